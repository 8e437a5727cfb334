//! The protocol's version.
//!
//! [`message`](super::message) may only grow at its end; growing it raises [`CURRENT`]. [`MINIMUM`] rises
//! only when an old peer can no longer be understood, and with it the golden bytes of that version go.

use serde::{Deserialize, Serialize};

/// Version of the protocol. The first byte of every frame is the version that its message came with.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
pub struct Version(pub u8);

/// The oldest version that this code understands.
pub const MINIMUM: Version = Version(1);

/// The version that this code speaks.
pub const CURRENT: Version = Version(2);

impl Version {
    /// True for a version from [`MINIMUM`] to [`CURRENT`].
    pub fn is_understood(self) -> bool {
        (MINIMUM..=CURRENT).contains(&self)
    }
}
