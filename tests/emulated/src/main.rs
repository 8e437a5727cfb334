//! Prints what the image costs: `cargo run -p emulated`.

use emulated::{Error, cost};

fn main() -> Result<(), Error> {
    print!("{}", cost::table()?);
    print!("{}", cost::roots()?);
    Ok(())
}
