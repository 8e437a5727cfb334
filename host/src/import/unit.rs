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

/// From one unit to another of the same quantity: value x `times` / `over` + `plus`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Conversion {
    times: f64,
    over: f64,
    plus: f64,
}

impl Conversion {
    /// From a unit to itself.
    pub(crate) const NONE: Self = Self {
        times: 1.0,
        over: 1.0,
        plus: 0.0,
    };

    /// To a unit of a campaign's columns (`V`, `V/s`, `g`, `s`, `deg`, `arcsec`, `Hz`, `C`, or none of a pure number).
    pub(crate) fn between(from: &str, to: &str) -> Option<Self> {
        let from: String = from.chars().filter(|c| !c.is_whitespace()).collect();
        let from = from
            .replace(['\u{b5}', '\u{3bc}'], "u")
            .replace('\u{b0}', "deg");
        // mV and MV differ by their capital alone, kelvin and kilo too.
        let times = |times: f64| {
            Some(Self {
                times,
                ..Self::NONE
            })
        };
        let over = |over: f64| Some(Self { over, ..Self::NONE });
        if from == to {
            return Some(Self::NONE);
        }
        match (to, from.as_str()) {
            ("", "1" | "-" | "") => times(1.0),
            ("", "%") => over(100.0),
            ("V", "v" | "volt" | "volts" | "counts" | "lsb" | "LSB") => times(1.0),
            ("V", "mV") => over(1e3),
            ("V", "uV") => over(1e6),
            ("V", "nV") => over(1e9),
            ("V/s", "mV/s") => over(1e3),
            ("V/s", "uV/s") => over(1e6),
            ("V/s", "V/min") => over(60.0),
            ("g", "gn" | "g0" | "g_n" | "grms" | "g_rms" | "gpk") => times(1.0),
            ("g", "mg") => over(1e3),
            ("g", "ug" | "microg") => over(1e6),
            ("g", "m/s2" | "m/s^2" | "m/s\u{b2}" | "m/s/s" | "ms-2" | "m\u{b7}s-2") => over(G_M_S2),
            ("g^2/Hz", "g2/Hz" | "g\u{b2}/Hz") => times(1.0),
            (
                "g^2/Hz",
                "(m/s^2)^2/Hz" | "(m/s2)2/Hz" | "m2/s4/Hz" | "(m/s\u{b2})\u{b2}/Hz" | "m^2/s^3",
            ) => over(G_M_S2 * G_M_S2),
            ("s", "sec" | "seconds") => times(1.0),
            ("s", "ms") => over(1e3),
            ("s", "us") => over(1e6),
            ("s", "min") => times(60.0),
            ("s", "h" | "hours") => times(3600.0),
            ("deg", "degree" | "degrees") => times(1.0),
            ("deg", "rad") => times(180.0 / std::f64::consts::PI),
            ("deg", "gon" | "grad") => times(0.9),
            ("deg", "arcmin" | "'") => over(60.0),
            ("deg", "arcsec" | "\"") => over(3600.0),
            ("arcsec", "\"" | "as") => times(1.0),
            ("arcsec", "arcmin" | "'") => times(60.0),
            ("arcsec", "deg") => times(3600.0),
            ("arcsec", "rad") => times(648_000.0 / std::f64::consts::PI),
            ("arcsec", "mrad") => times(648.0 / std::f64::consts::PI),
            ("arcsec", "urad") => times(0.648 / std::f64::consts::PI),
            ("Hz", "hz" | "1/s") => times(1.0),
            ("Hz", "kHz") => times(1e3),
            ("C", "degC" | "Celsius") => times(1.0),
            ("C", "K") => Some(Self {
                plus: -273.15,
                ..Self::NONE
            }),
            _ => None,
        }
    }

    /// The value in the other unit.
    pub(crate) fn of(self, value: f64) -> f64 {
        value * self.times / self.over + self.plus
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
