//! A four-channel sample through the converter's model, the firmware's driver, sampler and application, to bytes.
//!
//! `cargo bench -p host --bench board`

use divan::Bencher;
use divan::counter::ItemsCount;
use firmware::adc::registers::Config;
use host::bench::board::VirtualBoard;
use host::bench::converter::{Converter, Quiet};
use shared::wire::message::Command;
use shared::wire::version;

fn main() {
    divan::main();
}

const SAMPLES: u64 = 40_000;

#[divan::bench(args = [false, true])]
fn samples(bencher: Bencher, raw: bool) {
    let mut board = VirtualBoard::new(Converter::new(Config::default()), 40, [0; 12]);
    let hello = Command::Hello {
        version: version::CURRENT,
    };
    board.send(&hello).expect("fits");
    board.send(&Command::StreamRaw { on: raw }).expect("fits");
    bencher.counter(ItemsCount::new(SAMPLES)).bench_local(|| {
        let mut bytes = 0;
        board.run(SAMPLES, &mut Quiet, &mut |frame| bytes += frame.len());
        bytes
    });
}
