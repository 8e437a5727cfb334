//! What runs on every board: acquisition above, link and memory below, and the watchdog over all of them.

mod memory;
mod postmortem;
mod stack;
mod watchdog;

use core::cell::Cell;
use core::sync::atomic::{AtomicU32, Ordering};

use embassy_executor::{InterruptExecutor, Spawner};
use embassy_futures::select::select;
use embassy_stm32::gpio::{Input, Output};
use embassy_stm32::uid;
use embassy_sync::blocking_mutex::CriticalSectionMutex;
use embassy_sync::blocking_mutex::raw::CriticalSectionRawMutex;
use embassy_sync::signal::Signal;
use embassy_time::{Delay, Timer};
use firmware::adc::registers::{Config, Gain, REFERENCE_V};
use firmware::adc::{Ads131m04, Reset};
use firmware::app::App;
use firmware::check::Check;
use firmware::conversation::Conversation;
use firmware::link::Queues;
use firmware::sampler::{Acquisition, Around, Sampler};
use firmware::store::Kept;
use firmware::watch::{Supervisor, Task};
use shared::identify::static_test::workspace_len;
use shared::self_check::{MARKS, MOUNTS, SelfCheck, SetUp, Verdicts};
use shared::wire::configuration::Certified;
use shared::wire::message::Identity;
use shared::wire::version;
use static_cell::StaticCell;

use crate::boards::board::{self, Sender, Thermometer};
use crate::boards::conveyor::Bus;
use crate::boards::receiver::{Receiver, received};
use crate::boards::{Parts, Surroundings, drdy};
use memory::Memory;

/// Baud of the link: what both ends divide exactly from their clocks.
pub const BAUD: u32 = 1_000_000;

/// Conversions in a block: a hundred blocks a second at 4 kSPS.
const BLOCK_SAMPLES: u16 = 40;

/// How long the link sleeps when nothing is said or heard: what a command may wait while nothing is converted.
const LISTEN_MS: u64 = 5;

/// How often it is looked whether all tasks live, and how many looks there are to a measurement of temperatures.
const LOOK_MS: u64 = 100;
const LOOKS_A_MEASUREMENT: u32 = 10;

/// Numbers that the self-check works in.
const WORKSPACE_LEN: usize = workspace_len(MARKS, MOUNTS);

/// The acquisition of this board. A task holds it by reference: what is moved into a task lies there twice.
type TheAcquisition = Acquisition<'static, Bus, Output<'static>>;

/// The link of this board.
type TheConversation = Conversation<Receiver, Sender, Delay>;

static ACQUISITION: InterruptExecutor = InterruptExecutor::new();
static QUEUES: StaticCell<Queues> = StaticCell::new();
static APP: StaticCell<App<'static>> = StaticCell::new();
static ACQUIRING: StaticCell<TheAcquisition> = StaticCell::new();
static CONVERSING: StaticCell<TheConversation> = StaticCell::new();
static WORKSPACE: StaticCell<[f64; WORKSPACE_LEN]> = StaticCell::new();

/// Set when the link has something to do: a report waits for the line, the host has said something, or the memory was
/// written.
static LINK_CALLED: Signal<CriticalSectionRawMutex, ()> = Signal::new();

/// What was measured last of the surroundings, for the acquisition until it takes it, and for the link.
static AROUND: Signal<CriticalSectionRawMutex, Around> = Signal::new();
static AROUND_NOW: CriticalSectionMutex<Cell<Option<Around>>> =
    CriticalSectionMutex::new(Cell::new(None));

/// Bytes of the stack that were never used.
static STACK_FREE: AtomicU32 = AtomicU32::new(0);

/// The tasks as the watchdog sees them; the self-check is part of the link's.
static TASKS: [Task; 3] = [const { Task::new() }; 3];
const ACQUIRES: usize = 0;
const CONVERSES: usize = 1;
const REMEMBERS: usize = 2;
const NAMES: [&str; 3] = ["acquisition", "link", "memory"];

/// To be called by the interrupt [`board::ACQUISITION`] and by nobody else.
#[inline]
pub fn on_acquisition_interrupt() {
    // SAFETY: that handler is the only caller, and its vector is enabled by `InterruptExecutor::start`.
    #[allow(unsafe_code)]
    unsafe {
        ACQUISITION.on_interrupt();
    }
}

#[embassy_executor::main]
async fn main(spawner: Spawner) {
    watchdog::start();
    let (flash, parts) = board::start();
    board::unlock_backup();
    static MEMORY: StaticCell<Memory> = StaticCell::new();
    let memory = MEMORY.init(memory::open(flash));
    let known = memory.load().await;
    memory::tell(known.1);
    let thermometer = assemble(spawner, parts, known);
    spawner.spawn(defmt::unwrap!(remember(memory)));
    supervise(thermometer).await
}

/// Puts acquisition and link together and starts them. Not part of `main`, whose task would hold everything for good.
fn assemble(spawner: Spawner, parts: Parts, known: (Option<Certified>, Kept)) -> Thermometer {
    let Parts {
        bus,
        reset,
        receiver,
        sender,
        protect,
        mut thermometer,
        time_base,
        brown_out_guarded,
    } = parts;
    let config = Config::BUILT;
    let converter = Ads131m04::on_bus(bus, reset, config);
    let (to_application, to_acquisition) = QUEUES.init(Queues::new()).split();
    let mut sampler = Sampler::new(to_application, BLOCK_SAMPLES);
    let app = App::new(identity(&config), to_acquisition).with_kept(known, &mut sampler);
    let mut app = match SelfCheck::new(SetUp::default(), WORKSPACE.init([0.0; WORKSPACE_LEN])) {
        Ok(check) => app.with_check(Check::new(check)),
        Err(_) => app,
    };
    let told = app.board();
    (told.cause, told.boots) = postmortem::take();
    told.time_base = time_base;
    told.brown_out_guarded = brown_out_guarded;
    if !brown_out_guarded {
        defmt::warn!("no brown-out level 3: the flash may be written on falling power");
    }
    measure(&mut thermometer);

    let acquisition = Acquisition::new(converter, sampler, Reset::Pin);
    let above = ACQUISITION.start(board::ACQUISITION);
    above.spawn(defmt::unwrap!(acquire(ACQUIRING.init(acquisition))));
    let conversation = CONVERSING.init(Conversation::new(receiver, sender, Delay));
    spawner.spawn(defmt::unwrap!(converse(
        APP.init(app),
        conversation,
        protect
    )));
    thermometer
}

/// Feeds the watchdog while every task lives, measures the surroundings, and restarts when the clock is lost.
async fn supervise(mut thermometer: Thermometer) -> ! {
    let mut supervisor = Supervisor::new([0, 1, 2].map(|n| &TASKS[n]));
    let mut looks = 0;
    let mut told = false;
    loop {
        Timer::after_millis(LOOK_MS).await;
        if board::clock_is_lost() {
            postmortem::restart_without_clock();
        }
        if supervisor.all_alive() {
            watchdog::feed();
            told = false;
        } else if let (false, Some(name)) =
            (told, supervisor.first_dead().and_then(|n| NAMES.get(n)))
        {
            defmt::error!("no step of the {}", name);
            told = true;
        }
        looks += 1;
        if looks == LOOKS_A_MEASUREMENT {
            looks = 0;
            measure(&mut thermometer);
        }
    }
}

fn measure(thermometer: &mut Thermometer) {
    let around = thermometer.measure();
    AROUND.signal(around);
    AROUND_NOW.lock(|now| now.set(Some(around)));
    STACK_FREE.store(stack::free(), Ordering::Relaxed);
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
    let mut last = received();
    let mut pulses = 0;
    loop {
        acquisition.step().await;
        TASKS[ACQUIRES].step();
        // The rest once for all that was fetched together.
        if acquisition.has_fetched() {
            continue;
        }
        let (count, stamp) = drdy::pulse();
        if count != pulses {
            pulses = count;
            acquisition.note_pulse(count, stamp);
        }
        if let Some(around) = AROUND.try_take() {
            acquisition.sampler().set_around(around);
        }
        // The receiver has no interrupt of its own; orders are carried out between two fetches anyway.
        let (waits, came) = (acquisition.waiting(), received());
        if waits > waiting || came != last {
            LINK_CALLED.signal(());
        }
        (waiting, last) = (waits, came);
    }
}

/// Hears the host and answers, one frame at a time.
#[embassy_executor::task]
async fn converse(
    app: &'static mut App<'static>,
    conversation: &'static mut TheConversation,
    protect: Input<'static>,
) {
    loop {
        TASKS[CONVERSES].step();
        let told = app.board();
        told.write_protected = protect.is_low();
        if let Some(around) = AROUND_NOW.lock(Cell::get) {
            told.board_c = around.board_c;
            told.instrument_c = around.instrument_c;
        }
        told.stack_free = Some(STACK_FREE.load(Ordering::Relaxed));
        conversation.hear(app);
        if let Some(verdicts) = app.concluded() {
            tell(verdicts);
        }
        if let Some(keep) = app.keep() {
            memory::KEEP.signal(keep);
        }
        if let Some(kept) = memory::KEPT.try_take() {
            app.stored(kept);
        }
        if !conversation
            .say(app, async || LINK_CALLED.wait().await)
            .await
        {
            select(LINK_CALLED.wait(), Timer::after_millis(LISTEN_MS)).await;
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
    memory::serve(memory, || LINK_CALLED.signal(())).await
}
