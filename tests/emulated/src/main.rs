//! What the image costs: `cargo run -p emulated`; `-- functions [BOARD]` alone for where its instructions go.

use emulated::{Error, Model, cost};
use shared::compensate::Mode;

/// Functions with fewer instructions a sample are added up.
const LEAST: f64 = 4.0;

fn main() -> Result<(), Error> {
    let board = std::env::args().nth(2);
    let model = Model::ALL
        .into_iter()
        .find(|m| Some(m.name()) == board.as_deref());
    let model = model.unwrap_or_default();
    if std::env::args().nth(1).as_deref() != Some("functions") {
        print!("{}{}", cost::table()?, cost::roots()?);
    }
    for (name, mode, raw) in [
        ("blocks", None, false),
        ("blocks, compensated", Some(Mode::Block), false),
        (
            "blocks, compensated, and raw samples",
            Some(Mode::Block),
            true,
        ),
        ("compensated point by point", Some(Mode::Pointwise), false),
    ] {
        let functions = cost::by_function(model, mode, raw)?;
        let all: f64 = functions.iter().map(|(_, count)| count).sum();
        println!("\n{all:.0} instructions a sample: {name}");
        let mut rest = all;
        for (function, count) in functions.iter().filter(|(_, count)| *count >= LEAST) {
            println!("{count:8.1}  {function}");
            rest -= count;
        }
        println!("{rest:8.1}  all others");
    }
    Ok(())
}
