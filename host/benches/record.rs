//! Recorded raw frames decoded, checked and reduced to moments, in four-channel samples a second on one
//! core: `cargo bench -p host --bench record`.

use divan::counter::ItemsCount;
use divan::{Bencher, black_box};
use host::record::{self, RecordError};
use shared::moments::Accumulator;
use shared::wire::Event;
use shared::wire::framing::Frame;
use shared::wire::message::{MAX_RAW_SAMPLES, Raw, Segment, pack};

const FRAMES: usize = 4096;

/// Noise of some ten thousand codes on four channels.
fn recorded() -> Vec<u8> {
    let mut state = 1u64;
    let mut code = || {
        state = state
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1);
        (state >> 47) as i32 - (1 << 16)
    };
    let mut frame = Frame::new();
    let mut record = Vec::new();
    for n in 0..FRAMES {
        let codes: Vec<u8> = (0..MAX_RAW_SAMPLES)
            .flat_map(|_| pack(&std::array::from_fn(|_| code())))
            .collect();
        let first_sample = (n * MAX_RAW_SAMPLES) as u64;
        let event = Event::Raw(Raw {
            segment: Segment::Idle,
            first_sample,
            codes: &codes,
        });
        frame
            .encode(&event, n as u16)
            .expect("a full raw frame fits");
        record.extend_from_slice(frame.as_bytes());
    }
    record
}

#[divan::bench]
fn decoded_and_reduced(bencher: Bencher) {
    let record = recorded();
    bencher
        .counter(ItemsCount::new(FRAMES * MAX_RAW_SAMPLES))
        .bench_local(|| {
            let mut moments = Accumulator::<f64>::new([0; 4]);
            let tally = record::read(
                black_box(record.as_slice()),
                |event, _| -> Result<(), RecordError> {
                    if let Event::Raw(raw) = event {
                        let samples: Vec<[i32; 4]> = raw.samples().collect();
                        moments.extend(&samples).expect("a short block");
                    }
                    Ok(())
                },
            );
            (tally, moments.close())
        });
}

#[divan::bench]
fn decoded(bencher: Bencher) {
    let record = recorded();
    bencher
        .counter(ItemsCount::new(FRAMES * MAX_RAW_SAMPLES))
        .bench_local(|| {
            record::read(
                black_box(record.as_slice()),
                |event, _| -> Result<(), RecordError> {
                    black_box(event);
                    Ok(())
                },
            )
        });
}

fn main() {
    divan::main();
}
