//! The page of a measurement: what was taken of the record, each shift, and every doubt.

use maud::{Markup, html};

use super::figures::{Figure, WIDTH};
use super::frame::{self, Section};
use super::page::figure;
use super::plot::{Axis, Layer, Marker, Plot, Point, Shape, Ticks, colour, span};
use crate::error::Error;
use crate::measure::{
    self, Measurement, MotionKind, Outcome, Picture, Plateau, WaveformCoefficients,
};
use crate::quantity::Quantity;

/// The page, self-contained.
///
/// # Errors
/// A picture cannot be drawn.
pub fn measurement_page(found: &Measurement) -> Result<String, Error> {
    let first = html! {
        p.lead { "Verdict: " span.verdict { (found.verdict.name()) } }
        @for note in &found.notes { p { (note) } }
    };
    let mut sections = Vec::new();
    if let Some(picture) = &found.picture {
        sections.push(Section {
            id: "record",
            title: "The record",
            body: html! { (figure(&record(picture))?) },
        });
    }
    if !found.plateaus.is_empty() {
        sections.push(Section {
            id: "plateaus",
            title: "Plateaus",
            body: html! { (figure(&shifts(&found.plateaus))?) (table(&found.plateaus)) },
        });
    }
    if let Some(coefficients) = &found.coefficients {
        sections.push(Section {
            id: "coefficients",
            title: "Coefficients from the waveform",
            body: waveform(coefficients),
        });
    }
    let plateaus = found.plateaus.iter();
    let with_place = plateaus.flat_map(|plateau| {
        let place = format!("{:.3} to {:.3} s: ", plateau.from_s, plateau.to_s);
        plateau.axes.iter().map(move |axis| (place.clone(), axis))
    });
    let windows = found.axes.iter().map(|axis| (String::new(), axis));
    sections.push(Section {
        id: "doubts",
        title: "What else could have shifted the mean",
        body: html! { @for (place, axis) in with_place.chain(windows) { (doubts(&place, axis)) } },
    });
    let foot = html! { "format " (found.format) };
    let title = format!("Measured vibration error: {}", found.input);
    Ok(frame::page(&title, &first, &sections, &foot))
}

/// Least strength that is drawn, g: of what does not shake there is no logarithm.
const LEAST_G: f64 = 1e-9;

fn record(picture: &Picture) -> Figure {
    let [from, to] = picture.extent_s;
    let step = (to - from) / picture.rms_g.len().max(1) as f64;
    let line = picture.rms_g.iter().enumerate();
    let line: Vec<(f64, f64)> = line
        .map(|(n, rms)| (from + step * (n as f64 + 0.5), rms.max(LEAST_G).log10()))
        .collect();
    let y = span(line.iter().map(|point| point.1));
    let bands = |label: &str, colour, list: &[[f64; 2]]| -> Vec<Layer> {
        let band = |extent: &[f64; 2]| Shape::Band(extent.map(|at| (at, y.start, y.end)).to_vec());
        list.iter()
            .map(|extent| Layer::new(label, colour, band(extent)))
            .collect()
    };
    let mut layers = bands("rest", colour::GREY, &picture.rests_s);
    layers.extend(bands("plateau", colour::ORANGE, &picture.plateaus_s));
    layers.push(Layer::new(
        "what shakes, rms",
        colour::BLUE,
        Shape::Line(line),
    ));
    Figure {
        plots: vec![Plot {
            title: "The record, and what was taken of it".into(),
            x: Axis {
                label: "time, s".into(),
                range: from..to.max(from + f64::MIN_POSITIVE),
                ticks: Ticks::Round(8),
            },
            y: Axis {
                label: "rms, g".into(),
                range: y,
                ticks: Ticks::Decades,
            },
            layers,
            size: (WIDTH, 300),
        }],
        caption: "The root of the sum over the columns of the variance within pieces of equal length. Each plateau is compared \
            with the rests beside it; what is neither is left out."
            .into(),
    }
}

fn shifts(plateaus: &[Plateau]) -> Figure {
    const COLOURS: [plotters::style::RGBColor; 4] =
        [colour::BLUE, colour::ORANGE, colour::GREEN, colour::PURPLE];
    let columns = plateaus.first().map_or(0, |plateau| plateau.axes.len());
    let points = |column: usize| -> Vec<Point> {
        let axes = plateaus
            .iter()
            .filter_map(|p| Some((p, p.axes.get(column)?)));
        axes.filter_map(|(plateau, axis)| {
            let [low, high] = axis.interval_95_g;
            Some(Point {
                x: 0.5 * (plateau.from_s + plateau.to_s),
                y: 1e3 * axis.shift_g.value?,
                y_bar: Some(0.5e3 * (high - low))
                    .filter(|bar| bar.is_finite())
                    .unwrap_or(0.0),
                ..Point::default()
            })
        })
        .collect()
    };
    let series: Vec<Vec<Point>> = (0..columns).map(points).collect();
    let all = || series.iter().flatten();
    let heights = all()
        .flat_map(|p| [p.y - p.y_bar, p.y + p.y_bar])
        .chain([0.0]);
    let (x, y) = (span(all().map(|p| p.x)), span(heights));
    let mut layers = vec![Layer::unlabelled(
        colour::GREY,
        Shape::Line(vec![(x.start, 0.0), (x.end, 0.0)]),
    )];
    let names = plateaus
        .first()
        .map_or(&[][..], |plateau| plateau.axes.as_slice());
    for ((axis, points), colour) in names.iter().zip(series).zip(COLOURS.iter().cycle()) {
        layers.push(Layer::new(
            &axis.column,
            *colour,
            Shape::Points(Marker::Disc, points),
        ));
    }
    Figure {
        plots: vec![Plot {
            title: "Shift of the mean under vibration".into(),
            x: Axis {
                label: "time, s".into(),
                range: x,
                ticks: Ticks::Round(8),
            },
            y: Axis {
                label: "shift, mg".into(),
                range: y,
                ticks: Ticks::Round(6),
            },
            layers,
            size: (WIDTH, 300),
        }],
        caption: "Bars are the intervals of 95 %.".into(),
    }
}

fn table(plateaus: &[Plateau]) -> Markup {
    html! {
        div.wide { table {
            thead { tr {
                th { "from, s" } th { "to, s" } th { "motion" } th { "column" } th { "shift, mg" } th { "against the rest" } th { "verdict" }
            } }
            tbody { @for plateau in plateaus { @for axis in &plateau.axes { tr {
                td.number { (format!("{:.3}", plateau.from_s)) }
                td.number { (format!("{:.3}", plateau.to_s)) }
                td { (motion(plateau)) }
                td { (axis.column) }
                td.number { (in_mg(axis.shift_g)) }
                td { (plateau.against) }
                td { (axis.verdict.name()) }
            } } } }
        } }
    }
}

fn motion(plateau: &Plateau) -> String {
    match (plateau.kind, plateau.frequency_hz, plateau.band_hz) {
        (MotionKind::Sine, Some(hz), _) => {
            format!("sine, {:.4} g peak, {hz:.4} Hz", plateau.level_g)
        }
        (_, _, Some([low, high])) => format!(
            "random, {:.4} g rms, {low:.4} to {high:.4} Hz",
            plateau.level_g
        ),
        _ => format!("{:.4} g", plateau.level_g),
    }
}

/// A figure whose uncertainty is unknown still has a value.
fn in_mg(figure: Quantity) -> String {
    let figure = figure.scaled(1e3);
    match (figure.value, figure.sigma) {
        (Some(value), None) => format!("{value}(?)"),
        _ => figure.to_string(),
    }
}

fn doubts(place: &str, axis: &measure::Axis) -> Markup {
    let word = |doubt: &measure::Doubt| match (doubt.outcome, doubt.decisive) {
        (Outcome::Found, true) => "found",
        (Outcome::Found, false) => "found, too small",
        (Outcome::Clear, _) => "clear",
        (Outcome::NotLookedFor, _) => "not looked for",
    };
    html! {
        h3 { (place) (axis.column) ": " (in_mg(axis.shift_g)) " mg, " (axis.verdict.name()) }
        div.wide { table {
            thead { tr { th { "doubt" } th { "outcome" } th { "finding" } } }
            tbody { @for doubt in &axis.doubts {
                tr { td { (doubt.kind.name()) } td { (word(doubt)) } td { (doubt.finding) } }
            } }
        } }
    }
}

fn waveform(found: &WaveformCoefficients) -> Markup {
    let [least, most] = found.amplitudes_g;
    html! {
        p { "From the harmonics of " (found.blocks) " stretches of " (format!("{:.4}", found.block_s)) " s, "
            (format!("{least:.4} to {most:.4}")) " g of " (found.reference) ", and the means of the plateaus." }
        div.wide { table {
            thead { tr { th { "k2, 1/g" } th { "k3, 1/g²" } th { "k4, 1/g³" } th { "k2 by the means alone, if k3 and k4 were zero" } } }
            tbody { tr {
                @for coefficient in [found.k2_per_g, found.k3_per_g2, found.k4_per_g3] {
                    td.number { (coefficient) }
                }
                td.number { @if let Some(k2) = found.k2_of_means_alone_per_g { (k2) } }
            } }
        } }
        h3 { "Predicted by the harmonics alone, and measured" }
        div.wide { table {
            thead { tr {
                th { "from, s" } th { "to, s" } th { "level, g" } th { "predicted, mg" } th { "measured, mg" } th { "sigmas apart" }
                th { "of it k2, mg" } th { "k3, mg" } th { "k4, mg" }
            } }
            tbody { @for test in &found.tests { tr {
                td.number { (format!("{:.3}", test.from_s)) }
                td.number { (format!("{:.3}", test.to_s)) }
                td.number { (format!("{:.4}", test.level_g)) }
                td.number { (in_mg(test.predicted_vre_g)) }
                td.number { (in_mg(test.measured_vre_g)) }
                td.number { @if let Some(apart) = test.sigmas_apart { (format!("{apart:.1}")) } }
                @for part in test.parts_g { td.number { (in_mg(part)) } }
            } } }
        } }
        h3 { "Linear dynamics" }
        div.wide { table {
            thead { tr { th { "frequency, Hz" } th { "gain" } th { "phase, deg" } } }
            tbody { @for response in &found.dynamics { tr {
                td.number { (format!("{:.4}", response.frequency_hz)) }
                td.number { (response.gain) }
                td.number { (response.phase_deg) }
            } } }
        } }
        p { "Assumed:" }
        ul { @for assumption in &found.assumptions { li { (assumption) } } }
    }
}
