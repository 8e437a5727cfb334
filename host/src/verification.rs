//! What the instrument found in its self-check, against the same computation on the host from the same frames.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use serde::Serialize;
use shared::identify::static_test::workspace_len;
use shared::model::NOMINAL;
use shared::self_check::{Limits, MARKS, MOUNTS, Outcome, ReadingSums, SelfCheck, SetUp};
use shared::wire::message::{Event, Identity, Segment};

use crate::campaign::Campaign;
use crate::capture::RECORD;
use crate::error::Error;
use crate::record::{self, RecordError};
use crate::source::FileSource;
use crate::statics;

/// Largest difference between instrument and host that is rounding, relative to the coefficient, or to 1e-3 for smaller
/// ones.
pub const AGREEMENT: f64 = 1e-12;

/// Both sides.
#[derive(Clone, Debug, Serialize)]
pub struct Verification {
    /// As the instrument told.
    pub instrument: Outcome,
    /// As computed here from the record.
    pub host: Outcome,
    /// Largest difference of a coefficient, on the scale of [`AGREEMENT`]; the largest double if one is no number.
    pub difference: f64,
}

impl Verification {
    /// True when both found the same.
    pub fn agrees(&self) -> bool {
        self.difference <= AGREEMENT && self.instrument.readings == self.host.readings
    }
}

#[derive(Default)]
struct Replay {
    identity: Option<Identity>,
    set_up: Option<SetUp>,
    readings: BTreeMap<u32, ReadingSums>,
    /// Readings before the check.
    before: BTreeSet<u32>,
    outcome: Option<Outcome>,
}

/// Reads campaign and record in `folder` and does the instrument's self-check again.
///
/// # Errors
/// A campaign or record that cannot be read; a record without a self-check.
pub fn verify(folder: &Path) -> Result<Verification, Error> {
    let campaign = Campaign::read(folder)?;
    let file = folder.join(RECORD);
    let mut replay = Replay::default();
    let read = record::read(FileSource::open(&file)?, |event, _| {
        replay.take(&event);
        Ok::<(), RecordError>(())
    });
    read.map_err(|error| error.in_file(&file))?;
    let missing = |what: &str| Error::input(&file, format!("holds no {what}"));
    let identity = replay.identity.ok_or_else(|| missing("identity"))?;
    let set_up = replay.set_up.ok_or_else(|| missing("self-check"))?;
    let outcome = replay
        .outcome
        .ok_or_else(|| missing("outcome of a self-check"))?;

    let mut workspace = vec![0.0; workspace_len(MARKS, MOUNTS)];
    let bad = |error: &dyn std::fmt::Debug| Error::input(&file, format!("self-check: {error:?}"));
    let mut check = SelfCheck::new(set_up, &mut workspace).map_err(|error| bad(&error))?;
    let v_per_code = identity
        .gains
        .map(|gain| identity.reference_v / f64::from(gain) / f64::from(1 << 23));
    for reading in &campaign.readings {
        let number = u32::try_from(reading.order).ok();
        // Of a capture that was stopped: the check began anew after it.
        if number.is_some_and(|number| replay.before.contains(&number)) {
            continue;
        }
        let Some(sums) = number.and_then(|number| replay.readings.get(&number)) else {
            return Err(missing(&format!("blocks of reading {}", reading.order)));
        };
        // What the instrument has no room for does not count here either.
        let _ = check.absorb(statics::position(reading), sums, v_per_code);
    }
    let host = check
        .conclude(&Limits::default(), None, 0)
        .map_err(|error| bad(&error))?;
    Ok(Verification {
        instrument: outcome,
        host,
        difference: difference(&outcome.coefficients, &host.coefficients),
    })
}

/// Largest difference between the coefficients of instrument and host, relative to the host's or to 1e-3.
fn difference(instrument: &[f64; NOMINAL], host: &[f64; NOMINAL]) -> f64 {
    let each = instrument.iter().zip(host).map(|(a, b)| {
        let difference = (a - b).abs() / b.abs().max(1e-3);
        // JSON has no infinity, and what is no number differs from any.
        if difference.is_finite() {
            difference
        } else {
            f64::MAX
        }
    });
    each.fold(0.0, f64::max)
}

impl Replay {
    fn take(&mut self, event: &Event<'_>) {
        match event {
            Event::Hello(identity) => self.identity = Some(*identity),
            Event::CheckBegun(set_up) => {
                self.set_up = Some(*set_up);
                self.before
                    .extend(std::mem::take(&mut self.readings).into_keys());
                self.outcome = None;
            }
            Event::Block(block) => {
                if let Segment::Reading(number) = block.segment {
                    self.before.remove(&number);
                    self.readings.entry(number).or_default().absorb(block);
                }
            }
            Event::Check(outcome) => self.outcome = Some(*outcome),
            _ => {}
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_no_number_disagrees() {
        let host = [1.0; NOMINAL];
        assert_eq!(difference(&host, &host), 0.0);
        for absurd in [f64::NAN, f64::INFINITY, -f64::INFINITY] {
            for k in 0..NOMINAL {
                let mut told = host;
                told[k] = absurd;
                assert!(difference(&told, &host) > AGREEMENT, "{absurd} in {k}");
            }
        }
    }
}
