//! Where the fit of a triad starts, and what its outputs betray before anything is fitted: another unit, columns that are
//! swapped, an axis upside down, positions in a plane.

use shared::identify::square_root::{TriangularFactor, storage_len};
use shared::model::Coefficients;
use shared::triad::body::Axis;
use shared::triad::start::Ellipsoid;

use crate::campaign::TriadCampaign;
use crate::error::{Error, decimal};

/// Relative difference from the nominal scale factor by which no instrument of the type differs.
const FOREIGN: f64 = 0.25;

/// Positions that a triad held by hand needs at least: three scale factors, three biases, three misalignments.
pub const LEAST_BY_HAND: usize = 9;

/// A linear triad near the outputs.
///
/// # Errors
/// Fewer positions than unknowns of a linear triad, or in a plane; outputs in another unit; axes swapped or upside down.
pub fn start(campaign: &TriadCampaign) -> Result<[Coefficients<f64>; 3], Error> {
    let by_hand = campaign.positions.iter().all(|p| p.attitude.is_none());
    let count = campaign.positions.len();
    let least = if by_hand { LEAST_BY_HAND } else { 4 };
    if count < least {
        let how = if by_hand {
            "held by hand"
        } else {
            "on a bench"
        };
        return Err(Error::Usage(format!(
            "positions.csv has {count} positions; a triad {how} needs {least} for scale factors, biases and misalignments \
             alone, and some 40 for what rectifies"
        )));
    }
    check_axes(campaign)?;
    let found = ellipsoid(campaign);
    match found {
        Some(found) => {
            check_unit(campaign, &found)?;
            Ok(found)
        }
        None if by_hand => Err(Error::Usage(
            "positions.csv: the positions lie nearly in a plane or on a circle and tell no triad; turn it about another axis \
             too"
                .into(),
        )),
        None => Ok([nominal(campaign); 3]),
    }
}

fn nominal(campaign: &TriadCampaign) -> Coefficients<f64> {
    Coefficients {
        scale_factor_v_per_g: campaign.config.instrument.scale_factor_nominal_v_per_g,
        ..Coefficients::default()
    }
}

/// The ellipsoid of the outputs, in whatever unit they are.
fn ellipsoid(campaign: &TriadCampaign) -> Option<[Coefficients<f64>; 3]> {
    let outputs = || campaign.positions.iter().map(|p| p.output_v);
    let sign = campaign
        .config
        .instrument
        .scale_factor_nominal_v_per_g
        .signum();
    let half_range = [0, 1, 2].map(|s| {
        let most = outputs().map(|u| u[s]).fold(f64::NEG_INFINITY, f64::max);
        let least = outputs().map(|u| u[s]).fold(f64::INFINITY, f64::min);
        (most - least) / 2.0
    });
    if half_range.iter().any(|half| *half <= 0.0) {
        return None;
    }
    let mut ellipsoid = Ellipsoid::new(half_range.map(|half| sign * half)).ok()?;
    outputs().for_each(|u| ellipsoid.absorb(u));
    ellipsoid.triad(campaign.config.bench.local_gravity_g)
}

fn check_unit(campaign: &TriadCampaign, found: &[Coefficients<f64>; 3]) -> Result<(), Error> {
    let nominal = campaign.config.instrument.scale_factor_nominal_v_per_g;
    for axis in Axis::ALL {
        let k1 = found[axis.index()].scale_factor_v_per_g;
        let ratio = k1 / nominal;
        if (ratio - 1.0).abs() <= FOREIGN {
            continue;
        }
        let hint = match ratio {
            r if (r / 9.80665 - 1.0).abs() < 0.05 => "; are the outputs in m/s^2?",
            r if (r * 9.80665 - 1.0).abs() < 0.05 => "; is the nominal one per m/s^2?",
            r if (r * 9.80665e-3 - 1.0).abs() < 0.05 => "; are the outputs in mm/s^2?",
            r if (r / 1000.0 - 1.0).abs() < 0.1 => "; are the outputs in thousandths?",
            _ => "; another triad, or counts without their scale?",
        };
        return Err(Error::Usage(format!(
            "positions.csv, column u_{}_v: the outputs come to {} V/g, which does not fit scale_factor_nominal_v_per_g = {} of \
             campaign.toml{hint}",
            axis.name(),
            rounded(k1),
            decimal(nominal)
        )));
    }
    Ok(())
}

/// Where attitudes are known each output must follow its own axis, and with the sign of the nominal scale factor.
fn check_axes(campaign: &TriadCampaign) -> Result<(), Error> {
    let nominal = campaign.config.instrument.scale_factor_nominal_v_per_g;
    for axis in Axis::ALL {
        let s = axis.index();
        let Some(slopes) = slopes(campaign, s) else {
            continue;
        };
        let largest = |best: usize, k: usize| {
            if slopes[k].abs() > slopes[best].abs() {
                k
            } else {
                best
            }
        };
        let most = (0..3).fold(s, largest);
        let name = axis.name();
        if most != s {
            let other = Axis::ALL[most].name();
            return Err(Error::Usage(format!(
                "positions.csv, column u_{name}_v: follows a_{other}_g, not a_{name}_g; are columns u_{name}_v and u_{other}_v \
                 swapped?"
            )));
        }
        if slopes[s] * nominal < 0.0 {
            return Err(Error::Usage(format!(
                "positions.csv, column u_{name}_v: falls where a_{name}_g rises; is the axis {name} upside down?"
            )));
        }
    }
    Ok(())
}

/// Slopes of an output by the stated specific force along x, y, z, V/g; `None` where the stated attitudes do not tell them.
fn slopes(campaign: &TriadCampaign, instrument: usize) -> Option<[f64; 3]> {
    let mut factor = TriangularFactor::new(4, [0.0; storage_len(4)]).ok()?;
    let mut known = 0;
    for position in &campaign.positions {
        if let Some(attitude) = position.attitude {
            let [x, y, z] = attitude.direction;
            factor.absorb(&mut [x, y, z, 1.0, position.output_v[instrument]]);
            known += 1;
        }
    }
    let told = (0..4).all(|k| factor.row(k)[0].abs() > 0.1);
    let mut x = [0.0; 4];
    (known >= 4 && told).then_some(())?;
    factor.solve(0, &mut x).ok()?;
    Some([x[0], x[1], x[2]])
}

/// With four digits.
fn rounded(value: f64) -> String {
    decimal(format!("{value:.3e}").parse().unwrap_or(value))
}
