//! DRDY on TIM2 and a timer that counts: every falling edge is counted and stamped in hardware.
//!
//! TIM2 runs at 1 MHz and captures the falling edges on PA0. Each capture sends a trigger pulse, and the board's other timer
//! counts these pulses, so that count and stamp hold however late the software is. TIM2's second channel ends a wait: [`Deadline`],
//! its fourth stamps the vehicle's pulse a second on PA3.

use core::sync::atomic::{AtomicU32, Ordering};

use embassy_stm32::Peri;
use embassy_stm32::gpio::Pull;
use embassy_stm32::pac;
use embassy_stm32::peripherals::{PA0, PA3, TIM2};
use embassy_stm32::time::Hertz;
use embassy_stm32::timer::input_capture::CapturePin;
use embassy_stm32::timer::low_level::{
    InputCaptureMode, InputTISelection, MasterMode, SlaveMode, Timer,
};
use embassy_stm32::timer::{Ch1, Ch4, Channel};
use firmware::adc::count::{Edge, Timers};
use firmware::edge_pair;

use super::board::edges;

/// Ticks of TIM2.
const CLOCK: Hertz = Hertz(1_000_000);

const CAPTURE: usize = 0;
const COMPARE: usize = 1;
const PULSE: usize = 3;

/// Pulses of the vehicle's time since the board started, and TIM2 at the last of them.
static PULSES: AtomicU32 = AtomicU32::new(0);
static PULSE_STAMP: AtomicU32 = AtomicU32::new(0);

/// What TIM2's interrupt is about; reading it takes it away.
pub struct Flags {
    /// DRDY fell.
    pub edge: bool,
    /// A [`Deadline`] has passed.
    pub deadline: bool,
}

/// Takes what TIM2's interrupt is about.
#[inline]
pub fn take_flags() -> Flags {
    let flags = pac::TIM2.sr().read();
    // Cleared by writing zeros; what comes in between stays.
    pac::TIM2.sr().write(|w| w.0 = !flags.0);
    if flags.ccif(PULSE) {
        PULSE_STAMP.store(pac::TIM2.ccr(PULSE).read(), Ordering::Relaxed);
        // Only this interrupt writes it.
        let pulses = PULSES.load(Ordering::Relaxed).wrapping_add(1);
        PULSES.store(pulses, Ordering::Release);
    }
    Flags {
        edge: flags.ccif(CAPTURE),
        deadline: flags.ccif(COMPARE),
    }
}

/// True while DRDY is low.
#[inline]
pub fn is_low() -> bool {
    pac::GPIOA.idr().read().idr(0) == pac::gpio::vals::Idr::LOW
}

/// The last falling edge: the count until then, modulo 2^32, and TIM2 at it.
#[inline]
pub fn edge() -> (u32, u32) {
    edge_pair::read(|| pac::TIM2.ccr(CAPTURE).read(), edges::count)
}

/// Pulses of the vehicle's time until now, and TIM2 at the last of them.
pub fn pulse() -> (u32, u32) {
    let (stamp, pulses) = edge_pair::read(
        || PULSES.load(Ordering::Acquire),
        || PULSE_STAMP.load(Ordering::Relaxed),
    );
    (pulses, stamp)
}

/// The clock TIM2 and the timer that counts.
pub struct DrdyTimers {
    _pin: CapturePin<'static, TIM2, Ch1>,
    _pulse: CapturePin<'static, TIM2, Ch4>,
    _clock: Timer<'static, TIM2>,
    _count: Timer<'static, edges::Counter>,
    now_us: u64,
}

impl DrdyTimers {
    /// Starts both timers. Their interrupt has still to be enabled.
    pub fn start(
        clock: Peri<'static, TIM2>,
        count: Peri<'static, edges::Counter>,
        pin: Peri<'static, PA0>,
        pulse: Peri<'static, PA3>,
    ) -> Self {
        let count = Timer::new(count);
        count.set_trigger_source(edges::TRIGGER);
        count.set_slave_mode(SlaveMode::EXT_CLOCK_MODE);
        count.start();

        let pin = CapturePin::new(pin, Pull::Up);
        let pulse = CapturePin::new(pulse, Pull::Down);
        let mut clock = Timer::new(clock);
        clock.set_tick_freq(CLOCK);
        clock.set_max_compare_value(u32::MAX);
        clock.set_input_ti_selection(Channel::Ch1, InputTISelection::Normal);
        clock.set_input_capture_mode(Channel::Ch1, InputCaptureMode::Falling);
        clock.enable_channel(Channel::Ch1, true);
        clock.set_input_ti_selection(Channel::Ch4, InputTISelection::Normal);
        clock.set_input_capture_mode(Channel::Ch4, InputCaptureMode::Rising);
        clock.enable_channel(Channel::Ch4, true);
        clock.set_master_mode(MasterMode::COMPARE_PULSE);
        clock.generate_update_event();
        // Each channel compared until here, and was equal at zero.
        pac::TIM2.sr().write(|w| w.0 = 0);
        clock.enable_input_interrupt(Channel::Ch1, true);
        clock.enable_input_interrupt(Channel::Ch2, true);
        clock.enable_input_interrupt(Channel::Ch4, true);
        clock.start();
        Self {
            _pin: pin,
            _pulse: pulse,
            _clock: clock,
            _count: count,
            now_us: 0,
        }
    }
}

/// An edge of less than an hour ago on the clock that does not turn, which stands at `now_us`.
#[inline]
pub fn edge_at(now_us: u64, count: u32, stamp: u32) -> Edge {
    let ago_us = (now_us as u32).wrapping_sub(stamp);
    Edge {
        count,
        time_us: now_us.saturating_sub(u64::from(ago_us)),
    }
}

impl Timers for DrdyTimers {
    fn edge(&mut self) -> Edge {
        let (count, stamp) = edge();
        edge_at(self.now_us(), count, stamp)
    }

    /// The counter has 32 bits; asked at least once an hour, this clock does not lose a turn.
    fn now_us(&mut self) -> u64 {
        let passed = pac::TIM2.cnt().read().wrapping_sub(self.now_us as u32);
        self.now_us += u64::from(passed);
        self.now_us
    }
}

/// An instant at which TIM2 wakes the acquisition; one at a time.
pub struct Deadline(u32);

impl Deadline {
    /// From now on, half an hour at the most.
    #[inline]
    pub fn after_us(duration_us: u32) -> Self {
        let now = pac::TIM2.cnt().read();
        // One tick more, since the first is under way.
        let end = now.wrapping_add(duration_us.saturating_add(1).min(i32::MAX as u32));
        pac::TIM2.ccr(COMPARE).write_value(end);
        Self(end)
    }

    /// True once it has passed.
    #[inline]
    pub fn is_over(&self) -> bool {
        self.0.wrapping_sub(pac::TIM2.cnt().read()) as i32 <= 0
    }
}
