//! Contradictions within a campaign are named with their reason, and a sound campaign has none.

mod common;

use std::process::{Command, Output};

use host::bench::effects;
use host::bench::noise::Seed;
use host::bench::plan::Static;
use host::bench::simulate::{Specification, VirtualBench};
use host::campaign::{Campaign, Extremes, Run, VibrationKind};
use host::contradictions::{Contradiction, Rows, contradictions, impossible, slip, slip_of_run};
use host::prediction::sensitivity;
use shared::model::{Coefficients, SpecificForce};

fn bench(seed: u64, effect: Option<(&str, f64)>) -> VirtualBench {
    let seed = Seed(seed);
    let drawn = effect.map(|(id, strength)| {
        let mut stream = seed.stream("effect", 0);
        (effects::find(id).unwrap().draw)(strength, &mut stream)
    });
    let specification = Specification::with_dial_sigma(1.0);
    VirtualBench::new(
        seed,
        Static::Default,
        specification,
        drawn.into_iter().collect(),
    )
}

fn sound(seed: u64) -> Campaign {
    bench(seed, None).simulate().campaign
}

/// The only contradiction, in three campaigns that are spoilt alike.
fn only(spoil: impl Fn(&mut Campaign)) -> Contradiction {
    let mut found: Vec<Contradiction> = (1..4)
        .map(|seed| {
            let mut campaign = sound(seed);
            spoil(&mut campaign);
            let found = contradictions(&campaign);
            assert_eq!(found.len(), 1, "seed {seed}: {found:#?}");
            found[0].clone()
        })
        .collect();
    let last = found.pop().unwrap();
    for other in found {
        assert_eq!((&other.rows, &other.likely), (&last.rows, &last.likely));
    }
    last
}

fn check(found: &Contradiction, between: [&str; 2], factor: f64, rows: &Rows, likely: &str) {
    assert_eq!(found.between, between, "{found}");
    assert!((found.factor / factor - 1.0).abs() < 5e-3, "{found}");
    assert_eq!(&found.rows, rows, "{found}");
    assert_eq!(found.likely, likely, "{found}");
}

fn all(words: &str) -> Rows {
    Rows::All(words.into())
}

const COMMAND_AND_REFERENCE: [&str; 2] = ["level_g", "ref_*_rms_g"];

fn scale_levels(campaign: &mut Campaign, factor: f64, kind: Option<VibrationKind>) {
    for run in &mut campaign.runs {
        if kind.is_none_or(|kind| kind == run.kind) {
            run.level_g *= factor;
        }
    }
}

#[test]
fn a_sound_campaign_has_no_contradiction_whatever_effect_acts() {
    let mut campaigns = 0;
    for entry in effects::catalogue() {
        for strength in [1.0, 3.0] {
            for seed in 100..104 {
                let mut campaign = bench(seed, Some((entry.id, strength))).simulate().campaign;
                assert_eq!(
                    impossible(&campaign),
                    None,
                    "{} {strength} {seed}",
                    entry.id
                );
                let found = contradictions(&campaign);
                assert_eq!(found, [], "{} {strength} {seed}", entry.id);
                for run in &mut campaign.runs {
                    run.reference = None;
                }
                let found = contradictions(&campaign);
                assert_eq!(found, [], "{} {strength} {seed}, no reference", entry.id);
                campaigns += 1;
            }
        }
    }
    assert!(campaigns >= 200, "{campaigns}");
}

#[test]
fn gains_of_a_reference_and_of_a_peak_detector_within_two_per_cent_contradict_nothing() {
    for seed in 0..20 {
        let mut campaign = bench(seed, Some(("shaker-distortion", 3.0)))
            .simulate()
            .campaign;
        for run in &mut campaign.runs {
            let seen = run.reference.as_mut().unwrap();
            for (rms_g, gain) in seen.rms_g.iter_mut().zip([1.02, 0.98, 1.02]) {
                *rms_g *= gain;
            }
            let extremes = run.measured.as_mut().unwrap().extremes.as_mut().unwrap();
            extremes.maximum_v *= 1.02;
            extremes.minimum_v *= 1.02;
        }
        assert_eq!(contradictions(&campaign), [], "seed {seed}");
    }
}

#[test]
fn a_campaign_of_few_runs_has_no_contradiction() {
    for seed in 0..10 {
        for id in [
            "saturation",
            "fixture-resonance",
            "shaker-transverse",
            "reference-scale",
        ] {
            let whole = bench(seed, Some((id, 3.0))).simulate().campaign;
            for count in [1, 2, 3, 6, 12] {
                for first in [0, 20, 60] {
                    let runs = whole.runs[first..first + count].to_vec();
                    let campaign = Campaign {
                        runs,
                        ..whole.clone()
                    };
                    assert_eq!(contradictions(&campaign), [], "{id} {seed} {count} {first}");
                }
            }
        }
    }
}

#[test]
fn rms_entered_for_peak_is_named_with_its_factor() {
    let sine = Some(VibrationKind::Sine);
    let half = std::f64::consts::FRAC_1_SQRT_2;
    let found = only(|campaign| scale_levels(campaign, half, sine));
    let likely = "rms entered for peak in level_g";
    check(
        &found,
        COMMAND_AND_REFERENCE,
        half,
        &all("all sines"),
        likely,
    );
    assert_eq!(
        serde_json::to_value(&found).unwrap()["rows"],
        serde_json::json!("all sines")
    );
}

#[test]
fn levels_in_another_unit_are_told_from_a_reference_in_another_unit_by_the_extremes() {
    let found = only(|campaign| scale_levels(campaign, 9.80665, None));
    let likely = "m/s^2 entered for g in level_g";
    check(
        &found,
        COMMAND_AND_REFERENCE,
        9.80665,
        &all("all runs"),
        likely,
    );

    let found = only(|campaign| {
        for run in &mut campaign.runs {
            let seen = run.reference.as_mut().unwrap();
            seen.rms_g = seen.rms_g.map(|rms_g| rms_g * 9.80665);
        }
    });
    let likely = "m/s^2 entered for g in ref_*_rms_g";
    check(
        &found,
        COMMAND_AND_REFERENCE,
        1.0 / 9.80665,
        &all("all runs"),
        likely,
    );

    let sine = Some(VibrationKind::Sine);
    let found = only(|campaign| scale_levels(campaign, 2.0, sine));
    let likely = "peak to peak entered for peak in level_g";
    check(
        &found,
        COMMAND_AND_REFERENCE,
        2.0,
        &all("all sines"),
        likely,
    );

    let found = only(|campaign| scale_levels(campaign, 1.3, sine));
    let likely = "level_g is in another unit or scale";
    check(
        &found,
        COMMAND_AND_REFERENCE,
        1.3,
        &all("all sines"),
        likely,
    );
}

#[test]
fn without_a_reference_the_extremes_tell_all_levels_and_single_ones() {
    let unseen = |campaign: &mut Campaign| {
        for run in &mut campaign.runs {
            run.reference = None;
        }
    };
    let half = std::f64::consts::FRAC_1_SQRT_2;
    let found = only(|campaign| {
        unseen(campaign);
        scale_levels(campaign, half, Some(VibrationKind::Sine));
    });
    check(
        &found,
        ["level_g", "u_max_v"],
        half,
        &all("all sines"),
        "rms entered for peak in level_g",
    );
    for seed in 1..4 {
        let mut campaign = sound(seed);
        unseen(&mut campaign);
        let place = place_of(&campaign, |run| is_sine_along_ia(run, 60.0, 2.0));
        campaign.runs[place].level_g = 20.0;
        let found = contradictions(&campaign);
        assert_eq!(found.len(), 1, "{found:?}");
        assert_eq!(found[0].places(&campaign.runs), [place]);
        assert_eq!(found[0].likely, "decimal point: level_g 2 instead of 20");
    }
}

fn is_sine_along_ia(run: &Run, frequency_hz: f64, level_g: f64) -> bool {
    run.kind == VibrationKind::Sine
        && run.direction[0] == 1.0
        && run.band_hz[0] == frequency_hz
        && run.level_g == level_g
}

fn place_of(campaign: &Campaign, is: impl Fn(&Run) -> bool) -> usize {
    campaign.runs.iter().position(is).unwrap()
}

#[test]
fn one_mistyped_level_is_named_with_the_level_that_would_agree() {
    for (holds, likely) in [
        (20.0, "decimal point: level_g 2 instead of 20"),
        (3.0, "level_g 2 instead of 3"),
        (0.2, "decimal point: level_g 2 instead of 0.2"),
    ] {
        for seed in 1..4 {
            let mut campaign = sound(seed);
            let place = place_of(&campaign, |run| is_sine_along_ia(run, 480.0, 2.0));
            campaign.runs[place].level_g = holds;
            let found = contradictions(&campaign);
            assert_eq!(found.len(), 1, "{found:?}");
            assert_eq!(found[0].places(&campaign.runs), [place]);
            let rows = Rows::Some(vec![campaign.runs[place].run]);
            check(&found[0], COMMAND_AND_REFERENCE, holds / 2.0, &rows, likely);
        }
    }
}

#[test]
fn one_mistyped_cell_of_the_reference_is_told_from_a_mistyped_level() {
    for seed in 1..4 {
        let mut campaign = sound(seed);
        let place = place_of(&campaign, |run| is_sine_along_ia(run, 480.0, 2.0));
        let seen = campaign.runs[place].reference.as_mut().unwrap();
        seen.rms_g[0] = 14.14;
        let found = contradictions(&campaign);
        assert_eq!(found.len(), 1, "{found:?}");
        let likely = "decimal point: ref_i_rms_g 1.41 instead of 14.14";
        assert_eq!(found[0].likely, likely);
        assert_eq!(found[0].places(&campaign.runs), [place]);
    }
}

#[test]
fn a_channel_of_the_reference_in_another_scale_is_named() {
    let found = only(|campaign| {
        for run in &mut campaign.runs {
            run.reference.as_mut().unwrap().rms_g[1] *= 2.0;
        }
    });
    let between = ["level_g", "ref_p_rms_g"];
    assert_eq!(
        (&found.between, &found.rows),
        (&between.map(String::from), &all("all runs along PA"))
    );
    assert!((found.factor / 0.5 - 1.0).abs() < 5e-3, "{found}");
}

#[test]
fn a_zero_reference_on_a_driven_axis_is_impossible_and_on_one_at_rest_is_not() {
    let mut campaign = sound(1);
    assert_eq!(impossible(&campaign), None);
    campaign.runs[7].reference.as_mut().unwrap().rms_g = [0.0; 3];
    let cell = impossible(&campaign).unwrap();
    assert_eq!(cell.place, 7);
    assert!(cell.column.ends_with("_rms_g"));
    let expected = "reference 0 on a driven axis: leave the cell empty where nothing was measured";
    assert_eq!(cell.problem, expected);
}

#[test]
fn extremes_beyond_the_mean_are_impossible() {
    let campaign = sound(2);
    let place = place_of(&campaign, |run| is_sine_along_ia(run, 60.0, 2.0));
    let with = |extremes: Extremes| {
        let mut campaign = campaign.clone();
        campaign.runs[place].measured.as_mut().unwrap().extremes = Some(extremes);
        impossible(&campaign).map(|cell| (cell.place, cell.column))
    };
    let mean_v = campaign.runs[place].measured.unwrap().during_v;
    let of = |below_v, above_v| Extremes {
        minimum_v: mean_v + below_v,
        maximum_v: mean_v + above_v,
    };
    assert_eq!(with(of(1.5, 4.0)), Some((place, "u_min_v")));
    assert_eq!(with(of(-4.0, -1.5)), Some((place, "u_max_v")));
    assert_eq!(with(of(0.0, 0.0)), Some((place, "u_max_v")));
    assert_eq!(with(of(-4.0, 4.0)), None);
}

#[test]
fn the_mean_of_a_column_in_place_of_measurements_is_named() {
    let found = only(|campaign| {
        for run in &mut campaign.runs {
            run.measured.as_mut().unwrap().extremes = Some(Extremes {
                minimum_v: -2.5,
                maximum_v: 2.5,
            });
        }
    });
    assert_eq!(
        (&found.between[1][..], &found.rows),
        ("u_max_v", &all("all runs"))
    );
    assert!(found.likely.contains("an average perhaps"), "{found}");

    let mut campaign = sound(3);
    let mut places = [(60.0, 2.0), (480.0, 5.0), (60.0, 4.0)]
        .map(|(hz, level_g)| place_of(&campaign, |run| is_sine_along_ia(run, hz, level_g)));
    places.sort_unstable();
    for place in places {
        campaign.runs[place].reference.as_mut().unwrap().rms_g = [1.25, 0.5, 0.5];
    }
    let found = contradictions(&campaign);
    assert_eq!(found.len(), 1, "{found:?}");
    assert_eq!(found[0].places(&campaign.runs), places);
}

#[test]
fn a_reversed_channel_of_the_reference_is_named() {
    for (reversed, name) in [([0, 1], "I"), ([0, 2], "P"), ([1, 2], "O")] {
        let found = only(|campaign| {
            for run in &mut campaign.runs {
                let correlation = run
                    .reference
                    .as_mut()
                    .unwrap()
                    .correlation
                    .as_mut()
                    .unwrap();
                for at in reversed {
                    correlation[at] *= -1.0;
                }
            }
        });
        assert_eq!(found.factor, -1.0);
        assert!(found.is_of_all());
        let words = format!("the reference's {name} channel is reversed");
        assert!(found.likely.starts_with(&words), "{found}");
    }
}

#[test]
fn one_mistyped_sign_of_a_direction_is_named_by_its_run_and_a_sign_of_all_axes_changes_nothing() {
    let along = |run: &Run| run.direction[0] * run.direction[1] != 0.0;
    for seed in 1..4 {
        let mut campaign = sound(seed);
        let place = place_of(&campaign, along);
        campaign.runs[place].direction[1] *= -1.0;
        let found = contradictions(&campaign);
        assert_eq!(found.len(), 1, "{found:?}");
        assert_eq!(found[0].places(&campaign.runs), [place]);
        assert_eq!(found[0].likely, "the sign of dir_i or dir_p is mistyped");

        let mut campaign = sound(seed);
        for run in &mut campaign.runs {
            run.direction = run.direction.map(|n| -n);
        }
        assert_eq!(contradictions(&campaign), []);
    }
    let found = only(|campaign| {
        for run in &mut campaign.runs {
            if along(run) {
                run.direction[1] *= -1.0;
            }
        }
    });
    assert_eq!(found.rows, all("all runs along IA and PA"));
    assert_eq!(
        found.likely,
        "the sign of dir_i or dir_p is wrong in all these runs"
    );
}

#[test]
fn gravity_of_another_length_and_levels_all_beyond_the_full_scale_are_named() {
    let found = only(|campaign| {
        for run in &mut campaign.runs {
            let force = run.specific_force_g;
            run.specific_force_g =
                SpecificForce::new(force.i * 9.80665, force.p * 9.80665, force.o * 9.80665);
        }
        // The plateaus before the runs are over the same wrong force.
        campaign.runs.iter_mut().for_each(|run| run.measured = None);
    });
    let likely = "m/s^2 entered for g in a0_*_g";
    check(
        &found,
        ["a0_*_g", "local_gravity_g"],
        9.80665,
        &all("all runs"),
        likely,
    );

    let found = only(|campaign| {
        campaign.config.instrument.full_scale_g = 0.01;
        campaign.runs.retain(|run| run.direction[0] == 1.0);
    });
    assert_eq!(found.between, ["level_g", "full_scale_g"]);
}

#[test]
fn an_excluded_run_contradicts_nothing() {
    let mut campaign = sound(5);
    campaign.runs[3].level_g *= 10.0;
    assert_eq!(contradictions(&campaign).len(), 1);
    campaign.runs[3].exclude = true;
    assert_eq!(contradictions(&campaign), []);
}

/// What reading a campaign says after all outputs at rest were multiplied, in `static.csv` or in `vibration.csv`.
fn read_with(factors: [f64; 2], row: Option<usize>) -> Result<Campaign, String> {
    let mut campaign = sound(7);
    let [of_readings, of_runs] = factors;
    for (place, reading) in campaign.readings.iter_mut().enumerate() {
        if row.is_none_or(|row| row == place) {
            reading.output_v *= of_readings;
        }
    }
    for (place, run) in campaign.runs.iter_mut().enumerate() {
        if row.is_none_or(|row| row == place) {
            run.measured.as_mut().unwrap().before_v *= of_runs;
        }
    }
    let folder = tempfile::tempdir().unwrap();
    campaign.write(folder.path()).unwrap();
    Campaign::read(folder.path()).map_err(|error| error.to_string())
}

#[test]
fn outputs_that_are_all_in_another_unit_are_refused_and_single_ones_are_read() {
    for (factors, column) in [
        ([1000.0, 1.0], "static.csv, column u_v"),
        ([1.0, -1.0], "vibration.csv, column u_before_v"),
    ] {
        let told = read_with(factors, None).unwrap_err();
        assert!(told.contains(column), "{told}");
        assert!(
            told.contains("another instrument, or another unit?"),
            "{told}"
        );
        assert!(read_with(factors, Some(5)).is_ok());
    }
    assert!(read_with([1.0, 1.0], None).is_ok());
}

/// The slip that is found in a reading, with the bench's own coefficients as the model.
fn found_slip(seed: u64, place: usize, spoil: impl Fn(&mut Campaign)) -> Option<String> {
    let simulation = bench(seed, None).simulate();
    let coefficients = Coefficients::from_nominal(simulation.truth.coefficients);
    let mut campaign = simulation.campaign;
    spoil(&mut campaign);
    // Dial marks of 1 arcsec, and mounts of 60 arcsec, move an output by up to 0.3 mg.
    let sigma_v = 3e-4 * coefficients.scale_factor_v_per_g;
    slip(
        &campaign,
        place,
        &|force| coefficients.output_v(force),
        sigma_v,
    )
}

/// Types another dial angle, with the specific force that belongs to it.
fn type_dial(campaign: &mut Campaign, place: usize, dial_deg: f64) {
    let reading = &mut campaign.readings[place];
    reading.dial_deg = dial_deg;
    let instrument_deg = dial_deg + reading.mount_deg;
    reading.specific_force_g = reading.series.specific_force(instrument_deg.to_radians());
}

#[test]
fn a_slip_in_a_reading_is_told_in_words() {
    let campaign = sound(1);
    let place = campaign
        .readings
        .iter()
        .position(|r| r.dial_deg == 135.0)
        .unwrap();
    let row = place + 2;
    let other = place + 1;
    for seed in 1..6 {
        let told = |spoil: &dyn Fn(&mut Campaign)| found_slip(seed, place, spoil);
        assert_eq!(told(&|_| {}), None);
        let words = |words: &str| Some(words.to_owned());
        assert_eq!(
            told(&|c| type_dial(c, place, 153.0)),
            words("dial_deg 135 instead of 153")
        );
        assert_eq!(
            told(&|c| type_dial(c, place, 315.0)),
            words("dial_deg 135 instead of 315")
        );
        assert_eq!(
            told(&|c| type_dial(c, place, 137.0)),
            words("dial_deg 135 instead of 137")
        );
        let swapped = told(&|c| {
            let one = c.readings[place].output_v;
            c.readings[place].output_v = c.readings[other].output_v;
            c.readings[other].output_v = one;
        });
        assert_eq!(swapped, Some(format!("rows {row} and {} swapped", row + 1)));
        assert_eq!(
            told(&|c| c.readings[place].output_v *= 10.0),
            words("u_v ten times too large")
        );
        assert_eq!(
            told(&|c| c.readings[place].output_v += 2e-2),
            None,
            "seed {seed}: nothing that a hand does"
        );
    }
}

#[test]
fn a_slip_in_a_run_is_told_in_words() {
    for seed in 1..6 {
        let simulation = bench(seed, None).simulate();
        let coefficients = Coefficients::from_nominal(simulation.truth.coefficients);
        let k1 = coefficients.scale_factor_v_per_g;
        let shift_v = |run: &Run| k1 * sensitivity(run).vre_g(&coefficients);
        let sigma_v = 3e-6 * k1;
        let campaign = simulation.campaign;
        let place = place_of(&campaign, |run| is_sine_along_ia(run, 60.0, 4.0));
        let told = |spoil: &dyn Fn(&mut Campaign)| {
            let mut campaign = campaign.clone();
            spoil(&mut campaign);
            slip_of_run(&campaign, place, &shift_v, sigma_v)
        };
        assert_eq!(told(&|_| {}), None);
        let level = told(&|c| c.runs[place].level_g = 40.0);
        assert_eq!(level.as_deref(), Some("level_g 4 instead of 40"));
        let other = place_of(&campaign, |run| is_sine_along_ia(run, 480.0, 6.0));
        let swapped = told(&|c| {
            let one = c.runs[place].measured;
            c.runs[place].measured = c.runs[other].measured;
            c.runs[other].measured = one;
        });
        let rows = [place.min(other) + 2, place.max(other) + 2];
        assert_eq!(
            swapped,
            Some(format!("rows {} and {} swapped", rows[0], rows[1]))
        );
    }
}

fn vre(arguments: &[&str], campaign: &Campaign) -> (Output, tempfile::TempDir) {
    let folder = tempfile::tempdir().unwrap();
    campaign.write(folder.path()).unwrap();
    let (command, options) = arguments.split_first().unwrap();
    let output = Command::new(env!("CARGO_BIN_EXE_vre"))
        .args([*command, "--quiet"])
        .arg(folder.path())
        .args(options)
        .output()
        .unwrap();
    (output, folder)
}

#[test]
fn diagnose_and_predict_refuse_what_contradicts_everywhere_unless_it_is_accepted() {
    let mut campaign = sound(6);
    scale_levels(&mut campaign, 9.80665, None);
    for command in ["diagnose", "predict"] {
        let (output, _folder) = vre(&[command], &campaign);
        assert_eq!(output.status.code(), Some(2), "{command}");
        let told = String::from_utf8(output.stderr).unwrap();
        assert_eq!(told.lines().count(), 1, "{told}");
        for words in [
            "vibration.csv, column level_g",
            "ref_*_rms_g",
            "9.8",
            "m/s^2 entered for g",
            "--accept-contradictions",
        ] {
            assert!(told.contains(words), "{command}: {told}");
        }
    }
    let (output, _folder) = vre(&["predict", "--accept-contradictions"], &campaign);
    assert_eq!(output.status.code(), Some(0), "{output:?}");
}

#[test]
fn a_zero_reference_is_refused_with_row_and_column_even_where_contradictions_are_accepted() {
    let mut campaign = common::campaign();
    campaign.runs[1].reference.as_mut().unwrap().rms_g[0] = 0.0;
    let (output, _folder) = vre(&["predict", "--accept-contradictions"], &campaign);
    assert_eq!(output.status.code(), Some(2));
    let told = String::from_utf8(output.stderr).unwrap();
    let expected = "vibration.csv, row 3, column ref_i_rms_g: reference 0 on a driven axis";
    assert!(told.contains(expected), "{told}");
}
