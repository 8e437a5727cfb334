//! A triad: three instruments on one body, with a dial, with a poor one, or with none.
//!
//! The body has axes x, y, z; instrument s of the triad has its axes IA, PA, OA along (s, s+1, s+2), cyclically, and its
//! output is (1) with eleven coefficients of its own. At rest the specific force is g u with |u| = 1, g local gravity.
//! The attitude u is an unknown of each position, with two components on the tangent of the unit sphere and whatever is
//! known of it as a prior. What three outputs say beyond the attitude tells the coefficients:
//!
//! ```text
//! attitude known to sigma = 0      three equations a position: a bench that is exact
//! sigma > 0                        a dial, a box with square sides: the prior bounds what the attitude can explain
//! not known at all                 one equation, |a| = g: held by hand
//! ```
//!
//! One estimator for all three: the prior is the only difference.
//!
//! | module | subject |
//! |---|---|
//! | [`body`] | axes, the output of three instruments and its inversion |
//! | [`attitude`] | the equations of one position, its attitude eliminated |
//! | [`identification`] | coefficients of the three from positions, in constant memory |
//! | [`blind`] | what no attitude can tell, by name |
//! | [`start`] | where to linearise first: the ellipsoid of the outputs |
//! | [`vibration`] | vibration error of each instrument from the moments of the body's vibration |
//! | [`self_check`] | the triad judges its own calibration, on a cushion |
//!
//! Identification is in `f64`: coefficients of 1e-7 g are told apart from readings of 1 g.

pub mod attitude;
pub mod blind;
pub mod body;
pub mod identification;
pub mod self_check;
pub mod start;
pub mod vibration;
