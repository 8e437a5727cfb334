//! The output as it comes, block by block: what is drawn, how noisy it is, and since when it has been steady.

use std::collections::VecDeque;

use shared::wire::message::Block;

/// Points that are drawn: 30 s at ten a second.
const POINTS: usize = 300;
/// Time between two of them, s.
const POINT_S: f64 = 0.1;

/// A block whose mean is within so many of its own standard uncertainties of the stretch's mean belongs to it. Chosen: noise
/// alone passes it once in 5e8 blocks, two months; a dial that moves by an arcminute is a hundred times as much.
const STEADY_SIGMAS: f64 = 6.0;
/// The same in the instrument's own slow noise, V over the nominal scale factor, g. Chosen: what a table does on which a hand
/// is laid is more.
const STEADY_G: f64 = 2e-4;

/// The output of the instrument as it comes.
#[derive(Clone, Debug)]
pub struct Live {
    /// The instrument's output per code of its channel, V.
    v_per_code: f64,
    /// The same in g, by the nominal scale factor.
    tolerance_v: f64,
    points: VecDeque<[f64; 2]>,
    gathered: (f64, u32),
    gathered_since_s: f64,
    /// Since when the output has been steady, s; its mean and the number of blocks behind it.
    since_s: Option<f64>,
    mean_v: f64,
    blocks: f64,
    last: Option<(f64, f64)>,
}

impl Live {
    /// Nothing yet of an instrument with that output per code, V, and that nominal scale factor, V/g.
    pub fn new(v_per_code: f64, scale_factor_v_per_g: f64) -> Self {
        Self {
            v_per_code,
            tolerance_v: STEADY_G * scale_factor_v_per_g.abs(),
            points: VecDeque::new(),
            gathered: (0.0, 0),
            gathered_since_s: 0.0,
            since_s: None,
            mean_v: 0.0,
            blocks: 0.0,
            last: None,
        }
    }

    /// Takes a block that came at `now_s`.
    pub fn take(&mut self, block: &Block, now_s: f64) {
        if block.count == 0 {
            return;
        }
        let count = f64::from(block.count);
        let mean_v = self.v_per_code * block.moments.sum[0] as f64 / count;
        let rms_v = self.v_per_code * f64::from(block.moments.second[0]).max(0.0).sqrt();
        self.last = Some((mean_v, rms_v));
        let tolerance_v = self.tolerance_v.max(STEADY_SIGMAS * rms_v / count.sqrt());
        if self.since_s.is_none() || (mean_v - self.mean_v).abs() > tolerance_v {
            (self.since_s, self.mean_v, self.blocks) = (Some(now_s), mean_v, 1.0);
        } else {
            self.blocks += 1.0;
            self.mean_v += (mean_v - self.mean_v) / self.blocks;
        }
        self.gather(mean_v, now_s);
    }

    fn gather(&mut self, mean_v: f64, now_s: f64) {
        self.gathered.0 += mean_v;
        self.gathered.1 += 1;
        if now_s - self.gathered_since_s < POINT_S {
            return;
        }
        let (sum, count) = std::mem::take(&mut self.gathered);
        if self.points.len() == POINTS {
            self.points.pop_front();
        }
        self.points.push_back([now_s, sum / f64::from(count)]);
        self.gathered_since_s = now_s;
    }

    /// From here on the output has to be steady anew.
    pub fn restart(&mut self) {
        self.since_s = None;
    }

    /// How long the output has been steady, s.
    pub fn steady_s(&self, now_s: f64) -> f64 {
        self.since_s.map_or(0.0, |since| (now_s - since).max(0.0))
    }

    /// Mean of the last block and rms of its samples about it, V.
    pub fn last_v(&self) -> Option<(f64, f64)> {
        self.last
    }

    /// Time, s, and output, V, of the last half minute.
    pub fn points(&self) -> impl Iterator<Item = [f64; 2]> {
        self.points.iter().copied()
    }
}
