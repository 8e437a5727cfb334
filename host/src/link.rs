//! The conversation with a live instrument: commands that are answered, and everything that comes in its record, if there is
//! to be one.

use std::cell::RefCell;
use std::io::ErrorKind;
use std::rc::Rc;
use std::time::{Duration, Instant};

use shared::wire::board::BoardState;
use shared::wire::configuration::Certified;
use shared::wire::framing::{DELIMITER, Frame};
use shared::wire::message::{Command, Event, Identity, Refusal, Segment, State, StoreFault};
use shared::wire::version;

use crate::capture::Recorder;
use crate::error::Error;
use crate::record::{Reader, RecordError, Tally, hex};
use crate::source::Source;

/// How often a command is said before the instrument counts as deaf.
const ATTEMPTS: u32 = 4;

/// How long an answer may take.
const ANSWER: Duration = Duration::from_millis(500);

/// Blocks come a hundred times a second: after so long without a byte the line is dead.
const SILENCE: Duration = Duration::from_secs(2);

/// How long the instrument's memory may take: the flash erases a sector in half a second, and tries another.
const MEMORY: Duration = Duration::from_secs(5);

/// Bytes read at once.
const CHUNK: usize = 4096;

/// An answer to a command, by its number.
#[derive(Clone, Copy, Debug)]
enum Answer {
    Done(u16),
    Refused(u16, Refusal),
}

/// What the instrument keeps over a loss of power.
#[derive(Clone, Copy, Debug)]
pub struct Kept {
    /// What it compensates with now.
    pub certified: Option<Certified>,
    /// How often its memory was written.
    pub writes: u32,
    /// Why the memory does not hold what it should.
    pub fault: Option<StoreFault>,
}

/// A live instrument and the record of what it says.
#[derive(Debug)]
pub struct Link<S> {
    source: S,
    recorder: Option<Rc<RefCell<Recorder>>>,
    certified: Option<Certified>,
    board: Option<BoardState>,
    state: Option<State>,
    /// What it said last of its memory: writes and fault.
    stored: Option<(u32, Option<StoreFault>)>,
    reader: Reader,
    identity: Option<Identity>,
    answers: Vec<Answer>,
    sequence: u16,
    heard: Instant,
}

impl<S: Source> Link<S> {
    /// Greets the instrument at the far end of `source`.
    ///
    /// # Errors
    /// [`Error::Link`] if nobody answers, or in another version.
    pub fn unrecorded(source: S) -> Result<Self, Error> {
        let mut link = Self {
            source,
            recorder: None,
            certified: None,
            board: None,
            state: None,
            stored: None,
            reader: Reader::new(),
            identity: None,
            answers: Vec::new(),
            sequence: 0,
            heard: Instant::now(),
        };
        link.greet()?;
        Ok(link)
    }

    /// From here on what comes is appended to a record, the greeting first. An instrument that is not that of the record is
    /// refused before a byte of it is recorded.
    ///
    /// # Errors
    /// As [`Self::unrecorded`]; [`Error::Write`]; [`Error::Link`] for another instrument.
    pub fn record(&mut self, recorder: &Rc<RefCell<Recorder>>) -> Result<(), Error> {
        let known = recorder.borrow().ledger().reduction().identity().copied();
        if let (Some(known), Some(here)) = (known, self.identity)
            && known.serial != here.serial
        {
            return Err(self.broken(format!(
                "this is instrument {}, the record is of {}",
                hex(&here.serial),
                hex(&known.serial)
            )));
        }
        // What begins in the middle of a frame, or ended there, is nobody's.
        recorder.borrow_mut().write(&[DELIMITER])?;
        self.reader = Reader::new();
        self.recorder = Some(Rc::clone(recorder));
        self.greet().map(|_| ())
    }

    /// Asks the instrument who it is.
    ///
    /// # Errors
    /// As [`Self::unrecorded`].
    pub fn greet(&mut self) -> Result<Identity, Error> {
        let version = version::CURRENT;
        self.command(&Command::Hello { version })?;
        self.identity
            .ok_or_else(|| self.broken("the instrument does not say who it is"))
    }

    /// What was heard and what was missed.
    pub fn tally(&self) -> Tally {
        *self.reader.tally()
    }

    /// Makes the instrument keep this, or nothing, in place of what was written as the `writes`th, and asks what it keeps
    /// then.
    ///
    /// # Errors
    /// As [`Self::command`], and if its memory does not answer within five seconds, or was written by somebody else.
    pub fn replace(&mut self, writes: u32, certified: Option<Certified>) -> Result<Kept, Error> {
        self.stored = None;
        self.command(&Command::Replace { writes, certified })?;
        let end = Instant::now() + MEMORY;
        while self.stored.is_none() {
            if Instant::now() > end {
                return Err(self.broken("the instrument's memory does not answer"));
            }
            self.take()?;
        }
        self.ask_configuration()
    }

    /// Asks for the counters, and what the board says of itself.
    ///
    /// # Errors
    /// As [`Self::command`], and from firmware before version 2 of the protocol, which tells only the counters.
    pub fn ask_state(&mut self) -> Result<(State, BoardState), Error> {
        (self.state, self.board) = (None, None);
        self.command(&Command::AskState)?;
        self.state
            .zip(self.board)
            .ok_or_else(|| self.broken("the instrument does not say how it is"))
    }

    /// Asks what the instrument keeps.
    ///
    /// # Errors
    /// As [`Self::command`].
    pub fn ask_configuration(&mut self) -> Result<Kept, Error> {
        self.stored = None;
        self.command(&Command::AskConfiguration)?;
        let (writes, fault) = self
            .stored
            .ok_or_else(|| self.broken("the instrument does not say what it keeps"))?;
        Ok(Kept {
            certified: self.certified,
            writes,
            fault,
        })
    }

    /// Says a command until it is carried out.
    ///
    /// # Errors
    /// [`Error::Link`] if it is refused or not answered, or the line is dead; [`Error::Write`].
    pub fn command(&mut self, command: &Command) -> Result<(), Error> {
        for attempt in 0..ATTEMPTS {
            let number = self.send(command)?;
            let end = Instant::now() + ANSWER;
            while Instant::now() < end {
                self.take()?;
                for answer in std::mem::take(&mut self.answers) {
                    match answer {
                        Answer::Done(sequence) if sequence == number => return Ok(()),
                        Answer::Refused(sequence, reason) if sequence == number => {
                            return self.refused(command, reason, attempt > 0);
                        }
                        // Of an attempt before; that of this one comes as well.
                        _ => {}
                    }
                }
            }
        }
        Err(self.broken("the instrument does not answer"))
    }

    /// A command that is said again may have been carried out, and its first answer lost.
    fn refused(&self, command: &Command, reason: Refusal, again: bool) -> Result<(), Error> {
        match (command, reason) {
            (Command::StartPosition(position), Refusal::Open(Segment::Reading(open)))
                if again && open == position.reading =>
            {
                Ok(())
            }
            (Command::StopPosition, Refusal::NotOpen) if again => Ok(()),
            // The memory is at work for the first one, or done with it; what it keeps is asked for in any case.
            (Command::Replace { .. }, Refusal::Busy) if again => Ok(()),
            (Command::Replace { writes, .. }, Refusal::Writes { writes: now })
                if again && now == writes.saturating_add(1) =>
            {
                Ok(())
            }
            (_, Refusal::Protected) => {
                Err(self.broken("its memory is write-protected: open the jumper at its pin"))
            }
            (_, Refusal::Writes { .. }) => {
                Err(self.broken("its memory was written by somebody else meanwhile: ask again"))
            }
            (_, Refusal::Version { minimum, current }) => Err(self.broken(format!(
                "the instrument speaks the protocol's versions {} to {}, this program {} to {}",
                minimum.0,
                current.0,
                version::MINIMUM.0,
                version::CURRENT.0
            ))),
            (_, Refusal::NoHello) => Err(self.broken("the instrument was restarted")),
            (_, reason) => Err(self.broken(format!("the instrument refuses: {reason:?}"))),
        }
    }

    fn send(&mut self, command: &Command) -> Result<u16, Error> {
        self.sequence = self.sequence.wrapping_add(1);
        let mut frame = Frame::new();
        if frame.encode(command, self.sequence).is_err() {
            return Err(self.broken("a command is too long for a frame"));
        }
        match self.source.send(frame.as_bytes()) {
            Ok(()) => Ok(self.sequence),
            Err(error) => Err(self.broken(format!("lost: {error}"))),
        }
    }

    /// Records what comes for so long.
    ///
    /// # Errors
    /// [`Error::Link`] when the line is dead; [`Error::Write`].
    pub fn listen(&mut self, time: Duration) -> Result<(), Error> {
        self.listen_to(time, &mut |_| {})
    }

    /// The same, with each event that comes.
    ///
    /// # Errors
    /// As [`Self::listen`].
    pub fn listen_to(
        &mut self,
        time: Duration,
        each: &mut dyn FnMut(&Event<'_>),
    ) -> Result<(), Error> {
        let end = Instant::now() + time;
        while Instant::now() < end {
            self.take_each(each)?;
        }
        self.answers.clear();
        Ok(())
    }

    fn take(&mut self) -> Result<(), Error> {
        self.take_each(&mut |_| {})
    }

    /// Takes what has come, or waits as long as the source does, and hands out each event.
    ///
    /// # Errors
    /// As [`Self::listen`].
    pub fn take_each(&mut self, each: &mut dyn FnMut(&Event<'_>)) -> Result<(), Error> {
        let mut bytes = [0; CHUNK];
        match self.source.read(&mut bytes) {
            Ok(0) => Err(self.broken("lost: the line was closed")),
            Ok(length) => {
                self.heard = Instant::now();
                let bytes = &mut bytes[..length];
                if let Some(recorder) = &self.recorder {
                    let mut recorder = recorder.borrow_mut();
                    recorder.write(bytes)?;
                    recorder.flush()?;
                }
                self.hear(bytes, each)
            }
            Err(error) => match error.kind() {
                ErrorKind::TimedOut | ErrorKind::WouldBlock | ErrorKind::Interrupted => {
                    match self.heard.elapsed() > SILENCE {
                        true => Err(self.broken("lost: nothing was heard for two seconds")),
                        false => Ok(()),
                    }
                }
                _ => Err(self.broken(format!("lost: {error}"))),
            },
        }
    }

    fn hear(&mut self, bytes: &mut [u8], each: &mut dyn FnMut(&Event<'_>)) -> Result<(), Error> {
        let Self {
            reader,
            identity,
            answers,
            source,
            certified,
            board,
            state,
            stored,
            recorder,
            ..
        } = self;
        let mut absurd = None;
        let fed = reader.feed(bytes, &mut |event, _| {
            if let Some(recorder) = recorder {
                absurd = absurd.or(recorder.borrow_mut().hear(&event).err());
            }
            each(&event);
            match event {
                Event::Hello(who) => *identity = Some(who),
                Event::Ack { sequence, .. } => answers.push(Answer::Done(sequence)),
                Event::Refused { sequence, reason } => {
                    answers.push(Answer::Refused(sequence, reason));
                }
                Event::Certified(known) => *certified = known,
                Event::Board(told) => *board = Some(told),
                Event::State(told) => *state = Some(told),
                Event::Stored { writes, fault, .. } => *stored = Some((writes, fault)),
                _ => {}
            }
            Ok::<(), RecordError>(())
        });
        let broken = |problem: String| Error::Link {
            source_name: source.name(),
            problem,
        };
        fed.map_err(|error| broken(error.to_string()))?;
        absurd.map_or(Ok(()), |error| Err(broken(error.to_string())))
    }

    fn broken(&self, problem: impl Into<String>) -> Error {
        Error::Link {
            source_name: self.source.name(),
            problem: problem.into(),
        }
    }
}
