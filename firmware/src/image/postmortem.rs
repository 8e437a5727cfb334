//! What ended the last run: the reset flags, and what was kept in the backup registers of the RTC, which a reset does not
//! clear: the place of a panic, the address of a fault, and how often the board started.

use core::panic::PanicInfo;

use cortex_m_rt::{ExceptionFrame, exception};
use embassy_stm32::pac;
use shared::wire::board::{Cause, FILE_NAME, Place};

use crate::boards::{ResetFlags, board};

/// What backup register 0 holds of a kept cause.
const PANIC: u32 = 0x504E_4943;
const FAULT: u32 = 0x4841_5244;
const CLOCK: u32 = 0x434C_434B;

/// Registers: the kind of cause, its line or address, the end of the file's name, and the count of starts.
const KIND: usize = 0;
const VALUE: usize = 1;
const NAME: core::ops::Range<usize> = 2..2 + FILE_NAME / 4;
const BOOTS: usize = 12;

fn get(n: usize) -> u32 {
    pac::RTC.bkpr(n).read().bkp()
}

fn set(n: usize, value: u32) {
    pac::RTC.bkpr(n).write(|w| w.set_bkp(value));
}

/// Takes what is known of the last run, and counts this one. The backup domain has to be writable.
pub fn take() -> (Cause, u32) {
    let boots = get(BOOTS).saturating_add(1);
    set(BOOTS, boots);
    let flags = board::take_reset_flags();
    let kind = get(KIND);
    set(KIND, 0);
    let cause = match kind {
        PANIC => {
            let mut file = [0; FILE_NAME];
            let (words, _) = file.as_chunks_mut::<4>();
            for (word, n) in words.iter_mut().zip(NAME) {
                *word = get(n).to_le_bytes();
            }
            let line = get(VALUE);
            Cause::Panic(Place { line, file })
        }
        FAULT => {
            let address = get(VALUE);
            Cause::HardFault { address }
        }
        CLOCK => Cause::ClockLost,
        _ => cause(flags),
    };
    tell(&cause, boots);
    (cause, boots)
}

fn cause(flags: ResetFlags) -> Cause {
    if flags.power {
        Cause::Power
    } else if flags.watchdog {
        Cause::Watchdog
    } else if flags.software {
        Cause::Software
    } else if flags.brown_out {
        Cause::BrownOut
    } else {
        // What ever it is, the pin has seen it.
        Cause::Pin
    }
}

fn tell(cause: &Cause, boots: u32) {
    match cause {
        Cause::Panic(place) => {
            defmt::error!("start {}: panic in {}:{}", boots, place.file(), place.line);
        }
        Cause::HardFault { address } => {
            defmt::error!("start {}: fault at {:x}", boots, address);
        }
        Cause::Power => defmt::info!("start {}: power", boots),
        Cause::Pin => defmt::info!("start {}: reset pin", boots),
        Cause::BrownOut => defmt::warn!("start {}: the supply was too low", boots),
        Cause::Watchdog => defmt::error!("start {}: watchdog", boots),
        Cause::Software => defmt::info!("start {}: software", boots),
        Cause::ClockLost => defmt::error!("start {}: the external clock stopped", boots),
    }
}

fn restart(kind: u32, value: u32) -> ! {
    board::unlock_backup();
    set(VALUE, value);
    set(KIND, kind);
    cortex_m::peripheral::SCB::sys_reset()
}

/// The external clock stopped.
pub fn restart_without_clock() -> ! {
    restart(CLOCK, 0)
}

/// Keeps the place and restarts.
#[panic_handler]
fn panic(info: &PanicInfo) -> ! {
    board::unlock_backup();
    let Some(location) = info.location() else {
        restart(PANIC, 0)
    };
    let file = location.file().as_bytes();
    let end = file.get(file.len().saturating_sub(FILE_NAME)..);
    let mut words = end.unwrap_or(&[]).chunks(4);
    for n in NAME {
        let mut word = [0; 4];
        for (to, from) in word.iter_mut().zip(words.next().unwrap_or(&[])) {
            *to = *from;
        }
        set(n, u32::from_le_bytes(word));
    }
    restart(PANIC, location.line())
}

// SAFETY of both: they touch nothing but registers, and never return.
#[allow(unsafe_code)]
#[exception]
unsafe fn HardFault(frame: &ExceptionFrame) -> ! {
    restart(FAULT, frame.pc())
}

/// The clock security system is the only source of it.
#[allow(unsafe_code)]
#[exception]
unsafe fn NonMaskableInt() -> ! {
    restart_without_clock()
}
