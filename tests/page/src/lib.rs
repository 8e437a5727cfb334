//! Tests of the page in a browser; all of them in `tests/`.
