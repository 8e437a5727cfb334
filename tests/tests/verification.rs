//! The instrument's self-check and the host's come to the same coefficients from the same frames.

use host::bench::noise::Seed;
use host::bench::plan::Static;
use host::bench::simulate::{Specification, VirtualBench};
use host::capture::capture_virtual;
use host::verification::verify;

#[test]
fn instrument_and_host_agree_on_a_campaign_of_the_virtual_bench()
-> Result<(), Box<dyn std::error::Error>> {
    let specification = Specification::with_dial_sigma(1.0);
    let mut bench = VirtualBench::new(Seed(3), Static::Remounted, specification, Vec::new());
    bench.plan.runs.clear();
    let folder = tempfile::tempdir()?;
    let captured = capture_virtual(&bench, folder.path(), || {})?;
    let found = verify(folder.path())?;
    assert!(found.agrees(), "{found:?}");
    assert_eq!(
        found.instrument.readings as usize,
        captured.campaign.readings.len()
    );
    assert!(found.instrument.verdicts.passed(), "{:?}", found.instrument);
    Ok(())
}
