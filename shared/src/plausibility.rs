//! Is there a reference accelerometer at the converter's inputs, and does it feel what the instrument feels?
//!
//! An input that nothing is plugged into still has noise: it does not stand still. But it tells neither the specific force
//! along IA, nor a specific force at all, nor the vibration that the instrument tells.

use crate::scalar::Real;

/// By how much the reference's mean along IA may differ from the instrument's, g, and as a part of the specific force:
/// twice what data sheets of MEMS references allow for bias (50 mg), alignment (50 mg at 1 g, 3 deg) and scale (2.5 %).
const MEAN_TOLERANCE_G: f64 = 0.2;
const MEAN_TOLERANCE: f64 = 0.05;

/// Least specific force, g rms over all axes, that the reference tells in the long run. At rest it is 1 g, with vibration
/// more; a carrier that falls freely for long has less, and the reference is then taken for lost. Chosen halfway.
const LEAST_FELT_G: f64 = 0.5;

/// Samples of the long run: at 4 kSPS a second, twenty periods of the slowest vibration that is compensated. One block may
/// well tell nothing: vibration takes gravity away for a moment.
const LONG_RUN: f64 = 4096.0;

/// Instrument's vibration, g rms, from which on the reference must tell some too: far above the noise of either.
const VIBRATION_G: f64 = 0.02;

/// Least part of the instrument's variance that the reference tells. Both see the same axis; a quarter of the amplitude is
/// less than any difference of their bands makes in the claimed band. Chosen.
const LEAST_VARIANCE: f64 = 1.0 / 16.0;

/// One block as both tell it, g.
#[derive(Clone, Copy, Debug)]
pub struct Both<T> {
    /// False while the instrument is at the end of its range, and tells neither mean nor vibration.
    pub comparable: bool,
    /// The instrument's mean along IA.
    pub instrument_g: T,
    /// The instrument's variance, g^2.
    pub instrument_g2: T,
    /// The reference's mean along IA.
    pub reference_g: T,
    /// The reference's variance along IA, g^2.
    pub reference_g2: T,
    /// The reference's mean square over all axes in the long run, g^2.
    pub felt_g2: T,
}

/// What the reference feels in the long run: the mean over the last samples, or over all while there are fewer.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Felt<T> {
    mean_square_g2: T,
    /// Samples that it is of.
    samples: T,
}

impl<T: Real> Felt<T> {
    /// Takes the mean square of a block, g^2, of so many samples; gives that of the long run, g^2.
    pub fn absorb(&mut self, mean_square_g2: T, samples: u64) -> T {
        let samples = T::from_i64(samples as i64);
        self.samples = (self.samples + samples).min(T::lit(LONG_RUN).max(samples));
        let step = (mean_square_g2 - self.mean_square_g2) * samples / self.samples;
        self.mean_square_g2 += step;
        self.mean_square_g2
    }
}

impl<T: Real> Both<T> {
    /// True when the reference tells what the instrument tells.
    pub fn agree(&self) -> bool {
        let i = self.reference_g;
        let allowed = T::lit(MEAN_TOLERANCE_G) + T::lit(MEAN_TOLERANCE) * self.instrument_g.abs();
        let same_mean = (i - self.instrument_g).abs() <= allowed;
        let senses = self.felt_g2 >= T::lit(LEAST_FELT_G * LEAST_FELT_G);
        let quiet = self.instrument_g2 < T::lit(VIBRATION_G * VIBRATION_G);
        let shakes = self.reference_g2 >= T::lit(LEAST_VARIANCE) * self.instrument_g2;
        senses && (!self.comparable || same_mean && (quiet || shakes))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// At rest with IA up, both instruments sound.
    const SOUND: Both<f64> = Both {
        comparable: true,
        instrument_g: 1.0,
        instrument_g2: 1e-12,
        reference_g: 1.03,
        reference_g2: 1e-8,
        felt_g2: 1.06,
    };

    #[test]
    fn an_open_input_is_told_at_rest_in_any_attitude() {
        assert!(SOUND.agree());
        let open = Both {
            reference_g: 1e-4,
            reference_g2: 1e-9,
            ..SOUND
        };
        assert!(!open.agree());
        // IA level: the instrument tells nothing either, and gravity decides, after a second or two.
        let level = Both {
            instrument_g: 0.01,
            ..open
        };
        let mut felt = Felt::default();
        assert!((0..200).all(|_| felt.absorb(1.0, 40) == 1.0));
        let blocks = (0..1000).take_while(|_| {
            let felt_g2 = felt.absorb(1e-9, 40);
            Both { felt_g2, ..level }.agree()
        });
        // ln 4 times the long run.
        let samples = 40 * blocks.count();
        assert!((5000..6500).contains(&samples), "{samples}");
    }

    #[test]
    fn gravity_that_vibration_takes_away_for_a_block_is_no_lost_reference() {
        let mut felt = Felt::default();
        // 1 g and a sine of 1 g and 20 Hz, in blocks of 10 ms at 4 kSPS.
        for block in 0..1000 {
            let phase = f64::from(block % 5) / 5.0 * core::f64::consts::TAU;
            let mean = 1.0 - num_traits::Float::cos(phase);
            let felt_g2 = felt.absorb(mean * mean, 40);
            let shaken = Both {
                instrument_g: mean,
                reference_g: mean,
                felt_g2,
                ..SOUND
            };
            assert!(block < 5 || shaken.agree(), "{block}: {felt_g2}");
        }
    }

    #[test]
    fn a_reference_that_does_not_shake_with_the_instrument_is_told() {
        let shaken = Both {
            instrument_g2: 1.0,
            reference_g2: 0.9,
            ..SOUND
        };
        assert!(shaken.agree());
        let still = Both {
            reference_g2: 1e-8,
            ..shaken
        };
        assert!(!still.agree());
        // At the end of its range the instrument tells nothing to compare with.
        let saturated = Both {
            comparable: false,
            ..still
        };
        assert!(saturated.agree());
    }
}
