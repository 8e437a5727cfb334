//! Between acquisition and line: two bounded queues without locks, and counters of what did not fit.
//!
//! The acquisition runs above everything else and never waits. It puts [`Report`]s into a queue and takes
//! [`Order`]s from another; the [application](crate::app) does the contrary. When the line is slower than the
//! converter, blocks and raw samples are dropped, and counted exactly; answers to orders always have room.

use heapless::spsc::{Consumer, Producer, Queue};
use shared::compensate::Compensator;
use shared::wire::board::{BlockConditions, Pulse};
use shared::wire::message::{
    self, Block, CHANNELS, CompensatedBlock, Fault, MAX_RAW_SAMPLES, SAMPLE, Segment, State,
};

/// Samples in a full raw frame.
pub const RAW_SAMPLES: usize = 32;

const _: () = assert!(RAW_SAMPLES <= MAX_RAW_SAMPLES);

/// Orders that may wait for the acquisition, and reports kept free for the answers to them.
pub const MAX_ORDERS: usize = 4;

/// Slots of the queue of reports; one stays empty.
const REPORT_SLOTS: usize = 16;

/// What the acquisition is told; carried out between two conversions.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Order {
    /// Sequence number of the command's frame.
    pub sequence: u16,
    /// What to do.
    pub action: Action,
}

/// What an [`Order`] asks for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Action {
    /// Nothing but the answer, which tells the index of the next sample.
    Mark,
    /// The samples from here on belong to this.
    Begin(Segment),
    /// Report every sample, or no longer.
    Stream(bool),
    /// The codes of zero specific force from the next block on.
    Zero([i32; CHANNELS]),
    /// Blocks of that many conversions from here on, freed of vibration error if there is a compensator.
    Compensate(u16, Option<Compensator<f32>>),
    /// Report the counters.
    State,
}

/// What the acquisition says.
#[derive(Clone, Debug, PartialEq)]
pub enum Report {
    /// An order was carried out.
    Done {
        /// Its sequence number.
        sequence: u16,
        /// The first sample for which it holds.
        sample: u64,
        /// The counters, if it asked for them.
        counters: Option<Counters>,
    },
    /// A block was closed, under these conditions.
    Block(Block, BlockConditions),
    /// The same block freed of vibration error.
    Compensated(CompensatedBlock),
    /// Consecutive samples.
    Raw(RawSamples),
    /// Something went wrong.
    Fault {
        /// Index of the sample before which it was noticed.
        sample: u64,
        /// What.
        fault: Fault,
    },
}

/// What the acquisition counts.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Counters {
    /// As the state tells it; what the application counts is zero.
    pub state: State,
    /// Times that the converter was set up anew because its frames were wrong in a row.
    pub checksum_set_ups: u32,
    /// The last pulse of the vehicle's time.
    pub pulse: Option<Pulse>,
}

impl Report {
    /// Samples that are lost to the host when this is dropped.
    fn samples(&self) -> u64 {
        match self {
            Self::Block(block, _) => u64::from(block.count),
            Self::Raw(raw) => raw.count() as u64,
            // Its samples are those of the block before.
            Self::Compensated(_) | Self::Done { .. } | Self::Fault { .. } => 0,
        }
    }
}

/// At most [`RAW_SAMPLES`] consecutive samples, packed for the line.
#[derive(Clone, Debug, PartialEq)]
pub struct RawSamples {
    segment: Segment,
    first_sample: u64,
    codes: heapless::Vec<u8, { RAW_SAMPLES * SAMPLE }, u16>,
}

impl RawSamples {
    /// None yet; the first will have that index.
    pub const fn new(segment: Segment, first_sample: u64) -> Self {
        Self {
            segment,
            first_sample,
            codes: heapless::Vec::new(),
        }
    }

    /// Adds the next sample; a full frame takes none.
    #[inline]
    pub fn push(&mut self, codes: &[i32; CHANNELS]) {
        // All or nothing: the room is a multiple of the sample's bytes.
        let _ = self.codes.extend_from_slice(&message::pack(codes));
    }

    /// Samples inside.
    pub fn count(&self) -> usize {
        self.codes.len() / SAMPLE
    }

    /// True when nothing more fits.
    pub fn is_full(&self) -> bool {
        self.codes.is_full()
    }

    /// As the message that carries them.
    pub fn message(&self) -> message::Raw<'_> {
        message::Raw {
            segment: self.segment,
            first_sample: self.first_sample,
            codes: &self.codes,
        }
    }
}

/// The two queues; made once, where both sides can reach them.
#[derive(Default)]
pub struct Queues {
    orders: Queue<Order, { MAX_ORDERS + 1 }>,
    reports: Queue<Report, REPORT_SLOTS>,
}

impl Queues {
    /// Both empty.
    pub const fn new() -> Self {
        Self {
            orders: Queue::new(),
            reports: Queue::new(),
        }
    }

    /// The acquisition's end and the application's.
    pub fn split(&mut self) -> (AcquisitionEnd<'_>, ApplicationEnd<'_>) {
        let (give_orders, take_orders) = self.orders.split();
        let (give_reports, take_reports) = self.reports.split();
        (
            AcquisitionEnd {
                orders: take_orders,
                reports: give_reports,
                dropped_frames: 0,
                dropped_samples: 0,
            },
            ApplicationEnd {
                orders: give_orders,
                reports: take_reports,
                unanswered: 0,
            },
        )
    }
}

/// The acquisition's end of the [`Queues`].
pub struct AcquisitionEnd<'q> {
    orders: Consumer<'q, Order>,
    reports: Producer<'q, Report>,
    dropped_frames: u32,
    dropped_samples: u64,
}

impl AcquisitionEnd<'_> {
    /// The next order, if one waits.
    pub fn order(&mut self) -> Option<Order> {
        self.orders.dequeue()
    }

    /// Answers an order; there is always room, since the application keeps to [`MAX_ORDERS`].
    pub fn answer(&mut self, report: Report) {
        self.put(report);
    }

    /// Puts a report into the queue, or drops and counts it.
    pub fn offer(&mut self, report: Report) {
        if self.reports.len() + MAX_ORDERS < self.reports.capacity() {
            self.put(report);
        } else {
            self.count(&report);
        }
    }

    fn put(&mut self, report: Report) {
        if let Err(report) = self.reports.enqueue(report) {
            self.count(&report);
        }
    }

    fn count(&mut self, report: &Report) {
        self.dropped_frames = self.dropped_frames.saturating_add(1);
        self.dropped_samples = self.dropped_samples.saturating_add(report.samples());
    }

    /// Reports that wait for the line.
    pub fn waiting(&self) -> usize {
        self.reports.len()
    }

    /// Reports that were dropped.
    pub fn dropped_frames(&self) -> u32 {
        self.dropped_frames
    }

    /// Samples in the raw frames and blocks among them.
    pub fn dropped_samples(&self) -> u64 {
        self.dropped_samples
    }
}

/// The application's end of the [`Queues`].
pub struct ApplicationEnd<'q> {
    orders: Producer<'q, Order>,
    reports: Consumer<'q, Report>,
    unanswered: usize,
}

/// As many orders as there is room for wait for an answer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Busy;

impl ApplicationEnd<'_> {
    /// Gives an order to the acquisition.
    ///
    /// # Errors
    /// [`Busy`] with [`MAX_ORDERS`] unanswered; nothing is given then.
    pub fn give(&mut self, order: Order) -> Result<(), Busy> {
        if self.unanswered >= MAX_ORDERS {
            return Err(Busy);
        }
        self.orders.enqueue(order).map_err(|_| Busy)?;
        self.unanswered += 1;
        Ok(())
    }

    /// The next report, if one waits. It is looked at where it lies, since it is long; [`Self::sent`] takes it away.
    pub fn report(&self) -> Option<&Report> {
        self.reports.peek()
    }

    /// Makes room where the next report lay.
    pub fn sent(&mut self) {
        if let Some(Report::Done { .. }) = self.reports.dequeue() {
            self.unanswered = self.unanswered.saturating_sub(1);
        }
    }
}
