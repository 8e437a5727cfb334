//! What ended the last run: the reset flags, and the place of a panic kept in the backup registers of the RTC,
//! which a reset does not clear.

use core::panic::PanicInfo;

use embassy_stm32::pac;

/// Backup register 0 of a kept panic: "PNIC".
const MAGIC: u32 = 0x504E_4943;

/// Registers that the end of the file's name is kept in, after the marks and the line.
const NAME: core::ops::Range<usize> = 2..12;

/// Bytes of the name that are kept.
const NAME_BYTES: usize = 4 * (NAME.end - NAME.start);

/// Why the last run ended.
#[derive(defmt::Format)]
pub enum Cause {
    /// Power came on, or the reset pin.
    Power,
    /// The watchdog was not fed.
    Watchdog,
    /// A panic.
    Panic {
        /// Line of the source file.
        line: u32,
        /// End of the source file's name.
        file: heapless::String<NAME_BYTES>,
    },
    /// Software asked for it.
    Software,
}

/// Reads and clears what is known of the last run. The backup domain has to be writable.
pub fn take() -> Cause {
    let flags = pac::RCC.csr().read();
    pac::RCC.csr().modify(|w| w.set_rmvf(true));
    let backup = |n: usize| pac::RTC.bkpr(n);
    if backup(0).read().bkp() == MAGIC {
        backup(0).write(|w| w.set_bkp(0));
        let mut file = heapless::String::new();
        for n in NAME {
            for byte in backup(n).read().bkp().to_le_bytes() {
                if byte.is_ascii_graphic() {
                    // As many bytes as the string holds.
                    let _ = file.push(char::from(byte));
                }
            }
        }
        return Cause::Panic {
            line: backup(1).read().bkp(),
            file,
        };
    }
    if flags.wdgrstf() {
        Cause::Watchdog
    } else if flags.sftrstf() {
        Cause::Software
    } else {
        Cause::Power
    }
}

/// Makes the backup registers writable.
pub fn unlock() {
    pac::RCC.apb1enr().modify(|w| w.set_pwren(true));
    pac::PWR.cr1().modify(|w| w.set_dbp(true));
}

/// Keeps the place and restarts.
#[panic_handler]
fn panic(info: &PanicInfo) -> ! {
    unlock();
    if let Some(location) = info.location() {
        let file = location.file().as_bytes();
        let end = file.get(file.len().saturating_sub(NAME_BYTES)..);
        let mut words = end.unwrap_or(&[]).chunks(4);
        for n in NAME {
            let mut word = [0; 4];
            for (to, from) in word.iter_mut().zip(words.next().unwrap_or(&[])) {
                *to = *from;
            }
            pac::RTC
                .bkpr(n)
                .write(|w| w.set_bkp(u32::from_le_bytes(word)));
        }
        pac::RTC.bkpr(1).write(|w| w.set_bkp(location.line()));
        pac::RTC.bkpr(0).write(|w| w.set_bkp(MAGIC));
    }
    cortex_m::peripheral::SCB::sys_reset()
}
