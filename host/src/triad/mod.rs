//! A triad: three instruments on one body, held by hand if need be.
//!
//! ```text
//! record of a session -> rests -> positions.csv
//! campaign -> start -> fit (scatter, leave_out) -> answer, prediction, planning -> text, page
//! session: the virtual bench, in the time domain
//! ```

pub mod answer;
pub mod coverage;
pub mod diagnosis;
pub mod fit;
pub mod leave_out;
pub mod observations;
pub mod planning;
pub mod prediction;
pub mod rests;
pub mod session;
pub mod start;
pub mod text;

pub use answer::{TriadIdentification, identify};
pub use fit::{Fitted, fit};
pub use prediction::{TriadPrediction, predict};
