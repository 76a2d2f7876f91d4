//! Rows that go: what is left moves up, in stretches.

use super::Covariance;
use std::ops::Range;

impl Covariance {
    /// Keeps the rows and columns listed in `keep` (increasing), in one compaction.
    pub(crate) fn keep(&mut self, keep: &[usize]) {
        let mut used = vec![false; self.n];
        for &i in keep {
            used[self.slots[i]] = true;
        }
        let kept: Vec<usize> = (0..self.n).filter(|&slot| used[slot]).collect();
        let stretches = stretches(&kept);
        let (ld, data): (usize, &mut [f64]) = (self.ld, &mut self.data);
        for (new_j, &j) in kept.iter().enumerate() {
            for (from, new) in &stretches {
                let below = j.clamp(from.start, from.end);
                data.copy_within(
                    below + j * ld..from.end + j * ld,
                    new + below - from.start + new_j * ld,
                );
            }
        }
        self.n = kept.len();
        for (new, &old) in keep.iter().enumerate() {
            // Slots keep their order, so that a search finds the new one.
            self.slots[new] = kept.partition_point(|&slot| slot < self.slots[old]);
        }
        self.slots.truncate(keep.len());
    }
}

/// Stretches of increasing numbers that follow one another, and where each begins among all.
fn stretches(numbers: &[usize]) -> Vec<(Range<usize>, usize)> {
    let mut found: Vec<(Range<usize>, usize)> = Vec::new();
    for (at, &number) in numbers.iter().enumerate() {
        match found.last_mut() {
            Some((stretch, _)) if stretch.end == number => stretch.end += 1,
            _ => found.push((number..number + 1, at)),
        }
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::state::LinearPart;
    use nalgebra::{DMatrix, Matrix6};

    fn wave(i: usize) -> f64 {
        ((i * 7919 + 13) % 101) as f64 / 101.0 - 0.5
    }

    /// Numbers of their own in every entry, rows that follow from others, and features that share an anchor.
    fn some() -> Covariance {
        let mut p = Covariance::zeros(20, 24);
        for i in 0..20 {
            for j in 0..=i {
                p.set(i, j, wave(20 * i + j));
            }
        }
        let by: Vec<f64> = (0..6 * 4)
            .map(|i| if i % 6 < 3 { 0.0 } else { wave(i) })
            .collect();
        let parts = [
            LinearPart {
                offset: 3,
                width: 4,
                matrix: &by,
            },
            LinearPart {
                offset: 11,
                width: 4,
                matrix: &by,
            },
        ];
        p.augment(&parts, &Matrix6::identity(), None);
        p.augment(&parts, &Matrix6::identity(), Some(20));
        p
    }

    #[test]
    fn rows_that_are_appended_are_the_sum_of_their_parts() {
        let (p, mut by) = (some().to_dense(), DMatrix::zeros(6, 20));
        for i in 0..24 {
            let value = if i % 6 < 3 { 0.0 } else { wave(i) };
            by[(i % 6, 3 + i / 6)] = value;
            by[(i % 6, 11 + i / 6)] = value;
        }
        let before = p.view((0, 0), (20, 20));
        let cross = &by * before;
        assert!((p.view((20, 0), (6, 20)) - &cross).amax() < 1e-15);
        let own = &cross * by.transpose() + DMatrix::identity(6, 6);
        assert!((p.view((20, 20), (6, 6)) - own).amax() < 1e-14);
        assert_eq!(p.view((20, 0), (3, 32)), p.view((26, 0), (3, 32)));
    }

    #[test]
    fn what_is_kept_is_as_it_was() {
        for event in 0..60 {
            let mut p = some();
            let before = p.to_dense();
            let often = 2 + event % 9;
            let keep: Vec<usize> = (0..32)
                .filter(|i| (i * 31 + event * 17) % often != 0)
                .collect();
            p.keep(&keep);
            let expected = before.select_rows(&keep).select_columns(&keep);
            assert_eq!(p.to_dense(), expected, "{keep:?}");
        }
    }
}
