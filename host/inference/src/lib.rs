//! Which of several additions to a linear model a set of observations asks for.
//!
//! A *base* is linear in its unknowns. *Components* may act beside it: each adds to the observations, transforms the
//! base's own columns, or adds variance. A [`model::SeparableModel`] says what they predict; nothing here knows what they are.
//!
//! ```text
//! observations + model -> fit (one hypothesis) -> evidence -> search (all of them)
//!                          remainder, adequacy, profile, held_out, information, scales  look at what a fit says and leaves
//! ```
//!
//! Unknowns of the base and parameters in proportion are solved for exactly, the others by Gauss-Newton steps (variable
//! projection); a hypothesis counts by its marginal likelihood (Laplace).

pub mod adequacy;
pub mod dense;
pub mod evidence;
pub mod fit;
pub mod held_out;
pub mod information;
pub mod linear;
pub mod model;
pub mod modes;
mod normal;
pub mod observations;
pub mod outlier;
pub mod prior;
pub mod profile;
pub mod remainder;
pub mod scales;
pub mod search;
pub mod variance;
