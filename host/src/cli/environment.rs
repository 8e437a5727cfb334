//! `vre predict --vibration`: a spectrum, sines on it, a mission, a limit.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use super::{Console, within};
use crate::campaign::{Campaign, ranges, read_mission};
use crate::environment::{
    self, EnvironmentPrediction, G_M_S2, Judgement, MissionError, Vibration, judge, mission,
};
use crate::error::Error;
use crate::quantity::{Quantity, significant};
use crate::statics::{fit_determined, scatter_warning};

/// The environment that the instrument is to work in.
#[derive(clap::Args)]
pub(super) struct EnvironmentOptions {
    /// Predict for an environment in the place of runs: `sine:` peak or `random:` rms in g, `psd:FILE` (breakpoints, `vre help
    /// columns`), `psd+sine:FILE` (with sines in the same table)
    #[arg(long, value_name = "KIND:LEVEL|FILE", conflicts_with = "runs")]
    pub vibration: Option<String>,
    /// Direction on IA, PA, OA of what has none of its own; any length
    #[arg(long, value_name = "I,P,O", default_value = "1,0,0", value_parser = super::plan::direction, allow_hyphen_values = true, requires = "vibration")]
    direction: [f64; 3],
    /// Systematic specific force on IA during the vibration, g
    #[arg(long, value_name = "G", default_value = "0", value_parser = within(&ranges::SPECIFIC_FORCE), allow_negative_numbers = true, requires = "vibration")]
    a0: f64,
    /// A mission: a table of time_s and level_g, the rms of the vibration then; the error of velocity at its end
    #[arg(long, value_name = "FILE", requires = "vibration")]
    mission: Option<PathBuf>,
    /// Greatest magnitude of the vibration error, g; the campaign's own [limits] if absent
    #[arg(long, value_name = "G", value_parser = within(&ranges::VRE_LIMIT), requires = "vibration")]
    limit: Option<f64>,
    /// Greatest probability of a wrong pass, and of a wrong fail
    #[arg(long, value_name = "P", default_value = "0.05", value_parser = within(&ranges::RISK), requires = "vibration")]
    risk: f64,
}

impl EnvironmentOptions {
    /// Predicts for `vibration`, the name of the environment.
    pub(super) fn predict(
        &self,
        name: &str,
        campaign: &Campaign,
        prior_sigma: Option<f64>,
        console: &Console,
    ) -> Result<(), Error> {
        let vibration = Vibration::named(name, self.direction, Path::new(""))?;
        let vibration = vibration.ok_or_else(|| {
            let kinds = "none of sine:PEAK, random:RMS, psd:FILE, psd+sine:FILE";
            Error::Usage(format!("--vibration {name}: is {kinds}"))
        })?;
        let (fit, prior_sigma) = fit_determined(campaign, prior_sigma)?;
        let vre_g = environment::vre_g(&vibration, self.a0, &fit);
        let points = self.mission.as_deref().map(read_mission).transpose()?;
        let mission = points.map(|points| mission(&vibration, &points, self.a0, &fit));
        let limit_g = self
            .limit
            .or(campaign.config.limits.as_ref().and_then(|l| l.vre_g));
        let worst = mission
            .as_ref()
            .map_or(vre_g, |mission| mission.vre_at_highest_g);
        let answer = EnvironmentPrediction {
            format: "vre-environment/1",
            serial: campaign.config.instrument.serial.clone(),
            vibration: name.into(),
            rms_g: vibration.rms_g(),
            a0_i_g: self.a0,
            vre_g,
            velocity_m_per_s_per_h: vre_g.scaled(3600.0 * G_M_S2),
            limit: limit_g.and_then(|limit_g| judge(worst, limit_g, self.risk)),
            mission,
        };
        let mut text = text(&answer);
        if let Some(sigma) = prior_sigma {
            let _ = writeln!(
                text,
                "every coefficient but K1 is taken as 0 +- {sigma:e} beforehand"
            );
        }
        if let Some(warning) = scatter_warning(crate::statics::p_value(&fit)) {
            let _ = writeln!(text, "{warning}");
        }
        let highest = answer.mission.as_ref().map_or(1.0, |mission| {
            mission.highest_level_g / vibration.total_rms_g()
        });
        let reach_g = self.a0.abs() + highest * vibration.reach_g();
        if reach_g > campaign.config.instrument.full_scale_g {
            console.warn(format!(
                "{} g is reached on the input axis now and then, beyond full_scale_g = {} of campaign.toml; clipping is not \
                 predicted",
                significant(reach_g, 3),
                campaign.config.instrument.full_scale_g
            ))?;
        }
        console.answer(text, &answer)
    }
}

fn microg(quantity: Quantity) -> String {
    quantity.scaled(1e6).to_string()
}

fn text(answer: &EnvironmentPrediction) -> String {
    let rms = answer.rms_g.map(|rms| significant(rms, 4));
    let mut text = format!(
        "instrument {}, {}\n\n  rms on I, P, O         {} g; a0_I {} g\n  vibration error        {} microg\n  \
         velocity error         {} m/s in an hour\n",
        answer.serial,
        answer.vibration,
        rms.join(", "),
        significant(answer.a0_i_g, 4),
        microg(answer.vre_g),
        answer.velocity_m_per_s_per_h,
    );
    if let Some(mission) = &answer.mission {
        write_mission(&mut text, mission);
    }
    if let Some(judgement) = &answer.limit {
        write_judgement(&mut text, judgement);
    }
    text.push('\n');
    text
}

fn write_mission(text: &mut String, mission: &MissionError) {
    let _ = write!(
        text,
        "\nmission of {} s, up to {} g rms\n  at the highest level   {} microg\n  mean                   {} microg\n  \
         velocity error         {} m/s at its end\n",
        significant(mission.duration_s, 5),
        significant(mission.highest_level_g, 4),
        microg(mission.vre_at_highest_g),
        microg(mission.mean_vre_g),
        mission.velocity_m_per_s,
    );
}

fn write_judgement(text: &mut String, judgement: &Judgement) {
    let _ = write!(
        text,
        "\nlimit {} microg, risk {}: {}\n  kept with probability {}; guard band {} microg\n",
        significant(1e6 * judgement.limit_g, 4),
        judgement.risk,
        judgement.verdict.name(),
        probability(judgement.probability_kept),
        significant(1e6 * judgement.guard_band_g, 3),
    );
}

/// A probability without a false certainty.
fn probability(kept: f64) -> String {
    match kept {
        high if high > 0.9995 => "above 0.9995".into(),
        low if low < 0.0005 => "below 0.0005".into(),
        _ => format!("{kept:.3}"),
    }
}
