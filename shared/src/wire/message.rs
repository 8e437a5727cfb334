//! The messages. Append-only: variants are never moved, changed or removed, since postcard numbers them by
//! their order, and no field is ever added to a struct; what is new is a new variant at the end, and raises
//! [`CURRENT`](super::version::CURRENT). A frame is of the version that its message came with.
//!
//! Sample indices count the converter's conversions, by its DRDY edges, since the acquisition began. A lost
//! conversion has an index too, so that a gap in the indices is a loss, and its length how much.

use serde::{Deserialize, Serialize};

use super::board::{BlockConditions, BoardState};
use super::configuration::{Certified, Configuration};
use super::version::Version;
use crate::compensate::Quality;
use crate::self_check::{Outcome, SetUp};

pub use super::configuration::Coefficients;
pub use crate::channels::{Block, BlockMoments as Moments, CHANNELS, Plateau, Run, Segment};

/// Bytes of one four-channel sample in [`Raw::codes`].
pub const SAMPLE: usize = 3 * CHANNELS;

/// Most samples that one [`Raw`] carries.
pub const MAX_RAW_SAMPLES: usize = 64;

/// What the host asks of the instrument. Each is answered by [`Event::Ack`] or [`Event::Refused`] with the
/// command's sequence number; [`Command::Hello`] and [`Command::AskState`] by their event as well.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub enum Command {
    /// Opens the conversation; answered by [`Event::Hello`].
    Hello {
        /// The host's protocol version.
        version: Version,
    },
    /// The dial stands at a mark: the blocks from here on belong to this reading.
    StartPosition(Position),
    /// Ends the reading.
    StopPosition,
    /// The blocks from here on belong to this shaker run.
    StartRun(Run),
    /// Ends the run.
    StopRun,
    /// Sends every sample ([`Event::Raw`]) beside the blocks, or no longer.
    StreamRaw {
        /// True to send.
        on: bool,
    },
    /// The coefficients that the self-check compares with and that zero codes come from, until power is lost or
    /// [`Self::Configure`] brings others.
    SetCoefficients(Coefficients),
    /// Answered by [`Event::State`].
    AskState,
    /// Begins a self-check: the readings from here on go into it.
    BeginCheck(SetUp),
    /// Ends the self-check and asks for its outcome, [`Event::Check`].
    Conclude,
    /// Of version 1, which does not say what it replaces: refused, [`Refusal::Unconditional`].
    Configure(Configuration),
    /// The same.
    EraseConfiguration,
    /// Answered by [`Event::Certified`] and [`Event::Stored`].
    AskConfiguration,
    /// Compensate like this from now on, and keep it; [`Event::Stored`] tells when it is kept.
    Replace {
        /// How often the memory has been written, as the host knows it. If it was written since, this is refused.
        writes: u32,
        /// What to keep; `None`: nothing, and compensate no longer.
        certified: Option<Certified>,
    },
}

/// What the instrument says.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub enum Event<'a> {
    /// Who is there; answers [`Command::Hello`], also of a version that is then refused.
    Hello(Identity),
    /// A command was carried out.
    Ack {
        /// Sequence number of the command's frame.
        sequence: u16,
        /// The first sample for which it holds.
        sample: u64,
    },
    /// A command was not carried out.
    Refused {
        /// Sequence number of the command's frame.
        sequence: u16,
        /// Why.
        reason: Refusal,
    },
    /// Moments of a stretch of samples.
    Block(Block),
    /// Samples as the converter gave them.
    #[serde(borrow)]
    Raw(Raw<'a>),
    /// Counters; answers [`Command::AskState`].
    State(State),
    /// Something went wrong with the acquisition; told once when it begins.
    Fault {
        /// Index of the sample before which it was noticed.
        sample: u64,
        /// What.
        fault: Fault,
    },
    /// Outcome of a self-check.
    Check(Outcome),
    /// A self-check begins, with this; answers [`Command::BeginCheck`].
    CheckBegun(SetUp),
    /// A block freed of vibration error.
    Compensated(CompensatedBlock),
    /// How it compensates; answers [`Command::AskConfiguration`].
    Configuration(Option<Configuration>),
    /// The memory was written, or not.
    Stored {
        /// Sequence number of the command's frame.
        sequence: u16,
        /// How often it has been written.
        writes: u32,
        /// Why what is kept is not what the command says.
        fault: Option<StoreFault>,
    },
    /// The board itself; answers [`Command::Hello`] and [`Command::AskState`] beside their own events.
    Board(BoardState),
    /// Which time the last block is for, and under what it was measured.
    Conditions(BlockConditions),
    /// What is kept; answers [`Command::AskConfiguration`].
    Certified(Option<Certified>),
}

/// What a frame can carry.
pub trait Message: Serialize {
    /// The oldest version of the protocol that knows this message. A frame is of that version, so that an older peer
    /// still understands everything that it knows.
    fn version(&self) -> Version;
}

/// The version of the protocol that came first.
const FIRST: Version = Version(1);

impl Message for Command {
    fn version(&self) -> Version {
        match self {
            Self::Replace { .. } => Version(2),
            // It tells the host's version, and is understood by all.
            _ => FIRST,
        }
    }
}

impl Message for Event<'_> {
    fn version(&self) -> Version {
        match self {
            Self::Board(_) | Self::Conditions(_) | Self::Certified(_) => Version(2),
            Self::Refused {
                reason:
                    Refusal::Closing
                    | Refusal::Unconditional
                    | Refusal::Writes { .. }
                    | Refusal::Protected,
                ..
            } => Version(2),
            _ => FIRST,
        }
    }
}

/// The sense in which the dial came to its mark.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Approach {
    /// Clockwise.
    Cw,
    /// Counter-clockwise.
    Ccw,
}

/// A reading at a dial position, as a row of `static.csv`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Position {
    /// Number of the reading, the column `order`.
    pub reading: u32,
    /// 1 to 3: which axis lies along the dial's shaft (OA, PA, IA).
    pub series: u8,
    /// Nominal dial angle, degrees.
    pub dial_deg: f64,
    /// Angle by which the instrument is remounted on the shaft, degrees.
    pub mount_deg: f64,
    /// The sense in which the dial came to the mark.
    pub approach: Approach,
}

/// Who the instrument is and how its codes become volts: `code * reference_v / gain / 2^23`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Identity {
    /// Oldest protocol version that it understands.
    pub minimum: Version,
    /// The protocol version that it speaks.
    pub current: Version,
    /// Version of its firmware: major, minor, patch.
    pub firmware: [u8; 3],
    /// The device's unique number.
    pub serial: [u8; 12],
    /// Nominal rate of four-channel samples, Hz; [`State`] lets the host measure it.
    pub sample_rate_hz: f64,
    /// The converter's reference voltage, V: full scale at gain 1.
    pub reference_v: f64,
    /// Gain of each channel, 1 to 128.
    pub gains: [u8; CHANNELS],
    /// Samples in a full block.
    pub block_samples: u16,
}

/// Specific force over the samples `first_sample .. first_sample + count + lost`, freed of vibration error.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct CompensatedBlock {
    /// What the samples belong to.
    pub segment: Segment,
    /// Index of the block's first sample.
    pub first_sample: u64,
    /// Samples that it is the mean of.
    pub count: u32,
    /// Conversions of this stretch that were lost.
    pub lost: u32,
    /// Mean specific force on IA, g.
    pub specific_force_g: f64,
    /// The vibration error that was taken out, g.
    pub vre_g: f32,
    /// Its standard uncertainty from the coefficients' covariance, g; infinite without coefficients.
    pub vre_sigma_g: f32,
    /// What this is worth.
    pub quality: Quality,
}

/// Consecutive samples as the converter gave them; none is missing inside.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Raw<'a> {
    /// What the samples belong to.
    pub segment: Segment,
    /// Index of the first sample.
    pub first_sample: u64,
    /// [`SAMPLE`] bytes a sample: the four channels' codes, each 3 bytes little-endian in offset binary
    /// (`code + 2^23`, which keeps small signals free of zero bytes and so of byte stuffing).
    #[serde(borrow, serialize_with = "as_bytes")]
    pub codes: &'a [u8],
}

fn as_bytes<S: serde::Serializer>(bytes: &[u8], serializer: S) -> Result<S::Ok, S::Error> {
    serializer.serialize_bytes(bytes)
}

/// Zero in offset binary.
const OFFSET: i32 = 1 << 23;

/// Packs one sample for [`Raw::codes`], as three words of 32 bits. Codes outside 24 bits lose their upper bits.
#[inline]
pub fn pack(codes: &[i32; CHANNELS]) -> [u8; SAMPLE] {
    let [a, b, c, d] = codes.map(|code| (code.wrapping_add(OFFSET) as u32) & 0xFF_FFFF);
    let words = [a | b << 24, b >> 8 | c << 16, c >> 16 | d << 8];
    let mut bytes = [0; SAMPLE];
    let (places, _) = bytes.as_chunks_mut::<4>();
    for (place, word) in places.iter_mut().zip(words) {
        *place = word.to_le_bytes();
    }
    bytes
}

/// The inverse of [`pack`].
#[inline]
pub fn unpack(bytes: &[u8; SAMPLE]) -> [i32; CHANNELS] {
    core::array::from_fn(|k| {
        i32::from_le_bytes([bytes[3 * k], bytes[3 * k + 1], bytes[3 * k + 2], 0]) - OFFSET
    })
}

impl<'a> Raw<'a> {
    /// The samples, in order; bytes of an incomplete last one are left out.
    #[inline]
    pub fn samples(&self) -> impl ExactSizeIterator<Item = [i32; CHANNELS]> + use<'a> {
        self.codes.as_chunks::<SAMPLE>().0.iter().map(unpack)
    }
}

/// Counters since the acquisition began.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct State {
    /// What the samples belong to now.
    pub segment: Segment,
    /// True while every sample is sent.
    pub streaming: bool,
    /// True when there are coefficients to compensate with.
    pub compensating: bool,
    /// The instrument's clock, microseconds.
    pub clock_us: u64,
    /// Conversions that the converter made, counted by its DRDY edges.
    pub conversions: u64,
    /// Conversions that were read and are sound.
    pub samples: u64,
    /// Conversions that were lost.
    pub lost: u64,
    /// Frames that found the link's queue full.
    pub dropped_frames: u32,
    /// Samples in the raw frames and blocks among them.
    pub dropped_samples: u64,
    /// Conversions with a wrong checksum.
    pub converter_checksum_errors: u32,
    /// Times that the converter was set up anew.
    pub converter_resets: u32,
    /// Frames from the host that were not sound.
    pub rejected_frames: u32,
    /// The last thing that went wrong with the acquisition.
    pub last_fault: Option<Fault>,
}

/// What can go wrong with the acquisition.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Fault {
    /// The bus or a pin reported an error.
    Bus,
    /// No DRDY edge came in time.
    DrdyTimeout {
        /// How long it was waited for.
        waited_us: u32,
    },
    /// The checksum of a frame from the converter is wrong.
    Checksum {
        /// As sent by the converter.
        sent: u16,
        /// As computed from what arrived.
        computed: u16,
    },
    /// The device identification is not that of the converter.
    Identification {
        /// The register ID as read.
        read: u16,
    },
    /// A register does not hold what was written.
    Register {
        /// Its address.
        address: u8,
        /// What was written.
        written: u16,
        /// What was read.
        read: u16,
    },
    /// A command to the converter was not acknowledged.
    Acknowledge {
        /// The response that it asks for.
        expected: u16,
        /// The response as read.
        read: u16,
    },
    /// The status word names a trouble: reset, input checksum, register map, synchronisation, lock, word length.
    Status {
        /// The status word.
        read: u16,
    },
    /// Conversions were not read in time.
    Overrun {
        /// How many.
        lost: u32,
    },
    /// DRDY is low but there is no new conversion.
    NoData,
    /// The converter's data sheet does not allow its master clock, as it is set or as the beat of its conversions tells.
    Clock {
        /// Hz.
        clock_hz: u32,
    },
}

/// Why the memory does not hold what it should.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum StoreFault {
    /// Reading, erasing or writing failed.
    Flash,
    /// What is read back is not what was written.
    Verify,
    /// It holds something that is no configuration.
    Corrupt,
    /// A configuration of another version of the firmware.
    Version,
}

/// Why a command is refused.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Refusal {
    /// The host's protocol version is not understood.
    Version {
        /// Oldest that is.
        minimum: Version,
        /// Newest that is.
        current: Version,
    },
    /// No [`Command::Hello`] of an understood version came first.
    NoHello,
    /// Another reading or run is open.
    Open(Segment),
    /// No reading is open, or no run.
    NotOpen,
    /// A parameter is out of its range.
    Parameter(Parameter),
    /// Too many commands wait to be carried out.
    Busy,
    /// No self-check was begun, or its readings do not determine the coefficients.
    NoCheck,
    /// A reading is being closed; say it again once that is acknowledged.
    Closing,
    /// [`Command::Replace`] says what it replaces, and this command does not.
    Unconditional,
    /// The memory was written since.
    Writes {
        /// How often it has been.
        writes: u32,
    },
    /// The write-protect pin is set.
    Protected,
}

/// A command's parameter.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Parameter {
    /// [`Position::series`] is not 1 to 3.
    Series,
    /// [`Position::dial_deg`] or [`Position::mount_deg`] is not finite.
    Angle,
    /// One of [`Coefficients`] is not finite, or the scale factor is not positive.
    Coefficients,
    /// A figure of [`SetUp`] cannot be.
    SetUp,
    /// A figure of [`Configuration`] cannot be.
    Configuration,
}
