//! The page of a diagnosis: for a test engineer who wants to know what to repair, and how sure that is.

use maud::{DOCTYPE, Markup, PreEscaped, html};

use super::diagnosis_text::headline;
use super::figures::{Figure, WIDTH};
use super::page::{STYLE, figure};
use super::plot::{Axis, Layer, Marker, Plot, Point, Shape, Ticks, colour, span};
use crate::diagnose::{Diagnosis, GapRow, Study, Verdict, WHY_NOT_CARRIED};
use crate::effects;
use crate::error::Error;
use crate::quantity::Quantity;

const DIAGNOSIS_STYLE: &str = "
.bar { display: inline-block; height: .8em; background: #0072b2; }
.matrix td { text-align: center; min-width: 3.2rem; }
";

/// The page, self-contained.
///
/// # Errors
/// A picture cannot be drawn.
pub fn page(study: &Study) -> Result<String, Error> {
    let diagnosis = &study.diagnosis;
    let title = format!("Diagnosis of {}", diagnosis.serial);
    let page = html! {
        (DOCTYPE)
        html lang="en" {
            head {
                meta charset="utf-8";
                meta name="viewport" content="width=device-width, initial-scale=1";
                title { (title) }
                style { (PreEscaped(STYLE)) (PreEscaped(DIAGNOSIS_STYLE)) }
            }
            body {
                h1 { (title) }
                p.lead { (sentence(diagnosis)) }
                @for note in &diagnosis.not_looked_at {
                    div.remark { h3 { "Not looked at" } p { (note) } }
                }
                (place(study)?)
                (cause(diagnosis))
                (closing(diagnosis))
                (next(diagnosis))
                footer { "vre " (env!("CARGO_PKG_VERSION")) ", format " (diagnosis.format) }
            }
        }
    };
    Ok(page.into_string())
}

fn sentence(diagnosis: &Diagnosis) -> String {
    let mut line = headline(diagnosis);
    if let Some(first) = line.get(..1) {
        line = first.to_uppercase() + &line[1..];
    }
    format!(
        "{line}. The simulation with the best coefficients misses the measurements by {:.2} times their stated uncertainty; \
         about 1 would be right.",
        diagnosis.gap.rms_over_noise
    )
}

/// One plot of the gap over a condition, before and after the effect is added.
fn over(
    study: &Study,
    title: &str,
    axis: (&str, Ticks),
    observed: &str,
    gap: impl Fn(&GapRow) -> [f64; 2],
    value: impl Fn(&GapRow) -> f64,
) -> Plot {
    let points = |which: usize| -> Vec<Point> {
        let rows = study.rows.iter();
        rows.map(|row| Point {
            x: value(row),
            y: gap(row)[which],
            ..Point::default()
        })
        .collect()
    };
    let (before, after) = (points(0), points(1));
    let points = before.iter().chain(&after);
    Plot {
        title: title.into(),
        x: Axis {
            label: axis.0.into(),
            range: span(points.clone().map(|p| p.x)),
            ticks: axis.1,
        },
        y: Axis {
            label: format!("{observed}, gap / uncertainty"),
            range: span(points.map(|p| p.y)),
            ticks: Ticks::Round(6),
        },
        layers: vec![
            Layer::new(
                "nominal model",
                colour::ORANGE,
                Shape::Points(Marker::Circle, before),
            ),
            Layer::new(
                "with the effects",
                colour::BLUE,
                Shape::Points(Marker::Disc, after),
            ),
        ],
        size: (WIDTH, 260),
    }
}

/// A measured quantity in words.
fn quantity(name: &str) -> &str {
    match name {
        "static" => "readings on the dividing head",
        "vibration" => "vibration error in the runs",
        "bias" => "output at rest before the runs",
        "recovery" => "output at rest after the runs",
        "in-run-drift" => "drift within the runs",
        other => other,
    }
}

/// A condition in words, with its unit.
fn condition(factor: &str) -> (&str, &str) {
    match factor {
        "frequency_hz" => ("the frequency", " Hz"),
        "level_g" => ("the level", " g"),
        "direction_i" => ("the part of the motion along the input axis", ""),
        "direction_p" => ("the part of the motion along the pendulous axis", ""),
        "direction_o" => ("the part of the motion along the output axis", ""),
        "a0_i_g" => ("gravity along the input axis", " g"),
        "temp_c" => ("the temperature", " \u{b0}C"),
        "time_s" => ("the time", " s"),
        "order" => ("the position in the order of runs", ""),
        "dial_deg" => ("the dial angle", "\u{b0}"),
        "series" => ("the series", ""),
        "approach" => ("the approach (0 counter-clockwise, 1 clockwise)", ""),
        other => (other, ""),
    }
}

fn place(study: &Study) -> Result<Markup, Error> {
    let location = &study.diagnosis.location;
    let plots = vec![
        over(
            study,
            "Vibration error over frequency",
            ("frequency (of a band: its middle) / Hz", Ticks::Decades),
            "vibration error",
            |row| row.during,
            |row| row.centre_hz.max(1.0).log10(),
        ),
        over(
            study,
            "Vibration error over level",
            ("level / g", Ticks::Round(7)),
            "vibration error",
            |row| row.during,
            |row| row.level_g,
        ),
        over(
            study,
            "Bias before the runs over time",
            ("time / h", Ticks::Round(7)),
            "output at rest",
            |row| row.before,
            |row| row.time_s / 3600.0,
        ),
    ];
    let pictures = Figure {
        plots,
        caption: "Each run twice: what the nominal model leaves, and what is left once the named effects are added. Good is a \
                  band within \u{b1}3 around zero without any pattern; a pattern in the filled points means that something \
                  is still missing."
            .into(),
    };
    let runs = !study.rows.is_empty();
    Ok(html! {
        h2 { "Where the gap lies" }
        @if study.diagnosis.verdict != Verdict::NoGap {
            table {
                thead { tr { th { "measured quantity" } th { "share of the gap" } } }
                tbody { @for o in &location.observables { tr { td { (quantity(&o.name)) } td { (bar(o.share)) } } } }
            }
            @for c in location.conditions.iter().take(4) {
                p { (percent(c.share)) " of it lies where " b { (condition(&c.factor).0) } " is " (round(c.low)) " to " (round(c.high))
                    (condition(&c.factor).1) " (" (c.runs.len()) " of the measurements). Were the gap spread evenly, a search would come upon such a region in "
                    (percent(c.p_value)) " of cases." }
            }
        }
        @if runs { (figure(&pictures)?) }
    })
}

fn cause(diagnosis: &Diagnosis) -> Markup {
    let best = &diagnosis.which[0];
    html! {
        h2 { "What causes it" }
        @for id in &best.effects {
            @if let Some(effect) = effects::find(id) { p { b { (id) } ": " (effect.says) "." } }
        }
        @if !best.indistinguishable_from.is_empty() {
            p { "These measurements cannot tell it from " b { (best.indistinguishable_from.join(", ")) } "." }
        }
        @if diagnosis.verdict == Verdict::Unexplained {
            p { "No effect that the program knows explains the measurements; those listed come nearest and should not be believed." }
        }
        p { "How probable each explanation is, given all measurements: one that needs more freedom to fit must fit better to be believed." }
        table {
            thead { tr { th { "explanation" } th { "probability" } } }
            tbody {
                @for which in &diagnosis.which {
                    tr {
                        td { @if which.effects.is_empty() { "nothing acts" } @else { (which.effects.join(" + ")) } }
                        td { (bar(which.probability)) }
                    }
                }
            }
        }
        @if !best.parameters.is_empty() {
            table {
                thead { tr { th { "parameter" } th.number { "value (uncertainty of the last digits)" } } }
                tbody {
                    @for p in &best.parameters {
                        tr { td { (p.name) } td.number { (Quantity::new(p.value, p.sigma).to_string()) } }
                    }
                }
            }
        }
        @if let Some(similarity) = &diagnosis.similarity {
            h3 { "How alike the explanations are" }
            p { "1 or \u{2212}1: these measurements see the same in both, so that a test must be found that does not; 0: they differ completely." }
            div.wide { table.matrix {
                thead { tr { th {} @for name in &similarity.hypotheses { th { (name) } } } }
                tbody {
                    @for (name, row) in similarity.hypotheses.iter().zip(&similarity.correlation) {
                        tr { th { (name) } @for c in row { td.far[c.abs() > 0.9] { (format!("{c:.2}")) } } }
                    }
                }
            } }
        }
        @if let Some(cause) = &diagnosis.identification {
            p { "The prediction from the static test alone is off because of " b { (cause.cause) } " (" (percent(cause.share))
                " of its error). That is no fault of the instrument: with the shaker runs included the same model fits." }
        }
    }
}

fn closing(diagnosis: &Diagnosis) -> Markup {
    let Some(shrink) = &diagnosis.shrink else {
        return html! {};
    };
    let [low, high] = shrink.closed_fraction_interval_90;
    let named = !diagnosis.which[0].effects.is_empty();
    let rows = [
        (
            "coefficients of the static test",
            shrink.held_out_rms_static_only_g,
        ),
        (
            "coefficients fitted to everything",
            shrink.held_out_rms_refit_g,
        ),
        (
            "the same with the named effects",
            shrink.held_out_rms_with_effects_g,
        ),
        ("the noise alone", shrink.noise_floor_rms_g),
    ];
    html! {
        h2 { "How far the gap shrinks" }
        p { "Each group of runs of one frequency and attitude was predicted from all the others, so that no prediction has seen its own run." }
        table {
            thead { tr { th { "prediction" } th.number { "typical miss / 10" sup { "\u{2212}6" } " g" } } }
            tbody { @for (words, rms) in rows { tr { td { (words) } td.number { (format!("{:.2}", 1e6 * rms)) } } } }
        }
        @if shrink.closed_fraction > 0.0 {
            p { "In further runs, between those that were made, the named effects are expected to close "
                b { (percent(shrink.closed_fraction)) } " (in nine of ten cases " (percent(low)) " to " (percent(high))
                ") of what the best coefficients leave above the noise." }
        } @else if named {
            p { "They would make predictions of further runs no better, so those are made without them." }
        }
        @if let Some(compensation) = diagnosis.offered() {
            @for id in &compensation.carried {
                p { "The instrument's compensation can carry " b { (id) } " as a coefficient: " code { "vre configure --diagnosis" } " hands it over." }
            }
            @for id in &compensation.not_carried {
                p { b { (id) } " stays uncompensated on board: " (WHY_NOT_CARRIED) "." }
            }
        }
    }
}

fn next(diagnosis: &Diagnosis) -> Markup {
    html! {
        h2 { "What to measure next" }
        @if diagnosis.next_tests.is_empty() {
            p { "No test is needed to choose between explanations: one stands, or none." }
        }
        ol {
            @for test in &diagnosis.next_tests {
                li { (test.change) ": tells " (test.separates.join(" from ")) "; it is expected to settle "
                    (format!("{:.2}", test.expected_bits)) " bits of the question (1 bit settles an even choice between two)." }
            }
        }
    }
}

fn bar(share: f64) -> Markup {
    html! { span.bar style=(format!("width:{:.1}rem", 10.0 * share.clamp(0.0, 1.0))) {} " " (percent(share)) }
}

fn percent(share: f64) -> String {
    format!("{:.1} %", 100.0 * share)
}

fn round(value: f64) -> String {
    format!("{}", (value * 1e4).round() / 1e4)
}
