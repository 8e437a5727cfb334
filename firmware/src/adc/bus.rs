//! How frames get to the converter and back: [`FrameBus`], and [`HalBus`], which does it with what embedded-hal has.
//!
//! A board may do better. Reading a conversion is always the same frame, so that hardware and interrupts can fetch
//! conversions ahead while the software sleeps; each comes with the edge of DRDY at which it was fetched.

use ads131m0x::asynchronous::Transport;
use embassy_futures::select::{Either, select};
use embedded_hal::digital::{Error as _, ErrorKind as PinError};
use embedded_hal::spi::{Error as _, ErrorKind as SpiError};
use embedded_hal_async::delay::DelayNs;
use embedded_hal_async::digital::Wait;
use embedded_hal_async::spi::SpiDevice;

use super::count::{Edge, Timers};
use super::frame::{self, ChecksumError, FRAME, NULL, Response};
use super::registers::{has_data, is_sound_but_for};

/// A conversion as it was fetched.
#[derive(Clone, Copy, Debug)]
pub struct Fetched {
    /// The last falling edge of DRDY when its frame was begun.
    pub edge: Edge,
    /// What the converter answered to a null command, or why that is not known.
    pub response: Result<Response, FrameError>,
}

impl Fetched {
    /// True when the converter had nothing new to say: DRDY was low for no reason.
    pub fn is_empty(&self) -> bool {
        let sound = self.response.map(|response| response.status());
        sound.is_ok_and(|status| is_sound_but_for(status, 0) && !has_data(status))
    }
}

/// Why a frame from the converter is worth nothing.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FrameError {
    /// The bus reported an error.
    Spi(SpiError),
    /// Its checksum is wrong.
    Checksum(ChecksumError),
}

/// Opens a frame that came, if one came.
#[inline]
pub fn open(frame: Result<[u8; FRAME], SpiError>) -> Result<Response, FrameError> {
    match frame {
        Ok(frame) => frame::decode(frame::words(&frame)).map_err(FrameError::Checksum),
        Err(error) => Err(FrameError::Spi(error)),
    }
}

/// Why nothing was fetched.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FetchError {
    /// DRDY did not fall in time.
    Timeout,
    /// The pin reported an error.
    Pin(PinError),
}

/// The way to the converter.
#[allow(async_fn_in_trait)] // Nobody asks these futures to be sent to another thread.
pub trait FrameBus: Timers {
    /// Sends a frame now and returns what came meanwhile. What was fetched ahead is thrown away before.
    ///
    /// # Errors
    /// What the bus reports.
    async fn exchange(&mut self, frame: &[u8; FRAME]) -> Result<[u8; FRAME], SpiError>;

    /// The next conversion in order: waits until DRDY is low, and reads it by a null command. Those after it are fetched
    /// ahead only where `ahead` says so.
    ///
    /// # Errors
    /// [`FetchError`]; a timeout after `patience_us` without any conversion.
    async fn fetch(&mut self, patience_us: u32, ahead: bool) -> Result<Fetched, FetchError>;

    /// Takes the sound conversions that were fetched ahead, in order, as far as `take` takes them: the edge of each and its
    /// codes. Where it refuses one, or one is not sound, [`Self::fetch`] gives it.
    fn drain(&mut self, take: impl FnMut(Edge, [i32; frame::CHANNELS]) -> bool);

    /// True while a conversion that was fetched ahead waits for [`Self::fetch`].
    fn has_fetched(&self) -> bool;

    /// Puts the bus in order, whatever it was in the middle of: nothing is under way afterwards, nothing fetched, and no
    /// byte is left in its registers that would shift every frame to come.
    async fn recover(&mut self);

    /// Lets others run for that long.
    async fn pause_us(&mut self, duration_us: u32);
}

/// A bus of embedded-hal's parts, which fetches nothing ahead: DRDY stays low until a conversion is read, so that none
/// is missed by being late.
pub struct HalBus<SPI, DRDY, DELAY, TIMERS> {
    /// The converter's SPI with its chip select, mode 1.
    pub spi: SPI,
    /// The pin DRDY.
    pub drdy: DRDY,
    /// The acquisition's delays.
    pub delay: DELAY,
    /// The board's timers.
    pub timers: TIMERS,
}

impl<SPI, DRDY, DELAY, TIMERS: Timers> Timers for HalBus<SPI, DRDY, DELAY, TIMERS> {
    fn edge(&mut self) -> Edge {
        self.timers.edge()
    }

    fn now_us(&mut self) -> u64 {
        self.timers.now_us()
    }
}

impl<SPI, DRDY, DELAY, TIMERS> FrameBus for HalBus<SPI, DRDY, DELAY, TIMERS>
where
    SPI: SpiDevice,
    DRDY: Wait,
    DELAY: DelayNs,
    TIMERS: Timers,
{
    async fn exchange(&mut self, frame: &[u8; FRAME]) -> Result<[u8; FRAME], SpiError> {
        let mut receive = [0; FRAME];
        match self.spi.transfer(&mut receive, frame).await {
            Ok(()) => Ok(receive),
            Err(error) => Err(error.kind()),
        }
    }

    async fn fetch(&mut self, patience_us: u32, _: bool) -> Result<Fetched, FetchError> {
        match select(self.drdy.wait_for_low(), self.delay.delay_us(patience_us)).await {
            Either::First(Ok(())) => {}
            Either::First(Err(error)) => return Err(FetchError::Pin(error.kind())),
            Either::Second(()) => return Err(FetchError::Timeout),
        }
        let edge = self.timers.edge();
        Ok(Fetched {
            edge,
            response: open(self.exchange(&NULL).await),
        })
    }

    fn drain(&mut self, _: impl FnMut(Edge, [i32; frame::CHANNELS]) -> bool) {}

    fn has_fetched(&self) -> bool {
        false
    }

    /// The device leaves nothing behind between two transactions, or its own driver is at fault.
    async fn recover(&mut self) {}

    async fn pause_us(&mut self, duration_us: u32) {
        self.delay.delay_us(duration_us).await;
    }
}

/// A bus as the way to the converter of its driver, for setting it up.
pub(super) struct Through<'b, BUS>(pub &'b mut BUS);

impl<BUS: FrameBus> Transport for Through<'_, BUS> {
    type Error = SpiError;

    async fn transfer(&mut self, received: &mut [u8], sent: &[u8]) -> Result<(), SpiError> {
        // The driver's frames are as long as this bus's, since their format is the same.
        let (Ok(sent), Ok(received)) = (sent.try_into(), <&mut [u8; FRAME]>::try_from(received))
        else {
            return Err(SpiError::Other);
        };
        *received = self.0.exchange(sent).await?;
        Ok(())
    }
}
