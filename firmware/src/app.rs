//! The application: commands in, events out. It only decides; the acquisition carries out, and nothing here can
//! hold it up.
//!
//! Each command is checked against what is open, becomes an [`Order`], and is acknowledged when the acquisition
//! has carried it out, with the sample from which on it holds. What cannot be is refused by name. Bytes that are no
//! frame are counted.

use heapless::Deque;
use shared::compensate::Compensator;
use shared::self_check::{Outcome, Verdicts};
use shared::wire::configuration::Configuration;
use shared::wire::framing::{Deframer, Frame, FrameError};
use shared::wire::message::{
    CHANNELS, Coefficients, Command, Event, Identity, Parameter, Position, Refusal, Segment, State,
    StoreFault,
};
use shared::wire::version;

use crate::check::Check;
use crate::link::{Action, ApplicationEnd, Order, Report};
use crate::sampler::Sampler;
use crate::store::Kept;

/// Answers that may wait for the line; a host that floods faster than it listens misses some, and they are counted.
const REPLIES: usize = 8;

/// Codes on either side of zero.
const HALF_RANGE: f64 = 8_388_608.0;

/// What the memory is to hold from now on, `None` for nothing, as the command of that number says.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Keep {
    /// Sequence number of the command's frame.
    pub sequence: u16,
    /// What to write.
    pub configuration: Option<Configuration>,
}

/// The way of an order to the memory.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Keeping {
    /// Nothing to do.
    Idle,
    /// To be fetched.
    Asked(Keep),
    /// Under way, for the command of that number.
    Begun(u16),
}

/// The state of the conversation with the host.
pub struct App<'q> {
    identity: Identity,
    link: ApplicationEnd<'q>,
    incoming: Deframer,
    replies: Deque<Event<'static>, REPLIES>,
    greeted: bool,
    open: Segment,
    coefficients: Option<Coefficients>,
    configuration: Option<Configuration>,
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
            greeted: false,
            open: Segment::Idle,
            coefficients: None,
            configuration: None,
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
        (configuration, kept): (Option<Configuration>, Kept),
        sampler: &mut Sampler<'_>,
    ) -> Self {
        let Some(known) = configuration else {
            return Self { kept, ..self };
        };
        let Ok(compensator) = self.compensator(&known) else {
            let fault = Some(StoreFault::Corrupt);
            let kept = Kept { writes: 0, fault };
            return Self { kept, ..self };
        };
        sampler.compensate(known.compensation.block_samples, compensator);
        Self {
            coefficients: known.calibration.map(|known| known.coefficients),
            configuration,
            kept,
            ..self
        }
    }

    /// What is to be written to the memory next; [`Self::stored`] ends it.
    pub fn keep(&mut self) -> Option<Keep> {
        let Keeping::Asked(keep) = self.keeping else {
            return None;
        };
        self.keeping = Keeping::Begun(keep.sequence);
        Some(keep)
    }

    /// The memory was written, or not.
    pub fn stored(&mut self, kept: Kept) {
        self.kept = kept;
        if let Keeping::Begun(sequence) = core::mem::replace(&mut self.keeping, Keeping::Idle) {
            self.reply_stored(sequence);
        }
    }

    fn reply_stored(&mut self, sequence: u16) {
        let Kept { writes, fault } = self.kept;
        self.reply(Event::Stored {
            sequence,
            writes,
            fault,
        });
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
                        self.reply(Event::Hello(self.identity));
                    }
                }
            }
        }
    }

    /// Packs the next event for the line; false when there is none.
    pub fn transmit(&mut self, frame: &mut Frame) -> bool {
        loop {
            let packed = if let Some(event) = self.replies.pop_front() {
                frame.encode(&event, self.sequence)
            } else if let Some(report) = self.link.report() {
                let event = match report {
                    Report::Raw(raw) => Event::Raw(raw.message()),
                    Report::Block(block) => {
                        if let Some(check) = &mut self.check {
                            check.block(block);
                        }
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
                        state,
                    } => {
                        self.link.sent();
                        self.done(sequence, sample, state);
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

    /// The acquisition has carried out an order.
    fn done(&mut self, sequence: u16, sample: u64, state: Option<State>) {
        if let Some(mut state) = state {
            state.compensating = self.compensates();
            state.rejected_frames = self.rejected_frames;
            state.dropped_frames = state.dropped_frames.saturating_add(self.dropped_replies);
            self.reply(Event::State(state));
        }
        if self.closing == Some(sequence) {
            self.closing = None;
            let v_per_code = v_per_code(&self.identity);
            if let Some(check) = &mut self.check {
                check.close(v_per_code);
            }
        }
        self.reply(Event::Ack { sequence, sample });
    }

    fn reply(&mut self, event: Event<'static>) {
        if self.replies.push_back(event).is_err() {
            self.dropped_replies = self.dropped_replies.saturating_add(1);
        }
    }

    fn command(&mut self, sequence: u16, command: Command) {
        if let Command::Hello { .. } = command {
            self.reply(Event::Hello(self.identity));
        }
        let outcome = self.check(&command).and_then(|action| {
            self.link
                .give(Order { sequence, action })
                .map_err(|_| Refusal::Busy)
        });
        match outcome {
            Ok(()) => self.carry_out(sequence, &command),
            Err(reason) => self.reply(Event::Refused { sequence, reason }),
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
            Command::Configure(configuration) => {
                self.nothing_open()?;
                self.memory_is_free()?;
                let compensator = self.compensator(configuration)?;
                let block_samples = configuration.compensation.block_samples;
                Ok(Action::Compensate(block_samples, compensator))
            }
            Command::EraseConfiguration => {
                self.nothing_open()?;
                self.memory_is_free()?;
                Ok(Action::Compensate(self.identity.block_samples, None))
            }
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
                match (self.closing, self.outcome()) {
                    (Some(_), _) => Err(Refusal::Busy),
                    (None, Some(_)) => Ok(Action::Mark),
                    (None, None) => Err(Refusal::NoCheck),
                }
            }
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
                    self.reply(Event::CheckBegun(set_up));
                }
            }
            Command::Conclude => {
                if let Some(outcome) = self.outcome() {
                    self.concluded = Some(outcome.verdicts);
                    self.reply(Event::Check(outcome));
                }
            }
            Command::Configure(configuration) => self.configure(sequence, Some(configuration)),
            Command::EraseConfiguration => self.configure(sequence, None),
            Command::AskConfiguration => {
                self.reply(Event::Configuration(self.configuration));
                self.reply_stored(sequence);
            }
            Command::StreamRaw { .. } | Command::AskState => {}
        }
    }

    fn configure(&mut self, sequence: u16, configuration: Option<Configuration>) {
        self.configuration = configuration;
        let calibration = configuration.and_then(|known| known.calibration);
        self.coefficients = calibration.map(|known| known.coefficients);
        self.keeping = Keeping::Asked(Keep {
            sequence,
            configuration,
        });
    }

    fn compensates(&self) -> bool {
        let mode = self.configuration.and_then(|c| c.compensation.mode);
        mode.is_some()
    }

    fn memory_is_free(&self) -> Result<(), Refusal> {
        match self.keeping {
            Keeping::Idle => Ok(()),
            Keeping::Asked(_) | Keeping::Begun(_) => Err(Refusal::Busy),
        }
    }

    /// The compensator of a configuration that can be.
    fn compensator(
        &self,
        configuration: &Configuration,
    ) -> Result<Option<Compensator<f32>>, Refusal> {
        let compensator = configuration.compensator(v_per_code(&self.identity));
        let within = |code: i32| f64::from(code).abs() < HALF_RANGE;
        let mut zeros = compensator.iter().flat_map(|with| with.zero());
        if configuration.is_possible() && zeros.all(within) {
            Ok(compensator)
        } else {
            Err(Refusal::Parameter(Parameter::Configuration))
        }
    }

    fn nothing_open(&self) -> Result<(), Refusal> {
        match self.open {
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
