//! The independent watchdog. It runs before anything else, on an oscillator of its own, and nothing stops it.

use embassy_stm32::pac::IWDG;

/// Keys (RM0090, 21.4.1).
const RELOAD: u32 = 0xAAAA;
const OPEN: u32 = 0x5555;
const START: u32 = 0xCCCC;

/// A 64th of the oscillator's 32 kHz nominal.
const PRESCALER: u32 = 4;

/// 2 s nominal; the oscillator's 17 to 47 kHz (DS9405, table 42) make 1.4 to 3.8 s of it. The longest that a task may take
/// for one step is erasing a sector, 0.8 s at the most (DS9405, table 48).
const COUNT: u32 = 1000;

/// Starts it.
pub fn start() {
    IWDG.kr().write(|w| w.0 = START);
    IWDG.kr().write(|w| w.0 = OPEN);
    IWDG.pr().write(|w| w.0 = PRESCALER);
    IWDG.rlr().write(|w| w.0 = COUNT);
    // Until both are taken over it counts from its longest, 0.5 s at the shortest prescaler.
    feed();
}

/// All is well.
pub fn feed() {
    IWDG.kr().write(|w| w.0 = RELOAD);
}
