//! The command as a user runs it.

use std::fs;

use assert_cmd::Command;
use serde_json::Value;

/// Runs the command; its text and its JSON.
pub fn vre(arguments: &[&str]) -> (String, Value) {
    let folder = tempfile::tempdir().unwrap();
    let json = folder.path().join("result.json");
    let mut command = Command::cargo_bin("vre").unwrap();
    let assert = command.args(arguments).arg("--json").arg(&json).assert();
    let text = String::from_utf8(assert.success().get_output().stdout.clone()).unwrap();
    (
        text,
        serde_json::from_slice(&fs::read(json).unwrap()).unwrap(),
    )
}
