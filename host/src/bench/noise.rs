//! Randomness by name: every random number of the bench comes from one seed and the name of what it disturbs.
//!
//! Parts draw from streams of their own, so that switching one on or off, or computing runs in another order
//! or on several threads, leaves every other number as it was. Two campaigns of one seed, with and without
//! an effect, therefore differ by the effect alone.

use rand::{Rng, RngExt, SeedableRng};
use rand_chacha::ChaCha12Rng;
use rand_distr::{ChiSquared, StandardNormal};

/// The seed of a bench, from which named streams are taken.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Seed(pub u64);

impl Seed {
    /// The stream `name`, number `index` of its kind (a run's number, say). Always the same for the same
    /// three of seed, name and index; independent of every other.
    pub fn stream(self, name: &str, index: u64) -> Stream {
        // FNV-1a over name and index picks one of ChaCha's 2^64 streams.
        let bytes = name.bytes().chain(index.to_le_bytes());
        let hash = bytes.fold(0xcbf2_9ce4_8422_2325_u64, |hash, byte| {
            (hash ^ u64::from(byte)).wrapping_mul(0x0000_0100_0000_01b3)
        });
        let mut generator = ChaCha12Rng::seed_from_u64(self.0);
        generator.set_stream(hash);
        Stream(generator)
    }
}

/// A stream of random numbers.
#[derive(Clone, Debug)]
pub struct Stream(ChaCha12Rng);

impl Stream {
    /// Normally distributed, mean 0, standard deviation 1.
    #[inline]
    pub fn normal(&mut self) -> f64 {
        self.0.sample(StandardNormal)
    }

    /// Student's t of `dof` degrees of freedom over its standard deviation: mean 0, standard deviation 1. `dof` must be
    /// above 2.
    pub fn student_t(&mut self, dof: f64) -> f64 {
        let squares = ChiSquared::new(dof).map_or(dof, |chi_squared| self.0.sample(chi_squared));
        self.normal() * ((dof - 2.0) / squares).sqrt()
    }

    /// Uniform in [low, high).
    pub fn uniform(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.0.random::<f64>()
    }

    /// Log-uniform in [low, high), both positive.
    pub fn log_uniform(&mut self, low: f64, high: f64) -> f64 {
        self.uniform(low.ln(), high.ln()).exp()
    }

    /// +1 or -1, equally often.
    pub fn sign(&mut self) -> f64 {
        if self.0.random::<bool>() { 1.0 } else { -1.0 }
    }

    /// An index below `count`, which must not be zero.
    pub fn index(&mut self, count: usize) -> usize {
        self.0.random_range(0..count)
    }

    /// Puts `items` in random order (Fisher-Yates).
    pub fn shuffle<T>(&mut self, items: &mut [T]) {
        for last in (1..items.len()).rev() {
            items.swap(last, self.index(last + 1));
        }
    }

    /// Sixty-four random bits.
    pub fn bits(&mut self) -> u64 {
        self.0.next_u64()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_stream_is_fixed_by_seed_name_and_index() {
        let first = |seed: u64, name: &str, index: u64| Seed(seed).stream(name, index).bits();
        assert_eq!(first(1, "dial", 0), first(1, "dial", 0));
        assert_ne!(first(1, "dial", 0), first(2, "dial", 0));
        assert_ne!(first(1, "dial", 0), first(1, "level", 0));
        assert_ne!(first(1, "dial", 0), first(1, "dial", 1));
    }

    #[test]
    fn student_t_has_unit_variance_and_the_excess_of_its_degrees_of_freedom() {
        // Kurtosis 3 + 6/(dof - 4); with twenty its estimate scatters about as a Gaussian's, sqrt(24/n), and somewhat more.
        let mut stream = Seed(3).stream("tails", 0);
        let count = 400_000;
        let drawn: Vec<f64> = (0..count).map(|_| stream.student_t(20.0)).collect();
        let moment = |power| drawn.iter().map(|x| x.powi(power)).sum::<f64>() / f64::from(count);
        assert!(moment(1).abs() < 4.0 / f64::from(count).sqrt());
        assert!((moment(2) - 1.0).abs() < 4.0 * (2.4 / f64::from(count)).sqrt());
        assert!((moment(4) - 3.375).abs() < 0.1);
    }

    #[test]
    fn streams_of_different_names_are_uncorrelated() {
        let (mut a, mut b) = (Seed(7).stream("a", 0), Seed(7).stream("b", 0));
        let count = 20_000;
        let correlation =
            (0..count).map(|_| a.normal() * b.normal()).sum::<f64>() / f64::from(count);
        assert!(correlation.abs() < 4.0 / f64::from(count).sqrt());
    }
}
