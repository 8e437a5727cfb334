//! The application: commands in, events out. It only decides; the acquisition carries out, and nothing here can
//! hold it up.
//!
//! Each command is checked against what is open, becomes an [`Order`], and is acknowledged when the acquisition
//! has carried it out, with the sample from which on it holds. What cannot be is refused by name. Bytes that are no
//! frame are counted.

use heapless::Deque;
use shared::compensate::Compensator;
use shared::self_check::{Outcome, SetUp, Verdicts};
use shared::wire::board::{BlockConditions, BoardState};
use shared::wire::configuration::Certified;
use shared::wire::framing::{Deframer, Frame, FrameError};
use shared::wire::message::{
    CHANNELS, Coefficients, Command, Event, Identity, Parameter, Position, Refusal, Segment, State,
    StoreFault,
};
use shared::wire::version;

use crate::check::Check;
use crate::link::{Action, ApplicationEnd, Counters, MAX_ORDERS, Order, Report};
use crate::sampler::Sampler;
use crate::store::Kept;

/// Answers that may wait for the line: three to each order that may wait. A host that floods faster than it listens misses
/// some, and they are counted.
const REPLIES: usize = 3 * MAX_ORDERS;

/// Codes on either side of zero.
const HALF_RANGE: f64 = 8_388_608.0;

/// What the memory is to hold from now on, `None` for nothing, as the command of that number says.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Keep {
    /// Sequence number of the command's frame.
    pub sequence: u16,
    /// What to write.
    pub certified: Option<Certified>,
}

/// An answer that waits for the line.
#[derive(Clone, Copy, Debug)]
enum Reply {
    Hello,
    Board,
    State(State),
    Ack { sequence: u16, sample: u64 },
    Refused { sequence: u16, reason: Refusal },
    CheckBegun(SetUp),
    Check(Outcome),
    Certified,
    Stored { sequence: u16, kept: Kept },
}

/// The way of an order to the memory.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Keeping {
    /// Nothing to do.
    Idle,
    /// What is kept in the application is to be fetched, for the command of that number.
    Asked(u16),
    /// Under way, for the command of that number.
    Begun(u16),
}

/// The state of the conversation with the host.
pub struct App<'q> {
    identity: Identity,
    board: BoardState,
    link: ApplicationEnd<'q>,
    incoming: Deframer,
    replies: Deque<Reply, REPLIES>,
    /// What belongs to the block that was sent last.
    conditions: Option<BlockConditions>,
    greeted: bool,
    open: Segment,
    coefficients: Option<Coefficients>,
    certified: Option<Certified>,
    kept: Kept,
    keeping: Keeping,
    sequence: u16,
    rejected_frames: u32,
    dropped_replies: u32,
    check: Option<Check<'q>>,
    /// Number of the command that ends the open reading.
    closing: Option<u16>,
    /// What the last self-check found, until it is fetched.
    concluded: Option<Verdicts>,
}

impl<'q> App<'q> {
    /// Before the first byte; `identity` answers the host's greeting.
    pub fn new(identity: Identity, link: ApplicationEnd<'q>) -> Self {
        Self {
            identity,
            link,
            incoming: Deframer::new(),
            replies: Deque::new(),
            conditions: None,
            board: BoardState::default(),
            greeted: false,
            open: Segment::Idle,
            coefficients: None,
            certified: None,
            kept: Kept::default(),
            keeping: Keeping::Idle,
            sequence: 0,
            rejected_frames: 0,
            dropped_replies: 0,
            check: None,
            closing: None,
            concluded: None,
        }
    }

    /// The same with room for a self-check.
    pub fn with_check(self, check: Check<'q>) -> Self {
        Self {
            check: Some(check),
            ..self
        }
    }

    /// The same with what the memory held when power came on, for the acquisition as well. A configuration that cannot
    /// be with this converter's gains is no better than a corrupt one.
    pub fn with_kept(
        self,
        (certified, kept): (Option<Certified>, Kept),
        sampler: &mut Sampler<'_>,
    ) -> Self {
        let Some(known) = certified else {
            return Self { kept, ..self };
        };
        let Ok(compensator) = self.compensator(&known) else {
            let fault = Some(StoreFault::Corrupt);
            let kept = Kept { fault, ..kept };
            return Self { kept, ..self };
        };
        let block_samples = known.configuration.compensation.block_samples;
        sampler.compensate(block_samples, compensator);
        Self {
            coefficients: coefficients(&known),
            certified,
            kept,
            ..self
        }
    }

    /// What is to be written to the memory next; [`Self::stored`] ends it.
    pub fn keep(&mut self) -> Option<Keep> {
        let Keeping::Asked(sequence) = self.keeping else {
            return None;
        };
        self.keeping = Keeping::Begun(sequence);
        let certified = self.certified;
        Some(Keep {
            sequence,
            certified,
        })
    }

    /// The memory was written, or not.
    pub fn stored(&mut self, kept: Kept) {
        self.kept = kept;
        if let Keeping::Begun(sequence) = core::mem::replace(&mut self.keeping, Keeping::Idle) {
            self.reply_stored(sequence);
        }
    }

    fn reply_stored(&mut self, sequence: u16) {
        let kept = self.kept;
        self.reply(Reply::Stored { sequence, kept });
    }

    /// What is known of the memory.
    pub fn kept(&self) -> Kept {
        self.kept
    }

    /// What the board says of itself; whoever knows it better writes it there.
    pub fn board(&mut self) -> &mut BoardState {
        &mut self.board
    }

    /// The coefficients that the host has set or the memory held.
    pub fn coefficients(&self) -> Option<&Coefficients> {
        self.coefficients.as_ref()
    }

    /// What a self-check found that ended since the last call; its figures go over the link.
    pub fn concluded(&mut self) -> Option<Verdicts> {
        self.concluded.take()
    }

    /// Takes bytes from the line, in pieces of any length.
    pub fn receive(&mut self, mut bytes: &[u8]) {
        while !bytes.is_empty() {
            let (taken, packet) = self.incoming.feed(bytes);
            bytes = bytes.get(taken..).unwrap_or(&[]);
            let command = match packet {
                None => continue,
                Some(Ok(packet)) => packet
                    .message::<Command>()
                    .map(|command| (packet.sequence, command)),
                Some(Err(error)) => Err(error),
            };
            match command {
                Ok((sequence, command)) => self.command(sequence, command),
                Err(error) => {
                    self.rejected_frames = self.rejected_frames.saturating_add(1);
                    // Whoever speaks another version must learn which one is spoken here.
                    if let FrameError::Version(_) = error {
                        self.reply(Reply::Hello);
                    }
                }
            }
        }
    }

    /// Packs the next event for the line; false when there is none.
    pub fn transmit(&mut self, frame: &mut Frame) -> bool {
        loop {
            let packed = if let Some(conditions) = self.conditions.take() {
                frame.encode(&Event::Conditions(conditions), self.sequence)
            } else if let Some(reply) = self.replies.pop_front() {
                frame.encode(&self.answer(reply), self.sequence)
            } else if let Some(report) = self.link.report() {
                let event = match report {
                    Report::Raw(raw) => Event::Raw(raw.message()),
                    Report::Block(block, conditions) => {
                        if let Some(check) = &mut self.check {
                            check.block(block);
                        }
                        self.conditions = Some(*conditions);
                        Event::Block(*block)
                    }
                    Report::Compensated(block) => Event::Compensated(*block),
                    &Report::Fault { sample, fault } => {
                        if let Some(check) = &mut self.check {
                            check.fault();
                        }
                        Event::Fault { sample, fault }
                    }
                    &Report::Done {
                        sequence,
                        sample,
                        counters,
                    } => {
                        self.link.sent();
                        self.done(sequence, sample, counters);
                        continue;
                    }
                };
                let packed = frame.encode(&event, self.sequence);
                self.link.sent();
                packed
            } else {
                return false;
            };
            match packed {
                Ok(()) => {
                    self.sequence = self.sequence.wrapping_add(1);
                    return true;
                }
                // No message of ours is that long; if one were, it would be missed as a dropped one.
                Err(_) => self.dropped_replies = self.dropped_replies.saturating_add(1),
            }
        }
    }

    /// An answer as it goes over the line.
    fn answer(&self, reply: Reply) -> Event<'static> {
        match reply {
            Reply::Hello => Event::Hello(self.identity),
            Reply::Board => Event::Board(self.board),
            Reply::State(state) => Event::State(state),
            Reply::Ack { sequence, sample } => Event::Ack { sequence, sample },
            Reply::Refused { sequence, reason } => Event::Refused { sequence, reason },
            Reply::CheckBegun(set_up) => Event::CheckBegun(set_up),
            Reply::Check(outcome) => Event::Check(outcome),
            Reply::Certified => Event::Certified(self.certified),
            Reply::Stored { sequence, kept } => Event::Stored {
                sequence,
                writes: kept.writes,
                fault: kept.fault,
            },
        }
    }

    /// The acquisition has carried out an order.
    fn done(&mut self, sequence: u16, sample: u64, counters: Option<Counters>) {
        if let Some(counters) = counters {
            let mut state = counters.state;
            self.board.checksum_set_ups = counters.checksum_set_ups;
            self.board.pulse = counters.pulse;
            state.compensating = self.compensates();
            state.rejected_frames = self.rejected_frames;
            state.dropped_frames = state.dropped_frames.saturating_add(self.dropped_replies);
            self.reply(Reply::State(state));
            self.reply(Reply::Board);
        }
        if self.closing == Some(sequence) {
            self.closing = None;
            let v_per_code = v_per_code(&self.identity);
            if let Some(check) = &mut self.check {
                check.close(v_per_code);
            }
        }
        self.reply(Reply::Ack { sequence, sample });
    }

    fn reply(&mut self, reply: Reply) {
        if self.replies.push_back(reply).is_err() {
            self.dropped_replies = self.dropped_replies.saturating_add(1);
        }
    }

    fn command(&mut self, sequence: u16, command: Command) {
        if let Command::Hello { .. } = command {
            self.reply(Reply::Hello);
            self.reply(Reply::Board);
        }
        let outcome = self.check(&command).and_then(|action| {
            self.link
                .give(Order { sequence, action })
                .map_err(|_| Refusal::Busy)
        });
        match outcome {
            Ok(()) => self.carry_out(sequence, &command),
            Err(reason) => self.reply(Reply::Refused { sequence, reason }),
        }
    }

    /// What a command asks of the acquisition, if it is allowed now.
    fn check(&self, command: &Command) -> Result<Action, Refusal> {
        if let Command::Hello { version } = command {
            return if version.is_understood() {
                Ok(Action::Mark)
            } else {
                Err(Refusal::Version {
                    minimum: version::MINIMUM,
                    current: version::CURRENT,
                })
            };
        }
        if !self.greeted {
            return Err(Refusal::NoHello);
        }
        match command {
            Command::StartPosition(position) => {
                check_position(position)?;
                self.nothing_open()?;
                Ok(Action::Begin(Segment::Reading(position.reading)))
            }
            Command::StartRun(run) => {
                self.nothing_open()?;
                Ok(Action::Begin(Segment::Run(*run)))
            }
            Command::StopPosition if matches!(self.open, Segment::Reading(_)) => {
                Ok(Action::Begin(Segment::Idle))
            }
            Command::StopRun if matches!(self.open, Segment::Run(_)) => {
                Ok(Action::Begin(Segment::Idle))
            }
            Command::StopPosition | Command::StopRun => Err(Refusal::NotOpen),
            Command::StreamRaw { on } => Ok(Action::Stream(*on)),
            Command::SetCoefficients(coefficients) => {
                // The zero codes change with them, and blocks of one segment must agree in those.
                self.nothing_open()?;
                let zero = self.zero_codes(coefficients)?;
                // A compensator has zero codes of its own.
                Ok(if self.compensates() {
                    Action::Mark
                } else {
                    Action::Zero(zero)
                })
            }
            Command::Configure(_) | Command::EraseConfiguration => Err(Refusal::Unconditional),
            Command::Replace { writes, certified } => self.check_replacement(*writes, certified),
            Command::AskConfiguration => Ok(Action::Mark),
            Command::Hello { .. } => Ok(Action::Mark),
            Command::AskState => Ok(Action::State),
            Command::BeginCheck(_) if self.check.is_none() => Err(Refusal::NoCheck),
            Command::BeginCheck(set_up) => {
                self.nothing_open()?;
                if set_up.is_possible() {
                    Ok(Action::Mark)
                } else {
                    Err(Refusal::Parameter(Parameter::SetUp))
                }
            }
            Command::Conclude => {
                self.nothing_open()?;
                match self.outcome() {
                    Some(_) => Ok(Action::Mark),
                    None => Err(Refusal::NoCheck),
                }
            }
        }
    }

    /// What replacing the configuration asks of the acquisition. Whoever writes has to know what the memory holds: two hosts,
    /// or one whose last answer was lost, do not overwrite each other.
    fn check_replacement(
        &self,
        writes: u32,
        certified: &Option<Certified>,
    ) -> Result<Action, Refusal> {
        self.nothing_open()?;
        self.memory_is_free()?;
        if self.board.write_protected {
            return Err(Refusal::Protected);
        }
        if writes != self.kept.writes {
            let writes = self.kept.writes;
            return Err(Refusal::Writes { writes });
        }
        match certified {
            Some(certified) => {
                let compensator = self.compensator(certified)?;
                let block_samples = certified.configuration.compensation.block_samples;
                Ok(Action::Compensate(block_samples, compensator))
            }
            None => Ok(Action::Compensate(self.identity.block_samples, None)),
        }
    }

    fn outcome(&self) -> Option<Outcome> {
        self.check.as_ref()?.conclude(self.coefficients.as_ref())
    }

    /// Remembers a command whose order was given.
    fn carry_out(&mut self, sequence: u16, command: &Command) {
        match *command {
            Command::Hello { .. } => self.greeted = true,
            Command::StartPosition(position) => {
                self.open = Segment::Reading(position.reading);
                if let Some(check) = &mut self.check {
                    check.open(&position);
                }
            }
            Command::StartRun(run) => self.open = Segment::Run(run),
            Command::StopPosition => {
                self.open = Segment::Idle;
                self.closing = Some(sequence);
            }
            Command::StopRun => self.open = Segment::Idle,
            Command::SetCoefficients(coefficients) => self.coefficients = Some(coefficients),
            Command::BeginCheck(set_up) => {
                if let Some(check) = &mut self.check {
                    check.begin(set_up);
                    self.reply(Reply::CheckBegun(set_up));
                }
            }
            Command::Conclude => {
                if let Some(outcome) = self.outcome() {
                    self.concluded = Some(outcome.verdicts);
                    self.reply(Reply::Check(outcome));
                }
            }
            Command::Replace { certified, .. } => self.replace(sequence, certified),
            Command::AskConfiguration => {
                self.reply(Reply::Certified);
                self.reply_stored(sequence);
            }
            // The last two are refused.
            Command::StreamRaw { .. }
            | Command::AskState
            | Command::Configure(_)
            | Command::EraseConfiguration => {}
        }
    }

    fn replace(&mut self, sequence: u16, mut certified: Option<Certified>) {
        if let Some(provenance) = certified.as_mut().and_then(|c| c.provenance.as_mut()) {
            provenance.accepted_by = Some(self.identity.firmware);
        }
        self.certified = certified;
        self.coefficients = certified.as_ref().and_then(coefficients);
        self.keeping = Keeping::Asked(sequence);
    }

    fn compensates(&self) -> bool {
        let mode = self
            .certified
            .and_then(|c| c.configuration.compensation.mode);
        mode.is_some()
    }

    fn memory_is_free(&self) -> Result<(), Refusal> {
        match self.keeping {
            Keeping::Idle => Ok(()),
            Keeping::Asked(_) | Keeping::Begun(_) => Err(Refusal::Busy),
        }
    }

    /// The compensator of a configuration that can be.
    fn compensator(&self, certified: &Certified) -> Result<Option<Compensator<f32>>, Refusal> {
        let compensator = certified.compensator(v_per_code(&self.identity));
        let within = |code: i32| f64::from(code).abs() < HALF_RANGE;
        let mut zeros = compensator.iter().flat_map(|with| with.zero());
        if certified.is_possible() && zeros.all(within) {
            Ok(compensator)
        } else {
            Err(Refusal::Parameter(Parameter::Configuration))
        }
    }

    /// A reading that is being closed is still open to the self-check.
    fn nothing_open(&self) -> Result<(), Refusal> {
        match self.open {
            Segment::Idle if self.closing.is_some() => Err(Refusal::Closing),
            Segment::Idle => Ok(()),
            open => Err(Refusal::Open(open)),
        }
    }

    /// Codes of zero specific force: the instrument's K1 k0, and the middle of the reference's range.
    fn zero_codes(&self, coefficients: &Coefficients) -> Result<[i32; CHANNELS], Refusal> {
        let [scale_factor_v_per_g, bias_g, ..] = coefficients.nominal;
        let gain = f64::from(self.identity.gains[0]);
        let zero = scale_factor_v_per_g * bias_g * gain / self.identity.reference_v * HALF_RANGE;
        if coefficients.is_possible() && zero.abs() < HALF_RANGE {
            Ok([zero as i32, 0, 0, 0])
        } else {
            Err(Refusal::Parameter(Parameter::Coefficients))
        }
    }
}

fn coefficients(certified: &Certified) -> Option<Coefficients> {
    let calibration = certified.configuration.calibration;
    calibration.map(|known| known.coefficients)
}

/// Volts of one code of each channel.
fn v_per_code(identity: &Identity) -> [f64; CHANNELS] {
    let gains = identity.gains;
    gains.map(|gain| identity.reference_v / f64::from(gain) / HALF_RANGE)
}

fn check_position(position: &Position) -> Result<(), Refusal> {
    if !(1..=3).contains(&position.series) {
        return Err(Refusal::Parameter(Parameter::Series));
    }
    if !(position.dial_deg.is_finite() && position.mount_deg.is_finite()) {
        return Err(Refusal::Parameter(Parameter::Angle));
    }
    Ok(())
}
