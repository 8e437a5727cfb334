//! Which conversion is which: the index, moved on by the DRDY edges that hardware counted.

use super::registers::Config;

/// The board's timers.
pub trait Timers {
    /// Falling edges of DRDY since any beginning, modulo 2^32, counted by hardware.
    fn drdy_edges(&mut self) -> u32;

    /// Microseconds since any beginning.
    fn now_us(&mut self) -> u64;
}

/// Counts conversions, without any input or output.
#[derive(Clone, Debug)]
pub struct ConversionCount {
    /// Conversion periods a second, as a fraction: clock over cycles.
    clock_hz: u64,
    clock_cycles: u64,
    period_us: u32,
    edges: u32,
    time_us: u64,
    /// Part of a period that had passed at that time, if only the clock told; microseconds times `clock_hz`.
    begun: u64,
    index: u64,
    confidence: Confidence,
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum Confidence {
    /// Nothing was converted yet.
    New,
    /// Every conversion made an edge.
    Edges,
    /// There may have been conversions without an edge: only the clock tells.
    Clock,
}

impl ConversionCount {
    /// Before the first conversion.
    pub fn new(config: &Config) -> Self {
        let clock_hz = u64::from(config.clock_hz.max(1));
        let clock_cycles = u64::from(config.oversampling.clock_cycles());
        Self {
            clock_hz,
            clock_cycles,
            period_us: u32::try_from(clock_cycles * 1_000_000 / clock_hz).unwrap_or(u32::MAX),
            edges: 0,
            time_us: 0,
            begun: 0,
            index: 0,
            confidence: Confidence::New,
        }
    }

    /// The conversion period, microseconds.
    pub fn period_us(&self) -> u32 {
        self.period_us
    }

    /// Index of the conversion that the next edge announces.
    pub fn index(&self) -> u64 {
        self.index
    }

    /// From here on there may be conversions without an edge.
    pub fn doubt(&mut self) {
        if self.confidence == Confidence::Edges {
            self.confidence = Confidence::Clock;
        }
    }

    /// Begins to count: conversions until now were lost, except the first time, when the index stays zero.
    pub fn begin(&mut self, edges: u32, now_us: u64) {
        if self.confidence != Confidence::New {
            self.pass(edges, now_us);
        }
        self.confidence = Confidence::Edges;
        self.edges = edges;
        self.time_us = now_us;
    }

    /// Moves the index on by the conversions since it last was, and returns how many: none without an edge; by the
    /// edges, after [`Self::doubt`] at least by the time that went by.
    pub fn account(&mut self, edges: u32, now_us: u64) -> u32 {
        if edges == self.edges {
            return 0;
        }
        self.pass(edges, now_us)
    }

    fn pass(&mut self, edges: u32, now_us: u64) -> u32 {
        let mut passed = edges.wrapping_sub(self.edges);
        let begun = core::mem::take(&mut self.begun);
        if self.confidence == Confidence::Clock {
            let elapsed = self.elapsed_us(now_us).saturating_mul(self.clock_hz);
            let elapsed = elapsed.saturating_add(begun);
            let period = self.clock_cycles * 1_000_000;
            // One microsecond more, since both times are cut to whole ones.
            let periods = elapsed.saturating_add(self.clock_hz) / period;
            self.begun = elapsed.saturating_sub(periods * period);
            passed = passed.max(u32::try_from(periods).unwrap_or(u32::MAX));
        }
        self.confidence = Confidence::Edges;
        self.edges = edges;
        self.time_us = now_us;
        self.index = self.index.saturating_add(u64::from(passed));
        passed
    }

    /// Time since the last edge that was accounted for, microseconds.
    pub fn elapsed_us(&self, now_us: u64) -> u64 {
        now_us.saturating_sub(self.time_us)
    }
}
