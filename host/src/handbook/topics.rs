//! The topics that the terminal and the guide explain.

use super::page::{Entry, Page, Part};
use super::parameters::in_words;
use crate::campaign::columns::{Column, Columns, Content, Need, TABLES};
use crate::campaign::keys::KEYS;
use crate::effects::identity::Stage;
use crate::effects::{Effect, catalogue};

/// What `vre help` explains beside commands.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub enum Topic {
    /// The folder: its files and the keys of campaign.toml
    Campaign,
    /// Every column of the tables
    Columns,
    /// What the nominal model leaves out
    Effects,
    /// What a diagnosis and a measurement say
    Verdicts,
    /// Units, signs and uncertainties
    Units,
}

impl Topic {
    /// All topics.
    pub const ALL: [Self; 5] = [
        Self::Campaign,
        Self::Columns,
        Self::Effects,
        Self::Verdicts,
        Self::Units,
    ];

    /// Its name.
    pub fn name(self) -> &'static str {
        match self {
            Self::Campaign => "campaign",
            Self::Columns => "columns",
            Self::Effects => "effects",
            Self::Verdicts => "verdicts",
            Self::Units => "units",
        }
    }

    /// What is said of it.
    pub fn page(self) -> Page {
        match self {
            Self::Campaign => campaign(),
            Self::Columns => columns(),
            Self::Effects => effects(),
            Self::Verdicts => verdicts(),
            Self::Units => units(),
        }
    }
}

fn text(text: &str) -> Part {
    Part::Text(text.into())
}

fn heading(text: &str) -> Part {
    Part::Heading(text.into())
}

fn entry(name: &str, facts: &str, text: &str) -> Entry {
    Entry {
        name: name.into(),
        facts: facts.into(),
        text: text.into(),
        example: String::new(),
    }
}

fn of_column(column: &Column) -> Entry {
    let need = match column.need {
        Need::Required => "required",
        Need::Measured => "where measured",
        Need::Optional => "optional",
    };
    let values = match column.content {
        Content::Text => String::new(),
        _ => format!("; {}", column.values()),
    };
    Entry {
        name: column.name.into(),
        facts: format!("{need}{values}"),
        text: column.meaning.into(),
        example: column.example.into(),
    }
}

fn campaign() -> Page {
    let mut parts = vec![
        text(
            "A campaign is a folder with all the measurements of one instrument, as plain files that any bench, script or \
             spreadsheet can write. `vre template DIR` makes one to fill in.",
        ),
        Part::Lines(
            "campaign.toml   instrument and bench\n\
             static.csv      one reading at a dial position a row\n\
             vibration.csv   one shaker run a row (optional)"
                .into(),
        ),
        text(
            "A table may be static.csv, static.tsv, static.xlsx, static.ods or static.xls. Cells are parted by commas, \
             semicolons, tabs or bars; a comma may be the decimal sign where it does not part cells; lines that begin with # are \
             comments; what stands above the header is passed over; columns are found by name, in any order and in any letters, \
             and a unit behind a name, as in U [mV], is converted. Columns of other names are kept and not used. A row with yes \
             under exclude is kept and not used.",
        ),
        heading("Keys of campaign.toml"),
    ];
    for table in KEYS {
        let name = table
            .name
            .map_or(String::new(), |name| format!("[{name}]: "));
        let optional = if table.required {
            ""
        } else {
            "; the table may be absent"
        };
        parts.push(Part::Text(format!("{name}{}{optional}.", table.about)));
        let keys = table.keys.iter().map(of_column).collect();
        parts.push(Part::Entries(["Key", "Values", "Meaning", "Example"], keys));
    }
    Page {
        title: "A campaign's folder".into(),
        parts,
    }
}

fn columns() -> Page {
    let mut parts = vec![text(
        "A name ends with its unit. Another unit stands behind the name without it: u [mV], temp [K], dial [rad], time [min].",
    )];
    for Columns { file, row, columns } in TABLES {
        parts.push(Part::Heading(format!("{file}: {row} a row")));
        let columns = columns.iter().map(of_column).collect();
        parts.push(Part::Entries(
            ["Column", "Values", "Meaning", "Example"],
            columns,
        ));
    }
    Page {
        title: "Columns of the tables".into(),
        parts,
    }
}

/// Where an effect acts, in words.
fn place(stage: Stage) -> &'static str {
    match stage {
        Stage::InstrumentStatics => "in the instrument's characteristic at rest",
        Stage::InstrumentDynamics => "in the instrument's inner motion and its servo loop",
        Stage::Mounting => "between table and instrument",
        Stage::StaticBench => "in the dividing head and its base",
        Stage::Shaker => "in the table, its drive and the reference",
        Stage::Environment => "by temperature, time and history",
        Stage::Acquisition => "in the converter and the logger",
    }
}

/// The catalogue.
pub fn effects() -> Page {
    let mut parts = vec![text(
        "What the nominal model (IEEE Std 1293) leaves out and a diagnosis looks for, by the link of the chain where it acts. \
         `vre effects ID` tells more of one; `vre simulate --effect ID` makes a campaign with it.",
    )];
    for stage in Stage::ALL {
        let of_stage = catalogue().filter(|effect| effect.stage == stage);
        let entries: Vec<Entry> = of_stage
            .map(|effect| entry(effect.id, "", effect.says))
            .collect();
        if !entries.is_empty() {
            parts.push(Part::Heading(format!("Acts {}", place(stage))));
            parts.push(Part::Entries(["Effect", "", "What it is", ""], entries));
        }
    }
    Page {
        title: "Effects".into(),
        parts,
    }
}

/// One effect with its parameters.
pub fn effect(effect: &Effect) -> Page {
    let own = effect.parameters.iter().map(|parameter| parameter.name);
    let names: Vec<&str> = match effect.report {
        Some((names, _)) => names.to_vec(),
        None => own.filter(|name| !name.starts_with('_')).collect(),
    };
    let parameter = |name: &str| {
        let (words, unit) = in_words(effect.id, name);
        entry(name, unit, words)
    };
    Page {
        title: effect.id.into(),
        parts: vec![
            Part::Text(format!("{}. It acts {}.", effect.says, place(effect.stage))),
            heading("Parameters that a diagnosis reports"),
            Part::Entries(
                ["Name", "Unit", "What it is", ""],
                names.into_iter().map(parameter).collect(),
            ),
            heading("Try it"),
            Part::Lines(format!(
                "vre simulate --out try --effect {0}\nvre diagnose try\nvre diagnose try --without {0}",
                effect.id
            )),
        ],
    }
}

fn verdicts() -> Page {
    let heads = ["Verdict", "", "What it means, and what to do", ""];
    Page {
        title: "Verdicts".into(),
        parts: vec![
            heading("vre diagnose"),
            Part::Entries(
                heads,
                vec![
                    entry(
                        "no-gap",
                        "",
                        "prediction and shaker agree within the stated uncertainties; nothing needs a cause",
                    ),
                    entry(
                        "explained",
                        "",
                        "one hypothesis holds: its effects, with the probability beside them; repair or compensate it",
                    ),
                    entry(
                        "ambiguous",
                        "",
                        "one of several effects that these data do not tell apart; make one of the tests that are proposed",
                    ),
                    entry(
                        "unexplained",
                        "",
                        "there is a gap that no effect of the catalogue explains; see where it lies",
                    ),
                    entry(
                        "cannot-tell",
                        "",
                        "the campaign could not have shown a gap that matters; measure more, or with less noise",
                    ),
                ],
            ),
            heading("vre measure"),
            Part::Entries(
                heads,
                vec![
                    entry(
                        "shift",
                        "",
                        "the mean shifts under vibration, and nothing else that was looked for explains it",
                    ),
                    entry(
                        "no-shift",
                        "",
                        "zero lies within the 95 % interval; the interval says how large a shift could still be",
                    ),
                    entry(
                        "not-attributable",
                        "",
                        "there is a shift, and something else than the vibration explains as much; the reasons are listed",
                    ),
                    entry(
                        "cannot-tell",
                        "",
                        "the record does not show the noise at the time scale that counts, or may hide a shift",
                    ),
                ],
            ),
            heading("vre predict --limit"),
            Part::Entries(
                heads,
                vec![
                    entry(
                        "pass",
                        "",
                        "the vibration error keeps the limit, the risk that it does not being less than stated",
                    ),
                    entry(
                        "fail",
                        "",
                        "the vibration error exceeds the limit, the risk that it does not being less than stated",
                    ),
                    entry(
                        "cannot-tell",
                        "",
                        "neither can be said at the stated risk; a smaller uncertainty would decide",
                    ),
                ],
            ),
        ],
    }
}

fn units() -> Page {
    Page {
        title: "Units, signs and uncertainties".into(),
        parts: vec![
            text(
                "g is the unit 9.80665 m/s^2 of acceleration everywhere; local gravity in it is local_gravity_g of campaign.toml. Text \
                 for people is in microg (1e-6 g), JSON in the unit that a field's name ends with.",
            ),
            text(
                "Specific force is what an accelerometer feels: an instrument at rest with its input axis up feels +1 g. The output is \
                 positive where the specific force on the input axis is; an inverted output has a negative scale factor.",
            ),
            text(
                "The vibration rectification error (VRE) is the change of the mean output under vibration over the scale factor: during \
                 less before.",
            ),
            text(
                "A level is the peak of a sine and the rms of a random vibration, along its direction. A power spectral density is \
                 one-sided, in g^2/Hz.",
            ),
            text(
                "301.5(1.5) is 301.5 with the standard uncertainty 1.5 (coverage factor 1); the digits in parentheses stand in units of the \
                 last digits before them. Sigma of a column is the standard uncertainty of that mean from noise alone, not that of a \
                 sample: divide by the root of the number of independent samples.",
            ),
        ],
    }
}
