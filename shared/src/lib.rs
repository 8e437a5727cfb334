//! What instrument and host agree on, `no_std`, without allocation, in `f32` and `f64`.
//!
//! A pendulous accelerometer measures the specific force along its input axis **IA**; the pendulum points
//! along the pendulous axis **PA** and turns about the output (hinge) axis **OA**. Its output is nearly, but
//! not quite, linear: [`model`] holds the metrological model of IEEE Std 1293, equation (1). Under vibration
//! the nonlinearity rectifies the shaking into a constant, the *vibration rectification error* (VRE).
//!
//! | module | subject | equations |
//! |---|---|---|
//! | [`model`] | coefficients, output for a specific force | (1) |
//! | [`vibration`] | what shakes the instrument: a sine, Gaussian noise, or anything by its moments | |
//! | [`rectification`] | the vibration error and its derivatives by the coefficients | (2)-(9) |
//! | [`tumble`] | the static test on a dividing head: series, dial angle, specific force | |
//! | [`identify`] | coefficients from dial readings, with rank, blind directions, covariance | (10)-(17) |
//! | [`channels`] | the converter's channels, and a block of samples | |
//! | [`moments`] | streaming, mergeable moments of the converter's codes | (2) |
//! | [`compensate`] | vibration error taken out on board | (1), (2) |
//! | [`plausibility`] | does the reference feel what the instrument feels | |
//! | [`stated_errors`] | uncertainty that no static test determines | |
//! | [`self_check`] | the instrument judges its own calibration | (1) |
//! | [`slope`] | measured vibration error by integration and line fit | |
//! | [`triad`] | three instruments on one body, with a dial or without | (1), (2) |
//! | [`wire`] | messages between instrument and host, and their framing | |
//!
//! Units: specific force and everything that the model's bracket adds up is in g, the standard
//! acceleration that the bench uses as its unit; output in V; angles in rad unless a name says otherwise.
//! Equation numbers are those of the source paper, N. Chernyak et al., as rebuilt in the doc comments.
#![no_std]

#[cfg(test)]
extern crate std;

pub mod channels;
pub mod compensate;
pub mod identify;
pub mod model;
pub mod moments;
pub mod plausibility;
pub mod rectification;
pub mod scalar;
pub mod self_check;
pub mod slope;
pub mod stated_errors;
pub mod triad;
pub mod tumble;
pub mod vibration;
pub mod wire;
