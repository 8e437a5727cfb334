//! The driver over embedded-hal-async, or over any [`Transport`].

use embedded_hal::digital::OutputPin;
use embedded_hal_async::delay::DelayNs;
use embedded_hal_async::spi::SpiDevice;

use crate::clock::pulse;
use crate::error::Error;
use crate::format::Format;
use crate::frame::{Command, Response, reset_answer};
use crate::registers::{Identification, Register};
use crate::settings::{Channel, Settings};
use crate::status::Status;

/// The way to the converter: a frame each way at the same time, the chip select low meanwhile. Every
/// [`SpiDevice`] is one (SPI mode 1, up to 25 MHz; with a digital supply below 2 V up to 15.6 MHz).
#[allow(async_fn_in_trait)] // Nobody asks these futures to be sent to another thread.
pub trait Transport {
    /// What it reports.
    type Error;

    /// Sends all of `sent` and fills `received`, which is as long.
    async fn transfer(&mut self, received: &mut [u8], sent: &[u8]) -> Result<(), Self::Error>;
}

impl<SPI: SpiDevice> Transport for SPI {
    type Error = SPI::Error;

    async fn transfer(&mut self, received: &mut [u8], sent: &[u8]) -> Result<(), Self::Error> {
        SpiDevice::transfer(self, received, sent).await
    }
}

/// Channels of the largest converter of the family.
const MOST_CHANNELS: usize = 8;

/// Bytes of the longest frame.
const LONGEST_FRAME: usize = (MOST_CHANNELS + 2) * 4;

/// A converter with two, three, four, six or eight channels.
///
/// Each frame that a method sends brings a conversion; but for [`Self::read`] they throw it away. Each method
/// ends with a null command, so that the next frame begins with the status word.
#[derive(Debug)]
pub struct Ads131m0x<TRANSPORT, const CHANNELS: usize> {
    transport: TRANSPORT,
    format: Format,
}

/// The two-channel converter.
pub type Ads131m02<TRANSPORT> = Ads131m0x<TRANSPORT, 2>;
/// The three-channel converter.
pub type Ads131m03<TRANSPORT> = Ads131m0x<TRANSPORT, 3>;
/// The four-channel converter.
pub type Ads131m04<TRANSPORT> = Ads131m0x<TRANSPORT, 4>;
/// The six-channel converter.
pub type Ads131m06<TRANSPORT> = Ads131m0x<TRANSPORT, 6>;
/// The eight-channel converter.
pub type Ads131m08<TRANSPORT> = Ads131m0x<TRANSPORT, 8>;

impl<T: Transport, const CHANNELS: usize> Ads131m0x<T, CHANNELS> {
    /// A converter whose frames are as after a reset.
    pub const fn new(transport: T) -> Self {
        Self::with_format(transport, Format::RESET)
    }

    /// A converter whose frames are known to be otherwise, since it was set up before.
    pub const fn with_format(transport: T, format: Format) -> Self {
        const {
            assert!(
                matches!(CHANNELS, 2 | 3 | 4 | 6 | 8),
                "the family has 2, 3, 4, 6 or 8 channels"
            );
        }
        Self { transport, format }
    }

    /// How frames are written now.
    pub const fn format(&self) -> Format {
        self.format
    }

    /// The way to the converter.
    pub const fn transport(&mut self) -> &mut T {
        &mut self.transport
    }

    /// Gives the way to the converter back.
    pub fn release(self) -> T {
        self.transport
    }

    /// Sends a command and receives the answer to the one before it, with a conversion. The lowest level: after a
    /// command other than null, send a null command before [`Self::read`] is used again.
    ///
    /// # Errors
    /// [`Error::Bus`], [`Error::Checksum`].
    pub async fn exchange(
        &mut self,
        command: Command,
    ) -> Result<Response<CHANNELS>, Error<T::Error>> {
        let (mut sent, mut received) = ([0; LONGEST_FRAME], [0; LONGEST_FRAME]);
        let length = self.format.frame_bytes(CHANNELS).min(LONGEST_FRAME);
        let (sent, received) = (&mut sent[..length], &mut received[..length]);
        command.encode(sent, self.format);
        let transferred = self.transport.transfer(received, sent).await;
        transferred.map_err(Error::Bus)?;
        Ok(Response::decode(received, self.format)?)
    }

    /// Reads a conversion and the status; call it when DRDY is low. The converter keeps two conversions: read twice
    /// after a pause.
    ///
    /// # Errors
    /// [`Error::Bus`], [`Error::Checksum`].
    pub async fn read(&mut self) -> Result<Response<CHANNELS>, Error<T::Error>> {
        self.exchange(Command::Null).await
    }

    /// Demands the answer of the first frame after a reset by pin or power, which [`Self::reset`] does by itself.
    ///
    /// # Errors
    /// [`Error::Answer`] when the converter was not reset; [`Error::Bus`], [`Error::Checksum`].
    pub async fn expect_reset(&mut self) -> Result<(), Error<T::Error>> {
        self.format = Format::RESET;
        self.expect(Command::Null, Some(reset_answer(CHANNELS)))
            .await
    }

    /// Resets the converter by command, unlocked before. For a board that does not connect the pin: the pin works
    /// whatever the converter makes of the frames.
    ///
    /// # Errors
    /// [`Error::Answer`] when the converter was not reset; [`Error::Bus`], [`Error::Checksum`].
    pub async fn reset(&mut self, delay: &mut impl DelayNs) -> Result<(), Error<T::Error>> {
        // What these answer depends on the state before, and so may be their checksum.
        for command in [Command::Unlock, Command::Reset] {
            match self.exchange(command).await {
                Ok(_) | Err(Error::Checksum(_)) => {}
                Err(error) => return Err(error),
            }
        }
        delay.delay_us(pulse::REGISTERS_READY_US).await;
        self.expect_reset().await
    }

    /// Reads the register ID.
    ///
    /// # Errors
    /// [`Error::Identification`] when it is not that of a converter with so many channels; [`Error::Bus`],
    /// [`Error::Checksum`].
    pub async fn identify(&mut self) -> Result<Identification, Error<T::Error>> {
        let id = Identification(self.read_register(Register::Id).await?);
        if id.is_of(CHANNELS) {
            Ok(id)
        } else {
            Err(Error::Identification { read: id.0 })
        }
    }

    /// Sets the converter up after a reset: checks the settings and who it is, writes every setting and reads it back,
    /// waits until the converter has looked over its registers, throws away the status that tells of the writing, and
    /// demands one that tells of nothing.
    ///
    /// The first conversions after that still come from before: see
    /// [`Oversampling::settling_clock_cycles`](crate::Oversampling::settling_clock_cycles).
    ///
    /// # Errors
    /// Any; the converter is then not to be used.
    pub async fn set_up(
        &mut self,
        settings: &Settings<CHANNELS>,
        delay: &mut impl DelayNs,
    ) -> Result<Identification, Error<T::Error>> {
        settings.check()?;
        let id = self.identify().await?;
        self.configure(settings).await?;
        let cycles = settings.register_map_cycles();
        delay.delay_ns(pulse::ns(cycles, settings.clock_hz)).await;
        self.read().await?;
        let status = self.read().await?.status();
        if status.differs_from(settings.status()) != 0 {
            return Err(Error::Status(status));
        }
        Ok(id)
    }

    /// Writes every setting and reads it back: two frames a register and one more. MODE is the first; the frames after
    /// it are as it says.
    ///
    /// # Errors
    /// [`Error::Settings`] before anything is sent; [`Error::Answer`] and [`Error::Register`] at the first register
    /// that does not take its value; [`Error::Bus`], [`Error::Checksum`].
    pub async fn configure(
        &mut self,
        settings: &Settings<CHANNELS>,
    ) -> Result<(), Error<T::Error>> {
        settings.check()?;
        self.write_all(settings.registers()).await
    }

    /// Sets one channel anew but for its gain and whether it converts, which it shares registers for with others.
    ///
    /// # Errors
    /// As [`Self::configure`].
    pub async fn configure_channel(
        &mut self,
        number: u8,
        channel: &Channel,
    ) -> Result<(), Error<T::Error>> {
        self.write_all(channel.registers(number).into_iter()).await
    }

    /// Writes a register and reads it back.
    ///
    /// # Errors
    /// [`Error::Answer`], [`Error::Register`], [`Error::Bus`], [`Error::Checksum`].
    pub async fn write_register(
        &mut self,
        register: Register,
        value: u16,
    ) -> Result<(), Error<T::Error>> {
        self.write_all([(register, value)].into_iter()).await
    }

    /// Each register's content arrives with the frame that writes the next one.
    async fn write_all(
        &mut self,
        registers: impl Iterator<Item = (Register, u16)>,
    ) -> Result<(), Error<T::Error>> {
        let mut before = None;
        for (register, value) in registers {
            let write = Command::Write(register, value);
            let read = self.exchange(write).await?.word;
            compare(before, read)?;
            if let Register::Mode = register {
                self.format = crate::registers::Mode::from_bits(value).format;
            }
            self.expect(Command::Read(register), write.answer(CHANNELS))
                .await?;
            before = Some((register, value));
        }
        compare(before, self.exchange(Command::Null).await?.word)
    }

    /// Reads a register.
    ///
    /// # Errors
    /// [`Error::Bus`], [`Error::Checksum`].
    pub async fn read_register(&mut self, register: Register) -> Result<u16, Error<T::Error>> {
        self.exchange(Command::Read(register)).await?;
        Ok(self.exchange(Command::Null).await?.word)
    }

    /// Reads the checksum of the register map, as the converter computes it all the time.
    ///
    /// # Errors
    /// [`Error::Bus`], [`Error::Checksum`].
    pub async fn register_map_checksum(&mut self) -> Result<u16, Error<T::Error>> {
        self.read_register(Register::MapChecksum).await
    }

    /// Reads the status, whatever the command before was.
    ///
    /// # Errors
    /// [`Error::Bus`], [`Error::Checksum`].
    pub async fn status(&mut self) -> Result<Status, Error<T::Error>> {
        self.exchange(Command::Null).await?;
        Ok(self.exchange(Command::Null).await?.status())
    }

    /// Locks the registers against writing, until [`Self::unlock`] or a reset.
    ///
    /// # Errors
    /// [`Error::Answer`], [`Error::Bus`], [`Error::Checksum`].
    pub async fn lock(&mut self) -> Result<(), Error<T::Error>> {
        self.acknowledged(Command::Lock).await
    }

    /// The contrary.
    ///
    /// # Errors
    /// [`Error::Answer`], [`Error::Bus`], [`Error::Checksum`].
    pub async fn unlock(&mut self) -> Result<(), Error<T::Error>> {
        self.acknowledged(Command::Unlock).await
    }

    /// Stops converting. The settings stay; the clock may be stopped after that.
    ///
    /// # Errors
    /// [`Error::Answer`], [`Error::Bus`], [`Error::Checksum`].
    pub async fn stand_by(&mut self) -> Result<(), Error<T::Error>> {
        self.acknowledged(Command::StandBy).await
    }

    /// Converts again; the clock has to run.
    ///
    /// # Errors
    /// [`Error::Answer`], [`Error::Bus`], [`Error::Checksum`].
    pub async fn wake_up(&mut self) -> Result<(), Error<T::Error>> {
        self.acknowledged(Command::WakeUp).await
    }

    async fn acknowledged(&mut self, command: Command) -> Result<(), Error<T::Error>> {
        self.exchange(command).await?;
        self.expect(Command::Null, command.answer(CHANNELS)).await
    }

    /// Sends a command and demands an answer to the one before it.
    async fn expect(
        &mut self,
        command: Command,
        expected: Option<u16>,
    ) -> Result<(), Error<T::Error>> {
        let read = self.exchange(command).await?.word;
        match expected {
            Some(expected) if read != expected => Err(Error::Answer { expected, read }),
            _ => Ok(()),
        }
    }
}

/// What was written against what was read.
fn compare<E>(before: Option<(Register, u16)>, read: u16) -> Result<(), Error<E>> {
    match before {
        Some((register, written)) if written != read => Err(Error::Register {
            register,
            written,
            read,
        }),
        _ => Ok(()),
    }
}

/// Resets the converter by its pin SYNC/RESET, and waits until it can be spoken to; then call
/// [`Ads131m0x::expect_reset`].
///
/// # Errors
/// Of the pin.
pub async fn reset_by_pin<PIN: OutputPin>(
    pin: &mut PIN,
    delay: &mut impl DelayNs,
    clock_hz: u32,
) -> Result<(), PIN::Error> {
    hold_low(pin, delay, pulse::ns(pulse::RESET_CYCLES, clock_hz)).await?;
    delay.delay_us(pulse::REGISTERS_READY_US).await;
    Ok(())
}

/// Begins the conversions anew at the falling edge of SYNC/RESET, and empties the converter's memory of two of them.
/// While standing by, it begins to watch for a current ([`CurrentDetect`](crate::CurrentDetect)).
///
/// The pulse has 16 clock cycles. A delay that makes 2048 of it, 250 us at 8.192 MHz, resets the converter: keep
/// interrupts from it.
///
/// # Errors
/// Of the pin.
pub async fn synchronise_by_pin<PIN: OutputPin>(
    pin: &mut PIN,
    delay: &mut impl DelayNs,
    clock_hz: u32,
) -> Result<(), PIN::Error> {
    hold_low(pin, delay, pulse::ns(pulse::SYNCHRONISE_CYCLES, clock_hz)).await
}

async fn hold_low<PIN: OutputPin>(
    pin: &mut PIN,
    delay: &mut impl DelayNs,
    ns: u32,
) -> Result<(), PIN::Error> {
    pin.set_low()?;
    delay.delay_ns(ns).await;
    pin.set_high()
}
