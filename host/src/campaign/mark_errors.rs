//! What is known of the errors of a dividing head's marks, beside the standard uncertainty that a campaign states.

use shared::tumble::within_a_turn;

/// Errors of the marks as a Gaussian: their means are taken off the outputs already, their covariance is left.
#[derive(Clone, Debug, PartialEq)]
pub struct MarkErrors {
    /// Angles of the marks, deg, within a turn, each once.
    pub marks_deg: Vec<f64>,
    /// Covariance of their errors, rad^2, row by row.
    pub covariance_rad2: Vec<f64>,
}

impl MarkErrors {
    /// Place of a mark, if it is known.
    pub fn place(&self, dial_deg: f64) -> Option<usize> {
        let dial_deg = within_a_turn(dial_deg);
        self.marks_deg.iter().position(|mark| *mark == dial_deg)
    }

    /// Covariance of the errors of two known marks by their places, rad^2.
    pub fn between(&self, a: usize, b: usize) -> f64 {
        self.covariance_rad2[a * self.marks_deg.len() + b]
    }
}
