//! The pictures of the report, each with a sentence on what to look at and what would be bad.

use std::collections::BTreeMap;

use plotters::style::RGBColor;
use shared::model::NOMINAL;
use shared::tumble::{Position, Series, within_a_turn};

use super::plot::{Axis, Layer, Marker, Name, Plot, Point, Shape, Ticks, colour, span, symmetric};
use super::{Report, SYMBOLS, outlook, remarks};
use crate::statics;

/// Plots that belong together, with their explanation.
pub(super) struct Figure {
    pub plots: Vec<Plot>,
    pub caption: String,
}

pub(super) const WIDTH: u32 = 720;

const SERIES: [(Series, &str, RGBColor, Marker); 3] = [
    (
        Series::OutputAxis,
        "series 1, OA along the shaft",
        colour::BLUE,
        Marker::Disc,
    ),
    (
        Series::PendulousAxis,
        "series 2, PA along the shaft",
        colour::ORANGE,
        Marker::Triangle,
    ),
    (
        Series::InputAxis,
        "series 3, IA along the shaft",
        colour::GREEN,
        Marker::Square,
    ),
];

fn dial_axis() -> Axis {
    Axis {
        label: "angle of the instrument, dial + mount / deg".into(),
        range: -8.0..368.0,
        ticks: Ticks::Every(45.0),
    }
}

/// Readings over the angle, with the fitted model.
pub(super) fn readings(report: &Report) -> Figure {
    let model = &report.fit.coefficients;
    let gravity_g = report.campaign.config.bench.local_gravity_g;
    let mut layers = Vec::new();
    for (series, label, colour, marker) in SERIES {
        let readings = report
            .campaign
            .readings
            .iter()
            .filter(|r| r.series == series);
        let points: Vec<Point> = readings
            .map(|r| Point {
                x: within_a_turn(r.dial_deg + r.mount_deg),
                y: r.output_v / model.scale_factor_v_per_g,
                name: Some(Name::Reading(r.order, r.line)),
                ..Point::default()
            })
            .collect();
        if points.is_empty() {
            continue;
        }
        let curve = (0..=180).map(|step| {
            let phi_deg = 2.0 * f64::from(step);
            let mut a = series.specific_force(phi_deg.to_radians());
            (a.i, a.p, a.o) = (gravity_g * a.i, gravity_g * a.p, gravity_g * a.o);
            (phi_deg, model.output_g(a))
        });
        layers.push(Layer::unlabelled(colour, Shape::Thin(curve.collect())));
        layers.push(Layer::new(label, colour, Shape::Points(marker, points)));
    }
    let plot = Plot {
        title: "Readings over the dial angle".into(),
        x: dial_axis(),
        y: Axis {
            label: "output U / K1 / g".into(),
            range: -1.15..1.15,
            ticks: Ticks::Every(0.5),
        },
        layers,
        size: (WIDTH, 260),
    };
    Figure {
        plots: vec![plot],
        caption: "Every reading (marks) and the fitted model (curves). Series 1 and 2 follow \u{2212}cos \u{3c6} and lie on top of each other, series 3 \
                  stays near zero, as gravity never acts along its input axis. Bad: a mark off its curve \u{2013} a wrong \
                  angle, series or sign in static.csv."
            .into(),
    }
}

/// Residuals of one reading's position: where it stands, in which series and mount, and how large it is.
struct Residual {
    name: Name,
    position: Position,
    residual_g: f64,
    /// Standard deviation expected from dial, level and noise, g.
    sigma_g: f64,
}

/// Residuals at the nominal angle, less what the angle of each series and mount explains.
fn residuals_about_mounts(report: &Report) -> Vec<Residual> {
    let bench = statics::bench(&report.campaign.config.bench);
    let k1 = report.fit.coefficients.scale_factor_v_per_g;
    let tangent = |p: &Position| bench.local_gravity_g * p.series.tangent(p.phi_rad()).i;
    let mut mounts: BTreeMap<(u8, u64), (f64, f64)> = BTreeMap::new();
    let of = |p: &Position| (u8::from(p.series), p.mount_deg.to_bits());
    let all: Vec<(Position, f64, f64, Name)> = report
        .campaign
        .readings
        .iter()
        .zip(&report.identification.residuals_g)
        .map(|(r, residual)| {
            let name = Name::Reading(r.order, r.line);
            (statics::position(r), *residual, r.sigma_v / k1.abs(), name)
        })
        .collect();
    for (position, residual, ..) in &all {
        let slope = tangent(position);
        let sums = mounts.entry(of(position)).or_default();
        sums.0 += slope * residual;
        sums.1 += slope * slope;
    }
    all.into_iter()
        .map(|(position, residual, noise_g, name)| {
            let slope = tangent(&position);
            let angle_rad = match mounts.get(&of(&position)) {
                Some((product, square)) if *square > 1e-9 => product / square,
                _ => 0.0,
            };
            let dial = bench.dial_sigma_rad.hypot(bench.dial_repeat_sigma_rad) * slope;
            let lift =
                bench.level_sigma_rad * bench.local_gravity_g * position.series.lift::<f64>().i;
            Residual {
                name,
                position,
                residual_g: residual - angle_rad * slope,
                sigma_g: dial.hypot(lift).hypot(noise_g),
            }
        })
        .collect()
}

/// Residuals of the static fit, one plot a series.
pub(super) fn residuals(report: &Report) -> Figure {
    let all = residuals_about_mounts(report);
    let values = all
        .iter()
        .flat_map(|r| [r.residual_g, 2.0 * r.sigma_g, -2.0 * r.sigma_g]);
    let range = span(values.map(|value| 1e6 * value));
    let bench = statics::bench(&report.campaign.config.bench);
    let mut mounts: Vec<f64> = all.iter().map(|r| r.position.mount_deg).collect();
    mounts.sort_by(f64::total_cmp);
    mounts.dedup();
    let looks = [
        Marker::Disc,
        Marker::Circle,
        Marker::Triangle,
        Marker::Cross,
    ];
    let mut plots = Vec::new();
    for (series, label, colour, _) in SERIES {
        let own: Vec<&Residual> = all.iter().filter(|r| r.position.series == series).collect();
        let Some(first) = own.first() else { continue };
        // Noise and level do not depend on the angle, the dial's part goes with the tangent.
        let slope = |phi_deg: f64| bench.local_gravity_g * series.tangent(phi_deg.to_radians()).i;
        let dial = bench.dial_sigma_rad.hypot(bench.dial_repeat_sigma_rad);
        let rest = (first.sigma_g.powi(2)
            - (dial * slope(first.position.phi_rad().to_degrees())).powi(2))
        .max(0.0);
        let band = (0..=180).map(|step| {
            let phi_deg = 2.0 * f64::from(step);
            let half = 2e6 * ((dial * slope(phi_deg)).powi(2) + rest).sqrt();
            (phi_deg, -half, half)
        });
        let mut layers = vec![Layer::new(
            "95 % band of dial, level and noise",
            colour::GREY,
            Shape::Band(band.collect()),
        )];
        for (index, mount_deg) in mounts.iter().enumerate() {
            let points: Vec<Point> = own
                .iter()
                .filter(|r| r.position.mount_deg == *mount_deg)
                .map(|r| Point {
                    x: within_a_turn(r.position.dial_deg + mount_deg),
                    y: 1e6 * r.residual_g,
                    name: Some(r.name),
                    ..Point::default()
                })
                .collect();
            if !points.is_empty() {
                let name = if mounts.len() > 1 {
                    format!("{label}, mounted at {mount_deg} deg")
                } else {
                    label.to_owned()
                };
                layers.push(Layer::new(
                    &name,
                    colour,
                    Shape::Points(looks[index % looks.len()], points),
                ));
            }
        }
        plots.push(Plot {
            title: format!("Residuals, {label}"),
            x: dial_axis(),
            y: Axis {
                label: "residual / 10\u{207b}\u{2076} g".into(),
                range: range.clone(),
                ticks: Ticks::Round(4),
            },
            layers,
            size: (WIDTH, 190),
        });
    }
    Figure {
        plots,
        caption: "Reading less model at the nominal angle, the angle of each mounting taken out. A dial mark that is off by an \
                  angle moves the output by that angle times sin \u{3c6}: the band is wide at 90 and 270 deg and narrow at 0 \
                  and 180 deg. The readings at one mark share its error, so repeats lie close together anywhere within the \
                  band. Series 3 sees the dial not at all: noise, and one tilt of the base as an offset. Bad: many marks outside of the band, or a trend within one angle."
            .into(),
    }
}

/// The coefficients with bars, and their uncertainties on a logarithmic scale.
pub(super) fn coefficients(report: &Report) -> Figure {
    let quantities = &report.identification.coefficients;
    // K1 has another unit; the first coefficient stands on top.
    let rows: Vec<usize> = (1..NOMINAL).rev().collect();
    let name = |k: usize| match quantities[k].known() {
        Some(_) => SYMBOLS[k].to_owned(),
        None => format!("{} (blind)", SYMBOLS[k]),
    };
    let names: Vec<String> = rows.iter().map(|k| name(*k)).collect();
    let known = || {
        rows.iter().enumerate().filter_map(|(row, k)| {
            quantities[*k]
                .known()
                .map(|(value, sigma)| (row as f64, 1e6 * value, 1e6 * sigma))
        })
    };
    let y = || Axis {
        label: String::new(),
        range: -0.6..rows.len() as f64 - 0.4,
        ticks: Ticks::Names(names.clone()),
    };
    let values = known().map(|(row, value, sigma)| Point {
        x: value,
        y: row,
        x_bar: 2.0 * sigma,
        ..Point::default()
    });
    let ends =
        known().flat_map(|(_, value, sigma)| [value - 2.0 * sigma, value + 2.0 * sigma, 0.0]);
    let range = span(ends);
    let zero = Shape::Dashes(vec![(0.0, -0.6), (0.0, rows.len() as f64 - 0.4)]);
    let value_plot = Plot {
        title: "Coefficients with 95 % intervals".into(),
        x: Axis {
            label: "coefficient / 10\u{207b}\u{2076} of its unit".into(),
            range,
            ticks: Ticks::Round(6),
        },
        y: y(),
        layers: vec![
            Layer::unlabelled(colour::GREY, zero),
            Layer::new(
                "coefficient with its 95 % interval (k = 2)",
                colour::BLUE,
                Shape::Points(Marker::Disc, values.collect()),
            ),
        ],
        size: (WIDTH / 2, 330),
    };
    let sigmas = known()
        .filter(|(_, _, sigma)| *sigma > 0.0)
        .map(|(row, _, sigma)| Point {
            x: sigma.log10(),
            y: row,
            ..Point::default()
        });
    let sigmas: Vec<Point> = sigmas.collect();
    let sigma_plot = Plot {
        title: "Standard uncertainties of the coefficients".into(),
        x: Axis {
            label: "standard uncertainty / 10\u{207b}\u{2076} of its unit".into(),
            range: span(sigmas.iter().map(|p| p.x)),
            ticks: Ticks::Decades,
        },
        y: y(),
        layers: vec![Layer::new(
            "standard uncertainty (k = 1)",
            colour::ORANGE,
            Shape::Points(Marker::Square, sigmas),
        )],
        size: (WIDTH / 2, 330),
    };
    Figure {
        plots: vec![value_plot, sigma_plot],
        caption: "Left the coefficients of the static test, right how well each is known, on a logarithmic scale. For the \
                  vibration error k1\u{2032}, k2, k3, k4 and the cross-couplings count; the misalignments d do not. Bad: an \
                  interval of k2 or k4 that reaches across zero, or a coefficient without a mark, which the plan does not \
                  determine."
            .into(),
    }
}

/// Predicted against measured vibration error; none without measured runs.
pub(super) fn comparison(report: &Report) -> Option<Figure> {
    let (mut from_static, mut from_refit) = (Vec::new(), Vec::new());
    for (run, made) in report.prediction.runs.iter().zip(&report.campaign.runs) {
        let Some((measured, sigma)) = run.measured_vre_g.and_then(|q| q.known()) else {
            continue;
        };
        let point = |(value, uncertainty): (f64, f64)| Point {
            x: 1e6 * measured,
            y: 1e6 * value,
            x_bar: 2e6 * sigma,
            y_bar: 2e6 * uncertainty,
            name: Some(Name::Run(made.run, made.line)),
        };
        from_static.extend(run.vre_g.known().map(point));
        from_refit.extend(run.refit_vre_g.and_then(|q| q.known()).map(point));
    }
    if from_static.is_empty() {
        return None;
    }
    let differences = differences(&from_static, &from_refit);
    let both = || from_static.iter().chain(&from_refit);
    let x = span(both().map(|p| p.x));
    let y = span(both().flat_map(|p| [p.y - p.y_bar, p.y + p.y_bar]));
    let (low, high) = (x.start.max(y.start), x.end.min(y.end));
    let plot = Plot {
        title: "Predicted against measured vibration error".into(),
        x: Axis {
            label: "measured VRE / 10\u{207b}\u{2076} g".into(),
            range: x,
            ticks: Ticks::Round(8),
        },
        y: Axis {
            label: "predicted VRE / 10\u{207b}\u{2076} g".into(),
            range: y,
            ticks: Ticks::Round(7),
        },
        layers: vec![
            Layer::new(
                "predicted = measured",
                colour::GREY,
                Shape::Dashes(vec![(low, low), (high, high)]),
            ),
            Layer::new(
                "from the static test, 95 % interval (k = 2)",
                colour::BLUE,
                Shape::Points(Marker::Disc, from_static),
            ),
            Layer::new(
                "static + shaker, 95 % interval (k = 2)",
                colour::ORANGE,
                Shape::Points(Marker::Circle, from_refit),
            ),
        ],
        size: (WIDTH, 420),
    };
    Some(Figure {
        plots: vec![plot, differences],
        caption: "One mark a run; it tells its number where a pointer rests on it. Below, the differences, over the measured error on an axis \
                  that is logarithmic away from zero, so that small errors are seen too. The bars of the static prediction should reach the dashed line (below: zero); long bars mean that the plan or \
                  the dial leaves the prediction uncertain, which is no error. Bad: a short bar that misses the line, or an open \
                  circle off the line: the model does not hold for that run."
            .into(),
    })
}

/// Predicted less measured over the measured error, on an axis that is linear within the smallest uncertainty.
fn differences(from_static: &[Point], from_refit: &[Point]) -> Plot {
    let bars = from_static.iter().map(|p| p.x_bar).filter(|bar| *bar > 0.0);
    let linear = bars.fold(f64::INFINITY, f64::min).clamp(1e-3, 1e3);
    let difference = |p: &Point| Point {
        x: symmetric(p.x, linear),
        y: p.y - p.x,
        x_bar: 0.0,
        y_bar: p.x_bar.hypot(p.y_bar),
        name: p.name,
    };
    let [statics, refits] = [from_static, from_refit]
        .map(|points| points.iter().map(difference).collect::<Vec<Point>>());
    let both = || statics.iter().chain(&refits);
    let x = span(both().map(|p| p.x));
    let y = span(both().flat_map(|p| [p.y - p.y_bar, p.y + p.y_bar]));
    Plot {
        title: "Predicted less measured vibration error".into(),
        x: Axis {
            label: "measured VRE / 10\u{207b}\u{2076} g, symmetric logarithmic".into(),
            range: x.clone(),
            ticks: Ticks::Symmetric(linear),
        },
        y: Axis {
            label: "predicted \u{2212} measured / 10\u{207b}\u{2076} g".into(),
            range: y,
            ticks: Ticks::Round(6),
        },
        layers: vec![
            Layer::unlabelled(
                colour::GREY,
                Shape::Dashes(vec![(x.start, 0.0), (x.end, 0.0)]),
            ),
            Layer::unlabelled(colour::BLUE, Shape::Points(Marker::Disc, statics)),
            Layer::unlabelled(colour::ORANGE, Shape::Points(Marker::Circle, refits)),
        ],
        size: (WIDTH, 260),
    }
}

/// The gap of each run in units of its uncertainty; none without measured runs.
pub(super) fn gaps(report: &Report) -> Option<Figure> {
    let gaps = remarks::gaps(report);
    let (first, last) = (gaps.first()?.run as f64, gaps.last()?.run as f64);
    let points = |of: &dyn Fn(&remarks::Gap) -> Option<f64>| -> Vec<Point> {
        let all = gaps.iter().filter_map(|g| {
            Some(Point {
                x: g.run as f64,
                y: of(g)?,
                name: Some(Name::Run(g.run, line_of(report, g.run))),
                ..Point::default()
            })
        });
        all.collect()
    };
    let plot = |title: &str, colour, marker, points: Vec<Point>| {
        let x = span(points.iter().map(|p| p.x).chain([first - 0.5, last + 0.5]));
        let y = span(points.iter().map(|p| p.y).chain([-4.0, 4.0]));
        let across = |level: f64| Shape::Dashes(vec![(x.start, level), (x.end, level)]);
        Plot {
            title: title.into(),
            x: Axis {
                label: "run".into(),
                range: x.clone(),
                ticks: Ticks::Round(10),
            },
            y: Axis {
                label: "gap / its uncertainty".into(),
                range: y,
                ticks: Ticks::Round(6),
            },
            layers: vec![
                Layer::new(
                    "\u{b1} 3",
                    colour::GREY,
                    Shape::Band(vec![(x.start, -3.0, 3.0), (x.end, -3.0, 3.0)]),
                ),
                Layer::unlabelled(colour::GREY, across(0.0)),
                Layer::new(title, colour, Shape::Points(marker, points)),
            ],
            size: (WIDTH, 190),
        }
    };
    let mut plots = vec![plot(
        "measured less predicted from the static test",
        colour::BLUE,
        Marker::Disc,
        points(&|gap| Some(gap.from_static)),
    )];
    let fitted = points(&|gap| gap.from_refit);
    if !fitted.is_empty() {
        plots.push(plot(
            "measured less static + shaker",
            colour::ORANGE,
            Marker::Circle,
            fitted,
        ));
    }
    Some(Figure {
        plots,
        caption: "Above, measured less predicted from the static test over the uncertainty of both. All these predictions share one set \
                  of coefficients, so the marks may lean to one side together without anything being wrong. Below, what the model \
                  leaves when it is fitted to static test and shaker at once, over the uncertainty of the measurement: here the \
                  marks must scatter about zero. Bad: marks outside of the band; below they mean that something acts that \
                  the model does not have."
            .into(),
    })
}

/// Line of the table in which a run stands.
fn line_of(report: &Report, run: u64) -> u64 {
    let mut runs = report.campaign.runs.iter();
    runs.find(|made| made.run == run)
        .map_or(0, |made| made.line)
}

/// The predicted vibration error along the blind or least determined direction.
pub(super) fn direction(report: &Report) -> Figure {
    let direction = &report.direction;
    let here_g = outlook::white_noise(1.0).vre_g(&report.fit.coefficients);
    let reach = 3.0 * direction.sigma;
    let vre = |step: f64| 1e6 * (here_g + step * direction.vre_g_per_unit);
    let y = span([vre(-reach), vre(reach), 0.0]);
    let allowed = 2e6 * direction.sigma;
    let (band, colour) = if direction.blind {
        (
            "95 % by the assumption; the readings allow every step",
            colour::PURPLE,
        )
    } else {
        ("steps that the readings allow (95 %)", colour::GREEN)
    };
    let band = Layer::new(
        band,
        colour,
        Shape::Band(vec![(-allowed, y.start, y.end), (allowed, y.start, y.end)]),
    );
    let line = Shape::Line([-reach, reach].map(|step| (1e6 * step, vre(step))).to_vec());
    let estimate = vec![Point {
        x: 0.0,
        y: vre(0.0),
        ..Point::default()
    }];
    let plot = Plot {
        title: "Predicted vibration error along the direction".into(),
        x: Axis {
            label: "step along the direction / 10\u{207b}\u{2076}".into(),
            range: -1.04e6 * reach..1.04e6 * reach,
            ticks: Ticks::Round(8),
        },
        y: Axis {
            label: "VRE at 1 g rms / 10\u{207b}\u{2076} g".into(),
            range: y,
            ticks: Ticks::Round(6),
        },
        layers: vec![
            band,
            Layer::new(
                "predicted vibration error, white noise of 1 g rms along IA",
                colour::BLUE,
                line,
            ),
            Layer::new(
                "coefficients of this report",
                colour::INK,
                Shape::Points(Marker::Disc, estimate),
            ),
        ],
        size: (WIDTH, 260),
    };
    let caption = if direction.blind {
        "Every point of the line fits the readings equally well. Bad is a steep line: the quantity that the test is for is then \
         whatever one assumes."
    } else {
        "Within the band the readings cannot tell one set of coefficients from another. Bad is a line that changes much within the \
         band, compared with the error that is to be corrected."
    };
    Figure {
        plots: vec![plot],
        caption: caption.into(),
    }
}

/// The uncertainty of the predicted vibration error over the level.
pub(super) fn levels(report: &Report) -> Figure {
    let outlook = &report.outlook;
    let x: Vec<f64> = outlook.rms_g.iter().map(|rms| rms.log10()).collect();
    let curve = |values: &[f64]| -> Vec<(f64, f64)> {
        let points = x.iter().zip(values).filter(|(_, value)| **value != 0.0);
        points
            .map(|(x, value)| (*x, (1e6 * value.abs()).log10()))
            .collect()
    };
    let plans: Vec<_> = [&outlook.taken]
        .into_iter()
        .chain(&outlook.others)
        .collect();
    let floor = span(
        plans
            .iter()
            .flat_map(|plan| curve(&plan.sigma_g))
            .map(|(_, y)| y),
    )
    .start;
    // Where the error changes its sign its logarithm has no lower end.
    let error: Vec<_> = curve(&outlook.vre_g)
        .into_iter()
        .filter(|(_, y)| *y >= floor)
        .collect();
    let highest = plans
        .iter()
        .flat_map(|plan| curve(&plan.sigma_g))
        .chain(error.iter().copied());
    let y = floor..span(highest.map(|(_, y)| y)).end;
    let mut layers = vec![Layer::new(
        "the predicted error itself, for comparison",
        colour::GREY,
        Shape::Dashes(error),
    )];
    for (index, plan) in plans.iter().enumerate() {
        let points = curve(&plan.sigma_g);
        let (colour, shape) = match index {
            0 => (colour::BLUE, Shape::Line(points)),
            1 => (colour::ORANGE, Shape::Dashes(points)),
            _ => (colour::GREEN, Shape::Line(points)),
        };
        layers.push(Layer::new(&plan.name, colour, shape));
    }
    let plot = Plot {
        title: "Uncertainty of the predicted vibration error over the level".into(),
        x: Axis {
            label: "white noise along IA, a0 = 0 / g rms".into(),
            range: span(x.iter().copied()),
            ticks: Ticks::Decades,
        },
        y: Axis {
            label: "uncertainty of VRE / 10\u{207b}\u{2076} g".into(),
            range: y,
            ticks: Ticks::Decades,
        },
        layers,
        size: (WIDTH, 320),
    };
    let gain = match outlook.gain {
        Some(gain) if report.direction.blind => format!(
            " Repeating this plan, remounted or not, would not help, as it stays blind. Completed by the missing angles it is \
             determined; repeating all of it after remounting then divides the uncertainty by {gain:.1} at the highest level."
        ),
        Some(gain) => format!(
            " More readings of the same kind help little, as they share the errors of the dial's marks. At the highest level \
             remounting divides the uncertainty by {gain:.1} for the same number of readings, because the marks' errors then \
             separate from the coefficients."
        ),
        None => " This plan has more than one mount already, which separates the errors of the dial's marks from the coefficients."
            .into(),
    };
    Figure {
        plots: vec![plot],
        caption: format!(
            "Standard uncertainty of the vibration error predicted from the static test, both axes logarithmic. Bad: the line of \
             the plan as taken near or above the dashed grey line, where the prediction is as uncertain as the error is large.{gain}"
        ),
    }
}
