//! The page of a campaign: certificate, comparison, coefficients, and the diagnosis if there is one.

use maud::{Markup, PreEscaped, html};
use shared::model::NOMINAL;

use super::certificate::Certificate;
use super::figures::{self, Figure};
use super::frame::{self, Section};
use super::remarks::{self, Severity};
use super::{Report, diagnosis, scientific, text};
use crate::diagnose::Study;
use crate::error::Error;
use crate::quantity::{Quantity, fixed};
use crate::statics::MEANINGS;

/// The whole page.
pub(super) fn page(
    report: &Report,
    certificate: &Certificate,
    study: Option<&Study>,
) -> Result<String, Error> {
    let serial = &report.campaign.config.instrument.serial;
    let first = html! {
        (certificate.markup())
        p.lead { (remarks::summary(report)) }
        @if let Some(study) = study { (diagnosis::first(&study.diagnosis)) }
        @for remark in &report.remarks {
            div.remark.warning[remark.severity == Severity::Warning] {
                h3 { @if remark.severity == Severity::Warning { "Warning: " } (remark.heading) }
                p { (remark.text) }
            }
        }
    };
    let section = |id, title, body| Section { id, title, body };
    let blind = match report.direction.blind {
        true => "What no reading sees",
        false => "What the readings see least",
    };
    let mut sections = vec![section(
        "compared",
        "Predicted against measured",
        comparison(report)?,
    )];
    if let Some(study) = study {
        sections.extend(diagnosis::sections(study)?);
    }
    sections.extend([
        section("readings", "Static readings", readings(report)?),
        section(
            "coefficients",
            "Coefficients from the static test",
            coefficients(report)?,
        ),
        section("direction", blind, direction(report)?),
        section(
            "levels",
            "How well the static test predicts, over the level",
            figure(&figures::levels(report))?,
        ),
        section("reading", "How to read this", reading_it(report)),
        section("inputs", "What went in", inputs(report)),
        section("runs", "All runs", runs(report)),
    ]);
    let foot = html! {
        "formats vre-campaign/1, " (report.identification.format) ", " (report.prediction.format) ". The numbers of this page stand in full \
        precision in identification.json and prediction.json beside it."
    };
    let title = format!("Vibration rectification error of {serial}");
    Ok(frame::page(&title, &first, &sections, &foot))
}

fn readings(report: &Report) -> Result<Markup, Error> {
    Ok(html! {
        (figure(&figures::readings(report))?)
        (figure(&figures::residuals(report))?)
        p { (chi_square(report)) }
    })
}

pub(super) fn figure(figure: &Figure) -> Result<Markup, Error> {
    let mut legend: Vec<(&str, String)> = Vec::new();
    for layer in figure.plots.iter().flat_map(|plot| &plot.layers) {
        match &layer.label {
            Some(label) if legend.iter().all(|(known, _)| known != label) => {
                legend.push((label, layer.swatch()?));
            }
            _ => {}
        }
    }
    let pictures = figure
        .plots
        .iter()
        .map(|plot| plot.svg())
        .collect::<Result<Vec<_>, _>>()?;
    let side_by_side = figure.plots.iter().all(|plot| plot.size.0 < 500);
    Ok(html! {
        figure {
            ul.legend {
                @for (label, swatch) in &legend { li { (PreEscaped(swatch)) span { (label) } } }
            }
            div.pair[side_by_side] { @for picture in &pictures { (PreEscaped(picture)) } }
            figcaption { (figure.caption) }
        }
    })
}

fn comparison(report: &Report) -> Result<Markup, Error> {
    let (Some(compared), Some(gaps)) = (figures::comparison(report), figures::gaps(report)) else {
        return Ok(html! {
            p {
                "Missing: a vibration.csv with measured output. With it, this section would show the predicted beside the \
                measured vibration error of every run, and a fit of the model to static test and shaker together."
            }
        });
    };
    Ok(html! {
        (figure(&compared)?)
        (figure(&gaps)?)
        (worst(report))
    })
}

/// Runs in the list of those farthest off.
const WORST: usize = 10;

/// The runs farthest from the fit to static test and shaker, or from the static prediction without one.
fn worst(report: &Report) -> Markup {
    let mut gaps = remarks::gaps(report);
    let size = |gap: &remarks::Gap| gap.from_refit.unwrap_or(gap.from_static).abs();
    gaps.sort_by(|a, b| size(b).total_cmp(&size(a)));
    let number = |gap: f64| fixed(gap, 1).replace('-', "\u{2212}");
    let rows = gaps.iter().take(WORST).filter_map(|gap| {
        let mut runs = report.campaign.runs.iter();
        Some((gap, runs.find(|run| run.run == gap.run)?))
    });
    html! {
        div.wide { table.fold {
            caption { "The runs farthest off, in units of their uncertainty; row is the line in the table of runs" }
            thead { tr {
                th.number { "Run" } th.number { "Row" } th { "Vibration" } th { "Along" } th.number { "Static test" }
                th.number { "Static + shaker" }
            } }
            tbody { @for (gap, run) in rows { tr {
                td.number data-label="Run" { (run.run) }
                td.number data-label="Row" { (run.line) }
                td data-label="Vibration" { (text::vibration(run)) }
                td data-label="Along" { (text::along(run.direction).replace('-', "\u{2212}")) }
                td.number data-label="Static test" { (number(gap.from_static)) }
                td.number data-label="Static + shaker" { (gap.from_refit.map_or("\u{2013}".into(), number)) }
            } } }
        } }
    }
}

fn chi_square(report: &Report) -> String {
    let (Some(chi2), dof) = (report.identification.chi2, report.identification.dof) else {
        return String::new();
    };
    format!(
        "Chi-square of the fit is {chi2:.1}; {dof} \u{b1} {:.0} is expected if the uncertainties of the bench are as stated.",
        (2.0 * dof as f64).sqrt()
    )
}

/// Symbols and units of the coefficients but K1, whose unit is V/g.
fn symbol(k: usize) -> Markup {
    let (letter, below, prime) = [
        ("K", "1", ""),
        ("k", "0", ""),
        ("k", "1", "\u{2032}"),
        ("k", "2", ""),
        ("k", "3", ""),
        ("k", "4", ""),
        ("\u{3b4}", "OA", ""),
        ("\u{3b4}", "PA", ""),
        ("k", "IP", ""),
        ("k", "IO", ""),
        ("k", "PO", ""),
    ][k];
    html! { (letter) sub { (below) } (prime) }
}

const UNITS: [&str; NOMINAL] = [
    "V/g",
    "g",
    "1",
    "g\u{207b}\u{b9}",
    "g\u{207b}\u{b2}",
    "g\u{207b}\u{b3}",
    "rad",
    "rad",
    "g\u{207b}\u{b9}",
    "g\u{207b}\u{b9}",
    "g\u{207b}\u{b9}",
];

fn concise(quantity: Quantity) -> String {
    quantity.to_string().replace('-', "\u{2212}")
}

fn coefficients(report: &Report) -> Result<Markup, Error> {
    let found = &report.identification;
    Ok(html! {
        div.wide { table {
            thead { tr { th { "" } th { "Coefficient" } th.number { "Value" } th { "Unit" } } }
            tbody {
                @for k in 0..NOMINAL {
                    tr {
                        td { (symbol(k)) }
                        td { (MEANINGS[k]) }
                        @if k == 0 {
                            td.number { (concise(found.coefficients[k])) }
                            td { (UNITS[k]) }
                        } @else {
                            td.number { (concise(found.coefficients[k].scaled(1e6))) }
                            td { "10" sup { "\u{2212}6" } @if UNITS[k] != "1" { " " (UNITS[k]) } }
                        }
                    }
                }
            }
        } }
        p {
            "Standard uncertainties in parentheses, in units of the last digits: 301.5(1.5) is 301.5 \u{b1} 1.5. Rank "
            (found.rank) " of " (NOMINAL) ", "
            @if found.condition < 1e12 { "condition number " (format!("{:.0}", found.condition)) "." }
            @else { "condition number infinite within rounding." }
        }
        (figure(&figures::coefficients(report))?)
    })
}

fn direction(report: &Report) -> Result<Markup, Error> {
    let direction = &report.direction;
    let parts: Vec<(usize, f64)> = (0..NOMINAL)
        .map(|k| (k, direction.components[k]))
        .filter(|(_, c)| c.abs() > 5e-3)
        .collect();
    let change = format!(
        "{:.0}",
        1e6 * (direction.vre_g_per_unit * direction.sigma).abs()
    );
    Ok(html! {
        p {
            @if direction.blind {
                @if direction.among_even_terms() {
                    "Gravity takes the input axis to a few values of |a" sub { "I" } "| only in this plan, too few to tell the \
                    even terms of the model apart. "
                }
                "The coefficients may move together along "
            } @else {
                "Every coefficient is determined. Least so, among those that make vibration error, is their combination "
            }
            @for (k, c) in &parts { (format!("{c:+.2}").replace('-', "\u{2212}")) "\u{a0}" (symbol(*k)) " " }
            @if direction.blind { "without any reading changing. " } @else { "(standard uncertainty " (format!("{:.1}", 1e6 * direction.sigma)) " \u{d7} 10" sup { "\u{2212}6" } "). " }
            "In a white noise of 1 g rms along the input axis one standard uncertainty along it"
            @if direction.blind { ", which is the assumption 0 \u{b1} " (scientific(direction.sigma)) "," }
            " moves the predicted vibration error by " (change) " \u{d7} 10" sup { "\u{2212}6" } " g."
        }
        (figure(&figures::direction(report))?)
    })
}

fn reading_it(report: &Report) -> Markup {
    html! {
        p {
            "Vibration rectification error (VRE) is the change of the mean output under vibration. Numbers in parentheses are \
            standard uncertainties (coverage factor k = 1); bars in the pictures are intervals of k = 2, which hold the truth \
            in about 95 % of cases. \u{201c}From the static test\u{201d} uses the readings on the dividing head alone; \
            \u{201c}static + shaker\u{201d} fits the same model to these and the shaker runs together, so it is no independent \
            test of a run that went into it."
        }
        p {
            @match report.prediction.prior_sigma {
                Some(sigma) => {
                    "Assumed, because the plan is blind: every coefficient but K" sub { "1" } " is 0 \u{b1} "
                    (scientific(sigma))
                    " in its own unit before the first reading. It enters the predictions, not the table of coefficients."
                }
                None => {
                    "No prior knowledge of the coefficients is assumed in the predictions."
                }
            }
            " The level of a run is the commanded one. The third and fourth moments of a random run are those that the reference \
            accelerometer saw, if it did."
        }
    }
}

fn inputs(report: &Report) -> Markup {
    let config = &report.campaign.config;
    let bench = &config.bench;
    let inputs: [(&str, String); 9] = [
        (
            "Dial mark, common to all readings at it",
            format!("{} arcsec", bench.dial_sigma_arcsec),
        ),
        (
            "Repeatability of a setting",
            format!("{} arcsec", bench.dial_repeat_sigma_arcsec),
        ),
        (
            "Angle of a mounting, common to a series and mount",
            format!("{} arcsec", bench.mount_sigma_arcsec),
        ),
        (
            "Level of the base, two tilts",
            format!("{} arcsec", bench.level_sigma_arcsec),
        ),
        ("Noise of a reading, least and greatest", noise(report)),
        ("Local gravity", format!("{} g", bench.local_gravity_g)),
        (
            "Reference temperature",
            format!("{} \u{b0}C", bench.reference_temp_c),
        ),
        (
            "Nominal scale factor",
            format!("{} V/g", config.instrument.scale_factor_nominal_v_per_g),
        ),
        (
            "Full scale",
            format!("{} g", config.instrument.full_scale_g),
        ),
    ];
    html! {
        div.wide { table {
            thead { tr { th { "Standard uncertainties and constants of campaign.toml and static.csv" } th.number { "Value" } } }
            tbody { @for (name, value) in &inputs { tr { td { (name) } td.number { (value) } } } }
        } }
    }
}

fn noise(report: &Report) -> String {
    let sigmas = || {
        report
            .campaign
            .readings
            .iter()
            .map(|reading| 1e6 * reading.sigma_v)
    };
    let (least, greatest) = (
        sigmas().fold(f64::INFINITY, f64::min),
        sigmas().fold(0.0, f64::max),
    );
    format!("{least:.2} to {greatest:.2} \u{b5}V")
}

fn runs(report: &Report) -> Markup {
    let gaps = remarks::gaps(report);
    let cell =
        |quantity: Option<Quantity>| quantity.map_or("\u{2013}".into(), |q| concise(q.scaled(1e6)));
    let gap = |run: u64| {
        gaps.iter()
            .find(|gap| gap.run == run)
            .map(|gap| gap.from_static)
    };
    html! {
        @if report.campaign.runs.is_empty() {
            p { "Missing: vibration.csv, one row a shaker run. " }
        } @else {
            p { "Vibration error in 10" sup { "\u{2212}6" } " g; the gap is measured less predicted from the static test in units of its standard uncertainty, marked beyond 3." }
            div.wide { table.fold.full {
                thead { tr {
                    th.number { "Run" } th { "Vibration" } th { "Along" } th.number { "a" sub { "0,I" } " / g" }
                    th.number { "From static test" } th.number { "Static + shaker" } th.number { "Measured" } th.number { "Gap" }
                } }
                tbody {
                    @for (run, predicted) in report.campaign.runs.iter().zip(&report.prediction.runs) {
                        tr {
                            td.number data-label="Run" { (run.run) }
                            td data-label="Vibration" { (text::vibration(run)) }
                            td data-label="Along" { (text::along(run.direction).replace('-', "\u{2212}")) }
                            td.number data-label="Gravity on IA / g" { (fixed(run.specific_force_g.i, 2).replace('-', "\u{2212}")) }
                            td.number data-label="From static test" { (cell(Some(predicted.vre_g))) }
                            td.number data-label="Static + shaker" { (cell(predicted.refit_vre_g)) }
                            td.number data-label="Measured" { (cell(predicted.measured_vre_g)) }
                            @match gap(run.run) {
                                Some(gap) => td.number.far[gap.abs() > 3.0] data-label="Gap" { (fixed(gap, 1).replace('-', "\u{2212}")) },
                                None => td.number data-label="Gap" { "\u{2013}" },
                            }
                        }
                    }
                }
            } }
        }
    }
}
