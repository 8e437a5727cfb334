//! Running the image, a stretch of virtual time after the other.

use std::collections::BTreeMap;
use std::num::NonZeroU64;
use std::ops::Range;
use std::path::Path;
use std::sync::mpsc::{Receiver, Sender, channel};
use std::sync::{Arc, Mutex, MutexGuard};
use std::thread::{self, JoinHandle};
use std::time::Duration;

use rigless::emulator::{Access, AccessKind, Driver, Host, Settled, Start, Stop, Watch, run};
use rigless::image::Image;
use rigless::session::Session;
use rigless::snapshot::Store;
use rigless::soc::Width;
use rigless::time::VirtualNanos;

use crate::board::{INSTRUCTIONS_PER_SECOND, Nucleo, Shared, lock};
use crate::converter::Converter;
use crate::image::{self, Rate};
use crate::line::Line;
use crate::part::Model;

/// Why the emulated board does not run, or not on.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// No image.
    #[error(transparent)]
    Image(#[from] image::Error),
    /// The image cannot be placed in the microcontroller's memory.
    #[error("placing the image: {0}")]
    Place(#[from] rigless::image::Error),
    /// The board's description is wrong.
    #[error("the emulated board: {0}")]
    Board(#[from] rigless::soc::Error),
    /// The emulator refuses to start.
    #[error("the emulator: {0}")]
    Session(#[from] rigless::emulator::Error),
    /// The emulator ended; its own words.
    #[error("the emulator ended: {0}")]
    Ended(String),
}

/// What is done between two instructions, with the whole board at hand.
pub type Intervention = Box<dyn FnOnce(&mut Session<Nucleo>, &mut dyn Host, Stop) + Send>;

enum Request {
    /// Run until this instant, nanoseconds.
    Until(u64),
    /// Do this now.
    Do(Intervention),
}

/// The emulated board, standing still between two calls.
#[derive(Debug)]
pub struct Emulator {
    model: Model,
    converter: Shared<dyn Converter>,
    line: Shared<Line>,
    requests: Option<Sender<Request>>,
    stops: Receiver<Stop>,
    core: Option<JoinHandle<Result<(), String>>>,
    stop: Stop,
    executed: Shared<BTreeMap<u64, u64>>,
}

impl Emulator {
    /// Powers the board with the image on its flash and the given converter on its bus.
    pub fn start(converter: impl Converter + 'static) -> Result<Self, Error> {
        Self::start_image(converter, &image::path()?)
    }

    /// The same of that board, with these bytes in the flash of the instrument's memory.
    pub fn start_model(
        model: Model,
        converter: impl Converter + 'static,
        memory: Option<Vec<u8>>,
    ) -> Result<Self, Error> {
        let mut images = vec![Image::read(&image::path_of(model, Rate::X1024)?, None)?];
        if let Some(memory) = memory {
            images.push(Image::new(
                Path::new("memory"),
                memory,
                Some(model.memory()),
            )?);
        }
        Self::with_images(model, converter, &images, INSTRUCTIONS_PER_SECOND)
    }

    /// The same with another image.
    pub fn start_image(converter: impl Converter + 'static, image: &Path) -> Result<Self, Error> {
        let image = Image::read(image, None)?;
        Self::with_images(Model::F429, converter, &[image], INSTRUCTIONS_PER_SECOND)
    }

    /// The same with these bytes in the flash of the instrument's memory.
    pub fn start_with_memory(
        converter: impl Converter + 'static,
        memory: Vec<u8>,
    ) -> Result<Self, Error> {
        Self::start_model(Model::F429, converter, Some(memory))
    }

    /// The same of that board at a rate, with a processor of another speed.
    pub fn start_model_at(
        model: Model,
        converter: impl Converter + 'static,
        rate: Rate,
        instructions_per_second: NonZeroU64,
    ) -> Result<Self, Error> {
        let image = Image::read(&image::path_of(model, rate)?, None)?;
        Self::with_images(model, converter, &[image], instructions_per_second)
    }

    /// The same with the image of another rate and a processor of another speed.
    pub fn start_with_speed(
        converter: impl Converter + 'static,
        rate: Rate,
        instructions_per_second: NonZeroU64,
    ) -> Result<Self, Error> {
        Self::start_model_at(Model::F429, converter, rate, instructions_per_second)
    }

    fn with_images(
        model: Model,
        converter: impl Converter + 'static,
        images: &[Image],
        instructions_per_second: NonZeroU64,
    ) -> Result<Self, Error> {
        let converter: Shared<dyn Converter> = Arc::new(Mutex::new(converter));
        let line = Arc::new(Mutex::new(Line::default()));
        let board = Nucleo::new(
            model,
            converter.clone(),
            line.clone(),
            instructions_per_second,
        )?;
        let session = Session::new(Box::new(board), 0, VirtualNanos(1))?;
        let (requests, to_core) = channel();
        let (from_core, stops) = channel();
        let images = images.to_vec();
        let executed = Shared::default();
        let count = Arc::clone(&executed);
        let core = thread::Builder::new()
            .name("emulated board".into())
            .spawn(move || {
                let governor = Governor {
                    watched: model.watched(),
                    until: 0,
                    requests: to_core,
                    stops: from_core,
                    executed: count,
                };
                match run(session, &Start::new(&images), governor) {
                    Ok(_) => Ok(()),
                    Err(error) => Err(error.to_string()),
                }
            })
            .map_err(|error| Error::Ended(error.to_string()))?;
        let mut emulator = Self {
            model,
            converter,
            line,
            requests: Some(requests),
            stops,
            core: Some(core),
            executed,
            stop: Stop {
                at: VirtualNanos(0),
                instruction_count: 0,
                reason: rigless::emulator::StopReason::Deadline,
            },
        };
        emulator.wait()?;
        Ok(emulator)
    }

    /// Lets the firmware run for this long.
    pub fn run_for(&mut self, time: Duration) -> Result<(), Error> {
        let nanoseconds = u64::try_from(time.as_nanos()).unwrap_or(u64::MAX);
        self.request(Request::Until(self.stop.at.0.saturating_add(nanoseconds)))
    }

    /// Does something between two instructions.
    pub fn intervene(
        &mut self,
        what: impl FnOnce(&mut Session<Nucleo>, &mut dyn Host, Stop) + Send + 'static,
    ) -> Result<(), Error> {
        self.request(Request::Do(Box::new(what)))
    }

    /// Lets the firmware run for this long and counts how often each instruction is executed. Slow: some hundred thousand
    /// instructions a second.
    pub fn trace(&mut self, time: Duration) -> Result<BTreeMap<u64, u64>, Error> {
        // An instruction begins at every even address, or at none that is ever reached.
        let everywhere = || CODE.step_by(2).map(Watch::Instruction);
        self.intervene(move |_, host, _| {
            everywhere().for_each(|watch| {
                host.watch(watch);
            });
        })?;
        lock(&self.executed).clear();
        self.run_for(time)?;
        self.intervene(move |_, host, _| everywhere().for_each(|watch| host.unwatch(watch)))?;
        Ok(std::mem::take(&mut lock(&self.executed)))
    }

    /// Bytes of stack that have been used at some time: down to where the start-up code's paint is whole.
    pub fn stack_used(&mut self) -> Result<u64, Error> {
        let (to, from) = channel();
        let stack = self.model.stack();
        self.intervene(move |_, host, _| {
            let words = stack.step_by(4).map(|a| host.read(a, Width::W32).ok());
            let words: Vec<_> = words.collect();
            // What lies between variables and stack is by far the longest stretch of paint.
            let mut rest = words.len() as u64;
            let mut free = (0, rest);
            for stretch in words.chunk_by(|a, b| a == b) {
                rest -= stretch.len() as u64;
                if stretch[0] == Some(PAINT) {
                    free = free.max((stretch.len() as u64, rest));
                }
            }
            // Nobody stopped listening: this is called in between.
            let _ = to.send(4 * free.1);
        })?;
        from.recv().map_err(|_| self.ended())
    }

    /// Presses the reset button.
    pub fn reset(&mut self) -> Result<(), Error> {
        self.intervene(|session, host, stop| {
            session.reset_by_pin(stop.at, stop.instruction_count, host);
        })
    }

    /// Writes a word on the bus of the microcontroller, as a debugger does.
    pub fn write_word(&mut self, address: u64, value: u32) -> Result<(), Error> {
        self.intervene(move |session, host, stop| {
            let (kind, value) = (AccessKind::Write, u64::from(value));
            let mut access = Access::new(kind, address, Width::W32, value);
            access.virtual_time = stop.at;
            access.instruction_count = stop.instruction_count;
            session.access(access, host);
        })
    }

    /// Reads a word on the bus of the microcontroller, as a debugger does.
    pub fn read_word(&mut self, address: u64) -> Result<u32, Error> {
        let (to, from) = channel();
        self.intervene(move |session, host, stop| {
            let mut access = Access::new(AccessKind::Read, address, Width::W32, 0);
            access.virtual_time = stop.at;
            access.instruction_count = stop.instruction_count;
            let (word, _) = session.access(access, host);
            // Nobody stopped listening: this is called in between.
            let _ = to.send(word as u32);
        })?;
        from.recv().map_err(|_| self.ended())
    }

    /// So many bytes of the instrument's memory, from its beginning.
    pub fn memory(&mut self, bytes: u64) -> Result<Vec<u8>, Error> {
        let (to, from) = channel();
        let begin = self.model.memory();
        self.intervene(move |_, host, _| {
            let words = (begin..begin + bytes).step_by(4);
            let words = words.map(|a| host.read(a, Width::W32).unwrap_or(0) as u32);
            let _ = to.send(words.flat_map(u32::to_le_bytes).collect());
        })?;
        from.recv().map_err(|_| self.ended())
    }

    /// Reads a word of memory.
    pub fn read_memory(&mut self, address: u64) -> Result<u32, Error> {
        let (to, from) = channel();
        self.intervene(move |_, host, _| {
            let _ = to.send(host.read(address, Width::W32).unwrap_or(0) as u32);
        })?;
        from.recv().map_err(|_| self.ended())
    }

    /// Writes a word of memory.
    pub fn write_memory(&mut self, address: u64, value: u32) -> Result<(), Error> {
        self.intervene(move |_, host, _| {
            // Every address is one of memory.
            let _ = host.write(address, Width::W32, value.into());
        })
    }

    /// The converter, for looking and for faults.
    pub fn converter(&self) -> MutexGuard<'_, dyn Converter + 'static> {
        lock(&self.converter)
    }

    /// Puts bytes on the line to the board; they go at the line's speed.
    pub fn send(&self, bytes: &[u8]) {
        lock(&self.line).to_board.extend(bytes);
    }

    /// The line, for its noise.
    pub fn line(&self) -> MutexGuard<'_, Line> {
        lock(&self.line)
    }

    /// Fetches the bytes that came from the board.
    pub fn received(&self) -> Vec<u8> {
        std::mem::take(&mut lock(&self.line).from_board)
    }

    /// Virtual time since power came on.
    pub fn now(&self) -> Duration {
        Duration::from_nanos(self.stop.at.0)
    }

    /// Instructions since power came on; waiting for an interrupt takes none.
    pub fn instructions(&self) -> u64 {
        self.stop.instruction_count
    }

    fn request(&mut self, request: Request) -> Result<(), Error> {
        let sent = self.requests.as_ref().map(|to| to.send(request));
        match sent {
            Some(Ok(())) => self.wait(),
            _ => Err(self.ended()),
        }
    }

    fn wait(&mut self) -> Result<(), Error> {
        match self.stops.recv() {
            Ok(stop) => {
                self.stop = stop;
                Ok(())
            }
            Err(_) => Err(self.ended()),
        }
    }

    fn ended(&mut self) -> Error {
        let why = match self.core.take().map(JoinHandle::join) {
            None | Some(Ok(Ok(()))) => String::from("no more requests"),
            Some(Ok(Err(error))) => error,
            Some(Err(_)) => String::from("its thread panicked"),
        };
        Error::Ended(why)
    }
}

impl Drop for Emulator {
    fn drop(&mut self) {
        self.requests = None;
        if let Some(core) = self.core.take() {
            // Whatever ended it was told to the caller that met it.
            let _ = core.join();
        }
    }
}

/// Where the image's instructions are: as far as its budget of flash goes.
const CODE: Range<u64> = 0x0800_0000..0x0800_0000 + image::FLASH_BUDGET;

/// What the start-up code paints the stack with.
const PAINT: u64 = 0xCCCC_CCCC;

/// Lets the core run from one event of the converter to the next, and stops it where the test wants it.
struct Governor {
    /// Registers whose accesses move the converter's pins.
    watched: [Range<u64>; 2],
    until: u64,
    requests: Receiver<Request>,
    stops: Sender<Stop>,
    /// How often each watched instruction was executed.
    executed: Shared<BTreeMap<u64, u64>>,
}

impl Store for Governor {}

impl Driver<Nucleo> for Governor {
    fn on_settled(&mut self, session: &mut Session<Nucleo>, _: &mut dyn Host, settled: Settled) {
        if let Settled::Access { access, .. } = settled
            && self
                .watched
                .iter()
                .any(|range| range.contains(&access.address))
        {
            session.board_mut().settle(access.virtual_time);
        }
        session.board_mut().settle_clock();
        if let Settled::Hit(hit) = settled {
            *lock(&self.executed).entry(hit.address).or_default() += 1;
        }
    }

    fn on_stop(
        &mut self,
        session: &mut Session<Nucleo>,
        stop: Stop,
        host: &mut dyn Host,
    ) -> Option<VirtualNanos> {
        session.board_mut().settle(stop.at);
        while stop.at.0 >= self.until {
            self.stops.send(stop).ok()?;
            match self.requests.recv().ok()? {
                Request::Until(until) => self.until = until,
                Request::Do(what) => what(session, host, stop),
            }
        }
        let event = lock(&session.board().converter).next_event_ns();
        Some(VirtualNanos(event.clamp(stop.at.0 + 1, self.until)))
    }
}
