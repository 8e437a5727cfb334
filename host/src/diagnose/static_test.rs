//! A static test by itself: which readings belong, and how far their stated noise holds.

use serde::Serialize;

use super::answer::{NoiseFactor, SuspectRow};
use super::remarks;
use crate::campaign::Campaign;
use crate::campaign_model::judge::{self, suspects};
use crate::statics::Identification;

/// What a static test says of its own readings.
#[derive(Clone, Debug)]
pub struct StaticTest {
    /// The campaign with the readings that belong, their uncertainties as the scatter shows them.
    pub belonging: Campaign,
    /// The readings that do not.
    pub suspects: Vec<SuspectRow>,
    /// How far the stated noise of the readings holds; empty where they are too few to tell.
    pub noise: Vec<NoiseFactor>,
}

/// The coefficients and what the readings say of each other: `vre-identification/1` as programs get it.
#[derive(Serialize)]
pub struct Identified<'a> {
    #[serde(flatten)]
    identification: &'a Identification,
    suspects: &'a [SuspectRow],
    noise: &'a [NoiseFactor],
}

impl<'a> Identified<'a> {
    /// Of an identification by the readings that belong.
    pub fn new(identification: &'a Identification, judged: &'a StaticTest) -> Self {
        Self {
            identification,
            suspects: &judged.suspects,
            noise: &judged.noise,
        }
    }
}

/// Judges the readings of a campaign by each other; those that determine nothing are as they are stated.
pub fn static_test(campaign: &Campaign) -> StaticTest {
    let Some(judged) = judge::static_test(campaign) else {
        return StaticTest {
            belonging: campaign.clone(),
            suspects: Vec::new(),
            noise: Vec::new(),
        };
    };
    let alone = Campaign {
        runs: Vec::new(),
        ..campaign.clone()
    };
    let (model, fit) = (&judged.model, &judged.fit);
    let far = suspects(&alone, model, fit, &judged.assumptions);
    let scatter = judged.scatter(&alone).into_iter();
    let noise = scatter.map(|found| NoiseFactor {
        // As it was judged: what smooth functions of the angle take is no noise.
        stated_holds: judged.assumptions.factor(found.0) == 1.0,
        ..remarks::noise(&found)
    });
    StaticTest {
        belonging: judged.assumptions.applied_to_readings(campaign),
        suspects: remarks::suspect_rows(&alone, &far, model, fit, &[]),
        noise: noise.collect(),
    }
}
