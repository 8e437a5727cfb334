//! Plots as data, and their drawing as SVG.
//!
//! A [`Plot`] says what is to be seen: two axes and layers of lines, bands and points. [`Plot::svg`] draws it
//! with plotters; [`Layer::swatch`] is the layer's entry in a legend outside of the drawing.

use std::ops::Range;

use plotters::coord::Shift;
use plotters::coord::ranged1d::{KeyPointHint, NoDefaultFormatting, ValueFormatter};
use plotters::prelude::*;

use crate::error::Error;

/// Colours that people with any colour vision can tell apart (Okabe and Ito, 2008).
pub(super) mod colour {
    use plotters::style::RGBColor;

    pub const BLUE: RGBColor = RGBColor(0, 114, 178);
    pub const ORANGE: RGBColor = RGBColor(213, 94, 0);
    pub const GREEN: RGBColor = RGBColor(0, 158, 115);
    pub const PURPLE: RGBColor = RGBColor(170, 68, 135);
    pub const GREY: RGBColor = RGBColor(110, 110, 110);
    pub const INK: RGBColor = RGBColor(34, 34, 34);
    pub const MESH: RGBColor = RGBColor(225, 225, 225);
}

/// Two axes and what is drawn between them, the first layer below.
pub(super) struct Plot {
    pub title: String,
    pub x: Axis,
    pub y: Axis,
    pub layers: Vec<Layer>,
    /// Width and height in CSS pixels.
    pub size: (u32, u32),
}

/// One axis.
pub(super) struct Axis {
    /// Quantity and unit.
    pub label: String,
    pub range: Range<f64>,
    pub ticks: Ticks,
}

/// Where an axis has its marks.
pub(super) enum Ticks {
    /// At about so many round numbers.
    Round(usize),
    /// Every so much.
    Every(f64),
    /// At 1, 2 and 5 times the powers of ten; the axis holds decimal logarithms.
    Decades,
    /// At zero and at plus and minus the powers of ten; the axis holds [`symmetric`] values, linear within this.
    Symmetric(f64),
    /// At 0, 1, 2 ..., with these names.
    Names(Vec<String>),
}

/// One layer of a plot.
pub(super) struct Layer {
    /// Text of the legend; none if the layer needs no explanation.
    pub label: Option<String>,
    pub colour: RGBColor,
    pub shape: Shape,
}

pub(super) enum Shape {
    Line(Vec<(f64, f64)>),
    Thin(Vec<(f64, f64)>),
    Dashes(Vec<(f64, f64)>),
    /// From lower to upper: (x, lower, upper).
    Band(Vec<(f64, f64, f64)>),
    Points(Marker, Vec<Point>),
}

#[derive(Clone, Copy, PartialEq)]
pub(super) enum Marker {
    Disc,
    Circle,
    Triangle,
    Square,
    Cross,
}

/// A point with the half-lengths of its bars.
#[derive(Clone, Copy, Default)]
pub(super) struct Point {
    pub x: f64,
    pub y: f64,
    pub x_bar: f64,
    pub y_bar: f64,
    pub name: Option<Name>,
}

/// What a point is of, told where a pointer rests on it.
#[derive(Clone, Copy)]
pub(super) enum Name {
    /// A shaker run, and its line of the table.
    Run(u64, u64),
    /// A reading, and its line of the table.
    Reading(u64, u64),
}

impl Name {
    fn text(self) -> String {
        match self {
            Self::Run(run, 0) => format!("run {run}"),
            Self::Run(run, line) => format!("run {run}, row {line} of vibration"),
            Self::Reading(order, line) => format!("reading {order}, row {line} of static"),
        }
    }
}

impl Layer {
    pub(super) fn new(label: &str, colour: RGBColor, shape: Shape) -> Self {
        Self {
            label: Some(label.into()),
            colour,
            shape,
        }
    }

    pub(super) fn unlabelled(colour: RGBColor, shape: Shape) -> Self {
        Self {
            label: None,
            colour,
            shape,
        }
    }

    /// A small SVG that shows the layer's look.
    pub(super) fn swatch(&self) -> Result<String, Error> {
        let shape = match &self.shape {
            Shape::Line(_) | Shape::Thin(_) => Shape::Line(vec![(0.0, 0.5), (1.0, 0.5)]),
            Shape::Dashes(_) => Shape::Dashes(vec![(0.0, 0.5), (1.0, 0.5)]),
            Shape::Band(_) => Shape::Band(vec![(0.0, 0.15, 0.85), (1.0, 0.15, 0.85)]),
            Shape::Points(marker, _) => Shape::Points(
                *marker,
                vec![Point {
                    x: 0.5,
                    y: 0.5,
                    ..Point::default()
                }],
            ),
        };
        let layer = Self {
            label: None,
            colour: self.colour,
            shape,
        };
        svg((28, 16), None, |area| {
            let unit = || Scale {
                range: 0.0..1.0,
                marks: Vec::new(),
            };
            layer.draw(&mut ChartBuilder::on(area).build_cartesian_2d(unit(), unit())?)
        })
    }

    fn draw(&self, chart: &mut Chart<'_, '_>) -> Outcome {
        let line = self.colour.stroke_width(3);
        match &self.shape {
            Shape::Line(points) => {
                chart.draw_series(LineSeries::new(points.iter().copied(), line))?;
            }
            Shape::Thin(points) => {
                let thin = self.colour.mix(0.5).stroke_width(2);
                chart.draw_series(LineSeries::new(points.iter().copied(), thin))?;
            }
            Shape::Dashes(points) => {
                chart.draw_series(DashedLineSeries::new(points.iter().copied(), 12, 8, line))?;
            }
            Shape::Band(edges) => {
                let there = edges.iter().map(|&(x, low, _)| (x, low));
                let back = edges.iter().rev().map(|&(x, _, high)| (x, high));
                let outline: Vec<(f64, f64)> = there.chain(back).collect();
                chart.draw_series([Polygon::new(outline, self.colour.mix(0.18))])?;
            }
            Shape::Points(marker, points) => {
                let thin = self.colour.stroke_width(2);
                let bars = points.iter().flat_map(|p| {
                    let across = [(p.x - p.x_bar, p.y), (p.x + p.x_bar, p.y)];
                    let upright = [(p.x, p.y - p.y_bar), (p.x, p.y + p.y_bar)];
                    [(p.x_bar, across), (p.y_bar, upright)]
                });
                let bars = bars.filter(|(length, _)| *length > 0.0);
                chart.draw_series(bars.map(|(_, ends)| PathElement::new(ends.to_vec(), thin)))?;
                marker.draw(points.iter().map(|p| (p.x, p.y)), self.colour, chart)?;
            }
        }
        Ok(())
    }
}

impl Marker {
    fn draw(
        self,
        at: impl Iterator<Item = (f64, f64)>,
        colour: RGBColor,
        chart: &mut Chart<'_, '_>,
    ) -> Outcome {
        let (full, open) = (colour.filled(), colour.stroke_width(3));
        match self {
            Self::Disc => chart.draw_series(at.map(|at| Circle::new(at, 7, full)))?,
            Self::Circle => chart.draw_series(at.map(|at| {
                EmptyElement::at(at)
                    + Circle::new((0, 0), 7, WHITE.filled())
                    + Circle::new((0, 0), 7, open)
            }))?,
            Self::Triangle => chart.draw_series(at.map(|at| TriangleMarker::new(at, 10, full)))?,
            Self::Square => chart.draw_series(
                at.map(|at| EmptyElement::at(at) + Rectangle::new([(-6, -6), (6, 6)], full)),
            )?,
            Self::Cross => chart.draw_series(at.map(|at| Cross::new(at, 7, open)))?,
        };
        Ok(())
    }
}

/// An axis as plotters takes it: linear, with marks and their texts given.
#[derive(Clone)]
struct Scale {
    range: Range<f64>,
    marks: Vec<(f64, String)>,
}

impl Ranged for Scale {
    type FormatOption = NoDefaultFormatting;
    type ValueType = f64;

    fn map(&self, value: &f64, limit: (i32, i32)) -> i32 {
        let share = (value - self.range.start) / (self.range.end - self.range.start);
        limit.0 + (share * f64::from(limit.1 - limit.0)).round() as i32
    }

    fn key_points<Hint: KeyPointHint>(&self, _: Hint) -> Vec<f64> {
        self.marks.iter().map(|(at, _)| *at).collect()
    }

    fn range(&self) -> Range<f64> {
        self.range.clone()
    }
}

impl ValueFormatter<f64> for Scale {
    fn format_ext(&self, value: &f64) -> String {
        let mark = self.marks.iter().find(|(at, _)| at == value);
        mark.map_or(String::new(), |(_, text)| text.clone())
    }
}

type Chart<'a, 'b> = ChartContext<'a, SVGBackend<'b>, Cartesian2d<Scale, Scale>>;
type Outcome = Result<(), DrawingAreaErrorKind<std::io::Error>>;

/// Drawing units per CSS pixel; plotters draws on whole units.
const FINE: u32 = 2;

/// Draws on a canvas of `size` CSS pixels; the SVG scales with the width that it is given.
fn svg(
    size: (u32, u32),
    title: Option<&str>,
    draw: impl FnOnce(&DrawingArea<SVGBackend<'_>, Shift>) -> Outcome,
) -> Result<String, Error> {
    let mut text = String::new();
    {
        let canvas = (size.0 * FINE, size.1 * FINE);
        let area = SVGBackend::with_string(&mut text, canvas).into_drawing_area();
        draw(&area)
            .and_then(|()| area.present())
            .map_err(|error| Error::Picture(error.to_string()))?;
    }
    // Room for what plotters has no word for: the size on the page, and a name for screen readers.
    let Some(body) = text.split_once("viewBox").map(|(_, rest)| rest) else {
        return Err(Error::Picture("plotters wrote no SVG".into()));
    };
    let name = match title {
        Some(title) => format!("role=\"img\" aria-label=\"{}\"", escape(title)),
        None => "aria-hidden=\"true\"".into(),
    };
    let body = match (title, body.split_once('>')) {
        (Some(title), Some((tag, rest))) => format!("{tag}><title>{}</title>{rest}", escape(title)),
        _ => body.into(),
    };
    Ok(format!(
        "<svg {name} width=\"{}\" height=\"{}\" viewBox{body}",
        size.0, size.1
    ))
}

fn escape(text: &str) -> String {
    text.replace('&', "&amp;")
        .replace('<', "&lt;")
        .replace('"', "&quot;")
}

impl Plot {
    /// The drawing, without its legend; points that have a name tell it.
    pub(super) fn svg(&self) -> Result<String, Error> {
        let mut named = String::new();
        let drawing = self.drawing(&mut named)?;
        Ok(match drawing.rsplit_once("</svg>") {
            Some((drawn, after)) => format!("{drawn}{named}</svg>{after}"),
            None => drawing,
        })
    }

    fn drawing(&self, named: &mut String) -> Result<String, Error> {
        let ink = |size: u32| {
            ("sans-serif", f64::from(size * FINE) * PLOTTERS_FONT)
                .into_font()
                .color(&colour::INK)
        };
        svg(self.size, Some(&self.title), |area| {
            let left = match self.y.ticks {
                Ticks::Names(_) => 84,
                _ => 74,
            };
            let mut chart = ChartBuilder::on(area)
                .margin_top(8 * FINE)
                .margin_right(14 * FINE)
                .x_label_area_size(42 * FINE)
                .y_label_area_size(left * FINE)
                .build_cartesian_2d(self.x.scale(), self.y.scale())?;
            chart
                .configure_mesh()
                .light_line_style(TRANSPARENT)
                .bold_line_style(colour::MESH.stroke_width(FINE))
                .axis_style(colour::GREY.stroke_width(FINE))
                .label_style(ink(12))
                .axis_desc_style(ink(13))
                .x_desc(&self.x.label)
                .y_desc(&self.y.label)
                .draw()?;
            self.layers
                .iter()
                .try_for_each(|layer| layer.draw(&mut chart))?;
            for layer in &self.layers {
                if let Shape::Points(_, points) = &layer.shape {
                    points
                        .iter()
                        .for_each(|point| name_point(point, &chart, named));
                }
            }
            Ok(())
        })
    }
}

/// Radius about a point within which a pointer rests on it, in drawing units.
const NEAR: u32 = 10;

/// Something invisible over a point that tells its name.
fn name_point(point: &Point, chart: &Chart<'_, '_>, named: &mut String) {
    if let Some(name) = point.name {
        let (x, y) = chart.backend_coord(&(point.x, point.y));
        let text = name.text();
        *named += &format!(
            "<circle cx=\"{x}\" cy=\"{y}\" r=\"{NEAR}\" fill=\"transparent\"><title>{text}</title></circle>"
        );
    }
}

/// plotters takes the height of a line of text for the size of the font.
const PLOTTERS_FONT: f64 = 1.24;

/// A value on a symmetric logarithmic axis that is linear about zero within `linear`.
pub(super) fn symmetric(value: f64, linear: f64) -> f64 {
    (value / linear).asinh()
}

impl Axis {
    fn scale(&self) -> Scale {
        if let Ticks::Symmetric(linear) = self.ticks {
            return self.symmetric_scale(linear);
        }
        if let Ticks::Decades = self.ticks {
            return self.logarithmic_scale();
        }
        let step = self.step();
        let first = (self.range.start / step - 1e-9).ceil();
        let marks = (0..100).map(|index| (first + f64::from(index)) * step);
        let marks = marks.take_while(|at| *at <= self.range.end + 1e-9 * step);
        Scale {
            range: self.range.clone(),
            marks: marks.map(|at| (at, self.mark(at))).collect(),
        }
    }

    /// Marks at 1, 2 and 5 times the powers of ten; at the powers alone if the range is long.
    fn logarithmic_scale(&self) -> Scale {
        let factors: &[i32] = match self.range.end - self.range.start {
            length if length > 3.0 => &[1],
            _ => &[1, 2, 5],
        };
        let decades = self.range.start.floor() as i32..=self.range.end.ceil() as i32;
        let marks = decades.flat_map(|decade| {
            let mark = move |factor: &i32| {
                let value = f64::from(*factor) * 10f64.powi(decade);
                (value.log10(), format!("{value}"))
            };
            factors.iter().map(mark)
        });
        Scale {
            range: self.range.clone(),
            marks: marks.filter(|(at, _)| self.range.contains(at)).collect(),
        }
    }

    /// Marks at zero and at the powers of ten from the linear part on.
    fn symmetric_scale(&self, linear: f64) -> Scale {
        let first = linear.log10().ceil() as i32;
        let powers = (first..first + 12).map(|decade| 10f64.powi(decade));
        let both = powers.flat_map(|power| [power, -power]);
        let marks = std::iter::once(0.0).chain(both).map(|value| {
            let text = crate::error::decimal(value).replace('-', "\u{2212}");
            (symmetric(value, linear), text)
        });
        Scale {
            range: self.range.clone(),
            marks: marks.filter(|(at, _)| self.range.contains(at)).collect(),
        }
    }

    fn step(&self) -> f64 {
        match self.ticks {
            Ticks::Names(_) | Ticks::Decades | Ticks::Symmetric(_) => 1.0,
            Ticks::Every(step) => step,
            Ticks::Round(count) => {
                let rough = (self.range.end - self.range.start) / count.max(1) as f64;
                let decade = 10f64.powf(rough.log10().floor());
                let steps = [1.0, 2.0, 5.0, 10.0].map(|factor| factor * decade);
                steps
                    .into_iter()
                    .find(|step| *step >= rough)
                    .unwrap_or(rough)
            }
        }
    }

    fn mark(&self, at: f64) -> String {
        if let Ticks::Names(names) = &self.ticks {
            return names
                .get(at.round().max(0.0) as usize)
                .cloned()
                .unwrap_or_default();
        }
        let decimals = (-(self.step() * 1.000001).log10().floor()).max(0.0) as usize;
        let text = format!(
            "{:.decimals$}",
            if at.abs() < 1e-9 * self.step() {
                0.0
            } else {
                at
            }
        );
        text.replace('-', "\u{2212}")
    }
}

/// The range of all finite `values`, widened by a margin; around 0 if there are none.
pub(super) fn span(values: impl IntoIterator<Item = f64>) -> Range<f64> {
    let finite = values.into_iter().filter(|value| value.is_finite());
    let (low, high) = finite.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), value| {
        (low.min(value), high.max(value))
    });
    if low > high {
        return -1.0..1.0;
    }
    let margin = match high - low {
        0.0 => low.abs().max(1.0),
        length => 0.06 * length,
    };
    low - margin..high + margin
}
