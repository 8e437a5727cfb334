//! `vre paper`

use std::fmt::Write as _;

use serde::Serialize;

use super::{Command, Console};
use crate::error::Error;
use crate::paper::diagnosis::{TableDiagnosis, diagnose_published};
use crate::paper::{Comparison, TABLES, Weights, compare, weights};

/// Print the paper's Tables 1 and 2 beside what (9) gives from Table 1, and what Table 2 would imply
#[derive(clap::Args)]
#[command(after_help = "Example:\n  vre paper")]
pub struct Paper {}

#[derive(Serialize)]
struct Tables {
    format: &'static str,
    weights: Weights,
    instruments: Vec<Comparison>,
    diagnoses: Vec<TableDiagnosis>,
}

impl Command for Paper {
    fn run(self, console: &Console) -> Result<(), Error> {
        let diagnoses = TABLES
            .iter()
            .map(diagnose_published)
            .collect::<Result<_, _>>()?;
        let result = Tables {
            format: "vre-paper/1",
            weights: weights(),
            instruments: compare(),
            diagnoses,
        };
        console.answer(text(&result), &result)
    }
}

fn text(result: &Tables) -> String {
    let mut text = String::new();
    write_table_1(&mut text);
    write_table_2(&mut text, result);
    write_implied(&mut text, &result.instruments);
    text + &diagnosed(&result.diagnoses)
}

fn write_table_1(text: &mut String) {
    text.push_str("Table 1 as published, 1e-4 of the unit (no uncertainties are published)\n");
    let _ = writeln!(
        text,
        "  {:<8}{:>9}{:>9}{:>9}{:>9}{:>9}{:>9}{:>9}",
        "", "k0", "k1'", "k2", "k3", "k4", "d_PA", "d_OA"
    );
    for row in &TABLES {
        let c = &row.coefficients;
        let columns = [
            c.bias_g,
            c.asymmetry,
            c.second_order_per_g,
            c.third_order_per_g2,
            c.fourth_order_per_g3,
            c.misalignment_pa_rad,
            c.misalignment_oa_rad,
        ];
        let _ = write!(text, "  {:<8}", row.instrument);
        for value in columns {
            let _ = write!(text, "{:>9.3}", value * 1e4);
        }
        text.push('\n');
    }
    let _ = writeln!(
        text,
        "  The columns of k3 and k4 are identical for all three instruments.\n"
    );
}

fn write_table_2(text: &mut String, result: &Tables) {
    let _ = writeln!(
        text,
        "Table 2, white noise of 1 g rms; vibration error in 1e-4 g"
    );
    let _ = writeln!(
        text,
        "  {:<8}{:>18}{:>18}{:>12}{:>22}",
        "", "(9) from Table 1", "paper, computed", "measured", "paper's mismatch"
    );
    for row in &result.instruments {
        let _ = writeln!(
            text,
            "  {:<8}{:>18.2}{:>18.2}{:>12.2}{:>20.0} %",
            row.instrument,
            row.equation_9_vre_g * 1e4,
            row.paper_computed_vre_g * 1e4,
            row.paper_measured_vre_g * 1e4,
            row.paper_mismatch.abs() * 100.0
        );
    }
    let w = &result.weights;
    let line = |w: &[f64; 3]| format!("{:>7.3} k1' {:+.3} k2 {:+.3} k4", w[0], w[1], w[2]);
    let _ = writeln!(
        text,
        "\n  (9) does not give the computed row from Table 1 for any of the three. The weights of k1', k2 and k4:\n    \
         (9)                {}\n    computed row asks  {}\n    measured row asks  {}\n  \
         No vibration gives k4 a negative weight: M[w^4] is positive. The tables cannot both be right.",
        line(&w.equation_9),
        line(&w.from_computed),
        line(&w.from_measured)
    );
}

/// What Table 1 would have to say.
fn write_implied(text: &mut String, instruments: &[Comparison]) {
    for (title, of_measured) in [("measured", true), ("computed", false)] {
        let _ = writeln!(
            text,
            "\nWhat Table 1 would have to say for (9) to give the {title} value, 1e-4"
        );
        let _ = writeln!(
            text,
            "  {:<8}{:>10}{:>10}{:>10}   or, the 24 voltages unchanged, (k1', k2, k4) =",
            "", "k1' alone", "k2 alone", "k4 alone"
        );
        for row in instruments {
            let implied = if of_measured {
                &row.implied_by_measured
            } else {
                &row.implied_by_computed
            };
            let [k1_prime, k2, k4] = implied.along_blind_direction.map(|k| k * 1e4);
            let _ = writeln!(
                text,
                "  {:<8}{:>10.2}{:>10.2}{:>10.2}   ({k1_prime:.2}, {k2:.2}, {k4:.2})",
                row.instrument,
                implied.k1_prime * 1e4,
                implied.k2_per_g * 1e4,
                implied.k4_per_g3 * 1e4,
            );
        }
    }
    let _ = writeln!(
        text,
        "\n  The last column moves along the direction that the paper's plan cannot see: readings on its 24 positions \
         are\n  the same for the published coefficients and for these, so Table 1 cannot be told from it by that test."
    );
}

/// What the tables can and cannot say.
fn diagnosed(diagnoses: &[TableDiagnosis]) -> String {
    let mut text = String::from(
        "\nDiagnosed: Table 1 as the 24 readings behind it (head +-10 arcsec), Table 2 as one run; neither uncertainty, band nor\n\
         length of the noise is printed\n",
    );
    for found in diagnoses {
        let verdict = serde_json::to_string(&found.verdict).unwrap_or_default();
        let _ = writeln!(
            text,
            "  {:<8}{}: (9) misses by {:+.2}e-4 g, and a step along {} direction that the readings leave free makes that up; \
             measured numbers left to test any effect: {}",
            found.instrument,
            verdict.trim_matches('"'),
            found.gap_g * 1e4,
            if found.blind_directions == 1 {
                "the one"
            } else {
                "a"
            },
            found.spare_numbers
        );
        let named = found.would_do.iter().map(|effect| match effect.parameter {
            Some((name, value)) => format!("{} ({name} {value:.2e})", effect.effect),
            None => effect.effect.into(),
        });
        let _ = writeln!(
            text,
            "          each alone would make up the difference as well: {}",
            named.collect::<Vec<_>>().join(", ")
        );
        if !found.excluded.is_empty() {
            let _ = writeln!(
                text,
                "          at no size would: {}",
                found.excluded.join(", ")
            );
        }
    }
    if let Some(found) = diagnoses.first() {
        let _ = writeln!(
            text,
            "  One run cannot show at all: {}.\n  They can say: (9) and Table 1 do not give Table 2; a direction that the plan \
             cannot see is enough to explain it.\n  They cannot say: whether any effect acts, or which; how well anything is known; \
             nor, as k3 and k4 are printed alike,\n  whether Table 1 is what was identified. More runs at other levels and \
             attitudes, and a plan of full rank, would.",
            found.silent.join(", ")
        );
    }
    text
}
