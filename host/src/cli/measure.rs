//! `vre measure`

use std::fmt::Write as _;
use std::path::PathBuf;

use super::into::Into;
use super::sparkline::sparkline;
use super::{Command, Console, within};
use crate::campaign::ranges;
use crate::error::{Error, Place, Problem, clip};
use crate::import;
use crate::measure::{
    self, Axis, Calibration, Columns, Measurement, MotionKind, Outcome, Picture, Plateau, Request,
    Selection, Unit, Verdict, WaveformCoefficients,
};
use crate::output::write_file;
use crate::quantity::Quantity;
use crate::report;

/// Measure the vibration error from a raw record: how far the mean shifts under vibration, with its uncertainty and
/// what else could have shifted it
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  A record of whatever maker; rests and plateaus are found:
    vre measure shaker.csv --column x_g --time t_s
  One record of an instrument of 1.2 V/g, at rest for 10 s, shaken from the 12th second on:
    vre measure run.csv --column u_v --time time_s --scale 1.2 --before 0..10 --during 12..60
  Many files in one table, three axes in counts:
    vre measure raw.csv --column accel_x,accel_y,accel_z --group file --before 'quiet_*' --during 'saw_*' \\
      --time timestamp_ms --time-unit ms --scale 16384 --full-scale 2 --temperature temp_c
  The plateaus of a record become runs of a campaign, with what the reference beside the instrument saw:
    vre measure shaker.tdms --axes u=out_v,ref_i=x_g,ref_p=y_g,ref_o=z_g --into campaign
  A shaker run from recorded frames, an instrument of 1.2 V/g behind a divider by 10:
    vre measure capture.rec --run 3 --scale 0.12")]
pub struct Measure {
    /// A table (CSV, XLSX, ODS), a record of another maker (WAV, Parquet, MAT, HDF5, UFF 58, TDMS, ULog, DataFlash, MCAP), or a
    /// record of frames
    file: PathBuf,
    /// Columns of the output, one an axis (for a table)
    #[arg(
        long,
        value_name = "NAME",
        value_delimiter = ',',
        conflicts_with = "axes"
    )]
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
    /// Column of the time; without it, windows count rows, unless the file tells rate or times itself
    #[arg(long, value_name = "NAME")]
    time: Option<String>,
    /// Unit of the time; without it, what the name of the column or a row of units says, or s
    #[arg(long, value_enum)]
    time_unit: Option<TimeUnit>,
    /// Unit of the output: g, mg, m/s2, V or counts; it is read from the name of the column where that ends with it, as x_g,
    /// "x (m/s^2)"
    #[arg(long, value_name = "UNIT", value_parser = unit)]
    unit: Option<Unit>,
    /// Scale factor: counts or volts a g, negative of an inverted output; needed unless the unit is one of acceleration; of a record of frames, V/g at the converter's input, behind all dividers of the
    /// front end: 0.12 for an instrument of 1.2 V/g behind a divider by 10
    #[arg(long, value_name = "UNITS_PER_G", value_parser = within(&ranges::RECORD_SCALE), allow_negative_numbers = true)]
    scale: Option<f64>,
    /// Where the output clips, g
    #[arg(long, value_name = "G", value_parser = within(&ranges::FULL_SCALE))]
    full_scale: Option<f64>,
    /// Column of the instrument's temperature, C
    #[arg(long, value_name = "NAME")]
    temperature: Option<String>,
    /// Sensitivity of the bias to temperature, g/C; without it, it is taken from four or more segments before
    #[arg(long, value_name = "G_PER_C", value_parser = within(&ranges::BIAS_SENSITIVITY), allow_negative_numbers = true)]
    temperature_sensitivity: Option<f64>,
    #[command(flatten)]
    into: Into,
    /// Write a page with the picture of what was taken, for a browser
    #[arg(long, value_name = "FILE")]
    html: Option<PathBuf>,
    /// Shaker run, of a record of frames; the first by default
    #[arg(long, value_name = "N")]
    run: Option<u32>,
}

fn unit(text: &str) -> Result<Unit, String> {
    Unit::parse(text).ok_or_else(|| "is none of g, mg, m/s2, V, counts".into())
}

/// Unit of a column of time.
#[derive(Clone, Copy, clap::ValueEnum)]
pub(super) enum TimeUnit {
    S,
    Ms,
    Us,
}

impl TimeUnit {
    pub(super) fn per_second(self) -> f64 {
        match self {
            Self::S => 1.0,
            Self::Ms => 1e3,
            Self::Us => 1e6,
        }
    }
}

impl Measure {
    /// Fills in what a table says of itself: time and outputs by names and units.
    fn complete(&mut self) -> Result<Vec<Option<Unit>>, Error> {
        let names: Vec<&str> = self.column.iter().map(String::as_str).collect();
        let layout = import::layout(&self.file, &names)?;
        if let Some(twice) = layout.twice() {
            let place = Place {
                column: Some(twice.into()),
                ..Place::file(&self.file)
            };
            let problem = Problem::DuplicateColumn;
            return Err(Error::Input { place, problem });
        }
        if self.column.is_empty() {
            self.column = layout.outputs.clone();
            if self.column.is_empty() {
                let names: Vec<String> = layout.names.iter().map(|name| clip(name)).collect();
                return Err(Error::Usage(format!(
                    "no column's name or unit tells an acceleration; --column is one of {}",
                    names.join(", ")
                )));
            }
            self.time = self.time.take().or(layout.time.clone());
        }
        Ok(self.column.iter().map(|name| layout.unit(name)).collect())
    }

    /// Units of the time that make a second.
    fn per_second(&self, name: &str) -> Result<f64, Error> {
        if let Some(unit) = self.time_unit {
            return Ok(unit.per_second());
        }
        let layout = import::layout(&self.file, &[name])?;
        Ok(layout.seconds(name).unwrap_or(1.0))
    }

    /// Units a g: as told, or by the unit that is told or that the columns have.
    fn units_per_g(&self, units: &[Option<Unit>]) -> Result<f64, Error> {
        if let Some(scale) = self.scale {
            return Ok(scale);
        }
        if self.column.is_empty() {
            let line = "--scale is needed: V/g at the converter's input";
            return Err(Error::Usage(line.into()));
        }
        let mut known: Option<f64> = None;
        for (column, unit) in self.column.iter().zip(units) {
            let column = clip(column);
            let Some(units) = self.unit.or(*unit).and_then(Unit::units_per_g) else {
                return Err(Error::Usage(format!(
                    "--scale is needed, units a g of {column}: neither its name nor --unit tells a unit of acceleration"
                )));
            };
            if known.is_some_and(|known| known != units) {
                let line = format!("{column} is of another unit than the columns before it");
                return Err(Error::Usage(line));
            }
            known = Some(units);
        }
        Ok(known.unwrap_or(1.0))
    }
}

impl Command for Measure {
    fn run(mut self, console: &Console) -> Result<(), Error> {
        let campaign = self.into.campaign()?;
        if let Some(output) = self.into.output() {
            self.column = vec![output.to_owned()];
        }
        let table = !measure::is_record(&self.file, &self.column)?;
        let units = if table { self.complete()? } else { Vec::new() };
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
        // The campaign tells the scale factor of its instrument.
        let units_per_g = match (self.units_per_g(&units), &campaign, self.into.output()) {
            (Err(_), Some(campaign), Some(output)) if table => {
                campaign.units_per_g(&self.file, output)?
            }
            (found, ..) => found?,
        };
        let time = self.time.clone();
        let time = time.map(|name| Ok((name.clone(), self.per_second(&name)?)));
        let time = time.transpose()?;
        let request = Request {
            columns: Columns {
                outputs: self.column,
                time,
                temperature: self.temperature,
            },
            selection,
            run: self.run,
            calibration: Calibration {
                units_per_g,
                full_scale_g: self.full_scale,
                temperature_sensitivity_g_per_c: self.temperature_sensitivity,
            },
        };
        let mut measurement = measure::measure(&self.file, &request)?;
        if let Some(source) = self.into.motion(&self.file, units_per_g)? {
            let columns = &request.columns;
            match measure::coefficients(&self.file, columns, &measurement, &source)? {
                Ok(coefficients) => measurement.coefficients = Some(coefficients),
                Err(why) => measurement.notes.push(why),
            }
        }
        console.answer(text(&measurement), &measurement)?;
        if let Some(page) = &self.html {
            write_file(page, report::measurement_page(&measurement)?.as_bytes())?;
            console.print(format!("{}\n", page.display()))?;
        }
        if let Some(campaign) = campaign {
            let electrical = units
                .iter()
                .all(|unit| unit.or(self.unit).and_then(Unit::units_per_g).is_none());
            let told =
                campaign.append(&self.file, &self.into, &request, &measurement, electrical)?;
            console.print(told)?;
        }
        Ok(())
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
    if let Some(picture) = &found.picture {
        write_picture(&mut text, picture);
    }
    for plateau in &found.plateaus {
        write_plateau(&mut text, plateau);
    }
    for axis in &found.axes {
        write_axis(&mut text, axis);
    }
    if let Some(coefficients) = &found.coefficients {
        write_coefficients(&mut text, coefficients);
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
    for doubt in &axis.doubts {
        let weight = match (doubt.outcome, doubt.decisive) {
            (Outcome::Found, true) => "DOUBT",
            (Outcome::Found, false) => "doubt, too small",
            (Outcome::Clear, _) => "clear",
            (Outcome::NotLookedFor, _) => "not looked for",
        };
        let _ = writeln!(text, "  {weight}: {}: {}", doubt.kind.name(), doubt.finding);
    }
    let _ = writeln!(text, "  verdict: {}", in_words(axis));
}

fn in_words(axis: &Axis) -> String {
    let reasons: Vec<&str> = axis.reasons.iter().map(|kind| kind.name()).collect();
    let reasons = reasons.join(", ");
    match axis.verdict {
        Verdict::NoShift => "no-shift: none beyond the uncertainty".into(),
        Verdict::Shift => {
            "shift: the vibration explains it, and nothing else that was looked for".into()
        }
        Verdict::CannotTell => format!("cannot-tell: {reasons}"),
        Verdict::NotAttributable if reasons.is_empty() => {
            "not-attributable: the noise is unknown, see the notes".into()
        }
        Verdict::NotAttributable => format!("not-attributable: {reasons}"),
    }
}

/// Columns of the picture in a terminal.
const COLUMNS: usize = 72;

/// The strength of what shakes, in eighths of its logarithm, and what was taken of it.
fn write_picture(text: &mut String, picture: &Picture) {
    let by = picture.rms_g.len().div_ceil(COLUMNS).max(1);
    let loudest = |piece: &[f64]| piece.iter().copied().fold(0.0, f64::max);
    let columns: Vec<f64> = picture.rms_g.chunks(by).map(loudest).collect();
    let alive = || columns.iter().copied().filter(|rms| *rms > 0.0);
    let (low, high) = (
        alive().fold(f64::INFINITY, f64::min),
        alive().fold(0.0, f64::max),
    );
    let share = |rms: &f64| (rms.max(low) / low).ln() / (high / low).ln().max(1e-9);
    let [from, to] = picture.extent_s;
    let width = columns.len() as f64;
    let at = |column: usize| from + (to - from) * (column as f64 + 0.5) / width;
    let within = |list: &[[f64; 2]], time: f64| list.iter().any(|[a, b]| (*a..=*b).contains(&time));
    let mark = |column: usize| match at(column) {
        time if within(&picture.plateaus_s, time) => 'P',
        time if within(&picture.rests_s, time) => 'r',
        _ => ' ',
    };
    let line = sparkline(columns.iter().map(share));
    let marks: String = (0..columns.len()).map(mark).collect();
    let _ = writeln!(
        text,
        "\n{line}  rms {low:.3e} to {high:.3e} g, logarithmic\n{marks}  {from:.4} to {to:.4} s; P plateau, r rest"
    );
}

fn write_plateau(text: &mut String, plateau: &Plateau) {
    let motion = match (plateau.kind, plateau.frequency_hz, plateau.band_hz) {
        (MotionKind::Sine, Some(frequency), _) => {
            format!("sine of {:.4} g peak at {frequency:.4} Hz", plateau.level_g)
        }
        (_, _, Some([low, high])) => {
            format!(
                "random, {:.4} g rms, {low:.4} to {high:.4} Hz",
                plateau.level_g
            )
        }
        _ => format!("{:.4} g", plateau.level_g),
    };
    let _ = writeln!(
        text,
        "\nPLATEAU {:.3} to {:.3} s: {motion} on {}; against the rest {}",
        plateau.from_s, plateau.to_s, plateau.column, plateau.against
    );
    for axis in &plateau.axes {
        write_axis(text, axis);
    }
}

/// Coefficients from the waveform, and the test of their prediction.
fn write_coefficients(text: &mut String, found: &WaveformCoefficients) {
    let [least, most] = found.amplitudes_g;
    let _ = writeln!(
        text,
        "\nCOEFFICIENTS from {} blocks of {:.4} s, {least:.4} to {most:.4} g of {}\n  k2 {} /g   k3 {} /g^2   k4 {} /g^3",
        found.blocks,
        found.block_s,
        found.reference,
        found.k2_per_g,
        found.k3_per_g2,
        found.k4_per_g3,
    );
    if let Some(k2) = found.k2_of_means_alone_per_g {
        let _ = writeln!(
            text,
            "  k2 {k2} /g by the means alone, if k3 and k4 were zero"
        );
    }
    for response in &found.dynamics {
        let _ = writeln!(
            text,
            "  at {:.4} Hz: gain {}, phase {} deg",
            response.frequency_hz, response.gain, response.phase_deg
        );
    }
    for fit in &found.harmonics {
        let [in_phase, quadrature] = fit.residual_g;
        let _ = writeln!(
            text,
            "  harmonic {}: in phase {in_phase:.3e} g rms is left (unsteadiness {:.2}), in quadrature {quadrature:.3e} g ({:.2})",
            fit.order, fit.unsteadiness[0], fit.unsteadiness[1]
        );
    }
    for test in &found.tests {
        let mg = |quantity: Quantity| shown(quantity.scaled(1e3));
        let apart = test.sigmas_apart;
        let apart = apart.map_or("not comparable".into(), |z| {
            format!("{:.1} sigma apart", z.abs())
        });
        let [k2, k3, k4] = test.parts_g.map(mg);
        let measured = mg(test.measured_vre_g);
        let _ = writeln!(
            text,
            "  {:.3} to {:.3} s, {:.4} g: predicted by the harmonics alone {} mg, measured {measured} mg, {apart}\n    \
             of {measured} mg k2 makes {k2} mg, k3 {k3} mg, k4 {k4} mg{}",
            test.from_s,
            test.to_s,
            test.level_g,
            mg(test.predicted_vre_g),
            if test.mean_used {
                ""
            } else {
                "; the mean was not used, something else may have shifted it"
            },
        );
    }
    for assumption in &found.assumptions {
        let _ = writeln!(text, "  assumed: {assumption}");
    }
}
