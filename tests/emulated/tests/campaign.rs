//! A campaign from start to end: the virtual bench's volts through the image to the UART, the host's record of it, and
//! what host and instrument make of that.

use std::error::Error;
use std::path::Path;

use firmware::adc::registers::REFERENCE_V;
use host::bench::board::Board;
use host::bench::emulated::EmulatedBoard;
use host::bench::noise::Seed;
use host::bench::plan::{Shake, Static};
use host::bench::simulate::{Specification, VirtualBench};
use host::campaign::VibrationKind;
use host::capture::{RECORD, capture};
use host::record::{self, RecordError};
use host::source::FileSource;
use host::verification::verify;
use shared::compensate::{Mode, Source};
use shared::model::{FURTHER, NOMINAL};
use shared::rectification::Covariance;
use shared::wire::configuration::{Calibration, Compensation, Configuration};
use shared::wire::message::{
    Block, Coefficients, Command, CompensatedBlock, Event, Plateau, Run, Segment,
};
use shared::wire::version;

/// Volts of the instrument over those at the converter.
const DIVIDER: f64 = 10.0;

/// Of the converter.
const V_PER_CODE: f64 = REFERENCE_V / 8_388_608.0;

/// Volts of the reference at the converter, V/g.
const REFERENCE_V_PER_G: f32 = 0.1;

/// The instrument compensates with what it truly is.
fn configuration(bench: &VirtualBench) -> Configuration {
    let mut nominal = bench.accelerometer.coefficients.to_nominal();
    nominal[0] /= DIVIDER;
    let coefficients = Coefficients {
        nominal,
        further: [0.0; FURTHER],
    };
    Configuration {
        compensation: Compensation {
            mode: Some(Mode::Block),
            source: Source::Reference,
            block_samples: BLOCK as u16,
            nominal_v_per_g: nominal[0] as f32,
            reference_v_per_g: [REFERENCE_V_PER_G; 3],
            reference_zero_v: [0.0; 3],
        },
        calibration: Some(Calibration {
            coefficients,
            covariance: Covariance::default(),
            rank: NOMINAL as u8,
        }),
    }
}

/// Conversions in a block, and in a period of the shaker's 100 Hz.
const BLOCK: u32 = 40;

/// Conversions that a plateau may be longer or shorter than 400 blocks: what commands differ in their delay.
const DELAY: u32 = 7;

/// What came of a plateau, and the means over its whole blocks. A part of a period has a mean of its own, which is no
/// vibration error.
#[derive(Default)]
struct Means {
    samples: u32,
    blocks: u32,
    sum_codes: i64,
    compensated: u32,
    sum_g: f64,
}

impl Means {
    fn block(&mut self, block: &Block) {
        self.samples += block.count;
        if block.count == BLOCK {
            self.blocks += 1;
            self.sum_codes += block.moments.sum[0];
        }
    }

    fn compensated(&mut self, block: &CompensatedBlock) {
        if block.count == BLOCK {
            self.compensated += 1;
            self.sum_g += block.specific_force_g;
        }
    }

    /// The converter's, codes.
    fn codes(&self) -> f64 {
        self.sum_codes as f64 / f64::from(self.blocks * BLOCK)
    }

    /// As the instrument compensates it, g.
    fn specific_force_g(&self) -> f64 {
        self.sum_g / f64::from(self.compensated)
    }
}

/// The plateaus before and during vibration of the record's run. While the instrument solves, idle blocks find the queue
/// full; inside of a segment none is missing.
fn plateaus(folder: &Path) -> Result<[Means; 2], Box<dyn Error>> {
    let mut last = (Segment::Idle, 0);
    let mut means = [Means::default(), Means::default()];
    let of = |segment| match segment {
        Segment::Run(Run { plateau, .. }) => [Plateau::Before, Plateau::During]
            .iter()
            .position(|&one| one == plateau),
        _ => None,
    };
    record::read(FileSource::open(&folder.join(RECORD))?, |event, _| {
        if let Event::Block(block) = &event {
            let (segment, next) = last;
            if segment != Segment::Idle && block.segment == segment {
                assert_eq!((block.first_sample, block.lost), (next, 0));
            }
            last = (block.segment, block.first_sample + u64::from(block.count));
        }
        match event {
            Event::Block(block) if let Some(k) = of(block.segment) => means[k].block(&block),
            Event::Compensated(block) if let Some(k) = of(block.segment) => {
                means[k].compensated(&block);
            }
            _ => {}
        }
        Ok::<(), RecordError>(())
    })?;
    Ok(means)
}

#[test]
fn a_campaign_over_the_uart_makes_host_and_instrument_agree_and_leaves_a_twentieth_of_the_vibration_error()
-> Result<(), Box<dyn Error>> {
    let specification = Specification::with_dial_sigma(1.0);
    let mut bench = VirtualBench::new(Seed(3), Static::Paper, specification, Vec::new());
    // Each angle once.
    bench.plan.dwells.truncate(24);
    bench.plan.runs = vec![Shake {
        kind: VibrationKind::Sine,
        direction: [0.6, 0.8, 0.0],
        level_g: 5.0,
        f_lo_hz: 100.0,
        f_hi_hz: 100.0,
        a0: [0.6, 0.0, -0.8],
    }];
    let folder = tempfile::tempdir()?;
    let mut board = EmulatedBoard::start()?;
    let version = version::CURRENT;
    board.send(&Command::Hello { version })?;
    board.send(&Command::Replace {
        writes: 0,
        certified: Some(configuration(&bench).into()),
    })?;
    let captured = capture(&bench, &mut board, folder.path(), || {})?;
    assert_eq!(captured.campaign.readings.len(), 24);
    let tally = captured.tally;
    assert_eq!(
        (tally.damaged_bytes, tally.missing_frames, tally.restarts),
        (0, 0, 0)
    );
    assert_eq!(tally.blocks.missing, 0);

    let found = verify(folder.path())?;
    assert!(found.agrees(), "{found:?}");
    assert_eq!(found.instrument.readings, 24);

    let [before, during] = plateaus(folder.path())?;
    for plateau in [&before, &during] {
        assert_eq!(plateau.compensated, plateau.blocks);
        let off = plateau.samples.abs_diff(400 * BLOCK);
        assert!(off <= DELAY, "{}", plateau.samples);
    }
    let left_g = during.specific_force_g() - before.specific_force_g();
    let k1 = bench.accelerometer.coefficients.scale_factor_v_per_g;
    let plain_g = (during.codes() - before.codes()) * V_PER_CODE * DIVIDER / k1;
    println!("vibration error {plain_g:e} g, compensated {left_g:e} g");
    assert!(
        plain_g.abs() > 20.0 * left_g.abs(),
        "{plain_g:e} {left_g:e}"
    );
    Ok(())
}
