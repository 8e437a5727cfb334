//! What is remarked beside the verdict: rows set aside, noise that is not as stated, what sessions have of their own.

use inference::fit::Fit;
use shared::model::NOMINAL;

use super::answer::{
    AxisEstimate, Estimate, NoiseFactor, SessionEstimate, ShakerEstimate, SuspectRow,
};
use crate::campaign::{Campaign, Run};
use crate::campaign_model::CampaignModel;
use crate::campaign_model::assumptions::Noise;
use crate::campaign_model::judge::{Suspect, TOLD};
use crate::campaign_model::nuisances::Kind;
use crate::contradictions::{Contradiction, slip, slip_of_run};
use crate::forward::motion::Motion;
use crate::forward::nominal::{self, coefficients};
use crate::forward::rows::RunConditions;

/// Standard uncertainty of an output that a slip of the hand is judged by, g: what mounts and effects leave of it.
const SLIP_SIGMA_G: f64 = 3e-4;
/// The same of a vibration error.
const SLIP_OF_RUN_SIGMA_G: f64 = 2e-5;

/// Rows that are set aside, with what would make sense of each by a fit.
pub(super) fn suspect_rows(
    campaign: &Campaign,
    suspects: &[Suspect],
    model: &CampaignModel,
    fit: &Fit,
    contradictions: &[Contradiction],
) -> Vec<SuspectRow> {
    let believed = coefficients(&fit.base_values);
    let k1_v_per_g = model.scale_v_per_g() * fit.base_values[0];
    let output_v = |force| k1_v_per_g * believed.output_g(force);
    let shift_v = |run: &Run| {
        let conditions = RunConditions::from(run);
        let motion = Motion::commanded(&conditions, run.reference.as_ref());
        k1_v_per_g * nominal::value(&believed, &motion.sensitivity(&conditions).nominal)
    };
    let row = |suspect: &Suspect| {
        let place = suspect.place;
        let (file, line, what, number, slip) = if suspect.reading {
            let slip = slip(campaign, place, &output_v, SLIP_SIGMA_G * k1_v_per_g.abs());
            (
                "static.csv",
                campaign.readings[place].line,
                "reading",
                campaign.readings[place].order,
                slip,
            )
        } else {
            let likely = contradictions
                .iter()
                .find(|c| c.places(&campaign.runs).contains(&place));
            let sigma_v = SLIP_OF_RUN_SIGMA_G * k1_v_per_g.abs();
            let slip = likely
                .map(|contradiction| contradiction.likely.clone())
                .or_else(|| slip_of_run(campaign, place, &shift_v, sigma_v));
            let run = &campaign.runs[place];
            ("vibration.csv", run.line, "run", run.run, slip)
        };
        SuspectRow {
            file: file.into(),
            row: line,
            what: what.into(),
            number,
            sigma_off: suspect.distance,
            would_explain: slip,
            set_aside: true,
        }
    };
    suspects.iter().map(row).collect()
}

/// How far a stated noise holds, by the factor on it and that factor's relative standard uncertainty.
pub(super) fn noise(&(noise, factor, relative): &(Noise, f64, f64)) -> NoiseFactor {
    NoiseFactor {
        of: noise.name().into(),
        factor: Estimate {
            value: factor,
            sigma: factor * relative,
        },
        stated_holds: factor.ln().abs() < TOLD * relative,
    }
}

/// What each session after the first has of its own, by a fit.
pub(super) fn sessions(model: &CampaignModel, fit: &Fit) -> Vec<SessionEstimate> {
    let scale = fit.base_values[0];
    let mut sessions: Vec<SessionEstimate> = Vec::new();
    for (k, nuisance) in model.nuisances().iter().enumerate() {
        if nuisance.session.is_empty() {
            continue;
        }
        let unknown = NOMINAL + k;
        let estimate = Estimate {
            value: fit.base_values[unknown] / scale,
            sigma: fit.covariance(unknown, unknown).max(0.0).sqrt() / scale,
        };
        if sessions
            .last()
            .is_none_or(|last| last.session != nuisance.session)
        {
            sessions.push(SessionEstimate {
                session: nuisance.session.clone(),
                bias_g: None,
                alignment_rad: Vec::new(),
                gain: None,
            });
        }
        let Some(session) = sessions.last_mut() else {
            continue;
        };
        match nuisance.kind {
            Kind::Bias => session.bias_g = Some(estimate),
            Kind::Alignment => session.alignment_rad.push(estimate),
            Kind::Gain => {
                session.gain = Some(Estimate {
                    value: 1.0 + estimate.value,
                    ..estimate
                });
            }
            Kind::TableLevel | Kind::DetectorGain => {}
        }
    }
    sessions
}

/// What shaker, reference and peak detector have of their own, by a fit; `None` without runs.
pub(super) fn shaker(model: &CampaignModel, fit: &Fit) -> Option<ShakerEstimate> {
    let of = |kind: Kind| {
        let place = model.nuisances().iter().position(|n| n.kind == kind)?;
        let unknown = NOMINAL + place;
        Some(Estimate {
            value: 1.0 + fit.base_values[unknown] / fit.base_values[0],
            sigma: fit.covariance(unknown, unknown).max(0.0).sqrt() / fit.base_values[0],
        })
    };
    if model.conditions().runs.is_empty() {
        return None;
    }
    let reference = model.reference();
    const AXES: [&str; 3] = ["i", "p", "o"];
    let elements = |own: bool| -> Vec<AxisEstimate> {
        let Some(reference) = reference else {
            return Vec::new();
        };
        let pairs = (0..9).map(|k| (k / 3, k % 3));
        let pairs = pairs.filter(|(a, b)| (a == b) == own);
        let element = |(a, b): (usize, usize)| {
            let (value, sigma) = reference.response.element(a, b)?;
            Some(AxisEstimate {
                axis: AXES[a].into(),
                along: AXES[b].into(),
                value: if own { 1.0 + value } else { value },
                sigma,
            })
        };
        pairs.filter_map(element).collect()
    };
    Some(ShakerEstimate {
        reference_noise_g: reference.map(|r| r.noise_g),
        reference_scatter: reference.map(|r| r.scatter),
        table_scatter: reference.map(|r| r.table_scatter),
        reference_gain: elements(true),
        reference_cross_sensitivity: elements(false),
        table_level: of(Kind::TableLevel),
        peak_gain: of(Kind::DetectorGain),
    })
}
