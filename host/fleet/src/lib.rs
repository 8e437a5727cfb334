//! The campaigns of many instruments as one data set, asked in SQL.
//!
//! ```text
//! folders -> dataset (Parquet, one campaign a row) -> engine (DataFusion with the functions of vre) -> results
//!                       \-> folders                \-> head_of (a head's error map), sides
//! ```

pub mod commands;
pub mod dataset;
pub mod engine;
pub mod functions;
pub mod head_of;
pub mod results;
pub mod rowwise;
pub mod sides;
