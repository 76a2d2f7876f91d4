//! Errors that last, beside P (METHOD 20).
//!
//! P is the covariance of a filter whose errors are white: it gives gains, gates and the mean. What lasts, as an error that all
//! of a view share, is kept in *error modes*: columns G, one for each independent source, in standard deviations, so that the
//! covariance that is told is `P + G G^T`. The error of any linear filter follows from its own gain: `G <- F G` in a
//! prediction, `G <- (1 - K H) G` in an update, `J G` for what is born. These are the operations that the filter does to
//! rows of P, so G stands in P as the covariances of rows of its own, to which no measurement belongs: the mean never learns of
//! them. Their own variances mean nothing, as those of the auxiliary rows of a local update.

use super::{Block, BlockKind, CAMERA_DIM, State};
use crate::kernel::{Panels, Product};
use crate::math::pose::tangent_map;
use nalgebra::{DMatrix, DVector, Matrix3, Matrix6, SMatrix, Vector6};
use std::ops::Range;

/// Most error modes at a time.
const MOST: usize = 48;
/// How many are left where there are too many.
const KEPT: usize = 34;
/// Variance below which a number counts as known, for that comparison.
const LEAST_VARIANCE: f64 = 1e-12;

/// The covariance that is told, read entry by entry.
pub(crate) struct Told<'a> {
    state: &'a State,
    modes: Range<usize>,
}

/// Rows of the state, and their part in each mode.
pub(crate) struct ToldRows<const R: usize> {
    pub(crate) from: usize,
    parts: Vec<[f64; R]>,
}

impl Told<'_> {
    /// One entry.
    pub(crate) fn get(&self, i: usize, j: usize) -> f64 {
        let p = &self.state.p;
        let time_correlated = self.modes.clone().map(|k| p.get(i, k) * p.get(j, k));
        p.get(i, j) + time_correlated.sum::<f64>()
    }

    /// The `R x C` block whose corner is `(i, j)`.
    pub(crate) fn block<const R: usize, const C: usize>(
        &self,
        i: usize,
        j: usize,
    ) -> SMatrix<f64, R, C> {
        self.between(&self.rows::<R>(i), &self.rows::<C>(j))
    }

    /// `R` rows of the state from `i` on with their part in each mode, to be read against many others.
    pub(crate) fn rows<const R: usize>(&self, i: usize) -> ToldRows<R> {
        let p = &self.state.p;
        let parts = |k| std::array::from_fn(|r| p.get(i + r, k));
        ToldRows {
            from: i,
            parts: self.modes.clone().map(parts).collect(),
        }
    }

    /// The block of these rows and columns; each entry is summed as `get` does.
    pub(crate) fn between<const R: usize, const C: usize>(
        &self,
        rows: &ToldRows<R>,
        columns: &ToldRows<C>,
    ) -> SMatrix<f64, R, C> {
        // Column by column, whose sums stay in registers.
        let time_correlated: [[f64; R]; C] = std::array::from_fn(|c| {
            let mut sums = [-0.0; R];
            for (of_rows, of_columns) in rows.parts.iter().zip(&columns.parts) {
                for (sum, row) in sums.iter_mut().zip(of_rows) {
                    *sum += row * of_columns[c];
                }
            }
            sums
        });
        let p = &self.state.p;
        SMatrix::from_fn(|r, c| p.get(rows.from + r, columns.from + c) + time_correlated[c][r])
    }

    /// 6x6 covariance of the camera's pose, (translation, rotation), right tangent (METHOD 1).
    pub(crate) fn pose_covariance(&self) -> Matrix6<f64> {
        let to_tangent = tangent_map(&self.state.camera_pose().q);
        let p = self.block::<7, 7>(0, 0);
        let p = to_tangent * p * to_tangent.transpose();
        (p + p.transpose()) * 0.5
    }

    /// 12x12 covariance of the pose, as above, then of velocity and angular velocity along the axes of C.
    pub(crate) fn pose_and_twist_covariance(&self) -> SMatrix<f64, 12, 12> {
        let pose = self.state.camera_pose();
        let back = crate::math::quat::rotation(&pose.q).transpose();
        let to_tangent = tangent_map(&pose.q);
        let velocity = back * self.state.velocity();
        let mut by = SMatrix::<f64, 12, CAMERA_DIM>::zeros();
        by.fixed_view_mut::<6, 7>(0, 0).copy_from(&to_tangent);
        let turned = velocity.cross_matrix() * to_tangent.fixed_view::<3, 7>(3, 0);
        by.fixed_view_mut::<3, 7>(6, 0).copy_from(&turned);
        by.fixed_view_mut::<3, 3>(6, 7).copy_from(&back);
        by.fixed_view_mut::<3, 3>(9, 10)
            .copy_from(&Matrix3::identity());
        let p = by * self.block::<CAMERA_DIM, CAMERA_DIM>(0, 0) * by.transpose();
        (p + p.transpose()) * 0.5
    }

    /// What lasts of the variance of a number that is linear in the state.
    pub(crate) fn time_correlated_variance(&self, by: &[f64]) -> f64 {
        let p = &self.state.p;
        let along = self.modes.clone().map(|k| {
            let terms = by.iter().enumerate().filter(|(_, by)| **by != 0.0);
            terms.map(|(i, by)| by * p.get(i, k)).sum::<f64>()
        });
        along.map(|along| along * along).sum()
    }
}

impl State {
    /// The covariance that is told.
    pub(crate) fn told(&self) -> Told<'_> {
        Told {
            state: self,
            modes: self.error_modes().map_or(0..0, |block| block.range()),
        }
    }

    /// Covariance of the change that the error modes made in six numbers of the state, at `offset`, which `before` had the part of one
    /// number in it that stays, given with its derivative.
    pub(crate) fn put_by_modes(
        &self,
        offset: usize,
        before: Option<(usize, Vector6<f64>)>,
    ) -> Matrix6<f64> {
        let mut sum = Matrix6::zeros();
        for k in self.error_modes().map_or(0..0, |block| block.range()) {
            let mut put = Vector6::from_fn(|i, _| self.p.get(offset + i, k));
            if let Some((number, by)) = before {
                put -= by * self.p.get(number, k);
            }
            sum += put * put.transpose();
        }
        sum
    }

    /// The state with the covariance that is told, and without error modes.
    pub(crate) fn into_told(mut self) -> Self {
        let Some(block) = self.error_modes() else {
            return self;
        };
        let (slots, n) = (self.mode_slots(&block), self.p.stored().n);
        let mut change = Product::default();
        change.x.reshape(n, slots.len());
        change.y.reshape(n, slots.len());
        let mut column = vec![0.0; n];
        for (k, mode) in slots.clone().enumerate() {
            self.p.stored_column(mode, &mut column);
            column[slots.clone()].fill(0.0);
            change.x.set_column(k, column.iter().copied());
            change.y.set_column(k, column.iter().map(|g| -g));
        }
        self.p.downdate(&Panels::default(), Some(&change));
        self.remove(|b| b.id == block.id);
        self
    }

    /// The block of the error modes, if something lasts.
    pub(crate) fn error_modes(&self) -> Option<Block> {
        let mut blocks = self.layout.blocks().iter();
        let modes = blocks.find(|b| matches!(b.kind, BlockKind::ErrorModes(_)));
        modes.copied()
    }

    /// Where the rows of the error modes are stored, side by side.
    fn mode_slots(&self, block: &Block) -> Range<usize> {
        let first = self.p.stored().slots[block.offset];
        first..first + block.kind.dim()
    }

    /// Adds error modes: columns of as many numbers as P has stored rows, in standard deviations. `outside` says `G^T V^-1 G` of
    /// numbers that are not part of this state, V their variances; it is asked where others must make room.
    pub(crate) fn add_error_modes(
        &mut self,
        columns: &[f64],
        outside: impl FnOnce(&Self, &Block) -> DMatrix<f64>,
    ) {
        let n = self.p.stored().n;
        let count = columns.len() / n;
        let block = self.error_modes().unwrap_or_else(|| {
            let (zeros, none) = (DVector::zeros(MOST), DMatrix::zeros(MOST, MOST));
            self.append(BlockKind::ErrorModes(MOST), &zeros, &[], &none)
        });
        let slots = self.mode_slots(&block);
        let rows = self.p.stored().n;
        let others = |row: &usize| !slots.contains(row);
        let is_free = |&mode: &usize| {
            let mut rows = (0..rows).filter(others);
            rows.all(|row| self.p.stored_entry(row, mode) == 0.0)
        };
        let mut free: Vec<usize> = slots.clone().filter(is_free).collect();
        if free.len() < count {
            let outside = outside(self, &block);
            self.compress_modes(&slots, outside);
            free = (slots.start + KEPT..slots.end).collect();
        }
        for (column, &mode) in columns.chunks_exact(n).zip(&free) {
            for row in (0..n).filter(others) {
                self.p.set_stored(row.max(mode), row.min(mode), column[row]);
            }
        }
    }

    /// Turns the error modes among themselves, which leaves `G G^T` as it is, so that the first ones tell most of the state in its
    /// standard deviations; the last ones go, and the first tell by so much more that their sum is as before.
    fn compress_modes(&mut self, slots: &Range<usize>, outside: DMatrix<f64>) {
        let rows = self.p.stored().n;
        let others = || (0..rows).filter(|row| !slots.contains(row));
        let of_row = |state: &Self, row: usize| {
            let entries = slots.clone().map(|k| state.p.stored_entry(row, k));
            DVector::from_iterator(slots.len(), entries)
        };
        let mut counts = vec![false; rows];
        let of_state =
            |b: &&Block| !matches!(b.kind, BlockKind::Auxiliary(_) | BlockKind::ErrorModes(_));
        let blocks = self.layout.blocks().iter().filter(of_state);
        for i in (0..CAMERA_DIM).chain(blocks.flat_map(Block::range)) {
            counts[self.p.stored().slots[i]] = true;
        }
        let mut gram = outside;
        for row in others().filter(|&row| counts[row]) {
            let variance = self.p.stored_entry(row, row).max(LEAST_VARIANCE);
            let g = of_row(self, row);
            gram.ger(1.0 / variance, &g, &g, 1.0);
        }
        let eigen = gram.symmetric_eigen();
        let mut order: Vec<usize> = (0..slots.len()).collect();
        order.sort_by(|&a, &b| eigen.eigenvalues[b].total_cmp(&eigen.eigenvalues[a]));
        let told = |some: &[usize]| some.iter().map(|&k| eigen.eigenvalues[k]).sum::<f64>();
        let (all, kept) = (told(&order), told(&order[..KEPT]));
        // Modes that move nothing that was asked leave no measure.
        let more = if kept > 0.0 { (all / kept).sqrt() } else { 1.0 };
        for row in others() {
            let g = of_row(self, row);
            for (i, mode) in slots.clone().enumerate() {
                let turned = eigen.eigenvectors.column(order[i]).dot(&g);
                let value = if i < KEPT { more * turned } else { 0.0 };
                self.p.set_stored(row.max(mode), row.min(mode), value);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn wave(i: usize) -> f64 {
        ((i * 7919 + 13) % 101) as f64 / 101.0 - 0.5
    }

    /// What is put together changes P nowhere, and what is told in sum hardly.
    #[test]
    fn little_is_lost_where_there_is_no_room() {
        let mut state = State::at_origin(64);
        for _ in 0..3 {
            let own = DMatrix::identity(6, 6) * 0.02;
            state.append(BlockKind::Calibration, &DVector::zeros(6), &[], &own);
        }
        for i in 0..CAMERA_DIM {
            state.p.set(i, i, 0.01);
        }
        let before = state.p.to_dense();
        let n = before.nrows();
        let in_units_of_p =
            |p: &DMatrix<f64>| (0..n).map(|i| p[(i, i)] / before[(i, i)]).sum::<f64>();
        let mut all = before.clone();
        for event in 0..20 {
            let rows = state.p.stored().n;
            let entry = |i: usize| match i % rows {
                row if row < n => 0.1 * wave(i + 1000 * event),
                _ => 0.0,
            };
            let columns: Vec<f64> = (0..7 * rows).map(entry).collect();
            for column in columns.chunks_exact(rows) {
                let g = DVector::from_column_slice(&column[..n]);
                all += &g * g.transpose();
            }
            state.add_error_modes(&columns, |_, _| DMatrix::zeros(MOST, MOST));
        }
        let p = state.p.to_dense();
        assert_eq!(p.view((0, 0), (n, n)), before);
        let told = state.into_told().p.to_dense();
        assert_eq!(told.nrows(), n);
        let share = in_units_of_p(&told) / in_units_of_p(&all);
        assert!((share - 1.0).abs() < 1e-9, "{share}");
        for i in 0..n {
            let share = told[(i, i)] / all[(i, i)];
            assert!((0.9..1.1).contains(&share), "{i}: {share}");
        }
    }
}
