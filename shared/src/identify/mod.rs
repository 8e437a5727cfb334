//! Coefficients of the output model from readings at known specific forces.
//!
//! Twice: [`closed_form`], the paper's (10)-(17) for its own 24 positions, and weighted least squares for any
//! positions, absorbed row by row into a triangular factor ([`square_root`]), where dial, mount and level are
//! random effects with a stated standard deviation ([`static_test`]). [`blindness`] tells what a plan cannot
//! see.
//!
//! Identification works at 1e-7 of a reading and needs `f64`; the tests show what `f32` would lose.

pub mod blindness;
pub mod closed_form;
pub mod square_root;
pub mod static_test;
