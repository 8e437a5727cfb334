//! `simulate` into a folder, a dict, or a record batch.

use std::path::PathBuf;
use std::sync::Arc;

use arrow::array::{ArrayRef, Float64Array, RecordBatch, UInt64Array};
use columns::encode;
use columns::rows::{CampaignRow, RunRow};
use host::bench::effects;
use host::bench::imperfections::{self, Imperfection};
use host::bench::noise::Seed;
use host::bench::plan::Static;
use host::bench::simulate::{Simulation, Specification, VirtualBench};
use host::campaign::{ranges, write_runs};
use host::error::Error;
use host::output::write_json;
use pyo3::prelude::*;
use pyo3_arrow::PyRecordBatch;
use rayon::prelude::*;

use crate::failure::{detached, usage, within};

/// What is to be simulated, but for the seed.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub struct Wanted {
    plan: String,
    dial_sigma_arcsec: f64,
    effects: Vec<String>,
    strength: f64,
    imperfections: Vec<String>,
}

impl Wanted {
    fn simulate(&self, seed: u64) -> Result<Simulation, Error> {
        let plan = <Static as clap::ValueEnum>::from_str(&self.plan, false);
        let plan = plan.map_err(|_| {
            let plan = &self.plan;
            usage(format!(
                "the plan {plan:?} is none of default, paper and remounted"
            ))
        })?;
        let sigma = self.dial_sigma_arcsec;
        let sigma = within(&ranges::ARCSEC_SIGMA, "dial_sigma_arcsec", sigma)?;
        let strength = within(&ranges::STRENGTH, "strength", self.strength)?;
        let seed = Seed(seed);
        let mut drawn = Vec::new();
        for (index, id) in self.effects.iter().enumerate() {
            let entry = effects::find(id);
            let entry = entry.ok_or_else(|| usage(format!("{id:?} is no effect of the bench")))?;
            drawn.push((entry.draw)(
                strength,
                &mut seed.stream("effect", index as u64),
            ));
        }
        let imperfections = self.imperfections.iter().map(|text| text.parse());
        let imperfections: Vec<Imperfection> = imperfections
            .collect::<Result<_, _>>()
            .map_err(|problem: String| usage(problem))?;
        let specification = Specification::with_dial_sigma(sigma);
        let bench = VirtualBench::new(seed, plan, specification, drawn);
        Ok(imperfections::simulate(bench, &imperfections))
    }
}

/// Writes a campaign as `vre simulate` does; gives the truth behind it as JSON.
#[pyfunction]
pub fn to_folder(
    py: Python<'_>,
    out: PathBuf,
    seed: u64,
    wanted: Wanted,
    force: bool,
) -> PyResult<String> {
    detached(py, || {
        if !force && out.join("campaign.toml").exists() {
            let problem = "holds a campaign already; name another folder, or say force=True";
            return Err(Error::input(&out, problem));
        }
        let made = wanted.simulate(seed)?;
        made.campaign.write(&out)?;
        write_runs(&out.join("holdout.csv"), &made.holdout)?;
        write_json(&out.join("truth.json"), &made.truth)?;
        serde_json::to_string(&made.truth).map_err(usage)
    })
}

/// A campaign, the runs to predict and the truth, as JSON.
#[pyfunction]
pub fn to_dict(py: Python<'_>, seed: u64, wanted: Wanted) -> PyResult<String> {
    detached(py, || {
        let made = wanted.simulate(seed)?;
        let campaign = CampaignRow::new(&made.campaign).map_err(usage)?;
        let holdout: Vec<RunRow> = made.holdout.iter().map(RunRow::from).collect();
        let all =
            serde_json::json!({ "campaign": campaign, "holdout": holdout, "truth": made.truth });
        Ok(all.to_string())
    })
}

/// A record batch: seed, campaign, and the true coefficient k2, 1/g.
#[pyfunction]
pub fn to_arrow(py: Python<'_>, seeds: Vec<u64>, wanted: Wanted) -> PyResult<PyRecordBatch> {
    let batch = detached(py, || {
        let one = |seed: &u64| {
            let made = wanted.simulate(*seed)?;
            let campaign = CampaignRow::new(&made.campaign).map_err(usage)?;
            Ok::<_, Error>((campaign, made.truth.coefficients[3]))
        };
        let made: Vec<_> = seeds.par_iter().map(one).collect::<Result<_, _>>()?;
        let (rows, k2): (Vec<CampaignRow>, Vec<f64>) = made.into_iter().unzip();
        let columns: [(&str, ArrayRef); 3] = [
            ("seed", Arc::new(UInt64Array::from(seeds))),
            ("campaign", encode(&rows).map_err(usage)?),
            ("true_k2_per_g", Arc::new(Float64Array::from(k2))),
        ];
        RecordBatch::try_from_iter(columns).map_err(usage)
    })?;
    Ok(PyRecordBatch::new(batch))
}
