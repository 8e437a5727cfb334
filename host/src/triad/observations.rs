//! The positions of a campaign as the identification takes them.

use shared::model::Coefficients;
use shared::triad::attitude::Position;
use shared::triad::body::specific_force_g;

use crate::campaign::TriadCampaign;

/// The positions of `campaign`, each output with the noise that is stated and `scatter_g` (g) besides, which is of each
/// position alone.
pub fn observations(campaign: &TriadCampaign, scatter_g: f64) -> Vec<Position> {
    let scatter_v = scatter_g * campaign.config.instrument.scale_factor_nominal_v_per_g;
    let position = |p: &crate::campaign::TriadPosition| Position {
        output_v: p.output_v,
        sigma_v: p.sigma_v.map(|sigma_v| sigma_v.hypot(scatter_v)),
        attitude: p.attitude,
    };
    campaign.positions.iter().map(position).collect()
}

/// Directions of the specific force at the positions, by the outputs of a triad of these coefficients.
pub fn directions(campaign: &TriadCampaign, triad: &[Coefficients<f64>; 3]) -> Vec<[f64; 3]> {
    let outputs = campaign.positions.iter().map(|p| p.output_v);
    let forces = outputs.filter_map(|output_v| specific_force_g(triad, output_v));
    forces
        .map(|a| {
            let length = a.iter().map(|x| x * x).sum::<f64>().sqrt();
            a.map(|x| x / length)
        })
        .collect()
}

/// Local gravity, g.
pub fn gravity_g(campaign: &TriadCampaign) -> f64 {
    campaign.config.bench.local_gravity_g
}
