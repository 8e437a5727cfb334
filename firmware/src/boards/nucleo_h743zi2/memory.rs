//! What the caches hold, and what not.
//!
//! | memory | who | cached |
//! |---|---|---|
//! | flash, bank 1 | code and constants | yes |
//! | DTCM | variables and stack | no cache lies before it; no DMA reaches it |
//! | AXI SRAM | what a DMA reads or writes: section `.dma` | kept out by the memory protection unit |
//! | flash, bank 2 | the configuration, which is programmed while the core runs | kept out |
//!
//! So no cache is ever to be cleaned or invalidated.

use cortex_m::peripheral::MPU;

/// A region of the memory protection unit (PM0253, 4.6): normal memory that is not cached and never executed.
struct Uncached {
    base: u32,
    /// Its size as a power of two.
    log2_bytes: u32,
}

const REGIONS: [Uncached; 2] = [
    Uncached {
        base: 0x2400_0000,
        log2_bytes: 19,
    },
    Uncached {
        base: 0x0810_0000,
        log2_bytes: 20,
    },
];

/// Execution never; full access; type extension 1 with neither bufferable nor cacheable; enabled.
const ATTRIBUTES: u32 = 1 << 28 | 0b011 << 24 | 0b001 << 19 | 1;

/// On, with the default map for everything else.
const ON: u32 = 1 << 2 | 1;

fn protect(mpu: &MPU) {
    for (number, region) in (0..).zip(&REGIONS) {
        // SAFETY: nothing has been cached yet, and no region is smaller than what lies in it.
        #[allow(unsafe_code)]
        unsafe {
            mpu.rnr.write(number);
            mpu.rbar.write(region.base);
            mpu.rasr.write(ATTRIBUTES | (region.log2_bytes - 1) << 1);
        }
    }
    // SAFETY: as above.
    #[allow(unsafe_code)]
    unsafe {
        mpu.ctrl.write(ON);
    }
    cortex_m::asm::dsb();
    cortex_m::asm::isb();
}

/// Protects what must not be cached, and switches both caches on.
pub fn start() {
    let Some(mut core) = cortex_m::Peripherals::take() else {
        defmt::panic!("the core's peripherals are taken");
    };
    protect(&core.MPU);
    core.SCB.enable_icache();
    core.SCB.enable_dcache(&mut core.CPUID);
}
