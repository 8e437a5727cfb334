//! `identify`, `predict` and `diagnose` of a folder, a dict, or a column of campaigns.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use arrow::array::{Array, ArrayRef, AsArray, new_empty_array};
use arrow::datatypes::{DataType, Field, FieldRef};
use columns::functions::{diagnosed, identified, over, predicted, vibration};
use columns::rows::CampaignRow;
use columns::{answers, encode};
use host::campaign::{Campaign, Run, is_triad};
use host::error::Error;
use host::head::{HeadFile, known};
use pyo3::prelude::*;
use pyo3_arrow::input::AnyArray;
use pyo3_arrow::{PyArray, PyChunkedArray, PyField};
use rayon::prelude::*;
use serde_json::Value;

use crate::dicts;
use crate::failure::{detached, imported, raised, usage};

/// What is asked of a campaign.
enum What {
    Identify,
    /// Of these runs, or of the campaign's own.
    Predict(Option<[Run; 1]>),
    Diagnose,
}

impl What {
    fn new(name: &str, words: Option<&str>) -> Result<Self, Error> {
        match (name, words) {
            ("identify", None) => Ok(Self::Identify),
            ("diagnose", None) => Ok(Self::Diagnose),
            ("predict", words) => {
                let run = words.map(vibration).transpose().map_err(usage)?;
                Ok(Self::Predict(run.map(|run| [run])))
            }
            ("identify" | "diagnose", Some(_)) => Err(usage(format!("{name} takes no vibration"))),
            _ => Err(usage(format!(
                "{name:?} is none of identify, predict and diagnose"
            ))),
        }
    }

    /// Type of the answers.
    fn data_type(&self) -> DataType {
        match self {
            Self::Identify => answers::identification(),
            Self::Predict(_) => answers::prediction(),
            Self::Diagnose => answers::diagnosis(),
        }
    }

    fn answer(&self, campaign: &Campaign) -> Result<Value, Error> {
        match self {
            Self::Identify => identified(campaign),
            Self::Predict(runs) => predicted(campaign, runs.as_ref().map(<[Run; 1]>::as_slice)),
            Self::Diagnose => diagnosed(campaign),
        }
    }
}

/// A question with what is known of the head.
struct Question {
    what: What,
    head: Option<(PathBuf, HeadFile)>,
}

impl Question {
    fn new(what: What, head: Option<PathBuf>) -> Result<Self, Error> {
        let head = head.map(|file| HeadFile::read(&file).map(|head| (file, head)));
        let head = head.transpose()?;
        Ok(Self { what, head })
    }

    /// The answer to a campaign without its excluded rows.
    fn answer(&self, campaign: &Campaign) -> Result<Value, Error> {
        let Some((file, head)) = &self.head else {
            return self.what.answer(campaign);
        };
        let known = known(campaign, head)?;
        if !known.holds() {
            let problem = "the readings contradict it: the head was re-zeroed, or a mark moved";
            return Err(Error::input(file, problem));
        }
        self.what.answer(&known.campaign)
    }
}

fn of_one_instrument(folder: &Path) -> Result<Campaign, Error> {
    if is_triad(folder) {
        let problem = "is a triad's, which is not taken here";
        return Err(Error::input(&folder.join("campaign.toml"), problem));
    }
    Campaign::read(folder)
}

/// The answer to a campaign folder, as JSON.
#[pyfunction]
#[pyo3(signature = (name, folder, vibration=None, head=None))]
pub fn of_folder(
    py: Python<'_>,
    name: &str,
    folder: PathBuf,
    vibration: Option<&str>,
    head: Option<PathBuf>,
) -> PyResult<String> {
    detached(py, || {
        let question = Question::new(What::new(name, vibration)?, head)?;
        let campaign = of_one_instrument(&folder)?.used();
        question.answer(&campaign).map(|answer| answer.to_string())
    })
}

/// The answer to a campaign as JSON, as JSON.
#[pyfunction]
#[pyo3(signature = (name, campaign, vibration=None, head=None))]
pub fn of_dict(
    py: Python<'_>,
    name: &str,
    campaign: &str,
    vibration: Option<&str>,
    head: Option<PathBuf>,
) -> PyResult<String> {
    detached(py, || {
        let question = Question::new(What::new(name, vibration)?, head)?;
        let campaign = dicts::campaign(campaign)?.used();
        question.answer(&campaign).map(|answer| answer.to_string())
    })
}

/// The answers to a column of campaigns, or to record batches that have one of the name `campaign`: as many chunks as came.
#[pyfunction]
#[pyo3(signature = (name, campaigns, vibration=None, head=None))]
pub fn of_arrow(
    py: Python<'_>,
    name: &str,
    campaigns: &Bound<'_, PyAny>,
    vibration: Option<&str>,
    head: Option<PathBuf>,
) -> PyResult<PyChunkedArray> {
    let reader = imported::<AnyArray>(campaigns)?.into_reader()?;
    let what = What::new(name, vibration).map_err(|error| raised(&error))?;
    let data_type = what.data_type();
    let field = answer(data_type.clone());
    let chunks = detached(py, || {
        let question = Question::new(what, head)?;
        let mut answers = Vec::new();
        for chunk in reader {
            let chunk = chunk.map_err(usage)?;
            let campaigns = column(&chunk)?;
            let answer = |campaign: &Campaign| question.answer(campaign);
            answers.push(over(campaigns, &data_type, answer).map_err(usage)?);
        }
        if answers.is_empty() {
            answers.push(new_empty_array(&data_type));
        }
        Ok(answers)
    })?;
    PyChunkedArray::try_new(chunks, field)
}

/// The column `campaign` of a record batch; a column of campaigns itself.
fn column(chunk: &ArrayRef) -> Result<&dyn Array, Error> {
    let Some(columns) = chunk.as_struct_opt() else {
        let problem = format!("the column is of type {}, no campaigns", chunk.data_type());
        return Err(usage(problem));
    };
    if let Some(campaigns) = columns.column_by_name("campaign") {
        return Ok(campaigns);
    }
    if columns.column_by_name("readings").is_none() {
        let names = columns.column_names().join(", ");
        let problem = format!("there is no column campaign, only {names}");
        return Err(usage(problem));
    }
    Ok(chunk)
}

/// Name and type of the column of answers.
fn answer(data_type: DataType) -> FieldRef {
    Arc::new(Field::new("answer", data_type, true))
}

/// The column of answers of a function: its name and type.
#[pyfunction]
pub fn answer_field(name: &str) -> PyResult<PyField> {
    let what = What::new(name, None).map_err(|error| raised(&error))?;
    Ok(PyField::new(answer(what.data_type())))
}

/// A campaign folder as JSON.
#[pyfunction]
pub fn read(py: Python<'_>, folder: PathBuf) -> PyResult<String> {
    detached(py, || {
        let row = CampaignRow::new(&of_one_instrument(&folder)?).map_err(usage)?;
        serde_json::to_string(&row).map_err(usage)
    })
}

/// Campaign folders as a column of campaigns.
#[pyfunction]
pub fn folders_to_arrow(py: Python<'_>, folders: Vec<PathBuf>) -> PyResult<PyArray> {
    to_column(py, &folders, |folder| of_one_instrument(folder))
}

/// Campaigns as JSON, as a column of campaigns.
#[pyfunction]
pub fn dicts_to_arrow(py: Python<'_>, campaigns: Vec<String>) -> PyResult<PyArray> {
    to_column(py, &campaigns, |json| dicts::campaign(json))
}

fn to_column<T: Sync>(
    py: Python<'_>,
    from: &[T],
    read: impl Fn(&T) -> Result<Campaign, Error> + Send + Sync,
) -> PyResult<PyArray> {
    let column = detached(py, || {
        let row = |one| CampaignRow::new(&read(one)?).map_err(usage);
        let rows: Vec<CampaignRow> = from.par_iter().map(row).collect::<Result<_, _>>()?;
        encode(&rows).map_err(usage)
    })?;
    Ok(PyArray::from_array_ref(column))
}
