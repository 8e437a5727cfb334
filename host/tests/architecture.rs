//! The page for the next engineer names what is there.

use std::path::Path;

/// Every word in backquotes, or of an indented line, that looks like a path of this project.
fn paths(text: &str) -> Vec<String> {
    let quoted = text.split('`').skip(1).step_by(2);
    let lines = text.lines().filter(|line| line.starts_with("    "));
    let words = quoted.chain(lines).flat_map(str::split_whitespace);
    let rooms = ["shared", "firmware", "host", "tests", "docs"];
    let path = |word: &str| {
        let word = word.trim_end_matches([',', '.', ';', '/']);
        let first = word.split('/').next()?;
        (rooms.contains(&first) && word.contains('/')).then(|| word.to_owned())
    };
    words.filter_map(path).collect()
}

#[test]
fn every_path_of_the_architecture_page_exists() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).parent().unwrap();
    let page = std::fs::read_to_string(root.join("docs/architecture.md")).unwrap();
    let paths = paths(&page);
    assert!(paths.len() > 30, "{paths:?}");
    for path in paths {
        assert!(root.join(&path).exists(), "{path}");
    }
}

/// The inference depends on no package of the project: that is how it cannot know an effect.
#[test]
fn inference_depends_on_nothing_of_ours() {
    let manifest = Path::new(env!("CARGO_MANIFEST_DIR")).join("inference/Cargo.toml");
    let manifest = std::fs::read_to_string(manifest).unwrap();
    for ours in ["host", "shared", "firmware"] {
        assert!(
            !manifest.lines().any(|line| line.starts_with(ours)),
            "{ours}"
        );
    }
}
