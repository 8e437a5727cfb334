//! A bench whose page is served, and a browser.

use std::io::{self, Read, Write};
use std::net::{SocketAddr, TcpStream};
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::channel;
use std::thread::{self, JoinHandle};
use std::time::{Duration, Instant};

use chromiumoxide::cdp::browser_protocol::emulation::{
    MediaFeature, SetDeviceMetricsOverrideParams, SetEmulatedMediaParams,
};
use chromiumoxide::cdp::browser_protocol::page::CaptureScreenshotFormat;
use chromiumoxide::page::ScreenshotParams;
use chromiumoxide::{Browser, BrowserConfig, Page};
use futures_util::StreamExt;
use host::attended::{self, Connection, Test};
use host::bench::excitation::FRONT_END;
use host::bench::noise::Seed;
use host::bench::plan::{Dwell, Static};
use host::bench::simulate::{Specification, VirtualBench};
use host::capture::{self, Folder, Ledger};
use host::error::Error;
use host::source::{Hand, InstrumentSource, Source, order_of};
use host::statics::Environment;
use shared::model::SpecificForce;
use shared::vibration::Random;
use tempfile::TempDir;

pub type Outcome<T = ()> = Result<T, Box<dyn std::error::Error>>;

/// How long anything may take.
const PATIENCE: Duration = Duration::from_secs(40);

/// Enough positions for every coefficient but two, in three series.
const PLAN: &str = "series,dial_deg\n1,0\n1,45\n1,90\n1,135\n1,180\n1,270\n2,0\n2,60\n2,90\n2,180\n2,240\n3,0\n3,90\n3,180\n";

fn virtual_bench(plan: Vec<Dwell>) -> VirtualBench {
    let specification = Specification::with_dial_sigma(5.8);
    let mut bench = VirtualBench::new(Seed(7), Static::Paper, specification, Vec::new());
    bench.plan.dwells = plan;
    bench
}

/// The paper's positions and no run.
pub fn paper_bench() -> VirtualBench {
    let mut bench = virtual_bench(host::bench::plan::dwells(Static::Paper));
    bench.plan.runs.clear();
    bench
}

/// A line whose cable can be pulled.
struct Cable {
    line: InstrumentSource,
    out: Arc<AtomicBool>,
}

impl Read for Cable {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        match self.out.load(Ordering::Relaxed) {
            true => Ok(0),
            false => self.line.read(buffer),
        }
    }
}

impl Source for Cable {
    fn name(&self) -> String {
        self.line.name()
    }

    fn send(&mut self, frame: &[u8]) -> io::Result<()> {
        self.line.send(frame)
    }
}

struct Plug {
    plan: Vec<Dwell>,
    hand: Hand,
    out: Arc<AtomicBool>,
}

impl Connection for Plug {
    type Source = Cable;

    fn connect(&mut self) -> Result<Cable, Error> {
        if self.out.load(Ordering::Relaxed) {
            return Err(Error::Usage("the port is not there".into()));
        }
        let plan = self.plan.clone();
        let bench = move || virtual_bench(plan);
        let line = InstrumentSource::start(bench, capture::virtual_board, &self.hand);
        let out = Arc::clone(&self.out);
        Ok(Cable { line, out })
    }

    fn turn(&mut self, to: &Dwell) {
        if let Some(order) = order_of(&self.plan, to) {
            self.hand.turn(order);
        }
    }
}

/// A static test that is under way, with its page.
pub struct Bench {
    pub url: String,
    folder: TempDir,
    out: Arc<AtomicBool>,
    test: JoinHandle<Result<(), String>>,
}

impl Bench {
    pub fn start() -> Outcome<Self> {
        let folder = tempfile::tempdir()?;
        let plan_file = folder.path().join("positions.txt");
        std::fs::write(&plan_file, PLAN)?;
        let plan = capture::read_plan(&plan_file)?;
        let out = Arc::new(AtomicBool::new(false));
        let (tell_url, url) = channel();
        let (at, cable) = (folder.path().to_owned(), Arc::clone(&out));
        let test = thread::spawn(move || {
            let told = |error: Error| error.to_string();
            let listen = SocketAddr::from(([127, 0, 0, 1], 0));
            let name = at.display().to_string();
            let mut page = host::page::Page::serve(listen, &name, false).map_err(told)?;
            tell_url
                .send(page.url().to_owned())
                .map_err(|error| error.to_string())?;
            let mut config = virtual_bench(plan.clone()).config();
            config.acquisition = config.acquisition.with_front_end(FRONT_END);
            let test = Test {
                temp_c: config.bench.reference_temp_c,
                config,
                dwells: plan.clone(),
                settle: Duration::from_millis(200),
                dwell: Duration::from_millis(600),
                environment: environment(),
                enough: Some(0.2),
            };
            let folder = Folder::claim(&at, false).map_err(told)?;
            let mut plug = Plug {
                plan,
                hand: Hand::default(),
                out: cable,
            };
            let measured = attended::measure(
                &mut plug,
                &test,
                &folder,
                Ledger::default(),
                &mut page,
                None,
            );
            page.close();
            measured.map(|_| ()).map_err(told)
        });
        Ok(Self {
            url: url.recv_timeout(PATIENCE)?,
            folder,
            out,
            test,
        })
    }

    pub fn pull_cable(&self) {
        self.out.store(true, Ordering::Relaxed);
    }

    pub fn plug_cable(&self) {
        self.out.store(false, Ordering::Relaxed);
    }

    pub fn folder(&self) -> &Path {
        self.folder.path()
    }

    /// When the test has come to its end: its folder.
    pub fn ends(self) -> Outcome<TempDir> {
        match self.test.join() {
            Ok(outcome) => outcome?,
            Err(_) => return Err("the test panicked".into()),
        }
        Ok(self.folder)
    }
}

pub fn environment() -> Environment {
    let along = SpecificForce::new(1.0, 0.0, 0.0);
    Environment {
        name: "random:1".into(),
        a0_i_g: 0.0,
        moments: Random::along(along).into(),
    }
}

/// The whole answer to a request, whose headers end with one for the connection.
pub fn http(url: &str, head: &str, body: &str) -> Outcome<String> {
    let address = url.trim_start_matches("http://").trim_end_matches('/');
    let mut line = TcpStream::connect(address)?;
    write!(line, "{head}connection: close\r\n\r\n{body}")?;
    let mut answer = String::new();
    line.read_to_string(&mut answer)?;
    Ok(answer)
}

/// Runs what a browser does.
pub fn run<T>(what: impl Future<Output = Outcome<T>>) -> Outcome<T> {
    let runtime = tokio::runtime::Builder::new_current_thread()
        .enable_all()
        .build()?;
    runtime.block_on(what)
}

/// A browser of its own.
pub struct Browsing {
    browser: Browser,
    _profile: TempDir,
}

impl Browsing {
    pub async fn start(width: u32, height: u32) -> Outcome<Self> {
        let profile = tempfile::tempdir()?;
        let config = BrowserConfig::builder()
            .no_sandbox()
            .window_size(width, height)
            .viewport(None)
            .user_data_dir(profile.path())
            .arg("--disable-dev-shm-usage")
            .build()?;
        let (browser, mut handler) = Browser::launch(config).await?;
        tokio::spawn(async move { while handler.next().await.is_some() {} });
        Ok(Self {
            browser,
            _profile: profile,
        })
    }

    pub async fn open(&self, url: &str) -> Outcome<Page> {
        Ok(self.browser.new_page(url).await?)
    }

    pub async fn close(mut self) -> Outcome {
        self.browser.close().await?;
        self.browser.wait().await?;
        Ok(())
    }
}

pub async fn holds(page: &Page, condition: &str) -> Outcome<bool> {
    // While a page is loaded anew there is none.
    let value = page.evaluate(format!("Boolean({condition})")).await;
    Ok(value
        .ok()
        .and_then(|value| value.into_value().ok())
        .unwrap_or(false))
}

/// Waits until a condition holds on the page.
pub async fn until(page: &Page, condition: &str) -> Outcome {
    let end = Instant::now() + PATIENCE;
    while !holds(
        page,
        &format!("typeof view !== 'undefined' && ({condition})"),
    )
    .await?
    {
        if Instant::now() > end {
            let shown = text(page, "body").await.unwrap_or_default();
            return Err(format!("never: {condition}\n{shown}").into());
        }
        tokio::time::sleep(Duration::from_millis(30)).await;
    }
    Ok(())
}

pub async fn press(page: &Page, key: &str) -> Outcome {
    page.find_element("body").await?.press_key(key).await?;
    Ok(())
}

/// Measures the first positions of a walk, so many.
pub async fn measure_first(page: &Page, count: usize) -> Outcome {
    for n in 1..=count {
        until(page, "view && view.phase.is === 'place'").await?;
        press(page, "m").await?;
        until(page, &format!("view.readings.length === {n}")).await?;
    }
    Ok(())
}

/// Finishes the test and says yes to the question.
pub async fn finish(page: &Page) -> Outcome {
    page.evaluate("window.confirm = () => true").await?;
    press(page, "q").await?;
    until(page, "view.phase.is === 'over'").await
}

pub async fn text(page: &Page, selector: &str) -> Outcome<String> {
    let selector = serde_json::to_string(selector)?;
    let script = format!("document.querySelector({selector}).innerText.trim()");
    Ok(page.evaluate(script).await?.into_value()?)
}

pub async fn count(page: &Page, selector: &str) -> Outcome<usize> {
    let selector = serde_json::to_string(selector)?;
    let script = format!("document.querySelectorAll({selector}).length");
    Ok(page.evaluate(script).await?.into_value()?)
}

pub async fn resize(page: &Page, width: i64, dark: bool) -> Outcome {
    let scheme = if dark { "dark" } else { "light" };
    page.execute(SetDeviceMetricsOverrideParams::new(
        width,
        900,
        1.0,
        width < 500,
    ))
    .await?;
    let media = SetEmulatedMediaParams::builder();
    let media = media.feature(MediaFeature::new("prefers-color-scheme", scheme));
    page.execute(media.build()).await?;
    Ok(())
}

pub async fn picture(page: &Page, file: &Path) -> Outcome {
    let parameters = ScreenshotParams::builder().format(CaptureScreenshotFormat::Png);
    let bytes = page.screenshot(parameters.full_page(true).build()).await?;
    Ok(std::fs::write(file, bytes)?)
}
