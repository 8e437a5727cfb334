//! A campaign from start to end: the virtual bench's volts through the image to the UART, the host's record of it, and
//! what host and instrument make of that.

use std::error::Error;

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
use shared::wire::message::{Coefficients, Command, Event, Plateau, Segment};
use shared::wire::version;

/// Volts of the instrument over those at the converter.
const DIVIDER: f64 = 10.0;

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
            block_samples: 40,
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

/// Mean of what some values are added up to.
#[derive(Default)]
struct Mean {
    sum: f64,
    count: f64,
}

impl Mean {
    fn add(&mut self, value: f64, count: u32) {
        self.sum += value * f64::from(count);
        self.count += f64::from(count);
    }

    fn value(&self) -> f64 {
        self.sum / self.count
    }
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

    // While the instrument solves, idle blocks find the queue full; inside of a segment none is missing.
    let mut last = (Segment::Idle, 0);
    let (mut before_g, mut during_g) = (Mean::default(), Mean::default());
    let read = record::read(
        FileSource::open(&folder.path().join(RECORD))?,
        |event, _| {
            if let Event::Block(block) = event {
                let (segment, next) = last;
                if segment != Segment::Idle && block.segment == segment {
                    assert_eq!((block.first_sample, block.lost), (next, 0));
                }
                last = (block.segment, block.first_sample + u64::from(block.count));
            }
            if let Event::Compensated(block) = event
                && let Segment::Run(run) = block.segment
            {
                match run.plateau {
                    Plateau::Before => before_g.add(block.specific_force_g, block.count),
                    Plateau::During => during_g.add(block.specific_force_g, block.count),
                    Plateau::After => {}
                }
            }
            Ok::<(), RecordError>(())
        },
    );
    read?;
    // 400 blocks, give or take what a command takes to be heard.
    for count in [before_g.count, during_g.count] {
        assert!((15_990.0..16_010.0).contains(&count), "{count}");
    }
    let left_g = during_g.value() - before_g.value();
    let measured = captured.campaign.runs[0].measured.ok_or("measured")?;
    let k1 = bench.accelerometer.coefficients.scale_factor_v_per_g;
    let plain_g = (measured.during_v - measured.before_v) / k1;
    println!("vibration error {plain_g:e} g, compensated {left_g:e} g");
    assert!(
        plain_g.abs() > 20.0 * left_g.abs(),
        "{plain_g:e} {left_g:e}"
    );
    Ok(())
}
