//! TIM3 counts the pulses of TIM2: 16 bits, which software makes 32 of.

use core::sync::atomic::{AtomicU32, Ordering};

use embassy_stm32::pac;
use embassy_stm32::peripherals::TIM3;
use embassy_stm32::timer::low_level::TriggerSource;

/// The timer that counts.
pub type Counter = TIM3;

/// Internal trigger 1 of TIM3 is the output of TIM2 (RM0433, table 341).
pub const TRIGGER: TriggerSource = TriggerSource::ITR1;

/// The count when it was looked at last.
static LAST: AtomicU32 = AtomicU32::new(0);

/// Edges until now, modulo 2^32, as long as it is looked at once in 65 535 of them: 2 s at 32 kSPS.
#[inline]
pub fn count() -> u32 {
    // Read before the counter, so that the counter is never behind it, whoever interrupts.
    let last = LAST.load(Ordering::Relaxed);
    let passed = pac::TIM3.cnt().read().cnt().wrapping_sub(last as u16);
    let count = last.wrapping_add(u32::from(passed));
    LAST.store(count, Ordering::Relaxed);
    count
}
