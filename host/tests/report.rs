//! The report: written whole, well-formed, honest about what is missing.

mod common;

use std::fs;

use host::campaign::{Campaign, Reading, Series};
use sha2::{Digest, Sha256};

use host::report::{self, Report, Severity, Supplement};

/// The common campaign with the paper's 24 positions only.
fn paper_plan() -> Campaign {
    let mut campaign = common::campaign();
    campaign
        .readings
        .retain(|reading| reading.dial_deg % 45.0 == 0.0);
    campaign
}

fn page(campaign: &Campaign) -> String {
    let folder = tempfile::tempdir().unwrap();
    report::write(campaign, Supplement::default(), folder.path()).unwrap();
    fs::read_to_string(folder.path().join("report.html")).unwrap()
}

/// The text between tags, and the tags' attributes, of a page; panics unless every tag that is opened is closed in order.
fn parsed(page: &str) -> (Vec<String>, Vec<String>) {
    const VOID: [&str; 2] = ["meta", "!DOCTYPE"];
    let (mut open, mut texts, mut tags) = (Vec::new(), Vec::new(), Vec::new());
    let mut rest = page;
    while let Some((text, tail)) = rest.split_once('<') {
        texts.push(text.to_owned());
        let (tag, tail) = tail.split_once('>').expect("a tag that ends");
        rest = tail;
        tags.push(tag.to_owned());
        if let Some(name) = tag.strip_prefix('/') {
            assert_eq!(open.pop().as_deref(), Some(name), "closed out of order");
        } else if !tag.ends_with('/') {
            let name = tag.split_whitespace().next().unwrap_or_default();
            if !VOID.contains(&name) {
                open.push(name.to_owned());
            }
        }
    }
    assert!(open.is_empty(), "never closed: {open:?}");
    (texts, tags)
}

fn words(text: &str) -> impl Iterator<Item = &str> {
    text.split(|c: char| !c.is_ascii_alphabetic())
}

#[test]
fn page_is_well_formed_without_malformed_numbers_or_outside_resources() {
    let mut without_runs = common::campaign();
    without_runs.runs.clear();
    let mut at_rest = common::campaign();
    at_rest.runs.iter_mut().for_each(|run| run.level_g = 0.0);
    let mut odd_name = common::campaign();
    odd_name.config.instrument.serial = "<b>&\"A".into();
    for campaign in [
        common::campaign(),
        paper_plan(),
        without_runs,
        at_rest,
        odd_name,
    ] {
        let page = page(&campaign);
        let (texts, tags) = parsed(&page);
        for text in texts.iter().chain(&tags) {
            assert!(
                !words(text).any(|word| ["NaN", "inf", "infinity"].contains(&word)),
                "{text}"
            );
        }
        for outside in ["http://", "https://", "<script", "<link", "@import", "url("] {
            let found = page.replace("http://www.w3.org/2000/svg", "");
            assert!(!found.contains(outside), "{outside}");
        }
    }
}

#[test]
fn blind_plan_is_the_first_warning_and_a_full_one_gives_none() {
    let blind = page(&paper_plan());
    assert!(blind.contains("Warning: The plan is blind: rank 10 of 11"));
    let campaign = common::campaign();
    assert!(!page(&campaign).contains("The plan is blind"));
    let deficient = paper_plan();
    let report = Report::new(&deficient).unwrap();
    assert_eq!(report.remarks[0].severity, Severity::Warning);
    assert!(report::text::summary(&report).contains("WARNING: The plan is blind"));
}

#[test]
fn direction_of_the_papers_plan_is_the_blind_one_of_theory() {
    let campaign = paper_plan();
    let direction = Report::new(&campaign).unwrap().direction;
    assert!(direction.blind);
    for (k, expected) in [(2, -0.4459), (3, 0.8153), (5, -0.3694)] {
        assert!((direction.components[k] - expected).abs() < 1e-4);
    }
    assert!((direction.vre_g_per_unit.abs() - 0.65).abs() < 0.01);
}

#[test]
fn readings_that_scatter_too_much_or_too_little_are_told() {
    let headings = |campaign: &Campaign| -> Vec<String> {
        Report::new(campaign)
            .unwrap()
            .remarks
            .into_iter()
            .map(|remark| remark.heading)
            .collect()
    };
    // Perfect readings scatter less than any stated uncertainty.
    let told = headings(&common::campaign());
    assert!(
        told.iter().any(|heading| heading.contains("scatter less")),
        "{told:?}"
    );
    let mut moved = common::campaign();
    let jump = |reading: &mut Reading| {
        if reading.series == Series::InputAxis && reading.dial_deg > 150.0 {
            reading.output_v += 1e-3;
        }
    };
    moved.readings.iter_mut().for_each(jump);
    let told = headings(&moved);
    assert!(
        told.iter().any(|heading| heading.contains("scatter more")),
        "{told:?}"
    );
}

#[test]
fn run_far_from_its_prediction_is_named() {
    let mut campaign = common::campaign();
    if let Some(measured) = &mut campaign.runs[1].measured {
        measured.during_v += 0.1;
    }
    let report = Report::new(&campaign).unwrap();
    let remark = report
        .remarks
        .iter()
        .find(|remark| remark.heading.contains("do not agree"))
        .unwrap();
    assert_eq!(remark.severity, Severity::Warning);
    assert!(remark.text.contains("run 1 most of all"), "{}", remark.text);
}

#[test]
fn campaign_without_shaker_runs_gives_a_page_that_says_so() {
    let mut campaign = common::campaign();
    campaign.runs.clear();
    let page = page(&campaign);
    assert!(page.contains("No measured shaker run"));
    assert!(page.contains("Missing: a vibration.csv"));
}

#[test]
fn all_files_are_written_and_json_names_its_format() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("new/report");
    report::write(&common::campaign(), Supplement::default(), &out).unwrap();
    for (file, format) in [
        ("identification.json", "vre-identification/1"),
        ("prediction.json", "vre-prediction/1"),
    ] {
        let text = fs::read_to_string(out.join(file)).unwrap();
        let json: serde_json::Value = serde_json::from_str(&text).unwrap();
        assert_eq!(json["format"], format);
    }
    assert!(out.join("report.html").is_file());
}

#[test]
fn the_head_is_a_certificate_with_hashes_and_a_verdict() {
    let folder = tempfile::tempdir().unwrap();
    let mut campaign = common::campaign();
    campaign.write(folder.path()).unwrap();
    let certificate = |campaign: &Campaign| {
        campaign.write(folder.path()).unwrap();
        let out = folder.path().join("report");
        let supplement = Supplement {
            folder: Some(folder.path()),
            study: None,
        };
        report::write(campaign, supplement, &out).unwrap();
        fs::read_to_string(out.join("report.html")).unwrap()
    };
    let bare = certificate(&campaign);
    assert!(bare.contains("Operator</th><td>not stated"), "{bare}");
    assert!(bare.contains("Limit of the vibration error</th><td>not stated"));
    let table = fs::read(folder.path().join("static.csv")).unwrap();
    let hash: String = Sha256::digest(&table)
        .iter()
        .map(|b| format!("{b:02x}"))
        .collect();
    assert!(bare.contains(&hash));
    for (limit_g, verdict) in [(1.0, "pass"), (1e-9, "fail")] {
        let limits = format!("vre_g = {limit_g}\nenvironment = \"random:2\"");
        campaign.config.limits = Some(toml::from_str(&limits).unwrap());
        campaign.config.record =
            Some(toml::from_str("operator = \"N. N.\"\ndate = 2026-05-14").unwrap());
        let page = certificate(&campaign);
        assert!(
            page.contains(&format!("class=\"verdict {verdict}\"")),
            "{verdict}"
        );
        assert!(page.contains("N. N.") && page.contains("2026-05-14"));
    }
    campaign.config.limits = Some(toml::from_str("vre_g = 1\nenvironment = \"a lorry\"").unwrap());
    assert!(certificate(&campaign).contains("not judged"));
}

/// Contents lead to sections that are there, marks tell their run, folded cells their column.
#[test]
fn every_link_leads_somewhere_and_every_mark_of_a_run_tells_it() {
    let page = page(&common::campaign());
    let (_, tags) = parsed(&page);
    let attribute = |tag: &String, name: &str| {
        let rest = tag.split_once(&format!("{name}=\""))?.1;
        Some(rest.split_once('"')?.0.to_owned())
    };
    let links: Vec<String> = tags
        .iter()
        .filter_map(|tag| attribute(tag, "href"))
        .collect();
    assert!(links.len() > 6, "{links:?}");
    for link in links {
        let target = link.strip_prefix('#').unwrap();
        assert!(page.contains(&format!("id=\"{target}\"")), "{link}");
    }
    for run in &common::campaign().runs[..2] {
        assert!(page.contains(&format!(
            "<title>run {}, row {} of vibration</title>",
            run.run, run.line
        )));
    }
    let folded = page
        .split("class=\"fold")
        .skip(1)
        .map(|table| table.split("</table>").next().unwrap());
    for table in folded {
        let cells = table.matches("<td").count();
        assert!(
            cells > 0 && cells == table.matches("data-label").count(),
            "{table}"
        );
    }
}
