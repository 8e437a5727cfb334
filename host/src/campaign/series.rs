//! Placeholder until `shared::tumble` lands.
use shared::model::SpecificForce;
/// Which instrument axis lies along the dial's shaft.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Series {
    /// Series 1
    OutputAxis,
    /// Series 2
    PendulousAxis,
    /// Series 3
    InputAxis,
}
impl Series {
    /// At the instrument's angle.
    pub fn specific_force(self, phi: f64) -> SpecificForce<f64> {
        let (s, c) = phi.sin_cos();
        match self {
            Self::OutputAxis => SpecificForce::new(-c, s, 0.0),
            Self::PendulousAxis => SpecificForce::new(-c, 0.0, s),
            Self::InputAxis => SpecificForce::new(0.0, -c, s),
        }
    }
}
