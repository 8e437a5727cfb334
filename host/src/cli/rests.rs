//! `vre rests`

use std::path::PathBuf;

use super::measure::TimeUnit;
use super::{Command, Console, within};
use crate::campaign::{TriadConfig, ranges, write_positions};
use crate::error::Error;
use crate::import::Columns;
use crate::triad::{rests, text};

/// Find the rests in a continuous record of a triad that was turned by hand, and write them as positions
#[derive(clap::Args)]
#[command(after_help = "\
Example: a log in counts, 4096 a g, becomes a campaign and its coefficients:
    vre rests log.csv --column ax,ay,az --time t_ms --time-unit ms --scale 4096 --out triad
    vre identify triad")]
pub struct Rests {
    /// A CSV table of samples
    record: PathBuf,
    /// Columns of the outputs x, y, z
    #[arg(
        long,
        value_name = "X,Y,Z",
        value_delimiter = ',',
        default_value = "u_x_v,u_y_v,u_z_v"
    )]
    column: Vec<String>,
    /// Column of the time
    #[arg(long, value_name = "NAME", default_value = "time_s")]
    time: String,
    /// Unit of the time
    #[arg(long, value_enum, default_value = "s")]
    time_unit: TimeUnit,
    /// Column of the temperature, C
    #[arg(long, value_name = "NAME")]
    temperature: Option<String>,
    /// Least length of a rest, s
    #[arg(long, value_name = "S", default_value_t = 1.5, value_parser = within(&ranges::DURATION))]
    least: f64,
    /// Folder for positions.csv, made if need be
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Units (counts, volts, m/s^2) a g: writes a campaign.toml beside positions.csv
    #[arg(long, value_name = "UNITS_PER_G", requires = "out", value_parser = within(&ranges::SCALE_FACTOR))]
    scale: Option<f64>,
    /// Local gravity over the unit g, for campaign.toml
    #[arg(long, value_name = "G", default_value_t = 1.0, value_parser = within(&ranges::LOCAL_GRAVITY))]
    gravity: f64,
}

impl Command for Rests {
    fn run(self, console: &Console) -> Result<(), Error> {
        if self.column.len() != 3 {
            return Err(Error::Usage(format!(
                "--column names {} columns; a triad has three outputs, x, y, z",
                self.column.len()
            )));
        }
        let columns = Columns {
            outputs: self.column,
            time: Some((self.time, self.time_unit.per_second())),
            temperature: self.temperature,
        };
        let found = rests::find(&self.record, &columns, self.least)?;
        let mut told = text::rests(&found);
        if let Some(out) = &self.out {
            let head = out.join("campaign.toml");
            std::fs::create_dir_all(out).map_err(Error::write(out))?;
            if let Some(scale) = self.scale {
                if head.exists() {
                    return Err(Error::Usage(format!(
                        "{}: is there already; leave --scale out to keep it",
                        head.display()
                    )));
                }
                let stem = self.record.file_stem().unwrap_or_default();
                let serial = stem.to_string_lossy().into_owned();
                TriadConfig::new(&serial, scale, None, self.gravity).write(&head)?;
            }
            let file = out.join("positions.csv");
            write_positions(&file, &found.positions())?;
            told += &format!("{}\n", file.display());
        }
        console.answer(told, &found)
    }
}
