//! The head of a report: which instrument, who measured it where and when, from which files, and whether it keeps its limit.

use std::fs;
use std::path::Path;

use maud::{Markup, html};
use sha2::{Digest, Sha256};
use shared::identify::static_test::Fit;

use crate::campaign::Campaign;
use crate::configuration::hashed_files;
use crate::environment::{Judgement, Vibration, judge, vre_g};
use crate::error::Error;
use crate::quantity::{Quantity, significant};

/// Greatest probability of a wrong pass or fail in a certificate.
const RISK: f64 = 0.05;

/// What an auditor asks for.
pub(super) struct Certificate {
    /// Names and values that somebody stated.
    stated: Vec<(&'static str, String)>,
    /// Input files with their SHA-256.
    files: Vec<(String, String)>,
    limit: Limit,
}

enum Limit {
    NotStated,
    /// The environment is words, or is not stated.
    NotJudged(f64),
    Judged(String, Quantity, Judgement),
}

impl Certificate {
    /// Of a campaign that was read from `folder`, if it was.
    ///
    /// # Errors
    /// A file cannot be read; a spectrum that the limits name is no spectrum.
    pub(super) fn of(
        campaign: &Campaign,
        folder: Option<&Path>,
        fit: &Fit<f64>,
    ) -> Result<Self, Error> {
        let config = &campaign.config;
        let record = config.record.clone().unwrap_or_default();
        let date = record.date.map(|date| match date {
            toml::Value::String(words) => words,
            other => other.to_string(),
        });
        let type_text = format!(
            "{} V/g nominal, full scale {} g",
            config.instrument.scale_factor_nominal_v_per_g, config.instrument.full_scale_g
        );
        let mut stated = vec![
            ("Instrument", config.instrument.serial.clone()),
            ("Type", type_text),
        ];
        for (name, value) in [
            ("Bench", record.station),
            ("Operator", record.operator),
            ("Date", date),
            ("Note", record.note),
        ] {
            stated.push((name, value.unwrap_or_else(|| "not stated".into())));
        }
        let mut files = Vec::new();
        for file in folder.map(hashed_files).transpose()?.into_iter().flatten() {
            if file.exists() {
                let bytes = fs::read(&file).map_err(Error::read(&file))?;
                let hash = Sha256::digest(&bytes);
                let hash = hash.iter().map(|byte| format!("{byte:02x}")).collect();
                let name = file.file_name().unwrap_or_default().display().to_string();
                files.push((name, hash));
            }
        }
        Ok(Self {
            stated,
            files,
            limit: limit(campaign, folder, fit)?,
        })
    }

    /// As a table.
    pub(super) fn markup(&self) -> Markup {
        html! {
            div.wide { table.head {
                tbody {
                    @for (name, value) in &self.stated { tr { th scope="row" { (name) } td { (value) } } }
                    @for (name, hash) in &self.files {
                        tr { th scope="row" { "SHA-256 of " (name) } td.hash { (hash) } }
                    }
                    tr { th scope="row" { "Limit of the vibration error" } td { (self.limit.markup()) } }
                }
            } }
        }
    }
}

fn limit(campaign: &Campaign, folder: Option<&Path>, fit: &Fit<f64>) -> Result<Limit, Error> {
    let Some(limits) = &campaign.config.limits else {
        return Ok(Limit::NotStated);
    };
    let Some(limit_g) = limits.vre_g else {
        return Ok(Limit::NotStated);
    };
    let name = limits.environment.clone().unwrap_or_default();
    let base = folder.unwrap_or(Path::new("."));
    let Some(vibration) = Vibration::named(&name, [1.0, 0.0, 0.0], base)? else {
        return Ok(Limit::NotJudged(limit_g));
    };
    let found = vre_g(&vibration, 0.0, fit);
    Ok(match judge(found, limit_g, RISK) {
        Some(judgement) => Limit::Judged(name, found, judgement),
        None => Limit::NotJudged(limit_g),
    })
}

impl Limit {
    fn markup(&self) -> Markup {
        let unit = html! { " \u{d7} 10" sup { "\u{2212}6" } " g" };
        let micro = |g: f64| significant(1e6 * g, 4);
        match self {
            Self::NotStated => html! { "not stated: " code { "[limits]" } " of campaign.toml" },
            Self::NotJudged(limit_g) => html! {
                (micro(*limit_g)) (unit) "; not judged, since " code { "environment" }
                " names no vibration such as random:2 or psd:vehicle.csv"
            },
            Self::Judged(name, found, judgement) => html! {
                span class=(format!("verdict {}", judgement.verdict.name())) {
                    (judgement.verdict.name().replace('-', " "))
                }
                " \u{2013} " (micro(judgement.limit_g)) (unit) " in " (name) " along the input axis, a" sub { "0" } " = 0; predicted "
                (found.scaled(1e6).to_string().replace('-', "\u{2212}")) (unit) "; guard band "
                (significant(1e6 * judgement.guard_band_g, 2)) (unit) " at a risk of " (100.0 * judgement.risk) " %"
            },
        }
    }
}
