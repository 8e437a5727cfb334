//! What a reading or a run does to an instrument, by its conditions alone: no output is seen here.
//!
//! ```text
//! conditions -> motion (what the instrument feels) -> time means over it -> contributions to the observables
//! ```

pub mod band;
pub mod conditions;
pub mod contribution;
mod distorted_sine;
pub mod finite_record;
pub mod motion;
pub mod nominal;
mod quadrature;
pub mod rows;
pub mod time_mean;
