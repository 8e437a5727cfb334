//! A dividing head's marks, calibrated by the instruments that were tested on it.
//!
//! The errors of the marks belong to the head: every instrument that was ever tested on it has measured them. For
//! instrument i with coefficients c_i, drawn from its type (mean mu, spread T), and errors d of the marks
//!
//! ```text
//! y_i = H_i c_i + J_i d + mounts, level, noise
//! ```
//!
//! Given d everything of an instrument is linear: what it tells of (mu, d) is a quadratic form, and the forms of a batch
//! add up in any order.
//!
//! ```text
//! campaign -> reduced -> batch (sums) -> posterior (type, marks) -> harmonics, changes, head.toml
//!                                              head.toml + campaign -> known: the campaign beside what is known of its head
//! plan of positions -> reduced -> batch -> outlook
//! ```

pub mod batch;
pub mod changes;
pub mod file;
mod form;
pub mod harmonics;
pub mod known;
pub mod outlook;
pub mod posterior;
pub mod reduced;
pub mod teaching;

pub use batch::{Batch, DEFAULT_SPREAD, TYPE, settle};
pub use file::HeadFile;
pub use harmonics::{Harmonic, harmonics};
pub use known::{Known, known};
pub use posterior::{Posterior, Prior};
pub use reduced::Reduced;
