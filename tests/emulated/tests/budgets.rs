//! The image keeps to its budgets, with a twentieth to spare: inlining moves counts by 3 %.

use std::time::Duration;

use emulated::converter::Plain;
use emulated::{Emulator, Error, cost};

#[test]
fn every_figure_is_a_twentieth_below_its_budget() -> Result<(), Error> {
    let table = cost::table()?;
    println!("{table}");
    for figure in &table.0 {
        if let Some(budget) = figure.budget {
            assert!(figure.value <= 0.95 * budget, "{figure:?}");
        }
    }
    Ok(())
}

#[test]
fn a_trace_has_every_instruction_that_the_emulator_counts() -> Result<(), Error> {
    let mut board = Emulator::start(Plain::new(8_192_000, |_| [1, 2, 3, 4]))?;
    board.run_for(Duration::from_millis(300))?;
    let before = board.instructions();
    let executed = board.trace(Duration::from_millis(100))?;
    assert_eq!(
        executed.values().sum::<u64>(),
        board.instructions() - before
    );
    Ok(())
}

#[test]
fn the_square_root_of_libm_is_exact_where_the_quicker_one_is_not() -> Result<(), Error> {
    let table = cost::roots()?;
    println!("{table}");
    let [libm, micromath, libm_error, micromath_error] = &table.0[..] else {
        panic!("{table}");
    };
    // Half a unit in the last place, and what a millionth of the vibration error can be seen from.
    assert!(
        libm_error.value < 0.06 && micromath_error.value > 1.0,
        "{table}"
    );
    // Three roots a block of 40 samples: the difference is far below the budget of 300 instructions a sample.
    assert!(
        3.0 * (libm.value - micromath.value) / 40.0 < 30.0,
        "{table}"
    );
    Ok(())
}
