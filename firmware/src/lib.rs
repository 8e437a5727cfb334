//! The instrument, everything that compiles on the host too.
#![no_std]
