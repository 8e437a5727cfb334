//! Tests that cross the packages live in `tests/`; this library is empty.
