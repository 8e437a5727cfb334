//! A small valid campaign to start from.

use host::campaign::{
    Acquisition, Approach, Bench, Campaign, CampaignConfig, Drift, Extremes, Instrument, Measured,
    Reading, ReferenceMoments, Run, Series, Shaker, VibrationKind,
};
use shared::model::{Coefficients, SpecificForce};

/// An instrument of 1.2 V/g with small coefficients.
pub fn coefficients() -> Coefficients<f64> {
    Coefficients::from_nominal([
        1.2, 1e-4, 3e-4, -2.5e-4, -1.2e-4, 1.1e-4, 3e-4, -4e-4, 1e-5, -2e-5, 3e-5,
    ])
}

/// Readings at every 30 and 45 deg in three series, one sine and one random run, and one to be predicted.
pub fn campaign() -> Campaign {
    let unknown = toml::Table::new;
    let config = CampaignConfig::new(
        Instrument {
            serial: "A1".into(),
            scale_factor_nominal_v_per_g: 1.25,
            full_scale_g: 10.0,
            unknown: unknown(),
        },
        Bench {
            dial_sigma_arcsec: 5.8,
            dial_repeat_sigma_arcsec: 0.2,
            mount_sigma_arcsec: 60.0,
            level_sigma_arcsec: 5.8,
            local_gravity_g: 1.0,
            reference_temp_c: 22.0,
            session_bias_sigma_g: None,
            session_alignment_sigma_arcsec: None,
            session_gain_rel_sigma: None,
            unknown: unknown(),
        },
        Acquisition {
            sample_rate_hz: 400.0,
            divider: None,
            gain: None,
            sigma_dof: None,
            unknown: unknown(),
        },
        Some(Shaker {
            reference_rms_rel_sigma: 2e-4,
            reference_cross_sensitivity: None,
            reference_noise_g: None,
            reference_gain_rel_sigma: None,
            peak_rel_sigma: None,
            peak_gain_rel_sigma: None,
            unknown: unknown(),
        }),
    );
    let runs = vec![
        run(0, VibrationKind::Sine, [60.0, 60.0], true),
        run(1, VibrationKind::Random, [20.0, 2000.0], true),
        run(2, VibrationKind::Random, [20.0, 2000.0], false),
    ];
    Campaign {
        config,
        readings: readings(),
        runs,
    }
}

fn readings() -> Vec<Reading> {
    let mut readings = Vec::new();
    for series in [Series::OutputAxis, Series::PendulousAxis, Series::InputAxis] {
        for dial_deg in (0..24).map(|step| f64::from(step) * 15.0) {
            if dial_deg % 30.0 != 0.0 && dial_deg % 45.0 != 0.0 {
                continue;
            }
            let force = series.specific_force(dial_deg.to_radians());
            let order = readings.len() as u64;
            readings.push(Reading {
                order,
                time_s: 90.0 * (order + 1) as f64,
                series,
                dial_deg,
                mount_deg: 0.0,
                approach: [Approach::Clockwise, Approach::CounterClockwise][readings.len() % 2],
                specific_force_g: force,
                temp_c: 22.5,
                output_v: coefficients().output_v(force),
                sigma_v: 2e-6,
                session: None,
                exclude: false,
                line: order + 2,
                unknown: Vec::new(),
            });
        }
    }
    readings
}

fn run(run: u64, kind: VibrationKind, band_hz: [f64; 2], made: bool) -> Run {
    let specific_force_g = SpecificForce::new(0.0, 0.0, 1.0);
    let before_v = coefficients().output_v(specific_force_g);
    let rms_g = match kind {
        VibrationKind::Sine => 3.0 * std::f64::consts::FRAC_1_SQRT_2,
        VibrationKind::Random => 3.0,
    };
    let measured = Measured {
        before_v,
        during_v: before_v + 1e-4,
        after_v: Some(before_v),
        sigma_v: 2e-6,
        drift: Some(Drift {
            v_per_s: -6.4e-7,
            sigma_v_per_s: 5.7e-7,
        }),
        extremes: Some(Extremes {
            minimum_v: before_v - 2.16,
            maximum_v: before_v + 2.16,
        }),
    };
    Run {
        run,
        time_s: 8100.0 + 180.0 * run as f64,
        kind,
        direction: [0.6, 0.8, 0.0],
        level_g: 3.0,
        band_hz,
        specific_force_g,
        temp_c: 22.5,
        duration_s: 8.0,
        measured: made.then_some(measured),
        reference: Some(ReferenceMoments {
            rms_g: [0.6 * rms_g, 0.8 * rms_g, 0.0],
            skewness: [0.0; 3],
            kurtosis: [1.5, 1.5, 0.0],
            correlation: Some([1.0, 0.0, 0.0]),
        }),
        session: None,
        exclude: false,
        line: run + 2,
        unknown: Vec::new(),
    }
}
