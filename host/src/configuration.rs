//! What makes an instrument compensate, from coefficients that identification or a diagnosis found; and whose they are.

use std::fs;
use std::path::{Path, PathBuf};
use std::time::{SystemTime, UNIX_EPOCH};

use sha2::{Digest, Sha256};
use shared::compensate::{self, Mode, Source};
use shared::wire::configuration::{
    Calibration, Compensation, Configuration, Date, NAME, Name, Provenance,
};
use shared::wire::message;

use crate::campaign::{Campaign, table_file};
use crate::error::Error;
use crate::front_end::FrontEnd;

/// The head of a campaign.
const HEAD: &str = "campaign.toml";

/// Files of a campaign that its hash is of, in this order; one that is not there counts as empty.
///
/// # Errors
/// A table stands in two files.
pub fn hashed_files(folder: &Path) -> Result<[PathBuf; 3], Error> {
    let table = |stem| table_file(folder, stem);
    Ok([folder.join(HEAD), table("static")?, table("vibration")?])
}

const SECONDS_A_DAY: u64 = 86_400;

/// Whose coefficients a campaign's are: the instrument's serial number, today, the campaign's hash, and the temperatures of
/// its readings.
///
/// # Errors
/// [`Error::Input`] for a serial number that the instrument has no room for; [`Error::Read`].
pub fn provenance(folder: &Path, campaign: &Campaign) -> Result<Provenance, Error> {
    let serial = &campaign.config.instrument.serial;
    let serial = Name::new(serial).ok_or_else(|| {
        let line = format!(
            "instrument.serial {serial:?}: the instrument keeps 1 to {NAME} printable bytes"
        );
        Error::input(&folder.join(HEAD), line)
    })?;
    let mut hash = Sha256::new();
    for file in hashed_files(folder)? {
        let content = match file.exists() {
            true => fs::read(&file).map_err(Error::read(&file))?,
            false => Vec::new(),
        };
        // Its length first, so that no byte can move from one file to the next.
        hash.update((content.len() as u64).to_le_bytes());
        hash.update(&content);
    }
    let temperatures = campaign.readings.iter().map(|reading| reading.temp_c);
    let range = temperatures.fold(None, |range: Option<[f64; 2]>, t| {
        Some(range.map_or([t, t], |[low, high]| [low.min(t), high.max(t)]))
    });
    Ok(Provenance {
        serial,
        date: today(),
        campaign: hash.finalize().into(),
        temperature_c: range.map(|range| range.map(|t| t as f32)),
        accepted_by: None,
    })
}

/// The day in Greenwich.
fn today() -> Date {
    let since = SystemTime::now().duration_since(UNIX_EPOCH);
    date(since.map_or(0, |since| since.as_secs() / SECONDS_A_DAY))
}

/// The day that is so many after 1 January 1970, in the Gregorian calendar, whose cycle of 400 years is counted from
/// 1 March of the year 0.
fn date(days: u64) -> Date {
    let days = days + 719_468;
    let (era, day) = (days / 146_097, days % 146_097);
    let year = (day - day / 1460 + day / 36_524 - day / 146_096) / 365;
    let day = day - (365 * year + year / 4 - year / 100);
    // Months from March on: 153 days are five of them.
    let month = (5 * day + 2) / 153;
    let day = day - (153 * month + 2) / 5 + 1;
    let (month, next) = match month {
        0..10 => (month + 3, 0),
        _ => (month - 9, 1),
    };
    Date {
        year: (400 * era + year + next) as u16,
        month: month as u8,
        day: day as u8,
    }
}

/// Compensation with these coefficients, in blocks of that many conversions. The instrument counts in volts at the
/// converter, so that K1 (V/g at its output) is taken through the front end. `reference_v_per_g` is the reference's scale
/// at the converter; its zero is taken as 0 V.
/// What cannot be, as K1 <= 0, the instrument refuses.
pub fn configuration(
    known: &compensate::Calibration<f64>,
    front_end: &FrontEnd,
    reference_v_per_g: f64,
    mode: Mode,
    source: Source,
    block_samples: u16,
) -> Configuration {
    let mut nominal = known.coefficients.to_nominal();
    nominal[0] = front_end.converter_v(nominal[0]);
    Configuration {
        compensation: Compensation {
            mode: Some(mode),
            source,
            block_samples,
            nominal_v_per_g: nominal[0] as f32,
            reference_v_per_g: [reference_v_per_g as f32; 3],
            reference_zero_v: [0.0; 3],
        },
        calibration: Some(Calibration {
            coefficients: message::Coefficients {
                nominal,
                further: known.coefficients.to_further(),
            },
            covariance: known.covariance.narrow(),
            rank: known.rank,
        }),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn days_are_those_of_the_calendar() {
        let ymd = |days| {
            let Date { year, month, day } = date(days);
            (year, month, day)
        };
        assert_eq!(ymd(0), (1970, 1, 1));
        assert_eq!(ymd(59), (1970, 3, 1));
        // From `date -d @SECONDS`.
        assert_eq!(ymd(11_016), (2000, 2, 29));
        assert_eq!(ymd(20_453), (2025, 12, 31));
        assert_eq!(ymd(47_541), (2100, 3, 1));
    }
}
