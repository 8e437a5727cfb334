//! Terms of the instrument's own characteristic that (1) lacks; each is a function of the present force.

use super::{Block, Effect, Entry};
use crate::bench::noise::Stream;

/// Makers of the effects in this file.
pub const ENTRIES: &[Entry] = &[
    Entry {
        id: "bias-asymmetry",
        catalogued: true,
        draw: |strength, stream| {
            Box::new(BiasAsymmetry {
                k0_prime_g: strength * 2e-4 * stream.sign(),
                dead_band_g: 1e-3,
            })
        },
    },
    Entry {
        id: "odd-quadratic",
        catalogued: true,
        draw: |strength, stream| {
            term("odd-quadratic", "Koq_per_g", strength * 3e-4, stream, |a| {
                a[0] * a[0].abs()
            })
        },
    },
    Entry {
        id: "quintic",
        catalogued: true,
        draw: |strength, stream| {
            term("quintic", "k5_per_g4", strength * 3e-6, stream, |a| {
                a[0].powi(5)
            })
        },
    },
    Entry {
        id: "sextic",
        catalogued: true,
        draw: |strength, stream| {
            term("sextic", "k6_per_g5", strength * 1e-6, stream, |a| {
                a[0].powi(6)
            })
        },
    },
    Entry {
        id: "cross-axis-squares",
        catalogued: true,
        draw: |strength, stream| {
            let mut size = || strength * 2e-4 * stream.sign() * stream.uniform(0.4, 1.0);
            Box::new(CrossAxisSquares {
                kpp_per_g: size(),
                koo_per_g: size(),
            })
        },
    },
];

/// A term of one coefficient: output += coefficient x function(force).
pub struct Term {
    id: &'static str,
    name: &'static str,
    coefficient: f64,
    function: fn([f64; 3]) -> f64,
}

/// A term whose coefficient has the given size and a random sign.
pub fn term(
    id: &'static str,
    name: &'static str,
    size: f64,
    stream: &mut Stream,
    function: fn([f64; 3]) -> f64,
) -> Box<dyn Effect> {
    Box::new(Term {
        id,
        name,
        coefficient: size * stream.sign(),
        function,
    })
}

impl Effect for Term {
    fn id(&self) -> &'static str {
        self.id
    }

    fn parameters(&self) -> Vec<(&'static str, f64)> {
        vec![(self.name, self.coefficient)]
    }

    fn output(&self, block: &Block<'_>, output_g: &mut [f64]) {
        for (n, out) in output_g.iter_mut().enumerate() {
            *out += self.coefficient * (self.function)(block.force_g.map(|axis| axis[n]));
        }
    }
}

/// The pick-off's null has two sides: a bias that changes sign with the force. Within the dead band, which
/// covers where a bench can set zero, it is undecided and averages to nothing.
struct BiasAsymmetry {
    k0_prime_g: f64,
    dead_band_g: f64,
}

impl Effect for BiasAsymmetry {
    fn id(&self) -> &'static str {
        "bias-asymmetry"
    }

    fn parameters(&self) -> Vec<(&'static str, f64)> {
        vec![("K0_prime_g", self.k0_prime_g)]
    }

    fn output(&self, block: &Block<'_>, output_g: &mut [f64]) {
        for (out, &a) in output_g.iter_mut().zip(block.force_g[0]) {
            if a.abs() > self.dead_band_g {
                *out += self.k0_prime_g * a.signum();
            }
        }
    }
}

/// The suspension stretches under forces across the input axis, whatever their sign.
struct CrossAxisSquares {
    kpp_per_g: f64,
    koo_per_g: f64,
}

impl Effect for CrossAxisSquares {
    fn id(&self) -> &'static str {
        "cross-axis-squares"
    }

    fn parameters(&self) -> Vec<(&'static str, f64)> {
        vec![("Kpp_per_g", self.kpp_per_g), ("Koo_per_g", self.koo_per_g)]
    }

    fn output(&self, block: &Block<'_>, output_g: &mut [f64]) {
        let [_, p, o] = block.force_g;
        for ((out, p), o) in output_g.iter_mut().zip(p).zip(o) {
            *out += self.kpp_per_g * p * p + self.koo_per_g * o * o;
        }
    }
}
