//! What an effect alone changes in a campaign, as a picture.

use super::figures::WIDTH;
use super::plot::{Axis, Layer, Marker, Plot, Point, Shape, Ticks, colour, span};
use crate::campaign::{Campaign, VibrationKind};
use crate::error::Error;

/// The vibration errors of the runs over frequency and over level, and the readings over the dial angle: `with` less `without`,
/// two campaigns of the same positions and runs. Three pictures, one below the other.
///
/// # Errors
/// A picture cannot be drawn.
pub fn signature(id: &str, with: &Campaign, without: &Campaign) -> Result<[String; 3], Error> {
    let scale = with.config.instrument.scale_factor_nominal_v_per_g;
    let runs = || with.runs.iter().zip(&without.runs);
    let over = |x: fn(&crate::campaign::Run) -> f64, kind: VibrationKind| -> Vec<Point> {
        let of_kind = runs().filter(|(run, _)| run.kind == kind);
        let point = |(run, bare): (&crate::campaign::Run, &crate::campaign::Run)| {
            let shift = |run: &crate::campaign::Run| run.measured.map(|m| m.during_v - m.before_v);
            Some(Point {
                x: x(run),
                y: 1e6 * (shift(run)? - shift(bare)?) / scale,
                ..Point::default()
            })
        };
        of_kind.filter_map(point).collect()
    };
    let frequency: fn(&crate::campaign::Run) -> f64 =
        |run| (0.5 * (run.band_hz[0] + run.band_hz[1])).max(1e-3).log10();
    let level: fn(&crate::campaign::Run) -> f64 = |run| run.level_g;
    let plot = |label: &str, ticks: Ticks, x: fn(&crate::campaign::Run) -> f64| {
        let [sines, randoms] =
            [VibrationKind::Sine, VibrationKind::Random].map(|kind| over(x, kind));
        let all = || sines.iter().chain(&randoms);
        Plot {
            title: format!("What {id} adds to the vibration error, over {label}"),
            x: axis(label, all().map(|p| p.x), ticks),
            y: axis(
                "added VRE / 10\u{207b}\u{2076} g",
                all().map(|p| p.y),
                Ticks::Round(5),
            ),
            layers: vec![
                Layer::new(
                    "sine",
                    colour::BLUE,
                    Shape::Points(Marker::Disc, sines.clone()),
                ),
                Layer::new(
                    "random",
                    colour::ORANGE,
                    Shape::Points(Marker::Circle, randoms.clone()),
                ),
            ],
            size: (WIDTH, 200),
        }
    };
    let readings = with.readings.iter().zip(&without.readings);
    let readings: Vec<Point> = readings
        .map(|(reading, bare)| Point {
            x: reading.dial_deg,
            y: 1e6 * (reading.output_v - bare.output_v) / scale,
            ..Point::default()
        })
        .collect();
    let dial = Plot {
        title: format!("What {id} adds to the readings"),
        x: axis("dial angle / deg", [0.0, 360.0], Ticks::Every(45.0)),
        y: axis(
            "added reading / 10\u{207b}\u{2076} g",
            readings.iter().map(|p| p.y),
            Ticks::Round(5),
        ),
        layers: vec![Layer::new(
            "readings",
            colour::GREEN,
            Shape::Points(Marker::Square, readings),
        )],
        size: (WIDTH, 200),
    };
    Ok([
        plot("frequency / Hz", Ticks::Decades, frequency).svg()?,
        plot("level / g", Ticks::Round(7), level).svg()?,
        dial.svg()?,
    ])
}

fn axis(label: &str, values: impl IntoIterator<Item = f64>, ticks: Ticks) -> Axis {
    let range = span(values);
    // What is nothing but rounding is drawn as nothing.
    let range = match range.end - range.start < 1e-6 {
        true => -1.0..1.0,
        false => range,
    };
    Axis {
        label: label.into(),
        range,
        ticks,
    }
}
