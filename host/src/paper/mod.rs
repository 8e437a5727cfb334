//! The source paper's published tables beside what its own equation (9) makes of them.
//!
//! N. Chernyak et al., identification of the vibration error of a navigation accelerometer in its static tests.

pub mod comparison;
pub mod tables;

pub use comparison::{Comparison, Implied, Weights, compare, weights};
pub use tables::{Published, TABLES};
