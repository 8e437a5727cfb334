//! What is odd about a campaign but may be so: told, and no error.

use super::Campaign;
use crate::error::decimal;

/// A temperature that is rather kelvin, degrees Fahrenheit or a slip, degrees Celsius.
const HOT_C: f64 = 100.0;

impl Campaign {
    /// What is odd, a line each: keys that are not known, levels beyond the full scale, heat, times that go backwards.
    pub fn oddities(&self) -> Vec<String> {
        let keys = self.config.unknown_keys().into_iter();
        let keys = keys.map(|key| format!("campaign.toml: {key} is not known; kept, and not used"));
        let others = [self.beyond_full_scale(), self.hot(), self.backwards()];
        keys.chain(others.into_iter().flatten()).collect()
    }

    fn beyond_full_scale(&self) -> Option<String> {
        let full_scale_g = self.config.instrument.full_scale_g;
        let along_input_axis_g = |run: &super::Run| {
            (run.direction[0] * run.level_g).abs() + run.specific_force_g.i.abs()
        };
        let beyond = |run: &&super::Run| along_input_axis_g(run) > full_scale_g;
        let mut runs = self.runs.iter().filter(beyond);
        let first = runs.next()?;
        Some(format!(
            "vibration.csv: run {} has {} g along the input axis, level and gravity together, beyond full_scale_g = {} of \
             campaign.toml{}",
            first.run,
            decimal(along_input_axis_g(first)),
            decimal(full_scale_g),
            more(runs.count()),
        ))
    }

    fn hot(&self) -> Option<String> {
        let readings = self.readings.iter();
        let readings = readings.map(|r| (r.temp_c, format!("static.csv: reading {}", r.order)));
        let runs = self.runs.iter();
        let runs = runs.map(|r| (r.temp_c, format!("vibration.csv: run {}", r.run)));
        let mut hot = readings.chain(runs).filter(|(temp_c, _)| *temp_c > HOT_C);
        let (temp_c, place) = hot.next()?;
        let more = more(hot.count());
        Some(format!(
            "{place} is at {} C; is that the unit?{more}",
            decimal(temp_c)
        ))
    }

    fn backwards(&self) -> Option<String> {
        let pairs = self.readings.windows(2);
        let mut back = pairs.filter(|pair| pair[1].time_s < pair[0].time_s);
        let pair = back.next()?;
        Some(format!(
            "static.csv: reading {} at {} s follows one at {} s: time goes backwards{}",
            pair[1].order,
            pair[1].time_s,
            pair[0].time_s,
            more(back.count()),
        ))
    }
}

/// How many others are alike.
fn more(count: usize) -> String {
    match count {
        0 => String::new(),
        _ => format!(" (and {count} more)"),
    }
}
