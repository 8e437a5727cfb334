//! What the pictures of a gap show: each run before and after the effects are added.

use inference::adequacy::gap;
use inference::fit::Fit;
use inference::model::SeparableModel;

use crate::campaign_model::CampaignModel;
use crate::forward::contribution::Observable;

/// One run's gaps, in units of their stated uncertainty.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GapRow {
    /// Run number.
    pub run: u64,
    /// Time of the plateau before the vibration, s.
    pub time_s: f64,
    /// Commanded level, g.
    pub level_g: f64,
    /// Middle of the band, Hz.
    pub centre_hz: f64,
    /// Output during the run: by the nominal model, and with the effects.
    pub during: [f64; 2],
    /// Output before the run.
    pub before: [f64; 2],
}

/// Every run that was made.
pub(super) fn rows(model: &CampaignModel, fit: &Fit) -> Vec<GapRow> {
    let gap = gap(model, fit);
    let during = model.rows(Observable::During).start;
    let used = |row: usize| model.observations().weight(during + row) > 0.0;
    let runs = model.conditions().runs.iter().enumerate();
    let made = runs.filter(|(row, run)| run.made && used(*row));
    let row = |(n, run): (usize, &crate::forward::rows::RunConditions)| {
        let at = |observable| {
            let row = model.rows(observable).start + n;
            [gap[row], fit.residuals[row]]
        };
        GapRow {
            run: run.number,
            time_s: run.time_s,
            level_g: run.level_g,
            centre_hz: run.centre_hz(),
            during: at(Observable::During),
            before: at(Observable::Before),
        }
    };
    made.map(row).collect()
}
