//! The independent watchdog. It runs before anything else, on an oscillator of its own, and nothing stops it.

use crate::boards::board::{WATCHDOG, WATCHDOG_TICKS};

/// Keys (RM0090, 21.4.1; RM0433, 45.4.1).
const RELOAD: u32 = 0xAAAA;
const OPEN: u32 = 0x5555;
const START: u32 = 0xCCCC;

/// A 64th of the oscillator's 32 kHz nominal: ticks of 2 ms.
const PRESCALER: u32 = 4;

/// Starts it.
pub fn start() {
    WATCHDOG.kr().write(|w| w.0 = START);
    WATCHDOG.kr().write(|w| w.0 = OPEN);
    WATCHDOG.pr().write(|w| w.0 = PRESCALER);
    WATCHDOG.rlr().write(|w| w.0 = WATCHDOG_TICKS);
    // Until both are taken over it counts from its longest, 0.5 s at the shortest prescaler.
    feed();
}

/// All is well.
pub fn feed() {
    WATCHDOG.kr().write(|w| w.0 = RELOAD);
}
