//! How much of the stack was never used: what is left of the paint that the start-up code lays under it.

use cortex_m_rt::STACK_PAINT_VALUE;

/// The linker's symbols: the stack's ends.
#[allow(unsafe_code)]
mod ends {
    unsafe extern "C" {
        pub static _stack_start: u32;
        pub static _stack_end: u32;
    }
}

/// Words that are looked at, at the most, so that a look takes a fifth of a millisecond.
const MOST: u32 = 4096;

/// Bytes of the stack that were never used, as far as [`MOST`] words go.
pub fn free() -> u32 {
    let (end, start) = (&raw const ends::_stack_end, &raw const ends::_stack_start);
    let words = (start as u32).saturating_sub(end as u32) / 4;
    let mut free = 0;
    while free < words.min(MOST) {
        // SAFETY: memory of the stack, aligned; what others write to it meanwhile is no paint, or was none before.
        #[allow(unsafe_code)]
        let word = unsafe { end.add(free as usize).read_volatile() };
        if word != STACK_PAINT_VALUE {
            break;
        }
        free += 1;
    }
    4 * free
}
