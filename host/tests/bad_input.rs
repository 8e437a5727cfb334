//! The command on spoilt campaigns: it does its work or says in one line what is wrong, and never panics.

mod common;

use std::fs;
use std::path::Path;
use std::process::{Command, Output};

use tempfile::TempDir;

const FILES: [&str; 3] = ["campaign.toml", "static.csv", "vibration.csv"];

fn vre(command: &str, campaign: &Path) -> Output {
    Command::new(env!("CARGO_BIN_EXE_vre"))
        .args([command, "--quiet"])
        .arg(campaign)
        .output()
        .unwrap()
}

/// Exit status 0, or 2 with one line that names a file of the campaign.
fn check_done_or_told(what: &str, output: &Output) {
    let told = String::from_utf8_lossy(&output.stderr);
    assert!(!told.contains("panicked"), "{what}: {told}");
    match output.status.code() {
        Some(0) => {}
        Some(2) => {
            assert_eq!(told.lines().count(), 1, "{what}: {told}");
            assert!(told.starts_with("error: "), "{what}: {told}");
        }
        status => panic!("{what}: exit status {status:?}: {told}"),
    }
}

/// A xorshift generator (Marsaglia 2003).
struct Dice(u64);

impl Dice {
    fn below(&mut self, bound: usize) -> usize {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        (self.0 % bound as u64) as usize
    }
}

/// Flips bits, cuts, repeats and drops lines, drops a column, or puts nonsense into a cell.
fn spoil(content: &[u8], dice: &mut Dice) -> Vec<u8> {
    let mut bytes = content.to_vec();
    let mut lines: Vec<String> = String::from_utf8_lossy(content)
        .lines()
        .map(str::to_owned)
        .collect();
    let line = dice.below(lines.len());
    match dice.below(7) {
        0 => {
            for _ in 0..=dice.below(4) {
                let at = dice.below(bytes.len());
                bytes[at] ^= 1 << dice.below(8);
            }
            return bytes;
        }
        1 => {
            bytes.truncate(dice.below(bytes.len()));
            return bytes;
        }
        2 => {
            let length = lines[line].len();
            lines[line].truncate(dice.below(length.max(1)));
        }
        3 => drop(lines.remove(line)),
        4 => lines.push(lines[line].clone()),
        5 => {
            let column = dice.below(lines[0].split(',').count());
            for line in &mut lines {
                let mut cells: Vec<&str> = line.split(',').collect();
                if column < cells.len() {
                    cells.remove(column);
                }
                *line = cells.join(",");
            }
        }
        _ => {
            let nonsense = [
                "", "NaN", "-inf", "1e999", "-1", "0", "1,5", "\"", "\u{b0}", "=A1", "1e300",
            ];
            let mut cells: Vec<&str> = lines[line].split(',').collect();
            let column = dice.below(cells.len());
            cells[column] = nonsense[dice.below(nonsense.len())];
            lines[line] = cells.join(",");
        }
    }
    lines.join("\n").into_bytes()
}

#[test]
fn a_sound_campaign_is_done() {
    let folder = TempDir::new().unwrap();
    common::campaign().write(folder.path()).unwrap();
    for command in ["identify", "predict"] {
        let output = vre(command, folder.path());
        assert_eq!(output.status.code(), Some(0), "{command}: {output:?}");
    }
}

#[test]
fn any_spoilt_campaign_is_done_or_told_in_one_line() {
    let folder = TempDir::new().unwrap();
    let mut dice = Dice(0x9e37_79b9_7f4a_7c15);
    for round in 0..150 {
        common::campaign().write(folder.path()).unwrap();
        let name = FILES[dice.below(FILES.len())];
        let file = folder.path().join(name);
        let spoilt = spoil(&fs::read(&file).unwrap(), &mut dice);
        fs::write(&file, &spoilt).unwrap();
        let command = ["identify", "predict"][round % 2];
        let what = format!("round {round}, {command}, {name}");
        check_done_or_told(&what, &vre(command, folder.path()));
    }
}

#[test]
fn what_is_no_campaign_is_told_with_its_file() {
    let garbage: Vec<u8> = (0..200_000u32)
        .map(|n| (n.wrapping_mul(2_654_435_761) >> 13) as u8)
        .collect();
    for name in FILES {
        for content in [
            &b""[..],
            b"\n\n",
            b"\xff\xfe\x00",
            &garbage,
            &[b'a'; 3_000_000],
        ] {
            let folder = TempDir::new().unwrap();
            common::campaign().write(folder.path()).unwrap();
            fs::write(folder.path().join(name), content).unwrap();
            let output = vre("predict", folder.path());
            let told = String::from_utf8_lossy(&output.stderr);
            assert_eq!(output.status.code(), Some(2), "{name}: {told}");
            assert!(
                told.lines().count() == 1 && told.contains(name),
                "{name}: {told}"
            );
        }
    }
}

#[test]
fn a_plan_too_small_for_the_model_is_refused() {
    let folder = TempDir::new().unwrap();
    let mut campaign = common::campaign();
    campaign.readings.truncate(10);
    campaign.write(folder.path()).unwrap();
    let output = vre("identify", folder.path());
    assert_eq!(output.status.code(), Some(2), "{output:?}");
    assert_eq!(
        String::from_utf8_lossy(&output.stderr).lines().count(),
        1,
        "{output:?}"
    );
}

/// Numbers that no option can be; each `@` of a line takes them.
const ABSURD: [&str; 6] = ["5e-324", "1e160", "1e300", "-1e300", "NaN", "inf"];

const OPTIONS: [&str; 20] = [
    "identify C --prior-sigma @",
    "predict C --prior-sigma @",
    "predict C --vibration sine:@",
    "predict C --vibration random:@",
    "predict C --vibration random:1 --a0 @",
    "predict C --vibration random:1 --direction @,0,0",
    "predict C --vibration random:1 --limit @",
    "predict C --vibration random:1 --risk @",
    "plan paper --vibration random:@",
    "plan paper --dial-sigma @",
    "plan paper --mount-sigma @",
    "plan paper --noise @",
    "plan paper --a0 @",
    "plan paper --batch 10 --type-spread @",
    "simulate --out O --dial-sigma @",
    "simulate --out O --effect drift --strength @",
    "simulate --out O --effect drift --visibility @",
    "measure C/static.csv --column u_v --time time_s --scale @",
    "measure C/static.csv --column u_v --time time_s --scale 1.2 --full-scale @",
    "measure C/static.csv --column u_v --time time_s --scale 1.2 --temperature-sensitivity @",
];

#[test]
fn no_option_takes_a_number_that_cannot_be() {
    let folder = TempDir::new().unwrap();
    common::campaign().write(&folder.path().join("C")).unwrap();
    for line in OPTIONS {
        for number in ABSURD {
            let line = line.replace('@', number);
            let output = Command::new(env!("CARGO_BIN_EXE_vre"))
                .args(line.split(' '))
                .current_dir(folder.path())
                .output()
                .unwrap();
            let told = String::from_utf8_lossy(&output.stderr);
            assert_eq!(output.status.code(), Some(2), "{line}: {told}");
            assert_eq!(told.lines().count(), 1, "{line}: {told}");
        }
    }
}

#[test]
fn a_diagnosis_with_a_number_that_cannot_be_is_refused() {
    let folder = TempDir::new().unwrap();
    common::campaign().write(folder.path()).unwrap();
    let file = folder.path().join("diagnosis.json");
    let diagnose = Command::new(env!("CARGO_BIN_EXE_vre"))
        .args(["diagnose", "--quiet", "--json"])
        .args([&file, &folder.path().to_path_buf()])
        .output()
        .unwrap();
    assert!(diagnose.status.success(), "{diagnose:?}");
    let sound: serde_json::Value = serde_json::from_slice(&fs::read(&file).unwrap()).unwrap();
    let mut likely = sound.clone();
    likely["gap"]["p_value"] = 2.0.into();
    let mut fitted = sound;
    fitted["which"][0]["effects"] = serde_json::json!(["fixture-resonance"]);
    fitted["which"][0]["fitted"] = serde_json::json!([[1e9, 10.0]]);
    for (changed, named) in [
        (likely, "gap.p_value is 2e0"),
        (fitted, "1e9 is no parameter"),
    ] {
        fs::write(&file, changed.to_string()).unwrap();
        let output = Command::new(env!("CARGO_BIN_EXE_vre"))
            .arg("predict")
            .arg(folder.path())
            .arg("--diagnosis")
            .arg(&file)
            .output()
            .unwrap();
        let told = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(2), "{told}");
        assert!(told.contains(named), "{told}");
    }
}
