//! The page of a walk: what [`crate::walk::View`] holds, drawn in a browser, and what the person wishes, back.
//!
//! One self-contained page without anything from outside; the state comes as server-sent events, a whole view each, so that a
//! page that is loaded anew or a second one shows the same at once. The server has a thread of its own and knows nothing of
//! instruments.

mod server;

use std::net::SocketAddr;
use std::sync::mpsc::{Receiver, channel};
use std::thread;
use std::time::Duration;

use serde::Serialize;
use tokio::sync::watch;

use crate::attended::Operator;
use crate::error::Error;
use crate::walk::{View, Wish};

/// How long the server stays when the test is over, so that every page has heard it.
const LAST_WORDS: Duration = Duration::from_secs(1);

/// A view with what the page has to know beside it.
#[derive(Serialize)]
struct Shown<'v> {
    folder: &'v str,
    watching: bool,
    #[serde(flatten)]
    view: &'v View,
}

/// The page while it is served.
#[derive(Debug)]
pub struct Page {
    folder: String,
    watching: bool,
    url: String,
    views: watch::Sender<String>,
    wishes: Receiver<Wish>,
}

impl Page {
    /// Serves the page at `listen` (port 0: any that is free). `folder` is what the person is told of where the campaign is.
    /// With `watching` nothing can be wished. Beyond the loopback interface a token is asked for, which stands in
    /// [`Self::url`].
    ///
    /// # Errors
    /// [`Error::Usage`] if the address is taken.
    pub fn serve(listen: SocketAddr, folder: &str, watching: bool) -> Result<Self, Error> {
        let taken = |error: std::io::Error| {
            Error::Usage(format!("--listen {listen}: cannot be served at: {error}"))
        };
        let listener = std::net::TcpListener::bind(listen).map_err(taken)?;
        listener.set_nonblocking(true).map_err(taken)?;
        let address = listener.local_addr().map_err(taken)?;
        let token = match address.ip().is_loopback() {
            true => None,
            false => Some(token()?),
        };
        let url = match &token {
            None => format!("http://{address}/"),
            Some(token) => format!("http://{address}/?token={token}"),
        };
        let (views, seen) = watch::channel(String::new());
        let (wish, wishes) = channel();
        let desk = server::Desk::new(seen, (!watching).then_some(wish), token);
        let runtime = tokio::runtime::Builder::new_current_thread()
            .enable_io()
            .enable_time()
            .build()
            .map_err(taken)?;
        thread::spawn(move || {
            // Ends with the program; a page that cannot be served is no reason to stop a measurement.
            let _ = runtime.block_on(server::serve(listener, desk));
        });
        Ok(Self {
            folder: folder.into(),
            watching,
            url,
            views,
            wishes,
        })
    }

    /// Where it is.
    pub fn url(&self) -> &str {
        &self.url
    }

    /// Waits until the pages have heard the last of it.
    pub fn close(self) {
        thread::sleep(LAST_WORDS);
    }
}

impl Operator for Page {
    fn show(&mut self, view: &View) -> Result<(), Error> {
        let shown = Shown {
            folder: &self.folder,
            watching: self.watching,
            view,
        };
        let text = serde_json::to_string(&shown)
            .map_err(|error| Error::write("the page".as_ref())(error.into()))?;
        self.views.send_replace(text);
        Ok(())
    }

    fn wish(&mut self, _waits: bool) -> Option<Wish> {
        self.wishes.try_recv().ok()
    }

    fn stays(&self) -> bool {
        true
    }
}

/// A hundred and twenty-eight random bits, in hexadecimal digits.
fn token() -> Result<String, Error> {
    let mut bytes = [0_u8; 16];
    getrandom::fill(&mut bytes)
        .map_err(|error| Error::Usage(format!("no random numbers for a token: {error}")))?;
    Ok(bytes.iter().map(|byte| format!("{byte:02x}")).collect())
}
