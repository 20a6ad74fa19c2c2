//! Root finding for the tests.

/// Where `below` changes from true to false between `low` and `high`.
pub(crate) fn bisect(mut low: f64, mut high: f64, below: impl Fn(f64) -> bool) -> f64 {
    for _ in 0..60 {
        let middle = f64::midpoint(low, high);
        *if below(middle) { &mut low } else { &mut high } = middle;
    }
    f64::midpoint(low, high)
}
