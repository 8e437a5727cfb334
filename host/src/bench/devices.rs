//! What the devices of a laboratory really do, where it is not what the campaign states of them.
//!
//! The bench as stated has one session, a table that follows its command and noise of a Gaussian.

use super::noise::{Seed, Stream};
use super::plan::Shake;

/// The devices; by default as the campaign states them.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Devices {
    /// Sessions of the shaker in the order of time. Runs before the first are as the readings were.
    pub sessions: Vec<Session>,
    /// The shaker's table.
    pub table: Table,
    /// The reference accelerometer on it.
    pub reference: Reference,
    /// Gain of the peak detector, less 1.
    pub peak_gain_error: f64,
    /// Degrees of freedom of Student's t that the instrument's noise has, above 2; a Gaussian without.
    pub tail_dof: Option<f64>,
}

/// One mounting and power-up of the instrument on the shaker.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Session {
    /// Its first run, counted from 0 over the plan and the runs to hold out; it lasts until the next session.
    pub first_run: usize,
    /// What the tables call it.
    pub name: Option<&'static str>,
    /// Bias beyond that of the readings, g.
    pub bias_g: f64,
    /// Small turn of the instrument about IA, PA, OA against its fixture, rad.
    pub turn_rad: [f64; 3],
    /// Gain of the logger over that of the readings, less 1.
    pub gain_error: f64,
}

impl Session {
    /// Components on the turned axes of a vector with these nominal ones, to first order in the turn.
    pub fn turned(&self, [i, p, o]: [f64; 3]) -> [f64; 3] {
        let [x, y, z] = self.turn_rad;
        [i + p * z - o * y, p + o * x - i * z, o + i * y - p * x]
    }
}

/// The table against its command; the reference sees what it really does.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Table {
    /// Level over the command, less 1, in all runs alike.
    pub gain_error: f64,
    /// Standard deviation of the same from run to run.
    pub scatter: f64,
}

/// The reference accelerometer.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Reference {
    /// What its axes (rows: IA, PA, OA) read of a motion along IA, PA, OA.
    pub response: [[f64; 3]; 3],
    /// White noise of each axis, g rms.
    pub noise_g: f64,
    /// Relative standard deviation of its rms values from run to run; as stated without.
    pub rms_rel_sigma: Option<f64>,
}

impl Default for Reference {
    fn default() -> Self {
        Self {
            response: [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
            noise_g: 0.0,
            rms_rel_sigma: None,
        }
    }
}

impl Reference {
    /// What its axes read of a unit of motion in that direction.
    pub fn seen(&self, direction: [f64; 3]) -> [f64; 3] {
        let product = |row: [f64; 3]| row.iter().zip(direction).map(|(r, n)| r * n).sum();
        self.response.map(product)
    }
}

impl Devices {
    /// The session of a run, counted over the plan and the runs to hold out.
    pub fn session(&self, run: usize) -> Session {
        let mut latest_first = self.sessions.iter().rev();
        let begun = latest_first.find(|session| session.first_run <= run);
        begun.cloned().unwrap_or_default()
    }

    /// What the table makes of the command of a run.
    pub fn moved(&self, run: usize, command: &Shake, seed: Seed) -> Shake {
        let miss = self.table.scatter * seed.stream("table", run as u64).normal();
        Shake {
            level_g: command.level_g * (1.0 + self.table.gain_error + miss),
            ..*command
        }
    }

    /// A deviate of the instrument's noise, mean 0, standard deviation 1.
    pub fn deviate(&self, stream: &mut Stream) -> f64 {
        match self.tail_dof {
            None => stream.normal(),
            Some(dof) => stream.student_t(dof),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::Session;

    /// Gravity along OA, the instrument turned about IA: PA then points down or up by the turn; about OA: nothing.
    #[test]
    fn a_turned_instrument_feels_gravity_on_the_axis_that_leaves_the_horizontal() {
        let turned = |turn_rad| {
            let session = Session {
                turn_rad,
                ..Session::default()
            };
            session.turned([0.0, 0.0, 1.0])
        };
        assert_eq!(turned([1e-4, 0.0, 0.0]), [0.0, 1e-4, 1.0]);
        assert_eq!(turned([0.0, 1e-4, 0.0]), [-1e-4, 0.0, 1.0]);
        assert_eq!(turned([0.0, 0.0, 1e-4]), [0.0, 0.0, 1.0]);
    }
}
