//! What the campaigns of a bench say of its dividing head.

use std::fmt::Write as _;
use std::path::Path;

use columns::cell::Cell;
use columns::row;
use datafusion::arrow::datatypes::DataType;
use host::campaign::Campaign;
use host::error::Error;
use host::head::batch::{FEWEST, TYPE, sum};
use host::head::changes::changes;
use host::head::harmonics::{advice, harmonics};
use host::head::teaching::key;
use host::head::{Batch, DEFAULT_SPREAD, HeadFile, Posterior, Prior, Reduced, settle};
use host::statics::NAMES;
use rayon::prelude::*;
use serde::Serialize;
use shared::tumble::ARCSEC_RAD;
use statrs::distribution::{ChiSquared, ContinuousCDF};

use crate::dataset;

row! {
    /// A value with its standard uncertainty.
    pub struct QuantityRow {
        /// Estimate.
        value: f64,
        /// Standard uncertainty.
        sigma: f64,
    }
}

row! {
    /// A mark of the head.
    pub struct MarkRow {
        /// Its angle, deg.
        dial_deg: f64,
        /// Its error, arcsec.
        error_arcsec: QuantityRow,
    }
}

row! {
    /// A harmonic of the marks' errors.
    pub struct HarmonicRow {
        /// Its order.
        order: u64,
        /// Cosine part, arcsec.
        cos_arcsec: QuantityRow,
        /// Sine part, arcsec.
        sin_arcsec: Option<QuantityRow>,
        /// Whether the batch tells nothing of it.
        blind: bool,
    }
}

row! {
    /// A coefficient of the type.
    pub struct TypeRow {
        /// Its name.
        name: String,
        /// Mean of the type.
        mean: QuantityRow,
        /// Standard deviation of single instruments about it.
        spread: f64,
    }
}

row! {
    /// What a batch says of its head.
    pub struct BenchRow {
        /// Campaigns in it.
        campaigns: u64,
        /// Campaigns that could not be used.
        refused: u64,
        /// The error map.
        marks: Option<Vec<MarkRow>>,
        /// The same as harmonics.
        harmonics: Option<Vec<HarmonicRow>>,
        /// The type.
        coefficients: Option<Vec<TypeRow>>,
        /// What to do about a blind harmonic.
        advice: Option<String>,
        /// Why there is no answer, or why the first campaign that could not be used was not.
        reason: Option<String>,
    }
}

/// Type of what `vre_bench` gives.
pub fn bench_type() -> DataType {
    BenchRow::data_type()
}

impl BenchRow {
    /// Of so many campaigns.
    pub fn new(
        posterior: &Posterior,
        campaigns: u64,
        refused: u64,
        reason: Option<String>,
    ) -> Self {
        let quantity = |value: f64, sigma: f64| QuantityRow { value, sigma };
        let mut marks: Vec<MarkRow> = (0..posterior.marks_deg.len())
            .map(|mark| MarkRow {
                dial_deg: posterior.marks_deg[mark],
                error_arcsec: quantity(
                    posterior.mean[TYPE + mark] / ARCSEC_RAD,
                    posterior.mark_sigma_rad(mark) / ARCSEC_RAD,
                ),
            })
            .collect();
        marks.sort_by(|a, b| a.dial_deg.total_cmp(&b.dial_deg));
        let told = harmonics(posterior);
        let advice = advice(&told).map(str::to_owned);
        let known =
            |q: host::quantity::Quantity| q.known().map(|(value, sigma)| quantity(value, sigma));
        let harmonic = |h: host::head::Harmonic| {
            Some(HarmonicRow {
                order: h.order as u64,
                cos_arcsec: known(h.cos_arcsec)?,
                sin_arcsec: h.sin_arcsec.and_then(known),
                blind: h.blind,
            })
        };
        let of_type = |k: usize| TypeRow {
            name: NAMES[k + 1].into(),
            mean: quantity(
                posterior.mean[k],
                posterior.covariance[(k, k)].max(0.0).sqrt(),
            ),
            spread: posterior.spread[k],
        };
        Self {
            campaigns,
            refused,
            marks: Some(marks),
            harmonics: Some(told.into_iter().filter_map(harmonic).collect()),
            coefficients: Some((0..TYPE).map(of_type).collect()),
            advice,
            reason,
        }
    }

    /// No answer.
    pub fn none(refused: u64, reason: String) -> Self {
        Self {
            campaigns: 0,
            refused,
            marks: None,
            harmonics: None,
            coefficients: None,
            advice: None,
            reason: Some(reason),
        }
    }
}

/// A campaign on the head.
struct Tested {
    serial: String,
    time: String,
    key: String,
    told: Reduced,
}

/// What is told of a head, `vre-head-report/1`.
#[derive(Debug, Serialize)]
pub struct HeadReport {
    format: &'static str,
    /// Name of the head.
    pub id: String,
    /// First campaign of each stretch in which the head was the same, the last stretch being that of the map.
    pub stretches: Vec<Stretch>,
    /// The map and the type, from the last stretch.
    #[serde(flatten)]
    pub bench: BenchRow,
    /// Instruments of the last stretch that do not belong.
    pub strangers: Vec<Stranger>,
    /// Campaigns that could not be used, with the reason.
    pub refused_campaigns: Vec<String>,
    /// Standard uncertainty of k2 of an instrument, 1/g: the median.
    pub k2_sigma_per_g: f64,
    /// For `vre identify --head`.
    #[serde(skip)]
    pub head: HeadFile,
}

/// A time in which the head was the same.
#[derive(Debug, PartialEq, Eq, Serialize)]
pub struct Stretch {
    /// Serial number of its first instrument.
    pub serial: String,
    /// When that was tested.
    pub since: String,
    /// Number of campaigns.
    pub campaigns: usize,
}

/// An instrument that does not belong.
#[derive(Debug, PartialEq, Serialize)]
pub struct Stranger {
    /// Its serial number.
    pub serial: String,
    /// When it was tested.
    pub time: String,
    /// Probability of readings so far from what all others say of them.
    pub p_value: f64,
}

/// Batches in time between which a change is looked for: their number bounds the work.
const PARTS: usize = 192;

/// Probability up to which an instrument does not belong, over the number of instruments: one false in a thousand batches.
const STRANGE: f64 = 1e-3;

/// Calibrates the head of bench `id` by all campaigns on it. `step` is told what is being done.
///
/// # Errors
/// There is no such bench, or none of its campaigns can be used.
pub fn head_of(dataset: &Path, id: &str, step: impl Fn(String)) -> Result<HeadReport, Error> {
    let (mut tested, refused_campaigns) = read(dataset, id, &step)?;
    tested.sort_by(|a, b| (&a.time, &a.serial).cmp(&(&b.time, &b.serial)));
    if tested.is_empty() {
        let why = refused_campaigns.first().map_or("", String::as_str);
        return Err(Error::Usage(format!(
            "none of the campaigns of bench {id} can be used: {why}"
        )));
    }
    step("looking for changes of the head".into());
    let starts = stretches(&tested)?;
    let last = &tested[*starts.last().unwrap_or(&0)..];
    let Belonging {
        members,
        strangers,
        batch,
        posterior,
    } = belonging(last, &step)?;
    let sigma = |told: &Reduced| {
        let instrument = posterior.instrument(told)?;
        Some(instrument.covariance[(3, 3)].max(0.0).sqrt())
    };
    let mut sigma: Vec<f64> = members
        .iter()
        .filter_map(|member| sigma(&member.told))
        .collect();
    sigma.sort_by(f64::total_cmp);
    let ends = starts.iter().copied().skip(1).chain([tested.len()]);
    let stretch = |(start, end): (&usize, usize)| Stretch {
        serial: tested[*start].serial.clone(),
        since: tested[*start].time.clone(),
        campaigns: end - start,
    };
    Ok(HeadReport {
        format: "vre-head-report/1",
        id: id.into(),
        stretches: starts.iter().zip(ends).map(stretch).collect(),
        bench: BenchRow::new(
            &posterior,
            batch.campaigns,
            refused_campaigns.len() as u64,
            None,
        ),
        strangers,
        k2_sigma_per_g: sigma.get(sigma.len() / 2).copied().unwrap_or(f64::NAN),
        head: HeadFile::new(
            id,
            &posterior,
            members.iter().map(|tested| tested.key.clone()).collect(),
        ),
        refused_campaigns,
    })
}

fn read(
    dataset: &Path,
    id: &str,
    step: &impl Fn(String),
) -> Result<(Vec<Tested>, Vec<String>), Error> {
    let files: Vec<_> = dataset::files(dataset)?;
    let mut benches: Vec<&str> = files
        .iter()
        .map(|(partition, _)| partition.bench.as_str())
        .collect();
    benches.dedup();
    if !benches.contains(&id) {
        return Err(Error::Usage(format!(
            "--head {id}: no such bench; there are {}",
            benches.join(", ")
        )));
    }
    let (mut tested, mut refused) = (Vec::new(), Vec::new());
    for (_, file) in files.iter().filter(|(partition, _)| partition.bench == id) {
        for batch in dataset::batches(file)? {
            let entries = dataset::read(&batch?, file)?;
            let read: Vec<Result<Tested, String>> = entries.into_par_iter().map(test).collect();
            for outcome in read {
                match outcome {
                    Ok(one) => tested.push(one),
                    Err(line) => refused.push(line),
                }
            }
            step(format!("{} campaigns read", tested.len() + refused.len()));
        }
    }
    Ok((tested, refused))
}

fn test(entry: dataset::Entry) -> Result<Tested, String> {
    let (serial, time) = (entry.serial, entry.time);
    let told = || {
        let campaign: Campaign = entry.campaign.campaign()?.used();
        let told = Reduced::of(&campaign)?;
        Ok::<_, Error>((key(&campaign), told))
    };
    let (key, told) = told().map_err(|problem| format!("{serial} {time}: {problem}"))?;
    Ok(Tested {
        serial,
        time,
        key,
        told,
    })
}

/// Places of the first campaigns of the stretches in which the head was the same.
fn stretches(tested: &[Tested]) -> Result<Vec<usize>, Error> {
    let size = tested.len().div_ceil(PARTS);
    let part = |part: &[Tested]| {
        let told: Vec<Reduced> = part.iter().map(|tested| tested.told.clone()).collect();
        sum(&told, DEFAULT_SPREAD)
    };
    let parts: Vec<Batch> = tested.chunks(size).map(part).collect::<Result<_, _>>()?;
    let starts = changes(&parts).into_iter().map(|part| part * size);
    Ok([0].into_iter().chain(starts).collect())
}

/// Instruments that belong together, and what they say; those that do not belong.
struct Belonging<'t> {
    members: Vec<&'t Tested>,
    strangers: Vec<Stranger>,
    batch: Batch,
    posterior: Posterior,
}

/// Most instruments that are set aside, as a share; one at least.
const MOST_STRANGERS: f64 = 0.05;

/// Sets the instruments aside that do not belong, one after another: a bad one widens the spread of the type, behind which
/// others hide, and it itself. So each is judged by a batch without it.
fn belonging<'t>(tested: &'t [Tested], step: &impl Fn(String)) -> Result<Belonging<'t>, Error> {
    let limit = STRANGE / tested.len() as f64;
    let settled = |members: &[&Tested]| {
        let told: Vec<Reduced> = members.iter().map(|member| member.told.clone()).collect();
        let pass = |pass| step(format!("spread of the type, pass {pass}"));
        settle(&told, DEFAULT_SPREAD, &Prior::default(), pass)
    };
    let mut members: Vec<&Tested> = tested.iter().collect();
    let (mut batch, mut posterior) = settled(&members)?;
    let mut strangers = Vec::new();
    let most = (MOST_STRANGERS * tested.len() as f64).ceil() as usize;
    while members.len() > FEWEST && strangers.len() < most {
        let added = |member: &&Tested| added_squares(&member.told, &batch, &posterior);
        let added: Vec<f64> = members
            .par_iter()
            .map(added)
            .collect::<Result<_, Error>>()?;
        let farthest = (0..members.len()).max_by(|a, b| added[*a].total_cmp(&added[*b]));
        let Some(farthest) = farthest else { break };
        let mut others = members.clone();
        let candidate = others.remove(farthest);
        let (without, others_say) = settled(&others)?;
        let mut with = without.clone();
        with.add(&candidate.told)?;
        let squares = with.posterior(&Prior::default())?.squares - others_say.squares;
        // The scale factor of each instrument is its own.
        let freedom = candidate.told.rows.saturating_sub(1) as f64;
        let p_value = ChiSquared::new(freedom).map_or(1.0, |chi2| chi2.sf(squares.max(0.0)));
        if p_value >= limit {
            break;
        }
        strangers.push(Stranger {
            serial: candidate.serial.clone(),
            time: candidate.time.clone(),
            p_value,
        });
        (members, batch, posterior) = (others, without, others_say);
    }
    Ok(Belonging {
        members,
        strangers,
        batch,
        posterior,
    })
}

/// How much smaller the least sum of squares of a batch is without one of its campaigns.
fn added_squares(told: &Reduced, batch: &Batch, posterior: &Posterior) -> Result<f64, Error> {
    let mut others = batch.clone();
    others.remove(told)?;
    Ok(posterior.squares - others.posterior(&Prior::default())?.squares)
}

/// The report for people.
pub fn text(report: &HeadReport) -> String {
    let mut text = String::new();
    let bench = &report.bench;
    let _ = writeln!(text, "head {}: {} campaigns", report.id, bench.campaigns);
    if report.stretches.len() > 1 {
        let _ = writeln!(
            text,
            "\nCHANGED: the marks became others, as if the head was re-zeroed; the map is that of the last stretch."
        );
        for stretch in &report.stretches {
            let Stretch {
                serial,
                since,
                campaigns,
            } = stretch;
            let _ = writeln!(text, "  {campaigns:>6} campaigns from {serial} {since} on");
        }
    }
    let _ = writeln!(text, "\n{:>10} {:>10} {:>8}", "dial deg", "arcsec", "sigma");
    for mark in bench.marks.iter().flatten() {
        let error = &mark.error_arcsec;
        let _ = writeln!(
            text,
            "{:>10} {:>10.3} {:>8.3}",
            mark.dial_deg, error.value, error.sigma
        );
    }
    let _ = writeln!(
        text,
        "\n{:>10} {:>10} {:>8} {:>10} {:>8}",
        "harmonic", "cos arcsec", "sigma", "sin arcsec", "sigma"
    );
    for harmonic in bench
        .harmonics
        .iter()
        .flatten()
        .filter(|harmonic| harmonic.order > 0)
    {
        let cos = &harmonic.cos_arcsec;
        let _ = write!(
            text,
            "{:>10} {:>10.3} {:>8.3}",
            harmonic.order, cos.value, cos.sigma
        );
        if let Some(sin) = &harmonic.sin_arcsec {
            let _ = write!(text, " {:>10.3} {:>8.3}", sin.value, sin.sigma);
        }
        text += if harmonic.blind { "  blind\n" } else { "\n" };
    }
    if let Some(advice) = &bench.advice {
        let _ = writeln!(text, "BLIND: {advice}");
    }
    let _ = writeln!(
        text,
        "\n{:<12} {:>12} {:>10} {:>10}   1e-6 of its unit",
        "type", "mean", "sigma", "spread"
    );
    for coefficient in bench.coefficients.iter().flatten() {
        let TypeRow { name, mean, spread } = coefficient;
        let _ = writeln!(
            text,
            "{name:<12} {:>12.2} {:>10.2} {:>10.2}",
            mean.value * 1e6,
            mean.sigma * 1e6,
            spread * 1e6
        );
    }
    let _ = writeln!(
        text,
        "\nk2 of one instrument of the batch: sigma {:.2}e-6 /g (median)",
        report.k2_sigma_per_g * 1e6
    );
    for stranger in &report.strangers {
        let Stranger {
            serial,
            time,
            p_value,
        } = stranger;
        let _ = writeln!(text, "DOES NOT BELONG: {serial} {time} (p {p_value:.1e})");
    }
    for line in &report.refused_campaigns {
        let _ = writeln!(text, "not used: {line}");
    }
    text
}
