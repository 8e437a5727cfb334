//! The report on a triad: a sphere with its positions, what they leave of |a| - g, and what is determined.

use std::fs;
use std::path::Path;

use maud::{Markup, html};
use shared::triad::body::Axis as BodyAxis;

use super::figures::{Figure, WIDTH};
use super::frame::{self, Section};
use super::page::figure;
use super::plot::{Axis, Layer, Marker, Plot, Point, Shape, Ticks, colour};
use crate::campaign::TriadCampaign;
use crate::error::Error;
use crate::gate;
use crate::output::{write_file, write_json};
use crate::quantity::Quantity;
use crate::statics::{MEANINGS, NAMES};
use crate::triad::coverage::largest_hole;
use crate::triad::observations::directions;
use crate::triad::{TriadIdentification, TriadPrediction, identify, predict};

/// All that the report shows.
pub struct TriadReport {
    /// The coefficients.
    pub identification: TriadIdentification,
    /// Predictions of the campaign's runs, if it has some.
    pub prediction: Option<TriadPrediction>,
}

/// Writes `report.html`, `identification.json` and, with runs, `prediction.json` into the folder `out`, which is made if need be.
///
/// # Errors
/// Those of [`identify`], and what the file system says.
pub fn write(campaign: &TriadCampaign, out: &Path) -> Result<TriadReport, Error> {
    let identification = identify(campaign)?;
    let prediction = match campaign.runs.is_empty() {
        true => None,
        false => Some(predict(campaign, &campaign.runs)?),
    };
    let report = TriadReport {
        identification,
        prediction,
    };
    gate::check(&report.identification)?;
    gate::check(&report.prediction)?;
    let page = page(campaign, &report)?;
    fs::create_dir_all(out).map_err(Error::write(out))?;
    write_json(&out.join("identification.json"), &report.identification)?;
    if let Some(prediction) = &report.prediction {
        write_json(&out.join("prediction.json"), prediction)?;
    }
    write_file(&out.join("report.html"), page.as_bytes())?;
    Ok(report)
}

fn page(campaign: &TriadCampaign, report: &TriadReport) -> Result<String, Error> {
    let found = &report.identification;
    let section = |id, title, body| Section { id, title, body };
    let left = html! { (figure(&residuals(found))?) p { (left_out(found)) } };
    let mut sections = vec![
        section(
            "stood",
            "Where the triad stood",
            figure(&sphere(campaign, found))?,
        ),
        section("left", "What the positions leave", left),
        section("coefficients", "Coefficients", coefficients(found)),
        section(
            "blind",
            "What the orientations could not tell",
            blind(found),
        ),
    ];
    if let Some(prediction) = &report.prediction {
        sections.push(section(
            "runs",
            "Vibration error, predicted and measured",
            runs(campaign, prediction),
        ));
    }
    let foot = html! {
        "formats vre-campaign/1, " (found.format) ". The numbers of this page stand in full precision in identification.json beside it."
    };
    let title = format!(
        "Vibration rectification error of the triad {}",
        found.serial
    );
    let first = html! { p.lead { (lead(found)) } };
    Ok(frame::page(&title, &first, &sections, &foot))
}

fn lead(found: &TriadIdentification) -> String {
    let vre = &found.vre_at_1_g_rms_g;
    let cells = |of: &std::collections::BTreeMap<&str, Quantity>| {
        let each = BodyAxis::ALL
            .map(|axis| format!("{} {}", axis.name(), minus(of[axis.name()].scaled(1e6))));
        each.join(", ")
    };
    let attitude = match found.frame {
        "chosen" => "by hand, with no attitude known",
        _ => "with stated attitudes",
    };
    let prior = match found.cross_coupling_sigma_per_g {
        Some(sigma) => format!(
            "the cross-couplings being 0 \u{b1} {sigma:e} 1/g; without that statement {}",
            cells(&vre.without_prior)
        ),
        None => "no prior of the cross-couplings being stated".into(),
    };
    format!(
        "{} positions {attitude}. In white noise of 1 g rms along each input axis the vibration error will be {} \u{d7} \
         10\u{207b}\u{2076} g, {prior}.",
        found.residuals_g.len(),
        cells(&vre.with_prior)
    )
}

/// The sphere as two discs of equal area (Lambert), z up to the left, z down to the right.
fn sphere(campaign: &TriadCampaign, found: &TriadIdentification) -> Figure {
    let places = directions(campaign, &found.fitted.bounded.coefficients);
    let (hole, angle) = largest_hole(&places);
    let disc = |up: bool| {
        let onto = |d: &[f64; 3]| {
            let scale = (2.0 / (1.0 + d[2].abs())).sqrt();
            Point {
                x: scale * d[0],
                y: scale * d[1],
                ..Point::default()
            }
        };
        let here = |d: &&[f64; 3]| (d[2] >= 0.0) == up;
        let points: Vec<Point> = places.iter().filter(here).map(onto).collect();
        let rim = (0..=90).map(|k| {
            let (sin, cos) = (f64::from(k) * std::f64::consts::TAU / 90.0).sin_cos();
            (2f64.sqrt() * cos, 2f64.sqrt() * sin)
        });
        let mut layers = vec![
            Layer::unlabelled(colour::GREY, Shape::Thin(rim.collect())),
            Layer::new(
                "position",
                colour::BLUE,
                Shape::Points(Marker::Disc, points),
            ),
        ];
        if (hole[2] >= 0.0) == up {
            let cross = Shape::Points(Marker::Cross, vec![onto(&hole)]);
            layers.push(Layer::new(
                "middle of the largest hole",
                colour::ORANGE,
                cross,
            ));
        }
        let axis = |label: &str| Axis {
            label: label.into(),
            range: -1.6..1.6,
            ticks: Ticks::Every(1.0),
        };
        Plot {
            title: if up {
                "gravity's reaction on +z"
            } else {
                "on \u{2212}z"
            }
            .into(),
            x: axis("x, of equal area"),
            y: axis("y"),
            layers,
            size: (360, 370),
        }
    };
    Figure {
        plots: vec![disc(true), disc(false)],
        caption: format!(
            "Directions of the specific force on the body, both halves of the sphere. The largest hole is {:.0}\u{b0} from the \
             nearest position. Bad: half a disc without marks \u{2013} odd and even terms are not told apart there.",
            angle.to_degrees()
        ),
    }
}

fn residuals(found: &TriadIdentification) -> Figure {
    let points: Vec<Point> = found
        .residuals_g
        .iter()
        .enumerate()
        .filter(|(_, r)| r.is_finite())
        .map(|(k, residual)| Point {
            x: k as f64 + 1.0,
            y: residual * 1e6,
            ..Point::default()
        })
        .collect();
    let most = points.iter().map(|p| p.y.abs()).fold(1e-3, f64::max) * 1.2;
    Figure {
        plots: vec![Plot {
            title: "|a| less local gravity".into(),
            x: Axis {
                label: "position, in the order of positions.csv".into(),
                range: 0.0..found.residuals_g.len() as f64 + 1.0,
                ticks: Ticks::Round(8),
            },
            y: Axis {
                label: "|a| \u{2212} g / 10\u{207b}\u{2076} g".into(),
                range: -most..most,
                ticks: Ticks::Round(5),
            },
            layers: vec![Layer::new(
                "position",
                colour::BLUE,
                Shape::Points(Marker::Disc, points),
            )],
            size: (WIDTH, 260),
        }],
        caption: "What the coefficients leave of each position. Bad: a trend from left to right \u{2013} a bias that drifts; one \
                  mark far off \u{2013} a motion taken for a rest."
            .into(),
    }
}

fn left_out(found: &TriadIdentification) -> String {
    let left_out = &found.leave_one_out;
    let scatter = match found.scatter_g {
        0.0 => "The positions scatter as their stated noise says.".to_owned(),
        scatter => format!(
            "The positions scatter by {:.3} mg beyond their stated noise; that is in every uncertainty.",
            scatter * 1e3
        ),
    };
    let claimed = match left_out.claimed.as_slice() {
        [] => "no further term: none is borne out".to_owned(),
        claimed => claimed.join(", "),
    };
    format!(
        "Positions that were left out miss |a| = g by {:.2} \u{d7} 10\u{207b}\u{2076} g rms with scale factors, biases and misalignments \
         alone, by {:.2} with {claimed}. {scatter}",
        left_out.nine_parameters_rms_g * 1e6,
        left_out.rms_g * 1e6
    )
}

fn minus(quantity: Quantity) -> String {
    quantity.to_string().replace('-', "\u{2212}")
}

fn coefficients(found: &TriadIdentification) -> Markup {
    html! {
        div.wide { table {
            thead { tr { th { "" } th { "Coefficient" } @for axis in BodyAxis::ALL { th.number { (axis.name()) } } } }
            tbody {
                @for (k, (name, meaning)) in NAMES.iter().zip(MEANINGS).enumerate() {
                    tr {
                        td { (name) }
                        td { (meaning) @if k > 0 { ", 10" sup { "\u{2212}6" } } }
                        @for axis in BodyAxis::ALL {
                            td.number {
                                (minus(found.instruments[axis.name()].coefficients[name].scaled(if k == 0 { 1.0 } else { 1e6 })))
                            }
                        }
                    }
                }
            }
        } }
        p { "Standard uncertainties in parentheses, in units of the last digits. Assumed of higher terms that positions left out do not \
            bear out: 0 \u{b1} 5e-4 beforehand." }
    }
}

fn blind(found: &TriadIdentification) -> Markup {
    let plain = || found.blind_directions.iter().filter(|d| d.len() <= 4);
    let others = found.blind_directions.len() - plain().count();
    html! {
        p { "By themselves they tell " (found.rank) " of 33 directions, " (found.rank_with_prior) " with frame and prior." }
        @if !found.blind_directions.is_empty() {
            ul {
                @for direction in plain() {
                    li { @for (name, c) in direction { (format!("{c:+.2}\u{a0}{name} ").replace('-', "\u{2212}")) } }
                }
                @if others > 0 { li { (others) " combinations of many coefficients, which noise hides" } }
            }
        }
    }
}

fn runs(campaign: &TriadCampaign, prediction: &TriadPrediction) -> Markup {
    let cell = |q: Option<Quantity>| q.map_or("\u{2013}".into(), |q| minus(q.scaled(1e6)));
    html! {
        div.wide { table {
            thead { tr {
                th.number { "Run" } th { "Axis" } th { "Along x, y, z" } th.number { "Level / g" }
                th.number { "Predicted / 10" sup { "\u{2212}6" } " g" } th.number { "Measured" }
            } }
            tbody {
                @for (run, predicted) in campaign.runs.iter().zip(&prediction.runs) {
                    @for axis in BodyAxis::ALL {
                        tr {
                            td.number { (run.run) }
                            td { (axis.name()) }
                            td { (run.direction.map(|c| format!("{c:.2}")).join(", ").replace('-', "\u{2212}")) }
                            td.number { (run.level_g) }
                            td.number { (cell(Some(predicted.instruments[axis.name()].vre_g))) }
                            td.number { (cell(predicted.instruments[axis.name()].measured_vre_g)) }
                        }
                    }
                }
            }
        } }
    }
}
