//! What is remarked beside the verdict: rows set aside, noise that is not as stated, what sessions have of their own.

use inference::fit::Fit;
use shared::model::NOMINAL;

use super::answer::{Estimate, NoiseFactor, SessionEstimate, SuspectRow};
use super::settle::Settled;
use crate::campaign::{Campaign, Run};
use crate::campaign_model::CampaignModel;
use crate::campaign_model::judge::Suspect;
use crate::campaign_model::nuisances::Kind;
use crate::contradictions::{Contradiction, slip, slip_of_run};
use crate::forward::motion::Motion;
use crate::forward::nominal::{self, coefficients};
use crate::forward::rows::RunConditions;

/// Standard deviations of a factor's logarithm from which on the stated noise does not hold: by chance one in 1e4.
const CLEAR: f64 = 4.0;

/// Standard uncertainty of an output that a slip of the hand is judged by, g: what mounts and effects leave of it.
const SLIP_SIGMA_G: f64 = 3e-4;
/// The same of a vibration error.
const SLIP_OF_RUN_SIGMA_G: f64 = 2e-5;

/// The rows that are set aside, with what would make sense of each.
pub(super) fn suspects(
    campaign: &Campaign,
    settled: &Settled,
    fit: &Fit,
    contradictions: &[Contradiction],
) -> Vec<SuspectRow> {
    let believed = coefficients(&fit.base_values);
    let k1_v_per_g = settled.model.scale_v_per_g() * fit.base_values[0];
    let output_v = |force| k1_v_per_g * believed.output_g(force);
    let shift_v = |run: &Run| {
        let conditions = RunConditions::from(run);
        let motion = Motion::commanded(&conditions, run.reference.as_ref());
        k1_v_per_g * nominal::value(&believed, &motion.sensitivity(&conditions))
    };
    let row = |suspect: &Suspect| {
        let place = suspect.place;
        let (file, what, number, slip) = if suspect.reading {
            let slip = slip(campaign, place, &output_v, SLIP_SIGMA_G * k1_v_per_g.abs());
            (
                "static.csv",
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
            ("vibration.csv", "run", campaign.runs[place].run, slip)
        };
        SuspectRow {
            file: file.into(),
            // The header is line 1.
            row: place as u64 + 2,
            what: what.into(),
            number,
            sigma_off: suspect.distance,
            would_explain: slip,
            set_aside: true,
        }
    };
    settled.suspects.iter().map(row).collect()
}

/// How far the stated noise holds.
pub(super) fn noise(settled: &Settled) -> Vec<NoiseFactor> {
    let factors = settled
        .noise
        .iter()
        .map(|&(noise, factor, relative)| NoiseFactor {
            of: noise.name().into(),
            factor: Estimate {
                value: factor,
                sigma: factor * relative,
            },
            stated_holds: factor.ln().abs() < CLEAR * relative,
        });
    factors.collect()
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
