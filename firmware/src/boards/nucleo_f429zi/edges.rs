//! TIM5 counts the pulses of TIM2, 32 bits.

use embassy_stm32::pac;
use embassy_stm32::peripherals::TIM5;
use embassy_stm32::timer::low_level::TriggerSource;

/// The timer that counts.
pub type Counter = TIM5;

/// Internal trigger 0 of TIM5 is the output of TIM2 (RM0090, table 98).
pub const TRIGGER: TriggerSource = TriggerSource::ITR0;

/// Edges until now, modulo 2^32.
#[inline]
pub fn count() -> u32 {
    pac::TIM5.cnt().read()
}
