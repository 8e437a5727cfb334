//! Bars of text.

/// Eighths of a line.
const BARS: [char; 8] = [
    '\u{2581}', '\u{2582}', '\u{2583}', '\u{2584}', '\u{2585}', '\u{2586}', '\u{2587}', '\u{2588}',
];

/// One bar for each share, 0 to 1; a blank for what is no number.
pub(super) fn sparkline(shares: impl IntoIterator<Item = f64>) -> String {
    let bar = |share: f64| match share.is_finite() {
        true => BARS[(share.clamp(0.0, 1.0) * 7.99) as usize],
        false => ' ',
    };
    shares.into_iter().map(bar).collect()
}
