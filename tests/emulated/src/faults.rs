//! Faults of the converter and of its way to the board, around any model of one.

use crate::board::{Shared, lock};
use crate::converter::Converter;
use crate::random::Random;

/// What is broken; set from outside, at any time.
#[derive(Clone, Copy, Debug, Default)]
pub struct ConverterFaults {
    /// Share of the frames from the converter in which one bit is wrong, 0 to 1.
    pub wrong_bits: f64,
    /// What the pin DRDY does.
    pub drdy: Drdy,
    /// The converter resets itself once, as after a dip of its supply.
    pub reset: bool,
}

/// What the pin DRDY does.
#[derive(Clone, Copy, Debug, Default)]
pub enum Drdy {
    /// It follows the converter.
    #[default]
    Sound,
    /// Always low.
    StuckLow,
    /// Always high.
    StuckHigh,
    /// It falls late, not at all, or once more for a microsecond.
    Irregular {
        /// How late at the most, ns.
        jitter_ns: u64,
        /// Share of the conversions that it does not tell, 0 to 1.
        missing: f64,
        /// Share of the conversions after which it falls or rises once more, 0 to 1.
        extra: f64,
    },
}

const EXTRA_NS: u64 = 1000;

/// Bits of a frame, its last byte of zeros left out.
const FRAME_BITS: u64 = 8 * 17;

/// A converter with faults.
#[derive(Debug)]
pub struct Faulty<C> {
    converter: C,
    faults: Shared<ConverterFaults>,
    random: Random,
    now_ns: u64,
    /// Conversions until [`Self::now_ns`], as far as DRDY knows of them.
    told: u64,
    /// DRDY is held high until then.
    held_ns: u64,
    /// When DRDY does what nobody asked for, if it does.
    extra_ns: Option<u64>,
    /// The bit of the frame that is wrong, and the bytes that went over the bus.
    wrong_bit: Option<u64>,
    byte: u64,
}

impl<C: Converter> Faulty<C> {
    /// With these faults, which are by chance from this seed on.
    pub fn new(converter: C, faults: Shared<ConverterFaults>, seed: u64) -> Self {
        Self {
            converter,
            faults,
            random: Random::new(seed),
            now_ns: 0,
            told: 0,
            held_ns: 0,
            extra_ns: None,
            wrong_bit: None,
            byte: 0,
        }
    }

    fn drdy(&self) -> Drdy {
        lock(&self.faults).drdy
    }

    /// What becomes of the edge of the conversion that just ended.
    fn spoil_edge(&mut self, jitter_ns: u64, missing: f64, extra: f64) {
        let next_ns = self.converter.next_event_ns();
        let period_ns = next_ns.saturating_sub(self.now_ns);
        self.held_ns = if self.random.chance(missing) {
            next_ns
        } else {
            self.now_ns + self.random.below(jitter_ns + 1)
        };
        let extra = self.random.chance(extra);
        self.extra_ns = extra.then(|| self.now_ns + self.random.below(period_ns));
    }
}

impl<C: Converter> Converter for Faulty<C> {
    fn drive_reset(&mut self, now_ns: u64, low: bool) {
        self.converter.drive_reset(now_ns, low);
    }

    fn advance(&mut self, now_ns: u64) {
        if std::mem::take(&mut lock(&self.faults).reset) {
            self.converter.drive_reset(now_ns, true);
            self.converter.drive_reset(now_ns, false);
        }
        self.converter.advance(now_ns);
        self.now_ns = now_ns;
        let conversions = self.converter.conversions();
        if std::mem::replace(&mut self.told, conversions) == conversions {
            return;
        }
        if let Drdy::Irregular {
            jitter_ns,
            missing,
            extra,
        } = self.drdy()
        {
            self.spoil_edge(jitter_ns, missing, extra);
        }
    }

    fn next_event_ns(&self) -> u64 {
        let extra = self.extra_ns.into_iter();
        let own = extra
            .flat_map(|at| [at, at + EXTRA_NS])
            .chain([self.held_ns]);
        let next = own.filter(|at| *at > self.now_ns).min();
        let event = self.converter.next_event_ns();
        next.map_or(event, |next| next.min(event))
    }

    fn drdy_is_low(&self) -> bool {
        let sound = self.converter.drdy_is_low();
        match self.drdy() {
            Drdy::Sound => sound,
            Drdy::StuckLow => true,
            Drdy::StuckHigh => false,
            Drdy::Irregular { .. } => {
                let low = sound && self.now_ns >= self.held_ns;
                let within = |at: u64| (at..at + EXTRA_NS).contains(&self.now_ns);
                low != self.extra_ns.is_some_and(within)
            }
        }
    }

    fn select(&mut self) {
        let wrong_bits = lock(&self.faults).wrong_bits;
        let wrong = self.random.chance(wrong_bits);
        self.wrong_bit = wrong.then(|| self.random.below(FRAME_BITS));
        self.byte = 0;
        self.converter.select();
    }

    fn exchange(&mut self, byte: u8) -> u8 {
        let answer = self.converter.exchange(byte);
        self.byte += 1;
        match self.wrong_bit {
            Some(bit) if bit / 8 + 1 == self.byte => answer ^ 1 << (bit % 8),
            _ => answer,
        }
    }

    fn deselect(&mut self) {
        self.converter.deselect();
    }

    fn conversions(&self) -> u64 {
        self.converter.conversions()
    }
}
