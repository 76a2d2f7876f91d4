//! Matches that decide something alone (METHOD 25), close together or very few: where a pattern repeats they are wrong together,
//! and each agrees with the others.

use nalgebra::{DMatrix, Matrix6, Vector2};

/// Distance up to which matches are of one thing, as a share of the image's width.
const CLOSE: f64 = 0.08;
/// As many matches agree with some pose whatever they are: three points tell one.
const FEW: usize = 3;
/// Share of what is known of a direction beyond which nobody else has checked it.
const MOST: f64 = 0.9;

/// The matches, by their place, that hold nearly all that is known of some direction of the pose and lie close together (those
/// that hold most of it) or are no more than `FEW`; none if every direction is vouched for by others.
///
/// `by_pose` is `2n x 6`, `weight` `2n x 2n`, the inverse of the residuals' covariance; `width` is the image's, pixels.
pub(super) fn alone(
    uv: &[Vector2<f64>],
    width: f64,
    by_pose: &DMatrix<f64>,
    weight: &DMatrix<f64>,
) -> Vec<usize> {
    let everybody: Vec<usize> = (0..uv.len()).collect();
    let weighted = weight * by_pose;
    let known: Matrix6<f64> = (by_pose.transpose() * &weighted).fixed_resize(0.0);
    let root = known.cholesky().and_then(|all| all.l().try_inverse());
    let Some(root) = root else {
        return Vec::new();
    };
    // How much of what all say of some direction is lost without a group; what is left is said with the noise of the others.
    let held = |group: &[usize]| {
        let rows: Vec<usize> = group.iter().flat_map(|k| [2 * k, 2 * k + 1]).collect();
        let own = DMatrix::from_fn(rows.len(), rows.len(), |i, j| weight[(rows[i], rows[j])]);
        let said = weighted.select_rows(&rows);
        own.cholesky().map_or(1.0, |own| {
            let lost: Matrix6<f64> = (said.transpose() * own.solve(&said)).fixed_resize(0.0);
            let share = root * lost * root.transpose();
            ((share + share.transpose()) * 0.5)
                .symmetric_eigenvalues()
                .max()
        })
    };
    let close = uv.iter().map(|one| {
        let near = |k: &usize| (uv[*k] - one).norm() <= CLOSE * width;
        everybody.iter().copied().filter(near).collect()
    });
    let (most, group) = largest(close, held);
    if most > MOST {
        return group;
    }
    let mut few = Vec::new();
    for _ in 0..FEW {
        let one_more = everybody.iter().filter(|k| !few.contains(*k));
        let (most, group) = largest(one_more.map(|k| [few.as_slice(), &[*k]].concat()), held);
        if most > MOST {
            return group;
        }
        few = group;
    }
    Vec::new()
}

/// The group that holds most, and how much.
fn largest(
    groups: impl Iterator<Item = Vec<usize>>,
    held: impl Fn(&[usize]) -> f64,
) -> (f64, Vec<usize>) {
    groups.fold((0.0, Vec::new()), |most, group| {
        let share = held(&group);
        if share > most.0 { (share, group) } else { most }
    })
}
