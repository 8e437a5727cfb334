//! Tables of an environment: breakpoints of a spectrum with sines, and the profile of a mission.

use std::path::Path;

use super::ranges;
use super::table::{Row, Table};
use crate::error::Error;

/// A breakpoint of the spectral densities.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Breakpoint {
    /// Frequency, Hz.
    pub f_hz: f64,
    /// One-sided densities, g^2/Hz: along one direction, or on IA, PA, OA; zero of an axis that stands still.
    pub density: Density,
    /// Real part of the coherence IA-PA, IA-OA, PA-OA, -1 to 1.
    pub coherence: [f64; 3],
}

/// Densities, g^2/Hz.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Density {
    /// Along one direction, greater than zero.
    Along(f64),
    /// On IA, PA, OA; greater than zero, or zero in all rows.
    Axes([f64; 3]),
}

/// Breakpoints, and sines of frequency (Hz) and peak (g) along one direction.
#[derive(Clone, Debug, PartialEq)]
pub struct SpectrumTable {
    /// In the order of frequency.
    pub breakpoints: Vec<Breakpoint>,
    /// In the order of the table.
    pub sines: Vec<[f64; 2]>,
}

/// A point of a mission's profile.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MissionPoint {
    /// Time, s.
    pub time_s: f64,
    /// Rms of the vibration then, all axes together, g.
    pub level_g: f64,
}

const ALONG: &str = "psd_g2_per_hz";
const AXES: [&str; 3] = ["psd_i_g2_per_hz", "psd_p_g2_per_hz", "psd_o_g2_per_hz"];
const COHERENCE: [&str; 3] = ["corr_ip", "corr_io", "corr_po"];
const SINE: &str = "sine_g";

/// Most sines at a time.
const MAX_SINES: usize = 32;

/// Reads the breakpoints of a spectrum, and its sines.
///
/// # Errors
/// The first thing wrong in the file, with row and column.
pub fn read_spectrum(file: &Path) -> Result<SpectrumTable, Error> {
    let mut table = Table::open(file, &["f_hz"], &[])?;
    let mut found = SpectrumTable {
        breakpoints: Vec::new(),
        sines: Vec::new(),
    };
    while let Some(row) = table.next_row()? {
        let f_hz = row.number("f_hz", &ranges::FREQUENCY)?;
        if let Some(peak_g) = row.optional(SINE, &ranges::LEVEL)? {
            if row.text(ALONG).is_some() || AXES.iter().any(|axis| row.text(axis).is_some()) {
                let problem = "stands in a row with a density; give the sine a row of its own";
                return Err(row.error(SINE, problem));
            }
            if found.sines.len() == MAX_SINES {
                let problem = format!("is one of more than {MAX_SINES} sines");
                return Err(row.error(SINE, problem));
            }
            found.sines.push([f_hz, peak_g]);
            continue;
        }
        let point = breakpoint(&row, f_hz)?;
        if let Some(last) = found.breakpoints.last() {
            if last.f_hz >= f_hz {
                let problem = format!("{f_hz} is not above {} of the breakpoint before", last.f_hz);
                return Err(row.error("f_hz", problem));
            }
            if !alike(&last.density, &point.density) {
                let problem = "this row has densities of other axes than the one before; fill the same columns in all rows";
                return Err(row.error("f_hz", problem));
            }
        }
        found.breakpoints.push(point);
    }
    if found.breakpoints.len() == 1 {
        let problem = "has one breakpoint; a spectrum has two at the least";
        return Err(Error::input(file, problem));
    }
    Ok(found)
}

/// Whether both have the same axes.
fn alike(one: &Density, other: &Density) -> bool {
    match (one, other) {
        (Density::Along(_), Density::Along(_)) => true,
        (Density::Axes(one), Density::Axes(other)) => {
            one.iter().zip(other).all(|(a, b)| (*a > 0.0) == (*b > 0.0))
        }
        _ => false,
    }
}

fn breakpoint(row: &Row<'_>, f_hz: f64) -> Result<Breakpoint, Error> {
    let along = row.optional(ALONG, &ranges::DENSITY)?;
    let mut axes = [0.0; 3];
    for (density, column) in axes.iter_mut().zip(AXES) {
        *density = row.optional(column, &ranges::DENSITY)?.unwrap_or(0.0);
    }
    let moving = axes.iter().any(|density| *density > 0.0);
    let density = match along {
        Some(_) if moving => {
            let problem = "stands beside densities by axis; give one or the other";
            return Err(row.error(ALONG, problem));
        }
        Some(along) => Density::Along(along),
        None if moving => Density::Axes(axes),
        None => {
            let problem = "is empty, and so are the densities by axis and sine_g";
            return Err(row.error(ALONG, problem));
        }
    };
    let mut coherence = [0.0; 3];
    for (value, column) in coherence.iter_mut().zip(COHERENCE) {
        *value = row.optional(column, &ranges::CORRELATION)?.unwrap_or(0.0);
    }
    let [ip, io, po] = coherence;
    if 1.0 + 2.0 * ip * io * po - ip * ip - io * io - po * po < -1e-6 {
        let problem = format!("{ip} with {io} and {po}: no motion has these three coherences");
        return Err(row.error(COHERENCE[0], problem));
    }
    Ok(Breakpoint {
        f_hz,
        density,
        coherence,
    })
}

/// Reads the profile of a mission.
///
/// # Errors
/// The first thing wrong in the file, with row and column.
pub fn read_mission(file: &Path) -> Result<Vec<MissionPoint>, Error> {
    let mut table = Table::open(file, &["time_s", "level_g"], &[])?;
    let mut points: Vec<MissionPoint> = Vec::new();
    while let Some(row) = table.next_row()? {
        let point = MissionPoint {
            time_s: row.number("time_s", &ranges::TIME)?,
            level_g: row.number("level_g", &ranges::MISSION_LEVEL)?,
        };
        if let Some(last) = points.last().filter(|last| last.time_s >= point.time_s) {
            let problem = format!(
                "{} is not after {} of the row before",
                point.time_s, last.time_s
            );
            return Err(row.error("time_s", problem));
        }
        points.push(point);
    }
    match points.len() {
        1 => Err(Error::input(
            file,
            "has one point; a mission has two at the least",
        )),
        _ => Ok(points),
    }
}
