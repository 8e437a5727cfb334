#![doc = include_str!("../README.md")]
#![cfg_attr(not(test), no_std)]
#![forbid(unsafe_code)]
#![warn(missing_docs)]

pub mod asynchronous;
pub mod blocking;
mod clock;
mod error;
mod format;
pub mod frame;
pub mod registers;
mod settings;
mod status;
mod values;

pub use clock::{Oversampling, PowerMode};
pub use error::Error;
pub use format::{Format, Polynomial, WordLength};
pub use frame::{ChecksumError, Command, Response};
pub use registers::{ChannelCfg, DrdySource, Identification, Mode, Register};
pub use settings::{Channel, Settings, SettingsError};
pub use status::Status;
pub use values::{
    ChopDelay, CurrentDetect, DcBlock, DetectCount, DetectLength, EXTERNAL_REFERENCE_SHARE, Gain,
    GainCalibration, Input, Offset, OutOfRange, Phase, REFERENCE_V,
};
