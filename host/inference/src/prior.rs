//! What is known of a parameter before anything is observed.

/// A parameter of a component.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Parameter {
    /// Name with its unit at the end.
    pub name: &'static str,
    /// How it enters, and what is known of it.
    pub prior: Prior,
}

/// How a parameter enters, and what is known of it beforehand.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Prior {
    /// In proportion: a Cauchy distribution about zero.
    Linear {
        /// Its half width at half height.
        width: f64,
    },
    /// Smoothly: evenly probable over the range. Started from a grid and refined.
    Nonlinear {
        /// Least value.
        from: f64,
        /// Greatest value.
        to: f64,
        /// Points of the grid.
        points: usize,
        /// Whether the range is one of the logarithm.
        logarithmic: bool,
    },
    /// By steps: a threshold, evenly probable over the range. Started from a grid, then put between two steps.
    Threshold {
        /// Least value.
        from: f64,
        /// Greatest value.
        to: f64,
        /// Points of the grid.
        points: usize,
    },
}

impl Prior {
    /// A value on the scale that the parameter is refined on.
    pub(crate) fn inner(self, value: f64) -> f64 {
        match self {
            Self::Nonlinear {
                logarithmic: true, ..
            } => value.ln(),
            _ => value,
        }
    }

    /// The value behind a place on that scale.
    pub(crate) fn outer(self, inner: f64) -> f64 {
        match self {
            Self::Nonlinear {
                logarithmic: true, ..
            } => inner.exp(),
            _ => inner,
        }
    }

    /// Derivative of the value by its place on that scale.
    pub fn slope(self, value: f64) -> f64 {
        match self {
            Self::Nonlinear {
                logarithmic: true, ..
            } => value,
            _ => 1.0,
        }
    }

    /// Ends of the range on that scale; none in proportion.
    pub fn range(self) -> Option<(f64, f64)> {
        match self {
            Self::Linear { .. } => None,
            Self::Nonlinear { from, to, .. } => Some((self.inner(from), self.inner(to))),
            Self::Threshold { from, to, .. } => Some((from, to)),
        }
    }

    /// Whether a fit can end at a value: within the range, but for rounding; any in proportion.
    pub fn allows(self, value: f64) -> bool {
        let Some((from, to)) = self.range() else {
            return value.is_finite();
        };
        let slack = 1e-9 * (to - from);
        (from - slack..=to + slack).contains(&self.inner(value))
    }

    /// So many values, the middles of equal parts of the range; none in proportion.
    pub fn settings(self, points: usize) -> Vec<f64> {
        let Some((from, to)) = self.range() else {
            return Vec::new();
        };
        let step = (to - from) / points as f64;
        let at = |k: usize| self.outer(from + (k as f64 + 0.5) * step);
        (0..points).map(at).collect()
    }

    /// Values that a search starts from; 1 in proportion.
    fn starts(self) -> Vec<f64> {
        match self {
            Self::Linear { .. } => vec![1.0],
            Self::Nonlinear { points, .. } | Self::Threshold { points, .. } => {
                self.settings(points)
            }
        }
    }
}

/// A parameter in proportion, a Cauchy distribution of that half width about zero.
pub const fn linear(name: &'static str, width: f64) -> Parameter {
    Parameter {
        name,
        prior: Prior::Linear { width },
    }
}

/// A parameter evenly probable in its logarithm between two values, with so many starts.
pub const fn logarithmic(name: &'static str, from: f64, to: f64, points: usize) -> Parameter {
    Parameter {
        name,
        prior: Prior::Nonlinear {
            from,
            to,
            points,
            logarithmic: true,
        },
    }
}

/// A parameter evenly probable between two values, with so many starts.
pub const fn even(name: &'static str, from: f64, to: f64, points: usize) -> Parameter {
    Parameter {
        name,
        prior: Prior::Nonlinear {
            from,
            to,
            points,
            logarithmic: false,
        },
    }
}

/// A threshold evenly probable between two values, with so many starts.
pub const fn stepped(name: &'static str, from: f64, to: f64, points: usize) -> Parameter {
    Parameter {
        name,
        prior: Prior::Threshold { from, to, points },
    }
}

/// Every combination of the parameters' starts.
pub fn grid(parameters: &[Parameter]) -> Vec<Vec<f64>> {
    let mut all = vec![Vec::new()];
    for parameter in parameters {
        let starts = parameter.prior.starts();
        let with = |values: &Vec<f64>| {
            let values = values.clone();
            let longer = move |&start: &f64| [&values[..], &[start]].concat();
            starts.iter().map(longer).collect::<Vec<_>>()
        };
        all = all.iter().flat_map(with).collect();
    }
    all
}
