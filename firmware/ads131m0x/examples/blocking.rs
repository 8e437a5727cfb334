//! Sets an ADS131M04 up and reads a conversion, against a mock of the bus: `cargo run -p ads131m0x --example blocking`.
//!
//! On a board, `measure` takes its SPI device, pins and delay instead.

use ads131m0x::blocking::{Ads131m04, reset_by_pin};
use ads131m0x::{Command, Error, Format, Gain, Settings, frame::reset_answer};
use embedded_hal::delay::DelayNs;
use embedded_hal::digital::{InputPin, OutputPin};
use embedded_hal::spi::SpiDevice;
use embedded_hal_mock::eh1::delay::NoopDelay;
use embedded_hal_mock::eh1::digital::{Mock as Pin, State, Transaction as PinTransaction};
use embedded_hal_mock::eh1::spi::{Mock as Spi, Transaction};

/// The voltages of one conversion at 4 kSPS, V.
fn measure<SPI: SpiDevice>(
    spi: SPI,
    drdy: &mut impl InputPin,
    reset: &mut impl OutputPin,
    delay: &mut impl DelayNs,
) -> Result<[f64; 4], Error<SPI::Error>> {
    let mut settings = Settings::<4>::RESET;
    settings.mode.input_checksum = true;
    settings.mode.register_map_checksum = true;
    settings.channels[3].gain = Gain::X8;

    // A pin that fails shows below: the converter does not answer as after a reset.
    let _ = reset_by_pin(reset, delay, settings.clock_hz);
    let mut converter = Ads131m04::new(spi);
    converter.expect_reset()?;
    converter.set_up(&settings, delay)?;

    while drdy.is_high().unwrap_or(false) {}
    let conversion = converter.read()?;
    let mut volts = [0.0; 4];
    for ((v, code), channel) in volts
        .iter_mut()
        .zip(conversion.codes)
        .zip(settings.channels)
    {
        *v = f64::from(code) * channel.gain.v_per_code();
    }
    Ok(volts)
}

fn main() {
    let mut spi = Spi::new(&conversation());
    let mut drdy = Pin::new(&[PinTransaction::get(State::Low)]);
    let mut reset = Pin::new(&[State::Low, State::High].map(PinTransaction::set));
    let volts = measure(spi.clone(), &mut drdy, &mut reset, &mut NoopDelay::new());
    println!("{volts:?}");
    spi.done();
    drdy.done();
    reset.done();
}

/// What such a converter says.
fn conversation() -> Vec<Transaction<u8>> {
    let mut settings = Settings::<4>::RESET;
    settings.mode.input_checksum = true;
    settings.mode.register_map_checksum = true;
    settings.channels[3].gain = Gain::X8;
    let mut transactions = Vec::new();
    let mut say = |command: Command, word: u16, codes: [i32; 4]| {
        let mut sent = vec![0; 18];
        command.encode(&mut sent, Format::RESET);
        let mut received = vec![(word >> 8) as u8, word as u8, 0];
        received.extend(
            codes
                .iter()
                .flat_map(|code| code.to_be_bytes()[1..].to_vec()),
        );
        let sum = Format::RESET.polynomial.checksum(&received);
        received.extend(sum.to_be_bytes());
        received.push(0);
        transactions.push(Transaction::transaction_start());
        transactions.push(Transaction::transfer(sent, received));
        transactions.push(Transaction::transaction_end());
    };
    say(Command::Null, reset_answer(4), [0; 4]);
    say(Command::Read(ads131m0x::Register::Id), 0x0500, [0; 4]);
    say(Command::Null, 0x2401, [0; 4]);
    let mut before = 0x0500;
    for (register, value) in settings.registers() {
        let write = Command::Write(register, value);
        say(write, before, [0; 4]);
        say(
            Command::Read(register),
            write.answer(4).unwrap_or(0),
            [0; 4],
        );
        before = value;
    }
    say(Command::Null, before, [0; 4]);
    say(Command::Null, 0x2100, [0; 4]);
    say(Command::Null, 0x0100, [0; 4]);
    say(Command::Null, 0x010F, [1 << 22, -(1 << 22), 0, 1 << 20]);
    transactions
}
