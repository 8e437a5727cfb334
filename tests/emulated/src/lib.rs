//! The unmodified image in an emulated STM32F427 or STM32H743, with the converter on its SPI bus and a host on its serial line.
//!
//! Time is virtual: [`Emulator::run_for`] lets the firmware run for so long and returns, so that a test reads like
//! a host that takes its time, and gives the same result each time.

pub mod board;
pub mod converter;
pub mod cost;
pub mod faults;
pub mod host;
pub mod image;
pub mod line;
pub mod part;
pub mod random;
mod run;

pub use host::{Conversation, Heard};
pub use part::Model;
pub use run::{Emulator, Error};
