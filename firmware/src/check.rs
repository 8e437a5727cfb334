//! The self-check on the instrument: the blocks of each dial reading on their way to the line, absorbed as they pass.

use shared::model::Coefficients;
use shared::self_check::{Limits, Outcome, ReadingSums, SelfCheck, SetUp};
use shared::tumble::{Position, Series};
use shared::wire::message::{self, Block, CHANNELS, Segment};

/// A self-check, and the reading that is open.
pub struct Check<'w> {
    test: SelfCheck<'w>,
    begun: bool,
    open: Option<(u32, Position, ReadingSums)>,
    faults: u32,
}

impl<'w> Check<'w> {
    /// Not begun.
    pub fn new(test: SelfCheck<'w>) -> Self {
        Self {
            test,
            begun: false,
            open: None,
            faults: 0,
        }
    }

    /// Begins anew.
    pub fn begin(&mut self, set_up: SetUp) {
        self.test.restart(set_up);
        self.begun = true;
        self.open = None;
        self.faults = 0;
    }

    /// The dial stands at a position.
    pub fn open(&mut self, position: &message::Position) {
        self.open = Series::try_from(position.series).ok().map(|series| {
            let dial = Position {
                series,
                dial_deg: position.dial_deg,
                mount_deg: position.mount_deg,
            };
            (position.reading, dial, ReadingSums::default())
        });
    }

    /// A block passes.
    pub fn block(&mut self, block: &Block) {
        if let Some((reading, _, sums)) = &mut self.open
            && block.segment == Segment::Reading(*reading)
        {
            sums.absorb(block);
        }
    }

    /// The converter reported a fault.
    pub fn fault(&mut self) {
        self.faults = self.faults.saturating_add(1);
    }

    /// The reading ends. One too short for an uncertainty, or beyond the room for marks and mounts, does not count among
    /// the readings.
    pub fn close(&mut self, v_per_code: [f64; CHANNELS]) {
        if let Some((_, position, sums)) = self.open.take()
            && self.begun
        {
            // The outcome's number of readings tells.
            let _ = self.test.absorb(position, &sums, v_per_code);
        }
    }

    /// The outcome, `None` if nothing was begun or the readings do not determine the coefficients.
    pub fn conclude(&self, stored: Option<&message::Coefficients>) -> Option<Outcome> {
        let stored = stored.map(|c| Coefficients::from_nominal(c.nominal).with_further(c.further));
        let limits = Limits::default();
        let outcome = self.test.conclude(&limits, stored.as_ref(), self.faults);
        outcome.ok().filter(|_| self.begun)
    }
}
