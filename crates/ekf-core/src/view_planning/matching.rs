//! How probable it is that a point that both cameras see is matched.

use nalgebra::Vector3;

/// Share of the landmarks inside both images that are matched, by the angle between the two rays at the landmark, degrees: the
/// middles of bins, means over five recordings (docs/view-planning.md). Between them it is interpolated.
const MATCHED: [(f64, f64); 6] = [
    (2.5, 0.91),
    (7.5, 0.78),
    (12.5, 0.69),
    (17.5, 0.66),
    (25.0, 0.53),
    (35.0, 0.19),
];

/// Probability of a match of a point, given the vectors to it from both cameras.
pub(super) fn probability(from_s: &Vector3<f64>, from_f: &Vector3<f64>) -> f64 {
    let angle = from_s.angle(from_f).to_degrees();
    let after = MATCHED.partition_point(|(at, _)| *at < angle);
    match after {
        0 => MATCHED[0].1,
        n if n == MATCHED.len() => MATCHED[n - 1].1,
        n => {
            let ((a, low), (b, high)) = (MATCHED[n - 1], MATCHED[n]);
            low + (high - low) * (angle - a) / (b - a)
        }
    }
}

/// Probability that at least `least` of the matches with these probabilities come about: the normal approximation of their
/// number, its tail as a logistic curve.
pub(super) fn at_least(least: f64, mean: f64, variance: f64) -> f64 {
    let sigmas = (mean + 0.5 - least) / variance.max(1e-6).sqrt();
    1.0 / (1.0 + (-1.702 * sigmas).exp())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(degrees: f64) -> f64 {
        let angle = degrees.to_radians();
        probability(&Vector3::z(), &Vector3::new(angle.sin(), 0.0, angle.cos()))
    }

    #[test]
    fn the_table_is_met_and_held_beyond_its_ends() {
        for (angle, share) in MATCHED {
            assert!((at(angle) - share).abs() < 1e-9);
        }
        assert_eq!((at(0.0), at(90.0)), (0.91, 0.19));
        assert!((at(5.0) - 0.845).abs() < 1e-9);
    }

    #[test]
    fn enough_matches_are_likely_where_more_are_expected() {
        assert!(at_least(8.0, 30.0, 10.0) > 0.999);
        assert!(at_least(8.0, 1.0, 1.0) < 1e-4);
        assert!((at_least(8.0, 7.5, 3.0) - 0.5).abs() < 1e-12);
    }
}
