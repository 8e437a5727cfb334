//! Four-channel samples a second on one core: `cargo bench -p shared --bench moments`.

use divan::counter::ItemsCount;
use divan::{Bencher, black_box};
use shared::moments::{Accumulator, CHANNELS};
use shared::scalar::Real;

const SAMPLES: usize = 1 << 16;

/// Codes like an instrument's under vibration: a triangle of its own period on every channel.
fn samples() -> Vec<[i32; CHANNELS]> {
    (0..SAMPLES as i32)
        .map(|n| [613, 1201, 911, 1733].map(|period| (n % period - period / 2) * 4000 + n % 7))
        .collect()
}

#[divan::bench(types = [f32, f64])]
fn all_moments<T: Real>(bencher: Bencher) {
    let samples = samples();
    bencher.counter(ItemsCount::new(SAMPLES)).bench_local(|| {
        let mut accumulator = Accumulator::<T>::new([0; CHANNELS]);
        accumulator
            .extend(black_box(&samples))
            .map(|()| accumulator.close())
    });
}

fn main() {
    divan::main();
}
