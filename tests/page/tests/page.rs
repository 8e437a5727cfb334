//! A static test from the page alone: a browser, the virtual instrument in real time, a cable that can be pulled.

mod common;

use std::path::Path;
use std::time::Duration;

use common::{Bench, Browsing, Outcome, run};
use host::attended::Operator;
use host::campaign::Campaign;
use host::capture::{Ledger, RECORD, tables_of};
use host::follow::Follower;
use host::page::Page;
use host::walk::Wish;

/// Positions of the test's plan.
const POSITIONS: usize = 14;

/// Presses the key for the next reading until the page says that the test is over.
async fn measure_all(page: &chromiumoxide::Page) -> Outcome {
    loop {
        common::until(
            page,
            "view && (view.phase.is === 'place' || view.phase.is === 'over')",
        )
        .await?;
        if common::holds(page, "view.phase.is === 'over'").await? {
            return Ok(());
        }
        common::press(page, "m").await?;
        common::until(page, "view.phase.is !== 'place' || view.message !== ''").await?;
    }
}

fn readings(folder: &Path) -> Outcome<usize> {
    Ok(Campaign::read(folder)?.readings.len())
}

#[test]
fn somebody_measures_a_static_test_from_the_page_by_keyboard_alone() -> Outcome {
    let bench = Bench::start()?;
    run(async {
        let browser = Browsing::start(1280, 900).await?;
        let page = browser.open(&bench.url).await?;
        common::until(
            &page,
            "document.querySelector('#what').textContent === 'Series 1 · dial 0°'",
        )
        .await?;
        measure_all(&page).await?;
        // Everything that the person has to know stands there.
        common::until(
            &page,
            "document.querySelector('#what').textContent === 'The test is over'",
        )
        .await?;
        let told = common::text(&page, "#readings").await?;
        assert!(!told.contains('✗'), "{told}");
        assert_eq!(common::count(&page, "#reading-rows tr").await?, POSITIONS);
        assert!(common::text(&page, "#vre").await?.contains("in random:1 g"));
        assert!(
            common::text(&page, "#coefficient-rows")
                .await?
                .contains("V/g")
        );
        browser.close().await
    })?;
    let folder = bench.ends()?;
    assert_eq!(readings(folder.path())?, POSITIONS);
    // The record tells the same.
    tables_of(folder.path(), false)?;
    Ok(())
}

#[test]
fn a_redone_reading_a_remark_and_a_position_left_out_are_in_the_campaign() -> Outcome {
    let bench = Bench::start()?;
    run(async {
        let browser = Browsing::start(1280, 900).await?;
        let page = browser.open(&bench.url).await?;
        common::measure_first(&page, 2).await?;
        common::press(&page, "r").await?;
        common::until(&page, "view.readings.length === 1 && view.at === 1").await?;
        common::press(&page, "m").await?;
        common::until(&page, "view.readings.length === 2").await?;
        common::press(&page, "c").await?;
        let remark = page.find_element("#remark").await?;
        remark.type_str("touched the <b>table</b>").await?;
        remark.press_key("Enter").await?;
        common::until(&page, "view.readings[1].remark !== ''").await?;
        let shown = common::text(&page, "#reading-rows tr:first-child td:last-child").await?;
        assert_eq!(shown, "touched the <b>table</b>");
        common::press(&page, "s").await?;
        common::until(&page, "view.at === 3").await?;
        // A click on the plan goes there.
        page.find_element("#stops li:nth-child(6) button")
            .await?
            .click()
            .await?;
        common::until(&page, "view.at === 5").await?;
        page.find_element("#measure").await?.click().await?;
        common::until(&page, "view.readings.length === 3").await?;
        // From wherever the walk goes on, to a position of another series.
        common::until(&page, "view.phase.is === 'place'").await?;
        page.evaluate("window.before = view.stops[view.at].series")
            .await?;
        common::press(&page, "w").await?;
        common::until(&page, "view.stops[view.at].series !== before").await?;
        common::finish(&page).await?;
        browser.close().await
    })?;
    let folder = bench.ends()?;
    let campaign = Campaign::read(folder.path())?;
    let orders: Vec<u64> = campaign
        .readings
        .iter()
        .map(|reading| reading.order)
        .collect();
    assert_eq!(orders, [0, 2, 3]);
    let unknown = &campaign.readings[1].unknown;
    assert_eq!(
        unknown[..],
        [("remark".to_owned(), "touched the <b>table</b>".to_owned())]
    );
    Ok(())
}

#[test]
fn a_pulled_cable_costs_the_reading_under_way_and_the_test_goes_on_when_it_is_back() -> Outcome {
    let bench = Bench::start()?;
    run(async {
        let browser = Browsing::start(1280, 900).await?;
        let page = browser.open(&bench.url).await?;
        common::measure_first(&page, 2).await?;
        common::press(&page, "m").await?;
        common::until(&page, "view.phase.is === 'read'").await?;
        bench.pull_cable();
        common::until(&page, "view.phase.is === 'lost'").await?;
        assert_eq!(
            common::text(&page, "#what").await?,
            "The instrument is lost"
        );
        assert!(common::holds(&page, "document.querySelector('#measure').disabled").await?);
        // What is there by now is a campaign.
        assert_eq!(readings(bench.folder())?, 2);
        bench.plug_cable();
        common::until(&page, "view.phase.is === 'place'").await?;
        assert_eq!(
            common::text(&page, "#message").await?,
            "the instrument is there again"
        );
        measure_all(&page).await?;
        browser.close().await
    })?;
    let folder = bench.ends()?;
    assert_eq!(readings(folder.path())?, POSITIONS);
    let (ledger, _) = Ledger::read(&folder.path().join(RECORD))?;
    assert_eq!(ledger.begun(), 1, "the reading that was under way");
    Ok(())
}

#[test]
fn a_page_loaded_anew_and_a_second_one_show_the_same_and_either_measures() -> Outcome {
    let bench = Bench::start()?;
    run(async {
        let browser = Browsing::start(1280, 900).await?;
        let first = browser.open(&bench.url).await?;
        common::until(&first, "view && view.phase.is === 'place'").await?;
        common::press(&first, "m").await?;
        common::until(&first, "view.phase.is === 'read'").await?;
        first.reload().await?;
        common::until(&first, "view && view.readings.length === 1").await?;
        let second = browser.open(&bench.url).await?;
        common::until(&second, "view && view.readings.length === 1").await?;
        common::press(&second, "m").await?;
        for page in [&first, &second] {
            common::until(page, "view.readings.length === 2 && document.querySelectorAll('#reading-rows tr').length === 2").await?;
        }
        // Both at once: one reading.
        common::press(&first, "m").await?;
        common::press(&second, "m").await?;
        for page in [&first, &second] {
            common::until(
                page,
                "view.readings.length === 3 && view.phase.is === 'place'",
            )
            .await?;
        }
        common::finish(&second).await?;
        common::until(&first, "view.phase.is === 'over'").await?;
        browser.close().await
    })?;
    assert_eq!(readings(bench.ends()?.path())?, 3);
    Ok(())
}

/// Pictures for a person to look at, in the target's folder; what a program can see of them is tested: nothing is cut off,
/// what is to be pressed is large enough, every control has a name.
#[test]
fn the_page_holds_at_three_widths_bright_and_dark_and_names_every_control() -> Outcome {
    let bench = Bench::start()?;
    let pictures = Path::new(env!("CARGO_TARGET_TMPDIR")).join("page");
    std::fs::create_dir_all(&pictures)?;
    run(async {
        let browser = Browsing::start(1280, 900).await?;
        let page = browser.open(&bench.url).await?;
        common::measure_first(&page, 9).await?;
        tokio::time::sleep(Duration::from_secs(2)).await;
        for (width, dark) in [
            (400, false),
            (400, true),
            (768, false),
            (1280, false),
            (1280, true),
        ] {
            common::resize(&page, width, dark).await?;
            tokio::time::sleep(Duration::from_millis(600)).await;
            let name = format!("{width}-{}.png", if dark { "dark" } else { "bright" });
            assert!(
                common::holds(&page, "document.documentElement.scrollWidth <= innerWidth").await?,
                "{width}: something is cut off"
            );
            let large = "[...document.querySelectorAll('#buttons button')].every(b => b.offsetHeight >= 44)";
            assert!(
                common::holds(&page, large).await?,
                "{width}: buttons for thumbs"
            );
            // Taken last: the whole page in one picture is laid out anew.
            common::picture(&page, &pictures.join(name)).await?;
        }
        let named = "[...document.querySelectorAll('button, input, svg[role], [role=img], [role=progressbar]')].every(e => \
            e.textContent.trim() || e.getAttribute('aria-label') || e.getAttribute('aria-labelledby') || (e.labels && e.labels.length))";
        assert!(common::holds(&page, named).await?);
        common::finish(&page).await?;
        browser.close().await
    })?;
    bench.ends()?;
    Ok(())
}

#[test]
fn a_finished_record_is_watched_and_nothing_can_be_wished() -> Outcome {
    let folder = tempfile::tempdir()?;
    let bench = common::paper_bench();
    host::capture::capture_virtual(&bench, folder.path(), || ())?;
    let mut follower = Follower::open(folder.path(), common::environment())?;
    let view = follower.look()?.ok_or("a view")?;
    let name = folder.path().display().to_string();
    let mut served = Page::serve(([127, 0, 0, 1], 0).into(), &name, true)?;
    served.show(&view)?;
    let url = served.url().to_owned();
    run(async {
        let browser = Browsing::start(768, 900).await?;
        let page = browser.open(&url).await?;
        common::until(&page, "view && view.readings.length === 48").await?;
        assert_eq!(common::text(&page, "#what").await?, "A record");
        let hidden = "getComputedStyle(document.querySelector('#buttons')).display === 'none'";
        assert!(common::holds(&page, hidden).await?);
        common::press(&page, "m").await?;
        browser.close().await
    })?;
    assert_eq!(served.wish(true), None);
    let wish = "POST /wish HTTP/1.1\r\ncontent-type: application/json\r\ncontent-length: 18\r\n";
    let answer = common::http(
        &url,
        &format!("{wish}host: localhost\r\n"),
        "{\"wish\":\"measure\"}",
    )?;
    assert!(answer.starts_with("HTTP/1.1 403"), "{answer}");
    Ok(())
}

/// Another page in the same browser must neither read along nor measure.
#[test]
fn who_does_not_mean_this_machine_or_has_no_token_gets_nothing() -> Outcome {
    let mut page = Page::serve(([127, 0, 0, 1], 0).into(), "folder", false)?;
    let url = page.url().to_owned();
    let status = |request: &str, body: &str| -> Outcome<String> {
        let answer = common::http(&url, request, body)?;
        Ok(answer.split(' ').nth(1).unwrap_or_default().to_owned())
    };
    assert_eq!(
        status("GET / HTTP/1.1\r\nhost: localhost:80\r\n", "")?,
        "200"
    );
    // A name of somebody else's that points here.
    assert_eq!(
        status("GET / HTTP/1.1\r\nhost: bench.example\r\n", "")?,
        "403"
    );
    // A form of somebody else's page cannot send JSON as JSON.
    let form = "POST /wish HTTP/1.1\r\nhost: localhost\r\ncontent-type: text/plain\r\ncontent-length: 18\r\n";
    assert_eq!(status(form, "{\"wish\":\"measure\"}")?, "415");
    assert_eq!(page.wish(true), None);
    let json = form.replace("text/plain", "application/json");
    assert_eq!(status(&json, "{\"wish\":\"measure\"}")?, "204");
    assert_eq!(page.wish(true), Some(Wish::Measure));
    assert_eq!(status(&json, "{\"wish\":\"nonsens\"}")?, "422");

    let open = Page::serve(([0, 0, 0, 0], 0).into(), "folder", false)?;
    let (url, token) = open.url().split_once("?token=").ok_or("a token")?;
    assert_eq!(token.len(), 32);
    let url = url.replace("0.0.0.0", "127.0.0.1");
    for (given, expected) in [
        ("", "403"),
        ("?token=0", "403"),
        (&format!("?token={token}"), "200"),
    ] {
        let request = format!("GET /{given} HTTP/1.1\r\nhost: 127.0.0.1\r\n");
        let answer = common::http(&url, &request, "")?;
        assert_eq!(answer.split(' ').nth(1), Some(expected), "{given}");
    }
    Ok(())
}

#[test]
fn the_command_serves_the_page_and_writes_the_campaign() -> Outcome {
    let folder = tempfile::tempdir()?;
    let plan = folder.path().join("positions.csv");
    std::fs::write(&plan, "series,dial_deg\n1,0\n1,90\n")?;
    let out = folder.path().join("campaign");
    // Any port that is free now.
    let port = std::net::TcpListener::bind("127.0.0.1:0")?
        .local_addr()?
        .port();
    let listen = format!("127.0.0.1:{port}");
    let arguments: Vec<std::ffi::OsString> = vec![
        "vre".into(),
        "capture".into(),
        "--page".into(),
        "--dwell=0.3".into(),
        "--settle=0.1".into(),
        "--plan".into(),
        plan.into(),
        "--out".into(),
        out.clone().into(),
        "--listen".into(),
        (&listen).into(),
    ];
    let command = std::thread::spawn(move || host::cli::run(arguments));
    run(async {
        let browser = Browsing::start(400, 800).await?;
        while std::net::TcpStream::connect(&listen).is_err() {
            tokio::time::sleep(Duration::from_millis(50)).await;
        }
        let page = browser.open(&format!("http://{listen}/")).await?;
        measure_all(&page).await?;
        assert!(
            common::text(&page, "#how")
                .await?
                .contains(&*out.display().to_string())
        );
        browser.close().await
    })?;
    let status = command.join().map_err(|_| "the command panicked")?;
    assert_eq!(
        format!("{status:?}"),
        format!("{:?}", std::process::ExitCode::SUCCESS)
    );
    assert_eq!(readings(&out)?, 2);
    assert!(out.join("plan.csv").exists());
    Ok(())
}
