//! What the board says of itself: why it started, what its clock is worth, what it feels.

use serde::{Deserialize, Serialize};

/// Bytes of a panic's file name that are kept: its end.
pub const FILE_NAME: usize = 32;

/// The board since it started; answers [`Command::Hello`](super::Command::Hello) and
/// [`Command::AskState`](super::Command::AskState) beside their own events.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct BoardState {
    /// Starts since the backup domain had no power, this one included.
    pub boots: u32,
    /// Why it started.
    pub cause: Cause,
    /// What its clock is worth.
    pub time_base: TimeBase,
    /// True when the option bytes hold the part in reset below 2.7 V, so that no flash is written on falling power.
    pub brown_out_guarded: bool,
    /// True while the pin forbids writing the memory.
    pub write_protected: bool,
    /// Temperature of the microcontroller, degrees Celsius.
    pub board_c: Option<f32>,
    /// Temperature of the instrument, degrees Celsius; `None` without a sensor.
    pub instrument_c: Option<f32>,
    /// Bytes of the stack that were never used since the board started.
    pub stack_free: Option<u32>,
    /// Errors of the serial line: overrun, framing, noise.
    pub line_errors: u32,
    /// Frames that the serial line did not take in time.
    pub line_timeouts: u32,
    /// Times that the converter was set up anew because its frames were wrong in a row.
    pub checksum_set_ups: u32,
    /// The last pulse of the vehicle's time.
    pub pulse: Option<Pulse>,
}

/// Why the board started.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum Cause {
    /// Power came on.
    #[default]
    Power,
    /// The reset pin.
    Pin,
    /// The supply was too low.
    BrownOut,
    /// A task made no step in time.
    Watchdog,
    /// Software asked for it.
    Software,
    /// A panic.
    Panic(Place),
    /// The processor met what it cannot carry out, at this address.
    HardFault {
        /// Address of the instruction.
        address: u32,
    },
    /// The external oscillator stopped.
    ClockLost,
}

/// Where the program panicked.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Place {
    /// Line of the source file.
    pub line: u32,
    /// End of the source file's name, filled up with zeros.
    pub file: [u8; FILE_NAME],
}

impl Place {
    /// The end of the file's name.
    pub fn file(&self) -> &str {
        let end = self.file.iter().position(|byte| *byte == 0);
        let name = self.file.get(..end.unwrap_or(FILE_NAME));
        name.and_then(|name| core::str::from_utf8(name).ok())
            .unwrap_or("?")
    }
}

/// What times are worth.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum TimeBase {
    /// The external oscillator.
    #[default]
    External,
    /// The internal oscillator, since the external one did not come or stopped: 1 % at room temperature.
    Internal,
}

/// An edge of the vehicle's pulse a second.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Pulse {
    /// Pulses since the board started.
    pub count: u32,
    /// When the last one came, on the instrument's clock, microseconds.
    pub time_us: u64,
}

/// Which time a block is for, and under what it was measured; follows the block's own event.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct BlockConditions {
    /// Index of the block's first sample.
    pub first_sample: u64,
    /// When the converter told of the first sample that the block has, on the instrument's clock, microseconds.
    pub first_us: u64,
    /// When it told of the last one.
    pub last_us: u64,
    /// How much older what a sample tells is: the delay of the converter's filter, microseconds. The block's mean is for
    /// the middle between first and last, less this.
    pub delay_us: f32,
    /// The last pulse of the vehicle's time before the block's end.
    pub pulse: Option<Pulse>,
    /// Temperature of the board, degrees Celsius.
    pub board_c: Option<f32>,
    /// Temperature of the instrument, degrees Celsius.
    pub instrument_c: Option<f32>,
    /// Standard uncertainty of the compensated specific force, stated errors included, g; `None` for a block that is not
    /// compensated or has no coefficients.
    pub sigma_g: Option<f32>,
}
