//! What the terminal and the guide explain, from the data that the code works with: files, columns, keys, effects, verdicts,
//! units.

mod guide;
mod page;
mod parameters;
mod topics;

pub use guide::pages;
pub use page::{Entry, Page, Part};
pub use parameters::in_words;
pub use topics::{Topic, effect, effects};
