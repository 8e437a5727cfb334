//! Writes the generated pages of the guide and the picture of each effect's signature: `guide docs/guide/src/generated`.

use std::error::Error;
use std::fs;
use std::path::PathBuf;

use host::bench::effects;
use host::bench::noise::Seed;
use host::bench::plan::Static;
use host::bench::simulate::{Specification, VirtualBench};
use host::handbook;
use host::report::signature;

/// Any campaign will do: the same one with and without the effect.
const SEED: Seed = Seed(7);

fn main() -> Result<(), Box<dyn Error>> {
    let folder = std::env::args_os().nth(1).ok_or("name the folder")?;
    let folder = PathBuf::from(folder);
    fs::create_dir_all(folder.join("effects"))?;
    for (name, text) in handbook::pages() {
        fs::write(folder.join(name), text)?;
    }
    let bench = |drawn| {
        let specification = Specification::with_dial_sigma(1.0);
        VirtualBench::new(SEED, Static::default(), specification, drawn)
            .simulate()
            .campaign
    };
    let without = bench(Vec::new());
    let explained = |id: &str| host::effects::find(id).is_some();
    for entry in effects::catalogue().filter(|entry| explained(entry.id)) {
        let drawn = (entry.draw)(1.0, &mut SEED.stream("effect", 0));
        let pictures = signature(entry.id, &bench(vec![drawn]), &without)?;
        let file = folder.join("effects").join(format!("{}.svg", entry.id));
        fs::write(file, stacked(&pictures))?;
    }
    Ok(())
}

/// Drawings one below the other, as one.
fn stacked(pictures: &[String]) -> String {
    let (width, height) = (720, 200);
    let total = height * pictures.len();
    let placed = pictures.iter().enumerate().map(|(index, picture)| {
        let y = index * height;
        picture.replacen("<svg ", &format!("<svg y=\"{y}\" "), 1)
    });
    format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {width} {total}\" width=\"{width}\" height=\"{total}\">\
         <rect width=\"100%\" height=\"100%\" fill=\"white\"/>{}</svg>\n",
        placed.collect::<String>()
    )
}
