//! One frame's measurements as a batch (METHOD 7, steps 5-7): `P H^T`, S, its Cholesky factor, the update.
//!
//! A row of H touches 13 to 19 columns, so a row of `P H^T` costs O(n), and S is gathered from `P H^T`. The gain is never
//! formed: with `S = L L^T` and `V = P H^T L^-T`, the update is `x += V L^-1 g`, `P -= V V^T` (B1-B5).

use crate::error::EkfError;
use crate::gauge::{GAUGES, Gauge, SCALE};
use crate::guard;
use crate::kernel::{self, Panels};
use crate::observe::POSE_DIM;
use crate::observe::block::MeasurementBlock;
use crate::state::{Considered, Learned, State};
use crate::validate::{Batch, Blocks};
use faer::dyn_stack::{MemBuffer, MemStack};
use faer::linalg::cholesky::llt::factor;
use faer::linalg::triangular_solve::solve_lower_triangular_in_place;
use faer::{MatMut, MatRef, Par, Spec};
use nalgebra::{Matrix3, Vector6};

/// Buffers of the batch; they only grow, so a warm step allocates nothing.
#[derive(Default)]
pub struct Workspace {
    blocks: Vec<MeasurementBlock>,
    offsets: Vec<usize>,
    kept_rows: Vec<usize>,
    /// `P H^T`; after `solve`, `V`.
    pht: Panels,
    packed: Vec<f64>,
    /// `V y`, followed by `V C` if there is a gauge.
    moved: Vec<f64>,
    /// `y`, followed by `C = L^-1 H P B` if there is a gauge.
    along: Vec<f64>,
    /// Diagonal of `V V^T`.
    squares: Vec<f64>,
    s: Vec<f64>,
    l: Vec<f64>,
    g: Vec<f64>,
    /// `g` as the tests see it.
    tested: Vec<f64>,
    noise: Vec<Matrix3<f64>>,
    y: Vec<f64>,
    considered: Considered,
    scratch: Option<MemBuffer>,
    scratch_dim: usize,
}

impl std::fmt::Debug for Workspace {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Workspace")
            .field("rows", &self.rows())
            .finish_non_exhaustive()
    }
}

impl Clone for Workspace {
    /// An empty workspace: nothing in the buffers outlives a step.
    fn clone(&self) -> Self {
        Self::default()
    }
}

impl Workspace {
    /// Starts a new batch.
    pub(crate) fn clear(&mut self) {
        self.blocks.clear();
    }

    /// Adds a block.
    pub(crate) fn push(&mut self, block: MeasurementBlock) {
        self.blocks.push(block);
    }

    /// The blocks of the batch.
    pub fn blocks(&self) -> &[MeasurementBlock] {
        &self.blocks
    }

    /// First row of each block, and the number of rows at the end.
    pub fn offsets(&self) -> &[usize] {
        &self.offsets
    }

    /// Number of rows.
    pub fn rows(&self) -> usize {
        self.offsets.last().copied().unwrap_or(0)
    }

    /// Innovation covariance S, `m x m`, lower triangle, column-major.
    pub fn s(&self) -> &[f64] {
        &self.s
    }

    /// Cholesky factor of S, lower triangle, column-major.
    pub fn l(&self) -> &[f64] {
        &self.l
    }

    /// The innovation.
    pub fn g(&self) -> &[f64] {
        &self.g
    }

    /// By how much the first `rows` rows alone would move the mean, row by row as P is stored. Valid after the factorisation.
    pub(crate) fn moved_by_first(&self, rows: usize) -> Vec<f64> {
        let weights = self.weights(self.y[..rows].to_vec());
        let by_row = |i| self.gained(i, &weights);
        (0..self.pht.rows()).map(by_row).collect()
    }

    /// `L^-T v` of the first rows.
    fn weights(&self, mut v: Vec<f64>) -> Vec<f64> {
        let m = self.rows();
        for k in (0..v.len()).rev() {
            let later = (k + 1..v.len()).map(|i| self.l[i + k * m] * v[i]);
            v[k] = (v[k] - later.sum::<f64>()) / self.l[k + k * m];
        }
        v
    }

    /// Row `i` of `P H^T`, as P is stored, times `weights`.
    fn gained(&self, i: usize, weights: &[f64]) -> f64 {
        let weights = weights.iter().enumerate();
        weights.map(|(k, w)| self.pht.get(i, k) * w).sum()
    }

    /// By how much the update would move six numbers of the mean from `at` on only because it changes the scale: its step along
    /// the scale, times the regression of the six on that after the update. Zero where nothing tells the scale. Valid after
    /// the factorisation, with a gauge that is prepared.
    pub(crate) fn moved_with_scale(
        &self,
        gauge: &Gauge,
        slots: &[usize],
        at: usize,
    ) -> Vector6<f64> {
        let mut seen = Vec::with_capacity(self.rows());
        self.see(gauge, slots, SCALE, &mut seen);
        self.solve_lower(&mut seen);
        let taken: f64 = seen.iter().map(|c| c * c).sum();
        let left = gauge.scale_variance() - taken;
        if left <= 0.0 || left.is_nan() {
            return Vector6::zeros();
        }
        let growth: f64 = seen.iter().zip(&self.y).map(|(c, y)| c * y).sum();
        let weights = self.weights(seen);
        Vector6::from_fn(|i, _| {
            let slot = slots[at + i];
            (gauge.with_scale(slot) - self.gained(slot, &weights)) / left * growth
        })
    }

    /// Largest change that the update makes to a number of the camera's pose, whose rows are stored first. Valid after
    /// [`Self::solve`].
    pub(crate) fn moved_by(&self) -> f64 {
        let pose = self.moved.iter().take(POSE_DIM);
        pose.fold(0.0, |largest, x| largest.max(x.abs()))
    }

    /// By how much the update moves row `i` of the mean as P is stored. Valid after [`Self::solve`].
    pub(crate) fn moved_at(&self, i: usize) -> f64 {
        if self.rows() == 0 { 0.0 } else { self.moved[i] }
    }

    /// The batch as the validation tests see it. Valid after the factorisation.
    pub fn as_batch(&self) -> Batch<'_> {
        Batch {
            s: &self.s,
            l: &self.l,
            ld: self.rows(),
            g: &self.g,
            noise: &self.noise,
            blocks: Blocks::new(&self.offsets),
        }
    }

    /// As [`Self::as_batch`], of innovations that are `times` as large.
    pub fn as_batch_of(&mut self, times: f64) -> Batch<'_> {
        self.tested.clear();
        self.tested.extend(self.g.iter().map(|g| g * times));
        Batch {
            g: &self.tested,
            ..self.as_batch()
        }
    }

    /// Normalised innovation squared, `g^T S^-1 g`. Valid after the factorisation.
    pub fn nis(&self) -> f64 {
        self.y.iter().map(|v| v * v).sum()
    }

    /// Builds `P H^T`, S and g for the blocks (B4, B5).
    pub(crate) fn build(&mut self, state: &State) {
        self.offsets.clear();
        self.offsets.push(0);
        for block in &self.blocks {
            let last = self.offsets[self.offsets.len() - 1];
            self.offsets.push(last + block.rows.count);
        }
        let m = self.rows();
        let stored = state.p.stored();
        self.pht.reshape(stored.n, m);
        kernel::fill(stored, &self.blocks, &mut self.pht);
        self.gather_s(m, stored.slots);
        self.collect_noise();
    }

    fn collect_noise(&mut self) {
        self.noise.clear();
        self.noise.extend(self.blocks.iter().map(|u| u.rows.noise));
    }

    /// `S = H P H^T + R` and the innovation. Column `j` of S is row `j` of H times `P H^T`, summed over the entries of that
    /// row that are not zero.
    fn gather_s(&mut self, m: usize, slots: &[usize]) {
        resize(&mut self.s, m * m);
        resize(&mut self.g, m);
        for (u, block) in self.blocks.iter().enumerate() {
            let (from, rows) = (self.offsets[u], &block.rows);
            let (by_first, by_own) = rows.by_feature.as_slice().split_at(9);
            let (first, own) = block.slots(slots);
            for k in from..m {
                let mut sums = [0.0; 3];
                let pht = &self.pht;
                pht.add::<POSE_DIM>(&mut sums, 0, k, rows.by_pose.as_slice());
                if let Some(motion) = &rows.by_motion {
                    let (by_velocity, by_readout) = motion.by.as_slice().split_at(18);
                    pht.add::<6>(&mut sums, POSE_DIM, k, by_velocity);
                    pht.add::<1>(&mut sums, slots[motion.readout], k, by_readout);
                }
                pht.add::<3>(&mut sums, first, k, by_first);
                pht.add::<3>(&mut sums, own, k, by_own);
                if let (Some(by_shared), Some(w)) = (&rows.by_shared, block.shared) {
                    pht.add::<6>(&mut sums, slots[w], k, by_shared.as_slice());
                    if let Some(share) = rows.roll {
                        let by_roll = by_shared * share;
                        pht.add::<6>(&mut sums, slots[w + 6], k, by_roll.as_slice());
                    }
                }
                for (r, sum) in sums.iter().enumerate().take(rows.count) {
                    self.s[k + (from + r) * m] = *sum;
                }
            }
            for r in 0..rows.count {
                self.g[from + r] = rows.innovation[r];
                for c in 0..=r {
                    self.s[from + r + (from + c) * m] += rows.noise[(r, c)];
                }
            }
        }
    }

    /// Factors S and solves for `L^-1 g`.
    ///
    /// # Errors
    /// `NotPositiveDefinite` if S is not; nothing of the state has changed then.
    pub(crate) fn factor(&mut self) -> Result<(), EkfError> {
        let m = self.rows();
        self.y.clear();
        if m == 0 {
            return Ok(());
        }
        resize(&mut self.l, m * m);
        self.l.copy_from_slice(&self.s);
        let params: Spec<factor::LltParams, f64> = Spec::default();
        if self.scratch_dim < m || self.scratch.is_none() {
            let request = factor::cholesky_in_place_scratch::<f64>(m, Par::Seq, params);
            self.scratch = Some(MemBuffer::new(request));
            self.scratch_dim = m;
        }
        let scratch = self.scratch.as_mut().expect("made above");
        factor::cholesky_in_place(
            MatMut::from_column_major_slice_mut(&mut self.l, m, m),
            Default::default(),
            Par::Seq,
            MemStack::new(scratch),
            params,
        )
        .map_err(|e| {
            let factor::LltError::NonPositivePivot { index } = e;
            EkfError::NotPositiveDefinite {
                stage: "innovation covariance",
                pivot: index,
            }
        })?;
        resize(&mut self.y, m);
        self.y.copy_from_slice(&self.g);
        solve_lower_triangular_in_place(
            MatRef::from_column_major_slice(&self.l, m, m),
            MatMut::from_column_major_slice_mut(&mut self.y, m, 1),
            Par::Seq,
        );
        Ok(())
    }

    /// Removes blocks, given by increasing indices, and their rows of `P H^T`, S and g. The caller has to factor S again:
    /// at these sizes that is cheaper than deleting rows from the factor.
    pub(crate) fn leave_out(&mut self, gone: &[usize]) {
        if gone.is_empty() {
            return;
        }
        let m = self.rows();
        self.kept_rows.clear();
        for u in 0..self.blocks.len() {
            if gone.binary_search(&u).is_err() {
                self.kept_rows.extend(self.offsets[u]..self.offsets[u + 1]);
            }
        }
        let k = self.kept_rows.len();
        for (new, &old) in self.kept_rows.iter().enumerate() {
            self.g[new] = self.g[old];
        }
        self.pht.keep_columns(&self.kept_rows);
        for (new_j, &j) in self.kept_rows.iter().enumerate() {
            for (new_i, &i) in self.kept_rows.iter().enumerate().skip(new_j) {
                self.s[new_i + new_j * k] = self.s[i + j * m];
            }
        }
        self.s.truncate(k * k);
        self.g.truncate(k);
        let mut u = 0;
        self.blocks.retain(|_| {
            u += 1;
            gone.binary_search(&(u - 1)).is_err()
        });
        self.offsets.truncate(1);
        self.collect_noise();
        for block in &self.blocks {
            let last = self.offsets[self.offsets.len() - 1];
            self.offsets.push(last + block.rows.count);
        }
    }

    /// Computes the update, `V = P H^T L^-T` and `V y`, and checks it before anything changes. Call it once, after
    /// [`Self::factor`] and before [`Self::apply`]. With a gauge, which is prepared, it also computes `V C`, `C = L^-1 H P B`, in the same
    /// pass: the gauge needs `P B` after the update, which is `P B - V C`.
    ///
    /// # Errors
    /// `Unsound` if mean or covariance would be impossible after the update.
    pub(crate) fn solve(&mut self, state: &State, gauge: Option<&Gauge>) -> Result<(), EkfError> {
        if self.rows() == 0 {
            return Ok(());
        }
        self.along.clear();
        self.along.extend_from_slice(&self.y);
        if let Some(gauge) = gauge {
            self.look_along(gauge, state.p.stored().slots);
        }
        let products = self.along.len() / self.rows();
        let n = state.p.stored().n;
        resize(&mut self.moved, n * products);
        resize(&mut self.squares, n);
        let gives = (&mut self.moved[..], &mut self.squares[..]);
        kernel::solve(&mut self.pht, &self.l, &self.along, gives, &mut self.packed);
        guard::update_is_sane(state, &self.moved, &self.squares)
    }

    /// Makes the update, `x += V y`, `P -= V V^T`, with the same gauge as [`Self::solve`]. The caller normalises the
    /// quaternions afterwards.
    pub(crate) fn apply(
        &mut self,
        state: &mut State,
        gauge: Option<(&mut Gauge, &[u64])>,
        learned: &Learned,
    ) {
        if self.rows() == 0 {
            return;
        }
        state.camera_moved();
        state.consider(learned, &mut self.considered);
        let (n, moved) = (state.p.stored().n, &self.moved);
        for (x, &slot) in state.x.iter_mut().zip(state.p.stored().slots) {
            *x += moved[slot];
        }
        let change = gauge.map(|(gauge, followed)| {
            gauge.keep_shape(state, followed, &moved[..n]);
            gauge.change(state, followed, Some(&moved[n..]))
        });
        state.p.downdate(&self.pht, change);
        state.p.round_up(&self.squares);
        state.keep_considered(&self.considered, learned);
    }

    /// Appends `C` to `y`.
    fn look_along(&mut self, gauge: &Gauge, slots: &[usize]) {
        let mut along = std::mem::take(&mut self.along);
        for k in 0..GAUGES {
            self.see(gauge, slots, k, &mut along);
        }
        self.solve_lower(&mut along[self.rows()..]);
        self.along = along;
    }

    /// Appends `H P B` of the coordinate `k`.
    fn see(&self, gauge: &Gauge, slots: &[usize], k: usize, out: &mut Vec<f64>) {
        for block in &self.blocks {
            out.extend((0..block.rows.count).map(|r| gauge.seen_by(block, slots, r, k)));
        }
    }

    /// `L^-1` of columns.
    fn solve_lower(&self, columns: &mut [f64]) {
        let m = self.rows();
        let count = columns.len() / m;
        solve_lower_triangular_in_place(
            MatRef::from_column_major_slice(&self.l, m, m),
            MatMut::from_column_major_slice_mut(columns, m, count),
            Par::Seq,
        );
    }
}

fn resize(buffer: &mut Vec<f64>, len: usize) {
    buffer.resize(len, 0.0);
}
