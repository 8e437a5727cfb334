//! Which test would best separate the hypotheses still standing.

use inference::fit::Fit;
use inference::information::{expected_bits, separations};
use inference::search::Search;

use super::answer::{NextTest, Verdict};
use super::proposals::{Proposal, proposals};
use super::verdict::{credible_set, name};
use crate::campaign::Campaign;
use crate::campaign_model::CampaignModel;
use crate::campaign_model::assumptions::Assumptions;

/// Tests that tell less are not proposed.
const LEAST_BITS: f64 = 0.01;
const PROPOSED: usize = 5;
/// Most hypotheses that a test is judged by.
const MOST_HYPOTHESES: usize = 3;

/// Tests by expected information, most telling first; none if one hypothesis is left, or none stands.
pub(super) fn next_tests(
    campaign: &Campaign,
    model: &CampaignModel,
    search: &Search,
    verdict: Verdict,
) -> Vec<NextTest> {
    let mut candidates = credible_set(search);
    candidates.truncate(MOST_HYPOTHESES);
    if !matches!(verdict, Verdict::Explained | Verdict::Ambiguous) || candidates.len() < 2 {
        return Vec::new();
    }
    let total: f64 = candidates.iter().map(|h| h.probability).sum();
    let probabilities: Vec<f64> = candidates.iter().map(|h| h.probability / total).collect();
    let fits: Vec<&Fit> = candidates.iter().map(|h| &h.fit).collect();
    let now = separations(model, &fits);
    let mut tests: Vec<NextTest> = proposals(campaign)
        .into_iter()
        .filter_map(|proposal| {
            let gained = gained(campaign, model, &proposal, &fits, &now);
            let expected_bits = expected_bits(&probabilities, &gained);
            (expected_bits > LEAST_BITS).then(|| NextTest {
                change: proposal.words,
                separates: fits.iter().map(|fit| name(model, fit)).collect(),
                expected_bits,
            })
        })
        .collect();
    tests.sort_by(|a, b| b.expected_bits.total_cmp(&a.expected_bits));
    tests.truncate(PROPOSED);
    tests
}

/// By how much a test would raise the squared distances between fits over `now`.
fn gained(
    campaign: &Campaign,
    model: &CampaignModel,
    proposal: &Proposal,
    fits: &[&Fit],
    now: &[Vec<f64>],
) -> Vec<Vec<f64>> {
    let mut larger = campaign.clone();
    let made = larger.runs.len();
    larger.readings.extend_from_slice(&proposal.readings);
    larger.runs.extend_from_slice(&proposal.runs);
    let scale_v_per_g = model.scale_v_per_g();
    let mut with = CampaignModel::with_scale(
        &larger,
        &[],
        model.effects(),
        &Assumptions::default(),
        scale_v_per_g,
    );
    with.believe(model.conditions().coefficients);
    if proposal.swapped {
        with.swap_reference_from(made);
    }
    let mut gained = separations(&with, fits);
    for (gained, now) in gained.iter_mut().flatten().zip(now.iter().flatten()) {
        *gained = (*gained - now).max(0.0);
    }
    gained
}

#[cfg(test)]
mod tests {
    use inference::fit::fit_base;
    use inference::model::Member;

    use super::*;
    use crate::bench::noise::Seed;
    use crate::bench::plan::Static;
    use crate::bench::simulate::{Specification, VirtualBench};
    use crate::effects;

    /// Squared distance that a proposal adds between an effect of that size and nothing.
    fn added(words: &str, id: &str, values: &[f64]) -> f64 {
        let specification = Specification::with_dial_sigma(1.0);
        let bench = VirtualBench::new(Seed(4), Static::Default, specification, Vec::new());
        let campaign = bench.simulate().campaign;
        let model = CampaignModel::new(&campaign, &[], &[effects::find(id).unwrap()]);
        let null = fit_base(&model).unwrap();
        let member = Member {
            component: 0,
            values: values.to_vec(),
        };
        let acting = Fit {
            members: vec![member],
            ..null.clone()
        };
        let fits = [&acting, &null];
        let proposals = proposals(&campaign);
        let proposal = proposals.iter().find(|p| p.words.contains(words)).unwrap();
        let now = separations(&model, &fits);
        gained(&campaign, &model, proposal, &fits, &now)[0][1]
    }

    #[test]
    fn a_swap_of_the_reference_shows_what_the_instrument_alone_feels() {
        // One part in a hundred against the reference's 2e-4, in six runs.
        let distance = added("swap the reference", "reference-scale", &[0.01]);
        assert!(distance > 6.0 * 50.0_f64.powi(2), "{distance}");
        assert!(added("swap the reference", "thermal-bias", &[1e-6]) < 100.0);
    }

    #[test]
    fn a_dwell_shows_what_takes_longer_than_a_run() {
        // A shift of a time constant of 100 s grows through a dwell of 600 s, but hardly in a run of 8 s.
        let heating = [1e-6, 100.0, 8.0];
        let dwell = added("a dwell of", "self-heating", &heating);
        let runs = added(
            "three sines of 6 g along the input axis at 180 Hz",
            "self-heating",
            &heating,
        );
        assert!(dwell > 10.0 * runs, "{dwell} {runs}");
    }
}
