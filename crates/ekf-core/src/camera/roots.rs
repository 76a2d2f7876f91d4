//! Roots of polynomials, and the inverse of a function that grows.

/// Smallest positive root of `c[0] + c[1] s + c[2] s^2 + ...` with `c[0] > 0`; infinite if there is none.
///
/// Between two neighbouring critical points a polynomial is monotone, so its sign changes bracket the roots: the
/// critical points come from the same search one degree lower.
pub(super) fn smallest_positive_root(c: &[f64]) -> f64 {
    positive_roots(c).first().copied().unwrap_or(f64::INFINITY)
}

/// Positive roots with a sign change, in increasing order.
fn positive_roots(c: &[f64]) -> Vec<f64> {
    let degree = match c.iter().rposition(|&value| value != 0.0) {
        Some(degree) if degree > 0 => degree,
        _ => return Vec::new(),
    };
    let c = &c[..=degree];
    let value = |s: f64| c.iter().rev().fold(0.0, |sum, &a| sum * s + a);
    let derivative: Vec<f64> = (1..=degree).map(|i| i as f64 * c[i]).collect();
    // Cauchy's bound on the roots.
    let bound = 1.0
        + c[..degree]
            .iter()
            .fold(0.0_f64, |m, a| m.max((a / c[degree]).abs()));
    let mut ends = positive_roots(&derivative);
    ends.retain(|&s| s < bound);
    ends.push(bound);
    let mut roots = Vec::new();
    let mut low = 0.0;
    for &end in &ends {
        let (mut a, mut b) = (low, end);
        let sign = value(a) >= 0.0;
        if (value(b) >= 0.0) != sign {
            for _ in 0..2000 {
                let mid = 0.5 * (a + b);
                if mid <= a || mid >= b {
                    break;
                }
                if (value(mid) >= 0.0) == sign {
                    a = mid;
                } else {
                    b = mid;
                }
            }
            roots.push(a);
        }
        low = end;
    }
    roots
}

/// Solves `f(r) = target` for `r` in `[0, limit]`, where `f` (returned with its derivative) grows from `f(0) = 0`.
///
/// Newton's iteration kept inside a shrinking bracket. `None` if `target` is out of reach.
pub(super) fn invert_growing(
    f: impl Fn(f64) -> (f64, f64),
    target: f64,
    limit: f64,
) -> Option<f64> {
    let (mut low, mut high) = (0.0, limit);
    if !high.is_finite() {
        high = 1.0_f64.max(target);
        while f(high).0 < target {
            high *= 2.0;
            if high > 1e12 {
                return None;
            }
        }
    } else if f(high).0 < target {
        return None;
    }
    let mut r = target.clamp(low, high);
    for _ in 0..200 {
        let (value, slope) = f(r);
        let error = value - target;
        if error.abs() <= 1e-15 * (1.0 + target) {
            return Some(r);
        }
        if error > 0.0 {
            high = r;
        } else {
            low = r;
        }
        let newton = r - error / slope;
        let next = if newton > low && newton < high {
            newton
        } else {
            0.5 * (low + high)
        };
        if next == r {
            return Some(r);
        }
        r = next;
    }
    ((f(r).0 - target).abs() <= 1e-12 * (1.0 + target)).then_some(r)
}
