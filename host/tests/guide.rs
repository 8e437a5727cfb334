//! The guide: every link of it leads somewhere, generated pages included, and what it tells to type exists.

use std::fs;
use std::path::Path;

use host::handbook::pages;

/// Targets of `[text](target)`.
fn links(text: &str) -> Vec<String> {
    let after = text.split("](").skip(1);
    after
        .filter_map(|rest| Some(rest.split_once(')')?.0.to_owned()))
        .collect()
}

#[test]
fn every_link_of_the_guide_leads_to_a_page_or_a_picture() {
    let source = Path::new(env!("CARGO_MANIFEST_DIR")).join("../docs/guide/src");
    let generated = pages();
    let pictures = host::effects::catalogue().map(|effect| format!("effects/{}.svg", effect.id));
    let made: Vec<String> = generated
        .iter()
        .map(|(name, _)| name.clone())
        .chain(pictures)
        .collect();
    let mut texts: Vec<(String, String)> = Vec::new();
    for entry in fs::read_dir(&source).unwrap() {
        let file = entry.unwrap().path();
        if file.extension().is_some_and(|end| end == "md") {
            texts.push((String::new(), fs::read_to_string(&file).unwrap()));
        }
    }
    assert!(texts.len() > 6);
    texts.extend(
        generated
            .into_iter()
            .map(|(_, text)| ("generated/".to_owned(), text)),
    );
    let mut checked = 0;
    for (folder, text) in &texts {
        for link in links(text) {
            let target = format!("{folder}{link}");
            let there = match target.strip_prefix("generated/") {
                Some(name) => made.iter().any(|made| made == name),
                None => source.join(&target).exists(),
            };
            assert!(there, "{target}");
            checked += 1;
        }
    }
    assert!(checked > 30, "{checked}");
}

#[test]
fn every_option_that_the_guide_names_exists() {
    let source = Path::new(env!("CARGO_MANIFEST_DIR")).join("../docs/guide/src");
    let mut seen = 0;
    for entry in fs::read_dir(source).unwrap() {
        let file = entry.unwrap().path();
        let Ok(text) = fs::read_to_string(&file) else {
            continue;
        };
        for line in text
            .split(['\n', '`'])
            .filter(|line| line.trim().starts_with("vre "))
        {
            let mut words = line.split_whitespace().skip(1);
            let Some(command) = words.next() else {
                continue;
            };
            let options = words.filter(|word| word.starts_with("--"));
            let mut help = assert_cmd::Command::cargo_bin("vre").unwrap();
            let help = help.args(["help", command]).assert().success();
            let help = String::from_utf8_lossy(&help.get_output().stdout).into_owned();
            for option in options {
                assert!(help.contains(option), "{command} {option}");
                seen += 1;
            }
        }
    }
    assert!(seen > 10, "{seen}");
}
