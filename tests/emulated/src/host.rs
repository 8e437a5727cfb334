//! A host at the other end of the line, as far as tests need one.

use std::time::Duration;

use shared::self_check::{Outcome, SetUp};
use shared::wire::board::{BlockConditions, BoardState};
use shared::wire::configuration::{Certified, Configuration};
use shared::wire::framing::Frame;
use shared::wire::message::{
    Block, CHANNELS, CompensatedBlock, Fault, Identity, Refusal, State, StoreFault,
};
use shared::wire::{Command, Deframer, Event, FrameError, version};

use crate::converter::Converter;
use crate::run::{Emulator, Error};

/// An event that stands by itself.
#[derive(Clone, Debug, PartialEq)]
pub enum Heard {
    /// Who is there.
    Hello(Identity),
    /// A command was carried out: its number, and the first sample for which it holds.
    Ack(u16, u64),
    /// A command was not carried out: its number and why.
    Refused(u16, Refusal),
    /// Moments.
    Block(Block),
    /// Samples from an index on.
    Raw(u64, Vec<[i32; CHANNELS]>),
    /// Counters.
    State(State),
    /// Trouble before a sample.
    Fault(u64, Fault),
    /// A self-check begins.
    CheckBegun(SetUp),
    /// Outcome of a self-check.
    Check(Outcome),
    /// A block freed of vibration error.
    Compensated(CompensatedBlock),
    /// How it compensates, as version 1 told it.
    Configuration(Option<Configuration>),
    /// What it keeps.
    Certified(Option<Certified>),
    /// The board.
    Board(BoardState),
    /// What the last block was measured under.
    Conditions(BlockConditions),
    /// The memory was written for the command of that number, so often, or not.
    Stored(u16, u32, Option<StoreFault>),
    /// Bytes that are no frame.
    Broken(FrameError),
    /// So many frames of the instrument are missing here, by their numbers.
    Missing(u16),
}

impl From<Event<'_>> for Heard {
    fn from(event: Event<'_>) -> Self {
        match event {
            Event::Hello(identity) => Self::Hello(identity),
            Event::Ack { sequence, sample } => Self::Ack(sequence, sample),
            Event::Refused { sequence, reason } => Self::Refused(sequence, reason),
            Event::Block(block) => Self::Block(block),
            Event::Raw(raw) => Self::Raw(raw.first_sample, raw.samples().collect()),
            Event::State(state) => Self::State(state),
            Event::Fault { sample, fault } => Self::Fault(sample, fault),
            Event::Check(outcome) => Self::Check(outcome),
            Event::CheckBegun(set_up) => Self::CheckBegun(set_up),
            Event::Compensated(block) => Self::Compensated(block),
            Event::Configuration(configuration) => Self::Configuration(configuration),
            Event::Certified(certified) => Self::Certified(certified),
            Event::Board(board) => Self::Board(board),
            Event::Conditions(conditions) => Self::Conditions(conditions),
            Event::Stored {
                sequence,
                writes,
                fault,
            } => Self::Stored(sequence, writes, fault),
        }
    }
}

/// The emulated board with a host that talks to it.
pub struct Conversation {
    /// The board.
    pub board: Emulator,
    deframer: Deframer,
    sequence: u16,
    /// Number of the last frame that was heard.
    last: Option<u16>,
    heard: Vec<Heard>,
}

/// How long an answer may take: what the line still holds comes first.
const PATIENCE: Duration = Duration::from_millis(200);

/// How often a board is greeted that does not answer.
const GREETINGS: u32 = 3;

impl Conversation {
    /// Powers the board, and greets it once its converter is set up.
    pub fn start(converter: impl Converter + 'static) -> Result<Self, Error> {
        Self::with_board(Emulator::start(converter)?)
    }

    /// Greets this board, which was just powered, once its converter is set up.
    pub fn with_board(board: Emulator) -> Result<Self, Error> {
        let mut host = Self {
            board,
            deframer: Deframer::new(),
            sequence: 0,
            last: None,
            heard: Vec::new(),
        };
        // A slow processor is still setting its converter up when the first greeting comes.
        for _ in 0..GREETINGS {
            host.listen(Duration::from_millis(20))?;
            if host.greet()? {
                break;
            }
        }
        Ok(host)
    }

    /// Greets the board; true if it answers.
    pub fn greet(&mut self) -> Result<bool, Error> {
        let version = version::CURRENT;
        Ok(self.command(&Command::Hello { version })?.is_some())
    }

    /// Sends a command without waiting; returns its number.
    pub fn send(&mut self, command: &Command) -> u16 {
        self.sequence = self.sequence.wrapping_add(1);
        let mut frame = Frame::new();
        if frame.encode(command, self.sequence).is_ok() {
            self.board.send(frame.as_bytes());
        }
        self.sequence
    }

    /// Sends a command and waits until it is acknowledged or refused, or for 200 ms: the sample from which on it holds.
    pub fn command(&mut self, command: &Command) -> Result<Option<u64>, Error> {
        let number = self.send(command);
        let end = self.board.now() + PATIENCE;
        while self.board.now() < end {
            let before = self.heard.len();
            self.listen(Duration::from_millis(1))?;
            for heard in self.heard.get(before..).unwrap_or(&[]) {
                match heard {
                    Heard::Ack(sequence, sample) if *sequence == number => {
                        return Ok(Some(*sample));
                    }
                    Heard::Refused(sequence, _) if *sequence == number => return Ok(None),
                    _ => {}
                }
            }
        }
        Ok(None)
    }

    /// The instrument's counters, `None` if it does not answer.
    pub fn state(&mut self) -> Result<Option<State>, Error> {
        self.command(&Command::AskState)?;
        let state = self.heard.iter().rev().find_map(|heard| match heard {
            Heard::State(state) => Some(*state),
            _ => None,
        });
        Ok(state)
    }

    /// What the board says of itself, `None` if it does not answer.
    pub fn board_state(&mut self) -> Result<Option<BoardState>, Error> {
        self.command(&Command::AskState)?;
        let board = self.heard.iter().rev().find_map(|heard| match heard {
            Heard::Board(board) => Some(*board),
            _ => None,
        });
        Ok(board)
    }

    /// Makes the instrument keep this in place of what it keeps, as [`Self::command`].
    pub fn replace(&mut self, certified: Option<Certified>) -> Result<Option<u64>, Error> {
        self.command(&Command::AskConfiguration)?;
        let writes = self.heard.iter().rev().find_map(|heard| match heard {
            Heard::Stored(_, writes, _) => Some(*writes),
            _ => None,
        });
        let writes = writes.unwrap_or(0);
        self.command(&Command::Replace { writes, certified })
    }

    /// Lets time go by and takes down what is heard.
    pub fn listen(&mut self, time: Duration) -> Result<(), Error> {
        self.board.run_for(time)?;
        let bytes = self.board.received();
        let mut rest = bytes.as_slice();
        while !rest.is_empty() {
            let (taken, packet) = self.deframer.feed(rest);
            rest = rest.get(taken..).unwrap_or(&[]);
            let heard = match packet {
                None => continue,
                Some(Err(error)) => Heard::Broken(error),
                Some(Ok(packet)) => {
                    let expected = self.last.map(|last| last.wrapping_add(1));
                    let missing = packet
                        .sequence
                        .wrapping_sub(expected.unwrap_or(packet.sequence));
                    self.last = Some(packet.sequence);
                    if missing > 0 {
                        self.heard.push(Heard::Missing(missing));
                    }
                    match packet.message::<Event>() {
                        Ok(event) => event.into(),
                        Err(error) => Heard::Broken(error),
                    }
                }
            };
            self.heard.push(heard);
        }
        Ok(())
    }

    /// What was heard since the last call, in order.
    pub fn heard(&mut self) -> Vec<Heard> {
        std::mem::take(&mut self.heard)
    }
}
