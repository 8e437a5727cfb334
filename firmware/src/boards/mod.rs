//! The boards: each in a folder of its own, behind the same gates.
//!
//! | gate | what goes through it |
//! |---|---|
//! | [`FrameBus`](firmware::adc::bus::FrameBus) | frames to the converter and back |
//! | [`Timers`](firmware::adc::count::Timers) | DRDY's edges, counted and stamped |
//! | `NorFlash` of embedded-storage-async | the configuration |
//! | `Read` and `Write` of embedded-io-async | the link to the host |

mod nucleo_f429zi;
