//! Every transaction byte by byte, against frames made here from the data sheets, with both drivers.

use core::future::Future;
use core::pin::pin;
use core::task::{Context, Poll, Waker};

use ads131m0x::{
    Channel, ChannelCfg, ChecksumError, ChopDelay, Command, CurrentDetect, DcBlock, DetectCount,
    DetectLength, DrdySource, Error, Format, Gain, GainCalibration, Identification, Input, Mode,
    Offset, Oversampling, Phase, Polynomial, PowerMode, Register, Settings, SettingsError, Status,
    WordLength, asynchronous, blocking,
};
use embedded_hal_mock::eh1::delay::{CheckedDelay, NoopDelay, Transaction as DelayTransaction};
use embedded_hal_mock::eh1::digital::{
    Mock as PinMock, State as PinState, Transaction as PinTransaction,
};
use embedded_hal_mock::eh1::spi::{Mock as SpiMock, Transaction as SpiTransaction};

/// Nothing here waits for long.
fn block_on<F: Future>(future: F) -> F::Output {
    let mut future = pin!(future);
    loop {
        let polled = future
            .as_mut()
            .poll(&mut Context::from_waker(Waker::noop()));
        if let Poll::Ready(output) = polled {
            return output;
        }
    }
}

/// CRC bit by bit, from its definition.
fn crc16(bytes: &[u8], polynomial: Polynomial) -> u16 {
    let taps = match polynomial {
        Polynomial::Ccitt => 0x1021,
        Polynomial::Ansi => 0x8005,
    };
    bytes.iter().fold(0xFFFF, |sum, &byte| {
        (0..8).fold(sum ^ u16::from(byte) << 8, |sum, _| {
            (sum << 1) ^ if sum & 0x8000 != 0 { taps } else { 0 }
        })
    })
}

/// A word of 16 bits in one of the converter's.
fn word(value: u16, length: WordLength) -> Vec<u8> {
    let mut word = value.to_be_bytes().to_vec();
    word.resize(length.bytes(), 0);
    word
}

/// A code as the data sheets draw it in each length (section 8.5.1.9).
fn code(value: i32, length: WordLength) -> Vec<u8> {
    let [sign, a, b, c] = value.to_be_bytes();
    match length {
        WordLength::Bits16 => vec![a, b],
        WordLength::Bits24 => vec![a, b, c],
        WordLength::Bits32ZeroPadded => vec![a, b, c, 0],
        WordLength::Bits32SignExtended => vec![sign, a, b, c],
    }
}

/// The conversations of a converter with so many channels.
#[derive(Clone, Copy)]
struct Bus {
    channels: usize,
    format: Format,
}

type Script = Vec<(Vec<u8>, Vec<u8>)>;

impl Bus {
    const fn reset(channels: usize) -> Self {
        Self {
            channels,
            format: Format::RESET,
        }
    }

    fn sent(self, words: &[u16]) -> Vec<u8> {
        let Format {
            word_length,
            polynomial,
        } = self.format;
        let mut frame: Vec<u8> = words.iter().flat_map(|w| word(*w, word_length)).collect();
        frame.extend(word(crc16(&frame, polynomial), word_length));
        frame.resize((self.channels + 2) * word_length.bytes(), 0);
        frame
    }

    fn received(self, first: u16, codes: &[i32]) -> Vec<u8> {
        let Format {
            word_length,
            polynomial,
        } = self.format;
        let mut frame = word(first, word_length);
        for channel in 0..self.channels {
            let value = codes.get(channel).copied().unwrap_or(0);
            frame.extend(code(value, word_length));
        }
        frame.extend(word(crc16(&frame, polynomial), word_length));
        frame
    }

    /// Words to the converter, and the first one from it.
    fn frame(self, sent: &[u16], first: u16) -> (Vec<u8>, Vec<u8>) {
        (self.sent(sent), self.received(first, &[5, -5]))
    }

    /// Registers that are written and read back; the first frame begins with `status`.
    fn writes(self, status: u16, registers: &[(u16, u16)]) -> Script {
        let mut script = Vec::new();
        let mut before = status;
        for &(address, value) in registers {
            script.push(self.frame(&[0x6000 | address << 7, value], before));
            script.push(self.frame(&[0xA000 | address << 7], 0x4000 | address << 7));
            before = value;
        }
        script.push(self.frame(&[0], before));
        script
    }
}

fn mock(script: Script) -> SpiMock<u8> {
    let transactions: Vec<_> = script
        .into_iter()
        .flat_map(|(sent, received)| {
            [
                SpiTransaction::transaction_start(),
                SpiTransaction::transfer(sent, received),
                SpiTransaction::transaction_end(),
            ]
        })
        .collect();
    SpiMock::new(&transactions)
}

/// A test with both drivers: `go!` waits for the one and leaves the other as it is.
macro_rules! with_both {
    ($name:ident, $channels:literal, $script:expr, |$driver:ident| $body:block) => {
        mod $name {
            use super::*;

            #[test]
            #[allow(unused_mut)]
            fn blocking() {
                #[allow(unused_macros)]
                macro_rules! go {
                    ($call:expr) => {
                        $call
                    };
                }
                let mut spi = mock($script);
                let mut $driver = blocking::Ads131m0x::<_, $channels>::new(spi.clone());
                $body
                spi.done();
            }

            #[test]
            #[allow(unused_mut)]
            fn asynchronous() {
                #[allow(unused_macros)]
                macro_rules! go {
                    ($call:expr) => {
                        block_on($call)
                    };
                }
                let mut spi = mock($script);
                let mut $driver = asynchronous::Ads131m0x::<_, $channels>::new(spi.clone());
                $body
                spi.done();
            }
        }
    };
}

const FOUR: Bus = Bus::reset(4);
const STATUS: u16 = 0x050F;

with_both!(
    lock_unlock_stand_by_and_wake_up_are_a_command_and_its_answer,
    4,
    [0x0555, 0x0655, 0x0022, 0x0033]
        .into_iter()
        .flat_map(|command| [FOUR.frame(&[command], STATUS), FOUR.frame(&[0], command)])
        .collect(),
    |driver| {
        assert_eq!(go!(driver.lock()), Ok(()));
        assert_eq!(go!(driver.unlock()), Ok(()));
        assert_eq!(go!(driver.stand_by()), Ok(()));
        assert_eq!(go!(driver.wake_up()), Ok(()));
    }
);

with_both!(
    a_command_that_is_not_acknowledged_is_told,
    4,
    vec![FOUR.frame(&[0x0555], STATUS), FOUR.frame(&[0], STATUS)],
    |driver| {
        let expected = Error::Answer {
            expected: 0x0555,
            read: STATUS,
        };
        assert_eq!(go!(driver.lock()), Err(expected));
    }
);

with_both!(
    reset_by_command_unlocks_first_and_takes_no_notice_of_frames_from_before,
    4,
    {
        let (unlock, mut damaged) = FOUR.frame(&[0x0655], 0x8500);
        damaged[7] ^= 1;
        vec![
            (unlock, damaged),
            FOUR.frame(&[0x0011], 0x0655),
            FOUR.frame(&[0], 0xFF24),
        ]
    },
    |driver| {
        let mut delay = CheckedDelay::new(&[DelayTransaction::delay_us(10)]);
        assert_eq!(go!(driver.reset(&mut delay)), Ok(()));
        delay.done();
    }
);

with_both!(
    a_reset_that_did_not_happen_is_told,
    4,
    vec![FOUR.frame(&[0], STATUS)],
    |driver| {
        let expected = Error::Answer {
            expected: 0xFF24,
            read: STATUS,
        };
        assert_eq!(go!(driver.expect_reset()), Err(expected));
    }
);

with_both!(
    status_and_checksum_of_the_register_map_are_read,
    4,
    vec![
        FOUR.frame(&[0], 0x0555),
        FOUR.frame(&[0], 0xF50F),
        FOUR.frame(&[0xBF00], 0x8100),
        FOUR.frame(&[0], 0x1234),
    ],
    |driver| {
        let status = go!(driver.status()).unwrap();
        assert!(status.is_locked() && status.was_resynchronised() && status.was_reset());
        assert!(status.register_map_changed() && status.input_checksum_failed());
        assert!(status.has_data(0) && status.has_all_data(4) && !status.has_data(4));
        assert_eq!(go!(driver.register_map_checksum()), Ok(0x1234));
    }
);

/// Everything otherwise than after a reset.
fn elaborate() -> Settings<4> {
    let mut detect = CurrentDetect::new(0x12_3456).unwrap();
    detect.all_channels = true;
    detect.count = DetectCount::Of8;
    detect.length = DetectLength::Of1280;
    let mut settings = Settings {
        clock_hz: 4_096_000,
        mode: Mode {
            register_map_checksum: true,
            input_checksum: true,
            timeout: false,
            drdy_source: DrdySource::MostLeading,
            drdy_open_drain: true,
            drdy_pulse: true,
            ..Mode::RESET
        },
        oversampling: Oversampling::X16384,
        power: PowerMode::Low,
        global_chop: Some(ChopDelay::Cycles1024),
        current_detect: Some(detect),
        dc_block: DcBlock::new(16),
        ..Settings::RESET
    };
    settings.channels[0].gain = Gain::X128;
    settings.channels[1].enabled = false;
    settings.channels[2] = Channel {
        cfg: ChannelCfg {
            phase: Phase::new(-3).unwrap(),
            dc_block_off: true,
            input: Input::NegativeTest,
        },
        offset: Offset::new(-2).unwrap(),
        gain_calibration: GainCalibration::new(0xA0_B0C0).unwrap(),
        gain: Gain::X4,
        ..Channel::RESET
    };
    settings
}

/// What section 8.6 makes of it.
const ELABORATE: [(u16, u16); 26] = [
    (0x02, 0x310B),
    (0x03, 0x0D1D),
    (0x04, 0x0207),
    (0x06, 0x13B9),
    (0x07, 0x1234),
    (0x08, 0x560F),
    (0x09, 0x0000),
    (0x0A, 0x0000),
    (0x0B, 0x0000),
    (0x0C, 0x8000),
    (0x0D, 0x0000),
    (0x0E, 0x0000),
    (0x0F, 0x0000),
    (0x10, 0x0000),
    (0x11, 0x8000),
    (0x12, 0x0000),
    (0x13, 0xFF47),
    (0x14, 0xFFFF),
    (0x15, 0xFE00),
    (0x16, 0xA0B0),
    (0x17, 0xC000),
    (0x18, 0x0000),
    (0x19, 0x0000),
    (0x1A, 0x0000),
    (0x1B, 0x8000),
    (0x1C, 0x0000),
];

fn set_up_script(last_status: u16) -> Script {
    let mut script = vec![FOUR.frame(&[0xA000], 0x0500), FOUR.frame(&[0], 0x24C5)];
    script.extend(FOUR.writes(0x0500, &ELABORATE));
    // The writes themselves have changed the register map.
    script.push(FOUR.frame(&[0], 0x2100));
    script.push(FOUR.frame(&[0], last_status));
    script
}

with_both!(
    set_up_writes_and_reads_back_every_register_and_discards_the_status_that_tells_of_it,
    4,
    set_up_script(0x010F),
    |driver| {
        // Two passes over 27 registers of 16 bits: 864 cycles of 4.096 MHz.
        let mut delay = CheckedDelay::new(&[DelayTransaction::delay_ns(210_938)]);
        let id = go!(driver.set_up(&elaborate(), &mut delay));
        assert_eq!(id, Ok(Identification(0x24C5)));
        delay.done();
    }
);

with_both!(
    a_register_map_that_goes_on_changing_is_told,
    4,
    set_up_script(0x2100),
    |driver| {
        let told = go!(driver.set_up(&elaborate(), &mut NoopDelay::new()));
        assert_eq!(told, Err(Error::Status(Status(0x2100))));
    }
);

with_both!(
    another_device_is_told_by_its_identification,
    4,
    vec![FOUR.frame(&[0xA000], 0x0500), FOUR.frame(&[0], 0x2801)],
    |driver| {
        let told = go!(driver.set_up(&elaborate(), &mut NoopDelay::new()));
        assert_eq!(told, Err(Error::Identification { read: 0x2801 }));
    }
);

with_both!(
    a_register_that_does_not_hold_its_value_is_told,
    4,
    {
        let mut script = FOUR.writes(STATUS, &[(2, 0x0110), (3, 0x0F0E)]);
        script.truncate(4);
        script.push(FOUR.frame(&[0x6000 | 4 << 7, 0], 0x0F0A));
        script
    },
    |driver| {
        let told = go!(driver.configure(&Settings::RESET));
        let expected = Error::Register {
            register: Register::Clock,
            written: 0x0F0E,
            read: 0x0F0A,
        };
        assert_eq!(told, Err(expected));
    }
);

with_both!(
    one_channel_is_set_by_its_five_registers,
    4,
    FOUR.writes(STATUS, &ELABORATE[16..21]),
    |driver| {
        let channel = elaborate().channels[2];
        assert_eq!(go!(driver.configure_channel(2, &channel)), Ok(()));
    }
);

with_both!(
    settings_that_no_converter_takes_are_not_sent,
    8,
    vec![],
    |driver| {
        let mut settings = Settings::RESET;
        settings.clock_hz = 8_300_000;
        assert_eq!(settings.check(), Ok(()));
        settings.channels[7].gain = Gain::X4;
        let clock = SettingsError::Clock {
            clock_hz: 8_300_000,
            lowest_hz: 300_000,
            highest_hz: 8_200_000,
        };
        assert_eq!(
            go!(driver.configure(&settings)),
            Err(Error::Settings(clock))
        );
        settings.clock_hz = 8_192_000;
        settings.oversampling = Oversampling::X64;
        let told = go!(driver.configure(&settings));
        assert_eq!(told, Err(Error::Settings(SettingsError::Oversampling)));
    }
);

#[test]
fn clocks_are_those_of_the_recommended_operating_conditions() {
    for (power, nominal, highest) in [
        (PowerMode::VeryLow, 2_048_000, 2_080_000),
        (PowerMode::Low, 4_096_000, 4_150_000),
        (PowerMode::HighResolution, 8_192_000, 8_400_000),
    ] {
        let takes = |clock_hz| {
            let settings = Settings::<4> {
                clock_hz,
                power,
                ..Settings::RESET
            };
            settings.check().is_ok()
        };
        assert!(takes(300_000) && takes(nominal) && takes(highest));
        assert!(!takes(299_999) && !takes(highest + 1));
    }
    // 16 kSPS come from a ratio of 256, not from a clock of 32 MHz.
    let fast = Settings::<4> {
        oversampling: Oversampling::X256,
        ..Settings::RESET
    };
    assert_eq!((fast.check(), fast.sample_rate_hz()), (Ok(()), 16_000.0));
}

#[test]
fn phases_and_packages_are_checked() {
    let mut settings = Settings::<4> {
        oversampling: Oversampling::X128,
        ..Settings::RESET
    };
    settings.channels[3].cfg.phase = Phase::new(64).unwrap();
    let phase = SettingsError::Phase {
        channel: 3,
        cycles: 64,
    };
    assert_eq!(settings.check(), Err(phase));
    let small = Settings::<4> {
        external_reference: true,
        ..Settings::RESET
    };
    assert_eq!(small.check(), Err(SettingsError::SmallPackage));
    let large = Settings::<8> {
        external_reference: true,
        crystal_off: true,
        ..Settings::RESET
    };
    assert_eq!(large.check(), Ok(()));
    let clock = large.registers().nth(1);
    assert_eq!(clock, Some((Register::Clock, 0xFFCE)));
}

#[test]
fn a_conversion_while_chopping_takes_three_and_the_delay() {
    let settings = Settings::<4> {
        global_chop: Some(ChopDelay::Cycles16),
        ..Settings::RESET
    };
    // Equation 8, in modulator cycles: 16 + 3 * 1024.
    assert_eq!(settings.clock_cycles(), 2 * 3088);
}

/// Codes that every length of word carries: the lower eight bits are zero.
const CODES: [i32; 8] = [
    0x7F_FF00, -0x80_0000, 0x12_3400, -0x100, 0, 0x100, 0x55_AA00, -0x12_3400,
];

macro_rules! family {
    ($($name:ident, $channels:literal, $bytes:literal, $answer:literal, $id:literal;)+) => { $(
        with_both!(
            $name,
            $channels,
            {
                let bus = Bus::reset($channels);
                assert_eq!(bus.sent(&[0]).len(), $bytes);
                vec![
                    bus.frame(&[0], $answer),
                    bus.frame(&[0xA000], 0x0500),
                    bus.frame(&[0], $id),
                    (bus.sent(&[0]), bus.received(0x0500, &CODES)),
                ]
            },
            |driver| {
                assert_eq!(go!(driver.expect_reset()), Ok(()));
                assert_eq!(go!(driver.identify()).map(|id| id.channels()), Ok($channels));
                let read = go!(driver.read()).unwrap();
                assert_eq!(read.codes, CODES[..$channels]);
                assert_eq!(read.status(), Status(0x0500));
            }
        );
    )+ };
}

family! {
    two_channels, 2, 12, 0xFF22, 0x2201;
    three_channels, 3, 15, 0xFF23, 0x2302;
    four_channels, 4, 18, 0xFF24, 0x2403;
    six_channels, 6, 24, 0xFF26, 0x2604;
    eight_channels, 8, 30, 0xFF28, 0x2805;
}

macro_rules! formats {
    ($($name:ident, $word_length:ident, $polynomial:ident, $mode:literal, $bytes:literal;)+) => { $(
        with_both!(
            $name,
            8,
            {
                let before = Bus::reset(8);
                let format = Format {
                    word_length: WordLength::$word_length,
                    polynomial: Polynomial::$polynomial,
                };
                let after = Bus { format, ..before };
                assert_eq!(after.sent(&[0]).len(), $bytes);
                vec![
                    before.frame(&[0x6100, $mode], 0x0500),
                    // From here on in the new words.
                    after.frame(&[0xA100], 0x4100),
                    after.frame(&[0], $mode),
                    after.frame(&[0x6180, 0xFF0E], $mode & 0x0B00),
                    after.frame(&[0xA180], 0x4180),
                    after.frame(&[0], 0xFF0E),
                    (after.sent(&[0]), after.received($mode & 0x0B00 | 0xFF, &CODES)),
                    // A reset puts the words back.
                    after.frame(&[0x0655], $mode & 0x0B00),
                    after.frame(&[0x0011], 0x0655),
                    before.frame(&[0], 0xFF28),
                ]
            },
            |driver| {
                assert_eq!(go!(driver.write_register(Register::Mode, $mode)), Ok(()));
                assert_eq!(go!(driver.write_register(Register::Clock, 0xFF0E)), Ok(()));
                let read = go!(driver.read()).unwrap();
                assert_eq!(read.codes, CODES);
                let status = read.status();
                assert_eq!(status.word_length(), WordLength::$word_length);
                assert_eq!(status.polynomial(), Polynomial::$polynomial);
                assert_eq!(driver.format().word_length, WordLength::$word_length);
                assert_eq!(go!(driver.reset(&mut NoopDelay::new())), Ok(()));
            }
        );
    )+ };
}

formats! {
    words_of_16_bits_ccitt, Bits16, Ccitt, 0x0010, 20;
    words_of_16_bits_ansi, Bits16, Ansi, 0x0810, 20;
    words_of_24_bits_ccitt, Bits24, Ccitt, 0x0110, 30;
    words_of_24_bits_ansi, Bits24, Ansi, 0x0910, 30;
    words_of_32_bits_zeros_ccitt, Bits32ZeroPadded, Ccitt, 0x0210, 40;
    words_of_32_bits_zeros_ansi, Bits32ZeroPadded, Ansi, 0x0A10, 40;
    words_of_32_bits_sign_ccitt, Bits32SignExtended, Ccitt, 0x0310, 40;
    words_of_32_bits_sign_ansi, Bits32SignExtended, Ansi, 0x0B10, 40;
}

#[test]
fn a_code_of_24_bits_is_whole_in_all_words_but_those_of_16() {
    for word_length in [
        WordLength::Bits24,
        WordLength::Bits32ZeroPadded,
        WordLength::Bits32SignExtended,
    ] {
        let format = Format {
            word_length,
            ..Format::RESET
        };
        let codes = [8_388_607, -8_388_608, 1, -1];
        let frame = Bus {
            channels: 4,
            format,
        }
        .received(0, &codes);
        let response = ads131m0x::Response::<4>::decode(&frame, format).unwrap();
        assert_eq!(response.codes, codes);
    }
}

with_both!(
    every_bit_of_a_frame_is_under_the_checksum,
    2,
    (0..8 * 11)
        .map(|bit| {
            let (sent, mut received) = Bus::reset(2).frame(&[0], STATUS);
            received[bit / 8] ^= 0x80 >> (bit % 8);
            (sent, received)
        })
        .collect(),
    |driver| {
        for _ in 0..8 * 11 {
            assert!(matches!(go!(driver.read()), Err(Error::Checksum(_))));
        }
    }
);

#[test]
fn a_short_frame_is_told_as_a_wrong_checksum() {
    for length in 0..17 {
        let frame = &FOUR.received(0, &CODES)[..length];
        let told = ads131m0x::Response::<4>::decode(frame, Format::RESET);
        assert!(told.is_err(), "{length} bytes");
    }
}

#[test]
fn a_frame_that_is_too_short_for_a_command_is_filled_without_a_panic() {
    for length in 0..9 {
        let mut frame = [0xAA; 9];
        Command::Write(Register::Mode, 0x1234).encode(&mut frame[..length], Format::RESET);
        assert!(frame[length..].iter().all(|byte| *byte == 0xAA));
    }
}

/// A bus that is broken.
#[derive(Debug)]
struct Broken;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Dead(u8);

impl embedded_hal::spi::Error for Dead {
    fn kind(&self) -> embedded_hal::spi::ErrorKind {
        embedded_hal::spi::ErrorKind::Other
    }
}

impl embedded_hal::spi::ErrorType for Broken {
    type Error = Dead;
}

impl embedded_hal::spi::SpiDevice for Broken {
    fn transaction(&mut self, _: &mut [embedded_hal::spi::Operation<'_, u8>]) -> Result<(), Dead> {
        Err(Dead(7))
    }
}

#[test]
fn the_buss_own_error_is_kept() {
    let mut driver = blocking::Ads131m04::new(Broken);
    let error = driver.read().unwrap_err();
    assert_eq!(error, Error::Bus(Dead(7)));
    assert_eq!(error.to_string(), "bus: Dead(7)");
    assert_eq!(error.map_bus(|Dead(number)| number), Error::Bus(7));
    // A reset goes on after a wrong checksum, but not without a bus.
    assert_eq!(
        driver.reset(&mut NoopDelay::new()),
        Err(Error::Bus(Dead(7)))
    );
}

#[test]
fn errors_say_what_is_wrong() {
    let errors: [(Error<Dead>, &str); 5] = [
        (
            Error::Checksum(ChecksumError {
                sent: 1,
                computed: 0x1234,
            }),
            "frame from the converter: checksum 0x0001, computed 0x1234",
        ),
        (
            Error::Identification { read: 0x2801 },
            "not this converter: ID is 0x2801",
        ),
        (
            Error::Register {
                register: Register::OffsetMsb(3),
                written: 1,
                read: 2,
            },
            "CH3_OCAL_MSB holds 0x0002, written 0x0001",
        ),
        (Error::Status(Status(0x2500)), "status 0x2500"),
        (
            Error::Settings(SettingsError::Oversampling),
            "more than four channels have no oversampling ratio of 64",
        ),
    ];
    for (error, words) in errors {
        let error: &dyn core::error::Error = &error;
        assert_eq!(error.to_string(), words);
    }
}

#[test]
fn pulses_on_the_pin_are_as_long_as_the_clock_asks() {
    for clock_hz in [8_192_000, 2_048_000] {
        let per_us = f64::from(clock_hz) / 1e6;
        let low = [
            PinTransaction::set(PinState::Low),
            PinTransaction::set(PinState::High),
        ];
        let ns = |cycles: f64| (cycles / per_us * 1e3).ceil() as u32;
        let reset = [
            DelayTransaction::delay_ns(ns(2560.0)),
            DelayTransaction::delay_us(10),
        ];
        let synchronise = [DelayTransaction::delay_ns(ns(16.0))];
        let (mut pin, mut delay) = (PinMock::new(&low), CheckedDelay::new(&reset));
        blocking::reset_by_pin(&mut pin, &mut delay, clock_hz).unwrap();
        pin.done();
        delay.done();
        let (mut pin, mut delay) = (PinMock::new(&low), CheckedDelay::new(&synchronise));
        block_on(asynchronous::synchronise_by_pin(
            &mut pin, &mut delay, clock_hz,
        ))
        .unwrap();
        pin.done();
        delay.done();
    }
}
