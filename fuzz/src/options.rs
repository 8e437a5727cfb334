//! Options of the command, each run as a process of its own: done, or one line on what is wrong.

use std::path::Path;
use std::process::Command;

use arbitrary::Unstructured;
use host::bench::plan::Static;
use host::error::Error;
use tempfile::TempDir;

use crate::campaign::simulated;
use crate::draw::{below, number, one_in, one_of};
use crate::{Fuzz, Judged};

/// First argument by which this program is the command `vre`.
pub const AS_VRE: &str = "--as-vre";

/// The target, with a sound campaign.
pub struct Options {
    folder: TempDir,
}

/// Commands with options whose values are numbers; `C` is the campaign, `@` a number to be drawn, with a sound one behind it.
const COMMANDS: [&str; 22] = [
    "identify C --prior-sigma @5e-4",
    "identify C --exclude @12",
    "predict C --prior-sigma @5e-4",
    "predict C --vibration sine:@2",
    "predict C --vibration random:@2 --a0 @0.5",
    "predict C --vibration random:1 --direction @1,@0,@0",
    "predict C --vibration random:@1 --limit @5e-5 --risk @0.05",
    "plan paper --vibration random:@1 --dial-sigma @5.8",
    "plan full --vibration sine:@5 --a0 @0.5",
    "plan full --level-sigma @1 --repeat-sigma @1 --mount-sigma @60",
    "plan paper --noise @1.5e-6 --prior-sigma @5e-4",
    "plan full --batch @10 --type-spread @3e-5",
    "plan hand --direction @1,@1,@1 --vibration random:@1 --noise @2e-6",
    "plan C --vibration random:@1",
    "simulate --out O --seed @7 --dial-sigma @1",
    "simulate --out O --effect drift --strength @3",
    "simulate --out O --effect sextic --visibility @30",
    "simulate --out O --imperfection session-bias:@40",
    "simulate --out O --imperfection noise-misstated:@2",
    "simulate --out O --triad --positions @80 --attitude-sigma @10",
    "measure C/static.csv --column u_v --time time_s --scale @1.2 --full-scale @10",
    "measure C/static.csv --column u_v --time time_s --scale @1.2 --temperature temp_c --temperature-sensitivity @1e-5",
];

impl Options {
    pub fn new() -> Result<Self, Error> {
        let folder = TempDir::new().map_err(Error::write(Path::new("a folder")))?;
        simulated(&folder.path().join("C"), 5, Static::Remounted, None)?;
        Ok(Self { folder })
    }

    fn run(&self, line: &str) -> Judged {
        let program = std::env::current_exe().map_err(|error| error.to_string())?;
        let output = Command::new(program)
            .arg(AS_VRE)
            .args(line.split(' '))
            .args(["--json", "answer.json"])
            .current_dir(self.folder.path())
            .output()
            .map_err(|error| error.to_string())?;
        let _ = std::fs::remove_dir_all(self.folder.path().join("O"));
        let (said, told) = (
            String::from_utf8_lossy(&output.stdout),
            String::from_utf8_lossy(&output.stderr),
        );
        let errors = told.lines().filter(|line| !line.starts_with("warning: "));
        let words = said.split(|c: char| !c.is_alphanumeric());
        let absurd = words.into_iter().find(|word| ["NaN", "inf"].contains(word));
        match (output.status.code(), errors.count(), absurd) {
            (Some(0), 0, None) | (Some(2), 1, None) => Ok(()),
            (status, _, absurd) => Err(format!("vre {line}: {status:?}, {absurd:?}: {told}")),
        }
    }
}

impl Fuzz for Options {
    fn input(&mut self, draw: &mut Unstructured<'_>) -> Judged {
        let mut line = String::new();
        // A number stands from behind its sign to the next character that it cannot have.
        let mut rest = *one_of(draw, &COMMANDS);
        while let Some((before, from)) = rest.split_once('@') {
            line += before;
            let end = from.find([' ', ',']).unwrap_or(from.len());
            let sound = &from[..end];
            line += &match one_in(draw, 3) {
                true => sound.to_owned(),
                false => number(draw, sound),
            };
            rest = &from[end..];
        }
        line += rest;
        if below(draw, 20) == 0 {
            line = line.replacen('-', "", 1);
        }
        self.run(&line)
    }

    fn file(&mut self, path: &Path) -> Judged {
        let lines = std::fs::read_to_string(path).map_err(|error| error.to_string())?;
        lines.lines().try_for_each(|line| self.run(line))
    }
}
