//! The static test: coefficients from dial readings, and what a plan of positions can and cannot tell.
//!
//! ```text
//! campaign -> readings -> least_squares ------------\
//!                 \-----> covariance -> closed_form -> identification -> prediction, configuration
//!                                         goodness -/
//! plan of positions -> least_squares -> assessment -> planning
//! ```

pub mod assessment;
pub mod closed_form;
pub mod coefficients;
pub mod covariance;
pub mod goodness;
pub mod identification;
pub mod least_squares;
pub mod planning;
pub mod readings;

pub use assessment::{Assessment, Conditions, Environment, EnvironmentSigma, assess};
pub use coefficients::{MEANINGS, NAMES};
pub use covariance::{covariance, symmetric};
pub use goodness::{SUSPICIOUS, p_value, scatter_warning};
pub use identification::{Identification, Method, identify};
pub use least_squares::{DEFAULT_PRIOR_SIGMA, fit, fit_determined};
pub use planning::{best_plan, positions_to_add, twice_and_remounted};
pub use readings::{bench, position};
