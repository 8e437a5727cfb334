//! Square roots for ever, for the emulator to count: `cargo run -p emulated`. On the host there is nothing to run.
#![cfg_attr(target_os = "none", no_std, no_main)]

#[cfg(target_os = "none")]
mod image {
    use core::hint::black_box;
    use core::panic::PanicInfo;

    // The vector table and the interrupts' names.
    use embassy_stm32 as _;

    #[inline(never)]
    fn libm_root(x: f32) -> f32 {
        libm::sqrtf(x)
    }

    #[inline(never)]
    fn micromath_root(x: f32) -> f32 {
        micromath::F32Ext::sqrt(x)
    }

    #[cortex_m_rt::entry]
    fn main() -> ! {
        let mut x = 1.0;
        loop {
            black_box(libm_root(black_box(x)));
            black_box(micromath_root(black_box(x)));
            x = if x > 1e6 { 1e-6 } else { x * 1.7 };
        }
    }

    #[panic_handler]
    fn panic(_: &PanicInfo) -> ! {
        loop {}
    }
}

#[cfg(not(target_os = "none"))]
fn main() {
    eprintln!("this program runs on the board");
    std::process::exit(2);
}
