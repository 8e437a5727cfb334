//! The clock that comes from outside, or does not.

use embassy_stm32::pac::RCC;

/// True if the external clock comes while it is looked for so many times; it is switched off again if not.
pub fn comes(looks: u32) -> bool {
    RCC.cr().modify(|w| w.set_hsebyp(true));
    RCC.cr().modify(|w| w.set_hseon(true));
    let comes = (0..looks).any(|_| RCC.cr().read().hserdy());
    if !comes {
        RCC.cr().modify(|w| w.set_hseon(false));
    }
    comes
}
