//! Effects that the nominal model leaves out, each acting where it does in the real chain.
//!
//! An effect changes one link: an angle, a waveform, a motion inside the instrument, a slow state, a code.
//! None knows what its average will be: plateau means, drifts and extremes come out of the waveforms. Each
//! link of [`Effect`] does nothing unless an effect overrides it; adding one is a type here and a line in
//! [`catalogue`].

mod acquisition;
mod dynamics;
mod environment;
mod fixture;
mod head;
mod others;
mod shaker;
mod statics;

use realfft::num_complex::Complex64;

use super::environment::Moment;
use super::noise::Stream;
use super::plan::Dwell;

/// A stretch of samples inside the instrument.
#[derive(Clone, Copy, Debug)]
pub struct Block<'a> {
    /// Specific force on IA, PA, OA, g.
    pub force_g: [&'a [f64]; 3],
    /// Vibration along the direction of motion, g.
    pub vibration_g: &'a [f64],
    /// The same behind this effect's own [`Effect::response`]; empty without one.
    pub state: &'a [f64],
    /// Components of the direction of motion on IA, PA, OA.
    pub direction: [f64; 3],
    /// Temperature less the reference temperature, K.
    pub excess_k: f64,
}

/// What the logger makes its plateau mean of: the instrument's vibration along IA over one run.
#[derive(Clone, Copy, Debug)]
pub struct Plateau<'a> {
    /// Vibration along IA, g, over one period of the record.
    pub vibration_i_g: &'a [f64],
    /// Frequency of the record's period, Hz.
    pub fundamental_hz: f64,
    /// Length of the plateau, s.
    pub duration_s: f64,
    /// The logger's rate, Hz.
    pub logger_rate_hz: f64,
}

/// Something real that the nominal model does not know.
pub trait Effect: Send + Sync {
    /// Its identifier, as on the command line and in reports.
    fn id(&self) -> &'static str;

    /// Its parameters by name, with the unit at the end of the name.
    fn parameters(&self) -> Vec<(&'static str, f64)>;

    /// Error of the instrument's angle on the head, rad.
    fn dial_error_rad(&self, _dwell: &Dwell) -> f64 {
        0.0
    }

    /// Tilts of the base, rad: of the dial's zero, of the axis of rotation.
    fn base_tilt_rad(&self) -> [f64; 2] {
        [0.0; 2]
    }

    /// Bends the table's motion along the drive, samples in g, of the given rms value.
    fn drive(&self, _samples_g: &mut [f64], _rms_g: f64) {}

    /// Turns the direction of the table's motion; the result need not be a unit vector.
    fn direction(&self, direction: [f64; 3]) -> [f64; 3] {
        direction
    }

    /// True motion of the table over what command and reference say.
    fn motion_scale(&self) -> f64 {
        1.0
    }

    /// Frequency response from the table to the instrument; the reference does not see it.
    fn fixture(&self, _frequency_hz: f64) -> Option<Complex64> {
        None
    }

    /// Frequency response from the vibration to an inner state of this effect's own.
    fn response(&self, _frequency_hz: f64) -> Option<Complex64> {
        None
    }

    /// Adds to the specific force on IA, g, before the instrument senses it; `state` is this effect's own, as
    /// in [`Block::state`].
    fn force_i(&self, _state: &[f64], _force_i_g: &mut [f64]) {}

    /// Adds to the instrument's output u = U/K1, g.
    fn output(&self, _block: &Block<'_>, _output_g: &mut [f64]) {}

    /// Limits the output, g, after everything has been added.
    fn limit(&self, _output_g: &mut [f64]) {}

    /// Bends what the converter makes of the output, g.
    fn convert(&self, _output_g: &mut [f64]) {}

    /// Slow shift of the output at a moment, g.
    fn shift_g(&self, _moment: &Moment<'_>) -> f64 {
        0.0
    }

    /// Factor on the instrument's scale factor, less 1.
    fn scale_error(&self, _moment: &Moment<'_>) -> f64 {
        0.0
    }

    /// What the logger's mean over the plateau is off by, g.
    fn plateau_error_g(&self, _plateau: &Plateau<'_>, _stream: &mut Stream) -> f64 {
        0.0
    }
}

/// How an effect of the catalogue is made.
pub struct Entry {
    /// Identifier.
    pub id: &'static str,
    /// Whether the diagnosis's published catalogue names it.
    pub catalogued: bool,
    /// Draws an effect whose size is `strength` times a typical one; what is not a size (a frequency, a time
    /// constant, a phase) comes from the stream.
    pub draw: fn(strength: f64, stream: &mut Stream) -> Box<dyn Effect>,
}

/// Every effect that the bench can make.
pub fn catalogue() -> impl Iterator<Item = &'static Entry> {
    [
        statics::ENTRIES,
        dynamics::ENTRIES,
        fixture::ENTRIES,
        head::ENTRIES,
        shaker::ENTRIES,
        environment::ENTRIES,
        acquisition::ENTRIES,
        others::ENTRIES,
    ]
    .into_iter()
    .flatten()
}

/// The entry of that identifier.
pub fn find(id: &str) -> Option<&'static Entry> {
    catalogue().find(|entry| entry.id == id)
}
