//! Ctrl-C and the system's request to end: what is under way is put in order first.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use signal_hook::consts::{SIGINT, SIGTERM};
use signal_hook::flag;

use crate::error::Error;

/// Whether the program was asked to end. A second request ends it at once.
#[derive(Clone, Debug)]
pub struct Interrupt(Arc<AtomicBool>);

impl Interrupt {
    /// From here on requests are noticed, instead of ending the program.
    ///
    /// # Errors
    /// What the operating system says.
    pub fn catch() -> Result<Self, Error> {
        let came = Arc::new(AtomicBool::new(false));
        for signal in [SIGINT, SIGTERM] {
            // Registered in this order: the second request finds the first one's mark.
            flag::register_conditional_shutdown(signal, 1, Arc::clone(&came))
                .and_then(|_| flag::register(signal, Arc::clone(&came)))
                .map_err(|error| Error::Usage(format!("signals cannot be caught: {error}")))?;
        }
        Ok(Self(came))
    }

    /// Whether a request came.
    pub fn came(&self) -> bool {
        self.0.load(Ordering::Relaxed)
    }
}
