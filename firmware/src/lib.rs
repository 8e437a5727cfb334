//! The instrument, everything that compiles on the host too: `no_std`, without allocation, generic over
//! embedded-hal.
//!
//! ```text
//! adc -> sampler -> app -> conversation
//!                    \-> store
//! ```
//! [`link`] is what lies between sampler and application, [`watch`] who feeds the watchdog.
#![no_std]

pub mod adc;
pub mod app;
pub mod check;
pub mod conversation;
pub mod edge_pair;
pub mod link;
pub mod sampler;
pub mod store;
pub mod watch;
