//! The walk itself: a state, what may happen, what follows.

use serde::{Deserialize, Serialize};
use shared::wire::message::{Block, Segment};

use super::estimate::{Estimate, Judgement};
use super::live::Live;
use super::stops::{StopState, Stops};
use crate::bench::plan::Dwell;
use crate::campaign::{CampaignConfig, Reading, ranges};
use crate::statics::Environment;

/// How a walk is done.
#[derive(Clone, Debug)]
pub struct Settings {
    /// How long the output has to be steady before a reading, s.
    pub settle_s: f64,
    /// Length of a reading, s.
    pub dwell_s: f64,
    /// Blocks of a reading.
    pub blocks: u32,
    /// The instrument's output per code of its channel, V.
    pub v_per_code: f64,
    /// The vibration whose error the test is for.
    pub environment: Environment,
    /// The test is enough when the standard uncertainty of the vibration error is this share of it.
    pub enough: Option<f64>,
}

/// What the person wishes.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "wish", rename_all = "kebab-case")]
pub enum Wish {
    /// The dial stands there: measure.
    Measure,
    /// The last reading, or that of this number, once more.
    Redo {
        /// Its number.
        reading: Option<u32>,
    },
    /// Leave this position out.
    Skip,
    /// Stop for a while; the next measure goes on.
    Pause,
    /// Go on in another series or mounting.
    SwapSeries,
    /// Go to the position that helps most.
    Best,
    /// Go to this position of the plan.
    Choose {
        /// Its index.
        stop: usize,
    },
    /// A remark on the last reading, or on the test before there is one.
    Remark {
        /// In the person's words.
        text: String,
    },
    /// The instrument has this temperature from now on.
    Temperature {
        /// Degrees Celsius.
        temp_c: f64,
    },
    /// No more positions.
    Stop,
}

/// What the walk is doing.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(tag = "is", rename_all = "kebab-case")]
pub enum Phase {
    /// The person turns the dial.
    Place,
    /// The output comes to rest.
    Settle {
        /// When the person said that the dial stands, s.
        #[serde(skip)]
        since_s: f64,
    },
    /// The output is read.
    Read {
        /// Number of the reading.
        reading: u32,
        /// Blocks so far.
        blocks: u32,
        /// When it was begun, s.
        #[serde(skip)]
        since_s: f64,
    },
    /// The person rests.
    Paused,
    /// The instrument is gone.
    Lost {
        /// Why.
        reason: String,
    },
    /// It is over.
    Over,
}

/// What is to be done at the instrument and in the record.
#[derive(Clone, Debug, PartialEq)]
pub enum Order {
    /// Begin this reading.
    Begin {
        /// Its number.
        reading: u32,
        /// Where the dial stands.
        dwell: Dwell,
    },
    /// The reading has its blocks: end it, and say whether it is whole.
    End {
        /// Its number.
        reading: u32,
    },
    /// End a reading that does not count.
    Abandon {
        /// Its number.
        reading: u32,
    },
    /// This reading counts no longer.
    Withdraw {
        /// Its number.
        reading: u32,
    },
    /// Keep a remark.
    Remark {
        /// The reading that it is about.
        reading: Option<u32>,
        /// In the person's words.
        text: String,
    },
    /// Close everything in order.
    Finish,
}

/// A reading that counts, with how it was judged when it came.
#[derive(Clone, Debug)]
pub(super) struct Judged {
    pub(super) reading: Reading,
    pub(super) judgement: Judgement,
    pub(super) remark: String,
}

/// A walk through a static test.
#[derive(Clone, Debug)]
pub struct Walk {
    pub(super) settings: Settings,
    pub(super) config: CampaignConfig,
    pub(super) stops: Stops,
    pub(super) phase: Phase,
    pub(super) live: Live,
    pub(super) judged: Vec<Judged>,
    pub(super) estimate: Estimate,
    /// Readings, vibration error and its standard uncertainty, g, as they came.
    pub(super) history: Vec<(usize, f64, f64)>,
    pub(super) message: String,
    pub(super) temp_c: f64,
    next_reading: u32,
    orders: Vec<Order>,
}

impl Walk {
    /// Before the first stop of `plan`; the next reading has the number `next_reading`.
    pub fn new(
        config: CampaignConfig,
        settings: Settings,
        plan: &[Dwell],
        next_reading: u32,
        temp_c: f64,
    ) -> Self {
        let k1 = config.instrument.scale_factor_nominal_v_per_g;
        Self {
            live: Live::new(settings.v_per_code, k1),
            estimate: Estimate::new(&config, &[]),
            stops: Stops::new(plan),
            settings,
            config,
            phase: Phase::Place,
            judged: Vec::new(),
            history: Vec::new(),
            message: String::new(),
            temp_c,
            next_reading,
            orders: Vec::new(),
        }
    }

    /// Takes over readings of an earlier capture, each judged by those before it.
    pub fn take_over(&mut self, readings: &[Reading]) {
        for reading in readings {
            self.stops.was_taken(&dwell_of(reading), number(reading));
            self.judge(reading);
        }
        self.over_if_done();
    }

    /// The reading of this number is under way in a record that is followed, and has so many blocks.
    pub fn follow(&mut self, reading: u32, dwell: &Dwell, blocks: u32) {
        if let Some(stop) = self.stops.waits_at(dwell) {
            self.stops.choose(stop);
        }
        self.phase = Phase::Read {
            reading,
            blocks,
            since_s: 0.0,
        };
    }

    /// Judges a reading by those before it; then it is one of them.
    fn judge(&mut self, reading: &Reading) {
        let before = self.judged.last().map(|judged| dwell_of(&judged.reading));
        let judgement = self.estimate.judge(reading, before.as_ref());
        self.judged.push(Judged {
            reading: reading.clone(),
            judgement,
            remark: String::new(),
        });
        self.estimate_anew();
    }

    /// What is to be done by now; each order is given once.
    pub fn orders(&mut self) -> Vec<Order> {
        std::mem::take(&mut self.orders)
    }

    /// What it is doing.
    pub fn phase(&self) -> &Phase {
        &self.phase
    }

    /// Whether it waits for the person.
    pub fn waits(&self) -> bool {
        !matches!(
            self.phase,
            Phase::Settle { .. } | Phase::Read { .. } | Phase::Over
        )
    }

    /// The stops and what has become of them.
    pub fn stops(&self) -> &Stops {
        &self.stops
    }

    /// Temperature of the instrument as the person stated it last, degrees Celsius.
    pub fn temp_c(&self) -> f64 {
        self.temp_c
    }

    /// The person wishes something at `now_s`.
    pub fn wish(&mut self, wish: Wish, now_s: f64) {
        match wish {
            Wish::Measure => self.measure(now_s),
            Wish::Redo { reading } => self.redo(reading),
            Wish::Skip => {
                self.abandon();
                self.stops.done(StopState::Skipped);
                self.arrive();
            }
            Wish::Pause => {
                self.abandon();
                if self.phase == Phase::Place {
                    self.phase = Phase::Paused;
                }
            }
            Wish::SwapSeries => {
                self.abandon();
                match self.stops.swap_series() {
                    true => self.arrive(),
                    false => {
                        self.message = "no position of another series or mounting waits".into()
                    }
                }
            }
            Wish::Best => {
                self.abandon();
                match super::view::best_stop(self) {
                    Some(stop) => self.choose(stop),
                    None => self.message = "no position waits".into(),
                }
            }
            Wish::Choose { stop } => {
                self.abandon();
                self.choose(stop);
            }
            Wish::Remark { text } => self.remark(text),
            Wish::Temperature { temp_c } => match ranges::TEMPERATURE.check(temp_c) {
                Ok(temp_c) => self.temp_c = temp_c,
                Err(problem) => self.message = format!("the temperature {problem}"),
            },
            Wish::Stop => {
                self.abandon();
                self.over();
            }
        }
    }

    fn measure(&mut self, now_s: f64) {
        if matches!(self.phase, Phase::Place | Phase::Paused) && self.stops.at().is_some() {
            self.message.clear();
            self.live.restart();
            self.phase = Phase::Settle { since_s: now_s };
        }
    }

    fn redo(&mut self, reading: Option<u32>) {
        self.abandon();
        let last = || self.judged.last().map(|judged| number(&judged.reading));
        let Some(reading) = reading.or_else(last) else {
            self.message = "there is no reading yet".into();
            return;
        };
        if !self.stops.redo(reading) {
            self.message = format!("there is no reading {reading}");
            return;
        }
        self.orders.push(Order::Withdraw { reading });
        self.judged
            .retain(|judged| number(&judged.reading) != reading);
        self.estimate_anew();
        self.arrive();
    }

    fn choose(&mut self, stop: usize) {
        match self.stops.choose(stop) {
            true => self.arrive(),
            false => self.message = "that position is measured; redo its reading".into(),
        }
    }

    fn remark(&mut self, text: String) {
        let text = crate::error::printable(text.trim());
        if text.is_empty() {
            return;
        }
        let reading = self.judged.last_mut().map(|judged| {
            let gap = if judged.remark.is_empty() { "" } else { "; " };
            judged.remark = format!("{}{gap}{text}", judged.remark);
            number(&judged.reading)
        });
        self.orders.push(Order::Remark { reading, text });
    }

    /// What is under way does not count.
    fn abandon(&mut self) {
        match self.phase {
            Phase::Read { reading, .. } => {
                self.orders.push(Order::Abandon { reading });
                self.phase = Phase::Place;
            }
            Phase::Settle { .. } => self.phase = Phase::Place,
            _ => {}
        }
    }

    /// At the stop that is next now.
    fn arrive(&mut self) {
        if !matches!(self.phase, Phase::Lost { .. } | Phase::Over) {
            self.phase = Phase::Place;
            self.message.clear();
            self.over_if_done();
        }
    }

    fn over_if_done(&mut self) {
        if self.stops.at().is_none() {
            self.over();
        }
    }

    fn over(&mut self) {
        if self.phase != Phase::Over {
            self.phase = Phase::Over;
            self.orders.push(Order::Finish);
        }
    }

    /// A block came at `now_s`.
    pub fn block(&mut self, block: &Block, now_s: f64) {
        self.live.take(block, now_s);
        if let Phase::Read {
            reading, blocks, ..
        } = &mut self.phase
            && block.segment == Segment::Reading(*reading)
            && block.count > 0
        {
            *blocks += 1;
            // Once: the order takes a while to be carried out.
            if *blocks == self.settings.blocks {
                let reading = *reading;
                self.orders.push(Order::End { reading });
            }
        }
    }

    /// Time passes.
    pub fn tick(&mut self, now_s: f64) {
        match self.phase {
            Phase::Settle { .. } if self.live.steady_s(now_s) >= self.settings.settle_s => {
                if let Some(dwell) = self.stops.dwell().copied() {
                    let reading = self.next_reading;
                    self.next_reading += 1;
                    self.phase = Phase::Read {
                        reading,
                        blocks: 0,
                        since_s: now_s,
                    };
                    self.orders.push(Order::Begin { reading, dwell });
                }
            }
            Phase::Read { since_s, .. } if now_s - since_s > self.patience_s() => {
                self.abandon();
                self.message = "the instrument sends too few blocks: once more, please".into();
            }
            _ => {}
        }
    }

    /// How long a reading may take. Twice its length: with half of its blocks lost it is not whole anyhow; 3 s for a command
    /// that is said again.
    fn patience_s(&self) -> f64 {
        2.0 * self.settings.dwell_s + 3.0
    }

    /// The reading that was ended is whole, and this is it. All readings that count are `readings`, this one the last: what is
    /// known of the noise grows with each.
    pub fn whole(&mut self, readings: &[Reading]) {
        let Phase::Read { reading, .. } = self.phase else {
            return;
        };
        let Some(last) = readings.last() else { return };
        for (judged, now) in self.judged.iter_mut().zip(readings) {
            judged.reading = now.clone();
        }
        self.judge(last);
        self.stops.done(StopState::Taken(reading));
        self.arrive();
    }

    /// The reading that was ended is not whole.
    pub fn failed(&mut self, reason: &str) {
        self.phase = Phase::Place;
        self.message = format!("{reason}: once more, please");
    }

    /// The instrument is gone.
    pub fn lost(&mut self, reason: &str) {
        if self.phase != Phase::Over {
            self.phase = Phase::Lost {
                reason: reason.into(),
            };
        }
    }

    /// It is there again; what was under way is measured anew.
    pub fn found(&mut self) {
        if matches!(self.phase, Phase::Lost { .. }) {
            self.phase = Phase::Place;
            self.live.restart();
            self.message = "the instrument is there again".into();
        }
    }

    fn estimate_anew(&mut self) {
        let readings: Vec<Reading> = self.judged.iter().map(|j| j.reading.clone()).collect();
        self.estimate = Estimate::new(&self.config, &readings);
        if let Some((value_g, sigma_g)) = self.estimate.vre_g(&self.settings.environment) {
            self.history.retain(|(count, ..)| *count < readings.len());
            self.history.push((readings.len(), value_g, sigma_g));
        }
    }
}

/// Number of a reading as the record has it.
pub(super) fn number(reading: &Reading) -> u32 {
    u32::try_from(reading.order).unwrap_or(u32::MAX)
}

pub(super) fn dwell_of(reading: &Reading) -> Dwell {
    Dwell {
        series: reading.series,
        dial_deg: reading.dial_deg,
        mount_deg: reading.mount_deg,
        approach: reading.approach,
    }
}
