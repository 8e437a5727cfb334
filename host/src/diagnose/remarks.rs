//! What is remarked beside the verdict: rows set aside, noise that is not as stated, what sessions have of their own.

use inference::fit::Fit;
use shared::model::NOMINAL;

use super::answer::{Estimate, NoiseFactor, SessionEstimate, SuspectRow};
use super::settle::Settled;
use crate::campaign::Campaign;
use crate::campaign_model::CampaignModel;
use crate::campaign_model::nuisances::Kind;

/// Standard deviations of a factor's logarithm from which on the stated noise does not hold: by chance one in 1e4.
const CLEAR: f64 = 4.0;

/// The rows that are set aside.
pub(super) fn suspects(campaign: &Campaign, settled: &Settled) -> Vec<SuspectRow> {
    let rows = settled.suspects.iter().map(|suspect| {
        let (file, what, number) = match suspect.reading {
            true => (
                "static.csv",
                "reading",
                campaign.readings[suspect.place].order,
            ),
            false => ("vibration.csv", "run", campaign.runs[suspect.place].run),
        };
        SuspectRow {
            file: file.into(),
            // The header is line 1.
            row: suspect.place as u64 + 2,
            what: what.into(),
            number,
            sigma_off: suspect.distance,
            would_explain: None,
            set_aside: true,
        }
    });
    rows.collect()
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
