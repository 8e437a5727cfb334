//! What instrument and host agree on.
#![no_std]
