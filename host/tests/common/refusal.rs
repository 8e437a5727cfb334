//! The command where it must refuse.

use assert_cmd::Command;

/// Runs the command, which must refuse in one line.
pub fn refused(arguments: &[&str]) -> String {
    let mut command = Command::cargo_bin("vre").unwrap();
    let assert = command.args(arguments).assert().code(2);
    let told = String::from_utf8(assert.get_output().stderr.clone()).unwrap();
    assert_eq!(told.lines().count(), 1, "{told}");
    told
}
