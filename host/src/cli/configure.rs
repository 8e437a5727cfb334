//! `vre configure`

use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use clap::ValueEnum;
use serde::Serialize;
use shared::compensate::{self, Calibration};
use shared::model::FURTHER_NAMES;
use shared::rectification::{Covariance, NOMINAL_RECTIFYING};
use shared::stated_errors::StatedErrors;
use shared::wire::configuration::{Certified, Configuration, Date, Provenance};
use shared::wire::message::StoreFault;

use super::{Command, Console, within};
use crate::campaign::{Campaign, ranges};
use crate::configuration::{configuration, provenance};
use crate::diagnose::{Diagnosis, Verdict, static_test};
use crate::error::Error;
use crate::front_end::FrontEnd;
use crate::link::{Kept, Link};
use crate::source::{BAUD, SerialSource};
use crate::statics::{Method, NAMES, identify};

/// Give an instrument the coefficients of a campaign to compensate its vibration error with, which it keeps; or show or erase
/// what it keeps
#[derive(clap::Args)]
#[command(after_help = "Examples:
  vre configure campaigns/S01000 --port /dev/ttyACM0
  vre configure campaigns/S01000 --diagnosis diagnosis.json --port /dev/ttyACM0
  vre configure --port /dev/ttyACM0              shows what the instrument keeps
  vre configure --port /dev/ttyACM0 --erase")]
pub struct Configure {
    /// Folder of the campaign whose coefficients it is to have; without one it is only asked
    #[arg(conflicts_with = "erase")]
    campaign: Option<PathBuf>,
    /// Coefficients of the campaign's diagnosis (`vre diagnose --json`) in place of the static test's: with the terms that it
    /// found beyond the nominal model
    #[arg(long, value_name = "FILE.json", requires = "campaign")]
    diagnosis: Option<PathBuf>,
    /// The instrument's serial port
    #[arg(long, value_name = "DEV")]
    port: PathBuf,
    /// Speed of the line
    #[arg(long, value_name = "BAUD", default_value_t = BAUD)]
    baud: u32,
    /// Compensate no longer, and keep nothing
    #[arg(long)]
    erase: bool,
    /// Also where it keeps the coefficients of another instrument
    #[arg(long)]
    force: bool,
    /// By a block's moments or point by point
    #[arg(long, value_enum, default_value = "block")]
    mode: Mode,
    /// Where the vibration's moments come from
    #[arg(long, value_enum, default_value = "reference")]
    source: Source,
    /// Conversions in a block: 40 are a hundred blocks a second at 4 kSPS
    #[arg(long, value_name = "N", default_value_t = 40)]
    block: u16,
    /// Volts of the instrument's output over those at the converter [default: divider over gain of campaign.toml, 1 where
    /// it states neither]
    #[arg(long, value_name = "RATIO", value_parser = within(&ranges::FACTOR))]
    divider: Option<f64>,
    /// Scale of the reference at the converter, V/g
    #[arg(long, value_name = "V/G", default_value_t = 0.1, value_parser = within(&ranges::REFERENCE_SCALE))]
    reference: f64,
    #[command(flatten)]
    errors: Errors,
}

/// Standard uncertainties that no campaign determines; they widen what each compensated block states.
#[derive(clap::Args)]
#[command(next_help_heading = "Standard uncertainties that no campaign determines")]
struct Errors {
    /// Change of the scale factor, from the middle of the campaign's temperatures on
    #[arg(long, value_name = "PPM/K", default_value_t = 0.0, value_parser = within(&ranges::PARTS_PER_MILLION))]
    scale_per_k: f64,
    /// Change of the scale factor until the next calibration
    #[arg(long, value_name = "PPM", default_value_t = 0.0, value_parser = within(&ranges::PARTS_PER_MILLION))]
    scale_drift: f64,
    /// Change of the bias, from the middle of the campaign's temperatures on
    #[arg(long, value_name = "MICROG/K", default_value_t = 0.0, value_parser = within(&ranges::BIAS_CHANGE))]
    bias_per_k: f64,
    /// Change of the bias until the next calibration
    #[arg(long, value_name = "MICROG", default_value_t = 0.0, value_parser = within(&ranges::BIAS_CHANGE))]
    bias_drift: f64,
    /// Nonlinearity of the converter, of full scale; the ADS131M04's is 6 ppm typically
    #[arg(long, value_name = "PPM", default_value_t = 6.0, value_parser = within(&ranges::PARTS_PER_MILLION))]
    converter_nonlinearity: f64,
}

impl Errors {
    fn stated(&self) -> StatedErrors<f32> {
        let millionths = |x: f64| (x * 1e-6) as f32;
        StatedErrors {
            scale_factor_per_k: millionths(self.scale_per_k),
            scale_factor_drift: millionths(self.scale_drift),
            bias_g_per_k: millionths(self.bias_per_k),
            bias_drift_g: millionths(self.bias_drift),
            converter_nonlinearity: millionths(self.converter_nonlinearity),
        }
    }
}

#[derive(Clone, Copy, ValueEnum)]
enum Mode {
    Block,
    Pointwise,
}

#[derive(Clone, Copy, ValueEnum)]
enum Source {
    Reference,
    Instrument,
}

/// What `--json` gets.
#[derive(Serialize)]
struct Shown {
    configuration: Option<Configuration>,
    provenance: Option<Origin>,
    errors: Option<StatedErrors<f32>>,
    writes: u32,
    fault: Option<StoreFault>,
}

/// Whose coefficients these are, as text.
#[derive(Serialize)]
struct Origin {
    serial: String,
    /// Year, month, day.
    date: String,
    /// SHA-256 of its files, hexadecimal.
    campaign: String,
    temperature_c: Option<[f32; 2]>,
    accepted_by: Option<[u8; 3]>,
}

impl From<Provenance> for Origin {
    fn from(known: Provenance) -> Self {
        let Date { year, month, day } = known.date;
        Self {
            serial: known.serial.as_str().into(),
            date: format!("{year:04}-{month:02}-{day:02}"),
            campaign: known.campaign.iter().map(|b| format!("{b:02x}")).collect(),
            temperature_c: known.temperature_c,
            accepted_by: known.accepted_by,
        }
    }
}

impl Configure {
    /// What the instrument is to have, and a line on the front end that it is reckoned with.
    fn wanted(&self, folder: &Path) -> Result<(Certified, String), Error> {
        let campaign = Campaign::read(folder)?.used();
        let known = match &self.diagnosis {
            Some(file) => diagnosed(file, &campaign)?,
            None => {
                let belonging = static_test(&campaign).belonging;
                identify(&belonging, Method::LeastSquares, None)?.calibration()
            }
        };
        let acquisition = &campaign.config.acquisition;
        let (front_end, stated) = match self.divider {
            Some(divider) => (FrontEnd { divider, gain: 1.0 }, "as --divider says"),
            None if acquisition.states_front_end() => {
                (acquisition.front_end(), "as campaign.toml states")
            }
            None => (
                acquisition.front_end(),
                "campaign.toml states no divider or gain; see --divider",
            ),
        };
        let mode = match self.mode {
            Mode::Block => compensate::Mode::Block,
            Mode::Pointwise => compensate::Mode::Pointwise,
        };
        let source = match self.source {
            Source::Reference => compensate::Source::Reference,
            Source::Instrument => compensate::Source::Instrument,
        };
        let wanted = Certified {
            configuration: configuration(
                &known,
                &front_end,
                self.reference,
                mode,
                source,
                self.block,
            ),
            provenance: Some(provenance(folder, &campaign)?),
            errors: self.errors.stated(),
        };
        if wanted.is_possible() {
            Ok((wanted, format!("front end: {front_end} ({stated})")))
        } else {
            let line = "no instrument can compensate with this: a block has at least 4 conversions, K1 is positive";
            Err(Error::Usage(line.into()))
        }
    }
}

/// What a diagnosis of that campaign's instrument has the instrument compensate with.
fn diagnosed(file: &Path, campaign: &Campaign) -> Result<Calibration<f64>, Error> {
    let diagnosis = Diagnosis::read(file)?;
    let serial = &campaign.config.instrument.serial;
    if diagnosis.serial != *serial {
        let line = format!(
            "it is of instrument {}, the campaign of {serial}",
            diagnosis.serial
        );
        return Err(Error::input(file, line));
    }
    let serves = diagnosis.serves();
    match diagnosis.compensation {
        Some(compensation) if serves && !compensation.carried.is_empty() => {
            Ok(compensation.calibration())
        }
        compensation => {
            let what = match (compensation, diagnosis.verdict) {
                (Some(known), _) if known.carried.is_empty() => {
                    "it holds no term that the compensation could carry"
                }
                (Some(_), _) => "its effects make predictions no better",
                (None, Verdict::Ambiguous) => "it cannot tell which effect acts",
                (None, _) => "it leaves the gap unexplained",
            };
            let line = format!("{what}: leave out --diagnosis to send the static test's own");
            Err(Error::input(file, line))
        }
    }
}

/// As it was sent: the instrument adds by which firmware it was accepted.
fn unaccepted(certified: Certified) -> Certified {
    Certified {
        provenance: certified.provenance.map(|known| Provenance {
            accepted_by: None,
            ..known
        }),
        ..certified
    }
}

impl Configure {
    /// Refuses to put the coefficients of one accelerometer in the place of another's.
    fn same_instrument(
        &self,
        wanted: Option<&Certified>,
        kept: Option<&Certified>,
    ) -> Result<(), Error> {
        let serial = |known: Option<&Certified>| known?.provenance.map(|known| known.serial);
        match (serial(wanted), serial(kept)) {
            (Some(wanted), Some(kept)) if wanted != kept => Err(Error::Usage(format!(
                "--port {}: it keeps the coefficients of instrument {}, the campaign is of {}; --force replaces them",
                self.port.display(),
                kept.as_str(),
                wanted.as_str()
            ))),
            _ => Ok(()),
        }
    }
}

impl Command for Configure {
    fn run(self, console: &Console) -> Result<(), Error> {
        // The campaign first: a bad one must not touch the instrument.
        let wanted = self
            .campaign
            .as_deref()
            .map(|c| self.wanted(c))
            .transpose()?;
        let wanted = match wanted {
            None => None,
            Some((wanted, front_end)) => {
                console.print(front_end)?;
                Some(wanted)
            }
        };
        let mut link = Link::unrecorded(SerialSource::open(&self.port, self.baud)?)?;
        let mut kept = link.ask_configuration()?;
        if wanted.is_some() || self.erase {
            if !self.force {
                self.same_instrument(wanted.as_ref(), kept.certified.as_ref())?;
            }
            kept = link.replace(kept.writes, wanted)?;
            if kept.fault.is_none() && kept.certified.map(unaccepted) != wanted {
                return Err(Error::Link {
                    source_name: self.port.display().to_string(),
                    problem: "the instrument keeps something else than was sent".into(),
                });
            }
        }
        let shown = Shown {
            configuration: kept.certified.map(|kept| kept.configuration),
            provenance: kept
                .certified
                .and_then(|kept| kept.provenance)
                .map(Origin::from),
            errors: kept.certified.map(|kept| kept.errors),
            writes: kept.writes,
            fault: kept.fault,
        };
        console.as_told(text(&kept), &shown)?;
        match kept.fault {
            None => Ok(()),
            Some(fault) => Err(Error::Link {
                source_name: self.port.display().to_string(),
                problem: format!("the instrument's memory failed: {fault:?}"),
            }),
        }
    }
}

/// The standard uncertainty of one of the coefficients that rectify, to the end of its line.
fn sigma(covariance: &Covariance<f32>, n: usize) -> String {
    format!("  sigma {:.1e}\n", covariance.get(n, n).sqrt())
}

fn provenance_text(provenance: Option<Provenance>) -> String {
    let Some(known) = provenance else {
        return "Nobody says whose coefficients these are.\n".into();
    };
    let known = Origin::from(known);
    let mut text = format!("Instrument {}, sent on {}", known.serial, known.date);
    if let Some([major, minor, patch]) = known.accepted_by {
        let _ = write!(text, ", accepted by firmware {major}.{minor}.{patch}");
    }
    if let Some([low, high]) = known.temperature_c {
        let _ = write!(text, ", calibrated from {low} to {high} deg C");
    }
    let _ = writeln!(text, ".\nCampaign {}.", known.campaign);
    text
}

fn text(kept: &Kept) -> String {
    let Some(certified) = kept.certified else {
        return "The instrument keeps nothing and compensates nothing.".into();
    };
    let Configuration {
        compensation,
        calibration,
    } = certified.configuration;
    let mut text = provenance_text(certified.provenance);
    match compensation.mode {
        None => text.push_str("The instrument does not compensate.\n"),
        Some(mode) => {
            let _ = writeln!(
                text,
                "The instrument compensates: {mode:?}, moments from {:?}, blocks of {} conversions.",
                compensation.source, compensation.block_samples
            );
        }
    }
    match calibration {
        None => text.push_str("It has no coefficients.\n"),
        Some(known) => {
            let further = known.coefficients.further.into_iter();
            let nominal = known.coefficients.nominal.into_iter();
            for (k, (name, value)) in NAMES.into_iter().zip(nominal).enumerate() {
                let _ = write!(text, "{name:<12} {value:>16.8e}");
                let n = NOMINAL_RECTIFYING
                    .iter()
                    .position(|&rectifying| rectifying == k);
                text.push_str(&n.map_or("\n".into(), |n| sigma(&known.covariance, n)));
            }
            for (k, (name, value)) in FURTHER_NAMES.into_iter().zip(further).enumerate() {
                if value != 0.0 {
                    let _ = write!(text, "{name:<12} {value:>16.8e}");
                    text.push_str(&sigma(&known.covariance, NOMINAL_RECTIFYING.len() + k));
                }
            }
            let _ = writeln!(
                text,
                "K1 is in volts at the converter; rank {} of 11.",
                known.rank
            );
        }
    }
    let _ = write!(text, "Its memory was written {} times.", kept.writes);
    text
}
