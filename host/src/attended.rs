//! A static test of a real instrument: a person turns the dial, the host measures at each mark.

use std::fs;
use std::path::Path;
use std::time::{Duration, Instant};

use shared::wire::message::Command;

use crate::bench::plan::Dwell;
use crate::campaign::{Approach, Campaign, CampaignConfig};
use crate::capture::{self, Conditions, RECORD, Taken};
use crate::error::Error;
use crate::link::Link;
use crate::record::Tally;
use crate::source::Source;

/// How long the instrument may take to solve for its coefficients.
const CONCLUDING: Duration = Duration::from_secs(3);

/// How often the person is looked after while the line is listened to.
const LOOK: Duration = Duration::from_millis(50);

/// What the person wants.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Reply {
    /// The dial stands there: measure.
    Measure,
    /// Leave this position out.
    Skip,
    /// No more positions.
    Stop,
}

/// The person at the dial.
pub trait Operator {
    /// Tells one line.
    ///
    /// # Errors
    /// It cannot be told.
    fn tell(&mut self, line: &str) -> Result<(), Error>;

    /// What was answered since the last question, if anything; never waits.
    fn answer(&mut self) -> Option<Reply>;
}

/// What is to be measured, and how.
#[derive(Clone, Debug)]
pub struct Test {
    /// Instrument and bench.
    pub config: CampaignConfig,
    /// The positions, in order.
    pub dwells: Vec<Dwell>,
    /// Between the answer and the reading.
    pub settle: Duration,
    /// Length of a reading.
    pub dwell: Duration,
    /// Temperature of the instrument.
    pub temp_c: f64,
}

/// What came of it.
#[derive(Clone, Debug)]
pub struct Attended {
    /// The readings, if there are any.
    pub campaign: Option<Campaign>,
    /// What was recorded and what was lost on the line.
    pub tally: Tally,
    /// Positions that were left out.
    pub missing: usize,
}

/// Measures the positions of `test` and writes record and tables into `folder`, which must not hold a record. Every byte
/// is in the record as it comes; the tables are written at the end, also when the link is lost.
///
/// # Errors
/// [`Error::Usage`] if there is a record already; [`Error::Link`] when the instrument is lost; what the file system says.
pub fn measure(
    source: impl Source,
    test: &Test,
    folder: &Path,
    operator: &mut dyn Operator,
) -> Result<Attended, Error> {
    fs::create_dir_all(folder).map_err(Error::write(folder))?;
    let file = folder.join(RECORD);
    if file.exists() {
        return Err(Error::Usage(format!(
            "{}: there is a record already; another folder is needed",
            file.display()
        )));
    }
    let mut walk = Walk::begin(Link::open(source, &file)?, test, operator)?;
    let walked = walk.positions();
    let Walk {
        link,
        conditions,
        dwell_blocks,
        ..
    } = walk;
    let tally = link.finish()?;
    let missing = test.dwells.len() - conditions.dwells.len();
    let tables = || {
        let (reduction, _) = capture::reduce(&file, dwell_blocks)?;
        let campaign = capture::campaign(test.config.clone(), &reduction, &conditions, &file)?;
        campaign.write(folder)?;
        Ok(campaign)
    };
    let campaign = (!conditions.dwells.is_empty()).then(tables).transpose();
    // A lost link matters more than what it left.
    walked?;
    Ok(Attended {
        campaign: campaign?,
        tally,
        missing,
    })
}

/// From one position to the next.
struct Walk<'a, S> {
    link: Link<S>,
    test: &'a Test,
    operator: &'a mut dyn Operator,
    begun: Instant,
    conditions: Conditions,
    dwell_blocks: u64,
    /// Number of the next reading; one that failed keeps its own.
    number: u32,
}

impl<'a, S: Source> Walk<'a, S> {
    fn begin(
        mut link: Link<S>,
        test: &'a Test,
        operator: &'a mut dyn Operator,
    ) -> Result<Self, Error> {
        let identity = link.greet()?;
        link.command(&Command::BeginCheck(capture::set_up(&test.config)))?;
        let block_s = f64::from(identity.block_samples) / identity.sample_rate_hz;
        Ok(Self {
            link,
            test,
            operator,
            begun: Instant::now(),
            conditions: Conditions {
                dwells: Vec::new(),
                shakes: Vec::new(),
                local_gravity_g: test.config.bench.local_gravity_g,
                sample_rate_hz: identity.sample_rate_hz,
            },
            dwell_blocks: (test.dwell.as_secs_f64() / block_s).round() as u64,
            number: 0,
        })
    }

    fn positions(&mut self) -> Result<(), Error> {
        let count = self.test.dwells.len();
        for (order, dwell) in self.test.dwells.iter().enumerate() {
            loop {
                let sense = match dwell.approach {
                    Approach::Clockwise => "clockwise",
                    Approach::CounterClockwise => "counter-clockwise",
                };
                self.operator.tell(&format!(
                    "{} of {count}: series {}, mounted at {} deg: dial {} deg, {sense}; Enter to measure, s to skip, q to stop",
                    order + 1,
                    u8::from(dwell.series),
                    dwell.mount_deg,
                    dwell.dial_deg,
                ))?;
                match self.answer()? {
                    Reply::Stop => return Ok(()),
                    Reply::Skip => break,
                    Reply::Measure => {}
                }
                if self.reading(dwell)? {
                    break;
                }
                self.operator
                    .tell("the instrument was restarted or frames were lost: once more, please")?;
            }
        }
        // The readings are there, with or without it.
        match self.link.command(&Command::Conclude) {
            Ok(()) => self.link.listen(CONCLUDING),
            Err(error) => self.operator.tell(&format!("no self-check: {error}")),
        }
    }

    fn answer(&mut self) -> Result<Reply, Error> {
        loop {
            if let Some(reply) = self.operator.answer() {
                return Ok(reply);
            }
            self.link.listen(LOOK)?;
        }
    }

    /// Takes a reading; false if it is not whole.
    fn reading(&mut self, dwell: &Dwell) -> Result<bool, Error> {
        self.link.listen(self.test.settle)?;
        let number = self.number;
        self.number += 1;
        let before = self.link.tally();
        let begin = capture::position(number, dwell);
        self.link.command(&Command::StartPosition(begin))?;
        let begun_s = self.begun.elapsed().as_secs_f64();
        self.link.listen(self.test.dwell)?;
        self.link.command(&Command::StopPosition)?;
        // The answer follows the last block.
        let after = self.link.tally();
        if (after.restarts, after.blocks.missing) != (before.restarts, before.blocks.missing) {
            return Ok(false);
        }
        self.conditions.dwells.push(Taken {
            number,
            dwell: *dwell,
            time_s: begun_s + 0.5 * self.test.dwell.as_secs_f64(),
            temp_c: self.test.temp_c,
        });
        Ok(true)
    }
}
