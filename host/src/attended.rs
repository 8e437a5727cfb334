//! A static test of a real instrument: a person turns the dial, the host measures at each mark. The walk says what is next;
//! here it is done: at the instrument, in the record, in the tables.

use std::cell::RefCell;
use std::mem::{Discriminant, discriminant};
use std::rc::Rc;
use std::time::{Duration, Instant};

use shared::wire::message::{Command, Event, Identity};

use crate::bench::plan::Dwell;
use crate::campaign::{Campaign, CampaignConfig};
use crate::capture::{self, Folder, Ledger, Recorder};
use crate::error::Error;
use crate::interrupt::Interrupt;
use crate::link::Link;
use crate::record::{Note, ReadingNote, Tally, pieces};
use crate::source::Source;
use crate::statics::Environment;
use crate::walk::{Counts, Order, Phase, Settings, View, Walk, Wish};

/// How long the instrument may take to solve for its coefficients.
const CONCLUDING: Duration = Duration::from_secs(3);

/// How often the person is shown what is going on.
const SHOW: Duration = Duration::from_millis(200);

/// How often a lost instrument is looked for.
const LOOK_FOR: Duration = Duration::from_secs(1);

/// How often the person is looked after meanwhile.
const LOOK: Duration = Duration::from_millis(50);

/// What the walk is doing, and where.
type State = (Discriminant<Phase>, Option<usize>);

/// The person at the dial.
pub trait Operator {
    /// What is going on.
    ///
    /// # Errors
    /// It cannot be shown.
    fn show(&mut self, view: &View) -> Result<(), Error>;

    /// What is wished by now, if anything; never waits. `waits`: whether the walk waits for the person.
    fn wish(&mut self, waits: bool) -> Option<Wish>;

    /// Whether the person stays when the instrument is lost, until it is there again.
    fn stays(&self) -> bool {
        false
    }
}

/// What is to be measured, and how.
#[derive(Clone, Debug)]
pub struct Test {
    /// Instrument and bench.
    pub config: CampaignConfig,
    /// The positions, in order.
    pub dwells: Vec<Dwell>,
    /// How long the output has to be steady before a reading.
    pub settle: Duration,
    /// Length of a reading.
    pub dwell: Duration,
    /// Temperature of the instrument, degrees Celsius.
    pub temp_c: f64,
    /// The vibration whose error the test is for.
    pub environment: Environment,
    /// The test is enough when the standard uncertainty of the vibration error is this share of it.
    pub enough: Option<f64>,
}

/// How the instrument is reached.
pub trait Connection {
    /// The line to it.
    type Source: Source;

    /// Opens the line, also once more.
    ///
    /// # Errors
    /// It is not there.
    fn connect(&mut self) -> Result<Self::Source, Error>;

    /// The person is asked to turn the dial there: for an instrument whose dial turns by itself.
    fn turn(&mut self, _to: &Dwell) {}
}

/// What came of it.
#[derive(Clone, Debug)]
pub struct Attended {
    /// The readings, if there are any.
    pub campaign: Option<Campaign>,
    /// What was recorded and what was lost on the line since the last connection.
    pub tally: Tally,
    /// Positions without a reading.
    pub missing: usize,
}

/// Measures the positions of `test` that the record, which tells `ledger` by now, does not have, and writes record and tables
/// into `folder`. Every frame is in the record as it comes; the tables grow with each reading.
///
/// # Errors
/// [`Error::Link`] when the instrument is lost and the person does not stay; what the file system says.
pub fn measure<C: Connection>(
    connection: &mut C,
    test: &Test,
    folder: &Folder,
    ledger: Ledger,
    operator: &mut dyn Operator,
    interrupt: Option<&Interrupt>,
) -> Result<Attended, Error> {
    let link = Link::unrecorded(connection.connect()?)?;
    let recorder = Rc::new(RefCell::new(folder.begin(&test.config, ledger)?));
    capture::write_plan(&folder.plan(), &test.dwells)?;
    let mut session = Session::begin(link, connection, test, folder, recorder)?;
    let walked = session.go(operator, interrupt);
    let Session {
        link,
        recorder,
        walk,
        ..
    } = session;
    let tally = link.tally();
    drop(link);
    let closed = Rc::into_inner(recorder).map(|recorder| recorder.into_inner().finish());
    // A lost link matters more than what it left.
    walked?;
    let ledger = closed.transpose()?.unwrap_or_default();
    Ok(Attended {
        campaign: folder.write_tables(&test.config, &ledger)?,
        tally,
        missing: walk.stops().missing(),
    })
}

/// The conversation with the instrument while the walk goes on.
struct Session<'a, C: Connection> {
    link: Link<C::Source>,
    connection: &'a mut C,
    test: &'a Test,
    folder: &'a Folder,
    recorder: Rc<RefCell<Recorder>>,
    walk: Walk,
    begun: Instant,
    /// Time since the campaign's start when this capture began, s.
    offset_s: f64,
    /// Blocks of a reading.
    blocks: u32,
    /// What was lost before the reading that is under way.
    before: Tally,
    faults: u64,
    last_fault: Option<String>,
    turned: Option<Dwell>,
}

impl<'a, C: Connection> Session<'a, C> {
    fn begin(
        mut link: Link<C::Source>,
        connection: &'a mut C,
        test: &'a Test,
        folder: &'a Folder,
        recorder: Rc<RefCell<Recorder>>,
    ) -> Result<Self, Error> {
        link.record(&recorder)?;
        let identity = link.greet()?;
        let walk = walk(test, folder, &identity, &recorder.borrow())?;
        let began_ms = recorder.borrow().ledger().began_unix_ms();
        let since_ms = began_ms.map_or(0, |ms| capture::unix_ms().saturating_sub(ms));
        let mut session = Self {
            blocks: blocks(test.dwell, &identity),
            before: link.tally(),
            link,
            connection,
            test,
            folder,
            recorder,
            walk,
            begun: Instant::now(),
            offset_s: since_ms as f64 * 1e-3,
            faults: 0,
            last_fault: None,
            turned: None,
        };
        session.begin_check()?;
        Ok(session)
    }

    fn begin_check(&mut self) -> Result<(), Error> {
        let set_up = capture::set_up(&self.test.config);
        self.link.command(&Command::BeginCheck(set_up))
    }

    fn now_s(&self) -> f64 {
        self.offset_s + self.begun.elapsed().as_secs_f64()
    }

    /// Until the walk is over, or the instrument is lost and nobody stays.
    fn go(
        &mut self,
        operator: &mut dyn Operator,
        interrupt: Option<&Interrupt>,
    ) -> Result<(), Error> {
        let mut shown = None::<(Instant, State)>;
        loop {
            self.turn();
            let state = self.state();
            if shown.is_none_or(|(at, was)| was != state || at.elapsed() >= SHOW) {
                operator.show(&self.view())?;
                shown = Some((Instant::now(), state));
            }
            if interrupt.is_some_and(Interrupt::came) {
                self.walk.wish(Wish::Stop, self.now_s());
            } else if let Some(wish) = operator.wish(self.walk.waits()) {
                self.walk.wish(wish, self.now_s());
                shown = None;
            }
            self.walk.tick(self.now_s());
            let done = match self.orders() {
                Ok(true) => return operator.show(&self.view()),
                Ok(false) => self.hear(),
                Err(error) => Err(error),
            };
            match done {
                Err(error @ Error::Link { .. }) if operator.stays() => {
                    self.look_for(&error, operator, interrupt)?;
                }
                done => done?,
            }
        }
    }

    /// What is shown at once when it changes.
    fn state(&self) -> State {
        (discriminant(self.walk.phase()), self.walk.stops().at())
    }

    /// The dial of an instrument that turns it by itself.
    fn turn(&mut self) {
        let dwell = self.walk.stops().dwell().copied();
        if dwell != self.turned {
            self.turned = dwell;
            if let Some(dwell) = &self.turned {
                self.connection.turn(dwell);
            }
        }
    }

    fn view(&self) -> View {
        let counts = Counts::of(&self.link.tally(), self.faults, self.last_fault.clone());
        self.walk.view(self.now_s(), counts)
    }

    /// Takes what the instrument says.
    fn hear(&mut self) -> Result<(), Error> {
        let now_s = self.now_s();
        let Self {
            link,
            walk,
            faults,
            last_fault,
            ..
        } = self;
        link.take_each(&mut |event| match event {
            Event::Block(block) => walk.block(block, now_s),
            Event::Fault { fault, .. } => {
                *faults += 1;
                *last_fault = Some(format!("{fault:?}"));
            }
            _ => {}
        })
    }

    /// Does what the walk says; true when it is over.
    fn orders(&mut self) -> Result<bool, Error> {
        for order in self.walk.orders() {
            match order {
                Order::Begin { reading, dwell } => self.begin_reading(reading, &dwell)?,
                Order::End { reading } => self.end_reading(reading)?,
                Order::Abandon { .. } => self.link.command(&Command::StopPosition)?,
                Order::Withdraw { reading } => {
                    self.note(&Note::ReadingWithdrawn { reading })?;
                    self.write_tables()?;
                }
                Order::Remark { reading, text } => {
                    for text in pieces(&text) {
                        self.note(&Note::Remark { reading, text })?;
                    }
                    self.write_tables()?;
                }
                Order::Finish => {
                    self.conclude()?;
                    return Ok(true);
                }
            }
        }
        Ok(false)
    }

    fn note(&mut self, note: &Note<'_>) -> Result<(), Error> {
        self.recorder.borrow_mut().note(note)
    }

    fn begin_reading(&mut self, reading: u32, dwell: &Dwell) -> Result<(), Error> {
        let position = capture::position(reading, dwell);
        let note = Note::Reading(ReadingNote {
            position,
            time_s: self.now_s() + 0.5 * self.test.dwell.as_secs_f64(),
            temp_c: self.walk.temp_c(),
            blocks: self.blocks,
        });
        self.note(&note)?;
        self.before = self.link.tally();
        self.link.command(&Command::StartPosition(position))
    }

    fn end_reading(&mut self, reading: u32) -> Result<(), Error> {
        self.link.command(&Command::StopPosition)?;
        // The answer follows the last block.
        let (after, before) = (self.link.tally(), self.before);
        if (after.restarts, after.blocks.missing) != (before.restarts, before.blocks.missing) {
            self.walk
                .failed("the instrument was restarted or frames were lost");
            return Ok(());
        }
        self.note(&Note::ReadingTaken { reading })?;
        match self.write_tables()? {
            Some(campaign) => self.walk.whole(&campaign.readings),
            None => self.walk.failed("no block of the reading came"),
        }
        Ok(())
    }

    /// The tables of the readings that count.
    fn write_tables(&mut self) -> Result<Option<Campaign>, Error> {
        let recorder = self.recorder.borrow();
        self.folder
            .write_tables(&self.test.config, recorder.ledger())
    }

    /// The instrument's own self-check; the readings are there, with or without it.
    fn conclude(&mut self) -> Result<(), Error> {
        match self.link.command(&Command::Conclude) {
            Ok(()) => self.link.listen(CONCLUDING),
            // Too few readings for it.
            Err(_) => Ok(()),
        }
    }

    /// Waits for the instrument to be there again.
    fn look_for(
        &mut self,
        error: &Error,
        operator: &mut dyn Operator,
        interrupt: Option<&Interrupt>,
    ) -> Result<(), Error> {
        self.walk.lost(&error.to_string());
        let mut looked = None::<Instant>;
        loop {
            operator.show(&self.view())?;
            if interrupt.is_some_and(Interrupt::came) {
                self.walk.wish(Wish::Stop, self.now_s());
            } else if let Some(wish) = operator.wish(true) {
                self.walk.wish(wish, self.now_s());
            }
            if *self.walk.phase() == Phase::Over {
                return Ok(());
            }
            if looked.is_none_or(|at| at.elapsed() > LOOK_FOR) {
                let again = self.connection.connect().and_then(Link::unrecorded);
                match again.and_then(|link| self.reconnect(link)) {
                    Ok(()) => {
                        self.walk.found();
                        return Ok(());
                    }
                    Err(error) => self.walk.lost(&error.to_string()),
                }
                looked = Some(Instant::now());
            }
            std::thread::sleep(LOOK);
        }
    }

    fn reconnect(&mut self, mut link: Link<C::Source>) -> Result<(), Error> {
        link.record(&self.recorder)?;
        self.link = link;
        // A reading that is still open there is over. If none is, that is refused and as well.
        let _ = self.link.command(&Command::StopPosition);
        self.turned = None;
        self.begin_check()
    }
}

/// Blocks of a reading, at least four: a quarter each for its noise.
fn blocks(dwell: Duration, identity: &Identity) -> u32 {
    let block_s = f64::from(identity.block_samples) / identity.sample_rate_hz;
    (dwell.as_secs_f64() / block_s).round().max(4.0) as u32
}

fn walk(
    test: &Test,
    folder: &Folder,
    identity: &Identity,
    recorder: &Recorder,
) -> Result<Walk, Error> {
    let at_converter = identity.reference_v / f64::from(identity.gains[0]) / f64::from(1 << 23);
    let settings = Settings {
        settle_s: test.settle.as_secs_f64(),
        dwell_s: test.dwell.as_secs_f64(),
        blocks: blocks(test.dwell, identity),
        v_per_code: test.config.acquisition.front_end().output_v(at_converter),
        environment: test.environment.clone(),
        enough: test.enough,
    };
    let ledger = recorder.ledger();
    let next = ledger.next_reading();
    let config = test.config.clone();
    let mut walk = Walk::new(config, settings, &test.dwells, next, test.temp_c);
    if let Some(campaign) = folder.write_tables(&test.config, ledger)? {
        walk.take_over(&campaign.readings);
    }
    Ok(walk)
}
