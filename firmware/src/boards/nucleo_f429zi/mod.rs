//! The NUCLEO-F429ZI: clocks, pins, interrupts and executors.
//!
//! | ADS131M04 | pin | connector |
//! |---|---|---|
//! | SCLK | PE2 (SPI4) | CN9-14 |
//! | CS | PE4 | CN9-16 |
//! | DOUT | PE5 (SPI4) | CN9-18 |
//! | DIN | PE6 (SPI4) | CN9-20 |
//! | SYNC/RESET | PE3 | CN9-22 |
//! | DRDY | PA0 (TIM2) | CN10-29 |
//!
//! The link to the host is USART3 (PD8, PD9), the debugger's virtual serial port, at 921 600 baud.

mod bus;
mod drdy;
mod memory;
mod postmortem;

use core::sync::atomic::{AtomicU32, Ordering};
use core::task::Poll;

use defmt_rtt as _;
use embassy_executor::{InterruptExecutor, Spawner};
use embassy_futures::poll_once;
use embassy_futures::select::{Either, select};
use embassy_stm32::gpio::{Level, Output, Speed};
use embassy_stm32::interrupt::{InterruptExt, Priority};
use embassy_stm32::mode::Async;
use embassy_stm32::spi::{self, Spi};
use embassy_stm32::time::Hertz;
use embassy_stm32::usart::{self, RingBufferedUartRx, Uart, UartTx};
use embassy_stm32::wdg::IndependentWatchdog;
use embassy_stm32::{bind_interrupts, dma, flash, interrupt, peripherals, rcc, uid};
use embassy_sync::blocking_mutex::raw::CriticalSectionRawMutex;
use embassy_sync::signal::Signal;
use embassy_time::Timer;
use firmware::adc::registers::{Config, Gain, REFERENCE_V};
use firmware::adc::{Ads131m04, Reset};
use firmware::app::App;
use firmware::check::Check;
use firmware::link::Queues;
use firmware::sampler::{Acquisition, Sampler};
use shared::identify::static_test::workspace_len;
use shared::self_check::{MARKS, MOUNTS, SelfCheck, SetUp, Verdicts};
use shared::wire::framing::Frame;
use shared::wire::message::Identity;
use shared::wire::version;
use static_cell::StaticCell;

use bus::Bus;
use drdy::DrdyTimers;
use memory::Memory;

bind_interrupts!(struct Interrupts {
    USART3 => usart::InterruptHandler<peripherals::USART3>;
    DMA1_STREAM1 => dma::InterruptHandler<peripherals::DMA1_CH1>;
    DMA1_STREAM3 => dma::InterruptHandler<peripherals::DMA1_CH3>;
    FLASH => flash::InterruptHandler;
});

/// Baud of the link.
const BAUD: u32 = 921_600;

/// Clock of the converter's bus; the divider gives 10.5 MHz.
const SPI_CLOCK: Hertz = Hertz(10_500_000);

/// Conversions in a block: a hundred blocks a second at 4 kSPS.
const BLOCK_SAMPLES: u16 = 40;

/// What comes from the host while a frame is sent has to fit: 9 ms at 921 600 baud are 830 bytes.
const INCOMING_BYTES: usize = 2048;

/// Numbers that the self-check works in.
const WORKSPACE_LEN: usize = workspace_len(MARKS, MOUNTS);

/// The watchdog restarts the board when the acquisition made no step for this long.
const WATCHDOG_US: u32 = 1_000_000;

/// The acquisition of this board. A task holds it by reference: what is moved into a task lies there twice.
type TheAcquisition = Acquisition<'static, Bus, Output<'static>>;

static ACQUISITION: InterruptExecutor = InterruptExecutor::new();
static QUEUES: StaticCell<Queues> = StaticCell::new();
static APP: StaticCell<App<'static>> = StaticCell::new();
static ACQUIRING: StaticCell<TheAcquisition> = StaticCell::new();
static WORKSPACE: StaticCell<[f64; WORKSPACE_LEN]> = StaticCell::new();
static INCOMING: StaticCell<[u8; INCOMING_BYTES]> = StaticCell::new();

/// Set when the application has something to do: a report waits for the line, or the memory was written.
static REPORTS: Signal<CriticalSectionRawMutex, ()> = Signal::new();

/// Steps of the acquisition, for the watchdog.
static STEPS: AtomicU32 = AtomicU32::new(0);

/// A vector that no peripheral of this board uses carries the acquisition, above everything but the
/// interrupts that wake it.
#[interrupt]
fn CAN2_SCE() {
    // SAFETY: only this handler calls it, and the vector is enabled by `InterruptExecutor::start`.
    #[allow(unsafe_code)]
    unsafe {
        ACQUISITION.on_interrupt();
    }
}

/// 168 MHz from the 8 MHz that the debugger supplies.
fn clocks() -> embassy_stm32::Config {
    let mut config = embassy_stm32::Config::default();
    config.rcc.hse = Some(rcc::Hse {
        freq: Hertz(8_000_000),
        mode: rcc::HseMode::Bypass,
    });
    config.rcc.pll_src = rcc::PllSource::HSE;
    config.rcc.pll = Some(rcc::Pll {
        prediv: rcc::PllPreDiv::DIV4,
        mul: rcc::PllMul::MUL168,
        divp: Some(rcc::PllPDiv::DIV2),
        divq: None,
        divr: None,
    });
    config.rcc.ahb_pre = rcc::AHBPrescaler::DIV1;
    config.rcc.apb1_pre = rcc::APBPrescaler::DIV4;
    config.rcc.apb2_pre = rcc::APBPrescaler::DIV2;
    config.rcc.sys = rcc::Sysclk::PLL1_P;
    config
}

#[embassy_executor::main]
async fn main(spawner: Spawner) {
    let p = embassy_stm32::init(clocks());
    postmortem::unlock();
    defmt::info!("restarted: {}", postmortem::take());

    // Below the acquisition: link and memory may wait.
    for below in [
        interrupt::USART3,
        interrupt::DMA1_STREAM1,
        interrupt::DMA1_STREAM3,
        interrupt::FLASH,
    ] {
        below.set_priority(Priority::P12);
    }
    interrupt::CAN2_SCE.set_priority(Priority::P6);
    for converter in [interrupt::TIM2, interrupt::DMA2_STREAM0] {
        // SAFETY: their handlers share nothing but atomics with the rest.
        #[allow(unsafe_code)]
        unsafe {
            converter.enable();
        }
    }

    let memory = memory::open(p.FLASH, Interrupts, p.PA12);
    let known = memory.load().await;
    memory::tell(known.1);

    let mut spi_config = spi::Config::default();
    spi_config.mode = spi::MODE_1;
    spi_config.frequency = SPI_CLOCK;
    let spi = Spi::new_blocking(p.SPI4, p.PE2, p.PE6, p.PE5, spi_config);
    let select = Output::new(p.PE4, Level::High, Speed::VeryHigh);
    let reset = Output::new(p.PE3, Level::High, Speed::Low);
    let bus = Bus::new(spi, select, DrdyTimers::start(p.TIM2, p.TIM5, p.PA0));
    let config = Config::BUILT;
    let converter = Ads131m04::on_bus(bus, reset, config);

    let (to_application, to_acquisition) = QUEUES.init(Queues::new()).split();
    let (app, sampler) = {
        // Borrowed in here only, so that the task does not hold it for good.
        let mut sampler = Sampler::new(to_application, BLOCK_SAMPLES);
        let app = App::new(identity(&config), to_acquisition);
        (app.with_kept(known, &mut sampler), sampler)
    };
    let acquisition = Acquisition::new(converter, sampler, Reset::Pin);
    let above = ACQUISITION.start(interrupt::CAN2_SCE);
    above.spawn(defmt::unwrap!(acquire(ACQUIRING.init(acquisition))));

    let mut uart_config = usart::Config::default();
    uart_config.baudrate = BAUD;
    let uart = Uart::new(
        p.USART3,
        p.PD9,
        p.PD8,
        p.DMA1_CH3,
        p.DMA1_CH1,
        Interrupts,
        uart_config,
    );
    let Ok(uart) = uart else {
        defmt::panic!("the link's clock does not give {} baud", BAUD);
    };
    let (sender, receiver) = uart.split();
    let receiver = receiver.into_ring_buffered(INCOMING.init([0; INCOMING_BYTES]));
    let app = match SelfCheck::new(SetUp::default(), WORKSPACE.init([0.0; WORKSPACE_LEN])) {
        Ok(check) => app.with_check(Check::new(check)),
        Err(_) => app,
    };
    spawner.spawn(defmt::unwrap!(converse(APP.init(app), sender, receiver)));
    spawner.spawn(defmt::unwrap!(remember(memory)));

    let mut watchdog = IndependentWatchdog::new(p.IWDG, WATCHDOG_US);
    watchdog.unleash();
    let mut seen = 0;
    loop {
        Timer::after_millis(100).await;
        let steps = STEPS.load(Ordering::Relaxed);
        if steps != seen {
            seen = steps;
            watchdog.pet();
        }
    }
}

/// Who this is.
fn identity(config: &Config) -> Identity {
    Identity {
        minimum: version::MINIMUM,
        current: version::CURRENT,
        firmware: [
            env!("CARGO_PKG_VERSION_MAJOR"),
            env!("CARGO_PKG_VERSION_MINOR"),
            env!("CARGO_PKG_VERSION_PATCH"),
        ]
        .map(|number| number.parse().unwrap_or(u8::MAX)),
        serial: uid::uid(),
        sample_rate_hz: config.sample_rate_hz(),
        reference_v: REFERENCE_V,
        gains: config.gains.map(Gain::factor),
        block_samples: BLOCK_SAMPLES,
    }
}

/// Reads the converter for ever, above everything else.
#[embassy_executor::task]
async fn acquire(acquisition: &'static mut TheAcquisition) {
    let mut waiting = 0;
    loop {
        acquisition.step().await;
        STEPS.fetch_add(1, Ordering::Relaxed);
        let now = acquisition.waiting();
        if now > waiting {
            REPORTS.signal(());
        }
        waiting = now;
    }
}

/// Hears the host and answers, one frame at a time.
#[embassy_executor::task]
async fn converse(
    app: &'static mut App<'static>,
    mut sender: UartTx<'static, Async>,
    mut receiver: RingBufferedUartRx<'static>,
) {
    let mut frame = Frame::new();
    let mut bytes = [0; 64];
    loop {
        // A line error costs the frame that it falls into, which the checksum tells.
        if let Poll::Ready(Ok(count)) = poll_once(receiver.read(&mut bytes)) {
            app.receive(bytes.get(..count).unwrap_or(&[]));
        }
        if let Some(verdicts) = app.concluded() {
            tell(verdicts);
        }
        if let Some(keep) = app.keep() {
            memory::KEEP.signal(keep);
        }
        if let Some(kept) = memory::KEPT.try_take() {
            app.stored(kept);
        }
        if app.transmit(&mut frame) {
            // Only a bus error of the DMA fails it; the host misses the frame by its number.
            let _ = sender.write(frame.as_bytes()).await;
        } else if let Either::First(Ok(count)) =
            select(receiver.read(&mut bytes), REPORTS.wait()).await
        {
            app.receive(bytes.get(..count).unwrap_or(&[]));
        }
    }
}

/// Logs what a self-check found.
fn tell(verdicts: Verdicts) {
    if verdicts.passed() {
        defmt::info!("self-check: passed");
    }
    for verdict in verdicts.iter() {
        defmt::warn!("self-check: {}", verdict.name());
    }
}

/// Writes to the memory what it is told; nobody waits for it.
#[embassy_executor::task]
async fn remember(memory: &'static mut Memory) {
    memory::serve(memory, || REPORTS.signal(())).await
}
