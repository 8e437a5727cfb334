//! How well an effect can be seen at all.
//!
//! The *visibility* of an effect in a campaign is the Mahalanobis length of the difference that it makes to the five
//! observables beyond everything that the nominal model, its priors, the dial's and the level's errors and the noise can
//! do. Below 3 nobody can see it.

use inference::fit::fit_base;
use inference::model::SeparableModel;
use inference::remainder::Remainder;

use crate::campaign::Campaign;
use crate::campaign_model::CampaignModel;
use crate::campaign_model::assumptions::Assumptions;
use crate::campaign_model::observables::GAP;

/// Steps towards the visibility that is asked for.
const STEPS: usize = 12;
/// Relative error of the visibility at which the search ends, and the one that it must come to.
const ENOUGH: f64 = 0.05;
const TOLERATED: f64 = 0.4;

/// Visibility of what two campaigns of the same noise differ by; `None` if they do not determine the nominal model.
pub fn visibility(with: &Campaign, bare: &Campaign) -> Option<f64> {
    let model = CampaignModel::new(bare, &[], &[]);
    let changed = CampaignModel::with_scale(
        with,
        &[],
        &[],
        &Assumptions::default(),
        model.scale_v_per_g(),
    );
    let null = fit_base(&model)?;
    let [now, then] = [&changed, &model].map(|model| model.observations().observed().to_vec());
    let mut difference = vec![0.0; model.observations().len()];
    for row in GAP
        .into_iter()
        .flat_map(|observable| model.rows(observable))
    {
        difference[row] = now[row] - then[row];
    }
    let difference = model.observations().column(difference);
    Some(Remainder::new(&model, &null).length(&difference))
}

/// The strength at which the campaign that `with` makes has that visibility against `bare`; `None` if none does.
pub fn strength_for(wanted: f64, bare: &Campaign, with: impl Fn(f64) -> Campaign) -> Option<f64> {
    let seen = |strength: f64| visibility(&with(strength), bare);
    // A bracket first, then bisection in the logarithm, guided by proportion.
    let mut low: Option<(f64, f64)> = None;
    let mut high: Option<(f64, f64)> = None;
    let mut strength = 1.0_f64;
    for _ in 0..STEPS {
        let seen = seen(strength)?;
        if (seen / wanted).ln().abs() < ENOUGH {
            return Some(strength);
        }
        if seen < wanted {
            low = Some((strength, seen));
        } else {
            high = Some((strength, seen));
        }
        strength = match (low, high) {
            (Some((s, v)), None) => s * (wanted / v.max(1e-3)).clamp(1.2, 1e4),
            (None, Some((s, v))) => s * (wanted / v).clamp(1e-4, 0.8),
            (Some((a, va)), Some((b, vb))) => {
                let slope = (vb / va.max(1e-3)).ln().max(1e-9);
                let fraction = ((wanted / va.max(1e-3)).ln() / slope).clamp(0.1, 0.9);
                (a.ln() + fraction * (b / a).ln()).exp()
            }
            (None, None) => return None,
        };
        if !(1e-9..1e6).contains(&strength) {
            return None;
        }
    }
    // Near enough by the last step, or a jump that no strength fills.
    ((seen(strength)? / wanted).ln().abs() < TOLERATED).then_some(strength)
}
