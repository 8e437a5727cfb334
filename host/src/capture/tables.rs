//! The tables of a campaign from what its record tells.

use std::collections::BTreeMap;
use std::path::Path;

use shared::model::SpecificForce;
use shared::wire::message::Plateau;

use super::ledger::{Ledger, Shaken, Taken};
use crate::bench::dial;
use crate::bench::plan::Shake;
use crate::campaign::{
    Campaign, CampaignConfig, Drift, Measured, Reading, ReferenceMoments, Run, VibrationKind,
};
use crate::error::Error;
use crate::front_end::FrontEnd;
use crate::reduction::SegmentSums;

/// An axis of the reference stands still below this rms, g: its noise has no shape of interest.
const STANDS_STILL_G: f64 = 1e-3;

/// The column of static.csv for what the person remarked.
const REMARK: &str = "remark";

/// The campaign of the readings and runs that count. `file` is named in what is wrong.
///
/// # Errors
/// A record that never says who the instrument is; a whole segment without blocks.
pub fn campaign(
    mut config: CampaignConfig,
    ledger: &Ledger,
    file: &Path,
) -> Result<Campaign, Error> {
    let identity = ledger.reduction().identity().ok_or_else(|| {
        let problem = "the instrument never says who it is, so that its codes have no unit";
        Error::input(file, problem)
    })?;
    config.acquisition.sample_rate_hz = identity.sample_rate_hz;
    let mut tables = Tables {
        front_end: config.acquisition.front_end(),
        local_gravity_g: config.bench.local_gravity_g,
        block_s: f64::from(identity.block_samples) / identity.sample_rate_hz,
        sample_rate_hz: identity.sample_rate_hz,
        ledger,
        file,
        reading_sigma_v: BTreeMap::new(),
        plateau_sigma_v: BTreeMap::new(),
    };
    let readings = ledger
        .readings()
        .map(|taken| (taken.blocks, tables.sums(taken)));
    let reading_sigma_v = tables.pooled_sigma_v(readings)?;
    let quiet = [Plateau::Before, Plateau::After];
    let plateaus = ledger
        .runs()
        .flat_map(|run| quiet.map(|plateau| (run.blocks, tables.plateau(run, plateau))));
    let plateau_sigma_v = tables.pooled_sigma_v(plateaus)?;
    (tables.reading_sigma_v, tables.plateau_sigma_v) = (reading_sigma_v, plateau_sigma_v);

    let readings = (2..).zip(ledger.readings());
    let readings = readings.map(|(line, taken)| tables.reading(taken, line));
    let runs = (2..).zip(ledger.runs());
    let runs = runs.map(|(line, shaken)| tables.run(shaken, line));
    Ok(Campaign {
        config,
        readings: readings.collect::<Result<_, _>>()?,
        runs: runs.collect::<Result<_, _>>()?,
    })
}

struct Tables<'r> {
    front_end: FrontEnd,
    local_gravity_g: f64,
    /// Length of a block, s.
    block_s: f64,
    sample_rate_hz: f64,
    ledger: &'r Ledger,
    file: &'r Path,
    /// Standard uncertainty of a mean from noise, V, of readings and of plateaus of so many blocks.
    reading_sigma_v: BTreeMap<u32, f64>,
    plateau_sigma_v: BTreeMap<u32, f64>,
}

impl Tables<'_> {
    fn bad(&self, problem: impl ToString) -> Error {
        Error::input(self.file, problem.to_string())
    }

    fn sums(&self, taken: &Taken) -> Result<&SegmentSums, Error> {
        let sums = self.ledger.reduction().reading(taken.number);
        sums.ok_or_else(|| self.bad(format!("has no blocks of reading {}", taken.number)))
    }

    fn plateau(&self, shaken: &Shaken, plateau: Plateau) -> Result<&SegmentSums, Error> {
        let number = shaken.number;
        let sums = self.ledger.reduction().plateau(number, plateau);
        sums.ok_or_else(|| self.bad(format!("has no blocks of run {number}, {plateau:?}")))
    }

    /// Standard uncertainty of the mean of one segment at rest, V at the instrument's output, by the number of its blocks:
    /// pooled over segments of one length, since one alone tells its own noise badly.
    fn pooled_sigma_v<'s>(
        &self,
        segments: impl Iterator<Item = (u32, Result<&'s SegmentSums, Error>)>,
    ) -> Result<BTreeMap<u32, f64>, Error> {
        let mut sums: BTreeMap<u32, (f64, f64, u64)> = BTreeMap::new();
        for (blocks, segment) in segments {
            let segment = segment?;
            let difference = segment.half_difference();
            let difference = difference.ok_or_else(|| self.bad("has segments cut short"))?;
            let (squares, count, samples) = sums.entry(blocks).or_default();
            *squares += difference.powi(2);
            *count += 1.0;
            *samples += segment.moments.count();
        }
        let v_per_code = self.output_v_per_code()?;
        let sigma = |(squares, count, samples): (f64, f64, u64)| {
            // Codes that do not differ at all are still rounded: 1 / 12 of a code squared, a sample.
            let least = count / (12.0 * samples.max(1) as f64);
            v_per_code * (0.25 * squares / count).max(least).sqrt()
        };
        Ok(sums
            .into_iter()
            .map(|(blocks, sum)| (blocks, sigma(sum)))
            .collect())
    }

    /// The instrument's output per code of its channel, V.
    fn output_v_per_code(&self) -> Result<f64, Error> {
        let at_converter = self.ledger.reduction().volts_per_code(0);
        let at_converter = at_converter.map_err(|error| self.bad(error))?;
        Ok(self.front_end.output_v(at_converter))
    }

    /// Mean output of a segment, V.
    fn mean_v(&self, sums: &SegmentSums) -> Result<f64, Error> {
        Ok(self.output_v_per_code()? * sums.moments.mean()[0])
    }

    fn reading(&self, taken: &Taken, line: u64) -> Result<Reading, Error> {
        let dwell = &taken.dwell;
        let [i, p, o] = dial::nominal(dwell).map(|a| a * self.local_gravity_g);
        // Restarted, the instrument has another bias.
        let restarted = self.ledger.was_restarted();
        let remark = (!taken.remark.is_empty()).then(|| (REMARK.into(), taken.remark.clone()));
        Ok(Reading {
            order: u64::from(taken.number),
            time_s: taken.time_s,
            series: dwell.series,
            dial_deg: dwell.dial_deg,
            mount_deg: dwell.mount_deg,
            approach: dwell.approach,
            specific_force_g: SpecificForce::new(i, p, o),
            temp_c: taken.temp_c,
            output_v: self.mean_v(self.sums(taken)?)?,
            sigma_v: self
                .reading_sigma_v
                .get(&taken.blocks)
                .copied()
                .unwrap_or(0.0),
            session: restarted.then(|| format!("power-up-{}", taken.power_up + 1)),
            exclude: false,
            line,
            unknown: remark.into_iter().collect(),
        })
    }

    fn run(&self, shaken: &Shaken, line: u64) -> Result<Run, Error> {
        let shake = &shaken.shake;
        let during = self.plateau(shaken, Plateau::During)?;
        let duration_s = f64::from(shaken.blocks) * self.block_s;
        let drift = during.drift_per_s(duration_s);
        let (drift, drift_sigma) = drift.map_err(|error| self.bad(error))?;
        let scale = self.output_v_per_code()?;
        let a0_g = shake.a0.map(|a| a * self.local_gravity_g);
        Ok(Run {
            run: u64::from(shaken.number),
            time_s: shaken.time_s,
            kind: shake.kind,
            direction: shake.direction,
            level_g: shake.level_g,
            band_hz: [shake.f_lo_hz, shake.f_hi_hz],
            specific_force_g: SpecificForce::new(a0_g[0], a0_g[1], a0_g[2]),
            temp_c: shaken.temp_c,
            duration_s,
            measured: Some(Measured {
                before_v: self.mean_v(self.plateau(shaken, Plateau::Before)?)?,
                during_v: self.mean_v(during)?,
                after_v: Some(self.mean_v(self.plateau(shaken, Plateau::After)?)?),
                sigma_v: self
                    .plateau_sigma_v
                    .get(&shaken.blocks)
                    .copied()
                    .unwrap_or(0.0),
                drift: Some(Drift {
                    v_per_s: scale * drift,
                    sigma_v_per_s: scale * drift_sigma,
                }),
                extremes: None,
            }),
            reference: Some(self.reference(shaken, during)?),
            session: None,
            exclude: false,
            line,
            unknown: Vec::new(),
        })
    }

    /// What the reference saw; its rms is corrected for the droop of the converter's filter.
    fn reference(&self, shaken: &Shaken, during: &SegmentSums) -> Result<ReferenceMoments, Error> {
        let droop = droop(&shaken.shake, self.sample_rate_hz);
        let mut seen = ReferenceMoments {
            rms_g: [0.0; 3],
            skewness: [0.0; 3],
            kurtosis: [0.0; 3],
            correlation: Some(during.reference_correlation()),
        };
        for axis in 0..3 {
            let channel = axis + 1;
            let scale = self.ledger.reduction().volts_per_code(channel);
            let scale = scale.map_err(|error| self.bad(error))?;
            let (rms, skewness, kurtosis) = during.shape(channel);
            let rms_g = rms * scale / shaken.reference_v_per_g / droop;
            if rms_g > STANDS_STILL_G {
                (seen.rms_g[axis], seen.skewness[axis], seen.kurtosis[axis]) =
                    (rms_g, skewness, kurtosis);
            }
        }
        if let Some(correlation) = &mut seen.correlation {
            for (of, (j, k)) in correlation.iter_mut().zip([(0, 1), (0, 2), (1, 2)]) {
                let moves = seen.rms_g[j] > 0.0 && seen.rms_g[k] > 0.0;
                *of = if moves { of.clamp(-1.0, 1.0) } else { 0.0 };
            }
        }
        Ok(seen)
    }
}
/// Factor on the rms of a vibration by the converter's sinc3 filter; over a band the root of the mean square.
fn droop(shake: &Shake, sample_rate_hz: f64) -> f64 {
    let power = |frequency_hz: f64| {
        let x = std::f64::consts::PI * frequency_hz / sample_rate_hz;
        (x.sin() / x).powi(6)
    };
    match shake.kind {
        VibrationKind::Sine => power(shake.f_lo_hz).sqrt(),
        VibrationKind::Random => {
            let width = shake.f_hi_hz - shake.f_lo_hz;
            let at = |k: i32| shake.f_lo_hz + (f64::from(k) + 0.5) / 256.0 * width;
            ((0..256).map(|k| power(at(k))).sum::<f64>() / 256.0).sqrt()
        }
    }
}
