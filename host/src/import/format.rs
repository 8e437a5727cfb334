//! Which program wrote a file of channels, told by how it begins.

use std::path::Path;

use super::channels::{Channels, Wanted};
use crate::error::Error;

/// Formats of channels.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Format {
    /// RIFF WAVE: sound cards and vibration loggers.
    Wav,
    /// Apache Parquet.
    Parquet,
    /// MATLAB's level 5.
    Mat,
    /// HDF5, which MATLAB's 7.3 is too.
    Hdf5,
    /// Universal file, data set 58 as text or binary.
    Uff,
    /// LabVIEW's TDMS.
    Tdms,
    /// PX4's ULog.
    ULog,
    /// ArduPilot's DataFlash.
    DataFlash,
    /// MCAP, of robots.
    Mcap,
}

impl Format {
    /// The format of a file that begins with `head`, some hundred bytes.
    pub fn of(head: &[u8]) -> Option<Self> {
        let at = |place: usize, text: &[u8]| {
            head.get(place..).is_some_and(|rest| rest.starts_with(text))
        };
        let hdf5 = b"\x89HDF\r\n\x1a\n";
        Some(match () {
            () if at(0, b"RIFF") && at(8, b"WAVE") => Self::Wav,
            () if at(0, b"PAR1") => Self::Parquet,
            () if [0, 512].iter().any(|&place| at(place, hdf5)) => Self::Hdf5,
            () if at(0, b"MATLAB 5.0") => Self::Mat,
            () if is_uff(head) => Self::Uff,
            () if at(0, b"TDSm") => Self::Tdms,
            () if at(0, b"ULog\x01\x12\x35") => Self::ULog,
            () if at(0, &[0xa3, 0x95, 0x80]) => Self::DataFlash,
            () if at(0, b"\x89MCAP0\r\n") => Self::Mcap,
            () => return None,
        })
    }

    /// By the end of a file's name, where it is told apart from others by that.
    fn of_name(file: &Path) -> Option<Self> {
        let extension = file.extension()?.to_str()?.to_lowercase();
        Some(match extension.as_str() {
            "wav" => Self::Wav,
            "parquet" => Self::Parquet,
            "mat" => Self::Mat,
            "h5" | "hdf5" => Self::Hdf5,
            "uff" | "unv" => Self::Uff,
            "tdms" => Self::Tdms,
            "ulg" => Self::ULog,
            "mcap" => Self::Mcap,
            _ => return None,
        })
    }

    /// What it is called.
    pub fn name(self) -> &'static str {
        match self {
            Self::Wav => "WAV",
            Self::Parquet => "Parquet",
            Self::Mat => "MATLAB 5",
            Self::Hdf5 => "HDF5",
            Self::Uff => "UFF 58",
            Self::Tdms => "TDMS",
            Self::ULog => "ULog",
            Self::DataFlash => "DataFlash",
            Self::Mcap => "MCAP",
        }
    }

    /// Opens a file of this format.
    ///
    /// # Errors
    /// Unreadable, damaged, or without a channel.
    pub fn open(self, file: &Path, wanted: Wanted<'_>) -> Result<Channels, Error> {
        match self {
            Self::Wav => super::wav::open(file, wanted),
            #[cfg(feature = "parquet")]
            Self::Parquet => super::parquet::open(file, wanted),
            Self::Mat => super::mat::open(file, wanted),
            #[cfg(feature = "hdf5")]
            Self::Hdf5 => super::hdf5::open(file, wanted),
            Self::Uff => super::uff::open(file, wanted),
            Self::Tdms => super::tdms::open(file, wanted),
            Self::ULog => super::ulog::open(file, wanted),
            Self::DataFlash => super::dataflash::open(file, wanted),
            #[cfg(feature = "mcap")]
            Self::Mcap => super::mcap::open(file, wanted),
            #[cfg(not(all(feature = "parquet", feature = "hdf5", feature = "mcap")))]
            _ => {
                let problem = format!("is {}, which this vre was built without", self.name());
                Err(Error::input(file, problem))
            }
        }
    }
}

/// A file that is named as one of a format and does not begin so.
///
/// # Errors
/// It is one.
pub(super) fn check_name(file: &Path) -> Result<(), Error> {
    match Format::of_name(file) {
        Some(format) => {
            let problem = format!("does not begin as a {} file does", format.name());
            Err(Error::input(file, problem))
        }
        None => Ok(()),
    }
}

/// A universal file begins with a line of -1 and the number of a data set.
fn is_uff(head: &[u8]) -> bool {
    let text = String::from_utf8_lossy(head);
    let mut lines = text.lines().map(str::trim).filter(|line| !line.is_empty());
    let number = |line: &str| {
        let word = line.split_whitespace().next().unwrap_or_default();
        word.trim_end_matches('b').parse::<u32>().is_ok()
    };
    lines.next() == Some("-1") && lines.next().is_some_and(number)
}
