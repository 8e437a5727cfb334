//! From volts through the converter's model and the firmware to the bytes of the line.

use firmware::adc::registers::{Config, Oversampling, Register};
use host::bench::board::VirtualBoard;
use host::bench::converter::{Converter, DrdyPin, Faults, Quiet, Signal};
use host::bench::flash::{self, Flash};
use shared::compensate::{Mode, Source};
use shared::wire::board::BlockConditions;
use shared::wire::configuration::{Certified, Compensation, Configuration};
use shared::wire::framing::Deframer;
use shared::wire::message::{
    Block, Command, CompensatedBlock, Event, Fault, Plateau, Run, Segment, State, StoreFault,
};
use shared::wire::version;

const BLOCK: u16 = 40;

/// A sine on each channel, on its own constant.
struct Sines {
    constant_v: [f64; 4],
    amplitude_v: f64,
    frequency_hz: f64,
}

impl Signal for Sines {
    fn fill(&mut self, start_s: f64, rate_hz: f64, out: &mut [[f64; 4]]) {
        for (n, out) in out.iter_mut().enumerate() {
            let phase = std::f64::consts::TAU * self.frequency_hz * (start_s + n as f64 / rate_hz);
            *out = self.constant_v.map(|c| c + self.amplitude_v * phase.sin());
        }
    }
}

/// What the line has told.
#[derive(Default)]
struct Heard {
    blocks: Vec<Block>,
    faults: Vec<Fault>,
    raw_samples: u64,
    state: Option<State>,
    compensated: Vec<CompensatedBlock>,
    certified: Option<Certified>,
    conditions: Vec<BlockConditions>,
    stored: Vec<(u32, Option<StoreFault>)>,
}

struct Line {
    board: VirtualBoard,
    deframer: Deframer,
    heard: Heard,
}

impl Line {
    fn new(config: Config) -> Self {
        Self::with_memory(config, Flash::new(0))
    }

    fn with_memory(config: Config, flash: Flash) -> Self {
        let converter = Converter::new(config);
        let board = VirtualBoard::with_memory(converter, BLOCK, *b"virtualboard", flash);
        let mut line = Self {
            board,
            deframer: Deframer::new(),
            heard: Heard::default(),
        };
        line.send(Command::Hello {
            version: version::CURRENT,
        });
        line
    }

    fn run(&mut self, samples: u64, signal: &mut dyn Signal) {
        let Self {
            board,
            deframer,
            heard,
        } = self;
        board.run(samples, signal, &mut |mut bytes| {
            while !bytes.is_empty() {
                let (taken, packet) = deframer.feed(bytes);
                bytes = &bytes[taken..];
                let Some(packet) = packet else { continue };
                match packet.expect("sound").message().expect("an event") {
                    Event::Block(block) => heard.blocks.push(block),
                    Event::Fault { fault, .. } => heard.faults.push(fault),
                    event @ (Event::Check(_) | Event::CheckBegun(_)) => {
                        panic!("nobody asked for {event:?}")
                    }
                    Event::Compensated(block) => heard.compensated.push(block),
                    Event::Certified(certified) => heard.certified = certified,
                    Event::Configuration(_) => panic!("of version 1"),
                    Event::Board(_) => {}
                    Event::Conditions(conditions) => heard.conditions.push(conditions),
                    Event::Stored { writes, fault, .. } => heard.stored.push((writes, fault)),
                    Event::Raw(raw) => heard.raw_samples += raw.samples().len() as u64,
                    Event::State(state) => heard.state = Some(state),
                    Event::Refused { reason, .. } => panic!("refused: {reason:?}"),
                    Event::Hello(_) | Event::Ack { .. } => {}
                }
            }
        });
    }

    fn send(&mut self, command: Command) {
        self.board.send(&command).expect("fits");
        self.run(0, &mut Quiet);
    }

    fn replace(&mut self, certified: Option<Certified>) {
        self.board.replace(certified).expect("fits");
        self.run(0, &mut Quiet);
    }

    fn state(&mut self) -> State {
        self.send(Command::AskState);
        self.heard.state.take().expect("a state")
    }
}

const RUN: Run = Run {
    run: 1,
    plateau: Plateau::During,
};

#[test]
fn mean_code_is_the_mean_voltage_within_quantisation() {
    for oversampling in [Oversampling::X128, Oversampling::X256, Oversampling::X1024] {
        let config = Config {
            oversampling,
            ..Config::default()
        };
        let mut line = Line::new(config);
        let constant_v = [0.1234567, -0.4, 0.0, 1.0];
        let mut signal = Sines {
            constant_v,
            amplitude_v: 0.05,
            frequency_hz: config.sample_rate_hz() / 40.0,
        };
        // The filter forgets what was before.
        line.run(40, &mut signal);
        line.send(Command::StartRun(RUN));
        let samples = 40 * 500;
        line.run(samples, &mut signal);
        line.send(Command::StopRun);
        let blocks: Vec<_> = line
            .heard
            .blocks
            .iter()
            .filter(|block| block.segment == Segment::Run(RUN))
            .collect();
        assert_eq!(blocks.len(), 500);
        assert!(blocks.iter().all(|b| (b.count, b.lost) == (40, 0)));
        for channel in 0..4 {
            let sum: i64 = blocks.iter().map(|b| b.moments.sum[channel]).sum();
            let mean_v = sum as f64 / samples as f64 / f64::from(1 << 23) * 1.2;
            let step_v = 1.2 / f64::from(1 << 23);
            let error_v = mean_v - constant_v[channel];
            assert!(error_v.abs() < 0.5 * step_v, "{channel}: {error_v}");
        }
    }
}

#[test]
fn no_conversion_is_lost_in_raw_mode_without_faults() {
    let mut line = Line::new(Config::default());
    line.send(Command::StreamRaw { on: true });
    let before = line.state();
    line.run(32_000, &mut Quiet);
    line.send(Command::StreamRaw { on: false });
    let state = line.state();
    assert_eq!(state.conversions - before.conversions, 32_000);
    assert_eq!((state.lost, state.dropped_frames), (0, 0));
    assert_eq!(line.heard.raw_samples, 32_000);
}

/// What a fault and its end leave behind: every conversion of the model is either a sample or lost.
fn every_conversion_is_accounted_for(
    oversampling: Oversampling,
    spoil: impl Fn(&mut Line),
    expected: fn(&Fault) -> bool,
) {
    let mut line = Line::new(Config {
        oversampling,
        ..Config::default()
    });
    line.send(Command::StartRun(RUN));
    let before = (line.state(), line.board.conversions());
    line.run(1000, &mut Quiet);
    spoil(&mut line);
    line.board.disturb(|c| c.faults = Faults::default());
    line.run(2000, &mut Quiet);
    line.send(Command::StopRun);
    let state = line.state();
    let made = line.board.conversions() - before.1;
    assert_eq!(state.conversions - before.0.conversions, made);
    assert_eq!(
        state.samples - before.0.samples + state.lost - before.0.lost,
        made
    );
    let in_run = line
        .heard
        .blocks
        .iter()
        .filter(|b| b.segment == Segment::Run(RUN));
    let (count, lost) = in_run.fold((0, 0), |(count, lost), block| {
        (count + u64::from(block.count), lost + u64::from(block.lost))
    });
    assert_eq!((count + lost, lost), (made, state.lost - before.0.lost));
    assert!(lost > 0 && count >= 1900, "{lost} {count}");
    assert!(
        line.heard.faults.iter().any(expected),
        "{:?}",
        line.heard.faults
    );
}

const RATES: [Oversampling; 3] = [Oversampling::X128, Oversampling::X256, Oversampling::X1024];

#[test]
fn wrong_checksums_cost_exactly_their_conversions() {
    for rate in RATES {
        let spoil = |line: &mut Line| {
            line.board.disturb(|c| c.faults.wrong_checksums = 17);
            line.run(500, &mut Quiet);
        };
        every_conversion_is_accounted_for(rate, spoil, |f| matches!(f, Fault::Checksum { .. }));
    }
}

#[test]
fn missing_bytes_are_noticed_and_counted() {
    for rate in RATES {
        let spoil = |line: &mut Line| {
            line.board.disturb(|c| c.faults.missing_bytes = 5);
            line.run(500, &mut Quiet);
        };
        every_conversion_is_accounted_for(rate, spoil, |f| matches!(f, Fault::Checksum { .. }));
    }
}

#[test]
fn a_stuck_drdy_is_named_and_its_conversions_are_counted() {
    for rate in RATES {
        for pin in [DrdyPin::StuckLow, DrdyPin::StuckHigh] {
            let spoil = |line: &mut Line| {
                line.board.disturb(|c| c.faults.drdy = pin);
                line.run(777, &mut Quiet);
            };
            let timeout = |f: &Fault| matches!(f, Fault::DrdyTimeout { .. });
            every_conversion_is_accounted_for(rate, spoil, timeout);
        }
    }
}

#[test]
fn a_converter_reset_in_the_middle_is_set_up_anew() {
    for rate in RATES {
        let spoil = |line: &mut Line| {
            line.board.disturb(Converter::reset);
            line.run(100, &mut Quiet);
        };
        every_conversion_is_accounted_for(rate, spoil, |f| matches!(f, Fault::Status { .. }));
    }
}

#[test]
fn a_firmware_that_comes_too_late_counts_what_it_missed() {
    for rate in RATES {
        for missed in [1, 2, 3, 100] {
            let spoil = |line: &mut Line| line.board.stall(missed + 1, &mut Quiet);
            every_conversion_is_accounted_for(rate, spoil, |f| matches!(f, Fault::Overrun { .. }));
        }
    }
}

#[test]
fn a_register_that_takes_no_writing_stops_the_acquisition_by_name() {
    let mut converter = Converter::new(Config {
        oversampling: Oversampling::X256,
        ..Config::default()
    });
    converter.faults.stuck_register = Some(Register::Clock);
    let mut line = Line {
        board: VirtualBoard::new(converter, BLOCK, [0; 12]),
        deframer: Deframer::new(),
        heard: Heard::default(),
    };
    line.run(1000, &mut Quiet);
    let stuck = Fault::Register {
        address: Register::Clock.address(),
        written: 0x0F06,
        read: 0x0F0E,
    };
    assert_eq!(line.heard.faults, [stuck]);
}

#[test]
fn what_a_dead_line_drops_is_counted() {
    let mut line = Line::new(Config::default());
    line.send(Command::StartRun(RUN));
    line.board.run_unheard(40 * 1000, &mut Quiet);
    line.run(0, &mut Quiet);
    let heard: u64 = line.heard.blocks.iter().map(|b| u64::from(b.count)).sum();
    let state = line.state();
    assert!(state.dropped_samples > 0);
    assert_eq!(heard + state.dropped_samples, state.samples);
}

#[test]
fn a_configuration_outlives_a_loss_of_power_and_a_memory_that_fails_stops_nothing() {
    let configuration = Configuration {
        compensation: Compensation {
            mode: Some(Mode::Block),
            source: Source::Reference,
            block_samples: 20,
            nominal_v_per_g: 0.1,
            reference_v_per_g: [0.1; 3],
            reference_zero_v: [0.0; 3],
        },
        calibration: None,
    };
    let mut line = Line::new(Config::default());
    line.replace(Some(configuration.into()));
    line.run(1, &mut Quiet);
    assert_eq!(line.heard.stored, [(1, None)]);

    let mut flash = line.board.switch_off();
    flash.fault = flash::Fault::Deaf;
    let mut line = Line::with_memory(Config::default(), flash);
    line.send(Command::AskConfiguration);
    assert_eq!(line.heard.certified, Some(configuration.into()));
    line.run(200, &mut Quiet);
    assert!(line.heard.compensated.len() >= 10);
    assert!(line.heard.compensated.iter().skip(1).all(|b| b.count == 20));

    line.replace(None);
    line.run(200, &mut Quiet);
    let kept = (1, None);
    let failed = (1, Some(StoreFault::Verify));
    assert_eq!(line.heard.stored, [kept, failed]);
    let state = line.state();
    assert_eq!((state.lost, state.compensating), (0, false));
}
