//! Clocks: 168 MHz from the 8 MHz that the debugger supplies, or from the internal oscillator if it does not.
//!
//! The debugger's clock comes late or never when the board has power of its own. It is waited for so long and no longer;
//! then the board measures on its internal oscillator, and says so in every state message and block. If the clock stops
//! later, the clock security system tells (RM0090, 6.2.7), and the board starts again, on the internal oscillator.

use embassy_stm32::pac::{FLASH, RCC};
use embassy_stm32::time::Hertz;
use embassy_stm32::{Peripherals, rcc};
use shared::wire::board::TimeBase;

use crate::boards::external_clock;

/// How often it is looked whether the external clock has come. A look takes some ten cycles of the 16 MHz that the part
/// starts with: 0.3 s, far below what the watchdog waits.
const LOOKS: u32 = 500_000;

/// Starts the clocks and all that hangs on them.
pub fn start() -> (Peripherals, TimeBase) {
    let mut config = embassy_stm32::Config::default();
    let (prediv, time_base) = if external_clock::comes(LOOKS) {
        config.rcc.hse = Some(rcc::Hse {
            freq: Hertz(8_000_000),
            mode: rcc::HseMode::Bypass,
        });
        config.rcc.pll_src = rcc::PllSource::HSE;
        (rcc::PllPreDiv::DIV4, TimeBase::External)
    } else {
        config.rcc.pll_src = rcc::PllSource::HSI;
        (rcc::PllPreDiv::DIV8, TimeBase::Internal)
    };
    config.rcc.pll = Some(rcc::Pll {
        prediv,
        mul: rcc::PllMul::MUL168,
        divp: Some(rcc::PllPDiv::DIV2),
        divq: None,
        divr: None,
    });
    config.rcc.ahb_pre = rcc::AHBPrescaler::DIV1;
    config.rcc.apb1_pre = rcc::APBPrescaler::DIV4;
    config.rcc.apb2_pre = rcc::APBPrescaler::DIV2;
    config.rcc.sys = rcc::Sysclk::PLL1_P;
    let peripherals = embassy_stm32::init(config);
    // The HAL leaves them off, and each fetch of 128 bits would wait for the flash's five wait states (RM0090, 3.5.2).
    FLASH.acr().modify(|w| {
        w.set_icen(true);
        w.set_dcen(true);
        w.set_prften(true);
    });
    if time_base == TimeBase::External {
        RCC.cr().modify(|w| w.set_csson(true));
    }
    (peripherals, time_base)
}

/// True once the external clock has stopped; the part runs on its internal oscillator since, at 16 MHz.
pub fn is_lost() -> bool {
    RCC.cir().read().cssf()
}
