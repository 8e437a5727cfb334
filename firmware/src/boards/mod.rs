//! The boards: each in a folder of its own, behind the same gates.
//!
//! | gate | what goes through it |
//! |---|---|
//! | [`FrameBus`](firmware::adc::bus::FrameBus) | frames to the converter and back |
//! | [`Timers`](firmware::adc::count::Timers) | DRDY's edges, counted and stamped |
//! | `NorFlash` of embedded-storage-async | the configuration |
//! | `Read` of embedded-io and `Write` of embedded-io-async | the link to the host |
//!
//! A board's `start` gives the parts behind these gates, and what it knows of its start: clock, cause, supply.

use embassy_stm32::gpio::{Input, Output};
use firmware::sampler::Around;
use shared::wire::board::TimeBase;

pub mod conveyor;
pub mod drdy;
pub mod external_clock;
pub mod receiver;
pub mod temperature;

#[cfg(feature = "nucleo-f429zi")]
#[path = "nucleo_f429zi/mod.rs"]
pub mod board;

#[cfg(feature = "nucleo-h743zi2")]
#[path = "nucleo_h743zi2/mod.rs"]
pub mod board;

/// A board that has started, but for its memory.
pub struct Parts {
    /// The converter's bus.
    pub bus: conveyor::Bus,
    /// The converter's pin SYNC/RESET.
    pub reset: Output<'static>,
    /// What comes from the host.
    pub receiver: receiver::Receiver,
    /// What goes to the host.
    pub sender: board::Sender,
    /// Low: the memory must not be written.
    pub protect: Input<'static>,
    /// Temperatures.
    pub thermometer: board::Thermometer,
    /// What the clock is worth.
    pub time_base: TimeBase,
    /// The option bytes hold the part in reset while the supply is below 2.7 V.
    pub brown_out_guarded: bool,
}

/// What a board measures of its surroundings.
pub trait Surroundings {
    /// Temperatures now, and whether the clock can be trusted.
    fn measure(&mut self) -> Around;
}

/// What ended the last run, as the part's reset flags say.
#[derive(Clone, Copy, Debug, Default)]
pub struct ResetFlags {
    /// The independent watchdog.
    pub watchdog: bool,
    /// Software.
    pub software: bool,
    /// Power came on.
    pub power: bool,
    /// The supply was too low.
    pub brown_out: bool,
}
