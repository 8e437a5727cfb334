//! The page of a diagnosis: for a test engineer who wants to know what to repair, and how sure that is.

use maud::{Markup, html};

use super::diagnosis_text::headline;
use super::figures::{Figure, WIDTH};
use super::frame::{self, Section};
use super::page::figure;
use super::plot::{Axis, Layer, Marker, Name, Plot, Point, Shape, Ticks, colour, span};
use crate::diagnose::answer::NextTest;
use crate::diagnose::{Diagnosis, GapRow, Study, Verdict, WHY_NOT_CARRIED};
use crate::effects;
use crate::error::Error;
use crate::handbook::in_words;
use crate::quantity::Quantity;

/// The page, self-contained.
///
/// # Errors
/// A picture cannot be drawn.
pub fn page(study: &Study) -> Result<String, Error> {
    let diagnosis = &study.diagnosis;
    let title = format!("Diagnosis of {}", diagnosis.serial);
    let foot = html! { "format " (diagnosis.format) };
    Ok(frame::page(
        &title,
        &first(diagnosis),
        &sections(study)?,
        &foot,
    ))
}

/// What a diagnosis says first.
pub(super) fn first(diagnosis: &Diagnosis) -> Markup {
    html! {
        p.lead { (sentence(diagnosis)) }
        @for note in &diagnosis.not_looked_at {
            div.remark { h3 { "Not looked at" } p { (note) } }
        }
    }
}

/// The sections of a diagnosis, its verdict in the first.
pub(super) fn sections(study: &Study) -> Result<Vec<Section>, Error> {
    let diagnosis = &study.diagnosis;
    let section = |id, title, body| Section { id, title, body };
    let mut sections = vec![
        section("where", "Where the gap lies", place(study)?),
        section("cause", "What causes it", cause(diagnosis)),
    ];
    if diagnosis.shrink.is_some() {
        sections.push(section(
            "closing",
            "How far the gap shrinks",
            closing(diagnosis),
        ));
    }
    sections.push(section("next", "What to measure next", next(diagnosis)));
    Ok(sections)
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
            name: Some(Name::Run(row.run, 0)),
            ..Point::default()
        })
        .collect()
    };
    let (before, after) = (points(0), points(1));
    let points = before.iter().chain(&after);
    let x = span(points.clone().map(|p| p.x));
    let band = Shape::Band(vec![(x.start, -3.0, 3.0), (x.end, -3.0, 3.0)]);
    Plot {
        title: title.into(),
        x: Axis {
            label: axis.0.into(),
            range: x,
            ticks: axis.1,
        },
        y: Axis {
            label: format!("{observed}, gap / uncertainty"),
            range: span(points.map(|p| p.y).chain([-4.0, 4.0])),
            ticks: Ticks::Round(6),
        },
        layers: vec![
            Layer::new("\u{b1} 3", colour::GREY, band),
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
        @if !study.diagnosis.verdict.sees_none() {
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
                        tr { td { (parameter(&best.effects, &p.name)) } td.number { (Quantity::new(p.value, p.sigma).to_string()) } }
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

/// A parameter in words, with its unit.
fn parameter(effects: &[String], name: &str) -> String {
    let of_effect = effects.iter().map(|effect| in_words(effect, name));
    let found = of_effect.max_by_key(|(words, _)| !words.is_empty());
    match found {
        Some((words, unit)) if !words.is_empty() => match unit {
            "" => words.to_owned(),
            unit => format!("{words}, {unit}"),
        },
        _ => name.to_owned(),
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

/// Tests that are proposed in full; more would be a list, no advice.
const TESTS: usize = 3;

fn next(diagnosis: &Diagnosis) -> Markup {
    let test = |test: &NextTest| {
        html! {
            li { (test.change) ": tells " (test.separates.join(" from ")) "; " (settled(test.expected_bits)) "." }
        }
    };
    let further = diagnosis.next_tests.iter().skip(TESTS);
    html! {
        @if diagnosis.next_tests.is_empty() {
            p { "No test is needed to choose between explanations: one stands, or none." }
        }
        ol { @for one in diagnosis.next_tests.iter().take(TESTS) { (test(one)) } }
        @if diagnosis.next_tests.len() > TESTS {
            details { summary { "Tests that tell less" } ul { @for one in further { (test(one)) } } }
        }
    }
}

/// What an expected information means for an even choice between two: the probability p of naming the right one after it, from
/// bits = 1 - H(p), H the binary entropy.
fn settled(bits: f64) -> String {
    let entropy = |p: f64| -p * p.log2() - (1.0 - p) * (1.0 - p).log2();
    let (mut low, mut high) = (0.5, 1.0 - 1e-6);
    for _ in 0..40 {
        let middle = 0.5 * (low + high);
        match 1.0 - entropy(middle) < bits {
            true => low = middle,
            false => high = middle,
        }
    }
    match 100.0 * low {
        percent if percent > 99.0 => "would settle it in more than 99 of 100 cases".into(),
        percent => {
            format!("would settle it in {percent:.0} of 100 cases, where a guess does in 50")
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

#[cfg(test)]
mod tests {
    use super::settled;

    #[test]
    fn bits_are_told_as_cases() {
        // 1 - H(0.9) = 0.531.
        assert!(settled(0.531).contains("in 90 of 100"));
        assert!(settled(1e-9).contains("in 50 of 100"));
        assert!(settled(1.0).contains("more than 99"));
    }
}
