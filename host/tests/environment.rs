//! Vibration errors in an environment, against the output model in the time domain.

use std::f64::consts::TAU;
use std::fs;
use std::path::Path;

use assert_cmd::Command;
use command::vre;
use host::campaign::{Breakpoint, Campaign, Density, SpectrumTable, read_spectrum};
use host::environment::Vibration;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use realfft::RealFftPlanner;
use realfft::num_complex::Complex;
use shared::model::{Coefficients, SpecificForce};

#[path = "common/command.rs"]
mod command;
mod common;

const RATE_HZ: f64 = 8192.0;
const SAMPLES: usize = 1 << 18;

/// Noise on three axes whose spectral densities and coherences are those of the table, straight on logarithmic axes.
///
/// At each frequency three independent Gaussian amplitudes go through the Cholesky factor of the spectral matrix.
fn noise(table: &[([f64; 4], [f64; 3])], stream: &mut ChaCha8Rng) -> [Vec<f64>; 3] {
    let bins = SAMPLES / 2 + 1;
    let width_hz = RATE_HZ / SAMPLES as f64;
    let mut spectra: [Vec<Complex<f64>>; 3] =
        std::array::from_fn(|_| vec![Complex::default(); bins]);
    for bin in 1..bins - 1 {
        let f_hz = bin as f64 * width_hz;
        let pair = table
            .windows(2)
            .find(|pair| (pair[0].0[0]..=pair[1].0[0]).contains(&f_hz));
        let Some([(low, _), (high, coherence)]) = pair else {
            continue;
        };
        let share = (f_hz / low[0]).ln() / (high[0] / low[0]).ln();
        let s: [f64; 3] = std::array::from_fn(|axis| {
            low[axis + 1] * (high[axis + 1] / low[axis + 1]).powf(share)
        });
        // Of a bin the record holds 2 Re(X exp(i w t)): with X = c (a + i b), a and b of variance 1, its mean square is
        // 4 c^2, which is S df.
        let [ip, io, po] = *coherence;
        let l11 = (1.0 - ip * ip).sqrt();
        let l21 = (po - ip * io) / l11;
        let factor = [
            [1.0, 0.0, 0.0],
            [ip, l11, 0.0],
            [io, l21, (1.0 - io * io - l21 * l21).max(0.0).sqrt()],
        ];
        let mut deviate = || {
            let normal: f64 = StandardNormal.sample(stream);
            normal
        };
        let drawn: [Complex<f64>; 3] = std::array::from_fn(|_| Complex::new(deviate(), deviate()));
        for axis in 0..3 {
            let sum: Complex<f64> = (0..3).map(|k| drawn[k] * factor[axis][k]).sum();
            spectra[axis][bin] = sum * (0.25 * s[axis] * width_hz).sqrt();
        }
    }
    let inverse = RealFftPlanner::<f64>::new().plan_fft_inverse(SAMPLES);
    spectra.map(|mut spectrum| {
        let mut record = inverse.make_output_vec();
        inverse.process(&mut spectrum, &mut record).unwrap();
        record
    })
}

fn coefficients() -> Coefficients<f64> {
    // Large, so that every term counts: K1, k0, k1', k2, k3, k4, d_OA, d_PA, k_IP, k_IO, k_PO.
    Coefficients::from_nominal([
        1.2, 1e-4, 8e-4, -2.5e-4, 1.2e-4, -3e-5, 3e-4, -4e-4, 4e-4, -3e-4, 5e-4,
    ])
}

/// Mean output under the motion less that at rest, g.
fn rectified(motion: &[Vec<f64>; 3], a0: SpecificForce<f64>) -> f64 {
    let c = coefficients();
    let at = |k: usize| {
        let w = [0, 1, 2].map(|axis| motion[axis][k]);
        c.output_g(SpecificForce::new(a0.i + w[0], a0.p + w[1], a0.o + w[2]))
    };
    // The linear part of a record's own mean is no rectification; these records have none.
    (0..SAMPLES).map(at).sum::<f64>() / SAMPLES as f64 - c.output_g(a0)
}

/// Mean and its standard error of simulated errors, over the predicted one: two-sided over many records.
fn check(name: &str, predicted: f64, simulated: &[f64]) {
    let n = simulated.len() as f64;
    let mean = simulated.iter().sum::<f64>() / n;
    let variance = simulated.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / (n - 1.0);
    let off = (mean - predicted) / (variance / n).sqrt();
    assert!(
        off.abs() < 4.0,
        "{name}: {mean:e} for {predicted:e}, {off:.1} standard errors"
    );
    // The test would see an error of this size.
    let sees = 4.0 * (variance / n).sqrt() / predicted.abs();
    assert!(sees < 0.02, "{name}: blind below {:.1} %", 100.0 * sees);
}

fn table(rows: &[([f64; 4], [f64; 3])], sines: &[[f64; 2]]) -> SpectrumTable {
    let breakpoints = rows.iter().map(|([f_hz, i, p, o], coherence)| Breakpoint {
        f_hz: *f_hz,
        density: Density::Axes([*i, *p, *o]),
        coherence: *coherence,
    });
    SpectrumTable {
        breakpoints: breakpoints.collect(),
        sines: sines.to_vec(),
    }
}

const SHAPE: [([f64; 4], [f64; 3]); 4] = [
    ([20.0, 2e-3, 4e-3, 1e-3], [0.5, -0.3, 0.2]),
    ([150.0, 2e-2, 1e-2, 8e-3], [0.5, -0.3, 0.2]),
    ([800.0, 2e-2, 1e-2, 8e-3], [0.5, -0.3, 0.2]),
    ([2000.0, 3e-3, 2e-3, 4e-3], [0.5, -0.3, 0.2]),
];

#[test]
fn a_spectrum_with_coherent_axes_rectifies_as_its_record_does() {
    let vibration = Vibration::of_table(&table(&SHAPE, &[]), [1.0, 0.0, 0.0]);
    for (seed, a0_i) in [(1, 0.0), (2, 1.0), (3, -2.0)] {
        let a0 = SpecificForce::new(a0_i, 0.0, 0.0);
        let mut stream = ChaCha8Rng::seed_from_u64(seed);
        let records: Vec<_> = (0..24).map(|_| noise(&SHAPE, &mut stream)).collect();
        let simulated: Vec<f64> = records.iter().map(|motion| rectified(motion, a0)).collect();
        let predicted = vibration.sensitivity(a0_i).vre_g(&coefficients());
        check(&format!("a0 {a0_i}"), predicted, &simulated);
        for axis in 0..3 {
            let power = records
                .iter()
                .flat_map(|r| &r[axis])
                .map(|w| w * w)
                .sum::<f64>();
            let rms = (power / (24 * SAMPLES) as f64).sqrt();
            assert!(
                (rms / vibration.rms_g()[axis] - 1.0).abs() < 5e-3,
                "axis {axis}"
            );
        }
    }
}

#[test]
fn sines_on_a_spectrum_rectify_as_their_record_does() {
    let direction = [0.8, 0.6, 0.0];
    let sines = [[97.0, 3.0], [311.0, 2.0]];
    let vibration = Vibration::of_table(&table(&SHAPE, &sines), direction);
    for (seed, a0_i) in [(4, 0.0), (5, 1.0)] {
        let a0 = SpecificForce::new(a0_i, 0.0, 0.0);
        let mut stream = ChaCha8Rng::seed_from_u64(seed);
        let one = |_| {
            let mut motion = noise(&SHAPE, &mut stream);
            for (k, [f_hz, peak_g]) in sines.iter().enumerate() {
                // A whole number of periods in a record, so that its mean is none of the sine's.
                let periods = (f_hz * SAMPLES as f64 / RATE_HZ).round() + k as f64;
                for sample in 0..SAMPLES {
                    let phase = TAU * (periods * sample as f64 / SAMPLES as f64);
                    let w = peak_g * phase.sin();
                    for axis in 0..3 {
                        motion[axis][sample] += direction[axis] * w;
                    }
                }
            }
            rectified(&motion, a0)
        };
        let simulated: Vec<f64> = (0..24).map(one).collect();
        let predicted = vibration.sensitivity(a0_i).vre_g(&coefficients());
        check(&format!("a0 {a0_i}"), predicted, &simulated);
    }
}

/// A level and a slope as in the curves of MIL-STD-810 and DO-160; by the integral in closed form a slope of m adds S1 f1 ((f2/f1)^(m+1) - 1)/(m + 1).
#[test]
fn the_level_of_a_spectrum_is_the_integral_of_its_straight_lines() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("psd.csv");
    fs::write(
        &file,
        "f [Hz];psd [g^2/Hz]\n10;0,015\n40;0,015\n500;0,00015\n",
    )
    .unwrap();
    let found = Vibration::of_table(&read_spectrum(&file).unwrap(), [0.6, 0.0, 0.8]);
    let slope = (0.015_f64 / 0.000_15).ln() / (40.0_f64 / 500.0).ln();
    let above = 0.015 * 40.0 * ((500.0_f64 / 40.0).powf(slope + 1.0) - 1.0) / (slope + 1.0);
    let rms = (0.015 * 30.0 + above).sqrt();
    assert!((found.total_rms_g() / rms - 1.0).abs() < 1e-6);
    assert!((found.rms_g()[2] / rms - 0.8).abs() < 1e-6);
}

fn of(path: &Path) -> &str {
    path.to_str().unwrap()
}

#[test]
fn a_mission_of_constant_level_is_the_error_times_its_length_and_its_limit_is_judged() {
    let folder = tempfile::tempdir().unwrap();
    let campaign = folder.path().join("campaign");
    Campaign::write(&common::campaign(), &campaign).unwrap();
    let mission = folder.path().join("mission.csv");
    fs::write(&mission, "time [min],level_g\n0,2\n5,2\n10,2\n").unwrap();
    let base = [
        "predict",
        of(&campaign),
        "--vibration",
        "random:2",
        "--a0",
        "0.5",
    ];
    let more = [
        "--mission",
        of(&mission),
        "--limit",
        "0.05",
        "--risk",
        "0.01",
    ];
    let (text, found) = vre(&[base.as_slice(), &more].concat());
    let value = |name: &str| found[name]["value"].as_f64().unwrap();
    let sigma = |name: &str| found[name]["sigma"].as_f64().unwrap();
    let velocity = &found["mission"]["velocity_m_per_s"];
    for (key, one) in [("value", value("vre_g")), ("sigma", sigma("vre_g"))] {
        let total = velocity[key].as_f64().unwrap();
        assert!(
            (total / (one * 9.806_65 * 600.0) - 1.0).abs() < 1e-9,
            "{key}"
        );
    }
    assert_eq!(found["limit"]["verdict"], "pass");
    assert!(
        text.contains("limit 50000 microg, risk 0.01: pass"),
        "{text}"
    );
    let limit = (2.0 * value("vre_g").abs().max(sigma("vre_g")) * 1e-3).to_string();
    let (_, found) = vre(&[base.as_slice(), &["--limit", &limit]].concat());
    assert_ne!(found["limit"]["verdict"], "pass");
}

#[test]
fn a_bad_environment_is_one_line_that_names_the_place() {
    let folder = tempfile::tempdir().unwrap();
    let campaign = folder.path().join("campaign");
    Campaign::write(&common::campaign(), &campaign).unwrap();
    let file = folder.path().join("psd.csv");
    for (text, told) in [
        (
            "f_hz,psd_g2_per_hz\n20,0.1\n10,0.1\n",
            "row 3, column f_hz: 10 is not above 20",
        ),
        ("f_hz,psd_g2_per_hz\n20,0.1\n", "has one breakpoint"),
        (
            "f_hz,psd_g2_per_hz\n20,0.1\n30,-1\n",
            "row 3, column psd_g2_per_hz: -1 g^2/Hz is outside",
        ),
        (
            "f_hz,psd_g2_per_hz\n20,\n30,1\n",
            "row 2, column psd_g2_per_hz: is empty",
        ),
        (
            "f_hz,psd_i_g2_per_hz,corr_ip,corr_io,corr_po\n20,1,1,1,-1\n",
            "no motion has these",
        ),
        (
            "f_hz,psd_g2_per_hz,sine_g\n20,0.1,\n30,0.1,\n25,,2\n",
            "name it psd+sine",
        ),
    ] {
        fs::write(&file, text).unwrap();
        let name = format!("psd:{}", of(&file));
        let mut command = Command::cargo_bin("vre").unwrap();
        let assert = command
            .args(["predict", of(&campaign), "--vibration", &name])
            .assert();
        let line = String::from_utf8(assert.code(2).get_output().stderr.clone()).unwrap();
        assert!(line.contains(told) && line.lines().count() == 1, "{line}");
    }
}
