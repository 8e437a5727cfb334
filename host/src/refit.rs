//! Vibration error of runs by the nominal model fitted to all that was measured, static test and shaker runs together, and
//! by the same fit with effects.

use inference::fit::{Fit, fit, fit_base, tangent};
use inference::linear::inner_product;
use inference::model::{Member, SeparableModel};

use crate::campaign::{Campaign, Run};
use crate::campaign_model::CampaignModel;
use crate::effects::Effect;
use crate::error::Error;
use crate::forward::nominal::coefficients;
use crate::quantity::Quantity;

/// Predicts the vibration error of `runs`, one quantity (g) a run, in their order. `effects` act besides; their parameters
/// are fitted anew from the values given. `prior_sigma` is a standard deviation about zero of every coefficient but K1, in
/// its own unit.
///
/// # Errors
/// The campaign does not determine the model.
pub fn predict_refitted<'e>(
    campaign: &Campaign,
    effects: impl IntoIterator<Item = (&'static Effect, &'e [f64])>,
    runs: &[Run],
    prior_sigma: Option<f64>,
) -> Result<Vec<Quantity>, Error> {
    let (effects, values): (Vec<_>, Vec<_>) = effects.into_iter().unzip();
    let members = values.into_iter().enumerate();
    let members: Vec<Member> = members
        .map(|(component, values)| Member {
            component,
            values: values.to_vec(),
        })
        .collect();
    // A run of the campaign itself must not act twice; what others gave must not be learned from.
    let own: Vec<Run> = campaign.runs.iter().map(Run::unmade).collect();
    let mut new: Vec<Run> = runs.iter().map(Run::unmade).collect();
    let places: Vec<Option<usize>> = new
        .iter()
        .map(|run| own.iter().position(|own| own == run))
        .collect();
    new.retain(|run| !own.contains(run));
    let mut model = CampaignModel::new(campaign, &new, &effects);
    if let Some(sigma) = prior_sigma {
        model.set_prior_sigma(sigma);
    }
    let fit = fit_all(&mut model, &members)
        .ok_or_else(|| Error::Usage("the campaign does not determine the nominal model".into()))?;
    let nuisances = model.nuisances().len();
    let predictor = model.in_g(nuisances);
    let forecast = Forecast::new(&predictor, &fit);
    let commanded = &predictor.conditions().motions;
    let unseen = predictor.unseen_variance_g2(
        &coefficients(&fit.base_values),
        commanded,
        &forecast.record_g2,
    );
    let mut further = own.len()..;
    let places = places
        .into_iter()
        .map(|place| place.or_else(|| further.next()));
    let found = places.map(|place| {
        place.map_or(Quantity::UNDETERMINED, |place| {
            let row = predictor.row_of_run(place);
            let variance = forecast.variance_g2(row, &fit) + unseen[row];
            Quantity::new(forecast.vre_g[row], variance.sqrt())
        })
    });
    Ok(found.collect())
}

fn fit_all(model: &mut CampaignModel, members: &[Member]) -> Option<Fit> {
    let mut found = fit_base(model)?;
    if !members.is_empty() {
        for _ in 0..2 {
            model.linearise_about(&found.base_values);
            found = fit(model, members.to_vec(), &found.precision_factor, 3)?;
        }
    }
    Some(found)
}

/// What a fit says of every run's vibration error.
pub(crate) struct Forecast {
    /// Its expectation, g.
    pub(crate) vre_g: Vec<f64>,
    /// Its derivatives by the fit's unknowns, run by run.
    pub(crate) slopes: Vec<Vec<f64>>,
    /// Its variance from what the effects make of a record that nobody knows, g^2.
    pub(crate) record_g2: Vec<f64>,
}

impl Forecast {
    /// Of a fit, for the runs of a model whose rows are in g.
    pub(crate) fn new(predictor: &CampaignModel, fit: &Fit) -> Self {
        let (columns, values) = tangent(predictor, &fit.members, &fit.base_values);
        let rows = 0..predictor.conditions().runs.len();
        let slope = |row: usize| {
            columns
                .iter()
                .map(|c| predictor.vre_g(&c.values, row))
                .collect()
        };
        Self {
            vre_g: rows
                .clone()
                .map(|row| predictor.vre_g(&values, row) / fit.base_values[0])
                .collect(),
            slopes: rows.map(slope).collect(),
            record_g2: predictor.prediction(&fit.members, &fit.base_values).1,
        }
    }

    /// Variance of a run's vibration error from coefficients and parameters, g^2.
    fn variance_g2(&self, row: usize, fit: &Fit) -> f64 {
        let slope = &self.slopes[row];
        let rows = fit.covariance.chunks_exact(slope.len()).zip(slope);
        rows.map(|(row, x)| x * inner_product(row, slope))
            .sum::<f64>()
            .max(0.0)
    }
}
