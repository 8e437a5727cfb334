//! What something adds to the observables of a campaign, in g, not yet whitened.

use std::ops::Range;

use inference::observations::Column;

use super::rows::{ReadingConditions, RunConditions};

/// One kind of observation.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(usize)]
pub enum Observable {
    /// Dial readings.
    Static,
    /// Plateau before a run.
    Before,
    /// Plateau during a run.
    During,
    /// Plateau after a run.
    After,
    /// Drift within a run.
    Drift,
    /// Greatest output of a run.
    Maximum,
    /// Least output of a run.
    Minimum,
    /// Rms of the reference over the commanded level, with sign, on IA, PA, OA.
    Reference,
    /// Third standardized moment of a sine, and the fourth less 1.5.
    Shape,
}

impl Observable {
    /// All kinds in the order of their rows.
    pub const ALL: [Self; 9] = [
        Self::Static,
        Self::Before,
        Self::During,
        Self::After,
        Self::Drift,
        Self::Maximum,
        Self::Minimum,
        Self::Reference,
        Self::Shape,
    ];

    /// Its rows a run; none of a dial reading.
    const fn per_run(self) -> usize {
        match self {
            Self::Static => 0,
            Self::Reference => 3,
            Self::Shape => 2,
            _ => 1,
        }
    }
}

/// Where the rows of each observable lie.
#[derive(Clone, Copy, Debug)]
pub struct Layout {
    starts: [usize; Observable::ALL.len() + 1],
    runs: usize,
}

impl Layout {
    /// For these readings and runs.
    pub fn new(readings: &[ReadingConditions], runs: &[RunConditions]) -> Self {
        let mut starts = [0; Observable::ALL.len() + 1];
        for (k, observable) in Observable::ALL.into_iter().enumerate() {
            let length = match observable {
                Observable::Static => readings.len(),
                _ => observable.per_run() * runs.len(),
            };
            starts[k + 1] = starts[k] + length;
        }
        Self {
            starts,
            runs: runs.len(),
        }
    }

    /// Rows of an observable.
    #[inline]
    pub fn rows(&self, observable: Observable) -> Range<usize> {
        self.starts[observable as usize]..self.starts[observable as usize + 1]
    }

    /// Number of all rows.
    pub fn row_count(&self) -> usize {
        self.starts[Observable::ALL.len()]
    }

    /// A contribution of nothing.
    pub fn nothing(&self) -> Contribution {
        Contribution {
            column: Column::zero(self.row_count()),
            variance_g2: vec![0.0; self.runs],
            layout: *self,
        }
    }
}

/// What something adds.
#[derive(Clone, Debug)]
pub struct Contribution {
    /// To each row, in the observable's unit (g, g/s, or a ratio).
    pub column: Column,
    /// To the variance of each run's `during`, g^2.
    pub variance_g2: Vec<f64>,
    layout: Layout,
}

impl Contribution {
    /// Adds to row `row` of an observable.
    #[inline]
    pub fn add(&mut self, observable: Observable, row: usize, value: f64) {
        self.column.add_at(self.layout.rows(observable), row, value);
    }
}

/// Adds a value to each of several contributions.
pub fn add_each(
    contributions: &mut [Contribution],
    observable: Observable,
    row: usize,
    values: impl IntoIterator<Item = f64>,
) {
    for (contribution, value) in contributions.iter_mut().zip(values) {
        contribution.add(observable, row, value);
    }
}
