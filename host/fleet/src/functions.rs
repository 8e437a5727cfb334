//! The functions of `vre` in SQL: `vre_identify(campaign)`, `vre_predict(campaign, vibration)`, `vre_diagnose(campaign)`, and the
//! aggregate `vre_bench(campaign)`.

use std::sync::Arc;

use columns::answers;
use columns::functions::{diagnosed, identified, over, predicted, vibration};
use columns::rows::{decode, to_array};
use datafusion::arrow::array::{Array, ArrayRef, AsArray, BinaryArray};
use datafusion::arrow::datatypes::{DataType, Field, FieldRef};
use datafusion::common::{Result, ScalarValue, exec_err};
use datafusion::error::DataFusionError;
use datafusion::logical_expr::function::{AccumulatorArgs, StateFieldsArgs};
use datafusion::logical_expr::{
    Accumulator, AggregateUDF, AggregateUDFImpl, ColumnarValue, ScalarFunctionArgs, ScalarUDF,
    ScalarUDFImpl, Signature, Volatility,
};
use datafusion::prelude::SessionContext;
use host::head::{Batch, DEFAULT_SPREAD, Prior, Reduced};
use serde::{Deserialize, Serialize};

use crate::head_of::{BenchRow, bench_type};

/// Registers all functions.
pub fn register(context: &SessionContext) {
    for what in [What::Identify, What::Predict, What::Diagnose] {
        context.register_udf(ScalarUDF::new_from_impl(OfCampaign::new(what)));
    }
    context.register_udaf(AggregateUDF::new_from_impl(OfBench::default()));
}

/// Which function.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
enum What {
    Identify,
    Predict,
    Diagnose,
}

/// A function of one campaign.
#[derive(Debug, PartialEq, Eq, Hash)]
struct OfCampaign {
    what: What,
    signature: Signature,
}

impl OfCampaign {
    fn new(what: What) -> Self {
        let arguments = if what == What::Predict { 2 } else { 1 };
        let signature = Signature::any(arguments, Volatility::Immutable);
        Self { what, signature }
    }
}

impl ScalarUDFImpl for OfCampaign {
    fn name(&self) -> &str {
        match self.what {
            What::Identify => "vre_identify",
            What::Predict => "vre_predict",
            What::Diagnose => "vre_diagnose",
        }
    }

    fn signature(&self) -> &Signature {
        &self.signature
    }

    fn return_type(&self, _arguments: &[DataType]) -> Result<DataType> {
        Ok(match self.what {
            What::Identify => answers::identification(),
            What::Predict => answers::prediction(),
            What::Diagnose => answers::diagnosis(),
        })
    }

    fn invoke_with_args(&self, arguments: ScalarFunctionArgs) -> Result<ColumnarValue> {
        let campaigns = arguments.args[0].to_array(arguments.number_rows)?;
        let data_type = arguments.return_type();
        let answers = match self.what {
            What::Identify => over(&campaigns, data_type, identified),
            What::Diagnose => over(&campaigns, data_type, diagnosed),
            What::Predict => {
                let ColumnarValue::Scalar(text) = &arguments.args[1] else {
                    return exec_err!(
                        "vre_predict: the vibration is one text for all rows, such as 'random:1'"
                    );
                };
                let text = text.try_as_str().flatten().unwrap_or_default();
                let runs = vibration(text).map_err(DataFusionError::Execution)?;
                let runs = [runs];
                over(&campaigns, data_type, |campaign| {
                    predicted(campaign, Some(&runs))
                })
            }
        };
        Ok(ColumnarValue::Array(answers?))
    }
}

/// The aggregate: what the campaigns of a head say of it, by normal equations that add up.
#[derive(Debug, PartialEq, Eq, Hash)]
struct OfBench {
    signature: Signature,
}

impl Default for OfBench {
    fn default() -> Self {
        let signature = Signature::any(1, Volatility::Immutable);
        Self { signature }
    }
}

impl AggregateUDFImpl for OfBench {
    fn name(&self) -> &str {
        "vre_bench"
    }

    fn signature(&self) -> &Signature {
        &self.signature
    }

    fn return_type(&self, _arguments: &[DataType]) -> Result<DataType> {
        Ok(bench_type())
    }

    fn accumulator(&self, _arguments: AccumulatorArgs) -> Result<Box<dyn Accumulator>> {
        Ok(Box::new(BenchState::default()))
    }

    fn state_fields(&self, arguments: StateFieldsArgs) -> Result<Vec<FieldRef>> {
        let name = format!("{}[sums]", arguments.name);
        Ok(vec![Arc::new(Field::new(name, DataType::Binary, true))])
    }
}

/// Sums so far.
#[derive(Clone, Debug, Serialize, Deserialize)]
struct BenchState {
    sums: Batch,
    /// Campaigns that could not be used, and why the first of them.
    refused: u64,
    reason: Option<String>,
}

impl Default for BenchState {
    fn default() -> Self {
        Self {
            sums: Batch::new(DEFAULT_SPREAD),
            refused: 0,
            reason: None,
        }
    }
}

impl BenchState {
    fn refuse(&mut self, count: u64, reason: Option<String>) {
        self.refused += count;
        self.reason = self.reason.take().or(reason);
    }
}

fn external(error: impl std::error::Error + Send + Sync + 'static) -> DataFusionError {
    DataFusionError::External(Box::new(error))
}

impl Accumulator for BenchState {
    fn update_batch(&mut self, values: &[ArrayRef]) -> Result<()> {
        let campaigns = &values[0];
        for row in (0..campaigns.len()).filter(|row| campaigns.is_valid(*row)) {
            let reduced = decode(campaigns, row).and_then(|campaign| {
                Reduced::of(&campaign.used()).map_err(|error| error.to_string())
            });
            let added = reduced
                .and_then(|reduced| self.sums.add(&reduced).map_err(|error| error.to_string()));
            if let Err(problem) = added {
                self.refuse(1, Some(problem));
            }
        }
        Ok(())
    }

    fn merge_batch(&mut self, states: &[ArrayRef]) -> Result<()> {
        let states: &BinaryArray = states[0].as_binary();
        for state in states.iter().flatten() {
            let other: Self = serde_json::from_slice(state).map_err(external)?;
            self.sums.merge(&other.sums).map_err(external)?;
            self.refuse(other.refused, other.reason);
        }
        Ok(())
    }

    fn state(&mut self) -> Result<Vec<ScalarValue>> {
        let bytes = serde_json::to_vec(self).map_err(external)?;
        Ok(vec![ScalarValue::Binary(Some(bytes))])
    }

    fn evaluate(&mut self) -> Result<ScalarValue> {
        let posterior = self.sums.posterior(&Prior::default());
        let row = match &posterior {
            Ok(posterior) => BenchRow::new(
                posterior,
                self.sums.campaigns,
                self.refused,
                self.reason.clone(),
            ),
            Err(error) => BenchRow::none(
                self.refused,
                self.reason.clone().unwrap_or_else(|| error.to_string()),
            ),
        };
        ScalarValue::try_from_array(&to_array(&[row], &bench_type())?, 0)
    }

    fn size(&self) -> usize {
        let order = 1 + host::head::TYPE + self.sums.marks_deg.len();
        size_of_val(self) + (1 + host::head::TYPE) * order * order * size_of::<f64>()
    }
}
