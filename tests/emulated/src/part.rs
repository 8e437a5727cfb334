//! The microcontrollers of the boards, behind what the boards' models ask of them.

use std::num::{NonZeroU32, NonZeroU64};
use std::ops::Range;

use rigless::device::{DeviceContext, Level, RegisterFile};
use rigless::machine::{Target, armv7m};
use rigless::mcu::Mcu;
use rigless::soc::Error;
use rigless::soc::stm32f427::Stm32f427;
use rigless::soc::stm32f427::peripherals::spi as spi_f427;
use rigless::soc::stm32f427::peripherals::tim as tim_f427;
use rigless::soc::stm32h743::Stm32h743;
use rigless::soc::stm32h743::peripherals::gpio::Pin;
use rigless::soc::stm32h743::peripherals::spi as spi_h743;
use rigless::soc::stm32h743::peripherals::tim as tim_h743;
use rigless::soc::{stm32f427, stm32h743};
use rigless::time::VirtualNanos;

use crate::board::Shared;
use crate::converter::{Bus, Converter};
use crate::line::{HostEnd, Line};

/// The boards that there is an image for.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub enum Model {
    /// NUCLEO-F429ZI.
    #[default]
    F429,
    /// NUCLEO-H743ZI2.
    H743,
}

impl Model {
    /// Both.
    pub const ALL: [Self; 2] = [Self::F429, Self::H743];

    /// Its name, which is the image's feature too.
    pub const fn name(self) -> &'static str {
        match self {
            Self::F429 => "nucleo-f429zi",
            Self::H743 => "nucleo-h743zi2",
        }
    }

    /// Clock of its core, Hz.
    pub const fn core_hz(self) -> u64 {
        match self {
            Self::F429 => 168_000_000,
            Self::H743 => 400_000_000,
        }
    }

    /// Where the instrument's memory begins: bank 2 of the flash (RM0090, table 6), or its last two sectors (RM0433, table
    /// 15).
    pub(crate) const fn memory(self) -> u64 {
        match self {
            Self::F429 => 0x0810_0000,
            Self::H743 => 0x081C_0000,
        }
    }

    /// The RAM of its `board.x`: static variables from the beginning, the stack from the end.
    pub(crate) const fn stack(self) -> Range<u64> {
        match self {
            Self::F429 => 0x2000_0000..0x2003_0000,
            Self::H743 => 0x2000_0000..0x2002_0000,
        }
    }

    /// Registers of port E, where SYNC/RESET is driven, and of SPI4, whose accesses move DRDY.
    pub(crate) const fn watched(self) -> [Range<u64>; 2] {
        match self {
            Self::F429 => [0x4002_1000..0x4002_1400, 0x4001_3400..0x4001_3800],
            Self::H743 => [0x5802_1000..0x5802_1400, 0x4001_3400..0x4001_3800],
        }
    }
}

/// The external clock, on the high-speed oscillator's pin.
const HSE_HZ: u64 = 8_000_000;
const SUPPLY_MV: u32 = 3300;

const GPIOE: &str = "GPIOE";
const SPI4: usize = 3;
const USART3: usize = 2;

/// TIM2, and the timer that counts its pulses: TIM5 by its internal trigger 0, or TIM3 by its 1.
const TIM2: usize = 0;
const TIM5: usize = 3;
const TIM3: usize = 1;

/// A microcontroller.
#[derive(Debug)]
pub enum Part {
    /// STM32F427, in place of the STM32F429: the two differ by the display controller.
    F427(Box<Stm32f427>),
    /// STM32H743.
    H743(Box<Stm32h743>),
}

impl Part {
    /// Powered, with the converter at SPI4 behind that pin of port E and the host's end of the line at USART3.
    pub fn new(
        model: Model,
        converter: Shared<dyn Converter>,
        select: Pin,
        line: Shared<Line>,
    ) -> Result<Self, Error> {
        let (port, pin, active) = (GPIOE, select, Level::Low);
        match model {
            Model::F429 => {
                let mut mcu = Box::new(Stm32f427::new()?);
                mcu.rcc.attach_crystals(HSE_HZ, 0);
                mcu.set_supply(SUPPLY_MV);
                let select = spi_f427::Select { port, pin, active };
                mcu.spi[SPI4].attach_selected(Bus::new(converter), select);
                mcu.usart[USART3].attach(HostEnd::new(line));
                Ok(Self::F427(mcu))
            }
            Model::H743 => {
                let mut mcu = Box::new(Stm32h743::new()?);
                mcu.rcc.attach_crystals(HSE_HZ, 0);
                mcu.set_supply(SUPPLY_MV);
                mcu.set_analog_supply(SUPPLY_MV);
                let select = spi_h743::Select { port, pin, active };
                mcu.spi[SPI4].attach_selected(Bus::new(converter), select);
                mcu.usart[USART3].attach(HostEnd::new(line));
                for adc in &mut mcu.adc {
                    adc.set_reference(SUPPLY_MV);
                }
                Ok(Self::H743(mcu))
            }
        }
    }

    /// As the emulator sees it.
    pub fn mcu(&mut self) -> &mut dyn Mcu {
        match self {
            Self::F427(mcu) => mcu.as_mut(),
            Self::H743(mcu) => mcu.as_mut(),
        }
    }

    /// The external clock is not ready.
    pub fn without_clock(&mut self) {
        match self {
            Self::F427(mcu) => {
                use stm32f427::generated::rcc::{Register, cr};
                let (_, registers) = mcu.clocks();
                let control = registers.get(Register::Cr);
                registers.set(Register::Cr, cr::HSERDY.set(control, 0));
            }
            Self::H743(mcu) => {
                use stm32h743::generated::rcc::{Register, cr};
                let (_, registers) = mcu.clocks();
                let control = registers.get(Register::Cr);
                registers.set(Register::Cr, cr::HSERDY.set(control, 0));
            }
        }
    }

    /// The external clock fails.
    pub fn fail_clock(&mut self, at: VirtualNanos) {
        match self {
            Self::F427(mcu) => mcu.drive_clocks(at, |clocks, registers, context| {
                clocks.fail_hse(registers, context);
            }),
            Self::H743(mcu) => {
                let mut clocks =
                    std::mem::replace(&mut mcu.rcc, stm32h743::peripherals::rcc::Rcc::new());
                with_slot(mcu, at, "RCC", |registers, context| {
                    clocks.fail_hse(registers, context);
                });
                mcu.rcc = clocks;
            }
        }
    }

    /// Drives a pin, or lets it go.
    pub fn drive_pin(&mut self, at: VirtualNanos, port: usize, pin: Pin, level: Option<Level>) {
        match self {
            Self::F427(mcu) => mcu.drive_port(at, port, |gpio, registers, context| {
                gpio.drive(pin, level, registers, context);
            }),
            Self::H743(mcu) => mcu.drive_port(at, port, |gpio, registers, context| {
                gpio.drive(pin, level, registers, context);
            }),
        }
    }

    /// The level of a pin.
    pub fn pin(&mut self, port: usize, pin: Pin) -> Level {
        match self {
            Self::F427(mcu) => {
                let (gpio, registers) = mcu.port(port);
                gpio.level(pin, registers)
            }
            Self::H743(mcu) => {
                // A model has no more to say of a pin than its registers.
                let slot = mcu.bus().slot_of(GPIOE).unwrap_or_default();
                let registers = mcu.bus().slots()[slot].registers();
                mcu.gpio[port].level(pin, registers)
            }
        }
    }

    /// Drives an input of TIM2; how many trigger pulses it has sent.
    pub fn drive_timer(&mut self, at: VirtualNanos, channel: u8, level: Level) -> u64 {
        match self {
            Self::F427(mcu) => {
                let Some(channel) = tim_f427::Channel::new(channel) else {
                    return 0;
                };
                mcu.drive_timer(at, TIM2, |timer, registers, context| {
                    timer.drive_input(channel, level, registers, context);
                    timer.trigger_output().1
                })
            }
            Self::H743(mcu) => {
                let Some(channel) = tim_h743::Channel::new(channel) else {
                    return 0;
                };
                with_timer(mcu, at, TIM2, |timer, registers, context| {
                    timer.drive_input(channel, level, registers, context);
                    timer.trigger_output().1
                })
            }
        }
    }

    /// A trigger pulse of TIM2 comes to the timer that counts: the emulator does not wire the part's internal triggers.
    pub fn count(&mut self, at: VirtualNanos) {
        match self {
            Self::F427(mcu) => mcu.drive_timer(at, TIM5, |timer, registers, context| {
                timer.drive_internal_trigger(0, Level::High, registers, context);
                timer.drive_internal_trigger(0, Level::Low, registers, context);
            }),
            Self::H743(mcu) => with_timer(mcu, at, TIM3, |timer, registers, context| {
                timer.drive_internal_trigger(1, Level::High, registers, context);
                timer.drive_internal_trigger(1, Level::Low, registers, context);
            }),
        }
    }

    /// The emulator's target of that name: the core as the part has it.
    pub fn target(&mut self, name: &'static str, instructions: NonZeroU64) -> Target<'_> {
        let model = match self {
            Self::F427(_) => Model::F429,
            Self::H743(_) => Model::H743,
        };
        let cpu = self.mcu().bus().cpu().interrupt_lines;
        let core = armv7m::Core {
            variant: match model {
                Model::F429 => armv7m::Variant::M4,
                Model::H743 => armv7m::Variant::M7,
            },
            clock_hz: NonZeroU64::new(model.core_hz()).expect("not zero"),
            interrupt_lines: NonZeroU32::new(u32::from(cpu)).expect("the part has interrupts"),
            priority_bits: 4,
            refclk_divider: NonZeroU32::new(8).expect("not zero"),
            instructions_per_second: instructions,
            boot: "flash",
        };
        let windows = rigless::cpu::armv7m::windows(self.mcu().bus());
        let mut config = armv7m::Config::new(core, &windows);
        match model {
            Model::F429 => config.fpu = armv7m::Fpu::FpV4Sp,
            Model::H743 => h743(&mut config),
        }
        Target::new(name, self.mcu(), config.spec())
    }
}

/// What the STM32H743's core has beyond a plain one (PM0253, tables 77 and 81; DS12110, 3.1): double precision, sixteen regions
/// of memory protection, two caches of 16 KiB. It starts at the flash.
fn h743(config: &mut armv7m::Config) {
    config.fpu = armv7m::Fpu::FpV5Dp;
    config.mpu_regions = armv7m::MpuRegions::Sixteen;
    config.cpuid = 0x411F_C271;
    config.caches = Some(armv7m::Caches {
        clidr: 0x0900_0003,
        ctr: 0x8303_C003,
        ccsidr: &[0xF00F_E019, 0xF01F_E009],
    });
    config.branch_prediction = armv7m::BranchPrediction::Always;
    config.vector_table = Some(0x0800_0000);
}

/// Gives a model's registers as on an access of the bus; the caller holds the model.
fn with_slot<T>(
    mcu: &mut Stm32h743,
    at: VirtualNanos,
    instance: &'static str,
    what: impl FnOnce(&mut RegisterFile, &mut DeviceContext<'_>) -> T,
) -> T {
    let slot = mcu.bus().slot_of(instance).unwrap_or_default();
    let (registers, mut context) = mcu.bus_mut().drive(at, slot);
    what(registers, &mut context)
}

/// Drives a general-purpose timer, which the part itself gives to look at only.
fn with_timer<T>(
    mcu: &mut Stm32h743,
    at: VirtualNanos,
    nth: usize,
    what: impl FnOnce(
        &mut tim_h743::Tim<tim_h743::General>,
        &mut RegisterFile,
        &mut DeviceContext<'_>,
    ) -> T,
) -> T {
    let instance = tim_h743::TIMERS[nth];
    let mut timer = std::mem::replace(&mut mcu.tim[nth], tim_h743::Tim::new(instance));
    let result = with_slot(mcu, at, instance.instance, |registers, context| {
        what(&mut timer, registers, context)
    });
    mcu.tim[nth] = timer;
    result
}
