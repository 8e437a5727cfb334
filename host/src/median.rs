//! The middle of a few numbers.

/// 1 / 0.6745: a normal standard deviation over the median of moduli.
pub(crate) const MEDIAN_TO_SIGMA: f64 = 1.482_6;

/// The middle value, the mean of the two in the middle of an even number; `None` of none.
pub(crate) fn median(mut values: Vec<f64>) -> Option<f64> {
    values.sort_by(f64::total_cmp);
    let middle = values.len() / 2;
    match values.len() {
        0 => None,
        count if count % 2 == 1 => Some(values[middle]),
        _ => Some(0.5 * (values[middle - 1] + values[middle])),
    }
}
