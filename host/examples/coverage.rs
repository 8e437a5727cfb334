//! How often the interval of 95 % holds the true shift, by kind of noise and place of the windows.
//!
//! ```text
//! cargo run --release -p host --example coverage -- 1000
//! ```

#[path = "../tests/common/noise.rs"]
mod noise;

use noise::{Geometry, Interval, Noise};
use rayon::prelude::*;

fn main() {
    let records = std::env::args().nth(1).and_then(|text| text.parse().ok());
    let records: u64 = records.unwrap_or(100);
    let place = |before_s: f64, gap_s: f64, during_s: f64, whole: bool| Geometry {
        before_s,
        gap_s,
        during_s,
        whole,
    };
    let places = [
        Geometry::SHORT,
        Geometry::APART,
        place(60.0, 10.0, 60.0, true),
        place(60.0, 3600.0, 60.0, true),
        place(60.0, 3600.0, 60.0, false),
        place(10.0, 60.0, 10.0, false),
    ];
    println!("noise        before   gap during  gap in record   told   hold  half/white");
    for kind in Noise::ALL {
        for geometry in places {
            let found: Vec<Interval> = (0..records)
                .into_par_iter()
                .map(|seed| geometry.interval(kind, seed))
                .collect();
            let told: Vec<&Interval> = found.iter().filter(|i| i.told).collect();
            let count = told.len().max(1) as f64;
            let held = told.iter().filter(|i| i.holds).count() as f64 / count;
            let half = told.iter().map(|i| i.half_over_white).sum::<f64>() / count;
            println!(
                "{:12} {:6} {:6} {:6}  {:13} {:6.3} {held:6.3} {half:6.2}",
                format!("{kind:?}"),
                geometry.before_s,
                geometry.gap_s,
                geometry.during_s,
                geometry.whole,
                told.len() as f64 / records as f64,
            );
        }
    }
}
