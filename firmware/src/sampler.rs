//! From conversions to blocks of moments and raw frames.
//!
//! [`Sampler`] is plain: it is handed what the converter gave, and reports. [`Acquisition`] puts it behind a
//! converter. Codes stay integers until a block is closed. What was lost is told by the index of the conversions,
//! which counts DRDY edges ([`crate::adc::count`]); a loss belongs to the segment in which it happened.

use embedded_hal::digital::OutputPin;
use shared::compensate::{Compensator, CompensatorState, Surroundings};
use shared::moments::Accumulator;
use shared::wire::board::{BlockConditions, Pulse};
use shared::wire::message::{Block, CHANNELS, CompensatedBlock, Fault, Moments, Segment, State};

use crate::adc::batch::Batch;
use crate::adc::bus::FrameBus;
use crate::adc::registers::Config;
use crate::adc::{self, Ads131m04, Reset};
use crate::link::{AcquisitionEnd, Action, Counters, RawSamples, Report};

/// Conversions lost to unreadable frames in a row after which the bus is put in order and the converter set up anew: 4 ms
/// at 4 kSPS. A disturbance passes, a bus or a converter out of step does not. After one, two sound frames are wanted, so
/// that a line that spoils a share p of the frames goes on with 1 - (1 - p)^2: by chance, sixteen in a row begin at 3e-17
/// of the conversions for p = 5 %, and at 0.7 % for p = 50 %, where a set-up costs little more than the line does. Chosen.
const UNREADABLE: u8 = 16;

/// How long to wait before a converter that could not be set up is tried again.
const RETRY_US: u32 = 10_000;

/// Kinds of [`Fault`].
const TROUBLES: usize = 10;

impl From<adc::Error> for Fault {
    fn from(error: adc::Error) -> Self {
        match error {
            adc::Error::Spi(_) | adc::Error::Pin(_) => Self::Bus,
            adc::Error::DrdyTimeout { waited_us } => Self::DrdyTimeout { waited_us },
            adc::Error::Checksum(error) => Self::Checksum {
                sent: error.sent,
                computed: error.computed,
            },
            adc::Error::Identification { read } => Self::Identification { read },
            adc::Error::Register {
                register,
                written,
                read,
            } => Self::Register {
                address: register.address(),
                written,
                read,
            },
            adc::Error::Acknowledge { expected, read } => Self::Acknowledge { expected, read },
            adc::Error::Status(status) => Self::Status { read: status.0 },
            adc::Error::Overrun { lost } => Self::Overrun { lost },
            adc::Error::NoData => Self::NoData,
            adc::Error::Clock { clock_hz } => Self::Clock { clock_hz },
        }
    }
}

/// What the acquisition cannot measure itself.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Around {
    /// Temperature of the board, degrees Celsius.
    pub board_c: Option<f32>,
    /// Temperature of the instrument, degrees Celsius.
    pub instrument_c: Option<f32>,
    /// The clock is the board's internal oscillator.
    pub time_base_unsure: bool,
}

/// Gathers samples into blocks and raw frames, and carries out orders between them.
pub struct Sampler<'q> {
    link: AcquisitionEnd<'q>,
    block_samples: u32,
    zero: [i32; CHANNELS],
    segment: Segment,
    /// The block that is open.
    accumulator: Accumulator<f32>,
    first_sample: u64,
    count: u32,
    lost: u32,
    /// When the first and the last sample of the open block came, microseconds.
    first_us: u64,
    last_us: u64,
    /// The delay of the converter's filter, microseconds.
    delay_us: f32,
    around: Around,
    pulse: Option<Pulse>,
    compensator: Option<Compensator<f32>>,
    /// What compensation gathers of the open block.
    compensation: CompensatorState<f32>,
    /// The raw frame that is open, while streaming.
    raw: Option<RawSamples>,
    streaming: bool,
    /// Index of the next conversion that is expected.
    next: u64,
    samples: u64,
    checksum_errors: u32,
    checksum_set_ups: u32,
    resets: u32,
    last_fault: Option<Fault>,
    /// What went wrong since the last sound conversion.
    troubles: heapless::Vec<core::mem::Discriminant<Fault>, TROUBLES>,
}

impl<'q> Sampler<'q> {
    /// Blocks of that many conversions, lost ones included; at least one.
    pub fn new(link: AcquisitionEnd<'q>, block_samples: u16) -> Self {
        Self {
            link,
            block_samples: u32::from(block_samples.max(1)),
            zero: [0; CHANNELS],
            segment: Segment::Idle,
            accumulator: Accumulator::new([0; CHANNELS]),
            first_sample: 0,
            count: 0,
            lost: 0,
            first_us: 0,
            last_us: 0,
            delay_us: 0.0,
            around: Around::default(),
            pulse: None,
            compensator: None,
            compensation: CompensatorState::new(),
            raw: None,
            streaming: false,
            next: 0,
            samples: 0,
            checksum_errors: 0,
            checksum_set_ups: 0,
            resets: 0,
            last_fault: None,
            troubles: heapless::Vec::new(),
        }
    }

    /// Closes the open block; from here on there are blocks of that many conversions, freed of vibration error by
    /// `compensator`.
    pub fn compensate(&mut self, block_samples: u16, compensator: Option<Compensator<f32>>) {
        self.close_block();
        self.block_samples = u32::from(block_samples.max(1));
        self.compensator = compensator;
        self.compensation = CompensatorState::new();
        self.set_around(self.around);
        self.set_zero(compensator.map_or([0; CHANNELS], |with| with.zero()));
    }

    /// What the blocks from here on are measured under.
    pub fn set_around(&mut self, around: Around) {
        self.around = around;
        self.compensation.set_surroundings(Surroundings {
            temperature_c: around.instrument_c.or(around.board_c),
            time_base_unsure: around.time_base_unsure,
        });
    }

    /// A pulse of the vehicle's time came.
    pub fn set_pulse(&mut self, pulse: Pulse) {
        self.pulse = Some(pulse);
    }

    /// The delay of the converter's filter, microseconds.
    pub fn set_delay(&mut self, delay_us: f32) {
        self.delay_us = delay_us;
    }

    fn set_zero(&mut self, zero: [i32; CHANNELS]) {
        self.zero = zero;
        self.accumulator = Accumulator::new(zero);
    }

    /// Takes conversions; those between them and the ones before were lost.
    #[inline]
    pub fn take(&mut self, batch: &Batch) {
        self.troubles.clear();
        self.reach(batch.first());
        let (mut codes, mut at) = (batch.codes(), 0);
        while !codes.is_empty() {
            let open = self.count.saturating_add(self.lost);
            let room = self.block_samples.saturating_sub(open).max(1) as usize;
            let (now, later) = codes.split_at(room.min(codes.len()));
            if self.count == 0 {
                self.first_us = batch.time_us(at);
            }
            at += now.len();
            self.last_us = batch.time_us(at - 1);
            self.take_of_block(now);
            codes = later;
        }
    }

    /// Takes conversions of the open block, and closes it when it is full.
    fn take_of_block(&mut self, codes: &[[i32; CHANNELS]]) {
        if self.streaming {
            self.stream(codes);
        }
        let count = codes.len() as u32;
        self.next = self.next.saturating_add(u64::from(count));
        self.samples += u64::from(count);
        self.count += count;
        // A block is far shorter than what an accumulator holds.
        let _ = self.accumulator.extend(codes);
        if let Some(compensator) = &self.compensator {
            self.compensation.extend(compensator, codes);
        }
        if self.count.saturating_add(self.lost) >= self.block_samples {
            self.close_block();
        }
    }

    fn stream(&mut self, codes: &[[i32; CHANNELS]]) {
        let segment = self.segment;
        for (index, codes) in (self.next..).zip(codes) {
            let raw = self
                .raw
                .get_or_insert_with(|| RawSamples::new(segment, index));
            raw.push(codes);
            if raw.is_full() {
                self.close_raw();
            }
        }
    }

    /// Counts what went wrong and reports it when it begins; `conversions` is how many the converter made.
    pub fn fail(&mut self, error: adc::Error, conversions: u64) {
        self.reach(conversions);
        if matches!(error, adc::Error::Checksum(_)) {
            self.checksum_errors = self.checksum_errors.saturating_add(1);
        }
        let fault = Fault::from(error);
        self.last_fault = Some(fault);
        let kind = core::mem::discriminant(&fault);
        // What there is no room for is not told.
        if !self.troubles.contains(&kind) && self.troubles.push(kind).is_ok() {
            let sample = self.next;
            self.link.offer(Report::Fault { sample, fault });
        }
    }

    /// Carries out the orders that wait, after `conversions` of the converter.
    pub fn obey(&mut self, conversions: u64, clock_us: impl FnOnce() -> u64) {
        let Some(mut order) = self.link.order() else {
            return;
        };
        self.reach(conversions);
        let clock_us = clock_us();
        loop {
            let mut counters = None;
            match order.action {
                Action::Mark => {}
                Action::Begin(segment) => {
                    self.close_raw();
                    self.close_block();
                    self.segment = segment;
                }
                Action::Stream(on) => {
                    self.close_raw();
                    self.streaming = on;
                }
                Action::Zero(zero) => {
                    self.close_block();
                    self.set_zero(zero);
                }
                Action::Compensate(block_samples, compensator) => {
                    self.compensate(block_samples, compensator);
                }
                Action::State => {
                    counters = Some(Counters {
                        state: self.state(clock_us),
                        checksum_set_ups: self.checksum_set_ups,
                        pulse: self.pulse,
                    });
                }
            }
            self.link.answer(Report::Done {
                sequence: order.sequence,
                sample: self.next,
                counters,
            });
            match self.link.order() {
                Some(next) => order = next,
                None => return,
            }
        }
    }

    /// The counters; those of the application are zero.
    fn state(&self, clock_us: u64) -> State {
        State {
            segment: self.segment,
            streaming: self.streaming,
            compensating: false,
            clock_us,
            conversions: self.next,
            samples: self.samples,
            lost: self.next - self.samples,
            dropped_frames: self.link.dropped_frames(),
            dropped_samples: self.link.dropped_samples(),
            converter_checksum_errors: self.checksum_errors,
            converter_resets: self.resets,
            rejected_frames: 0,
            last_fault: self.last_fault,
        }
    }

    /// Conversions up to this index that did not come are lost.
    fn reach(&mut self, index: u64) {
        let gap = index.saturating_sub(self.next);
        if gap > 0 {
            self.close_raw();
            let gap32 = u32::try_from(gap).unwrap_or(u32::MAX);
            self.lost = self.lost.saturating_add(gap32);
            self.compensation.interrupt();
            self.next = index;
        }
    }

    fn close_raw(&mut self) {
        if let Some(raw) = self.raw.take() {
            self.link.offer(Report::Raw(raw));
        }
    }

    fn close_block(&mut self) {
        let Self {
            segment,
            first_sample,
            count,
            lost,
            ..
        } = *self;
        // The counts have not overflowed, so there are moments unless all were lost.
        let moments = self.accumulator.close().ok().flatten();
        let with = self.compensator.as_ref().zip(moments);
        let freed = with.map(|(with, moments)| self.compensation.close(with, &moments));
        if count > 0 || lost > 0 {
            let none = Moments {
                zero: self.zero,
                ..Moments::default()
            };
            let block = Block {
                segment,
                first_sample,
                count,
                lost,
                moments: moments.map_or(none, |moments| moments.to_wire()),
            };
            let conditions = BlockConditions {
                first_sample,
                first_us: self.first_us,
                last_us: self.last_us,
                delay_us: self.delay_us,
                pulse: self.pulse,
                board_c: self.around.board_c,
                instrument_c: self.around.instrument_c,
                sigma_g: freed.map(|f| f.sigma_g).filter(|s| s.is_finite()),
            };
            self.link.offer(Report::Block(block, conditions));
        }
        if let Some(freed) = freed {
            self.link.offer(Report::Compensated(CompensatedBlock {
                segment,
                first_sample,
                count,
                lost,
                specific_force_g: freed.specific_force_g,
                vre_g: freed.vre_g,
                vre_sigma_g: freed.vre_sigma_g,
                quality: freed.quality,
            }));
        }
        self.first_sample = self.next;
        self.count = 0;
        self.lost = 0;
    }

    /// Reports that wait for the line.
    pub fn waiting(&self) -> usize {
        self.link.waiting()
    }
}

/// A converter and the sampler behind it: the loop that runs above everything else.
pub struct Acquisition<'q, BUS, RESET> {
    converter: Ads131m04<BUS, RESET>,
    sampler: Sampler<'q>,
    batch: Batch,
    reset: Reset,
    ready: bool,
    started: bool,
    /// Frames in a row that could not be read.
    unreadable: u8,
    /// Conversions since orders were last looked for.
    unasked: u8,
}

/// Delay of the converter's filter, microseconds.
pub fn filter_delay_us(config: &Config) -> f32 {
    let cycles = config.oversampling.delay_clock_cycles() as f32;
    cycles * 1e6 / config.clock_hz.max(1) as f32
}

/// So many conversions at the most are older than an order that waits for them.
const FETCHED_AHEAD: u8 = 8;

impl<'q, BUS: FrameBus, RESET: OutputPin> Acquisition<'q, BUS, RESET> {
    /// Of a converter that is not yet set up, and is reset in that way whenever it needs to be.
    pub fn new(converter: Ads131m04<BUS, RESET>, mut sampler: Sampler<'q>, reset: Reset) -> Self {
        sampler.set_delay(filter_delay_us(converter.config()));
        Self {
            converter,
            sampler,
            batch: Batch::default(),
            reset,
            ready: false,
            started: false,
            unreadable: 0,
            unasked: 0,
        }
    }

    /// Carries out what was ordered, then waits for conversions or one failure. Takes no longer
    /// than the converter's patience, so that orders are heard whatever the converter does. Call it for ever.
    pub async fn step(&mut self) {
        // What was converted before an order came does not belong to what it begins.
        if !self.converter.has_fetched() || self.unasked >= FETCHED_AHEAD {
            self.unasked = 0;
            let conversions = self.converter.conversions();
            let Self {
                converter, sampler, ..
            } = self;
            sampler.obey(conversions, || converter.now_us());
        }
        if !self.ready {
            return self.set_up().await;
        }
        match self.converter.next_batch(&mut self.batch).await {
            Ok(()) => {
                self.unreadable = 0;
                let count = self.batch.codes().len();
                self.unasked = self.unasked.saturating_add(count as u8);
                self.sampler.take(&self.batch);
            }
            Err(error) => {
                self.sampler.fail(error, self.converter.conversions());
                self.ready = !error.needs_initialise() && !self.is_out_of_step(error);
                if matches!(error, adc::Error::Spi(_)) {
                    // Nothing else takes time while the bus fails at once.
                    self.converter.pause_half_a_period().await;
                }
            }
        }
    }

    /// True when frames have been unreadable for so long that none will be right by itself: bytes of it are shifted, or
    /// the converter has lost its settings in a way that its status does not tell.
    fn is_out_of_step(&mut self, error: adc::Error) -> bool {
        self.unreadable = match error {
            adc::Error::Spi(_) | adc::Error::Checksum(_) => self.unreadable + 1,
            _ => 0,
        };
        let out_of_step = self.unreadable >= UNREADABLE;
        if out_of_step {
            self.unreadable = 0;
            self.sampler.checksum_set_ups = self.sampler.checksum_set_ups.saturating_add(1);
        }
        out_of_step
    }

    /// Pulse number `count` of the vehicle's time came when the lower half of the timers' clock stood at `stamp_us`, less
    /// than an hour ago.
    pub fn note_pulse(&mut self, count: u32, stamp_us: u32) {
        let now_us = self.converter.now_us();
        let ago_us = (now_us as u32).wrapping_sub(stamp_us);
        let time_us = now_us.saturating_sub(u64::from(ago_us));
        self.sampler.set_pulse(Pulse { count, time_us });
    }

    /// The sampler, for what it cannot measure itself.
    pub fn sampler(&mut self) -> &mut Sampler<'q> {
        &mut self.sampler
    }

    async fn set_up(&mut self) {
        match self.converter.initialise(self.reset).await {
            Ok(()) => {
                if self.started {
                    self.sampler.resets = self.sampler.resets.saturating_add(1);
                }
                self.started = true;
                self.ready = true;
                self.unreadable = 0;
            }
            Err(error) => {
                self.sampler.fail(error, self.converter.conversions());
                self.converter.pause_us(RETRY_US).await;
            }
        }
    }

    /// True while there is a conversion that [`Self::step`] will take without waiting.
    pub fn has_fetched(&self) -> bool {
        self.converter.has_fetched()
    }

    /// Reports that wait for the line: what to wake the application for.
    pub fn waiting(&self) -> usize {
        self.sampler.waiting()
    }
}
