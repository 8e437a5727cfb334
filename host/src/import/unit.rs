//! The unit of a column.

/// Units of an output.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Unit {
    /// g.
    G,
    /// 0.001 g.
    MilliG,
    /// m/s^2.
    MetresPerSecondSquared,
    /// V: a scale factor makes g of it.
    Volts,
    /// Counts of a converter, likewise.
    Counts,
}

/// Standard acceleration of free fall, m/s^2 (CGPM 1901).
const G_M_S2: f64 = 9.806_65;

impl Unit {
    /// Units a g; none if only the instrument's scale factor tells.
    pub fn units_per_g(self) -> Option<f64> {
        match self {
            Self::G => Some(1.0),
            Self::MilliG => Some(1e3),
            Self::MetresPerSecondSquared => Some(G_M_S2),
            Self::Volts | Self::Counts => None,
        }
    }

    /// As it is written: `g`, `mg`, `m/s2` and the like, `V`, `counts`.
    pub fn parse(text: &str) -> Option<Self> {
        let text: String = text.chars().filter(|c| !c.is_whitespace()).collect();
        let text = text
            .to_lowercase()
            .replace('\u{b2}', "2")
            .replace(['^', '*'], "");
        Some(match text.as_str() {
            "g" | "gn" | "g0" => Self::G,
            "mg" | "milli-g" | "millig" => Self::MilliG,
            "m/s2" | "m/s/s" | "ms2" | "ms-2" | "mps2" | "m_s2" => Self::MetresPerSecondSquared,
            "v" | "volt" | "volts" => Self::Volts,
            "counts" | "count" | "cts" | "lsb" | "raw" | "adc" => Self::Counts,
            _ => return None,
        })
    }

    /// In the name of a column: `x_g`, `x (mg)`, `x [m/s^2]`.
    pub fn of_name(name: &str) -> Option<Self> {
        let bracketed = name.rfind(['(', '[']).and_then(|at| {
            let inner = name[at + 1..].trim_end();
            Self::parse(inner.strip_suffix([')', ']'])?)
        });
        let suffixed = || {
            let after = |separator: char| Some(name.rsplit_once(separator)?.1);
            let long = name.to_lowercase().ends_with("m_s2").then_some("m_s2");
            Self::parse(long.or(after('_')).or(after(' '))?)
        };
        bracketed.or_else(suffixed)
    }
}

#[cfg(test)]
mod tests {
    use super::Unit;

    #[test]
    fn a_unit_is_read_from_the_name_of_a_column() {
        for (name, unit) in [
            ("x_g", Some(Unit::G)),
            ("acc (m/s^2)", Some(Unit::MetresPerSecondSquared)),
            ("ax_m_s2", Some(Unit::MetresPerSecondSquared)),
            ("Accel X [m/s\u{b2}]", Some(Unit::MetresPerSecondSquared)),
            ("z_mg", Some(Unit::MilliG)),
            ("u_v", Some(Unit::Volts)),
            ("raw", None),
            ("acc", None),
            ("g", None),
        ] {
            assert_eq!(Unit::of_name(name), unit, "{name}");
        }
    }
}
