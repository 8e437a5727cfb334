//! What a linear triad leaves of the positions, and which effect of statics makes it: drift, temperature, higher terms.
//!
//! About the fit, |a| - g of a position changes by sum_s u_s e_s with an error e_s of instrument s. Each effect is a group of three
//! columns, one an instrument, of a linear regression on |a| - g: a bias that drifts has e = t, one that follows temperature
//! e = T, a scale factor that does e = T a_I, a term of (1) its own function. An effect is named if |a| - g of positions that
//! were left out comes nearer to zero with it. Drift and temperature are asked first: on instruments where they are they are
//! far larger than nonlinearity, and a nonlinearity beside them is not to be trusted.

use serde::Serialize;
use shared::identify::square_root::{TriangularFactor, storage_len};
use shared::model::terms;
use shared::triad::body::{Axis, specific_force_g};
use shared::triad::identification::Prior;
use statrs::distribution::{ChiSquared, ContinuousCDF};

use super::fit::{fit, stated_prior};
use super::leave_out::GROUPS;
use crate::campaign::TriadCampaign;
use crate::error::Error;
use crate::quantity::Quantity;
use crate::statics::{NAMES, SUSPICIOUS};

/// What is found, `vre-diagnosis/1`.
#[derive(Clone, Debug, Serialize)]
pub struct TriadDiagnosis {
    /// Always `vre-diagnosis/1`.
    pub format: &'static str,
    /// Serial number.
    pub serial: String,
    /// Always `triad`.
    pub kind: &'static str,
    /// `no-gap`, `explained` or `unexplained`.
    pub verdict: &'static str,
    /// What the linear triad leaves.
    pub gap: Gap,
    /// The effects that are named, the first found first; empty without a gap.
    pub which: Vec<Named>,
    /// Positions left out.
    pub shrink: Shrink,
    /// Effects that these positions could not show.
    pub not_asked: Vec<&'static str>,
}

/// What the linear triad leaves of the positions.
#[derive(Clone, Debug, Serialize)]
pub struct Gap {
    /// Root mean square of |a| - g over its noise.
    pub rms_over_noise: f64,
    /// Probability of as much by noise alone.
    pub p_value: Option<f64>,
}

/// An effect.
#[derive(Clone, Debug, Serialize)]
pub struct Named {
    /// Its name.
    pub effect: &'static str,
    /// Size for each instrument.
    pub parameters: Vec<Parameter>,
}

/// A size of an effect.
#[derive(Clone, Debug, Serialize)]
pub struct Parameter {
    /// Name with instrument and unit.
    pub name: String,
    /// Its value.
    #[serde(flatten)]
    pub quantity: Quantity,
}

/// Root mean square of |a| - g of positions left out, g.
#[derive(Clone, Debug, Serialize)]
pub struct Shrink {
    /// By scale factors, biases and misalignments alone.
    pub held_out_rms_linear_g: f64,
    /// With the effects.
    pub held_out_rms_with_effects_g: f64,
}

/// A group of columns.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Column {
    /// Bias over time, g/s.
    BiasDrift,
    /// Bias over temperature, g/C.
    BiasTemperature,
    /// Scale factor over temperature, 1/C.
    ScaleTemperature,
    /// A group of terms of (1).
    Terms(usize),
}

impl Column {
    fn effect(self) -> &'static str {
        match self {
            Self::BiasDrift => "bias-drift",
            Self::BiasTemperature => "bias-temperature",
            Self::ScaleTemperature => "scale-temperature",
            Self::Terms(group) => GROUPS[group].0,
        }
    }

    /// Name with unit of a column; `k` counts the columns of an instrument.
    fn unit(self, k: usize) -> &'static str {
        match self {
            Self::BiasDrift => "bias_drift_g_per_s",
            Self::BiasTemperature => "bias_g_per_c",
            Self::ScaleTemperature => "scale_per_c",
            Self::Terms(group) => NAMES[GROUPS[group].1[k]],
        }
    }
}

/// A position as the regression takes it.
struct Row {
    /// |a| - g, g.
    residual_g: f64,
    /// Its standard uncertainty from noise, g.
    sigma_g: f64,
    /// Direction of gravity on the body axes, and local gravity times it.
    direction: [f64; 3],
    body_g: [f64; 3],
    /// Time and temperature about their means.
    time_s: f64,
    temp_c: f64,
}

/// Diagnoses the positions of a campaign.
///
/// # Errors
/// Those of [`fit`].
pub fn diagnose(campaign: &TriadCampaign) -> Result<TriadDiagnosis, Error> {
    let fitted = fit(campaign)?;
    let prior = stated_prior(campaign).beside_beforehand();
    let rows = rows(campaign, &fitted.bounded.coefficients);
    let spread = |of: fn(&Row) -> f64| rows.iter().map(|row| of(row).abs()).fold(0.0, f64::max);
    let timed = campaign.positions.iter().all(|p| p.time_s.is_some()) && spread(|r| r.time_s) > 0.0;
    let warm = campaign.positions.iter().all(|p| p.temp_c.is_some()) && spread(|r| r.temp_c) > 0.2;
    let first: Vec<Column> = [
        (Column::BiasDrift, timed),
        (Column::BiasTemperature, warm),
        (Column::ScaleTemperature, warm),
    ]
    .into_iter()
    .filter_map(|(column, asked)| asked.then_some(column))
    .collect();
    let second: Vec<Column> = (0..GROUPS.len()).map(Column::Terms).collect();
    let linear = regress(&rows, &[], &prior).ok_or_else(few)?;
    let mut named = Vec::new();
    let gap = gap(&linear);
    let is_gap = gap.p_value.is_some_and(|p| p < SUSPICIOUS);
    if is_gap {
        for stage in [&first, &second] {
            select(&rows, stage, &prior, &mut named);
        }
    }
    let last = regress(&rows, &named, &prior).ok_or_else(few)?;
    let left = self::gap(&last);
    let verdict = match (is_gap, left.p_value.is_some_and(|p| p < SUSPICIOUS)) {
        (false, _) => "no-gap",
        (true, false) if !named.is_empty() => "explained",
        _ => "unexplained",
    };
    let asked = |column: &Column| first.contains(column);
    let never = [
        Column::BiasDrift,
        Column::BiasTemperature,
        Column::ScaleTemperature,
    ];
    Ok(TriadDiagnosis {
        format: "vre-diagnosis/1",
        serial: campaign.config.instrument.serial.clone(),
        kind: "triad",
        verdict,
        gap,
        which: sizes(&last, &named, &left),
        shrink: Shrink {
            held_out_rms_linear_g: rms(&linear.left_out_g),
            held_out_rms_with_effects_g: rms(&last.left_out_g),
        },
        not_asked: never
            .iter()
            .filter(|c| !asked(c))
            .map(|c| c.effect())
            .collect(),
    })
}

fn few() -> Error {
    Error::Usage("positions.csv has too few positions, or too alike, for a diagnosis".into())
}

fn rows(campaign: &TriadCampaign, triad: &[shared::model::Coefficients<f64>; 3]) -> Vec<Row> {
    let gravity_g = campaign.config.bench.local_gravity_g;
    let count = campaign.positions.len() as f64;
    let mean = |of: fn(&crate::campaign::TriadPosition) -> Option<f64>| {
        campaign.positions.iter().filter_map(of).sum::<f64>() / count
    };
    let (time_s, temp_c) = (mean(|p| p.time_s), mean(|p| p.temp_c));
    // The linear triad alone: what its terms leave is what is to be explained.
    let linear = triad.map(|c| {
        let mut c = c.to_nominal();
        [2, 3, 4, 5, 8, 9, 10].iter().for_each(|k| c[*k] = 0.0);
        shared::model::Coefficients::from_nominal(c)
    });
    let row = |p: &crate::campaign::TriadPosition| {
        let a = specific_force_g(&linear, p.output_v)?;
        let length = a.iter().map(|x| x * x).sum::<f64>().sqrt();
        let direction = a.map(|x| x / length);
        let noise = [0, 1, 2].map(|s| direction[s] * p.sigma_v[s] / linear[s].scale_factor_v_per_g);
        Some(Row {
            residual_g: length - gravity_g,
            sigma_g: noise.iter().map(|x| x * x).sum::<f64>().sqrt(),
            direction,
            body_g: direction.map(|u| gravity_g * u),
            time_s: p.time_s.map_or(0.0, |t| t - time_s),
            temp_c: p.temp_c.map_or(0.0, |t| t - temp_c),
        })
    };
    campaign.positions.iter().filter_map(row).collect()
}

/// What |a| - g gains by each unit of the linear triad and of the columns.
fn sensitivities(row: &Row, columns: &[Column]) -> Vec<f64> {
    let [x, y, z] = row.direction;
    // Three biases, three scale factors, and three misalignments: a symmetric part alone changes a length.
    let mut all = vec![x, y, z, x * x, y * y, z * z, x * y, y * z, z * x];
    for column in columns {
        match column {
            Column::BiasDrift => all.extend(row.direction.map(|u| u * row.time_s)),
            Column::BiasTemperature => all.extend(row.direction.map(|u| u * row.temp_c)),
            Column::ScaleTemperature => all.extend(row.direction.map(|u| u * u * row.temp_c)),
            Column::Terms(group) => {
                for k in GROUPS[*group].1 {
                    for axis in Axis::ALL {
                        let f = terms(axis.on_instrument(row.body_g));
                        all.push(row.direction[axis.index()] * f[*k]);
                    }
                }
            }
        }
    }
    all
}

struct Regression {
    /// Residuals by all positions, over their noise.
    whitened: Vec<f64>,
    /// Residuals of each position by the others, g.
    left_out_g: Vec<f64>,
    values: Vec<f64>,
    sigma: Vec<f64>,
}

/// Standard deviation about zero, in the unit of each column, that keeps what the positions do not tell at zero: far above any
/// size of drift or temperature. Terms of (1) have what is stated or known of them.
const WIDE: f64 = 1.0;

/// Standard deviation about zero of each column: the linear triad first.
fn widths(columns: &[Column], prior: &Prior) -> Vec<f64> {
    let mut widths = vec![WIDE; LINEAR];
    for column in columns {
        match column {
            Column::Terms(group) => {
                let places = GROUPS[*group].1.iter();
                widths.extend(places.flat_map(|k| [prior.sigma[*k]; 3]));
            }
            _ => widths.extend([WIDE; 3]),
        }
    }
    widths
}

/// Unknowns of the linear triad: scale factors, biases, misalignments.
const LINEAR: usize = 9;

/// Weighted least squares; `None` with fewer positions than unknowns.
fn regress(rows: &[Row], columns: &[Column], prior: &Prior) -> Option<Regression> {
    let widths = widths(columns, prior);
    let n = widths.len();
    if rows.len() <= n {
        return None;
    }
    let mut factor = TriangularFactor::new(n, vec![0.0; storage_len(n)]).ok()?;
    for k in 0..n {
        let mut row = vec![0.0; n + 1];
        row[k] = widths[k].recip();
        factor.absorb(&mut row);
    }
    let whitened = |row: &Row| {
        let mut whitened: Vec<f64> = sensitivities(row, columns);
        whitened.iter_mut().for_each(|x| *x /= row.sigma_g);
        whitened
    };
    for row in rows {
        let mut all = whitened(row);
        all.push(row.residual_g / row.sigma_g);
        factor.absorb(&mut all);
    }
    let mut values = vec![0.0; n];
    factor.solve(0, &mut values).ok()?;
    let mut found = Regression {
        whitened: Vec::new(),
        left_out_g: Vec::new(),
        sigma: (0..n)
            .map(|k| {
                let mut unit = vec![0.0; n];
                unit[k] = 1.0;
                norm(&solve_transposed(&factor, &unit))
            })
            .collect(),
        values,
    };
    for row in rows {
        let h = whitened(row);
        let fitted: f64 = h.iter().zip(&found.values).map(|(h, x)| h * x).sum();
        let residual = row.residual_g / row.sigma_g - fitted;
        // The leverage of a position tells what it would be off without itself.
        let leverage = norm(&solve_transposed(&factor, &h)).powi(2);
        found.whitened.push(residual);
        found
            .left_out_g
            .push(residual / (1.0 - leverage).max(1e-9) * row.sigma_g);
    }
    Some(found)
}

/// R^T y = h.
fn solve_transposed(factor: &TriangularFactor<f64, Vec<f64>>, h: &[f64]) -> Vec<f64> {
    let n = h.len();
    let mut y = h.to_vec();
    for k in 0..n {
        let row = factor.row(k);
        y[k] /= row[0];
        for j in k + 1..n {
            y[j] -= row[j - k] * y[k];
        }
    }
    y
}

fn norm(x: &[f64]) -> f64 {
    x.iter().map(|x| x * x).sum::<f64>().sqrt()
}

fn rms(x: &[f64]) -> f64 {
    norm(x) / (x.len() as f64).sqrt()
}

fn gap(regression: &Regression) -> Gap {
    let freedom = regression.whitened.len() as f64 - regression.values.len() as f64;
    let chi2 = norm(&regression.whitened).powi(2);
    Gap {
        rms_over_noise: (chi2 / freedom).sqrt(),
        p_value: ChiSquared::new(freedom).ok().map(|chi| chi.sf(chi2)),
    }
}

/// Standard errors by which the mean square of positions left out must fall for an effect to be named. Chosen, as for terms that are
/// claimed.
const NAMED: f64 = 2.0;

/// Adds effects of a stage one after another, each time the one that brings most.
fn select(rows: &[Row], stage: &[Column], prior: &Prior, named: &mut Vec<Column>) {
    loop {
        let Some(current) = regress(rows, named, prior) else {
            return;
        };
        let mut best: Option<(Column, f64)> = None;
        for column in stage.iter().filter(|column| !named.contains(column)) {
            let with = [named.as_slice(), &[*column]].concat();
            let Some(tried) = regress(rows, &with, prior) else {
                continue;
            };
            let falls = current.left_out_g.iter().zip(&tried.left_out_g);
            let falls: Vec<f64> = falls.map(|(old, new)| old * old - new * new).collect();
            let mean = falls.iter().sum::<f64>() / falls.len() as f64;
            let scatter: f64 = falls.iter().map(|fall| (fall - mean).powi(2)).sum();
            let error = scatter.sqrt() / falls.len() as f64;
            if mean > NAMED * error && best.is_none_or(|(_, most)| mean > most) {
                best = Some((*column, mean));
            }
        }
        match best {
            Some((column, _)) => named.push(column),
            None => return,
        }
    }
}

fn sizes(regression: &Regression, named: &[Column], left: &Gap) -> Vec<Named> {
    // Where positions scatter beyond their noise still, so do the sizes.
    let factor = left.rms_over_noise.max(1.0);
    let mut next = LINEAR;
    let size = |column: &Column| {
        let count = match column {
            Column::Terms(group) => 3 * GROUPS[*group].1.len(),
            _ => 3,
        };
        let first = next;
        next += count;
        let parameter = |k: usize| Parameter {
            name: format!("{}.{}", Axis::ALL[k % 3].name(), column.unit(k / 3)),
            quantity: Quantity::new(
                // The regression tells what |a| - g has; an error of the output has the same sign.
                regression.values[first + k],
                factor * regression.sigma[first + k],
            ),
        };
        Named {
            effect: column.effect(),
            parameters: (0..count).map(parameter).collect(),
        }
    };
    named.iter().map(size).collect()
}
