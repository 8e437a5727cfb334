//! Clocks: 400 MHz from the 8 MHz that the debugger supplies, or from the internal oscillator if it does not. SPI4, USART3
//! and the timers get 100, 100 and 200 MHz, of which 12.5 MHz, 1 Mbaud and 1 MHz are whole parts.
//!
//! The debugger's clock comes late or never when the board has power of its own. It is waited for so long and no longer;
//! then the board measures on its internal oscillator, and says so in every state message and block. If the clock stops
//! later, the clock security system tells (RM0433, 8.5.3), and the board starts again, on the internal oscillator.

use embassy_stm32::Peripherals;
use embassy_stm32::pac::RCC;
use embassy_stm32::rcc::{self, PllDiv, PllMul, PllPreDiv, PllSource, mux};
use embassy_stm32::time::Hertz;
use shared::wire::board::TimeBase;

use crate::boards::external_clock;

/// How often it is looked whether the external clock has come. A look takes some twenty cycles of the 64 MHz that the part
/// starts with: 0.3 s, far below what the watchdog waits.
const LOOKS: u32 = 1_000_000;

/// Starts the clocks and all that hangs on them.
pub fn start() -> (Peripherals, TimeBase) {
    let mut config = embassy_stm32::Config::default();
    let (source, prediv, time_base) = if external_clock::comes(LOOKS) {
        config.rcc.hse = Some(rcc::Hse {
            freq: Hertz(8_000_000),
            mode: rcc::HseMode::Bypass,
        });
        (PllSource::HSE, PllPreDiv::DIV1, TimeBase::External)
    } else {
        (PllSource::HSI, PllPreDiv::DIV8, TimeBase::Internal)
    };
    config.rcc.hsi48 = None;
    config.rcc.pll1 = Some(rcc::Pll {
        source,
        prediv,
        mul: PllMul::MUL100,
        fracn: None,
        divp: Some(PllDiv::DIV2),
        divq: None,
        divr: None,
    });
    config.rcc.sys = rcc::Sysclk::PLL1_P;
    config.rcc.ahb_pre = rcc::AHBPrescaler::DIV2;
    config.rcc.apb1_pre = rcc::APBPrescaler::DIV2;
    config.rcc.apb2_pre = rcc::APBPrescaler::DIV2;
    config.rcc.apb3_pre = rcc::APBPrescaler::DIV2;
    config.rcc.apb4_pre = rcc::APBPrescaler::DIV2;
    config.rcc.voltage_scale = rcc::VoltageScale::Scale1;
    // The converter of the thermometer, by the internal oscillator.
    config.rcc.mux.adcsel = mux::Adcsel::PER;
    let peripherals = embassy_stm32::init(config);
    if time_base == TimeBase::External {
        RCC.cr().modify(|w| w.set_hsecsson(true));
    }
    (peripherals, time_base)
}

/// True once the external clock has stopped; the part runs on its internal oscillator since, at 64 MHz.
pub fn is_lost() -> bool {
    RCC.cifr().read().hsecssf()
}
