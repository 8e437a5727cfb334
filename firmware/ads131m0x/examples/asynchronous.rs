//! Waits for DRDY and reads an ADS131M02 for ever, for any executor. It has no hardware to run on here; on a board,
//! spawn `acquire` with its SPI device and pins.

use ads131m0x::asynchronous::{Ads131m02, reset_by_pin};
use ads131m0x::{Error, Oversampling, Settings};
use embedded_hal::digital::OutputPin;
use embedded_hal_async::delay::DelayNs;
use embedded_hal_async::digital::Wait;
use embedded_hal_async::spi::SpiDevice;

/// Hands each conversion to `take`, until something goes wrong.
async fn acquire<SPI: SpiDevice>(
    spi: SPI,
    drdy: &mut impl Wait,
    reset: &mut impl OutputPin,
    delay: &mut impl DelayNs,
    mut take: impl FnMut([i32; 2]),
) -> Error<SPI::Error> {
    let settings = Settings::<2> {
        oversampling: Oversampling::X4096,
        ..Settings::RESET
    };
    let _ = reset_by_pin(reset, delay, settings.clock_hz).await;
    let mut converter = Ads131m02::new(spi);
    if let Err(error) = converter.expect_reset().await {
        return error;
    }
    if let Err(error) = converter.set_up(&settings, delay).await {
        return error;
    }
    loop {
        let _ = drdy.wait_for_low().await;
        match converter.read().await {
            Ok(conversion) => take(conversion.codes),
            // One frame is lost; the next read brings the following conversion.
            Err(Error::Checksum(_)) => {}
            Err(error) => return error,
        }
    }
}

fn main() {
    use embedded_hal_mock::eh1::{delay::NoopDelay, digital::Mock as Pin, spi::Mock as Spi};
    let (spi, mut pin) = (Spi::new(&[]), Pin::new(&[]));
    let (mut drdy, mut reset, mut delay) = (pin.clone(), pin.clone(), NoopDelay::new());
    let future = acquire(spi.clone(), &mut drdy, &mut reset, &mut delay, |codes| {
        println!("{codes:?}");
    });
    println!(
        "the acquisition is a future of {} bytes",
        size_of_val(&future)
    );
    drop(future);
    pin.done();
    spi.clone().done();
}
