//! The application at the serial line: takes what comes, sends what there is, and never waits for either for ever.

use embassy_futures::select::{Either, select};
use embedded_hal_async::delay::DelayNs;
use embedded_io::{Read, ReadReady};
use embedded_io_async::Write;
use shared::wire::framing::Frame;

use crate::app::App;

/// How long a frame may take: ten times what the longest takes at 1 Mbaud.
pub const WRITE_LIMIT_US: u32 = 100_000;

/// Bytes taken at once.
const BYTES: usize = 64;

/// A serial line and what it carries.
pub struct Conversation<RX, TX, DELAY> {
    receiver: RX,
    sender: TX,
    delay: DELAY,
    frame: Frame,
}

impl<RX: Read + ReadReady, TX: Write, DELAY: DelayNs> Conversation<RX, TX, DELAY> {
    /// Over this line.
    pub fn new(receiver: RX, sender: TX, delay: DELAY) -> Self {
        Self {
            receiver,
            sender,
            delay,
            frame: Frame::new(),
        }
    }

    /// Takes all that has come. Bytes that the line spoilt are counted; the frame that they fall into is rejected by its
    /// checksum.
    pub fn hear(&mut self, app: &mut App<'_>) {
        let mut bytes = [0; BYTES];
        // At the most as often as the receiver's ring can have been filled: the loop ends whatever comes.
        for _ in 0..BYTES {
            match self.receiver.read_ready() {
                Ok(false) => return,
                Ok(true) => match self.receiver.read(&mut bytes) {
                    Ok(count) => app.receive(bytes.get(..count).unwrap_or(&[])),
                    Err(_) => count(&mut app.board().line_errors),
                },
                Err(_) => count(&mut app.board().line_errors),
            }
        }
    }

    /// Sends the next frame; false when there is none. A line that does not take it in time costs the frame, which the
    /// host misses by its number, and is counted.
    pub async fn say(&mut self, app: &mut App<'_>) -> bool {
        if !app.transmit(&mut self.frame) {
            return false;
        }
        let sent = select(
            self.sender.write_all(self.frame.as_bytes()),
            self.delay.delay_us(WRITE_LIMIT_US),
        );
        match sent.await {
            Either::First(Ok(())) => {}
            Either::First(Err(_)) => count(&mut app.board().line_errors),
            Either::Second(()) => count(&mut app.board().line_timeouts),
        }
        true
    }
}

fn count(counter: &mut u32) {
    *counter = counter.saturating_add(1);
}
