//! Where the gap between prediction and shaker lies, which effect causes it, how far it shrinks.
//!
//! ```text
//! campaign -> problem (one whitened vector) -> fit (one hypothesis) -> search (all of them) -> diagnosis
//!                        catalogue (one entry an effect) -/      adequacy, locate, shrink, next_test -/
//! ```
//!
//! Nominal coefficients, dial, mount and level errors and the effects are estimated jointly: an effect also bends the
//! static identification, so that residuals of a fit without it would mislead.

mod adequacy;
pub mod blind;
pub mod catalogue;
mod closing;
mod compensation;
mod dense;
pub mod diagnosis;
pub mod fit;
mod forecast;
mod locate;
pub mod motion;
mod next_test;
mod parts;
pub mod problem;
pub mod published;
pub mod search;
mod shrink;
mod text;
pub mod visibility;

pub use compensation::{Compensation, WHY_NOT_CARRIED};
pub use diagnosis::{Diagnosis, Study, Verdict, diagnose};
pub use forecast::{predict_refitted, predict_with_effects};
pub use text::{headline, text};
