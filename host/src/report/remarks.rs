//! What the reader of a report must know before the numbers.

use shared::model::NOMINAL;

use super::{Report, SYMBOLS, outlook, scientific};
use crate::forward::finite_record::unseen_variance_g2;
use crate::statics::SUSPICIOUS;

/// How grave a remark is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Severity {
    /// The numbers do not mean what they seem to.
    Warning,
    /// Good to know.
    Note,
}

/// A heading and what it means in plain words.
#[derive(Clone, Debug, PartialEq)]
pub struct Remark {
    /// How grave it is.
    pub severity: Severity,
    /// A few words.
    pub heading: String,
    /// A few sentences.
    pub text: String,
}

/// Measured less predicted vibration error of one run.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Gap {
    pub run: u64,
    /// From the prediction of the static test, in units of the standard uncertainty of the difference.
    pub from_static: f64,
    /// From the nominal model fitted to static test and shaker, in units of the standard uncertainty of the measurement.
    pub from_refit: Option<f64>,
}

/// The gaps of the measured runs.
pub(super) fn gaps(report: &Report) -> Vec<Gap> {
    let runs = report.campaign.runs.iter().zip(&report.prediction.runs);
    runs.filter_map(|(run, predicted)| {
        let (measured, sigma) = predicted.measured_vre_g?.known()?;
        let (from_static, static_sigma) = predicted.vre_g.known()?;
        let unseen = unseen_variance_g2(&run.into(), &report.fit.coefficients);
        let refit = predicted.refit_vre_g.and_then(|refit| refit.value);
        Some(Gap {
            run: run.run,
            from_static: (measured - from_static) / sigma.hypot(static_sigma),
            from_refit: refit.map(|refit| (measured - refit) / (sigma * sigma + unseen).sqrt()),
        })
    })
    .collect()
}

/// All remarks on a report, the gravest first.
pub(super) fn remarks(report: &Report) -> Vec<Remark> {
    let gaps = gaps(report);
    let mut all = Vec::new();
    let belonging = report.belonging.lines().map(|line| Remark {
        severity: Severity::Warning,
        heading: "Readings that do not belong, or noise that is not as stated".into(),
        text: format!("{line}."),
    });
    all.extend(belonging);
    all.extend(blindness(report));
    all.extend(scatter(report));
    all.extend(against_static(&gaps));
    all.extend(against_model(&gaps));
    if gaps.is_empty() {
        all.push(Remark {
            severity: Severity::Note,
            heading: "No measured shaker run".into(),
            text: "The campaign has no run with a measured output (vibration.csv), so the predictions of this report \
                   are not confronted with any measurement."
                .into(),
        });
    }
    all.sort_by_key(|remark| remark.severity);
    all
}

/// A direction as a sum, components below one per mille left out.
pub(super) fn spelt(direction: &[f64; NOMINAL]) -> String {
    let named = SYMBOLS
        .iter()
        .zip(direction)
        .filter(|(_, c)| c.abs() > 1e-3);
    let parts: Vec<_> = named.map(|(name, c)| format!("{c:+.3} {name}")).collect();
    parts.join(" ").replace('-', "\u{2212}")
}

fn blindness(report: &Report) -> Option<Remark> {
    let direction = &report.direction;
    let sigma = report.prediction.prior_sigma.filter(|_| direction.blind)?;
    Some(Remark {
        severity: Severity::Warning,
        heading: format!(
            "The plan is blind: rank {} of {NOMINAL}",
            report.identification.rank
        ),
        text: format!(
            "The dial positions of this campaign cannot tell some coefficients apart. If the instrument's coefficients \
             changed together along {}, not one reading would change, but the vibration error would: by {:.0}\u{d7}10\u{207b}\u{2076} g \
             in 1 g rms of white noise for a step of 10\u{207b}\u{2074}. Where a prediction from the static test depends on this \
             direction it rests on an assumption (each coefficient but K1 taken as 0 \u{b1} {}), not on a measurement; \
             its stated uncertainty includes this. Remedy: {} (vre plan lists the best positions), or shaker runs, which do \
             see it.",
            spelt(&direction.components),
            100.0 * direction.vre_g_per_unit.abs(),
            scientific(sigma),
            if direction.among_even_terms() {
                "readings at 30, 60, 120, 150, 210, 240, 300 and 330 deg of the dial in series 1 and 2"
            } else {
                "readings in the series that are missing"
            },
        ),
    })
}

fn scatter(report: &Report) -> Option<Remark> {
    let (chi2, dof) = (report.identification.chi2?, report.identification.dof);
    if dof == 0 {
        return Some(Remark {
            severity: Severity::Warning,
            heading: "No reading to spare".into(),
            text: "There are as many readings as coefficients: nothing checks the stated uncertainties.".into(),
        });
    }
    let expected = format!(
        "chi-square is {chi2:.1}, expected {dof} \u{b1} {:.0}",
        (2.0 * dof as f64).sqrt()
    );
    let (heading, text) = match report.identification.chi2_p_value? {
        p if p < SUSPICIOUS => (
            "The static readings scatter more than stated",
            format!(
                "Their {expected}. Either the bench's uncertainties in campaign.toml are too small or something moved \
                 (temperature, mount, drift of the bias): the uncertainties of the coefficients and of the predictions \
                 are too small. The residuals below show where."
            ),
        ),
        p if p > 1.0 - SUSPICIOUS => (
            "The static readings scatter less than stated",
            format!(
                "Their {expected}. The bench's uncertainties in campaign.toml are too large, and so are those of the \
                 coefficients and of the predictions."
            ),
        ),
        _ => return None,
    };
    Some(Remark {
        severity: Severity::Warning,
        heading: heading.into(),
        text,
    })
}

/// Of the gaps in units of their uncertainty: how many exceed 3, and the run and size of the worst.
fn beyond(gaps: impl Iterator<Item = (u64, f64)>) -> Option<(usize, u64, f64)> {
    let beyond: Vec<_> = gaps.filter(|(_, gap)| gap.abs() > 3.0).collect();
    let worst = beyond
        .iter()
        .max_by(|a, b| a.1.abs().total_cmp(&b.1.abs()))?;
    Some((beyond.len(), worst.0, worst.1.abs()))
}

fn counted(gaps: &[Gap], count: usize, run: u64, worst: f64) -> String {
    format!(
        "{count} of {} measured runs {} off by more than 3 standard uncertainties (by chance one expects {:.1}), run {run} \
         most of all, by {worst:.1}.",
        gaps.len(),
        if count == 1 { "is" } else { "are" },
        0.0027 * gaps.len() as f64
    )
}

/// By chance less than one table of a hundred runs in a hundred has a gap beyond four.
fn severity(worst: f64) -> Severity {
    if worst > 4.0 {
        Severity::Warning
    } else {
        Severity::Note
    }
}

fn against_static(gaps: &[Gap]) -> Option<Remark> {
    let (count, run, worst) = beyond(gaps.iter().map(|gap| (gap.run, gap.from_static)))?;
    let counted = counted(gaps, count, run, worst);
    Some(match severity(worst) {
        severity @ Severity::Warning => Remark {
            severity,
            heading: "Predicted from the static test and measured do not agree".into(),
            text: format!(
                "{counted} All predictions share the same coefficients, so they go astray together; look at which level, \
                 frequency and direction the runs in question have."
            ),
        },
        severity @ Severity::Note => Remark {
            severity,
            heading: "Some runs lie at the edge of what the static test predicts".into(),
            text: format!("{counted} This can be chance."),
        },
    })
}

fn against_model(gaps: &[Gap]) -> Option<Remark> {
    let fitted = gaps
        .iter()
        .filter_map(|gap| Some((gap.run, gap.from_refit?)));
    let (count, run, worst) = beyond(fitted)?;
    let counted = format!(
        "With the model fitted to both, {}",
        counted(gaps, count, run, worst)
    );
    Some(match severity(worst) {
        severity @ Severity::Warning => Remark {
            severity,
            heading: "No set of coefficients fits static test and shaker together".into(),
            text: format!(
                "{counted} Something acts that the model of IEEE 1293 does not have: a resonance of the fixture, the \
                 bandwidth of the loop, heating, a clipped output. The column \u{201c}static + shaker\u{201d} is then a \
                 compromise, and its uncertainties are too small."
            ),
        },
        severity @ Severity::Note => Remark {
            severity,
            heading: "Static test and shaker fit together, with runs at the edge".into(),
            text: format!("{counted} This can be chance."),
        },
    })
}

/// The summary in three sentences.
pub(super) fn summary(report: &Report) -> String {
    let campaign = &report.campaign;
    let marks: std::collections::BTreeSet<u64> = campaign
        .readings
        .iter()
        .map(|r| shared::tumble::within_a_turn(r.dial_deg).to_bits())
        .collect();
    let gaps = gaps(report);
    let vre = outlook::vre_g(&report.fit, 1.0).scaled(1e6).to_string();
    let agreement = if gaps.is_empty() {
        "No measured shaker run stands beside it.".to_owned()
    } else {
        let within = gaps
            .iter()
            .filter(|gap| gap.from_static.abs() <= 2.0)
            .count();
        let fitted = gaps
            .iter()
            .filter(|gap| gap.from_refit.is_some_and(|g| g.abs() <= 2.0))
            .count();
        format!(
            "Of {} measured runs the prediction from the static test agrees with {within} within its 95 % interval, and \
             the model fitted to static test and shaker together with {fitted}.",
            gaps.len()
        )
    };
    format!(
        "Instrument {} was read {} times at {} dial angles and shaken {} times. In a white noise of 1 g rms along its \
         input axis, at a\u{2080} = 0, the static test alone predicts a vibration rectification error of {} \u{d7} 10\u{207b}\u{2076} g{}. \
         {agreement}",
        campaign.config.instrument.serial,
        campaign.readings.len(),
        marks.len(),
        campaign.runs.len(),
        vre.replace('-', "\u{2212}"),
        if report.direction.blind {
            ", most of its uncertainty by assumption"
        } else {
            ""
        },
    )
}
