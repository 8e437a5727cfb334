//! The driver over embedded-hal: the same transactions, and each call returns when they are done.

use core::future::Future;
use core::pin::pin;
use core::task::{Context, Poll, Waker};

use embedded_hal::delay::DelayNs;
use embedded_hal::digital::OutputPin;
use embedded_hal::spi::SpiDevice;

use crate::asynchronous::{self, Transport};
use crate::error::Error;
use crate::format::Format;
use crate::frame::{Command, Response};
use crate::registers::{Identification, Register};
use crate::settings::{Channel, Settings};
use crate::status::Status;

/// What blocks, seen as what is always ready when it is asked.
#[derive(Debug)]
struct Ready<BLOCKING>(BLOCKING);

impl<SPI: SpiDevice> Transport for Ready<SPI> {
    type Error = SPI::Error;

    async fn transfer(&mut self, received: &mut [u8], sent: &[u8]) -> Result<(), Self::Error> {
        self.0.transfer(received, sent)
    }
}

impl<DELAY: DelayNs> embedded_hal_async::delay::DelayNs for Ready<&mut DELAY> {
    async fn delay_ns(&mut self, ns: u32) {
        self.0.delay_ns(ns);
    }
}

/// Runs a future of nothing but [`Ready`] parts, which is complete when it is polled once.
fn complete<FUTURE: Future>(future: FUTURE) -> FUTURE::Output {
    let mut future = pin!(future);
    let mut context = Context::from_waker(Waker::noop());
    loop {
        if let Poll::Ready(output) = future.as_mut().poll(&mut context) {
            return output;
        }
    }
}

/// A converter with two, three, four, six or eight channels on a [`SpiDevice`] (SPI mode 1, up to 25 MHz).
///
/// Each frame that a method sends brings a conversion; but for [`Self::read`] they throw it away. Each method
/// ends with a null command, so that the next frame begins with the status word.
#[derive(Debug)]
pub struct Ads131m0x<SPI, const CHANNELS: usize>(asynchronous::Ads131m0x<Ready<SPI>, CHANNELS>);

/// The two-channel converter.
pub type Ads131m02<SPI> = Ads131m0x<SPI, 2>;
/// The three-channel converter.
pub type Ads131m03<SPI> = Ads131m0x<SPI, 3>;
/// The four-channel converter.
pub type Ads131m04<SPI> = Ads131m0x<SPI, 4>;
/// The six-channel converter.
pub type Ads131m06<SPI> = Ads131m0x<SPI, 6>;
/// The eight-channel converter.
pub type Ads131m08<SPI> = Ads131m0x<SPI, 8>;

impl<SPI: SpiDevice, const CHANNELS: usize> Ads131m0x<SPI, CHANNELS> {
    /// A converter whose frames are as after a reset.
    pub const fn new(spi: SPI) -> Self {
        Self::with_format(spi, Format::RESET)
    }

    /// A converter whose frames are known to be otherwise, since it was set up before.
    pub const fn with_format(spi: SPI, format: Format) -> Self {
        Self(asynchronous::Ads131m0x::with_format(Ready(spi), format))
    }

    /// How frames are written now.
    pub const fn format(&self) -> Format {
        self.0.format()
    }

    /// Gives the bus back.
    pub fn release(self) -> SPI {
        self.0.release().0
    }

    /// See [`asynchronous::Ads131m0x::exchange`].
    ///
    /// # Errors
    /// [`Error::Bus`], [`Error::Checksum`].
    pub fn exchange(&mut self, command: Command) -> Result<Response<CHANNELS>, Error<SPI::Error>> {
        complete(self.0.exchange(command))
    }

    /// Reads a conversion and the status; call it when DRDY is low. The converter keeps two conversions: read twice
    /// after a pause.
    ///
    /// # Errors
    /// [`Error::Bus`], [`Error::Checksum`].
    pub fn read(&mut self) -> Result<Response<CHANNELS>, Error<SPI::Error>> {
        complete(self.0.read())
    }

    /// Demands the answer of the first frame after a reset by pin or power.
    ///
    /// # Errors
    /// [`Error::Answer`] when the converter was not reset; [`Error::Bus`], [`Error::Checksum`].
    pub fn expect_reset(&mut self) -> Result<(), Error<SPI::Error>> {
        complete(self.0.expect_reset())
    }

    /// Resets the converter by command; see [`asynchronous::Ads131m0x::reset`].
    ///
    /// # Errors
    /// [`Error::Answer`] when the converter was not reset; [`Error::Bus`], [`Error::Checksum`].
    pub fn reset(&mut self, delay: &mut impl DelayNs) -> Result<(), Error<SPI::Error>> {
        complete(self.0.reset(&mut Ready(delay)))
    }

    /// Reads the register ID.
    ///
    /// # Errors
    /// [`Error::Identification`]; [`Error::Bus`], [`Error::Checksum`].
    pub fn identify(&mut self) -> Result<Identification, Error<SPI::Error>> {
        complete(self.0.identify())
    }

    /// Sets the converter up after a reset; see [`asynchronous::Ads131m0x::set_up`].
    ///
    /// # Errors
    /// Any; the converter is then not to be used.
    pub fn set_up(
        &mut self,
        settings: &Settings<CHANNELS>,
        delay: &mut impl DelayNs,
    ) -> Result<Identification, Error<SPI::Error>> {
        complete(self.0.set_up(settings, &mut Ready(delay)))
    }

    /// Writes every setting and reads it back; see [`asynchronous::Ads131m0x::configure`].
    ///
    /// # Errors
    /// [`Error::Settings`], [`Error::Answer`], [`Error::Register`], [`Error::Bus`], [`Error::Checksum`].
    pub fn configure(&mut self, settings: &Settings<CHANNELS>) -> Result<(), Error<SPI::Error>> {
        complete(self.0.configure(settings))
    }

    /// Sets one channel anew but for its gain and whether it converts.
    ///
    /// # Errors
    /// As [`Self::configure`].
    pub fn configure_channel(
        &mut self,
        number: u8,
        channel: &Channel,
    ) -> Result<(), Error<SPI::Error>> {
        complete(self.0.configure_channel(number, channel))
    }

    /// Writes a register and reads it back.
    ///
    /// # Errors
    /// [`Error::Answer`], [`Error::Register`], [`Error::Bus`], [`Error::Checksum`].
    pub fn write_register(
        &mut self,
        register: Register,
        value: u16,
    ) -> Result<(), Error<SPI::Error>> {
        complete(self.0.write_register(register, value))
    }

    /// Reads a register.
    ///
    /// # Errors
    /// [`Error::Bus`], [`Error::Checksum`].
    pub fn read_register(&mut self, register: Register) -> Result<u16, Error<SPI::Error>> {
        complete(self.0.read_register(register))
    }

    /// Reads the checksum of the register map.
    ///
    /// # Errors
    /// [`Error::Bus`], [`Error::Checksum`].
    pub fn register_map_checksum(&mut self) -> Result<u16, Error<SPI::Error>> {
        complete(self.0.register_map_checksum())
    }

    /// Reads the status, whatever the command before was.
    ///
    /// # Errors
    /// [`Error::Bus`], [`Error::Checksum`].
    pub fn status(&mut self) -> Result<Status, Error<SPI::Error>> {
        complete(self.0.status())
    }

    /// Locks the registers against writing, until [`Self::unlock`] or a reset.
    ///
    /// # Errors
    /// [`Error::Answer`], [`Error::Bus`], [`Error::Checksum`].
    pub fn lock(&mut self) -> Result<(), Error<SPI::Error>> {
        complete(self.0.lock())
    }

    /// The contrary.
    ///
    /// # Errors
    /// [`Error::Answer`], [`Error::Bus`], [`Error::Checksum`].
    pub fn unlock(&mut self) -> Result<(), Error<SPI::Error>> {
        complete(self.0.unlock())
    }

    /// Stops converting. The settings stay; the clock may be stopped after that.
    ///
    /// # Errors
    /// [`Error::Answer`], [`Error::Bus`], [`Error::Checksum`].
    pub fn stand_by(&mut self) -> Result<(), Error<SPI::Error>> {
        complete(self.0.stand_by())
    }

    /// Converts again; the clock has to run.
    ///
    /// # Errors
    /// [`Error::Answer`], [`Error::Bus`], [`Error::Checksum`].
    pub fn wake_up(&mut self) -> Result<(), Error<SPI::Error>> {
        complete(self.0.wake_up())
    }
}

/// Resets the converter by its pin SYNC/RESET, and waits until it can be spoken to; then call
/// [`Ads131m0x::expect_reset`].
///
/// # Errors
/// Of the pin.
pub fn reset_by_pin<PIN: OutputPin>(
    pin: &mut PIN,
    delay: &mut impl DelayNs,
    clock_hz: u32,
) -> Result<(), PIN::Error> {
    complete(asynchronous::reset_by_pin(pin, &mut Ready(delay), clock_hz))
}

/// Begins the conversions anew; see [`asynchronous::synchronise_by_pin`].
///
/// # Errors
/// Of the pin.
pub fn synchronise_by_pin<PIN: OutputPin>(
    pin: &mut PIN,
    delay: &mut impl DelayNs,
    clock_hz: u32,
) -> Result<(), PIN::Error> {
    complete(asynchronous::synchronise_by_pin(
        pin,
        &mut Ready(delay),
        clock_hz,
    ))
}
