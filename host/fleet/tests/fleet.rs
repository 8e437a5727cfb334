//! The command `vre-fleet` on data sets that it makes itself.

use std::fs;
use std::path::Path;
use std::process::{Command, Output};

use host::bench::noise::Seed;
use host::bench::plant::Plant;
use host::campaign::{Campaign, Record};
use tempfile::TempDir;

/// What a command said, and how it ended.
struct Outcome(Output);

impl Outcome {
    fn code(self, code: i32) -> Self {
        assert_eq!(
            self.0.status.code(),
            Some(code),
            "{}{}",
            self.out(),
            self.err()
        );
        self
    }

    fn success(self) -> Self {
        self.code(0)
    }

    fn out(&self) -> String {
        String::from_utf8(self.0.stdout.clone()).unwrap()
    }

    fn err(&self) -> String {
        String::from_utf8(self.0.stderr.clone()).unwrap()
    }
}

fn fleet(arguments: &[&str]) -> Outcome {
    let command = Command::new(env!("CARGO_BIN_EXE_vre-fleet"))
        .args(arguments)
        .output();
    Outcome(command.unwrap())
}

fn said(outcome: &Outcome) -> String {
    outcome.out()
}

struct Place(TempDir);

impl Place {
    fn new() -> Self {
        Self(tempfile::tempdir().unwrap())
    }

    fn path(&self, name: &str) -> String {
        self.0.path().join(name).to_str().unwrap().into()
    }

    /// A simulated data set.
    fn simulated(&self, instruments: &str, further: &[&str]) -> String {
        let dataset = self.path("dataset");
        let arguments = ["simulate", "--out", &dataset, "--instruments", instruments];
        fleet(&[&arguments, further].concat()).success();
        dataset
    }

    fn json(&self, name: &str) -> serde_json::Value {
        serde_json::from_slice(&fs::read(self.path(name)).unwrap()).unwrap()
    }
}

/// Three campaigns, one with runs, foreign keys and columns, and one that cannot be read.
fn folders(root: &Path) {
    for number in 0..3 {
        let plant = Plant {
            shaken: number == 0,
            ..Plant::new(Seed(7), 5.8)
        };
        let mut campaign = plant.campaign(number).campaign;
        campaign
            .config
            .unknown
            .insert("remark".into(), "kept".into());
        campaign.readings[3].exclude = true;
        campaign.readings[4]
            .unknown
            .push(("colour".into(), "green".into()));
        campaign.readings[5].session = Some("monday".into());
        campaign.write(&root.join(format!("day/{number}"))).unwrap();
    }
    let bad = root.join("day/bad");
    fs::create_dir_all(&bad).unwrap();
    fs::copy(root.join("day/0/campaign.toml"), bad.join("campaign.toml")).unwrap();
    let table = fs::read_to_string(root.join("day/0/static.csv")).unwrap();
    fs::write(bad.join("static.csv"), table.replacen("ccw", "west", 1)).unwrap();
}

#[test]
fn folders_come_back_as_they_were_gathered_and_a_bad_one_is_told_by_its_line() {
    let place = Place::new();
    folders(Path::new(&place.path("in")));
    let (dataset, out) = (place.path("dataset"), place.path("out"));
    let gathered = fleet(&["gather", &place.path("in"), "--out", &dataset]).success();
    assert!(
        said(&gathered).contains("3 campaigns added, 0 replaced, 1 folders not taken"),
        "{}",
        said(&gathered)
    );
    let told = gathered.err();
    assert!(
        told.contains("static.csv, row 2, column approach"),
        "{told}"
    );
    // Again: nothing is there twice.
    let again = fleet(&["gather", &place.path("in"), "--out", &dataset]).success();
    assert!(
        said(&again).contains("0 campaigns added, 3 replaced"),
        "{}",
        said(&again)
    );
    fleet(&["scatter", &dataset, "--out", &out]).success();
    for number in 0..3 {
        let before = Path::new(&place.path("in")).join(format!("day/{number}"));
        let after = Path::new(&out).join(format!("H1/P0000{number}"));
        for table in ["campaign.toml", "static.csv", "vibration.csv"] {
            let read = |folder: &Path| fs::read_to_string(folder.join(table)).ok();
            assert_eq!(read(&before), read(&after), "{number} {table}");
        }
        assert_eq!(
            Campaign::read(&before).unwrap(),
            Campaign::read(&after).unwrap()
        );
    }
}

#[test]
fn functions_of_a_query_answer_as_the_commands_do_and_a_bad_row_is_null_with_a_reason() {
    let place = Place::new();
    let root = place.path("in");
    let plant = Plant {
        shaken: true,
        ..Plant::new(Seed(8), 5.8)
    };
    let mut few = plant.campaign(1).campaign;
    few.readings.truncate(5);
    few.write(&Path::new(&root).join("few")).unwrap();
    let whole = Path::new(&root).join("whole");
    plant.campaign(0).campaign.write(&whole).unwrap();
    let dataset = place.path("dataset");
    fleet(&["gather", &root, "--out", &dataset]).success();
    let sql = "SELECT serial, bench, month, vre_identify(campaign) AS i, vre_predict(campaign, 'random:1') AS p, \
               vre_diagnose(campaign) AS d FROM campaigns ORDER BY serial";
    fleet(&["query", &dataset, sql, "--out", &place.path("answer.json")]).success();
    let answer = place.json("answer.json");
    let campaign = Campaign::read(&whole).unwrap().used();
    let identified = columns::functions::identified(&campaign).unwrap();
    let diagnosed = columns::functions::diagnosed(&campaign).unwrap();
    let (good, bad) = (&answer[0], &answer[1]);
    assert_eq!(
        (&good["bench"], &good["month"]),
        (&"H1".into(), &"2026-01".into())
    );
    assert_eq!(good["i"]["coefficients"], identified["coefficients"]);
    assert_eq!(good["i"]["covariance"], identified["covariance"]);
    assert_eq!(good["i"]["reason"], serde_json::Value::Null);
    assert_eq!(good["d"]["verdict"], diagnosed["verdict"]);
    assert_eq!(good["d"]["gap"], diagnosed["gap"]);
    let sigma = good["p"]["runs"][0]["vre_g"]["sigma"].as_f64().unwrap();
    assert!(sigma > 0.0 && sigma < 1e-3, "{sigma}");
    for function in ["i", "p"] {
        assert_eq!(bad[function]["serial"], serde_json::Value::Null);
        let reason = bad[function]["reason"].as_str().unwrap();
        assert!(reason.contains("5 readings"), "{reason}");
    }
}

#[test]
fn results_go_to_the_terminal_csv_json_and_a_parquet_that_goes_on_where_it_was() {
    let place = Place::new();
    // Two months: three instruments a day.
    let dataset = place.simulated("100", &[]);
    let count = fleet(&["query", &dataset, "SELECT count(*) AS n FROM campaigns"]).success();
    assert!(said(&count).contains("100"), "{}", said(&count));
    let sql = "SELECT serial, month, vre_identify(campaign)['coefficients']['k2_per_g']['value'] AS k2 FROM campaigns";
    let [csv, parquet, all] = ["k2.csv", "k2.parquet", "all.json"].map(|name| place.path(name));
    fleet(&["query", &dataset, sql, "--out", &csv]).success();
    assert_eq!(fs::read_to_string(&csv).unwrap().lines().count(), 101);
    fleet(&["query", &dataset, sql, "--out", &parquet]).success();
    let part = Path::new(&parquet).join("part-H1-2026-01.parquet");
    let made = fs::metadata(&part).unwrap().modified().unwrap();
    let other = Path::new(&parquet).join("part-H1-2026-02.parquet");
    let bytes = fs::read(&other).unwrap();
    fs::remove_file(&other).unwrap();
    fleet(&["query", &dataset, sql, "--out", &parquet]).success();
    assert_eq!(fs::read(&other).unwrap(), bytes);
    assert_eq!(fs::metadata(&part).unwrap().modified().unwrap(), made);
    let changed = fleet(&[
        "query",
        &dataset,
        "SELECT serial FROM campaigns",
        "--out",
        &parquet,
    ])
    .code(2);
    let told = changed.err();
    assert!(told.contains("parts of another query"), "{told}");
    let aggregate = "SELECT vre_bench(campaign) AS head FROM campaigns GROUP BY bench";
    fleet(&["query", &dataset, aggregate, "--out", &all]).success();
    let head = &place.json("all.json")[0]["head"];
    assert_eq!(
        (
            head["campaigns"].as_u64(),
            head["marks"].as_array().map(Vec::len)
        ),
        (Some(100), Some(24))
    );
    let explained = fleet(&["query", &dataset, sql, "--explain"]).success();
    assert!(
        said(&explained).contains("vre_identify"),
        "{}",
        said(&explained)
    );
    let bad = fleet(&["query", &dataset, "SELECT nothing FROM campaigns"]).code(2);
    let told = bad.err();
    assert!(
        told.lines().count() == 1 && told.contains("nothing"),
        "{told}"
    );
}

/// Two commands from folders to a head's map, and a third that uses it.
#[test]
fn a_batch_maps_its_head_and_the_file_serves_a_single_campaign() {
    let place = Place::new();
    let dataset = place.simulated("30", &["--rezero", "12"]);
    let [head, json] = ["head.toml", "report.json"].map(|name| place.path(name));
    let told = fleet(&[
        "bench", &dataset, "--head", "H1", "--out", &head, "--json", &json,
    ])
    .success();
    assert!(said(&told).contains("CHANGED"), "{}", said(&told));
    let report = place.json("report.json");
    assert_eq!(report["stretches"][1]["serial"], "P00012");
    assert_eq!(report["strangers"], serde_json::json!([]));
    // The map against the truth: the marks of the second stretch.
    let plant = Plant {
        rezeroed_before: Some(12),
        ..Plant::new(Seed(1), 5.8)
    };
    let next = plant.campaign(40);
    let known = host::head::HeadFile::read(Path::new(&head)).unwrap();
    let beside = host::head::known(&next.campaign, &known).unwrap();
    assert!(beside.holds(), "{}", beside.log_odds);
    let before = host::head::known(&plant.campaign(3).campaign, &known).unwrap();
    assert!(!before.holds(), "{}", before.log_odds);
    let none = fleet(&["bench", &dataset, "--head", "H9", "--out", &head]).code(2);
    let told = none.err();
    assert!(told.contains("no such bench; there are H1"), "{told}");
}

#[test]
fn instruments_mounted_alike_are_told_to_alternate() {
    let place = Place::new();
    let dataset = place.simulated("20", &["--alike"]);
    let told = fleet(&[
        "bench",
        &dataset,
        "--head",
        "H1",
        "--out",
        &place.path("head.toml"),
    ])
    .success();
    assert!(
        said(&told).contains("Mount every other instrument turned by 180 deg"),
        "{}",
        said(&told)
    );
}

#[test]
fn an_instrument_that_does_not_belong_is_named() {
    let place = Place::new();
    let plant = Plant::new(Seed(2), 5.8);
    for number in 0..20 {
        let mut campaign = plant.campaign(number).campaign;
        if number == 9 {
            // Of another type: a second order of 1e-3 /g more.
            for reading in &mut campaign.readings {
                reading.output_v += 1e-3 * reading.specific_force_g.i.powi(2);
            }
        }
        campaign.config.record = campaign.config.record.map(|record| Record {
            station: Some("B 7".into()),
            ..record
        });
        campaign
            .write(&Path::new(&place.path("in")).join(number.to_string()))
            .unwrap();
    }
    let dataset = place.path("dataset");
    fleet(&["gather", &place.path("in"), "--out", &dataset]).success();
    let told = fleet(&[
        "bench",
        &dataset,
        "--head",
        "B_7",
        "--out",
        &place.path("head.toml"),
    ])
    .success();
    let strangers: Vec<String> = said(&told)
        .lines()
        .filter(|line| line.starts_with("DOES NOT BELONG"))
        .map(str::to_owned)
        .collect();
    assert!(
        strangers.len() == 1 && strangers[0].contains("P00009"),
        "{}",
        said(&told)
    );
}

/// The same resonance in all campaigns of one of two benches, by diagnoses of what the bench makes of it.
#[test]
fn a_resonance_that_all_instruments_of_a_bench_have_is_the_benchs() {
    let place = Place::new();
    let plant = Plant {
        shaken: true,
        alternate: false,
        ..Plant::new(Seed(6), 1.0)
    };
    let resonance = host::bench::effects::find("fixture-resonance").unwrap();
    for number in 0..12 {
        let mut bench = plant.bench(number);
        let on_second = number % 2 == 1;
        if on_second {
            let drawn = (resonance.draw)(1.0, &mut Seed(3).stream("effect", 0));
            bench.effects.push(drawn);
        }
        let mut campaign = bench.simulate().campaign;
        campaign.config.instrument.serial = format!("P{number:05}");
        campaign.config.record = Some(Record {
            station: Some(if on_second { "H2" } else { "H1" }.into()),
            ..Record::default()
        });
        let folder = Path::new(&place.path("in")).join(number.to_string());
        campaign.write(&folder).unwrap();
    }
    let (dataset, json) = (place.path("dataset"), place.path("sides.json"));
    fleet(&["gather", &place.path("in"), "--out", &dataset]).success();
    fleet(&["sides", &dataset, "--json", &json]).success();
    let told = &place.json("sides.json")["effects"][0];
    assert_eq!(told["effect"], "fixture-resonance", "{told}");
    assert!(told["sides"]["bench"].as_f64().unwrap() > 0.95, "{told}");
}

#[test]
fn bad_use_is_one_line_and_exit_status_2() {
    let place = Place::new();
    let (empty, out) = (place.path("empty"), place.path("out"));
    fs::create_dir_all(&empty).unwrap();
    for arguments in [
        vec!["gather", &empty, "--out", &out],
        vec!["gather", "nowhere", "--out", &out],
        vec!["query", &empty, "SELECT 1"],
        vec!["scatter", &empty, "--out", &out],
        vec!["bench", &empty, "--head", "H1"],
        vec!["simulate", "--out", &out, "--dial-sigma", "-1"],
        vec!["something"],
    ] {
        let told = fleet(&arguments).code(2);
        let told = told.err();
        assert_eq!(told.lines().count(), 1, "{arguments:?}: {told}");
    }
}
