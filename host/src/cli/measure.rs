//! `vre measure`

use std::fmt::Write as _;
use std::path::PathBuf;

use super::{Command, Console};
use crate::error::Error;
use crate::measure::{self, Axis, Calibration, Columns, Measurement, Request, Selection, Verdict};
use crate::quantity::Quantity;

/// Measure the vibration error from a raw record: how far the mean shifts under vibration, with its uncertainty and
/// what else could have shifted it
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  One record of an instrument of 1.2 V/g, at rest for 10 s, shaken from the 12th second on:
    vre measure run.csv --column u_v --time time_s --scale 1.2 --before 0..10 --during 12..60
  Many files in one table, three axes in counts:
    vre measure raw.csv --column accel_x,accel_y,accel_z --group file --before 'quiet_*' --during 'saw_*' \\
      --time timestamp_ms --time-unit ms --scale 16384 --full-scale 2 --temperature temp_c
  A shaker run from recorded frames, an instrument of 1.2 V/g behind a divider by 10:
    vre measure capture.rec --run 3 --scale 0.12")]
pub struct Measure {
    /// A CSV table, or a record of frames
    file: PathBuf,
    /// Columns of the output, one an axis (for a table)
    #[arg(long, value_name = "NAME", value_delimiter = ',')]
    column: Vec<String>,
    /// Column that says to which file or group a row belongs; without it, --before and --during are windows of time
    #[arg(long, value_name = "NAME")]
    group: Option<String>,
    /// Samples before the vibration: names or patterns (* ? [..]) separated by commas, or a window START..END in s
    #[arg(long, value_name = "SELECTION", requires = "during")]
    before: Option<String>,
    /// Samples during the vibration, likewise; what --before names is not taken again
    #[arg(long, value_name = "SELECTION", requires = "before")]
    during: Option<String>,
    /// Names to leave out
    #[arg(long, value_name = "NAMES", requires = "before")]
    without: Option<String>,
    /// Column of the time; without it, windows count rows
    #[arg(long, value_name = "NAME")]
    time: Option<String>,
    /// Unit of the time
    #[arg(long, value_enum, default_value = "s")]
    time_unit: TimeUnit,
    /// Scale factor: counts or volts a g; of a record of frames, V/g at the converter's input, behind all dividers of the
    /// front end: 0.12 for an instrument of 1.2 V/g behind a divider by 10
    #[arg(long, value_name = "UNITS_PER_G", default_value = "1", value_parser = scale, allow_negative_numbers = true)]
    scale: f64,
    /// Where the output clips, g
    #[arg(long, value_name = "G", value_parser = super::positive)]
    full_scale: Option<f64>,
    /// Column of the instrument's temperature, C
    #[arg(long, value_name = "NAME")]
    temperature: Option<String>,
    /// Sensitivity of the bias to temperature, g/C; without it, it is taken from four or more segments before
    #[arg(long, value_name = "G_PER_C", allow_negative_numbers = true)]
    temperature_sensitivity: Option<f64>,
    /// Shaker run, of a record of frames; the first by default
    #[arg(long, value_name = "N")]
    run: Option<u32>,
}

/// What no instrument and no unit comes near is a slip of the pen.
fn scale(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(scale) if (1e-12..=1e12).contains(&scale.abs()) => Ok(scale),
        Ok(_) => Err("is outside of 1e-12 to 1e12".into()),
        Err(_) => Err("is not a number".into()),
    }
}

#[derive(Clone, Copy, clap::ValueEnum)]
enum TimeUnit {
    S,
    Ms,
    Us,
}

impl TimeUnit {
    fn per_second(self) -> f64 {
        match self {
            Self::S => 1.0,
            Self::Ms => 1e3,
            Self::Us => 1e6,
        }
    }
}

impl Command for Measure {
    fn run(self, console: &Console) -> Result<(), Error> {
        let selection = match (&self.before, &self.during) {
            (Some(before), Some(during)) => Some(Selection::parse(
                self.group.as_deref(),
                before,
                during,
                self.without.as_deref(),
            )?),
            _ => None,
        };
        if self
            .temperature_sensitivity
            .is_some_and(|sensitivity| !sensitivity.is_finite())
        {
            return Err(Error::Usage(
                "--temperature-sensitivity is not finite".into(),
            ));
        }
        let request = Request {
            columns: Columns {
                outputs: self.column,
                time: self.time.map(|name| (name, self.time_unit.per_second())),
                temperature: self.temperature,
            },
            selection,
            run: self.run,
            calibration: Calibration {
                units_per_g: self.scale,
                full_scale_g: self.full_scale,
                temperature_sensitivity_g_per_c: self.temperature_sensitivity,
            },
        };
        let measurement = measure::measure(&self.file, &request)?;
        console.print(text(&measurement))?;
        console.json(&measurement)
    }
}

fn text(found: &Measurement) -> String {
    let mut text = format!("{}\n", found.input);
    if found.record.is_some() {
        let _ = writeln!(
            text,
            "scale {} V/g at the converter's input",
            found.units_per_g
        );
    }
    text.push('\n');
    for segment in &found.segments {
        let means: Vec<_> = segment
            .mean_g
            .iter()
            .map(|mean| format!("{:>14}", shown(*mean)))
            .collect();
        let rms: Vec<_> = segment
            .rms_g
            .iter()
            .map(|rms| format!("{rms:.4}"))
            .collect();
        let blocks = segment
            .blocks
            .map(|n| format!(" in {n} blocks"))
            .unwrap_or_default();
        let temperature = segment
            .temperature_c
            .map(|t| format!("  {t:.2} C"))
            .unwrap_or_default();
        let _ = writeln!(
            text,
            "{:<6} {:<28} {:>9} samples{blocks}  mean {} g  rms {} g{temperature}",
            segment.role,
            segment.name,
            segment.samples,
            means.join(" "),
            rms.join(" "),
        );
    }
    for axis in &found.axes {
        write_axis(&mut text, axis);
    }
    if let Some(tally) = &found.record {
        let _ = writeln!(
            text,
            "\nrecord: {} sound frames; lost: {} frames missing, {} of {} bytes damaged in {} stretches, {} raw samples, \
             {} samples of blocks; {} restarts",
            tally.frames,
            tally.missing_frames,
            tally.damaged_bytes,
            tally.bytes,
            tally.damaged_stretches,
            tally.raw.missing,
            tally.blocks.missing,
            tally.restarts,
        );
    }
    if !found.notes.is_empty() {
        text.push('\n');
    }
    for note in &found.notes {
        let _ = writeln!(text, "note: {note}");
    }
    text
}

/// A figure whose uncertainty is unknown still has a value.
fn shown(figure: Quantity) -> String {
    match (figure.value, figure.sigma) {
        (Some(value), None) => format!("{value}(?)"),
        _ => figure.to_string(),
    }
}

fn write_axis(text: &mut String, axis: &Axis) {
    let [low, high] = axis.interval_95_g.map(|g| 1e3 * g);
    // As many digits as the uncertainty has, and one more.
    let decimals = (1.0 - ((high - low) / 4.0).log10().floor()).clamp(0.0, 9.0) as usize;
    let freedom = match axis.degrees_of_freedom {
        many if many > 1000.0 => "over 1000".into(),
        few => format!("{few:.1}"),
    };
    let probability = axis
        .p_value
        .map_or("p unknown".into(), |p| format!("p = {p:.2e}"));
    let _ = writeln!(
        text,
        "\n{}: shift {} mg, 95 % interval {low:.decimals$} to {high:.decimals$} mg ({freedom} degrees of freedom), {probability}\n  \
         plain difference of the means {} mg; rms {:.4} g before, {:.4} g during",
        axis.column,
        shown(axis.shift_g.scaled(1e3)),
        shown(axis.mean_difference_g.scaled(1e3)),
        axis.rms_before_g,
        axis.rms_during_g,
    );
    for rival in &axis.rivals {
        let weight = if rival.decisive {
            "RIVAL"
        } else {
            "rival, too small"
        };
        let _ = writeln!(text, "  {weight}: {}", rival.finding);
    }
    let verdict = match axis.verdict {
        Verdict::NoShift => "no shift beyond the uncertainty",
        Verdict::Attributable => {
            "a shift that the vibration explains and nothing else that was looked at"
        }
        Verdict::NotAttributable => {
            "a shift, but NOT ATTRIBUTABLE to the vibration: see the rivals and notes"
        }
    };
    let _ = writeln!(text, "  verdict: {verdict}");
}
