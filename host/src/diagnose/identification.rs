//! Why the prediction from the static test misses though nothing acts.

use super::answer::{IdentificationCause, Shrink};
use crate::campaign_model::CampaignModel;

/// A matter of the plan, or of the dial; none if the static prediction is nearly as good as any.
pub(super) fn cause(model: &CampaignModel, shrink: Shrink) -> Option<IdentificationCause> {
    let [statics, refit, floor] = [
        shrink.held_out_rms_static_only_g,
        shrink.held_out_rms_refit_g,
        shrink.noise_floor_rms_g,
    ]
    .map(|rms| rms * rms);
    if statics < 2.0 * refit.max(floor) {
        return None;
    }
    let cause = if model.blind_directions() > 0 {
        "plan-blindness"
    } else {
        "dial-noise"
    };
    let share = ((statics - refit) / (statics - floor)).clamp(0.0, 1.0);
    Some(IdentificationCause {
        cause: cause.into(),
        share,
    })
}
