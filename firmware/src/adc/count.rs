//! Which conversion is which: the index, moved on by the DRDY edges that hardware counted and stamped.
//!
//! The edges alone do not do it. A conversion that ends while the one before goes over the bus makes no edge (data
//! sheet SBASA31B of a sibling, section 8.3.9), and a disturbance on the pin makes one without a conversion. The
//! converter's beat is regular, though: the time between two edges tells how many conversions it was, as long as
//! the period is known. It is that of the configuration, unless the converter runs on another clock, and is followed
//! by a phase-locked loop.

use ads131m0x::PowerMode;

use super::registers::{Config, Gain};

/// The last falling edge of DRDY.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Edge {
    /// Edges since any beginning, modulo 2^32.
    pub count: u32,
    /// When it fell, on the clock of [`Timers::now_us`].
    pub time_us: u64,
}

/// The board's timers.
pub trait Timers {
    /// The last falling edge of DRDY, counted and stamped by hardware.
    fn edge(&mut self) -> Edge;

    /// Microseconds since any beginning.
    fn now_us(&mut self) -> u64;
}

/// Fractional bits of times in here: units of 1/65536 us.
const FRACTION: u32 = 16;

/// The loop's gains, as shifts: of the phase, and of the period. Damped critically, with a time constant of 32
/// conversions.
const PHASE_SHIFT: u32 = 4;
const PERIOD_SHIFT: u32 = 10;

/// The longest period that is followed in 32 bits: 8 ms, the converter's slowest at its nominal clock is 4.
const LONGEST: i64 = 8000 << FRACTION;

/// The shortest conversion period that is believed, as a share of 1/100 of that at the fastest clock that the data sheet
/// allows: 1 % for a board on its internal oscillator, 1 % for reading the edges in whole microseconds.
const SHORTEST_PERCENT: i64 = 98;

/// Counts conversions, without any input or output.
#[derive(Clone, Debug)]
pub struct ConversionCount {
    nominal: i64,
    /// The shortest period that is believed.
    shortest: i64,
    period: i64,
    /// When the last conversion ended that was accounted for.
    beat: i64,
    /// Time since a restart that is not accounted for; less than half of a period either way.
    rest: i64,
    edges: u32,
    index: u64,
    started: bool,
}

impl ConversionCount {
    /// Before the first conversion.
    pub fn new(config: &Config) -> Self {
        let cycles = u64::from(config.oversampling.clock_cycles());
        let period = |clock_hz: u32| {
            let period = ((cycles * 1_000_000) << FRACTION) / u64::from(clock_hz.max(1));
            // At the most 32 768 cycles of a clock of 1 Hz.
            i64::try_from(period).unwrap_or(i64::MAX >> FRACTION)
        };
        let nominal = period(config.clock_hz);
        let gains = config.gains.map(Gain::factor).into_iter().max();
        let clocks = PowerMode::HighResolution.clocks_hz(config.gains.len(), gains.unwrap_or(1));
        Self {
            nominal,
            shortest: period(*clocks.end()) * SHORTEST_PERCENT / 100,
            period: nominal,
            beat: 0,
            rest: 0,
            edges: 0,
            index: 0,
            started: false,
        }
    }

    /// The conversion period, microseconds.
    pub fn period_us(&self) -> u32 {
        u32::try_from(self.period >> FRACTION).unwrap_or(u32::MAX)
    }

    /// The master clock that makes conversions of such a period, in 1/65536 us, Hz.
    pub fn clock_hz(period: i64, config: &Config) -> u32 {
        let cycles = i64::from(config.oversampling.clock_cycles());
        let clock_hz = ((cycles * 1_000_000) << FRACTION) / period.max(1);
        u32::try_from(clock_hz).unwrap_or(u32::MAX)
    }

    /// Index of the conversion that the next edge announces.
    pub fn index(&self) -> u64 {
        self.index
    }

    /// Looks at the beat over some edges with nothing on the bus. Before the first [`Self::begin`] a much faster one is
    /// believed: the converter runs on another clock, since edges can be missing but are rarely too many.
    ///
    /// # Errors
    /// The period, in 1/65536 us, that is too short for any clock that the data sheet allows.
    pub fn measure(&mut self, first: Edge, last: Edge) -> Result<(), i64> {
        let edges = i64::from(last.count.wrapping_sub(first.count));
        let time = fixed(last.time_us).wrapping_sub(fixed(first.time_us));
        match time.checked_div(edges) {
            Some(period) if period < self.shortest => return Err(period),
            Some(period) if !self.started && period <= self.nominal / 4 * 3 => {
                self.period = period;
            }
            _ => {}
        }
        Ok(())
    }

    /// Begins to count at an edge: conversions until now were lost, except the first time, when the index stays zero.
    /// The converter may have restarted, at any phase.
    pub fn begin(&mut self, edge: Edge) {
        let now = fixed(edge.time_us);
        if self.started {
            let elapsed = now.wrapping_sub(self.beat).saturating_add(self.rest);
            let passed = self.periods(elapsed);
            self.rest = elapsed - passed * self.period;
            self.index = self.index.saturating_add(passed as u64);
        }
        self.started = true;
        self.edges = edge.count;
        self.beat = now;
    }

    /// Moves the index on by one if this edge is one period after the last; false, and nothing changes, if it is not, or if a
    /// period is longer than 8 ms. In 32 bits, since it is asked at each conversion.
    #[inline]
    pub fn is_next(&mut self, last: Edge) -> bool {
        let elapsed = fixed(last.time_us).wrapping_sub(self.beat);
        if last.count == self.edges || self.period > LONGEST || !(0..2 * LONGEST).contains(&elapsed)
        {
            return false;
        }
        let (period, late) = (self.period as i32, elapsed as i32 - self.period as i32);
        if late + late < -period || late + late >= period {
            return false;
        }
        self.edges = last.count;
        self.beat += i64::from(period + (late >> PHASE_SHIFT));
        self.period += i64::from(late >> PERIOD_SHIFT);
        self.index = self.index.saturating_add(1);
        true
    }

    /// Moves the index on to the last edge, and returns by how many conversions: none without a new edge, or if it came
    /// too early to be one.
    #[inline]
    pub fn account(&mut self, last: Edge) -> u32 {
        if last.count == self.edges {
            return 0;
        }
        self.edges = last.count;
        let elapsed = fixed(last.time_us).wrapping_sub(self.beat);
        let passed = if elapsed + elapsed < 3 * self.period {
            i64::from(elapsed + elapsed >= self.period)
        } else {
            self.periods(elapsed)
        };
        let beats = passed * self.period;
        let late = elapsed - beats;
        self.beat += beats + (late >> PHASE_SHIFT);
        if passed == 1 {
            self.period += late >> PERIOD_SHIFT;
        }
        self.index = self.index.saturating_add(passed as u64);
        u32::try_from(passed).unwrap_or(u32::MAX)
    }

    /// Whole periods nearest to a time, not negative.
    fn periods(&self, time: i64) -> i64 {
        let half = self.period / 2;
        time.saturating_add(half).max(0) / self.period.max(1)
    }

    /// Time since the last conversion that was accounted for, microseconds.
    pub fn elapsed_us(&self, now_us: u64) -> u64 {
        let elapsed = fixed(now_us).wrapping_sub(self.beat) >> FRACTION;
        u64::try_from(elapsed).unwrap_or(0)
    }
}

/// Wraps after four years.
fn fixed(time_us: u64) -> i64 {
    (time_us << FRACTION) as i64
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_followed_edge_by_edge_in_32_bits_is_what_is_accounted_for() {
        let mut one = ConversionCount::new(&Config::default());
        let begin = Edge {
            count: 7,
            time_us: 1 << 40,
        };
        one.begin(begin);
        let mut other = one.clone();
        let mut edge = begin;
        for n in 0..10_000u64 {
            edge.count += 1;
            // A beat that is fast and jitters, and sometimes an edge that is missing or too much.
            edge.time_us += match n % 997 {
                500 => 510,
                900 => 60,
                _ => 249 + n * 7 % 3,
            };
            let before = other.clone();
            let next = one.is_next(edge);
            if !next {
                assert_eq!((one.beat, one.index), (before.beat, before.index));
                one.account(edge);
            }
            let passed = other.account(edge);
            assert_eq!(next, passed == 1, "{n}");
            let state = |c: &ConversionCount| (c.beat, c.period, c.index, c.edges);
            assert_eq!(state(&one), state(&other), "{n}");
        }
    }
}
