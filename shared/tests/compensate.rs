//! Compensation against a simulation in the time domain: the output model sample by sample, the converter's sinc3
//! filter as three moving sums, and 24-bit codes.

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use shared::compensate::{
    CLAIMED_BAND, Calibration, Compensated, Compensator, CompensatorState, Mode, Quality, Scaling,
    Source,
};
use shared::model::{Coefficients, FURTHER, NOMINAL, SpecificForce};
use shared::moments::Accumulator;
use shared::rectification::{Covariance, NOMINAL_RECTIFYING, RECTIFYING};

/// Modulator rate of the simulation over the sample rate.
const DECIMATION: usize = 16;
const SAMPLE_RATE_HZ: f64 = 4000.0;
const BLOCK: usize = 40;
const BLOCKS: usize = 100;
const V_PER_CODE: f64 = 1.2 / 8_388_608.0;
const G_PER_CODE: f64 = 30.0 / 8_388_608.0;

/// Without a fifth order, which is for itself: see [`FIFTH`].
fn instrument() -> Coefficients<f64> {
    Coefficients::from_nominal([
        0.04, 2e-4, -6.2e-4, 3.9e-4, 2.7e-5, -4.9e-6, 3.8e-4, -6e-4, -4.6e-5, 2.6e-5, 5e-5,
    ])
    .with_further([0.0, -2e-4, 3e-4, 1.5e-4, -1.1e-4])
}

fn narrow(c: &Coefficients<f64>) -> Coefficients<f32> {
    Coefficients::from_nominal(c.to_nominal().map(|x| x as f32))
        .with_further(c.to_further().map(|x| x as f32))
}

fn compensator(c: &Coefficients<f64>, source: Source, mode: Mode) -> Compensator<f32> {
    let calibration = Calibration {
        coefficients: narrow(c),
        covariance: Covariance::default(),
        rank: NOMINAL as u8,
    };
    Compensator::new(Some(calibration), scaling(), source, mode)
}

fn scaling() -> Scaling<f32> {
    Scaling {
        instrument_v_per_code: V_PER_CODE as f32,
        nominal_v_per_g: 0.04,
        reference_g_per_code: [G_PER_CODE as f32; 3],
        reference_zero: [0; 3],
    }
}

/// Lines of a vibration: amplitude (g), frequency (Hz), phase (rad).
type Lines = Vec<(f64, f64, f64)>;

fn sine(rms_g: f64, frequency_hz: f64) -> Lines {
    vec![(rms_g * 2f64.sqrt(), frequency_hz, 0.3)]
}

/// Gaussian-like noise of 60 lines over 20 to `top_hz` with a given shape.
fn noise(rms_g: f64, top_hz: f64, shape: impl Fn(f64) -> f64, seed: u64) -> Lines {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let mut lines: Lines = (0..60)
        .map(|k| {
            let f = 20.0 + (top_hz - 20.0) * (f64::from(k) + random.random::<f64>()) / 60.0;
            (
                shape(f).sqrt(),
                f,
                random.random_range(0.0..std::f64::consts::TAU),
            )
        })
        .collect();
    let total = lines.iter().map(|l| l.0 * l.0 / 2.0).sum::<f64>().sqrt();
    lines.iter_mut().for_each(|l| l.0 *= rms_g / total);
    lines
}

/// Three moving sums, decimated: the converter's filter.
struct Sinc3 {
    rings: [[f64; DECIMATION]; 3],
    sums: [f64; 3],
    at: usize,
}

impl Sinc3 {
    fn new(rest: f64) -> Self {
        Self {
            rings: [[rest; DECIMATION]; 3],
            sums: [rest * DECIMATION as f64; 3],
            at: 0,
        }
    }

    fn push(&mut self, mut x: f64) -> f64 {
        for (ring, sum) in self.rings.iter_mut().zip(&mut self.sums) {
            *sum += x - ring[self.at];
            ring[self.at] = x;
            x = *sum / DECIMATION as f64;
        }
        self.at = (self.at + 1) % DECIMATION;
        x
    }
}

/// The direction of vibration on IA, PA, OA.
const DIRECTION: [f64; 3] = [0.8, 0.48, -0.36];

/// Codes of the four channels, and the mean specific force on IA that an ideal instrument would have measured.
fn simulate(
    c: &Coefficients<f64>,
    a0: SpecificForce<f64>,
    vibration: &[(f64, f64, f64)],
) -> (Vec<[i32; 4]>, f64) {
    simulate_along(DIRECTION, c, a0, vibration)
}

/// The same of vibration in any direction.
fn simulate_along(
    [along_i, along_p, along_o]: [f64; 3],
    c: &Coefficients<f64>,
    a0: SpecificForce<f64>,
    vibration: &[(f64, f64, f64)],
) -> (Vec<[i32; 4]>, f64) {
    let dt = 1.0 / (SAMPLE_RATE_HZ * DECIMATION as f64);
    let mut phasors: Vec<[f64; 4]> = vibration
        .iter()
        .map(|&(amplitude, f, phase)| {
            let (s, c) = (std::f64::consts::TAU * f * dt).sin_cos();
            [amplitude * phase.cos(), amplitude * phase.sin(), c, s]
        })
        .collect();
    let at_rest = [
        c.output_v(a0) / V_PER_CODE,
        a0.i / G_PER_CODE,
        a0.p / G_PER_CODE,
        a0.o / G_PER_CODE,
    ];
    let mut filters = at_rest.map(Sinc3::new);
    let mut codes = Vec::new();
    let mut truth = 0.0;
    let warm_up = 4;
    for n in 0..(BLOCK * BLOCKS + warm_up) * DECIMATION {
        let mut w = 0.0;
        for p in &mut phasors {
            w += p[1];
            *p = [
                p[0] * p[2] - p[1] * p[3],
                p[1] * p[2] + p[0] * p[3],
                p[2],
                p[3],
            ];
        }
        let a = SpecificForce::new(a0.i + along_i * w, a0.p + along_p * w, a0.o + along_o * w);
        let inputs = [
            c.output_v(a) / V_PER_CODE,
            a.i / G_PER_CODE,
            a.p / G_PER_CODE,
            a.o / G_PER_CODE,
        ];
        let mut outputs = [0.0; 4];
        for k in 0..4 {
            outputs[k] = filters[k].push(inputs[k]);
        }
        if n % DECIMATION == DECIMATION - 1 && n / DECIMATION >= warm_up {
            codes.push(outputs.map(|x| x.round() as i32));
            truth += outputs[1] * G_PER_CODE;
        }
    }
    (codes, truth / (BLOCK * BLOCKS) as f64)
}

fn compensate(compensator: &Compensator<f32>, codes: &[[i32; 4]]) -> Vec<Compensated<f32>> {
    let mut state = CompensatorState::new();
    let mut accumulator = Accumulator::<f32>::new(compensator.zero());
    let block = |codes: &[[i32; 4]]| {
        for &sample in codes {
            accumulator.extend(&[sample]).expect("short");
            state.extend(compensator, &[sample]);
        }
        let moments = accumulator.close().expect("short").expect("not empty");
        state.close(compensator, &moments)
    };
    codes.chunks(BLOCK).map(block).collect()
}

fn mean(blocks: &[Compensated<f32>]) -> f64 {
    let sum: f64 = blocks.iter().map(|b| b.specific_force_g).sum();
    sum / blocks.len() as f64
}

/// Systematic specific forces on IA with gravity on PA where there is some left.
fn attitudes() -> [SpecificForce<f64>; 4] {
    [-1.0f64, 0.0, 0.5, 1.0].map(|i| SpecificForce::new(i, (1.0 - i * i).sqrt(), 0.0))
}

/// Vibrations of the claimed band, 0.1 to 5 g rms: sines, white noise, noise that falls with frequency.
fn vibrations() -> Vec<Lines> {
    let top_hz = CLAIMED_BAND * SAMPLE_RATE_HZ;
    let mut all = Vec::new();
    for (n, rms_g) in [0.1, 0.5, 2.0, 5.0].into_iter().enumerate() {
        for frequency_hz in [23.3, 0.473 * top_hz, 0.987 * top_hz] {
            all.push(sine(rms_g, frequency_hz));
        }
        all.push(noise(rms_g, top_hz, |_| 1.0, n as u64));
        all.push(noise(rms_g, top_hz, |f| f.powi(-2), 10 + n as u64));
    }
    all
}

/// What `f32`, quantisation and a second of samples leave, g.
const FLOOR_G: f64 = 1.5e-7;

struct Residual {
    before_g: f64,
    after_g: f64,
    name: String,
}

fn residuals(c: &Coefficients<f64>, with: &Compensator<f32>) -> Vec<Residual> {
    let mut all = Vec::new();
    for vibration in vibrations() {
        for a0 in attitudes() {
            let (codes, truth) = simulate(c, a0, &vibration);
            let blocks = compensate(with, &codes);
            let sum: f64 = codes.iter().map(|s| f64::from(s[0])).sum();
            let mean_g = sum / codes.len() as f64 * V_PER_CODE / c.scale_factor_v_per_g;
            // Everything but the vibration error taken out, in f64.
            let mut uncompensated = truth;
            for _ in 0..20 {
                uncompensated = mean_g - c.error_g(SpecificForce::new(uncompensated, a0.p, a0.o));
            }
            all.push(Residual {
                before_g: (uncompensated - truth).abs(),
                after_g: (mean(&blocks) - truth).abs(),
                name: format!(
                    "{} lines, first {:?}, at {a0:?}",
                    vibration.len(),
                    vibration[0]
                ),
            });
        }
    }
    all
}

/// The number of the fifth order, and its coefficient. By a block's moments it is held to a twentieth in the mean square
/// alone: its fifth moment is guessed from the third and the fourth, and a block with hardly any error may be off by as much.
const FIFTH: (usize, f64) = (NOMINAL, 1e-7);

/// One instrument for each coefficient that rectifies, with nothing else; the further ones count from [`NOMINAL`].
fn single_effects() -> impl Iterator<Item = (usize, Coefficients<f64>)> {
    let (all, mut further) = (instrument().to_nominal(), instrument().to_further());
    further[0] = FIFTH.1;
    let bare = Coefficients {
        scale_factor_v_per_g: all[0],
        ..Coefficients::default()
    };
    let nominal = NOMINAL_RECTIFYING.into_iter().map(move |k| {
        let mut one = bare.to_nominal();
        one[k] = all[k];
        (k, Coefficients::from_nominal(one))
    });
    let further = (0..FURTHER).map(move |k| {
        let mut one = [0.0; FURTHER];
        one[k] = further[k];
        (NOMINAL + k, bare.with_further(one))
    });
    nominal.chain(further)
}

fn assert_twentieth(source: Source, mode: Mode, only: impl Fn(usize) -> bool) {
    for (k, c) in single_effects().filter(|(k, _)| only(*k)) {
        let with = compensator(&c, source, mode);
        for r in residuals(&c, &with) {
            assert!(
                r.after_g <= r.before_g / 20.0 + FLOOR_G,
                "coefficient {k}, {}: {:e} g -> {:e} g",
                r.name,
                r.before_g,
                r.after_g
            );
        }
    }
}

#[test]
fn block_mode_leaves_less_than_a_twentieth_of_each_effect() {
    assert_twentieth(Source::Reference, Mode::Block, |k| k != FIFTH.0);
}

#[test]
fn block_mode_leaves_a_twentieth_of_the_fifth_order_in_the_mean_square() {
    let (_, c) = single_effects().find(|(k, _)| *k == FIFTH.0).unwrap();
    let with = compensator(&c, Source::Reference, Mode::Block);
    let (mut before, mut after) = (0.0, 0.0);
    for r in residuals(&c, &with) {
        before += r.before_g.powi(2);
        after += r.after_g.powi(2);
    }
    let left = (after / before).sqrt();
    assert!(left < 0.05, "{left}");
}

#[test]
fn pointwise_mode_leaves_less_than_a_twentieth_of_each_effect() {
    assert_twentieth(Source::Reference, Mode::Pointwise, |_| true);
}

#[test]
fn the_instruments_own_signal_serves_where_nothing_couples_crosswise() {
    let left_out = [8, 9, 10, FIFTH.0, NOMINAL + 3, NOMINAL + 4];
    assert_twentieth(Source::Instrument, Mode::Block, |k| !left_out.contains(&k));
}

/// The input axis stands still: its noise tells no frequency to correct the droop of the others by.
#[test]
fn vibration_across_the_input_axis_alone_is_taken_out_to_a_twentieth() {
    let c = instrument();
    let a0 = SpecificForce::new(0.5, 0.75f64.sqrt(), 0.0);
    for mode in [Mode::Block, Mode::Pointwise] {
        let with = compensator(&c, Source::Reference, mode);
        for hz in [23.3, 118.25, 246.75] {
            let (codes, truth) = simulate_along([0.0, 1.0, 0.0], &c, a0, &sine(1.0, hz));
            let error_g = (mean(&compensate(&with, &codes)) - truth).abs();
            assert!(
                error_g < c.cross_pp_per_g / 20.0,
                "{mode:?}, {hz} Hz: {error_g:e}"
            );
        }
    }
}

#[test]
fn compensation_never_makes_the_error_larger_even_where_effects_cancel() {
    let c = instrument();
    for mode in [Mode::Block, Mode::Pointwise] {
        let with = compensator(&c, Source::Reference, mode);
        for r in residuals(&c, &with) {
            assert!(r.after_g <= r.before_g + FLOOR_G, "{mode:?}, {}", r.name);
        }
    }
}

#[test]
fn a_change_of_level_is_followed_within_two_blocks() {
    let c = instrument();
    let a0 = SpecificForce::new(0.5, 0.75f64.sqrt(), 0.0);
    let with = compensator(&c, Source::Reference, Mode::Block);
    let (mut codes, _) = simulate(&c, a0, &sine(0.3, 200.0));
    let (louder, _) = simulate(&c, a0, &sine(3.0, 200.0));
    codes.truncate(10 * BLOCK + BLOCK / 2);
    codes.extend(&louder[..10 * BLOCK + BLOCK / 2]);
    let blocks = compensate(&with, &codes);
    // 200 Hz: two whole periods a block, so that every block means the same a0.
    for (n, block) in blocks.iter().enumerate() {
        if !(10..12).contains(&n) {
            let error = block.specific_force_g - a0.i;
            let allowed = f64::from(block.vre_g.abs()) / 20.0 + 1e-6;
            assert!(error.abs() < allowed, "block {n}: {error:e}");
        }
    }
    let step = blocks[12].vre_g - blocks[9].vre_g;
    assert!(step.abs() > 5e-4, "{step}");
}

#[test]
fn stated_uncertainty_is_the_spread_of_predictions_over_the_coefficients_covariance() {
    let c = instrument();
    let sigma = 2e-5;
    // Neighbours share half of their variance.
    let element = |row: usize, column: usize| match row - column {
        0 => 2.0 * sigma * sigma,
        1 => sigma * sigma,
        _ => 0.0,
    };
    let calibration = Calibration {
        coefficients: narrow(&c),
        covariance: Covariance::from_fn(element).narrow(),
        rank: NOMINAL as u8,
    };
    // Not at zero, where the vibration error of the bias asymmetry jumps.
    let a0 = SpecificForce::new(0.5, 0.75f64.sqrt(), 0.0);
    let (codes, _) = simulate(&c, a0, &sine(1.0, 100.0));
    let codes = &codes[..BLOCK];
    let predict = |calibration| {
        let with = Compensator::new(Some(calibration), scaling(), Source::Reference, Mode::Block);
        compensate(&with, codes)[0]
    };
    let stated = f64::from(predict(calibration).vre_sigma_g);
    let nominal = f64::from(predict(calibration).vre_g);
    let mut random = ChaCha8Rng::seed_from_u64(3);
    let normal = rand_distr::StandardNormal;
    let trials = 2000;
    let spread: f64 = (0..trials)
        .map(|_| {
            let z: [f64; RECTIFYING + 1] = std::array::from_fn(|_| random.sample(normal));
            let moves = |n: usize| sigma * (z[n] + z[n + 1]);
            let (mut moved, mut further) = (c.to_nominal(), c.to_further());
            for (n, k) in NOMINAL_RECTIFYING.into_iter().enumerate() {
                moved[k] += moves(n);
            }
            for (k, x) in further.iter_mut().enumerate() {
                *x += moves(NOMINAL_RECTIFYING.len() + k);
            }
            let mut other = calibration;
            other.coefficients = narrow(&Coefficients::from_nominal(moved).with_further(further));
            (f64::from(predict(other).vre_g) - nominal).powi(2)
        })
        .sum();
    let spread = (spread / f64::from(trials)).sqrt();
    // The spread of 2000 trials is itself known to 1.6 %.
    assert!(
        (spread / stated - 1.0).abs() < 0.06,
        "{spread:e} {stated:e}"
    );
}

fn quality(c: &Coefficients<f64>, codes: &[[i32; 4]]) -> Quality {
    compensate(&compensator(c, Source::Reference, Mode::Block), codes)[1].quality
}

#[test]
fn blocks_that_deserve_no_trust_say_why() {
    let c = instrument();
    let a0 = SpecificForce::new(0.2, 0.9, 0.1);
    let (codes, _) = simulate(&c, a0, &sine(1.0, 100.0));
    assert!(quality(&c, &codes).is_sound());

    let mut saturated = codes.clone();
    saturated[BLOCK + 3][0] = (1 << 23) - 1;
    assert_eq!(quality(&c, &saturated), Quality(Quality::SATURATED));

    let still: Vec<_> = codes.iter().map(|s| [s[0], 5, 6, 7]).collect();
    assert_eq!(quality(&c, &still), Quality(Quality::REFERENCE_LOST));

    let (fast, _) = simulate(&c, a0, &sine(1.0, 400.0));
    assert_eq!(quality(&c, &fast), Quality(Quality::OUT_OF_BAND));

    let without = Compensator::new(None, scaling(), Source::Reference, Mode::Block);
    let block = compensate(&without, &codes)[1];
    assert_eq!(block.quality, Quality(Quality::COEFFICIENTS_MISSING));
    assert!(block.vre_sigma_g.is_infinite());

    let blind = Calibration {
        coefficients: narrow(&c),
        covariance: Covariance::default(),
        rank: 10,
    };
    let blind = Compensator::new(Some(blind), scaling(), Source::Reference, Mode::Block);
    assert_eq!(
        compensate(&blind, &codes)[1].quality,
        Quality(Quality::PLAN_BLIND)
    );
}

#[test]
fn a_block_is_finite_or_says_that_no_specific_force_gives_its_output() {
    let (codes, _) = simulate(
        &instrument(),
        SpecificForce::new(0.2, 0.9, 0.1),
        &sine(1.0, 100.0),
    );
    let (mut flagged, mut sound) = (0, 0);
    for mode in [Mode::Block, Mode::Pointwise] {
        for (coefficient, exponent) in (1..16).flat_map(|c| (-6..39).map(move |e| (c, e))) {
            for sign in [-1.0f32, 1.0] {
                let (mut nominal, mut further) = ([0.0f32; NOMINAL], [0.0; FURTHER]);
                nominal[0] = 0.04;
                let mut all = nominal.iter_mut().chain(&mut further);
                if let Some(one) = all.nth(coefficient) {
                    *one = sign * 10f32.powi(exponent);
                }
                let calibration = Calibration {
                    coefficients: Coefficients::from_nominal(nominal).with_further(further),
                    covariance: Covariance::from_fn(|j, k| if j == k { 1e-12 } else { 0.0 }),
                    rank: NOMINAL as u8,
                };
                let with = Compensator::new(Some(calibration), scaling(), Source::Reference, mode);
                for block in compensate(&with, &codes) {
                    let no_solution = block.quality.has(Quality::NO_SOLUTION);
                    let figures = [block.vre_g, block.vre_sigma_g, block.sigma_g];
                    let finite = figures.iter().all(|x| x.is_finite());
                    assert!(block.specific_force_g.is_finite(), "{mode:?} {block:?}");
                    assert!(finite || no_solution, "{mode:?} {block:?}");
                    flagged += u32::from(no_solution);
                    sound += u32::from(block.quality.is_sound());
                }
            }
        }
    }
    // The sweep holds both kinds.
    assert!(flagged > 1000 && sound > 1000, "{flagged} {sound}");
}

#[test]
fn in_how_many_pieces_samples_come_changes_not_one_bit() {
    let (codes, _) = simulate(
        &instrument(),
        SpecificForce::new(0.2, 0.9, 0.1),
        &sine(1.0, 100.0),
    );
    for mode in [Mode::Block, Mode::Pointwise] {
        let with = compensator(&instrument(), Source::Reference, mode);
        let gather = |piece: usize| {
            let mut accumulator = Accumulator::<f32>::new(with.zero());
            let mut state = CompensatorState::new();
            for samples in codes[..5 * BLOCK].chunks(piece) {
                accumulator.extend(samples).expect("short");
                state.extend(&with, samples);
            }
            let moments = accumulator.close().expect("short").expect("samples");
            (moments, state.close(&with, &moments))
        };
        let whole = gather(5 * BLOCK);
        for piece in [1, 2, 3, 7, 8, 9, 64, 65] {
            assert_eq!(gather(piece), whole, "{mode:?} {piece}");
        }
    }
}
