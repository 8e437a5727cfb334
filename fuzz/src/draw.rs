//! What hostile input is drawn from.

use arbitrary::Unstructured;

/// Numbers that break programs.
const HOSTILE: [&str; 24] = [
    "0",
    "-0",
    "5e-324",
    "-5e-324",
    "1e-300",
    "1e-30",
    "1e-12",
    "1e160",
    "-1e160",
    "1e300",
    "-1e300",
    "1.7976931348623157e308",
    "NaN",
    "inf",
    "-inf",
    "1e400",
    "18446744073709551615",
    "9007199254740993",
    "-1",
    "1e6",
    "1e-6",
    "",
    "1,5",
    "0x10",
];

/// A number below `bound`, which is not 0.
pub fn below(draw: &mut Unstructured<'_>, bound: usize) -> usize {
    draw.int_in_range(0..=bound - 1).unwrap_or(0)
}

/// Whether one in `times` happens.
pub fn one_in(draw: &mut Unstructured<'_>, times: usize) -> bool {
    below(draw, times) == 0
}

/// One of several.
pub fn one_of<'c, T>(draw: &mut Unstructured<'_>, choices: &'c [T]) -> &'c T {
    &choices[below(draw, choices.len())]
}

/// A uniform number from 0 to 1.
pub fn unit(draw: &mut Unstructured<'_>) -> f64 {
    f64::from(draw.arbitrary::<u32>().unwrap_or(0)) / f64::from(u32::MAX)
}

/// A number in the place of `text`: hostile, far, near, of another sign.
pub fn number(draw: &mut Unstructured<'_>, text: &str) -> String {
    let value: f64 = text.parse().unwrap_or(1.0);
    match below(draw, 8) {
        0 | 1 => (*one_of(draw, &HOSTILE)).into(),
        2 => format!("{:e}", value * 10f64.powi(below(draw, 25) as i32 - 12)),
        3 => format!("{:e}", value * (1.0 + 1e-3 * (unit(draw) - 0.5))),
        4 => format!("{}", -value),
        5 => format!("{:e}", 10f64.powi(below(draw, 40) as i32 - 20)),
        6 => format!("{}", value * (unit(draw) * 4.0 - 2.0)),
        _ => format!("{:e}", f64::from_bits(draw.arbitrary().unwrap_or(0))),
    }
}

/// Spoils a text as a disk or an editor does: flipped bits, a cut, a piece twice.
pub fn spoil(draw: &mut Unstructured<'_>, bytes: &mut Vec<u8>) {
    for _ in 0..=below(draw, 3) {
        if bytes.is_empty() {
            return;
        }
        let at = below(draw, bytes.len());
        match below(draw, 4) {
            0 => bytes[at] ^= 1 << below(draw, 8),
            1 => bytes.truncate(at),
            2 => {
                let end = (at + 1 + below(draw, 64)).min(bytes.len());
                let piece = bytes[at..end].to_vec();
                bytes.splice(at..at, piece);
            }
            _ => {
                bytes.remove(at);
            }
        }
    }
}
