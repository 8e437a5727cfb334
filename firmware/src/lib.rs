//! The instrument, everything that compiles on the host too: `no_std`, without allocation, generic over
//! embedded-hal.
//!
//! ```text
//! adc -> sampler -> app -> link
//!                    \-> store
//! ```
#![no_std]

pub mod adc;
pub mod app;
pub mod check;
pub mod link;
pub mod sampler;
pub mod store;
