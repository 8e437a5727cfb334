//! A serial port.

use std::io::{self, Read};
use std::path::Path;
use std::time::Duration;

use serial2::SerialPort;

use super::Source;
use crate::error::Error;

/// Baud of the instrument's link, unless it is told otherwise.
pub const BAUD: u32 = 1_000_000;

/// How long a read waits for bytes.
const PATIENCE: Duration = Duration::from_millis(50);

/// How long a write waits for room.
const WRITE_PATIENCE: Duration = Duration::from_secs(1);

/// An instrument behind a serial port.
#[derive(Debug)]
pub struct SerialSource {
    name: String,
    port: SerialPort,
}

impl SerialSource {
    /// Opens a port at so many baud, eight bits without parity, and throws away what came before.
    ///
    /// # Errors
    /// [`Error::Usage`], since it is the port that was asked for.
    pub fn open(device: &Path, baud: u32) -> Result<Self, Error> {
        let name = device.display().to_string();
        let port = SerialPort::open(device, baud).and_then(|mut port| {
            port.set_read_timeout(PATIENCE)?;
            port.set_write_timeout(WRITE_PATIENCE)?;
            port.discard_input_buffer()?;
            Ok(port)
        });
        match port {
            Ok(port) => Ok(Self { name, port }),
            Err(error) => Err(Error::Usage(format!(
                "--port {name}: cannot be opened: {error}"
            ))),
        }
    }
}

impl Read for SerialSource {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        self.port.read(buffer)
    }
}

impl Source for SerialSource {
    fn name(&self) -> String {
        self.name.clone()
    }

    fn send(&mut self, frame: &[u8]) -> io::Result<()> {
        self.port.write_all(frame)
    }
}
