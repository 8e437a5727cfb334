//! The paper's Tables 1 and 2, diagnosed: what so little data can and cannot say.
//!
//! Table 1 stands for the 24 readings that it was made from (they are computed from it by (1)), Table 2 for one run in
//! white noise of 1 g rms along IA at a0 = 0. The paper states no uncertainty: its head's +-10 arcsec and the rounding of
//! what is printed are the least. Neither band nor length of its noise is printed; they are taken here.

use serde::Serialize;
use shared::model::NOMINAL;
use shared::tumble::paper_plan;

use inference::model::Member;
use inference::prior::{Prior, grid};

use super::Published;
use crate::campaign::{
    Acquisition, Approach, Bench, Campaign, CampaignConfig, Drift, Instrument, Measured, Reading,
    Run, VibrationKind,
};
use crate::campaign_model::CampaignModel;
use crate::campaign_model::assumptions::Assumptions;
use crate::diagnose::{Verdict, diagnose};
use crate::effects::identity::Stage;
use crate::effects::{self, Action, Effect};
use crate::error::Error;

/// Half width of the head's error, arcsec.
const HEAD_ARCSEC: f64 = 10.0;
/// Half a unit of the last digit of Table 1 (g) and of Table 2 (g).
const ROUNDING_1_G: f64 = 0.5e-7;
const ROUNDING_2_G: f64 = 0.5e-5;
/// Standard deviation of an even distribution over its half width.
const EVEN: f64 = 0.577_350_269_189_625_8;
const BAND_HZ: [f64; 2] = [20.0, 2000.0];
const DURATION_S: f64 = 60.0;
/// Vibration error that is none beside what is printed, g.
const NOTHING_G: f64 = 1e-9;

/// What one instrument's rows of both tables say.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct TableDiagnosis {
    /// Name of the type.
    pub instrument: &'static str,
    /// Verdict of the diagnosis of 24 readings and one run.
    pub verdict: Verdict,
    /// Measured less (9) from Table 1, g.
    pub gap_g: f64,
    /// Directions of the coefficients that the 24 readings leave free; a step along one makes up the gap.
    pub blind_directions: usize,
    /// Measured vibration errors less these directions: what is left to test an effect.
    pub spare_numbers: i64,
    /// Effects of which each alone makes up the whole gap.
    pub would_do: Vec<WouldDo>,
    /// Effects that such a run cannot show at any size.
    pub silent: Vec<&'static str>,
    /// Effects that show in such a run but at no size make up this gap.
    pub excluded: Vec<&'static str>,
}

/// An effect that makes up a gap.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct WouldDo {
    /// Its identifier.
    pub effect: &'static str,
    /// Where it acts.
    pub stage: Stage,
    /// Name and value of its parameter, if it has one alone and in proportion.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub parameter: Option<(&'static str, f64)>,
}

/// Diagnoses one instrument's rows.
///
/// # Errors
/// Those of [`diagnose`].
pub fn diagnose_published(row: &Published) -> Result<TableDiagnosis, Error> {
    let campaign = campaign(row);
    let study = diagnose(&campaign, &[])?;
    let effects: Vec<&'static Effect> = effects::catalogue().collect();
    let scale_v_per_g = row.coefficients.scale_factor_v_per_g;
    let model = CampaignModel::with_scale(
        &campaign,
        &[],
        &effects,
        &Assumptions::default(),
        scale_v_per_g,
    );
    let vre_g = |members: &[Member]| vre_g(&model, row, members);
    let gap_g = row.measured_vre_g - vre_g(&[]);
    let mut found = TableDiagnosis {
        instrument: row.instrument,
        verdict: study.diagnosis.verdict,
        gap_g,
        blind_directions: model.blind_directions(),
        spare_numbers: 1 - model.blind_directions() as i64,
        would_do: Vec::new(),
        silent: Vec::new(),
        excluded: Vec::new(),
    };
    for (component, effect) in effects.into_iter().enumerate() {
        match alone(effect, component, gap_g, |members| {
            vre_g(members) - vre_g(&[])
        }) {
            Alone::Silent => found.silent.push(effect.id),
            Alone::Excluded => found.excluded.push(effect.id),
            Alone::WouldDo(parameter) => found.would_do.push(WouldDo {
                effect: effect.id,
                stage: effect.stage,
                parameter,
            }),
        }
    }
    Ok(found)
}

enum Alone {
    Silent,
    Excluded,
    WouldDo(Option<(&'static str, f64)>),
}

/// What an effect alone can make of a gap, by the grid of its parameters.
fn alone(
    effect: &'static Effect,
    component: usize,
    gap_g: f64,
    adds_g: impl Fn(&[Member]) -> f64,
) -> Alone {
    if let Action::AddsVariance(_) = effect.action {
        return Alone::Silent;
    }
    let (mut least, mut greatest) = (0.0_f64, 0.0_f64);
    for values in grid(effect.parameters) {
        let member = Member { component, values };
        let mut unit = adds_g(std::slice::from_ref(&member));
        if unit.abs() < NOTHING_G {
            continue;
        }
        if effect.linear() > 0 {
            // Any multiple of either sign.
            if let [only] = effect.parameters {
                return Alone::WouldDo(Some((only.name, gap_g / unit)));
            }
            return Alone::WouldDo(None);
        }
        // The ends of the range, beyond the grid's own points.
        for (k, parameter) in effect.parameters.iter().enumerate() {
            let Prior::Nonlinear { from, to, .. } = parameter.prior else {
                continue;
            };
            for end in [from, to] {
                let mut member = member.clone();
                member.values[k] = end;
                unit = adds_g(&[member]);
                least = least.min(unit);
                greatest = greatest.max(unit);
            }
        }
        least = least.min(unit);
        greatest = greatest.max(unit);
    }
    if greatest - least < NOTHING_G {
        Alone::Silent
    } else if (least..=greatest).contains(&gap_g) {
        Alone::WouldDo(None)
    } else {
        Alone::Excluded
    }
}

/// Vibration error of the run with Table 1's coefficients and further effects, g.
fn vre_g(model: &CampaignModel, row: &Published, members: &[Member]) -> f64 {
    let mut base_values: [f64; NOMINAL] = row.coefficients.to_nominal();
    for coefficient in &mut base_values[1..] {
        *coefficient *= row.coefficients.scale_factor_v_per_g;
    }
    let (values, _) = model.prediction(members, &base_values);
    model.vre_g(&values, 0)
}

/// Tables 1 and 2 as a campaign.
fn campaign(row: &Published) -> Campaign {
    let c = &row.coefficients;
    let reference_temp_c = 20.0;
    let bench = Bench {
        dial_sigma_arcsec: EVEN * HEAD_ARCSEC,
        dial_repeat_sigma_arcsec: 0.0,
        mount_sigma_arcsec: 0.0,
        level_sigma_arcsec: EVEN * HEAD_ARCSEC,
        local_gravity_g: 1.0,
        reference_temp_c,
        session_bias_sigma_g: None,
        session_alignment_sigma_arcsec: None,
        session_gain_rel_sigma: None,
        unknown: Default::default(),
    };
    let instrument = Instrument {
        serial: row.instrument.into(),
        scale_factor_nominal_v_per_g: c.scale_factor_v_per_g,
        full_scale_g: 10.0,
        unknown: Default::default(),
    };
    let acquisition = Acquisition {
        sample_rate_hz: 400.0,
        divider: None,
        gain: None,
        sigma_dof: None,
        unknown: Default::default(),
    };
    let readings = paper_plan().zip(0..).map(|(position, order)| Reading {
        order,
        time_s: 90.0 * order as f64,
        series: position.series,
        dial_deg: position.dial_deg,
        mount_deg: position.mount_deg,
        approach: Approach::CounterClockwise,
        specific_force_g: position.specific_force(),
        temp_c: reference_temp_c,
        output_v: c.output_v(position.specific_force()),
        sigma_v: EVEN * ROUNDING_1_G * c.scale_factor_v_per_g,
        session: None,
        exclude: false,
        line: order + 2,
        unknown: Vec::new(),
    });
    let rest = shared::model::SpecificForce::new(0.0, 0.0, 1.0);
    let before_v = c.output_v(rest);
    let run = Run {
        run: 0,
        time_s: 3600.0,
        kind: VibrationKind::Random,
        direction: [1.0, 0.0, 0.0],
        level_g: 1.0,
        band_hz: BAND_HZ,
        specific_force_g: rest,
        temp_c: reference_temp_c,
        duration_s: DURATION_S,
        measured: Some(Measured {
            before_v,
            during_v: before_v + c.scale_factor_v_per_g * row.measured_vre_g,
            after_v: Some(before_v),
            // The rounding belongs to the difference of two plateaus.
            sigma_v: EVEN * ROUNDING_2_G * c.scale_factor_v_per_g * std::f64::consts::FRAC_1_SQRT_2,
            drift: Some(Drift {
                v_per_s: 0.0,
                sigma_v_per_s: ROUNDING_2_G / DURATION_S,
            }),
            extremes: None,
        }),
        reference: None,
        session: None,
        exclude: false,
        line: 2,
        unknown: Vec::new(),
    };
    Campaign {
        config: CampaignConfig::new(instrument, bench, acquisition, None),
        readings: readings.collect(),
        runs: vec![run],
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::paper::{TABLES, compare};

    #[test]
    fn one_number_fixes_the_blind_direction_and_leaves_nothing_to_test_an_effect_by() {
        for (row, compared) in TABLES.iter().zip(compare()) {
            let found = diagnose_published(row).unwrap();
            assert_eq!(found.verdict, Verdict::CannotTell, "{}", row.instrument);
            assert_eq!((found.blind_directions, found.spare_numbers), (1, 0));
            let gap_g = row.measured_vre_g - compared.equation_9_vre_g;
            assert!(
                (found.gap_g - gap_g).abs() < 1e-9,
                "{} {gap_g}",
                found.gap_g
            );
            assert!(found.would_do.len() > 1);
        }
    }

    #[test]
    fn odd_terms_do_not_show_at_rest_and_a_sixth_order_does_by_fifteen_times_its_coefficient() {
        let found = diagnose_published(&TABLES[0]).unwrap();
        for id in [
            "quintic",
            "odd-quadratic",
            "bias-asymmetry",
            "cross-axis-squares",
            "dial-index-error",
        ] {
            assert!(found.silent.contains(&id), "{id}");
        }
        let sextic = found
            .would_do
            .iter()
            .find(|e| e.effect == "sextic")
            .unwrap();
        let (name, value) = sextic.parameter.unwrap();
        assert_eq!(name, "k6_per_g5");
        // M[w^6] = 15 sigma^6 at 1 g rms, to the end of the normal density that is integrated over.
        assert!((15.0 * value / found.gap_g - 1.0).abs() < 1e-6);
    }
}
