//! Samples a second into a trace, on one core: `cargo bench -p shared --bench slope`.

use divan::counter::ItemsCount;
use divan::{Bencher, black_box};
use shared::slope::Trace;

const SAMPLES: usize = 1 << 16;

#[divan::bench]
fn trace(bencher: Bencher) {
    let samples: Vec<f64> = (0..SAMPLES).map(|n| (n as f64 * 0.1).sin()).collect();
    bencher.counter(ItemsCount::new(SAMPLES)).bench_local(|| {
        let mut trace = Trace::new();
        black_box(&samples)
            .iter()
            .try_for_each(|&x| trace.push(x))
            .map(|()| trace.line_fit())
    });
}

fn main() {
    divan::main();
}
