//! The conversation with the instrument: what is carried out, what is refused and by which name, and that whatever
//! does not fit on the line is counted exactly.

use firmware::adc::Conversion;
use firmware::adc::batch::Batch;
use firmware::app::{App, Keep};
use firmware::link::{MAX_ORDERS, Queues, RAW_SAMPLES};
use firmware::sampler::{Around, Sampler};
use firmware::store::Kept;
use shared::compensate::{Mode, Source};
use shared::model::FURTHER;
use shared::rectification::Covariance;
use shared::wire::board::{BlockConditions, BoardState, Pulse};
use shared::wire::configuration::{
    Calibration, Certified, Compensation, Configuration, Date, Name, Provenance,
};
use shared::wire::framing::{Frame, Packet};
use shared::wire::message::{
    Approach, Coefficients, Command, Event, Identity, Parameter, Plateau, Position, Refusal, Run,
    Segment, State, StoreFault,
};
use shared::wire::version::{self, Version};

const BLOCK: u16 = 40;

const IDENTITY: Identity = Identity {
    minimum: version::MINIMUM,
    current: version::CURRENT,
    firmware: [0, 1, 0],
    serial: *b"123456789012",
    sample_rate_hz: 4000.0,
    reference_v: 1.2,
    gains: [1; 4],
    block_samples: BLOCK,
};

const POSITION: Position = Position {
    reading: 7,
    series: 1,
    dial_deg: 30.0,
    mount_deg: 0.0,
    approach: Approach::Cw,
};

const RUN: Run = Run {
    run: 3,
    plateau: Plateau::During,
};

const HELLO: Command = Command::Hello {
    version: version::CURRENT,
};

/// An instrument whose conversions are made by hand.
struct Instrument<'q> {
    sampler: Sampler<'q>,
    app: App<'q>,
    next: u64,
    sequence: u16,
    board: Option<BoardState>,
    conditions: Vec<BlockConditions>,
}

/// What came over the line, without borrowing from it.
#[derive(Clone, Debug, PartialEq)]
enum Said {
    Event(Event<'static>),
    Raw {
        segment: Segment,
        first_sample: u64,
        samples: Vec<[i32; 4]>,
    },
}

impl<'q> Instrument<'q> {
    fn new(queues: &'q mut Queues) -> Self {
        let (acquisition, application) = queues.split();
        Self {
            sampler: Sampler::new(acquisition, BLOCK),
            app: App::new(IDENTITY, application),
            next: 0,
            sequence: 100,
            board: None,
            conditions: Vec::new(),
        }
    }

    fn greeted(queues: &'q mut Queues) -> Self {
        let mut instrument = Self::new(queues);
        instrument.ask(HELLO);
        instrument
    }

    fn send(&mut self, command: Command) {
        let mut frame = Frame::new();
        frame.encode(&command, self.sequence).expect("fits");
        self.sequence += 1;
        self.app.receive(frame.as_bytes());
    }

    fn convert(&mut self, count: u64) {
        for _ in 0..count {
            self.obey();
            let index = self.next;
            self.next += 1;
            self.sampler.take(&Batch::new(&Conversion {
                index,
                time_us: 250 * index,
                codes: codes(index),
            }));
        }
    }

    fn obey(&mut self) {
        self.sampler.obey(self.next, || 250 * self.next);
    }

    fn listen(&mut self) -> Vec<Said> {
        let mut frame = Frame::new();
        let mut said = Vec::new();
        while self.app.transmit(&mut frame) {
            let mut bytes = frame.as_bytes().to_vec();
            assert_eq!(bytes.pop(), Some(0));
            let packet = Packet::open(&mut bytes).expect("sound");
            said.push(match packet.message().expect("an event") {
                Event::Raw(raw) => Said::Raw {
                    segment: raw.segment,
                    first_sample: raw.first_sample,
                    samples: raw.samples().collect(),
                },
                Event::Hello(identity) => Said::Event(Event::Hello(identity)),
                Event::Ack { sequence, sample } => Said::Event(Event::Ack { sequence, sample }),
                Event::Refused { sequence, reason } => {
                    Said::Event(Event::Refused { sequence, reason })
                }
                Event::Block(block) => Said::Event(Event::Block(block)),
                Event::State(state) => Said::Event(Event::State(state)),
                Event::Fault { sample, fault } => Said::Event(Event::Fault { sample, fault }),
                Event::Check(outcome) => Said::Event(Event::Check(outcome)),
                Event::CheckBegun(set_up) => Said::Event(Event::CheckBegun(set_up)),
                Event::Compensated(block) => Said::Event(Event::Compensated(block)),
                Event::Configuration(_) => panic!("of version 1"),
                Event::Certified(known) => Said::Event(Event::Certified(known)),
                // Asked for where it matters.
                Event::Board(board) => {
                    self.board = Some(board);
                    continue;
                }
                Event::Conditions(conditions) => {
                    self.conditions.push(conditions);
                    continue;
                }
                Event::Stored {
                    sequence,
                    writes,
                    fault,
                } => Said::Event(Event::Stored {
                    sequence,
                    writes,
                    fault,
                }),
            });
        }
        said
    }

    /// Sends, lets it be carried out, and returns what was said.
    fn ask(&mut self, command: Command) -> Vec<Said> {
        self.send(command);
        self.obey();
        self.listen()
    }

    fn state(&mut self) -> State {
        self.ask(Command::AskState)
            .into_iter()
            .find_map(|said| match said {
                Said::Event(Event::State(state)) => Some(state),
                _ => None,
            })
            .expect("a state")
    }

    fn ack(&self, sample: u64) -> Said {
        Said::Event(Event::Ack {
            sequence: self.sequence - 1,
            sample,
        })
    }

    fn refused(&self, reason: Refusal) -> Said {
        Said::Event(Event::Refused {
            sequence: self.sequence - 1,
            reason,
        })
    }
}

fn codes(index: u64) -> [i32; 4] {
    let n = index as i32;
    [n, -n, 3 * n, 1000 - n]
}

#[test]
fn a_host_of_another_version_is_answered_and_refused() {
    let mut queues = Queues::new();
    let mut instrument = Instrument::new(&mut queues);
    let said = instrument.ask(Command::Hello {
        version: Version(99),
    });
    let refused = instrument.refused(Refusal::Version {
        minimum: version::MINIMUM,
        current: version::CURRENT,
    });
    assert_eq!(said, [Said::Event(Event::Hello(IDENTITY)), refused]);
    let said = instrument.ask(Command::StopRun);
    assert_eq!(said, [instrument.refused(Refusal::NoHello)]);
}

#[test]
fn nothing_is_carried_out_before_hello() {
    let mut queues = Queues::new();
    let mut instrument = Instrument::new(&mut queues);
    let said = instrument.ask(Command::StartPosition(POSITION));
    assert_eq!(said, [instrument.refused(Refusal::NoHello)]);
    let said = instrument.ask(HELLO);
    let ack = instrument.ack(0);
    assert_eq!(said, [Said::Event(Event::Hello(IDENTITY)), ack]);
    let said = instrument.ask(Command::StartPosition(POSITION));
    assert_eq!(said, [instrument.ack(0)]);
}

#[test]
fn blocks_cover_a_segment_from_its_first_sample_to_its_last() {
    let mut queues = Queues::new();
    let mut instrument = Instrument::greeted(&mut queues);
    instrument.convert(17);
    assert_eq!(
        instrument.ask(Command::StartPosition(POSITION)).last(),
        Some(&instrument.ack(17))
    );
    instrument.convert(3 * u64::from(BLOCK));
    let mut said = instrument.listen();
    said.extend(instrument.ask(Command::StopPosition));
    let blocks: Vec<_> = said
        .iter()
        .filter_map(|said| match said {
            Said::Event(Event::Block(block)) => Some(block),
            _ => None,
        })
        .collect();
    assert_eq!(blocks.len(), 3);
    for (n, block) in (0u64..).zip(blocks) {
        let first = 17 + 40 * n;
        assert_eq!(block.segment, Segment::Reading(7));
        assert_eq!((block.first_sample, block.count), (first, 40));
        let sum: i64 = (first..first + 40).map(|n| n as i64).sum();
        assert_eq!(block.moments.sum[0], sum);
        assert_eq!(block.moments.sum[3], 40_000 - sum);
    }
    assert_eq!(said.last(), Some(&instrument.ack(137)));
}

#[test]
fn what_is_open_must_be_closed_first() {
    let mut queues = Queues::new();
    let mut instrument = Instrument::greeted(&mut queues);
    for stop in [Command::StopPosition, Command::StopRun] {
        assert_eq!(instrument.ask(stop), [instrument.refused(Refusal::NotOpen)]);
    }
    instrument.ask(Command::StartRun(RUN));
    let open = Refusal::Open(Segment::Run(RUN));
    for command in [
        Command::StartPosition(POSITION),
        Command::StartRun(RUN),
        Command::SetCoefficients(coefficients()),
    ] {
        assert_eq!(instrument.ask(command), [instrument.refused(open)]);
    }
    let said = instrument.ask(Command::StopPosition);
    assert_eq!(said, [instrument.refused(Refusal::NotOpen)]);
    assert_eq!(instrument.ask(Command::StopRun), [instrument.ack(0)]);
}

fn coefficients() -> Coefficients {
    let mut nominal = [0.0; 11];
    nominal[0] = 0.1;
    nominal[1] = 0.003;
    Coefficients {
        nominal,
        further: [0.0; FURTHER],
    }
}

#[test]
fn parameters_out_of_range_are_named() {
    let mut queues = Queues::new();
    let mut instrument = Instrument::greeted(&mut queues);
    let mut wrong = coefficients();
    wrong.nominal[4] = f64::NAN;
    let mut negative = coefficients();
    negative.nominal[0] = -0.1;
    let mut huge = coefficients();
    huge.nominal[3] = 1e27;
    for (command, parameter) in [
        (
            Command::StartPosition(Position {
                series: 4,
                ..POSITION
            }),
            Parameter::Series,
        ),
        (
            Command::StartPosition(Position {
                dial_deg: f64::INFINITY,
                ..POSITION
            }),
            Parameter::Angle,
        ),
        (Command::SetCoefficients(wrong), Parameter::Coefficients),
        (Command::SetCoefficients(negative), Parameter::Coefficients),
        (Command::SetCoefficients(huge), Parameter::Coefficients),
    ] {
        let said = instrument.ask(command);
        assert_eq!(said, [instrument.refused(Refusal::Parameter(parameter))]);
    }
    assert_eq!(instrument.app.coefficients(), None);
}

#[test]
fn the_modulus_is_about_the_zero_code_of_the_coefficients() {
    let mut queues = Queues::new();
    let mut instrument = Instrument::greeted(&mut queues);
    instrument.ask(Command::SetCoefficients(coefficients()));
    assert!(!instrument.state().compensating);
    instrument.convert(40);
    let said = instrument.listen();
    let [Said::Event(Event::Block(block))] = said.as_slice() else {
        panic!("not one block: {said:?}");
    };
    // 0.1 V/g * 0.003 g / 1.2 V * 2^23
    let zero = 2097;
    assert_eq!(block.moments.zero, [zero, 0, 0, 0]);
    let modulus: u64 = (0..40)
        .map(|n| (codes(n)[0] - zero).unsigned_abs() as u64)
        .sum();
    assert_eq!(block.moments.modulus[0], modulus);
}

fn configuration() -> Certified {
    Configuration {
        compensation: Compensation {
            mode: Some(Mode::Block),
            source: Source::Reference,
            block_samples: 8,
            nominal_v_per_g: 0.1,
            reference_v_per_g: [0.1; 3],
            reference_zero_v: [0.0; 3],
        },
        calibration: Some(Calibration {
            coefficients: coefficients(),
            covariance: Covariance::default(),
            rank: 11,
        }),
    }
    .into()
}

/// Replaces what was written as that.
fn replace(writes: u32, certified: Certified) -> Command {
    Command::Replace {
        writes,
        certified: Some(certified),
    }
}

#[test]
fn a_configuration_holds_from_the_next_sample_on_is_kept_and_is_read_back() {
    let mut queues = Queues::new();
    let mut instrument = Instrument::greeted(&mut queues);
    instrument.convert(5);
    let command = replace(0, configuration());
    let said = instrument.ask(command);
    assert!(said.contains(&instrument.ack(5)), "{said:?}");
    let sequence = instrument.sequence - 1;
    assert!(instrument.state().compensating);

    // The memory is busy until it says how it went.
    let keep = Keep {
        sequence,
        certified: Some(configuration()),
    };
    assert_eq!(instrument.app.keep(), Some(keep));
    assert_eq!(instrument.app.keep(), None);
    let said = instrument.ask(command);
    assert_eq!(said, [instrument.refused(Refusal::Busy)]);
    let kept = Kept {
        writes: 4,
        fault: Some(StoreFault::Verify),
    };
    instrument.app.stored(kept);
    let stored = |sequence| {
        Said::Event(Event::Stored {
            sequence,
            writes: kept.writes,
            fault: kept.fault,
        })
    };
    assert_eq!(instrument.listen(), [stored(sequence)]);

    instrument.convert(8);
    let said = instrument.listen();
    let [
        Said::Event(Event::Block(block)),
        Said::Event(Event::Compensated(freed)),
    ] = said.as_slice()
    else {
        panic!("{said:?}");
    };
    assert_eq!((freed.first_sample, freed.count), (5, 8));
    assert_eq!((block.first_sample, block.count), (5, 8));
    // No vibration to speak of: the mean less the bias.
    let volts = block.moments.sum[0] as f64 / 8.0 * 1.2 / 8_388_608.0;
    assert!((freed.specific_force_g - (volts / 0.1 - 0.003)).abs() < 1e-7);

    let said = instrument.ask(Command::AskConfiguration);
    let asked = instrument.sequence - 1;
    let known = Said::Event(Event::Certified(Some(configuration())));
    assert_eq!(said, [known, stored(asked), instrument.ack(13)]);

    instrument.ask(Command::Replace {
        writes: 4,
        certified: None,
    });
    assert_eq!(instrument.app.keep().map(|keep| keep.certified), Some(None));
    assert!(!instrument.state().compensating);
    assert_eq!(instrument.app.coefficients(), None);
}

#[test]
fn a_configuration_that_cannot_be_is_refused_and_changes_nothing() {
    let mut queues = Queues::new();
    let mut instrument = Instrument::greeted(&mut queues);
    let spoilt: [fn(&mut Configuration, &mut Calibration); 15] = [
        |c, _| c.compensation.block_samples = 3,
        |c, _| c.compensation.nominal_v_per_g = 0.0,
        |c, _| c.compensation.reference_v_per_g[1] = 0.0,
        |c, _| c.compensation.reference_zero_v[2] = f32::NAN,
        // Zero specific force beyond the converter's range.
        |c, _| c.compensation.reference_zero_v[2] = 1.3,
        |_, k| k.rank = 12,
        |_, k| k.covariance = Covariance::from_fn(|_, _| -1.0),
        |_, k| k.coefficients.nominal[0] = 0.0,
        |_, k| k.coefficients.further[4] = f64::NAN,
        // Finite, and of no instrument.
        |_, k| k.coefficients.nominal[3] = 1e27,
        |_, k| k.coefficients.nominal[0] = 1e-300,
        |c, _| c.compensation.nominal_v_per_g = 1e30,
        |c, _| c.compensation.reference_v_per_g[0] = 1e-30,
        |_, k| k.covariance = Covariance::from_fn(|j, k| if j == k { 1e30 } else { 0.0 }),
        // More than two variances allow.
        |_, k| k.covariance = Covariance::from_fn(|j, k| if j == k { 1e-12 } else { 2e-12 }),
    ];
    for spoil in spoilt {
        let mut wrong = configuration();
        let inner = &mut wrong.configuration;
        let mut calibration = inner.calibration.expect("one");
        spoil(inner, &mut calibration);
        inner.calibration = Some(calibration);
        let said = instrument.ask(replace(0, wrong));
        let refusal = Refusal::Parameter(Parameter::Configuration);
        assert_eq!(said, [instrument.refused(refusal)]);
        assert_eq!(instrument.app.keep(), None);
    }
    instrument.ask(Command::StartRun(RUN));
    let said = instrument.ask(replace(0, configuration()));
    assert_eq!(said, [instrument.refused(Refusal::Open(Segment::Run(RUN)))]);
}

#[test]
fn raw_frames_carry_every_sample_and_end_at_a_loss() {
    let mut queues = Queues::new();
    let mut instrument = Instrument::greeted(&mut queues);
    instrument.ask(Command::StreamRaw { on: true });
    instrument.convert(RAW_SAMPLES as u64 + 5);
    // Three conversions are lost.
    instrument.next += 3;
    instrument.convert(2);
    let mut said = instrument.listen();
    said.extend(instrument.ask(Command::StreamRaw { on: false }));
    let (mut lost, mut raw) = (0, Vec::new());
    for said in said {
        match said {
            Said::Raw {
                first_sample,
                samples,
                ..
            } => raw.push((first_sample, samples)),
            Said::Event(Event::Block(block)) => lost += block.lost,
            _ => {}
        }
    }
    let stretch = |range: std::ops::Range<u64>| (range.start, range.map(codes).collect::<Vec<_>>());
    assert_eq!(raw, [stretch(0..32), stretch(32..37), stretch(40..42)]);
    assert_eq!(lost, 3);
    let state = instrument.state();
    assert_eq!((state.conversions, state.samples, state.lost), (42, 39, 3));
}

#[test]
fn what_the_line_cannot_take_is_counted_to_the_sample() {
    let mut queues = Queues::new();
    let mut instrument = Instrument::greeted(&mut queues);
    instrument.ask(Command::StreamRaw { on: true });
    let total = 32 * 40 * 10;
    let (mut raw, mut blocks) = (0, 0);
    let mut hear = |said: Vec<Said>| {
        for said in said {
            match said {
                Said::Raw { samples, .. } => raw += samples.len() as u64,
                Said::Event(Event::Block(block)) => blocks += u64::from(block.count),
                _ => {}
            }
        }
    };
    // The line listens twice, far too seldom.
    for _ in 0..2 {
        instrument.convert(total / 2);
        hear(instrument.listen());
    }
    let state = instrument.state();
    hear(instrument.listen());
    assert_eq!((state.conversions, state.lost), (total, 0));
    assert!(state.dropped_samples > 0);
    assert_eq!(raw + blocks + state.dropped_samples, 2 * total);
}

#[test]
fn orders_are_answered_even_when_the_queue_is_full() {
    let mut queues = Queues::new();
    let mut instrument = Instrument::greeted(&mut queues);
    instrument.convert(40 * 1000);
    instrument.send(Command::StartRun(RUN));
    instrument.obey();
    assert!(instrument.listen().contains(&instrument.ack(40_000)));
}

#[test]
fn a_flood_of_commands_is_refused_by_name_and_the_acquisition_goes_on() {
    let mut queues = Queues::new();
    let mut instrument = Instrument::greeted(&mut queues);
    for _ in 0..1000 {
        instrument.send(Command::AskState);
    }
    instrument.convert(40);
    let said = instrument.listen();
    let count = |wanted: fn(&Said) -> bool| said.iter().filter(|s| wanted(s)).count();
    let busy = count(|s| {
        matches!(
            s,
            Said::Event(Event::Refused {
                reason: Refusal::Busy,
                ..
            })
        )
    });
    let states = count(|s| matches!(s, Said::Event(Event::State(_))));
    let blocks = count(|s| matches!(s, Said::Event(Event::Block(_))));
    assert_eq!((states, blocks), (MAX_ORDERS, 1));
    assert!(busy > 0);
    // Whatever answer did not fit was counted.
    let dropped = instrument.state().dropped_frames as usize;
    assert_eq!(states + busy + dropped, 1000);
}

#[test]
fn garbage_is_counted_and_the_next_command_is_heard() {
    let mut queues = Queues::new();
    let mut instrument = Instrument::greeted(&mut queues);
    let mut random = 1u64;
    for _ in 0..100_000 {
        random ^= random << 13;
        random ^= random >> 7;
        random ^= random << 17;
        instrument.app.receive(&[(random >> 32) as u8]);
    }
    instrument.app.receive(&[0]);
    instrument.listen();
    let said = instrument.ask(Command::StartPosition(POSITION));
    assert_eq!(said, [instrument.ack(0)]);
    assert!(instrument.state().rejected_frames > 100);
}

#[test]
fn a_reading_that_is_being_closed_is_not_overwritten_by_the_next() {
    let mut queues = Queues::new();
    let mut instrument = Instrument::greeted(&mut queues);
    instrument.ask(Command::StartPosition(POSITION));
    instrument.convert(5);
    // Both arrive before the acquisition has carried out the first.
    instrument.send(Command::StopPosition);
    instrument.send(Command::StartPosition(POSITION));
    let said = instrument.listen();
    assert_eq!(said, [instrument.refused(Refusal::Closing)]);
    instrument.obey();
    instrument.listen();
    let said = instrument.ask(Command::StartPosition(POSITION));
    assert_eq!(said, [instrument.ack(5)]);
}

#[test]
fn the_memory_is_not_written_by_who_does_not_know_what_it_holds() {
    let mut queues = Queues::new();
    let mut instrument = Instrument::greeted(&mut queues);
    for unconditional in [
        Command::Configure(configuration().configuration),
        Command::EraseConfiguration,
    ] {
        let said = instrument.ask(unconditional);
        assert_eq!(said, [instrument.refused(Refusal::Unconditional)]);
    }
    let said = instrument.ask(replace(3, configuration()));
    assert_eq!(said, [instrument.refused(Refusal::Writes { writes: 0 })]);
    instrument.app.board().write_protected = true;
    let said = instrument.ask(replace(0, configuration()));
    assert_eq!(said, [instrument.refused(Refusal::Protected)]);
    assert_eq!(instrument.app.keep(), None);
    instrument.app.board().write_protected = false;
    instrument.ask(replace(0, configuration()));
    assert!(instrument.app.keep().is_some());
}

#[test]
fn a_configuration_says_whose_it_is_and_which_firmware_accepted_it() {
    let mut queues = Queues::new();
    let mut instrument = Instrument::greeted(&mut queues);
    let provenance = Provenance {
        serial: Name::new("V00007").expect("a name"),
        date: Date {
            year: 2026,
            month: 2,
            day: 28,
        },
        campaign: [7; 32],
        temperature_c: Some([15.0, 35.0]),
        accepted_by: None,
    };
    let certified = Certified {
        provenance: Some(provenance),
        ..configuration()
    };
    instrument.ask(replace(0, certified));
    let kept = instrument.app.keep().and_then(|keep| keep.certified);
    let kept = kept.and_then(|kept| kept.provenance).expect("one");
    assert_eq!(kept.accepted_by, Some(IDENTITY.firmware));
    assert_eq!(
        (kept.serial.as_str(), kept.date),
        ("V00007", provenance.date)
    );

    let mut nameless = certified;
    nameless.provenance = Some(Provenance {
        date: Date {
            month: 13,
            ..provenance.date
        },
        ..provenance
    });
    instrument.app.stored(Kept::default());
    instrument.listen();
    let said = instrument.ask(replace(0, nameless));
    let refusal = Refusal::Parameter(Parameter::Configuration);
    assert_eq!(said, [instrument.refused(refusal)]);
    // A drift a kelvin counts from somewhere.
    let mut nowhere = configuration();
    nowhere.errors.bias_g_per_k = 1e-6;
    let said = instrument.ask(replace(0, nowhere));
    assert_eq!(said, [instrument.refused(refusal)]);
}

#[test]
fn every_block_says_which_time_it_is_for() {
    let mut queues = Queues::new();
    let mut instrument = Instrument::greeted(&mut queues);
    instrument.sampler.set_delay(374.6);
    instrument.sampler.set_around(Around {
        board_c: Some(31.5),
        instrument_c: None,
        time_base_unsure: false,
    });
    instrument.convert(u64::from(BLOCK));
    instrument.sampler.set_pulse(Pulse {
        count: 3,
        time_us: 12_345,
    });
    instrument.convert(u64::from(BLOCK));
    instrument.listen();
    let [first, second] = instrument.conditions[..] else {
        panic!("{:?}", instrument.conditions);
    };
    assert_eq!(
        (first.first_sample, first.first_us, first.last_us),
        (0, 0, 39 * 250)
    );
    assert_eq!((second.first_sample, second.first_us), (40, 40 * 250));
    assert_eq!(
        (first.pulse, second.pulse.map(|p| p.count)),
        (None, Some(3))
    );
    assert_eq!((second.delay_us, second.board_c), (374.6, Some(31.5)));
    assert_eq!(second.sigma_g, None);
}
