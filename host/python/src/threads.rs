//! The threads that work. A process that was forked has none of its parent's, and what is handed to those is never done.

use std::sync::{Arc, Mutex, PoisonError};

use host::error::Error;
use rayon::{ThreadPool, ThreadPoolBuilder};

use crate::failure::usage;

/// The threads, and the process that they belong to.
static OWN: Mutex<Option<(u32, Arc<ThreadPool>)>> = Mutex::new(None);

/// The threads of this process, as many as there are cores.
///
/// # Errors
/// The system gives none.
pub fn own() -> Result<Arc<ThreadPool>, Error> {
    let mut held = OWN.lock().unwrap_or_else(PoisonError::into_inner);
    let process = std::process::id();
    if let Some((of, threads)) = &*held
        && *of == process
    {
        return Ok(Arc::clone(threads));
    }
    let threads = Arc::new(ThreadPoolBuilder::new().build().map_err(usage)?);
    let parents = held.replace((process, Arc::clone(&threads)));
    // To end the parent's would be to wait for threads that are not here.
    std::mem::forget(parents);
    Ok(threads)
}
