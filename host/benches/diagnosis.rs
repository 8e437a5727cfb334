//! A campaign of 80 readings and 96 runs, diagnosed on one core: whole catalogue, pairs, cross-validation, next tests.

use divan::Bencher;
use host::bench::effects;
use host::bench::noise::Seed;
use host::bench::plan::Static;
use host::bench::simulate::{Specification, VirtualBench};
use host::campaign::Campaign;
use host::diagnose::diagnose;

fn main() {
    divan::main();
}

/// What acts, and what the catalogue lacks.
const CASES: [(&str, &[&str], &[&str]); 7] = [
    ("nothing", &[], &[]),
    ("one effect", &["self-heating"], &[]),
    ("one that moves", &["fixture-resonance"], &[]),
    ("two effects", &["vibropendulous", "drift"], &[]),
    (
        "two, one of them periodic",
        &["adc-inl", "reference-scale"],
        &[],
    ),
    (
        "two, one of them moving",
        &["fixture-resonance", "bias-asymmetry"],
        &[],
    ),
    ("unexplained", &["vibropendulous"], &["vibropendulous"]),
];

fn campaign(acting: &[&str]) -> Campaign {
    let seed = Seed(1);
    let drawn = acting.iter().enumerate().filter_map(|(k, id)| {
        let mut stream = seed.stream("effect", k as u64);
        Some((effects::find(id)?.draw)(0.5, &mut stream))
    });
    let specification = Specification::with_dial_sigma(1.0);
    let bench = VirtualBench::new(seed, Static::Default, specification, drawn.collect());
    bench.simulate().campaign
}

#[divan::bench(args = CASES.map(|(name, ..)| name))]
fn diagnosis(bencher: Bencher<'_, '_>, name: &str) {
    let (_, acting, without) = CASES.into_iter().find(|case| case.0 == name).unwrap();
    let campaign = campaign(acting);
    let without: Vec<String> = without.iter().map(|&id| id.to_owned()).collect();
    bencher.bench(|| diagnose(&campaign, &without).unwrap().diagnosis);
}
