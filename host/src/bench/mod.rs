//! The virtual bench, in the time domain: a dividing head, a shaker, an accelerometer with its errors, and what
//! the nominal model does not know of them.
//!
//! ```text
//! plan -> dial ------------------\
//!      -> shaker -> chain (table, fixture, instrument, converter) -> simulate -> campaign, truth
//!                       \-> reference                            \-> signal  -> converter -> firmware
//! ```
//!
//! The parts err as real ones do ([`dial`], [`noise`], [`environment`]); [`effects`] holds what a model leaves
//! out, [`imperfections`] what persons and devices do that a campaign does not state. Nothing here knows the averaged formulas that the rest of the project tests itself with: a plateau's
//! mean is the mean of its waveform.

pub mod accelerometer;
pub mod board;
pub mod chain;
pub mod converter;
pub mod devices;
pub mod dial;
pub mod effects;
#[cfg(feature = "emulated")]
pub mod emulated;
pub mod environment;
pub mod excitation;
pub mod flash;
pub mod imperfections;
pub mod noise;
pub mod plan;
pub mod plant;
pub mod reference;
pub mod shaker;
pub mod simulate;
