//! Mean, standard deviation and extremes, value by value.

/// Mean and standard deviation (Welford).
#[derive(Clone, Copy, Debug, Default)]
pub struct Spread {
    /// Number of values.
    pub count: u64,
    /// Their mean, 0 of none.
    pub mean: f64,
    squares: f64,
    /// The largest, 0 of none.
    pub max: f64,
    /// The smallest, 0 of none.
    pub min: f64,
}

impl Spread {
    /// Takes a value.
    pub fn add(&mut self, value: f64) {
        (self.min, self.max) = match self.count {
            0 => (value, value),
            _ => (self.min.min(value), self.max.max(value)),
        };
        self.count += 1;
        let delta = value - self.mean;
        self.mean += delta / self.count as f64;
        self.squares += delta * (value - self.mean);
    }

    /// Takes `count` values at once, given their mean and variance; extremes are left as they are.
    pub fn merge(&mut self, count: u64, mean: f64, variance: f64) {
        let (a, b) = (self.count as f64, count as f64);
        let delta = mean - self.mean;
        self.count += count;
        self.mean += delta * b / (a + b);
        self.squares += variance * b + delta * delta * a * b / (a + b);
    }

    /// Takes the values of another.
    pub fn join(&mut self, other: &Self) {
        if other.count == 0 {
            return;
        }
        let (min, max) = match self.count {
            0 => (other.min, other.max),
            _ => (self.min.min(other.min), self.max.max(other.max)),
        };
        self.merge(other.count, other.mean, other.squares / other.count as f64);
        (self.min, self.max) = (min, max);
    }

    /// Of the values themselves, n - 1 in the denominator; 0 of fewer than two.
    pub fn standard_deviation(&self) -> f64 {
        match self.count {
            0 | 1 => 0.0,
            n => (self.squares / (n - 1) as f64).sqrt(),
        }
    }
}

impl FromIterator<f64> for Spread {
    fn from_iter<I: IntoIterator<Item = f64>>(values: I) -> Self {
        let mut spread = Self::default();
        values.into_iter().for_each(|value| spread.add(value));
        spread
    }
}
