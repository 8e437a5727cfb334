//! Acquisition from the ADS131M04: four simultaneous 24-bit channels, SPI mode 1, DRDY.
//!
//! The converter's registers, frames and set-up are those of its driver, the package `ads131m0x`. Here are what this
//! instrument sets ([`registers`]), how conversions come over a board's [`bus`], and which conversion is which ([`count`]).
//!
//! **Losing nothing unnoticed.** Each conversion has an index, counted from the DRDY edges that timers count and
//! stamp in hardware ([`count`]), not from what the software saw. The converter keeps two conversions: when one was
//! not read in time, the next frame brings the older one. The driver then throws away what there is, since
//! after a gap it cannot be known which conversions they are, goes on with the next one, and says how many were lost.

pub mod batch;
pub mod bus;
pub mod count;
pub mod frame;
pub mod registers;

pub use ads131m0x;

use embedded_hal::digital::{Error as _, ErrorKind as PinError, OutputPin};
use embedded_hal::spi::ErrorKind as SpiError;
use embedded_hal_async::delay::DelayNs;
use embedded_hal_async::digital::Wait;
use embedded_hal_async::spi::SpiDevice;

use ads131m0x::asynchronous::Ads131m0x;
use batch::Batch;
use bus::{FetchError, Fetched, FrameBus, FrameError, HalBus, Through, open};
use count::{ConversionCount, Timers};
use frame::{Command, Response};
use registers::{Config, Register, Status, has_data, is_sound_but_for};

/// What the converter or the way to it does wrong.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Error {
    /// The bus reported an error.
    Spi(SpiError),
    /// A pin reported an error.
    Pin(PinError),
    /// DRDY did not fall in time.
    DrdyTimeout {
        /// How long it was waited for.
        waited_us: u32,
    },
    /// A frame from the converter has a wrong checksum.
    Checksum(frame::ChecksumError),
    /// Not an ADS131M04.
    Identification {
        /// Register ID as read.
        read: u16,
    },
    /// A register does not hold what was written.
    Register {
        /// Which.
        register: Register,
        /// What was written.
        written: u16,
        /// What was read.
        read: u16,
    },
    /// A command was not acknowledged.
    Acknowledge {
        /// The response that it asks for.
        expected: u16,
        /// The response as read.
        read: u16,
    },
    /// The status word names a trouble; the converter needs to be set up anew.
    Status(Status),
    /// Conversions were not read in time.
    Overrun {
        /// How many.
        lost: u32,
    },
    /// DRDY is low but there is no new conversion.
    NoData,
    /// The data sheet does not allow such a master clock: that of the settings, or the one that makes conversions as fast
    /// as they come.
    Clock {
        /// Hz.
        clock_hz: u32,
    },
}

impl From<FrameError> for Error {
    fn from(error: FrameError) -> Self {
        match error {
            FrameError::Spi(error) => Self::Spi(error),
            FrameError::Checksum(error) => Self::Checksum(error),
        }
    }
}

impl From<ads131m0x::Error<SpiError>> for Error {
    fn from(error: ads131m0x::Error<SpiError>) -> Self {
        match error {
            ads131m0x::Error::Bus(error) => Self::Spi(error),
            ads131m0x::Error::Checksum(error) => Self::Checksum(error),
            ads131m0x::Error::Identification { read } => Self::Identification { read },
            ads131m0x::Error::Answer { expected, read } => Self::Acknowledge { expected, read },
            ads131m0x::Error::Register {
                register,
                written,
                read,
            } => Self::Register {
                register,
                written,
                read,
            },
            ads131m0x::Error::Status(status) => Self::Status(status),
            // Its settings are checked before; else it has no other today.
            _ => Self::Spi(SpiError::Other),
        }
    }
}

impl Error {
    /// True when the converter must be set up anew; false when only conversions are lost.
    pub const fn needs_initialise(self) -> bool {
        match self {
            Self::Spi(_) | Self::Checksum(_) | Self::Overrun { .. } | Self::NoData => false,
            Self::Status(status) => !is_sound_but_for(status, Status::INPUT_CHECKSUM),
            _ => true,
        }
    }
}

/// How to reset the converter.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Reset {
    /// By the pin SYNC/RESET, held low for 2048 cycles of the converter's clock.
    Pin,
    /// By the command, for a board that does not connect the pin.
    Command,
}

/// One instant of four channels.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Conversion {
    /// Conversions before this one since the first [`Ads131m04::initialise`], read or not.
    pub index: u64,
    /// When DRDY told of it, on the clock of [`Timers`].
    pub time_us: u64,
    /// Codes of the four channels, 24 bits with sign.
    pub codes: [i32; 4],
}

/// Conversion periods between set-up and the first conversion that is read: three until the sinc3 filter holds nothing
/// from before, as many more as the first check of the register map takes at 32 kSPS, and enough to tell the beat.
const SETTLING: u32 = 10;

/// How often a beat that is too fast is looked at.
const LOOKS: u32 = 3;

/// Frames in which the converter's two conversions and those that are made meanwhile are read away, even at 32 kSPS.
const EMPTYING: usize = 16;

/// Conversion periods without a frame on the bus, in which DRDY falls at least once.
const QUIET: u32 = 2;

/// How many conversion periods DRDY may stay away: more than a batch, so that a batch that comes needs no second look.
const PATIENCE: u32 = batch::ROOM as u32 + 4;

/// Time from reset to the first frame, over the 5 microseconds of t_REGACQ.
const REGISTERS_READY_US: u32 = 10;

/// The converter on its bus.
pub struct Ads131m04<BUS, RESET> {
    bus: BUS,
    reset: RESET,
    config: Config,
    count: ConversionCount,
    /// The last frame failed, so that the converter may still hold its conversion.
    behind: bool,
    /// It is not known which conversions wait in the converter.
    astray: bool,
    /// The conversion that came after those that [`Self::next`] told to be lost.
    fresh: Option<Fetched>,
}

impl<SPI, DRDY, RESET, DELAY, TIMERS> Ads131m04<HalBus<SPI, DRDY, DELAY, TIMERS>, RESET>
where
    SPI: SpiDevice,
    DRDY: Wait,
    RESET: OutputPin,
    DELAY: DelayNs,
    TIMERS: Timers,
{
    /// On a bus of embedded-hal's parts, not yet set up. `reset` is the pin SYNC/RESET, active low.
    pub fn new(
        spi: SPI,
        drdy: DRDY,
        reset: RESET,
        delay: DELAY,
        timers: TIMERS,
        config: Config,
    ) -> Self {
        let bus = HalBus {
            spi,
            drdy,
            delay,
            timers,
        };
        Self::on_bus(bus, reset, config)
    }
}

impl<BUS: FrameBus, RESET: OutputPin> Ads131m04<BUS, RESET> {
    /// On its bus, not yet set up. `reset` is the pin SYNC/RESET, active low.
    pub fn on_bus(bus: BUS, reset: RESET, config: Config) -> Self {
        Self {
            bus,
            reset,
            config,
            count: ConversionCount::new(&config),
            behind: false,
            astray: false,
            fresh: None,
        }
    }

    /// How it is set.
    pub fn config(&self) -> &Config {
        &self.config
    }

    /// Conversions that the converter has made since the first [`Self::initialise`], as far as accounted for.
    pub fn conversions(&self) -> u64 {
        let untold = u64::from(self.fresh.is_some());
        self.count.index().saturating_sub(untold)
    }

    /// True while there is a conversion that [`Self::next`] will give without waiting.
    pub fn has_fetched(&self) -> bool {
        self.fresh.is_some() || self.bus.has_fetched()
    }

    /// The clock of its timers, microseconds.
    pub fn now_us(&mut self) -> u64 {
        self.bus.now_us()
    }

    /// Lets others run for that long.
    pub async fn pause_us(&mut self, duration_us: u32) {
        self.bus.pause_us(duration_us).await;
    }

    /// Lets others run for half of a conversion period.
    pub async fn pause_half_a_period(&mut self) {
        self.pause_us(self.count.period_us() / 2).await;
    }

    /// Puts the bus in order, resets the converter, checks who it is, writes every setting and reads it back, locks it,
    /// and waits until its filter has settled. Conversions that this costs count as lost, except the first time.
    ///
    /// # Errors
    /// Any but [`Error::Overrun`]; the converter is then not to be used.
    pub async fn initialise(&mut self, how: Reset) -> Result<(), Error> {
        let settings = self.config.settings();
        if settings.check().is_err() {
            // Nothing else of a configuration can be wrong.
            let clock_hz = self.config.clock_hz;
            return Err(Error::Clock { clock_hz });
        }
        self.bus.recover().await;
        match how {
            Reset::Pin => {
                self.reset.set_low().map_err(|e| Error::Pin(e.kind()))?;
                // 2048 cycles and a quarter more.
                let low_us = 2560 * 1_000_000u64 / u64::from(self.config.clock_hz.max(1));
                self.pause_us(low_us as u32).await;
                self.reset.set_high().map_err(|e| Error::Pin(e.kind()))?;
            }
            Reset::Command => {
                for command in [Command::Unlock, Command::Reset] {
                    // What these answer depends on the state before.
                    let answer = self.bus.exchange(&frame::encode(command)).await;
                    answer.map_err(Error::Spi)?;
                }
            }
        }
        self.pause_us(REGISTERS_READY_US).await;
        let mut converter = Ads131m0x::<_, { frame::CHANNELS }>::new(Through(&mut self.bus));
        converter.expect_reset().await?;
        converter.identify().await?;
        converter.configure(&settings).await?;
        converter.lock().await?;
        self.settle().await
    }

    /// Lets the filter settle and the timers measure the beat, with nothing on the bus; then reads away what there is.
    async fn settle(&mut self) -> Result<(), Error> {
        self.beat().await?;
        // Writing the registers has set a flag that this one puts out (data sheet, section 8.3.13).
        self.exchange(Command::Null).await?;
        let status = self.exchange(Command::Null).await?.status();
        if !is_sound_but_for(status, 0) {
            return Err(Error::Status(status));
        }
        self.astray = !self.empty().await?;
        if self.astray {
            // Too fast to be read, but not to be counted.
            self.pause_us(QUIET * self.count.period_us()).await;
        }
        let fetched = self.fetch().await?;
        fetched.response?;
        self.count.begin(fetched.edge);
        self.behind = false;
        self.fresh = None;
        Ok(())
    }

    /// Measures the beat. One that is too fast is looked at again, since a disturbed DRDY has edges too many.
    async fn beat(&mut self) -> Result<(), Error> {
        let mut shortest = 0;
        for _ in 0..LOOKS {
            let first = self.bus.edge();
            self.pause_us(SETTLING * self.count.period_us()).await;
            let last = self.bus.edge();
            if last.count == first.count {
                return Err(self.timeout());
            }
            match self.count.measure(first, last) {
                Ok(()) => return Ok(()),
                Err(period) => shortest = period,
            }
        }
        let clock_hz = ConversionCount::clock_hz(shortest, &self.config);
        Err(Error::Clock { clock_hz })
    }

    /// Reads conversions away until none is left; false if they come faster.
    async fn empty(&mut self) -> Result<bool, Error> {
        for _ in 0..EMPTYING {
            if !has_data(self.exchange(Command::Null).await?.status()) {
                return Ok(true);
            }
        }
        Ok(false)
    }

    /// Waits for the next conversion and reads it.
    ///
    /// # Errors
    /// Any. Conversions that an error costs are missing from the indices of those that follow. Where
    /// [`Error::needs_initialise`], call [`Self::initialise`] before the next call.
    pub async fn next(&mut self) -> Result<Conversion, Error> {
        // Looked at before it is taken: taking nothing moves as many bytes.
        if self.fresh.is_some()
            && let Some(fetched) = self.fresh.take()
        {
            return self.read(&fetched).await;
        }
        let fetched = self.fetch().await?;
        if fetched.is_empty() {
            return Err(self.idle().await);
        }
        match self.count.account(fetched.edge) {
            1 if !self.astray => self.read(&fetched).await,
            passed => self.catch_up(passed).await,
        }
    }

    /// The next conversion and those that were fetched with it, as far as nothing has to be judged between them.
    ///
    /// # Errors
    /// As [`Self::next`]; the batch is empty then, and conversions that were fetched before the one that fails have been
    /// given.
    pub async fn next_batch(&mut self, batch: &mut Batch) -> Result<(), Error> {
        batch.clear();
        batch.begin(&self.next().await?);
        let judged = self.behind || self.astray || self.fresh.is_some();
        if !judged {
            let Self { bus, count, .. } = self;
            bus.drain(|edge, codes| {
                !batch.is_full() && count.is_next(edge) && batch.push(edge.time_us, codes)
            });
        }
        Ok(())
    }

    /// Several conversions wait, or one that made no edge, or DRDY is low for no reason. Throws away what there is, since
    /// it cannot be known which conversions they are; the next one is known by the time of its edge.
    async fn catch_up(&mut self, passed: u32) -> Result<Conversion, Error> {
        self.astray = true;
        if !self.empty().await? {
            self.pause_us(QUIET * self.count.period_us()).await;
            return Err(Error::Overrun { lost: passed });
        }
        let fetched = self.fetch().await?;
        let again = self.count.account(fetched.edge);
        if again == 0 || fetched.is_empty() {
            return Err(self.idle().await);
        }
        self.astray = false;
        self.behind = false;
        match passed.saturating_add(again).saturating_sub(1) {
            0 => self.read(&fetched).await,
            lost => {
                self.fresh = Some(fetched);
                Err(Error::Overrun { lost })
            }
        }
    }

    /// DRDY is low and nothing is converted. The pause keeps that from taking all the time.
    async fn idle(&mut self) -> Error {
        let elapsed_us = self.count.elapsed_us(self.bus.now_us());
        self.pause_half_a_period().await;
        if elapsed_us < u64::from(self.patience_us()) {
            Error::NoData
        } else {
            self.timeout()
        }
    }

    fn patience_us(&self) -> u32 {
        PATIENCE * self.count.period_us()
    }

    fn timeout(&self) -> Error {
        Error::DrdyTimeout {
            waited_us: self.patience_us(),
        }
    }

    /// Reads the one conversion that the last edge announced.
    async fn read(&mut self, fetched: &Fetched) -> Result<Conversion, Error> {
        let behind = core::mem::replace(&mut self.behind, true);
        let mut response = fetched.response?;
        let status = response.status();
        if !is_sound_but_for(status, 0) {
            return Err(Error::Status(status));
        }
        if !has_data(status) {
            return Err(Error::NoData);
        }
        if behind {
            // The first may have been the conversion whose frame failed; then there is a second one.
            let second = self.exchange(Command::Null).await?;
            if self.bus.edge().count != fetched.edge.count {
                // Or the second is a later one: the next call catches up.
                self.astray = true;
                return Err(Error::Overrun { lost: 1 });
            }
            if has_data(second.status()) {
                response = second;
            }
        }
        self.behind = false;
        Ok(Conversion {
            index: self.count.index().saturating_sub(1),
            time_us: fetched.edge.time_us,
            codes: response.codes,
        })
    }

    /// The next conversion in order, whichever it is; alone, while it has to be judged which that is.
    async fn fetch(&mut self) -> Result<Fetched, Error> {
        let ahead = !(self.behind || self.astray);
        match self.bus.fetch(self.patience_us(), ahead).await {
            Ok(fetched) => Ok(fetched),
            Err(FetchError::Timeout) => Err(self.timeout()),
            Err(FetchError::Pin(error)) => Err(Error::Pin(error)),
        }
    }

    async fn exchange(&mut self, command: Command) -> Result<Response, Error> {
        Ok(open(self.bus.exchange(&frame::encode(command)).await)?)
    }
}
