//! `vre plan`

use std::fmt::Write as _;
use std::path::Path;
use std::str::FromStr;

use serde::Serialize;
use shared::identify::static_test::Bench;
use shared::model::{NOMINAL, SpecificForce};
use shared::tumble::{ARCSEC_RAD, Position, full_rank_plan, paper_plan};
use shared::vibration::{Harmonic, Random};

use super::identify::{condition, sum};
use super::{Command, Console, read_campaign, triad, within};
use crate::campaign::{is_triad, ranges, read_plan};
use crate::error::Error;
use crate::head::TYPE;
use crate::head::batch::DEFAULT_SPREAD;
use crate::head::harmonics::ADVICE;
use crate::head::outlook::{Mounting, Outlook, PlannedBatch, outlook};
use crate::head::posterior::{MEAN_SIGMA, Prior};
use crate::quantity::fixed;
use crate::statics::DEFAULT_PRIOR_SIGMA;
use crate::statics::{
    self, Assessment, Conditions, Environment, NAMES, assess, best_plan, positions_to_add,
    twice_and_remounted,
};
use crate::triad::coverage::spiral;

/// Tell what a plan of dial positions can and cannot tell: rank, blind directions, uncertainty of the predicted VRE
#[derive(clap::Args)]
#[command(after_help = "Examples:\n  \
    vre plan paper --vibration random:1 --dial-sigma 5.8\n  \
    vre plan full --vibration sine:5 --vibration random:2 --a0 0.5 --best 80\n  \
    vre plan campaigns/S01000 --vibration random:1\n  \
    vre plan hand --direction 1,1,1 --vibration random:1")]
pub struct Plan {
    /// `paper` (24 positions), `full` (40, full rank), `hand` (a triad in 80 orientations by hand), a CSV file with the columns series, dial_deg and mount_deg
    /// (optional), or a campaign folder, whose stated uncertainties then hold
    plan: String,
    /// Vibration in which the error is to be predicted, KIND:LEVEL, `sine:` peak or `random:` rms in g; repeatable
    #[arg(long, value_name = "KIND:LEVEL", default_value = "random:1")]
    vibration: Vec<Vibration>,
    /// Direction of the vibration on IA, PA, OA; any length
    #[arg(long, value_name = "I,P,O", default_value = "1,0,0", value_parser = direction, allow_hyphen_values = true)]
    direction: [f64; 3],
    /// Systematic specific force on IA during the vibration, g
    #[arg(long, value_name = "G", default_value = "0", value_parser = within(&ranges::SPECIFIC_FORCE), allow_negative_numbers = true)]
    a0: f64,
    /// Standard uncertainty of a dial mark, arcsec [default: the campaign's, or 5.8, a limit of +-10]
    #[arg(long, value_name = "ARCSEC", value_parser = within(&ranges::ARCSEC_SIGMA))]
    dial_sigma: Option<f64>,
    /// Standard uncertainty of the base's level, arcsec [default: the campaign's, or that of the dial]
    #[arg(long, value_name = "ARCSEC", value_parser = within(&ranges::ARCSEC_SIGMA))]
    level_sigma: Option<f64>,
    /// Repeatability of a setting, arcsec [default: the campaign's, or 1]
    #[arg(long, value_name = "ARCSEC", value_parser = within(&ranges::ARCSEC_SIGMA))]
    repeat_sigma: Option<f64>,
    /// Standard uncertainty of a remounting angle, arcsec [default: the campaign's, or 60]
    #[arg(long, value_name = "ARCSEC", value_parser = within(&ranges::ARCSEC_SIGMA))]
    mount_sigma: Option<f64>,
    /// Standard uncertainty of one reading from noise alone, g [default: the campaign's mean, or 1.5e-6]
    #[arg(long, value_name = "G", value_parser = within(&ranges::READING_NOISE))]
    noise: Option<f64>,
    /// Standard deviation about zero of every coefficient but K1, for what the plan is blind to
    #[arg(long, value_name = "SIGMA", default_value_t = DEFAULT_PRIOR_SIGMA, value_parser = within(&ranges::PRIOR_SIGMA))]
    prior_sigma: f64,
    /// Search the best plan of N readings for these vibrations
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(11..=400))]
    best: Option<u16>,
    /// Tell what a batch of N instruments of one type on one head will know of each, mounted alike, mounted turned by 180 deg every
    /// other one, and each remounted
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..=1_000_000))]
    batch: Option<u64>,
    /// Standard deviation of the coefficients that rectify within the type, each in its own unit, for --batch
    #[arg(long, value_name = "SIGMA", default_value_t = 3e-5, value_parser = within(&ranges::PRIOR_SIGMA))]
    type_spread: f64,
}

/// A vibration as people name it: `sine:2` or `random:1`.
#[derive(Clone)]
pub(super) struct Vibration {
    text: String,
    sine: bool,
    level_g: f64,
}

impl Vibration {
    /// Along this unit vector, with this systematic specific force on IA, g.
    pub(super) fn environment(&self, direction: &[f64; 3], a0_i_g: f64) -> Environment {
        let [i, p, o] = direction.map(|cosine| cosine * self.level_g);
        let along = SpecificForce::new(i, p, o);
        let moments = match self.sine {
            true => Harmonic { amplitude_g: along }.into(),
            false => Random::along(along).into(),
        };
        Environment {
            name: self.text.clone(),
            a0_i_g,
            moments,
        }
    }
}

impl FromStr for Vibration {
    type Err = String;
    fn from_str(text: &str) -> Result<Self, String> {
        let (kind, level) = text
            .split_once(':')
            .ok_or("is not KIND:LEVEL, such as random:1")?;
        let sine = match kind {
            "sine" => true,
            "random" => false,
            _ => return Err("the kind is neither sine nor random".into()),
        };
        let level_g = ranges::LEVEL
            .parse(level)
            .map_err(|problem| format!("the level {problem}"))?;
        Ok(Self {
            text: text.into(),
            sine,
            level_g,
        })
    }
}

pub(super) fn direction(text: &str) -> Result<[f64; 3], String> {
    let parts: Option<Vec<f64>> = text
        .split(',')
        .map(|part| ranges::DIRECTION.parse(part).ok())
        .collect();
    let Some(&[i, p, o]) = parts.as_deref() else {
        return Err("is not three numbers from -1e6 to 1e6 with commas between".into());
    };
    let length = (i * i + p * p + o * o).sqrt();
    if length == 0.0 {
        return Err("has no direction".into());
    }
    Ok([i / length, p / length, o / length])
}

/// What the command tells, `vre-plan/1`.
#[derive(Serialize)]
struct Advice {
    format: &'static str,
    plan: Assessment,
    /// Positions worth adding one after another, with the worst environment's uncertainty after each.
    add: Vec<Addition>,
    /// The plan taken twice with one mount.
    twice: Assessment,
    /// The same number of readings, half of them remounted by 180 deg.
    remounted: Assessment,
    #[serde(skip_serializing_if = "Option::is_none")]
    best: Option<Best>,
    /// One instrument of a batch, mounted in each way.
    #[serde(skip_serializing_if = "Option::is_none")]
    batch: Option<Vec<Outlook>>,
}

#[derive(Serialize)]
struct Addition {
    #[serde(flatten)]
    position: Position,
    vre_sigma_g: f64,
}

#[derive(Serialize)]
struct Best {
    #[serde(flatten)]
    assessment: Assessment,
    positions: Vec<Position>,
}

/// Positions to add that are looked for.
const MOST_ADDITIONS: usize = 8;

impl Command for Plan {
    fn run(self, console: &Console) -> Result<(), Error> {
        if self.plan == BY_HAND || is_triad(Path::new(&self.plan)) {
            return self.of_triad(console);
        }
        let (plan, conditions) = self.plan_and_conditions(console)?;
        let environments = self.environments();
        let fail = |error| Error::Usage(format!("{}: {error}", self.plan));
        if plan.len() < NOMINAL {
            return Err(Error::Usage(format!(
                "{}: has {} positions, the model {NOMINAL} coefficients",
                self.plan,
                plan.len()
            )));
        }
        let (twice, remounted) = twice_and_remounted(&plan);
        let additions =
            positions_to_add(&plan, &conditions, &environments, MOST_ADDITIONS).map_err(fail)?;
        let best = match self.best {
            None => None,
            Some(readings) => {
                let readings = usize::from(readings);
                let bar = console.progress(2 * readings as u64, "searching the best plan");
                let positions =
                    best_plan(readings, &conditions, &environments, || bar.inc(1)).map_err(fail)?;
                bar.finish_and_clear();
                let assessment = assess(&positions, &conditions, &environments).map_err(fail)?;
                Some(Best {
                    assessment,
                    positions,
                })
            }
        };
        let judge = |plan: &[Position]| assess(plan, &conditions, &environments).map_err(fail);
        let advice = Advice {
            format: "vre-plan/1",
            plan: judge(&plan)?,
            add: additions
                .into_iter()
                .map(|(position, vre_sigma_g)| Addition {
                    position,
                    vre_sigma_g,
                })
                .collect(),
            twice: judge(&twice)?,
            remounted: judge(&remounted)?,
            best,
            batch: self.outlook(&plan, &conditions, &environments)?,
        };
        console.answer(text(&advice, &conditions), &advice)
    }
}

/// The plan of a triad that is held by hand.
const BY_HAND: &str = "hand";
/// Its orientations.
const BY_HAND_POSITIONS: usize = 80;

impl Plan {
    /// Orientations of a triad: those of a campaign, or an even cover of the sphere.
    fn of_triad(&self, console: &Console) -> Result<(), Error> {
        if self.best.is_some() {
            return Err(Error::Usage(
                "--best is for a dividing head, not for a triad".into(),
            ));
        }
        let (directions, mut conditions) = match self.plan.as_str() {
            BY_HAND => {
                let conditions = triad::conditions_by_hand();
                (spiral(BY_HAND_POSITIONS), conditions)
            }
            folder => triad::plan_of(Path::new(folder))?,
        };
        if let Some(noise_g) = self.noise {
            conditions.noise_g = noise_g;
        }
        let environment = |vibration: &Vibration| {
            let along_g = self.direction.map(|cosine| cosine * vibration.level_g);
            let moments = triad::moments(vibration.sine, along_g);
            (vibration.text.clone(), moments, [self.a0, 0.0, 0.0])
        };
        let environments: Vec<_> = self.vibration.iter().map(environment).collect();
        triad::plan(&directions, &conditions, &environments, console)
    }

    /// One instrument of a batch, if a batch is asked for.
    fn outlook(
        &self,
        plan: &[Position],
        conditions: &Conditions,
        environments: &[Environment],
    ) -> Result<Option<Vec<Outlook>>, Error> {
        let Some(instruments) = self.batch else {
            return Ok(None);
        };
        let batch = PlannedBatch {
            instruments,
            spread: of_type(DEFAULT_SPREAD, self.type_spread),
            prior: Prior::of_type(of_type(MEAN_SIGMA, self.prior_sigma)),
        };
        outlook(
            plan,
            &conditions.bench,
            conditions.noise_g,
            &batch,
            environments,
        )
        .map(Some)
    }

    fn plan_and_conditions(&self, console: &Console) -> Result<(Vec<Position>, Conditions), Error> {
        let arcsec = |angle: f64| angle * ARCSEC_RAD;
        let dial_sigma_rad = arcsec(self.dial_sigma.unwrap_or(5.8));
        let mut conditions = Conditions {
            bench: Bench {
                dial_sigma_rad,
                dial_repeat_sigma_rad: arcsec(1.0),
                mount_sigma_rad: arcsec(60.0),
                level_sigma_rad: dial_sigma_rad,
                local_gravity_g: 1.0,
            },
            noise_g: 1.5e-6,
            prior_sigma: self.prior_sigma,
        };
        let path = Path::new(&self.plan);
        let plan = match self.plan.as_str() {
            "paper" => paper_plan().collect(),
            "full" => full_rank_plan().collect(),
            _ if path.is_dir() => {
                let campaign = read_campaign(path, &[], console)?;
                conditions.bench = statics::bench(&campaign.config.bench);
                let k1 = campaign.config.instrument.scale_factor_nominal_v_per_g;
                let n = campaign.readings.len() as f64;
                conditions.noise_g =
                    campaign.readings.iter().map(|r| r.sigma_v).sum::<f64>() / n / k1.abs();
                campaign.readings.iter().map(statics::position).collect()
            }
            _ => read_plan(path)?,
        };
        let bench = &mut conditions.bench;
        for (given, into) in [
            (self.dial_sigma, &mut bench.dial_sigma_rad),
            (self.level_sigma, &mut bench.level_sigma_rad),
            (self.repeat_sigma, &mut bench.dial_repeat_sigma_rad),
            (self.mount_sigma, &mut bench.mount_sigma_rad),
        ] {
            if let Some(given) = given {
                *into = arcsec(given);
            }
        }
        if let Some(noise) = self.noise {
            conditions.noise_g = noise;
        }
        Ok((plan, conditions))
    }

    fn environments(&self) -> Vec<Environment> {
        let each = self.vibration.iter();
        each.map(|vibration| vibration.environment(&self.direction, self.a0))
            .collect()
    }
}

fn text(advice: &Advice, conditions: &Conditions) -> String {
    let mut text = String::new();
    let plan = &advice.plan;
    let _ = writeln!(
        text,
        "{} readings, rank {} of {NOMINAL}, {}",
        plan.readings,
        plan.rank,
        condition(plan.condition)
    );
    for direction in &plan.blind_directions {
        let _ = writeln!(
            text,
            "BLIND along {}: the readings tell no more than the prior.",
            sum(direction)
        );
    }
    let arcsec = |angle: f64| angle / ARCSEC_RAD;
    let b = &conditions.bench;
    let _ = writeln!(
        text,
        "\ndial {:.3} arcsec, repeatability {:.3}, level {:.3}, mount {:.3}; noise {:.2e} g a reading\n",
        arcsec(b.dial_sigma_rad),
        arcsec(b.dial_repeat_sigma_rad),
        arcsec(b.level_sigma_rad),
        arcsec(b.mount_sigma_rad),
        conditions.noise_g
    );
    write_coefficients(&mut text, plan);
    write_environments(&mut text, advice, conditions.prior_sigma);
    write_additions(&mut text, &advice.add);
    if let Some(best) = &advice.best {
        write_best(&mut text, best);
    }
    if let Some(batch) = &advice.batch {
        write_batch(&mut text, batch, plan);
    }
    text
}

fn write_coefficients(text: &mut String, plan: &Assessment) {
    let _ = writeln!(
        text,
        "Standard uncertainty of each coefficient, 1e-6 of its unit:"
    );
    for name in NAMES {
        let _ = match plan.coefficient_sigma.get(name).copied().flatten() {
            Some(sigma) => writeln!(text, "  {name:<12} {:>10.2}", sigma * 1e6),
            None => writeln!(text, "  {name:<12} undetermined"),
        };
    }
}

fn write_environments(text: &mut String, advice: &Advice, prior_sigma: f64) {
    let _ = writeln!(
        text,
        "\nStandard uncertainty of the predicted vibration error, 1e-6 g (blind: if every coefficient is 0 +- {:e}):",
        prior_sigma
    );
    let _ = writeln!(
        text,
        "  {:<34} {:>9} {:>9} {:>9}",
        "", "readings", "blind", "together"
    );
    let mut rows: Vec<(&str, &Assessment)> = vec![
        ("this plan", &advice.plan),
        ("twice, one mount", &advice.twice),
        ("as many, half remounted by 180 deg", &advice.remounted),
    ];
    if let Some(best) = &advice.best {
        rows.push(("best plan found", &best.assessment));
    }
    for k in 0..advice.plan.environments.len() {
        let _ = writeln!(text, "{}", advice.plan.environments[k].name);
        for (name, assessment) in &rows {
            let e = &assessment.environments[k];
            let _ = writeln!(
                text,
                "  {name:<34} {:>9} {:>9} {:>9}   {} readings, rank {}",
                fixed(e.readings_sigma_g * 1e6, 2),
                fixed(e.blind_sigma_g * 1e6, 2),
                fixed(e.sigma_g() * 1e6, 2),
                assessment.readings,
                assessment.rank
            );
        }
        let gain = advice.twice.environments[k].readings_sigma_g
            / advice.remounted.environments[k].readings_sigma_g;
        let _ = writeln!(
            text,
            "  remounting divides what the readings leave by {gain:.1}"
        );
    }
}

fn write_additions(text: &mut String, additions: &[Addition]) {
    if additions.is_empty() {
        let _ = writeln!(text, "\nNo single position more lowers this by 2 %.");
    } else {
        let _ = writeln!(
            text,
            "\nPositions to add, each the best after those above it:"
        );
        for Addition {
            position,
            vre_sigma_g,
        } in additions
        {
            let _ = writeln!(
                text,
                "  series {}  dial {:>5} deg   then {:.2}e-6 g together",
                u8::from(position.series),
                position.dial_deg,
                vre_sigma_g * 1e6
            );
        }
    }
}

fn write_best(text: &mut String, best: &Best) {
    let _ = writeln!(
        text,
        "\nBest plan found (a local optimum; best for these vibrations only, and for no others):"
    );
    for group in best
        .positions
        .chunk_by(|a, b| a.series == b.series && a.mount_deg == b.mount_deg)
    {
        let angles: Vec<_> = group.iter().map(|p| p.dial_deg.to_string()).collect();
        let _ = writeln!(
            text,
            "  series {}, mount {:>3} deg, dial {}",
            u8::from(group[0].series),
            group[0].mount_deg,
            angles.join(" ")
        );
    }
}

/// Standard deviations of a type's coefficients: `sigma` for those that rectify, as they are for bias and misalignments.
fn of_type(wide: [f64; TYPE], sigma: f64) -> [f64; TYPE] {
    const NOT_RECTIFYING: [usize; 3] = [0, 5, 6];
    std::array::from_fn(|k| {
        if NOT_RECTIFYING.contains(&k) {
            wide[k]
        } else {
            sigma
        }
    })
}

fn write_batch(text: &mut String, batch: &[Outlook], plan: &Assessment) {
    let _ = writeln!(
        text,
        "\nOne instrument of the batch, standard uncertainty in 1e-6 of k2 and of each predicted vibration error:"
    );
    for outlook in batch {
        let name = match outlook.mounting {
            Mounting::Alike => "all mounted alike",
            Mounting::Alternating => "every other one turned by 180 deg",
            Mounting::Remounted => "each remounted, twice the readings",
        };
        let _ = write!(
            text,
            "  {name:<34} k2 {:>8.2}",
            outlook.coefficient_sigma[3] * 1e6
        );
        for (environment, sigma_g) in plan.environments.iter().zip(&outlook.vre_sigma_g) {
            let _ = write!(text, "   {} {:>8.2}", environment.name, sigma_g * 1e6);
        }
        text.push('\n');
    }
    if batch.iter().any(|outlook| outlook.blind_first_harmonic) {
        let _ = writeln!(text, "BLIND, mounted alike: {ADVICE}");
    }
}
