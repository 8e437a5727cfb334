//! Which samples are before the vibration and which are during it.

use glob::Pattern;

use super::segment::Role;
use crate::error::Error;

/// How the samples of a table are told apart.
#[derive(Clone, Debug)]
pub enum Selection {
    /// By name: a column says to which file (or other group) a row belongs.
    Groups {
        /// The column.
        column: String,
        /// Names before the vibration.
        before: Names,
        /// Names during the vibration.
        during: Names,
        /// Names of neither.
        without: Names,
    },
    /// By time.
    Windows {
        /// Before the vibration.
        before: Window,
        /// During the vibration.
        during: Window,
    },
}

impl Selection {
    /// The selection as it is written: with a `column`, comma-separated names or patterns, otherwise
    /// windows `START..END` in s.
    ///
    /// # Errors
    /// [`Error::Usage`].
    pub fn parse(
        column: Option<&str>,
        before: &str,
        during: &str,
        without: Option<&str>,
    ) -> Result<Self, Error> {
        Ok(match column {
            Some(column) => Self::Groups {
                column: column.into(),
                before: Names::parse(before)?,
                during: Names::parse(during)?,
                without: Names::parse(without.unwrap_or(""))?,
            },
            None if without.is_some() => {
                return Err(Error::Usage(
                    "--without selects by name and needs --group".into(),
                ));
            }
            None => {
                let (before, during) = (Window::parse(before)?, Window::parse(during)?);
                if before.from_s < during.to_s && during.from_s < before.to_s {
                    return Err(Error::Usage("--before and --during overlap".into()));
                }
                Self::Windows { before, during }
            }
        })
    }
}

/// Names, or patterns with `*`, `?` and `[...]`.
#[derive(Clone, Debug)]
pub struct Names(Vec<Pattern>);

impl Names {
    fn parse(text: &str) -> Result<Self, Error> {
        let patterns = text
            .split(',')
            .map(str::trim)
            .filter(|name| !name.is_empty());
        let patterns = patterns.map(|name| {
            Pattern::new(name).map_err(|error| Error::Usage(format!("pattern {name:?}: {error}")))
        });
        patterns.collect::<Result<_, _>>().map(Self)
    }

    /// Whether the name is one of these.
    pub fn has(&self, name: &str) -> bool {
        self.0.iter().any(|pattern| pattern.matches(name))
    }
}

/// A half-open window of time, s.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Window {
    from_s: f64,
    to_s: f64,
}

impl Window {
    fn parse(text: &str) -> Result<Self, Error> {
        let bad = || Error::Usage(format!("\"{text}\" is not a window START..END in s"));
        let (from, to) = text.split_once("..").ok_or_else(bad)?;
        let number = |text: &str| text.trim().parse::<f64>().map_err(|_| bad());
        let window = Self {
            from_s: number(from)?,
            to_s: number(to)?,
        };
        let sound = window.from_s.is_finite() && window.from_s < window.to_s;
        sound.then_some(window).ok_or_else(bad)
    }

    /// Whether the time lies within.
    pub fn has(&self, time_s: f64) -> bool {
        (self.from_s..self.to_s).contains(&time_s)
    }
}

impl std::fmt::Display for Role {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Self::Before => "before",
            Self::During => "during",
            Self::Rest => "rest",
            Self::Plateau => "plateau",
        })
    }
}
