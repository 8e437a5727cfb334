//! Moments against two passes over the samples, for many signals.

use std::ops::Range;

use rand::rngs::StdRng;
use rand::{RngExt, SeedableRng};
use rand_distr::{Distribution, Normal};
use shared::moments::{Accumulator, CHANNELS, MAX_SAMPLES, Moments, MomentsError, PAIRS};
use shared::scalar::Real;
use shared::wire::message::{Block, Segment};

type Sample = [i32; CHANNELS];

const EXTREMES: [i32; 2] = [-(1 << 23), (1 << 23) - 1];

/// Relative errors promised for each number type.
fn promised<T: Real>() -> f64 {
    if size_of::<T>() == 4 { 2e-5 } else { 1e-13 }
}

fn moments<T: Real>(samples: &[Sample], zero: Sample) -> Moments<T> {
    let mut accumulator = Accumulator::new(zero);
    accumulator.extend(samples).unwrap();
    accumulator.close().unwrap().unwrap()
}

/// Means of powers of the differences from the mean and of their moduli, in two passes.
struct TwoPass {
    /// Integer part of the mean and its fraction.
    mean: [(i64, f64); CHANNELS],
    central: [[f64; CHANNELS]; 3],
    absolute: [[f64; CHANNELS]; 3],
    cross: [f64; 6],
    modulus: [i128; CHANNELS],
}

fn two_pass(samples: &[Sample], zero: Sample) -> TwoPass {
    let n = samples.len() as i64;
    let mean: [(i64, f64); CHANNELS] = std::array::from_fn(|k| {
        let sum: i64 = samples.iter().map(|s| i64::from(s[k])).sum();
        (sum.div_euclid(n), sum.rem_euclid(n) as f64 / n as f64)
    });
    let d = |s: &Sample, k: usize| (i64::from(s[k]) - mean[k].0) as f64 - mean[k].1;
    // Sums of a few hundred at a time keep the reference's own rounding below the promise.
    let average = |f: &dyn Fn(&Sample) -> f64| {
        samples
            .chunks(500)
            .map(|part| part.iter().map(f).sum::<f64>())
            .sum::<f64>()
            / n as f64
    };
    let power = |order: usize, modulus: bool| -> [f64; CHANNELS] {
        std::array::from_fn(|k| {
            average(&|s| {
                let d = d(s, k);
                (if modulus { d.abs() } else { d }).powi(order as i32 + 2)
            })
        })
    };
    TwoPass {
        mean,
        central: std::array::from_fn(|order| power(order, false)),
        absolute: std::array::from_fn(|order| power(order, true)),
        cross: PAIRS.map(|(i, j)| average(&|s| d(s, i) * d(s, j))),
        modulus: std::array::from_fn(|k| {
            samples
                .iter()
                .map(|s| (i128::from(s[k]) - i128::from(zero[k])).abs())
                .sum()
        }),
    }
}

/// Kinds of signal: at rest, noise, sine, step, ramp, full-scale square.
const STEADY: Range<u32> = 0..6;

/// Noise with heavy tails, and noise that begins with a spike of a hundred standard deviations: the
/// worst origin that there can be.
const IMPULSIVE: Range<u32> = 6..8;

/// A signal, each channel of its own kind.
fn signal(rng: &mut StdRng, length: usize, kinds: Range<u32>) -> Vec<Sample> {
    let channels: [Vec<i32>; CHANNELS] = std::array::from_fn(|_| {
        let offset: f64 = rng.random_range(-8e6..8e6);
        let size = 10f64.powf(rng.random_range(0.0..6.5));
        let kind = rng.random_range(kinds.clone());
        let noise = Normal::new(0.0, 1.0).unwrap();
        (0..length)
            .map(|n| {
                let x = n as f64;
                let unit = match kind {
                    0 => 0.0,
                    1 => noise.sample(rng),
                    2 => (x * 0.37).sin(),
                    3 => f64::from(u8::from(n > length / 2)) + 1e-4 * noise.sample(rng),
                    4 => x / length as f64,
                    5 => return EXTREMES[rng.random_range(0..2)],
                    6 => noise.sample(rng).powi(3),
                    _ => f64::from(u8::from(n == 0)) * 100.0 + noise.sample(rng),
                };
                (offset + size * unit).clamp(f64::from(EXTREMES[0]), f64::from(EXTREMES[1])) as i32
            })
            .collect()
    });
    (0..length)
        .map(|n| std::array::from_fn(|k| channels[k][n]))
        .collect()
}

fn assert_close<T: Real>(got: T, want: f64, scale: f64, what: &str, tolerance: f64) {
    let error = (got.to_f64() - want).abs();
    assert!(
        error <= tolerance * scale,
        "{what}: {got:?}, not {want:e}; scale {scale:e}"
    );
}

fn agree_with_two_passes<T: Real>(samples: &[Sample], tolerance: f64) {
    let zero = [17, -250_000, 0, EXTREMES[1]];
    let got = moments::<T>(samples, zero);
    let want = two_pass(samples, zero);
    assert_eq!(got.count(), samples.len() as u64);
    for k in 0..CHANNELS {
        let column = || samples.iter().map(|s| s[k]);
        assert_eq!(got.sum()[k], column().map(i64::from).sum::<i64>());
        assert_eq!(got.min()[k], column().min().unwrap());
        assert_eq!(got.max()[k], column().max().unwrap());
        assert_eq!(i128::from(got.modulus_sum()[k]), want.modulus[k]);
        let whole = want.mean[k].0 as i32;
        let fraction = got.mean_about([whole; CHANNELS])[k];
        assert_close(
            fraction,
            want.mean[k].1,
            1.0,
            "mean",
            2.0 * T::epsilon().to_f64(),
        );
        let central = [got.m2(), got.m3(), got.m4()];
        for (order, central) in central.iter().enumerate() {
            let scale = want.absolute[order][k];
            assert_close(
                central[k],
                want.central[order][k],
                scale,
                "central",
                tolerance,
            );
        }
    }
    for (p, (i, j)) in PAIRS.into_iter().enumerate() {
        let scale = (want.central[0][i] * want.central[0][j]).sqrt();
        assert_close(got.cross()[p], want.cross[p], scale, "cross", tolerance);
    }
}

fn agree_for_many_signals<T: Real>(kinds: Range<u32>, tolerance: f64) {
    for seed in 0..400 {
        let mut rng = StdRng::seed_from_u64(seed);
        let length = rng.random_range(1..3000);
        let samples = signal(&mut rng, length, kinds.clone());
        agree_with_two_passes::<T>(&samples, tolerance);
    }
}

#[test]
fn moments_in_f32_are_true_to_2e_5() {
    agree_for_many_signals::<f32>(STEADY, promised::<f32>());
}

#[test]
fn moments_in_f64_are_true_to_1e_13() {
    agree_for_many_signals::<f64>(STEADY, promised::<f64>());
}

#[test]
fn impulses_cost_f32_less_than_1e_3_and_f64_less_than_1e_12() {
    agree_for_many_signals::<f32>(IMPULSIVE, 1e-3);
    agree_for_many_signals::<f64>(IMPULSIVE, 1e-12);
}

#[test]
fn a_million_samples_cost_f32_less_than_1e_4_and_f64_nothing() {
    let samples = signal(&mut StdRng::seed_from_u64(1), 1_000_000, STEADY);
    agree_with_two_passes::<f32>(&samples, 1e-4);
    agree_with_two_passes::<f64>(&samples, promised::<f64>());
}

#[test]
fn merging_in_any_order_gives_the_same_moments() {
    fn check<T: Real>() {
        for seed in 0..200 {
            let mut rng = StdRng::seed_from_u64(seed);
            let samples = signal(&mut rng, 1000, STEADY);
            let zero = [5; CHANNELS];
            let (first, second) = (rng.random_range(1..500), rng.random_range(501..999));
            let parts = [
                &samples[..first],
                &samples[first..second],
                &samples[second..],
            ]
            .map(|part| moments::<T>(part, zero));
            let merge = |mut a: Moments<T>, b: &Moments<T>| {
                a.merge(b).unwrap();
                a
            };
            let left = merge(merge(parts[0], &parts[1]), &parts[2]);
            let right = merge(parts[0], &merge(parts[1], &parts[2]));
            let backwards = merge(parts[2], &merge(parts[1], &parts[0]));
            let scale = two_pass(&samples, zero).absolute;
            for other in [right, backwards] {
                assert_eq!(left.sum(), other.sum());
                assert_eq!(left.modulus_sum(), other.modulus_sum());
                assert_eq!((left.min(), left.max()), (other.min(), other.max()));
                let orders = [(left.m2(), other.m2()), (left.m3(), other.m3())];
                for (order, (a, b)) in orders
                    .into_iter()
                    .chain([(left.m4(), other.m4())])
                    .enumerate()
                {
                    for k in 0..CHANNELS {
                        assert_close(a[k], b[k].to_f64(), scale[order][k], "m", promised::<T>());
                    }
                }
            }
        }
    }
    check::<f32>();
    check::<f64>();
}

#[test]
fn one_sample_has_its_code_as_mean_and_no_spread() {
    let sample = [EXTREMES[0], EXTREMES[1], 0, 1];
    let one = moments::<f32>(&[sample], [0; CHANNELS]);
    assert_eq!(one.count(), 1);
    assert_eq!(one.mean(), sample.map(|code| code as f32));
    assert_eq!([one.m2(), one.m3(), one.m4()], [[0.0; CHANNELS]; 3]);
    assert_eq!(
        one.mean_modulus(),
        sample.map(|code| code.unsigned_abs() as f32)
    );
}

#[test]
fn an_empty_block_has_no_moments() {
    let mut accumulator = Accumulator::<f32>::new([0; CHANNELS]);
    assert_eq!(accumulator.close(), Ok(None));
    accumulator.extend(&[]).unwrap();
    assert_eq!(accumulator.close(), Ok(None));
}

#[test]
fn closing_a_block_begins_a_new_one() {
    let mut accumulator = Accumulator::<f64>::new([0; CHANNELS]);
    accumulator.extend(&[[1000; CHANNELS]; 100]).unwrap();
    assert_eq!(accumulator.count(), 100);
    accumulator.close().unwrap();
    assert_eq!(accumulator.count(), 0);
    accumulator.extend(&[[-7; CHANNELS]; 3]).unwrap();
    let second = accumulator.close().unwrap().unwrap();
    assert_eq!(
        (second.count(), second.sum(), second.max()),
        (3, [-21; CHANNELS], [-7; CHANNELS])
    );
}

/// Overflow checks are on in tests: a sum that did not fit would panic.
#[test]
fn full_scale_codes_and_any_integer_at_all_overflow_nothing() {
    for zero in EXTREMES {
        let square: Vec<Sample> = (0..10_000).map(|n| [EXTREMES[n % 2]; CHANNELS]).collect();
        let got = moments::<f32>(&square, [zero; CHANNELS]);
        assert_eq!(got.m2(), [2f32.powi(46); CHANNELS]);
        assert_eq!(got.m4(), [2f32.powi(92); CHANNELS]);
    }
    let mut rng = StdRng::seed_from_u64(3);
    let rubbish: Vec<Sample> = (0..100_000).map(|_| rng.random()).collect();
    let got = moments::<f64>(&rubbish, rng.random());
    assert!(got.min().iter().all(|&code| code >= EXTREMES[0]));
    assert!(got.max().iter().all(|&code| code <= EXTREMES[1]));
}

#[test]
fn the_longest_block_fits_and_one_more_sample_is_refused() {
    let samples: Vec<Sample> = (0..64).map(|n| [EXTREMES[n % 2]; CHANNELS]).collect();
    let mut longest = moments::<f32>(&samples, [EXTREMES[1]; CHANNELS]);
    while longest.count() < MAX_SAMPLES {
        longest.merge(&longest.clone()).unwrap();
    }
    assert_eq!(longest.count(), MAX_SAMPLES);
    assert_eq!(longest.sum(), [-(1 << 34); CHANNELS]);
    assert!(
        longest
            .m4()
            .iter()
            .all(|m4| (m4 / 2f32.powi(92) - 1.0).abs() < 1e-5)
    );
    let before = longest;
    let one = moments(&samples[..1], [EXTREMES[1]; CHANNELS]);
    assert_eq!(
        longest.merge(&one),
        Err(MomentsError::TooLong {
            count: MAX_SAMPLES + 1
        })
    );
    assert_eq!(longest, before);
}

#[test]
fn different_zero_codes_do_not_merge() {
    let mut left = moments::<f32>(&[[1; CHANNELS]], [0; CHANNELS]);
    let right = moments::<f32>(&[[1; CHANNELS]], [1; CHANNELS]);
    assert!(matches!(
        left.merge(&right),
        Err(MomentsError::DifferentZero { .. })
    ));
}

#[test]
fn reference_cross_moments_are_ip_io_po() {
    let samples: Vec<Sample> = (0..4)
        .map(|n| [[0, 1, 1, 3], [0, -1, -1, -3], [0, 1, -1, -3], [0, -1, 1, 3]][n])
        .collect();
    let got = moments::<f64>(&samples, [0; CHANNELS]);
    assert_eq!(got.reference_cross(), [0.0, 0.0, 3.0]);
}

#[test]
fn a_block_over_the_link_keeps_its_moments() {
    let samples = signal(&mut StdRng::seed_from_u64(9), 500, STEADY);
    let here = moments::<f32>(&samples, [0; CHANNELS]);
    let mut block = Block {
        segment: Segment::Idle,
        first_sample: 7,
        count: 500,
        lost: 0,
        moments: here.to_wire(),
    };
    let there = Moments::<f32>::from_block(&block).unwrap();
    assert_eq!(there.count(), here.count());
    assert_eq!(there.to_wire(), here.to_wire());
    block.moments.sum[2] = i64::MAX;
    let refused = Moments::<f32>::from_block(&block);
    assert_eq!(refused, Err(MomentsError::Impossible { first_sample: 7 }));
}
