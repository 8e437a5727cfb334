//! `vre watch`

use std::net::SocketAddr;
use std::path::PathBuf;
use std::thread;
use std::time::Duration;

use super::plan::Vibration;
use super::{Command, Console};
use crate::attended::Operator;
use crate::error::Error;
use crate::follow::Follower;
use crate::interrupt::Interrupt;
use crate::page::Page;

/// How often the record is looked at.
const LOOK: Duration = Duration::from_millis(200);

/// Show a record on a page, while it grows or afterwards; Ctrl-C ends it
#[derive(clap::Args)]
#[command(after_help = "Example:
  vre watch campaigns/S01000")]
pub struct Watch {
    /// A record, or the folder of a capture
    record: PathBuf,
    /// Serve the page at ADDRESS:PORT; port 0 is any that is free
    #[arg(long, value_name = "ADDRESS:PORT", default_value = "127.0.0.1:0")]
    listen: SocketAddr,
    /// The vibration along IA whose error is shown, `sine:` peak or `random:` rms in g
    #[arg(long, value_name = "KIND:LEVEL", default_value = "random:1")]
    vibration: Vibration,
}

impl Command for Watch {
    fn run(self, console: &Console) -> Result<(), Error> {
        let interrupt = Interrupt::catch()?;
        let environment = self.vibration.environment(&[1.0, 0.0, 0.0], 0.0);
        let mut follower = Follower::open(&self.record, environment)?;
        // What is wrong with the record is told before anybody opens a page.
        let mut view = follower.look()?;
        let folder = follower.folder().display().to_string();
        let mut page = Page::serve(self.listen, &folder, true)?;
        console.print(format!("the page is at {}", page.url()))?;
        while !interrupt.came() {
            if let Some(view) = &view {
                page.show(view)?;
            }
            thread::sleep(LOOK);
            view = follower.look()?;
        }
        Ok(())
    }
}
