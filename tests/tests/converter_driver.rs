//! The acquisition's transactions with the converter, byte by byte, and what each trouble becomes.

use std::cell::{Cell, RefCell};
use std::collections::VecDeque;
use std::convert::Infallible;
use std::future::pending;
use std::rc::Rc;

use embassy_futures::block_on;
use embedded_hal::digital::ErrorType;
use embedded_hal_async::delay::DelayNs;
use embedded_hal_async::digital::Wait;
use embedded_hal_mock::eh1::digital::{
    Mock as PinMock, State as PinState, Transaction as PinTransaction,
};
use embedded_hal_mock::eh1::spi::{Mock as SpiMock, Transaction as SpiTransaction};
use firmware::adc::bus::HalBus;
use firmware::adc::count::{Edge, Timers};
use firmware::adc::registers::{Config, Register, Status};
use firmware::adc::{Ads131m04, Error, Reset};

const PERIOD_US: u64 = 250;

/// CRC-16/CCITT bit by bit, from its definition.
fn crc16(bytes: &[u8]) -> u16 {
    bytes.iter().fold(0xFFFF, |sum, &byte| {
        (0..8).fold(sum ^ u16::from(byte) << 8, |sum, _| {
            (sum << 1) ^ if sum & 0x8000 != 0 { 0x1021 } else { 0 }
        })
    })
}

/// A frame of 24-bit words whose upper 16 bits are given, then their checksum, then zeros.
fn to_converter(words: &[u16]) -> Vec<u8> {
    let mut bytes: Vec<u8> = words
        .iter()
        .flat_map(|word| [(word >> 8) as u8, *word as u8, 0])
        .collect();
    bytes.extend(crc16(&bytes).to_be_bytes());
    bytes.resize(18, 0);
    bytes
}

fn from_converter(word: u16, codes: [i32; 4]) -> Vec<u8> {
    let mut bytes = vec![(word >> 8) as u8, word as u8, 0];
    for code in codes {
        bytes.extend(&code.to_be_bytes()[1..]);
    }
    bytes.extend(crc16(&bytes).to_be_bytes());
    bytes.push(0);
    bytes
}

type Script = Vec<(Vec<u8>, Vec<u8>)>;

const NULL: &[u16] = &[0x0000];
const AFTER_RESET: u16 = 0x0500;
const SET_UP: u16 = 0x0100;
const READY: u16 = 0x810F;
const EMPTY: u16 = 0x8100;
const CHANGED: u16 = 0xA10F;
const CODES: [i32; 4] = [1, -2, 8_388_607, -8_388_608];

/// Everything up to the settings: 0xFF24 after a reset, then register ID.
fn identify(id: u16) -> Script {
    vec![
        (to_converter(NULL), from_converter(0xFF24, [0; 4])),
        (to_converter(&[0xA000]), from_converter(AFTER_RESET, [0; 4])),
        (to_converter(NULL), from_converter(id, [0; 4])),
    ]
}

/// Writes registers and reads them back; each one's content comes with the frame that writes the next.
fn writes(registers: &[(u16, u16)]) -> Script {
    let mut script = Vec::new();
    let mut before = SET_UP;
    for &(address, value) in registers {
        let address = address << 7;
        script.push((
            to_converter(&[0x6000 | address, value]),
            from_converter(before, [0; 4]),
        ));
        script.push((
            to_converter(&[0xA000 | address]),
            from_converter(0x4000 | address, [0; 4]),
        ));
        before = value;
    }
    script.push((to_converter(NULL), from_converter(before, [0; 4])));
    script
}

/// Every register, at 4 kSPS and gain 1: but for MODE as after a reset.
const REGISTERS: [(u16, u16); 26] = {
    let mut registers = [(0, 0); 26];
    let head = [
        (2, 0x3110),
        (3, 0x0F0E),
        (4, 0x0000),
        (6, 0x0600),
        (7, 0x0000),
        (8, 0x0000),
    ];
    let mut k = 0;
    while k < registers.len() {
        registers[k] = if k < head.len() {
            head[k]
        } else {
            // Of each channel's five the fourth is the gain calibration.
            let place = (k - head.len()) % 5;
            (k as u16 + 3, if place == 3 { 0x8000 } else { 0 })
        };
        k += 1;
    }
    registers
};

fn read(status: u16, codes: [i32; 4]) -> (Vec<u8>, Vec<u8>) {
    (to_converter(NULL), from_converter(status, codes))
}

/// The whole set-up at 4 kSPS and gain 1.
fn set_up() -> Script {
    let mut script = identify(0x2401);
    script.extend(writes(&REGISTERS));
    script.push((to_converter(&[0x0555]), from_converter(SET_UP, [0; 4])));
    script.push((to_converter(NULL), from_converter(0x0555, [0; 4])));
    // The register map changed by being written; then what the converter still holds.
    let statuses = [CHANGED, READY, READY, EMPTY, READY];
    script.extend(statuses.map(|status| read(status, [7; 4])));
    script
}

/// What DRDY does at a wait.
#[derive(Clone, Copy)]
enum Drdy {
    /// It falls so often, a period after the other.
    Edges(u32),
    /// It is low, and no edge came.
    Low,
    /// It does not fall.
    Never,
}

#[derive(Clone, Default)]
struct Pins(Rc<World>);

#[derive(Default)]
struct World {
    now_us: Cell<u64>,
    /// How often DRDY falls; 0 stands for [`PERIOD_US`].
    period_us: Cell<u64>,
    edge: Cell<Edge>,
    waits: RefCell<VecDeque<Drdy>>,
}

impl ErrorType for Pins {
    type Error = Infallible;
}

impl Wait for Pins {
    async fn wait_for_low(&mut self) -> Result<(), Infallible> {
        let wait = self.0.waits.borrow_mut().pop_front();
        match wait.unwrap_or(Drdy::Edges(1)) {
            Drdy::Edges(edges) => {
                let passed = PERIOD_US * u64::from(edges);
                let time_us = self.0.now_us.get() + passed;
                self.0.now_us.set(time_us);
                let count = self.0.edge.get().count + edges;
                self.0.edge.set(Edge { count, time_us });
            }
            Drdy::Low => {}
            Drdy::Never => pending().await,
        }
        Ok(())
    }
    async fn wait_for_high(&mut self) -> Result<(), Infallible> {
        pending().await
    }
    async fn wait_for_rising_edge(&mut self) -> Result<(), Infallible> {
        pending().await
    }
    async fn wait_for_falling_edge(&mut self) -> Result<(), Infallible> {
        pending().await
    }
    async fn wait_for_any_edge(&mut self) -> Result<(), Infallible> {
        pending().await
    }
}

impl DelayNs for Pins {
    async fn delay_ns(&mut self, ns: u32) {
        let (now_us, passed_us) = (self.0.now_us.get(), u64::from(ns / 1000));
        self.0.now_us.set(now_us + passed_us);
        let period_us = match self.0.period_us.get() {
            0 => PERIOD_US,
            other => other,
        };
        let edges = passed_us / period_us;
        if edges > 0 {
            self.0.edge.set(Edge {
                count: self.0.edge.get().count + edges as u32,
                time_us: now_us + edges * period_us,
            });
        }
    }
}

impl Timers for Pins {
    fn edge(&mut self) -> Edge {
        self.0.edge.get()
    }
    fn now_us(&mut self) -> u64 {
        self.0.now_us.get()
    }
}

type Driver = Ads131m04<HalBus<SpiMock<u8>, Pins, Pins, Pins>, PinMock>;

/// Runs `body` with a driver whose transactions have to be those of `script`, no more and no fewer.
fn with_driver(script: Script, resets: usize, body: impl AsyncFnOnce(&mut Driver, &World)) {
    with_config(Config::default(), script, resets, body);
}

fn with_config(
    config: Config,
    script: Script,
    resets: usize,
    body: impl AsyncFnOnce(&mut Driver, &World),
) {
    let transactions: Vec<_> = script
        .into_iter()
        .flat_map(|(sent, answered)| {
            [
                SpiTransaction::transaction_start(),
                SpiTransaction::transfer(sent, answered),
                SpiTransaction::transaction_end(),
            ]
        })
        .collect();
    let mut spi = SpiMock::new(&transactions);
    let pulses = [PinState::Low, PinState::High].repeat(resets);
    let pulses: Vec<_> = pulses.into_iter().map(PinTransaction::set).collect();
    let mut reset = PinMock::new(&pulses);
    let pins = Pins::default();
    let mut driver = Ads131m04::new(
        spi.clone(),
        pins.clone(),
        reset.clone(),
        pins.clone(),
        pins.clone(),
        config,
    );
    block_on(body(&mut driver, &pins.0));
    spi.done();
    reset.done();
}

fn set_up_then(more: Script) -> Script {
    let mut script = set_up();
    script.extend(more);
    script
}

fn waits(world: &World, waits: &[Drdy]) {
    world.waits.borrow_mut().extend(waits);
}

#[test]
fn reset_set_up_and_read_are_these_transactions() {
    let script = set_up_then(vec![read(READY, CODES), read(READY, [0; 4])]);
    with_driver(script, 1, async |driver, _| {
        driver.initialise(Reset::Pin).await.expect("set up");
        let first = driver.next().await.expect("sound");
        assert_eq!((first.index, first.codes), (0, CODES));
        let second = driver.next().await.expect("sound");
        assert_eq!((second.index, second.codes), (1, [0; 4]));
        assert_eq!(second.time_us - first.time_us, PERIOD_US);
    });
}

#[test]
fn reset_by_command_unlocks_first() {
    let mut script = vec![
        (to_converter(&[0x0655]), from_converter(READY, [0; 4])),
        (to_converter(&[0x0011]), from_converter(0x0655, [0; 4])),
    ];
    script.extend(set_up());
    with_driver(script, 0, async |driver, _| {
        driver.initialise(Reset::Command).await.expect("set up");
    });
}

#[test]
fn another_device_is_named_by_its_identification() {
    with_driver(identify(0x2801), 1, async |driver, _| {
        let error = driver.initialise(Reset::Pin).await;
        assert_eq!(error, Err(Error::Identification { read: 0x2801 }));
    });
}

#[test]
fn a_converter_that_was_not_reset_is_not_believed() {
    let script = vec![(to_converter(NULL), from_converter(READY, [0; 4]))];
    with_driver(script, 1, async |driver, _| {
        let (expected, read) = (0xFF24, READY);
        let error = driver.initialise(Reset::Pin).await;
        assert_eq!(error, Err(Error::Acknowledge { expected, read }));
    });
}

#[test]
fn a_register_that_does_not_hold_its_value_is_named() {
    let mut script = identify(0x2401);
    script.extend(writes(&[(2, 0x3110), (3, 0x0F0E)]));
    script.pop();
    // The content of CLOCK comes with the frame that writes GAIN1.
    script.push((
        to_converter(&[0x6200, 0x0000]),
        from_converter(0x0F0A, [0; 4]),
    ));
    with_driver(script, 1, async |driver, _| {
        let error = driver.initialise(Reset::Pin).await;
        let (register, written, read) = (Register::Clock, 0x0F0E, 0x0F0A);
        assert_eq!(
            error,
            Err(Error::Register {
                register,
                written,
                read
            })
        );
    });
}

#[test]
fn a_register_map_that_goes_on_changing_is_not_believed() {
    let mut script = set_up();
    script.truncate(script.len() - 4);
    script.push(read(CHANGED, [7; 4]));
    with_driver(script, 1, async |driver, _| {
        let error = driver.initialise(Reset::Pin).await;
        assert_eq!(error, Err(Error::Status(Status(CHANGED))));
    });
}

#[test]
fn a_clock_that_the_data_sheet_does_not_allow_is_refused_before_a_reset() {
    for (clock_hz, allowed) in [(299_999, false), (8_400_000, true), (16_384_000, false)] {
        let config = Config {
            clock_hz,
            ..Config::default()
        };
        assert_eq!(config.settings().check().is_ok(), allowed);
        if !allowed {
            with_config(config, vec![], 0, async |driver, _| {
                let error = driver.initialise(Reset::Pin).await;
                assert_eq!(error, Err(Error::Clock { clock_hz }));
            });
        }
    }
}

#[test]
fn a_beat_that_no_allowed_clock_makes_is_refused_by_that_clock() {
    let mut script = set_up();
    script.truncate(script.len() - 5);
    with_driver(script, 1, async |driver, world| {
        // 8 kSPS in place of 4: a clock of 16.384 MHz.
        world.period_us.set(PERIOD_US / 2);
        let error = driver.initialise(Reset::Pin).await;
        let clock_hz = 16_384_000;
        assert_eq!(error, Err(Error::Clock { clock_hz }));
    });
}

#[test]
fn a_wrong_checksum_costs_one_conversion_and_the_next_is_not_mistaken_for_it() {
    let (sent, mut damaged) = read(READY, [10; 4]);
    damaged[5] ^= 0x20;
    let script = set_up_then(vec![
        read(READY, [9; 4]),
        (sent, damaged),
        // The converter may still hold the one that failed.
        read(READY, [10; 4]),
        read(READY, [11; 4]),
        read(READY, [12; 4]),
    ]);
    with_driver(script, 1, async |driver, _| {
        driver.initialise(Reset::Pin).await.expect("set up");
        driver.next().await.expect("sound");
        let Err(error @ Error::Checksum(_)) = driver.next().await else {
            panic!("the damage was not noticed");
        };
        assert!(!error.needs_initialise());
        let third = driver.next().await.expect("sound");
        assert_eq!((third.index, third.codes), (2, [11; 4]));
        let fourth = driver.next().await.expect("sound");
        assert_eq!((fourth.index, fourth.codes), (3, [12; 4]));
    });
}

#[test]
fn drdy_that_stays_high_is_a_timeout() {
    with_driver(set_up(), 1, async |driver, world| {
        driver.initialise(Reset::Pin).await.expect("set up");
        waits(world, &[Drdy::Never]);
        let error = driver.next().await.expect_err("no conversion");
        assert_eq!(error, Error::DrdyTimeout { waited_us: 5000 });
        assert!(error.needs_initialise());
    });
}

#[test]
fn drdy_that_stays_low_is_a_timeout_after_twenty_periods() {
    let nothing = || read(EMPTY, [0; 4]);
    let script = set_up_then((0..41).map(|_| nothing()).collect());
    with_driver(script, 1, async |driver, world| {
        driver.initialise(Reset::Pin).await.expect("set up");
        let began_us = world.now_us.get();
        for _ in 0..40 {
            waits(world, &[Drdy::Low]);
            assert_eq!(driver.next().await, Err(Error::NoData));
        }
        waits(world, &[Drdy::Low]);
        let error = driver.next().await;
        assert_eq!(error, Err(Error::DrdyTimeout { waited_us: 5000 }));
        assert_eq!(world.now_us.get() - began_us, 5125);
    });
}

#[test]
fn conversions_that_were_not_read_in_time_are_counted_by_their_edges() {
    let script = set_up_then(vec![
        read(READY, [1; 4]),
        // Whatever the converter kept is thrown away.
        read(READY, [2; 4]),
        read(READY, [6; 4]),
        read(EMPTY, [6; 4]),
        read(READY, [7; 4]),
    ]);
    with_driver(script, 1, async |driver, world| {
        driver.initialise(Reset::Pin).await.expect("set up");
        driver.next().await.expect("sound");
        waits(world, &[Drdy::Edges(5)]);
        assert_eq!(driver.next().await, Err(Error::Overrun { lost: 5 }));
        let after = driver.next().await.expect("sound");
        assert_eq!((after.index, after.codes), (6, [7; 4]));
    });
}

#[test]
fn a_conversion_without_an_edge_is_counted_by_the_time_of_the_next() {
    let script = set_up_then(vec![
        read(READY, [1; 4]),
        // It ended while the one before went over the bus.
        read(READY, [2; 4]),
        read(EMPTY, [2; 4]),
        read(READY, [3; 4]),
    ]);
    with_driver(script, 1, async |driver, world| {
        driver.initialise(Reset::Pin).await.expect("set up");
        driver.next().await.expect("sound");
        world.now_us.set(world.now_us.get() + PERIOD_US);
        waits(world, &[Drdy::Low, Drdy::Edges(1)]);
        assert_eq!(driver.next().await, Err(Error::Overrun { lost: 1 }));
        let after = driver.next().await.expect("sound");
        assert_eq!((after.index, after.codes), (2, [3; 4]));
    });
}

#[test]
fn a_converter_reset_by_something_else_is_noticed_and_set_up_anew() {
    let mut script = set_up_then(vec![read(READY, [1; 4]), read(0x050F, [2; 4])]);
    script.extend(set_up_then(vec![read(READY, [3; 4])]));
    with_driver(script, 2, async |driver, _| {
        driver.initialise(Reset::Pin).await.expect("set up");
        driver.next().await.expect("sound");
        let error = driver.next().await.expect_err("the flag is set");
        assert_eq!(error, Error::Status(Status(0x050F)));
        assert!(error.needs_initialise());
        driver.initialise(Reset::Pin).await.expect("set up again");
        let after = driver.next().await.expect("sound");
        // One failed; the reset's 312 + 10 microseconds, ten periods and one are twelve.
        assert_eq!((after.index, after.codes), (14, [3; 4]));
    });
}
