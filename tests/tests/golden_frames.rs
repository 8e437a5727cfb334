//! The bytes of every message, in a frame of the protocol's version that it came with, as they went out once and for all. If this test fails, the code is
//! wrong: instruments in the field and records on disk speak these bytes. A new message gets a new line; no line is ever
//! changed while `version::MINIMUM` is at its version.

use shared::compensate::{Mode, Quality, Source, StatedErrors};
use shared::identify::static_test::Bench;
use shared::rectification::Covariance;
use shared::self_check::{Outcome, SetUp, Verdict, Verdicts};
use shared::wire::board::{BlockConditions, BoardState, Cause, FILE_NAME, Place, Pulse, TimeBase};
use shared::wire::configuration::{
    Calibration, Certified, Compensation, Configuration, Date, Name, Provenance,
};
use shared::wire::framing::{Frame, Packet};
use shared::wire::message::{
    Approach, Block, Coefficients, Command, CompensatedBlock, Event, Fault, Identity, Moments,
    Parameter, Plateau, Position, Raw, Refusal, Run, Segment, State, StoreFault,
};
use shared::wire::version::Version;

const GOLDEN: &str = include_str!("golden_frames.txt");

fn hex(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| format!("{byte:02x}")).collect()
}

const POSITION: Position = Position {
    reading: 300,
    series: 2,
    dial_deg: 22.5,
    mount_deg: 180.0,
    approach: Approach::Ccw,
};

const RUN: Run = Run {
    run: 7,
    plateau: Plateau::During,
};

const COEFFICIENTS: Coefficients = Coefficients {
    nominal: [
        1.25, 1e-4, -6e-4, 4e-4, 3e-4, -5e-5, 4e-4, -6e-4, -5e-5, 3e-6, 5e-5,
    ],
    further: [7e-6, 2e-4, -3e-4, 1e-4, -8e-5],
};

const COMPENSATION: Compensation = Compensation {
    mode: Some(Mode::Pointwise),
    source: Source::Instrument,
    block_samples: 400,
    nominal_v_per_g: 0.12,
    reference_v_per_g: [0.1, -0.2, 0.3],
    reference_zero_v: [0.0, 1e-3, -2e-3],
};

/// Every number of the covariance another one.
fn configuration() -> Configuration {
    let covariance = Covariance::from_fn(|j, k| (1 + j * 12 + k) as f32 * 1e-12);
    Configuration {
        compensation: COMPENSATION,
        calibration: Some(Calibration {
            coefficients: COEFFICIENTS,
            covariance,
            rank: 10,
        }),
    }
}

fn commands() -> Vec<(&'static str, Command)> {
    let set_up = SetUp {
        bench: Bench {
            dial_sigma_rad: 2.8e-5,
            dial_repeat_sigma_rad: 1e-6,
            mount_sigma_rad: 3e-4,
            level_sigma_rad: 5e-6,
            local_gravity_g: 0.998,
        },
        nominal_v_per_g: 0.12,
        reference_v_per_g: Some([0.1, 0.2, 0.3]),
    };
    vec![
        (
            "command-hello",
            Command::Hello {
                version: Version(1),
            },
        ),
        ("command-start-position", Command::StartPosition(POSITION)),
        ("command-stop-position", Command::StopPosition),
        ("command-start-run", Command::StartRun(RUN)),
        ("command-stop-run", Command::StopRun),
        ("command-stream-raw", Command::StreamRaw { on: true }),
        (
            "command-set-coefficients",
            Command::SetCoefficients(COEFFICIENTS),
        ),
        ("command-ask-state", Command::AskState),
        ("command-begin-check", Command::BeginCheck(set_up)),
        ("command-conclude", Command::Conclude),
        ("command-configure", Command::Configure(configuration())),
        ("command-erase-configuration", Command::EraseConfiguration),
        ("command-ask-configuration", Command::AskConfiguration),
        (
            "command-replace",
            Command::Replace {
                writes: 300,
                certified: Some(certified()),
            },
        ),
        (
            "command-replace-by-nothing",
            Command::Replace {
                writes: 0,
                certified: None,
            },
        ),
    ]
}

/// Every number another one.
fn certified() -> Certified {
    Certified {
        configuration: configuration(),
        provenance: Some(Provenance {
            serial: Name::new("V00007").expect("a name"),
            date: Date {
                year: 2026,
                month: 2,
                day: 28,
            },
            campaign: std::array::from_fn(|k| 200 + k as u8),
            temperature_c: Some([-40.0, 71.5]),
            accepted_by: Some([1, 2, 3]),
        }),
        errors: StatedErrors {
            scale_factor_per_k: 1e-6,
            scale_factor_drift: 2e-6,
            bias_g_per_k: 3e-6,
            bias_drift_g: 4e-6,
            converter_nonlinearity: 5e-6,
        },
    }
}

fn events() -> Vec<(&'static str, Event<'static>)> {
    let identity = Identity {
        minimum: Version(1),
        current: Version(1),
        firmware: [0, 1, 2],
        serial: *b"V00001-test!",
        sample_rate_hz: 4000.0,
        reference_v: 1.2,
        gains: [1, 2, 4, 128],
        block_samples: 40,
    };
    let moments = Moments {
        sum: [-5_000_000_000, 1, 0, 300],
        second: [1.5, 2.0, 0.0, 3e10],
        third: [-1.0, 0.0, 0.0, 1e-3],
        fourth: [4.0, 5.0, 0.0, 1e20],
        cross: [0.5, -0.5, 0.0, 1.0, -1.0, 2.0],
        minimum: [-8_388_608, -1, 0, 1],
        maximum: [8_388_607, 1, 0, 200],
        zero: [-42, 0, 0, 0],
        modulus: [5_000_000_042, 1, 0, 300],
    };
    let block = Block {
        segment: Segment::Run(RUN),
        first_sample: 1 << 40,
        count: 39,
        lost: 1,
        moments,
    };
    let state = State {
        segment: Segment::Reading(300),
        streaming: true,
        compensating: false,
        clock_us: 123_456_789_012,
        conversions: 500_000,
        samples: 499_990,
        lost: 10,
        dropped_frames: 3,
        dropped_samples: 96,
        converter_checksum_errors: 2,
        converter_resets: 1,
        rejected_frames: 4,
        last_fault: Some(Fault::Register {
            address: 3,
            written: 0x0f0e,
            read: 0x0f00,
        }),
    };
    const CODES: [u8; 24] = [
        0, 0, 128, 1, 0, 128, 255, 255, 127, 0, 0, 0, 255, 255, 255, 0, 1, 2, 3, 4, 5, 6, 7, 8,
    ];
    let raw = Raw {
        segment: Segment::Idle,
        first_sample: 129,
        codes: &CODES,
    };
    let mut events = vec![
        ("event-hello", Event::Hello(identity)),
        (
            "event-ack",
            Event::Ack {
                sequence: 513,
                sample: 70_000,
            },
        ),
        ("event-block", Event::Block(block)),
        ("event-raw", Event::Raw(raw)),
        ("event-state", Event::State(state)),
    ];
    let refusals = [
        (
            "refused-version",
            Refusal::Version {
                minimum: Version(1),
                current: Version(1),
            },
        ),
        ("refused-no-hello", Refusal::NoHello),
        ("refused-open", Refusal::Open(Segment::Reading(300))),
        ("refused-not-open", Refusal::NotOpen),
        ("refused-series", Refusal::Parameter(Parameter::Series)),
        ("refused-angle", Refusal::Parameter(Parameter::Angle)),
        (
            "refused-coefficients",
            Refusal::Parameter(Parameter::Coefficients),
        ),
        ("refused-busy", Refusal::Busy),
    ];
    events.extend(refusals.map(|(name, reason)| {
        (
            name,
            Event::Refused {
                sequence: 9,
                reason,
            },
        )
    }));
    let faults = [
        ("fault-bus", Fault::Bus),
        ("fault-drdy-timeout", Fault::DrdyTimeout { waited_us: 1500 }),
        (
            "fault-checksum",
            Fault::Checksum {
                sent: 0x1234,
                computed: 0xfedc,
            },
        ),
        (
            "fault-identification",
            Fault::Identification { read: 0x2300 },
        ),
        (
            "fault-register",
            Fault::Register {
                address: 3,
                written: 0x0f0e,
                read: 0x0f00,
            },
        ),
        (
            "fault-acknowledge",
            Fault::Acknowledge {
                expected: 0xff24,
                read: 0xff22,
            },
        ),
        ("fault-status", Fault::Status { read: 0x0500 }),
        ("fault-overrun", Fault::Overrun { lost: 77 }),
        ("fault-no-data", Fault::NoData),
    ];
    events.extend(faults.map(|(name, fault)| {
        (
            name,
            Event::Fault {
                sample: 1000,
                fault,
            },
        )
    }));
    let outcome = Outcome {
        readings: 80,
        rank: 11,
        coefficients: [
            1.25, 1e-4, -6e-4, 4e-4, 3e-4, -5e-5, 4e-4, -6e-4, -5e-5, 3e-6, 5e-5,
        ],
        sigma: [1e-6; 11],
        chi2: 68.5,
        degrees_of_freedom: 69,
        noise_g: 1.5e-6,
        reference_g: 0.0,
        lost: 3,
        verdicts: Verdicts(Verdict::Blind as u16 | Verdict::Changed as u16),
    };
    events.push(("event-check", Event::Check(outcome)));
    let later = [
        ("refused-no-check", Refusal::NoCheck),
        ("refused-set-up", Refusal::Parameter(Parameter::SetUp)),
    ];
    events.extend(later.map(|(name, reason)| {
        let sequence = 9;
        (name, Event::Refused { sequence, reason })
    }));
    events.extend(compensation_events());
    events.extend(board_events());
    events
}

fn board_events() -> Vec<(&'static str, Event<'static>)> {
    let mut file = [0; FILE_NAME];
    file[..6].copy_from_slice(b"app.rs");
    let pulse = Pulse {
        count: 300,
        time_us: 1 << 40,
    };
    let board = |cause| BoardState {
        boots: 300,
        cause,
        time_base: TimeBase::Internal,
        brown_out_guarded: true,
        write_protected: false,
        board_c: Some(31.5),
        instrument_c: None,
        stack_free: Some(70_000),
        line_errors: 1,
        line_timeouts: 2,
        checksum_set_ups: 3,
        pulse: Some(pulse),
    };
    let conditions = BlockConditions {
        first_sample: 1 << 40,
        first_us: 1 << 41,
        last_us: (1 << 41) + 9750,
        delay_us: 374.6,
        pulse: Some(pulse),
        board_c: Some(31.5),
        instrument_c: Some(30.0),
        sigma_g: Some(2e-5),
    };
    let causes = [
        ("board-power", Cause::Power),
        ("board-pin", Cause::Pin),
        ("board-brown-out", Cause::BrownOut),
        ("board-watchdog", Cause::Watchdog),
        ("board-software", Cause::Software),
        ("board-panic", Cause::Panic(Place { line: 300, file })),
        (
            "board-hard-fault",
            Cause::HardFault {
                address: 0x0800_1234,
            },
        ),
        ("board-clock-lost", Cause::ClockLost),
    ];
    let refusals = [
        ("refused-closing", Refusal::Closing),
        ("refused-unconditional", Refusal::Unconditional),
        ("refused-writes", Refusal::Writes { writes: 300 }),
        ("refused-protected", Refusal::Protected),
    ];
    let mut events: Vec<_> = causes
        .into_iter()
        .map(|(name, cause)| (name, Event::Board(board(cause))))
        .collect();
    events.extend(refusals.map(|(name, reason)| {
        let sequence = 9;
        (name, Event::Refused { sequence, reason })
    }));
    events.extend([
        ("event-conditions", Event::Conditions(conditions)),
        ("event-certified", Event::Certified(Some(certified()))),
        ("event-certified-none", Event::Certified(None)),
    ]);
    let clock_hz = 16_384_000;
    let fault = Fault::Clock { clock_hz };
    events.push((
        "fault-clock",
        Event::Fault {
            sample: 1000,
            fault,
        },
    ));
    events
}

fn compensation_events() -> Vec<(&'static str, Event<'static>)> {
    let block = CompensatedBlock {
        segment: Segment::Idle,
        first_sample: 1 << 40,
        count: 39,
        lost: 1,
        specific_force_g: -0.999_999_9,
        vre_g: 1e-4,
        vre_sigma_g: f32::INFINITY,
        quality: Quality(Quality::COEFFICIENTS_MISSING | Quality::OUT_OF_BAND),
    };
    let without = Configuration {
        compensation: Compensation {
            mode: None,
            ..COMPENSATION
        },
        calibration: None,
    };
    let stored = |writes, fault| Event::Stored {
        sequence: 513,
        writes,
        fault,
    };
    let refused = Refusal::Parameter(Parameter::Configuration);
    vec![
        ("event-compensated", Event::Compensated(block)),
        (
            "event-configuration",
            Event::Configuration(Some(configuration())),
        ),
        (
            "event-configuration-off",
            Event::Configuration(Some(without)),
        ),
        ("event-no-configuration", Event::Configuration(None)),
        ("event-stored", stored(3, None)),
        ("stored-flash", stored(0, Some(StoreFault::Flash))),
        ("stored-verify", stored(70_000, Some(StoreFault::Verify))),
        ("stored-corrupt", stored(0, Some(StoreFault::Corrupt))),
        ("stored-version", stored(0, Some(StoreFault::Version))),
        (
            "refused-configuration",
            Event::Refused {
                sequence: 9,
                reason: refused,
            },
        ),
    ]
}

/// The frozen bytes of a message.
fn golden(name: &str) -> Vec<u8> {
    let line = GOLDEN
        .lines()
        .find_map(|line| line.strip_prefix(name)?.strip_prefix(' '));
    let text = line.unwrap_or_else(|| panic!("no frozen bytes of {name}"));
    (0..text.len())
        .step_by(2)
        .map(|k| u8::from_str_radix(&text[k..k + 2], 16).expect("hexadecimal"))
        .collect()
}

#[test]
fn every_message_is_sent_as_it_was_frozen() {
    let mut frame = Frame::new();
    for (sequence, (name, command)) in commands().into_iter().enumerate() {
        frame.encode(&command, sequence as u16).unwrap();
        assert_eq!(hex(frame.as_bytes()), hex(&golden(name)), "{name}");
    }
    for (sequence, (name, event)) in events().into_iter().enumerate() {
        frame.encode(&event, 0x1200 + sequence as u16).unwrap();
        assert_eq!(hex(frame.as_bytes()), hex(&golden(name)), "{name}");
    }
}

#[test]
fn every_frozen_frame_is_still_understood() {
    for (name, command) in commands() {
        let mut bytes = golden(name);
        let end = bytes.len() - 1;
        let packet = Packet::open(&mut bytes[..end]).unwrap();
        assert_eq!(packet.message::<Command>().unwrap(), command, "{name}");
    }
    for (name, event) in events() {
        let mut bytes = golden(name);
        let end = bytes.len() - 1;
        let packet = Packet::open(&mut bytes[..end]).unwrap();
        assert_eq!(packet.message::<Event<'_>>().unwrap(), event, "{name}");
    }
}
