//! Rows that a finding names: counted from 0 until the file tells its lines.

/// Rows are counted from 0 until the file tells its lines.
pub(super) fn place(row: u64) -> String {
    format!("\u{1}{row}\u{2}")
}

/// The rows that a finding names, for `lines` to put in their lines.
pub(in crate::measure) fn rows(text: &str) -> Vec<u64> {
    let marks = text.split('\u{1}').skip(1);
    marks
        .filter_map(|rest| rest.split('\u{2}').next()?.parse().ok())
        .collect()
}

/// The finding with its rows named.
pub(in crate::measure) fn named(text: &str, name: impl Fn(u64) -> String) -> String {
    let mut whole = String::new();
    for (index, piece) in text.split('\u{1}').enumerate() {
        match piece.split_once('\u{2}').filter(|_| index > 0) {
            Some((row, rest)) => {
                whole.push_str(&name(row.parse().unwrap_or(0)));
                whole.push_str(rest);
            }
            None => whole.push_str(piece),
        }
    }
    whole
}
