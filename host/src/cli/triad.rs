//! What the commands do with the campaign of a triad.

use std::path::Path;

use serde_json::json;
use shared::triad::body::Axis;
use shared::triad::vibration::BodyMoments;

use super::{Console, refuse_campaign, within};
use crate::bench::noise::Seed;
use crate::campaign::{TriadCampaign, ranges, read_triad_runs};
use crate::error::Error;
use crate::output::{write_file, write_json};
use crate::report;
use crate::statics::NAMES;
use crate::triad::planning::{self, Conditions, Environment};
use crate::triad::session::{Session, Simulated};
use crate::triad::{self, rests, text};

/// `vre identify`
pub fn identify(folder: &Path, console: &Console) -> Result<(), Error> {
    let identification = triad::identify(&TriadCampaign::read(folder)?)?;
    console.answer(text::identification(&identification), &identification)
}

/// `vre predict`; `runs` is a table of its own.
pub fn predict(folder: &Path, runs: Option<&Path>, console: &Console) -> Result<(), Error> {
    let campaign = TriadCampaign::read(folder)?;
    let own;
    let runs = match runs {
        Some(file) => {
            own = read_triad_runs(file)?;
            &own
        }
        None => &campaign.runs,
    };
    if runs.is_empty() {
        return Err(Error::Usage(format!(
            "{}: has no runs to predict; name a table of some with --runs",
            folder.display()
        )));
    }
    let prediction = triad::predict(&campaign, runs)?;
    console.answer(text::prediction(&prediction, runs), &prediction)
}

/// `vre diagnose`
pub fn diagnose(folder: &Path, console: &Console) -> Result<(), Error> {
    let diagnosis = triad::diagnosis::diagnose(&TriadCampaign::read(folder)?)?;
    console.answer(text::diagnosis(&diagnosis), &diagnosis)
}

/// `vre report`
pub fn report(folder: &Path, out: &Path, console: &Console) -> Result<(), Error> {
    let campaign = TriadCampaign::read(folder)?;
    let report = report::triad::write(&campaign, out)?;
    let page = out.join("report.html");
    console.answer(
        format!(
            "{}\n{}",
            text::identification(&report.identification),
            page.display()
        ),
        &report.identification,
    )
}

/// Least length of a rest in the demonstration, s.
const LEAST_REST_S: f64 = 1.5;

/// `vre demo --triad`: a session by hand in the time domain, its rests, coefficients, prediction, page.
pub fn demo(out: &Path, session: &Session, console: &Console) -> Result<(), Error> {
    let folder = out.join("campaign");
    if !out.join("truth.json").exists() {
        refuse_campaign(&folder, "")?;
    }
    let simulated = session.simulate();
    let mut campaign = simulated.campaign.clone();
    if session.attitude_sigma_arcsec.is_none() {
        let samples = simulated
            .record
            .iter()
            .map(|sample| (sample.time_s, sample.output_v));
        let rests = rests::of_samples(samples, LEAST_REST_S);
        campaign.positions = rests.map_or(Vec::new(), |rests| rests.positions());
    }
    campaign.write(&folder)?;
    write_record(&folder.join("record.csv"), &simulated)?;
    write_json(&out.join("truth.json"), &truth(&simulated))?;
    let report = report::triad::write(&campaign, out)?;
    let mut told = format!(
        "{} rests found in a session of {:.0} s, {} orientations\n\n",
        campaign.positions.len(),
        simulated.record.last().map_or(0.0, |sample| sample.time_s),
        session.positions
    );
    told += &text::identification(&report.identification);
    told.push('\n');
    if let Some(prediction) = &report.prediction {
        told += &text::prediction(prediction, &campaign.runs);
    }
    told += &out.join("report.html").display().to_string();
    console.answer(told, &report.identification)
}

/// Orientations to add that are looked for.
const ADDITIONS: usize = 4;

/// `vre plan` of a campaign, or of orientations without one.
pub fn plan(
    directions: &[[f64; 3]],
    conditions: &Conditions,
    environments: &[Environment],
    console: &Console,
) -> Result<(), Error> {
    let plan = planning::assess(directions, conditions, environments, ADDITIONS)?;
    console.answer(text::plan(&plan, conditions), &plan)
}

/// What is taken where no campaign says otherwise: 2 microg a reading, cross-couplings of navigation instruments.
pub fn conditions_by_hand() -> Conditions {
    Conditions {
        noise_g: 2e-6,
        attitude_sigma_rad: None,
        cross_coupling_sigma_per_g: Some(5e-5),
    }
}

/// Directions of the positions of a campaign, and what they are known to.
pub fn plan_of(folder: &Path) -> Result<(Vec<[f64; 3]>, Conditions), Error> {
    let campaign = TriadCampaign::read(folder)?;
    let fitted = triad::fit(&campaign)?;
    let count = campaign.positions.len() as f64;
    let k1 = campaign
        .config
        .instrument
        .scale_factor_nominal_v_per_g
        .abs();
    let squares = campaign.positions.iter().flat_map(|p| p.sigma_v);
    let squares: f64 = squares.map(|sigma_v| (sigma_v / k1).powi(2)).sum();
    let noise_g = (squares / (3.0 * count)).sqrt().hypot(fitted.scatter_g);
    let known = campaign.positions.iter().filter_map(|p| p.attitude);
    let sigmas: Vec<f64> = known.map(|attitude| attitude.sigma_rad).collect();
    let all = sigmas.len() == campaign.positions.len();
    let conditions = Conditions {
        noise_g,
        attitude_sigma_rad: all.then(|| sigmas.iter().sum::<f64>() / count),
        cross_coupling_sigma_per_g: campaign.config.instrument.cross_coupling_sigma_per_g,
    };
    let directions = triad::observations::directions(&campaign, &fitted.bounded.coefficients);
    Ok((directions, conditions))
}

/// Moments of a vibration along a direction of the body.
pub fn moments(sine: bool, along_g: [f64; 3]) -> BodyMoments<f64> {
    if sine {
        return BodyMoments::harmonic(along_g);
    }
    let sign = |j: usize, k: usize| match along_g[j] * along_g[k] {
        0.0 => 0.0,
        product => product.signum(),
    };
    BodyMoments::random(along_g.map(f64::abs), [sign(0, 1), sign(1, 2), sign(2, 0)])
}

/// `vre simulate --triad`: campaign.toml, positions.csv, vibration.csv, record.csv and truth.json.
pub fn simulate(out: &Path, session: &Session, console: &Console) -> Result<(), Error> {
    let simulated = session.simulate();
    simulated.campaign.write(out)?;
    write_record(&out.join("record.csv"), &simulated)?;
    let truth = truth(&simulated);
    write_json(&out.join("truth.json"), &truth)?;
    console.answer(format!(
        "{}: {} positions, {} shaker runs, a record of {:.0} s in record.csv, the truth in truth.json",
        out.display(),
        simulated.campaign.positions.len(),
        simulated.campaign.runs.len(),
        simulated.record.last().map_or(0.0, |sample| sample.time_s),
    ), &truth)
}

/// The coefficients that the bench really gave the triad, by name.
pub fn truth(simulated: &Simulated) -> serde_json::Value {
    let instrument = |axis: Axis| {
        let values = simulated.triad[axis.index()].to_nominal();
        let by_name = NAMES.iter().zip(values);
        let named: serde_json::Map<_, _> = by_name
            .map(|(name, value)| ((*name).to_owned(), json!(value)))
            .collect();
        (axis.name().to_owned(), serde_json::Value::Object(named))
    };
    let instruments: serde_json::Map<_, _> = Axis::ALL.map(instrument).into_iter().collect();
    json!({ "format": "vre-triad-truth/1", "instruments": instruments })
}

fn write_record(file: &Path, simulated: &Simulated) -> Result<(), Error> {
    use std::fmt::Write as _;
    let mut table = String::from("time_s,u_x_v,u_y_v,u_z_v\n");
    for sample in &simulated.record {
        let [x, y, z] = sample.output_v;
        let _ = writeln!(table, "{:.2},{x:.7},{y:.7},{z:.7}", sample.time_s);
    }
    write_file(file, table.as_bytes())
}

/// Options of the commands that make a triad up.
#[derive(Clone, Debug, clap::Args)]
pub struct Made {
    /// A triad instead of a single instrument: positions.csv and a continuous record of the session
    #[arg(long)]
    pub triad: bool,
    /// Orientations of the triad
    #[arg(long, value_name = "N", default_value_t = 80, value_parser = clap::value_parser!(u16).range(12..=1000), requires = "triad")]
    pub positions: u16,
    /// Error of each setting of the triad, arcsec, which is stated; by hand, with no attitude known, if absent
    #[arg(long, value_name = "ARCSEC", value_parser = within(&ranges::ARCSEC_SIGMA), requires = "triad")]
    pub attitude_sigma: Option<f64>,
}

impl Made {
    /// The session of this seed.
    pub fn session(&self, seed: u64) -> Session {
        Session {
            seed: Seed(seed),
            positions: usize::from(self.positions),
            attitude_sigma_arcsec: self.attitude_sigma,
            noise_g: 2e-6,
        }
    }
}
