//! The page: HTML without scripts and without anything from outside, good to read and to print.

use maud::{DOCTYPE, Markup, PreEscaped, html};
use shared::model::NOMINAL;

use super::figures::{self, Figure};
use super::remarks::{self, Severity};
use super::{Report, scientific, text};
use crate::error::Error;
use crate::quantity::Quantity;
use crate::statics::MEANINGS;

pub(super) const STYLE: &str = "
:root { color-scheme: light; }
* { box-sizing: border-box; }
body { margin: 0 auto; max-width: 50rem; padding: 1.5rem 1.2rem 3rem; background: #fff; color: #222;
  font: 16px/1.5 system-ui, -apple-system, 'Segoe UI', 'DejaVu Sans', sans-serif; }
h1 { font-size: 1.7rem; line-height: 1.2; margin: 0 0 .3rem; }
h2 { font-size: 1.25rem; margin: 2.4rem 0 .5rem; padding-top: .6rem; border-top: 2px solid #ddd; }
p { margin: .5rem 0; }
.lead { font-size: 1.08rem; }
.remark { border-left: 6px solid #0072b2; background: #eef5fa; padding: .6rem 1rem; margin: .8rem 0; }
.remark.warning { border-color: #d55e00; background: #fdf1e8; }
.remark h3 { margin: 0; font-size: 1.02rem; }
.remark p { margin: .2rem 0 0; }
figure { margin: 1rem 0 1.4rem; }
figure svg { max-width: 100%; height: auto; }
.pair { display: flex; flex-wrap: wrap; }
.pair > svg { flex: 1 1 18rem; min-width: 0; max-width: 50%; }
.legend { display: flex; flex-wrap: wrap; gap: .1rem 1.3rem; list-style: none; margin: .2rem 0 .3rem; padding: 0;
  font-size: .88rem; }
.legend li { display: flex; align-items: center; gap: .45rem; }
figcaption { font-size: .93rem; color: #333; }
.wide { overflow-x: auto; }
table { border-collapse: collapse; font-size: .9rem; margin: .6rem 0; font-variant-numeric: tabular-nums; }
th, td { padding: .2rem .7rem; border-bottom: 1px solid #ddd; text-align: left; }
th { border-bottom: 2px solid #999; vertical-align: bottom; }
sub, sup { line-height: 0; font-size: .75em; }
.number { text-align: right; white-space: nowrap; }
.far { background: #fdf1e8; font-weight: 600; }
footer { margin-top: 2.5rem; border-top: 1px solid #ddd; padding-top: .6rem; font-size: .85rem; color: #444; }
@media print {
  body { max-width: none; padding: 0; font-size: 10.5pt; }
  h2 { break-after: avoid; }
  figure, .remark, tr { break-inside: avoid; }
  thead { display: table-header-group; }
  .wide { overflow: visible; }
  * { print-color-adjust: exact; -webkit-print-color-adjust: exact; }
}
";

/// The whole page.
pub(super) fn page(report: &Report) -> Result<String, Error> {
    let serial = &report.campaign.config.instrument.serial;
    let page = html! {
        (DOCTYPE)
        html lang="en" {
            head {
                meta charset="utf-8";
                meta name="viewport" content="width=device-width, initial-scale=1";
                title { "Vibration rectification error of " (serial) }
                style { (PreEscaped(STYLE)) }
            }
            body {
                h1 { "Vibration rectification error of " (serial) }
                p.lead { (remarks::summary(report)) }
                @for remark in &report.remarks {
                    div.remark.warning[remark.severity == Severity::Warning] {
                        h3 { @if remark.severity == Severity::Warning { "Warning: " } (remark.heading) }
                        p { (remark.text) }
                    }
                }
                (comparison(report)?)
                h2 { "Static readings" }
                (figure(&figures::readings(report))?)
                (figure(&figures::residuals(report))?)
                p { (chi_square(report)) }
                (coefficients(report)?)
                (direction(report)?)
                h2 { "How well the static test predicts, over the level" }
                (figure(&figures::levels(report))?)
                (reading_it(report))
                (runs(report))
                footer {
                    "vre " (env!("CARGO_PKG_VERSION")) ", formats vre-campaign/1, " (report.identification.format) ", "
                    (report.prediction.format) ". The numbers of this page stand in full precision in identification.json and \
                    prediction.json beside it."
                }
            }
        }
    };
    Ok(page.into_string())
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
            h2 { "Predicted against measured" }
            p {
                "Missing: a vibration.csv with measured output. With it, this section would show the predicted beside the \
                measured vibration error of every run, and a fit of the model to static test and shaker together."
            }
        });
    };
    Ok(html! {
        h2 { "Predicted against measured" }
        (figure(&compared)?)
        (figure(&gaps)?)
    })
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
        h2 { "Coefficients from the static test" }
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
        h2 { @if direction.blind { "What no reading sees" } @else { "What the readings see least" } }
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
        h2 { "How to read this" }
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
        h2 { "What went in" }
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
        h2 { "All runs" }
        @if report.campaign.runs.is_empty() {
            p { "Missing: vibration.csv, one row a shaker run. " }
        } @else {
            p { "Vibration error in 10" sup { "\u{2212}6" } " g; the gap is measured less predicted from the static test in units of its standard uncertainty, marked beyond 3." }
            div.wide { table {
                thead { tr {
                    th.number { "Run" } th { "Vibration" } th { "Along I, P, O" } th.number { "a" sub { "0,I" } " / g" }
                    th.number { "From static test" } th.number { "Static + shaker" } th.number { "Measured" } th.number { "Gap" }
                } }
                tbody {
                    @for (run, predicted) in report.campaign.runs.iter().zip(&report.prediction.runs) {
                        tr {
                            td.number { (run.run) }
                            td { (text::vibration(run)) }
                            td { (run.direction.map(|c| format!("{c:.2}")).join(", ").replace('-', "\u{2212}")) }
                            td.number { (format!("{:.2}", run.specific_force_g.i).replace('-', "\u{2212}")) }
                            td.number { (cell(Some(predicted.vre_g))) }
                            td.number { (cell(predicted.refit_vre_g)) }
                            td.number { (cell(predicted.measured_vre_g)) }
                            @match gap(run.run) {
                                Some(gap) => td.number.far[gap.abs() > 3.0] { (format!("{gap:.1}").replace('-', "\u{2212}")) },
                                None => td.number { "\u{2013}" },
                            }
                        }
                    }
                }
            } }
        }
    }
}
