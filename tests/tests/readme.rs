//! The example of the README is what the commands print.

use host::bench::effects;
use host::bench::noise::Seed;
use host::bench::plan::Static;
use host::bench::simulate::{Specification, VirtualBench};
use host::campaign::Campaign;
use host::diagnose::diagnose;
use host::report::diagnosis_text;

const README: &str = include_str!("../../README.md");

#[test]
fn diagnosis_shown_in_the_readme_is_the_one_that_is_printed() {
    let seed = Seed(7);
    let entry = effects::find("fixture-resonance").unwrap();
    let effect = (entry.draw)(1.0, &mut seed.stream("effect", 0));
    let specification = Specification::with_dial_sigma(1.0);
    let bench = VirtualBench::new(seed, Static::Default, specification, vec![effect]);
    // Through the files, as the commands do.
    let folder = tempfile::tempdir().unwrap();
    bench.simulate().campaign.write(folder.path()).unwrap();
    let campaign = Campaign::read(folder.path()).unwrap();
    let printed = diagnosis_text(&diagnose(&campaign, &[]).unwrap().diagnosis);
    for line in printed.lines().filter(|line| !line.trim().is_empty()) {
        assert!(
            README.contains(line.trim()),
            "the README does not show: {line}\n{printed}"
        );
    }
}
