//! What can go wrong.

use core::fmt;

use crate::frame::ChecksumError;
use crate::registers::Register;
use crate::settings::SettingsError;
use crate::status::Status;

/// What the converter or the way to it does wrong; `E` is the bus's own error.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub enum Error<E> {
    /// The bus reported an error.
    Bus(E),
    /// A frame from the converter has a wrong checksum.
    Checksum(ChecksumError),
    /// The register ID is not that of a converter with so many channels.
    Identification {
        /// As read.
        read: u16,
    },
    /// A command was not acknowledged.
    Answer {
        /// The answer that it asks for.
        expected: u16,
        /// The answer as read.
        read: u16,
    },
    /// A register does not hold what was written.
    Register {
        /// Which.
        register: Register,
        /// What was written.
        written: u16,
        /// What was read.
        read: u16,
    },
    /// The status is not that of a converter that was just set up.
    Status(Status),
    /// The converter does not take these settings; nothing was sent.
    Settings(SettingsError),
}

impl<E> Error<E> {
    /// The same with another error of the bus.
    pub fn map_bus<F>(self, map: impl FnOnce(E) -> F) -> Error<F> {
        match self {
            Self::Bus(error) => Error::Bus(map(error)),
            Self::Checksum(error) => Error::Checksum(error),
            Self::Identification { read } => Error::Identification { read },
            Self::Answer { expected, read } => Error::Answer { expected, read },
            Self::Register {
                register,
                written,
                read,
            } => Error::Register {
                register,
                written,
                read,
            },
            Self::Status(status) => Error::Status(status),
            Self::Settings(error) => Error::Settings(error),
        }
    }
}

impl<E> From<ChecksumError> for Error<E> {
    fn from(error: ChecksumError) -> Self {
        Self::Checksum(error)
    }
}

impl<E> From<SettingsError> for Error<E> {
    fn from(error: SettingsError) -> Self {
        Self::Settings(error)
    }
}

impl<E: fmt::Debug> fmt::Display for Error<E> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            // Errors of embedded-hal need not be printable otherwise.
            Self::Bus(error) => write!(f, "bus: {error:?}"),
            Self::Checksum(error) => write!(f, "frame from the converter: {error}"),
            Self::Identification { read } => write!(f, "not this converter: ID is {read:#06x}"),
            Self::Answer { expected, read } => {
                write!(f, "answer {read:#06x}, expected {expected:#06x}")
            }
            Self::Register {
                register,
                written,
                read,
            } => write!(f, "{register} holds {read:#06x}, written {written:#06x}"),
            Self::Status(status) => write!(f, "status {:#06x}", status.0),
            Self::Settings(error) => error.fmt(f),
        }
    }
}

impl<E: fmt::Debug> core::error::Error for Error<E> {}
