//! The application at the serial line: takes what comes, sends what there is, and never waits for either for ever.

use embassy_futures::select::{Either3, select3};
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
        hear(&mut self.receiver, app);
    }

    /// Sends the next frame; false when there is none. Meanwhile it hears whenever `called` is ready, so that no command
    /// waits for a frame. A line that does not take it in time costs the frame, which the host misses by its number, and
    /// is counted.
    pub async fn say(&mut self, app: &mut App<'_>, mut called: impl AsyncFnMut()) -> bool {
        let Self {
            receiver,
            sender,
            delay,
            frame,
        } = self;
        if !app.transmit(frame) {
            return false;
        }
        let hearing = async {
            loop {
                called().await;
                hear(receiver, app);
            }
        };
        let sent = select3(
            sender.write_all(frame.as_bytes()),
            delay.delay_us(WRITE_LIMIT_US),
            hearing,
        );
        match sent.await {
            Either3::First(Ok(())) => {}
            Either3::First(Err(_)) => count(&mut app.board().line_errors),
            Either3::Second(()) => count(&mut app.board().line_timeouts),
            Either3::Third(never) => never,
        }
        true
    }
}

fn hear(receiver: &mut (impl Read + ReadReady), app: &mut App<'_>) {
    let mut bytes = [0; BYTES];
    // At the most as often as the receiver's ring can have been filled: the loop ends whatever comes.
    for _ in 0..BYTES {
        match receiver.read_ready() {
            Ok(false) => return,
            Ok(true) => match receiver.read(&mut bytes) {
                Ok(count) => app.receive(bytes.get(..count).unwrap_or(&[])),
                Err(_) => count(&mut app.board().line_errors),
            },
            Err(_) => count(&mut app.board().line_errors),
        }
    }
}

fn count(counter: &mut u32) {
    *counter = counter.saturating_add(1);
}

#[cfg(test)]
mod tests {
    extern crate std;

    use core::convert::Infallible;
    use core::future::pending;
    use core::pin::pin;

    use embassy_futures::{block_on, poll_once};
    use embedded_io::{ErrorKind, ErrorType};
    use shared::wire::framing::Frame;
    use shared::wire::message::{Command, Identity};
    use shared::wire::version;
    use std::collections::VecDeque;
    use std::vec::Vec;

    use super::*;
    use crate::link::Queues;

    /// Bytes that have come, and errors among them.
    struct Port(VecDeque<Result<u8, ErrorKind>>);

    impl ErrorType for Port {
        type Error = ErrorKind;
    }

    impl ReadReady for Port {
        fn read_ready(&mut self) -> Result<bool, ErrorKind> {
            match self.0.front() {
                Some(&Err(error)) => {
                    self.0.pop_front();
                    Err(error)
                }
                some => Ok(some.is_some()),
            }
        }
    }

    impl Read for Port {
        fn read(&mut self, bytes: &mut [u8]) -> Result<usize, ErrorKind> {
            let mut count = 0;
            while let (Some(&Ok(byte)), Some(to)) = (self.0.front(), bytes.get_mut(count)) {
                *to = byte;
                self.0.pop_front();
                count += 1;
            }
            Ok(count)
        }
    }

    /// Takes bytes, or nothing for ever.
    struct Wire(Option<Vec<u8>>);

    impl ErrorType for Wire {
        type Error = Infallible;
    }

    impl Write for Wire {
        async fn write(&mut self, bytes: &[u8]) -> Result<usize, Infallible> {
            match &mut self.0 {
                Some(taken) => {
                    taken.extend(bytes);
                    Ok(bytes.len())
                }
                None => pending().await,
            }
        }

        async fn flush(&mut self) -> Result<(), Infallible> {
            Ok(())
        }
    }

    /// Time passes at once.
    struct Passes;

    impl DelayNs for Passes {
        async fn delay_ns(&mut self, _: u32) {}
    }

    /// Time stands still.
    struct Stands;

    impl DelayNs for Stands {
        async fn delay_ns(&mut self, _: u32) {
            pending().await
        }
    }

    const IDENTITY: Identity = Identity {
        minimum: version::MINIMUM,
        current: version::CURRENT,
        firmware: [0, 1, 0],
        serial: *b"123456789012",
        sample_rate_hz: 4000.0,
        reference_v: 1.2,
        gains: [1; 4],
        block_samples: 40,
    };

    fn hello() -> Vec<Result<u8, ErrorKind>> {
        let mut frame = Frame::new();
        let version = version::CURRENT;
        let command = Command::Hello { version };
        frame.encode(&command, 1).expect("a command fits");
        frame.as_bytes().iter().map(|byte| Ok(*byte)).collect()
    }

    #[test]
    fn a_line_that_takes_nothing_costs_the_frame_and_is_counted() {
        let mut queues = Queues::new();
        let (_, end) = queues.split();
        let mut app = App::new(IDENTITY, end);
        let mut line = Conversation::new(Port(hello().into()), Wire(None), Passes);
        line.hear(&mut app);
        // Its name, and what the board says of itself.
        for timeouts in 1..=2 {
            assert!(block_on(line.say(&mut app, pending)));
            assert_eq!(app.board().line_timeouts, timeouts);
        }
        assert!(!block_on(line.say(&mut app, pending)));
    }

    #[test]
    fn errors_of_the_line_are_counted_and_what_comes_around_them_is_heard() {
        let mut queues = Queues::new();
        let (_, end) = queues.split();
        let mut app = App::new(IDENTITY, end);
        let noise = [Err(ErrorKind::Other), Ok(7), Ok(0), Err(ErrorKind::Other)];
        let came = noise.into_iter().chain(hello());
        let mut line = Conversation::new(Port(came.collect()), Wire(Some(Vec::new())), Stands);
        line.hear(&mut app);
        assert_eq!(app.board().line_errors, 2);
        assert!(block_on(line.say(&mut app, pending)));
        assert!(line.sender.0.is_some_and(|taken| taken.len() > 30));
    }
    #[test]
    fn a_command_that_comes_while_a_frame_is_sent_is_heard_before_the_frame_ends() {
        let mut queues = Queues::new();
        let (mut acquisition, end) = queues.split();
        let mut app = App::new(IDENTITY, end);
        let mut line = Conversation::new(Port(hello().into()), Wire(None), Stands);
        line.hear(&mut app);
        assert!(acquisition.order().is_some() && acquisition.order().is_none());
        line.receiver.0.extend(hello());
        // The wire never ends: whoever is called but once waits for ever.
        let mut calls = 0;
        let mut sending = pin!(line.say(&mut app, async || {
            calls += 1;
            if calls > 1 {
                pending::<()>().await;
            }
        }));
        assert!(poll_once(sending.as_mut()).is_pending());
        assert!(acquisition.order().is_some());
    }
}
