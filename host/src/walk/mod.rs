//! The walk through a static test: where the dial goes next, when the output has settled, how long it is read, whether the
//! reading fits, what the coefficients and the vibration error are by now, and when that is enough.
//!
//! Pure: it is told what the person wishes ([`Wish`]), what the instrument says and what time it is, and answers with what is
//! to be done ([`Order`]) and what is to be shown ([`View`]). The terminal and the page walk by it alike.
//!
//! ```text
//!   place --measure--> settle --steady--> read --whole--> judge --> place (the next stop)
//!     ^                   |                 |
//!     +-- pause, skip, redo, a lost cable --+
//! ```

mod estimate;
mod expectation;
mod live;
mod machine;
mod stops;
mod view;

pub use estimate::{Estimate, Judgement, RED};
pub use live::Live;
pub use machine::{Order, Phase, Settings, Walk, Wish};
pub use stops::{StopState, Stops};
pub use view::{Counts, ReadingView, StopView, View, VreView};
