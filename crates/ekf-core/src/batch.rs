//! One frame's measurements as a batch (METHOD 7, steps 5-7): grad H built once, S, its factor, the update.
//!
//! `P H^T` costs O(n) per row, because a row touches 13 to 19 columns; S is gathered from it; the gain is never
//! formed: with `S = L L^T` and `V = P H^T L^-T`, the update is `x += V L^-1 g`, `P -= V V^T` (B1-B5).

use crate::error::EkfError;
use crate::observe::Rows;
use crate::state::{POSE_DIM, State};
use faer::dyn_stack::{MemBuffer, MemStack};
use faer::linalg::cholesky::llt::factor;
use faer::linalg::triangular_solve::{
    solve_lower_triangular_in_place, solve_upper_triangular_in_place,
};
use faer::{MatMut, MatRef, Par, Spec};
use nalgebra::{Matrix3, Vector3};

/// A measurement that is accepted or rejected as a whole.
#[derive(Clone, Debug)]
pub struct Unit {
    /// Rows of the innovation and of grad H.
    pub rows: Rows,
    /// Id of its feature.
    pub id: u64,
    /// Offset of its feature in the state.
    pub feature: usize,
    /// Offset of the frame's error of T_CF, if the rows depend on it.
    pub worn: Option<usize>,
}

/// Buffers of the batch; they only grow, so a warm step allocates nothing.
#[derive(Default)]
pub struct Workspace {
    units: Vec<Unit>,
    offsets: Vec<usize>,
    kept_rows: Vec<usize>,
    pose_columns: Vec<f64>,
    feature_columns: Vec<f64>,
    worn_columns: Vec<f64>,
    pht: Vec<f64>,
    s: Vec<f64>,
    l: Vec<f64>,
    g: Vec<f64>,
    noise: Vec<Matrix3<f64>>,
    y: Vec<f64>,
    weights: Vec<f64>,
    scratch: Option<MemBuffer>,
    scratch_dim: usize,
}

impl Unit {
    /// `H (to - from)` of its rows.
    fn step(&self, from: &[f64], to: &[f64]) -> Vector3<f64> {
        let part = |offset: usize, c: usize| to[offset + c] - from[offset + c];
        let mut sum = Vector3::zeros();
        for c in 0..POSE_DIM {
            sum += self.rows.by_pose.column(c) * part(0, c);
        }
        for c in 0..6 {
            sum += self.rows.by_feature.column(c) * part(self.feature, c);
        }
        if let (Some(by_worn), Some(worn)) = (&self.rows.by_worn, self.worn) {
            for c in 0..6 {
                sum += by_worn.column(c) * part(worn, c);
            }
        }
        sum
    }
}

impl std::fmt::Debug for Workspace {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Workspace")
            .field("rows", &self.rows())
            .finish_non_exhaustive()
    }
}

impl Clone for Workspace {
    /// Buffers carry nothing over: a copy starts empty.
    fn clone(&self) -> Self {
        Self::default()
    }
}

impl Workspace {
    /// Starts a new batch.
    pub(crate) fn clear(&mut self) {
        self.units.clear();
    }

    /// Adds a unit.
    pub(crate) fn push(&mut self, unit: Unit) {
        self.units.push(unit);
    }

    /// The units of the batch.
    pub fn units(&self) -> &[Unit] {
        &self.units
    }

    /// First row of each unit, and the number of rows at the end.
    pub fn offsets(&self) -> &[usize] {
        &self.offsets
    }

    /// Number of rows.
    pub fn rows(&self) -> usize {
        self.offsets.last().copied().unwrap_or(0)
    }

    /// Innovation covariance S, `m x m`, column-major, both triangles.
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

    /// Measurement noise of each unit.
    pub fn noise(&self) -> &[Matrix3<f64>] {
        &self.noise
    }

    /// Normalised innovation squared, `g^T S^-1 g`. Valid after [`Self::factor`].
    pub fn nis(&self) -> f64 {
        self.y.iter().map(|v| v * v).sum()
    }

    /// Builds `P H^T`, S and g for the units (B4, B5).
    pub(crate) fn build(&mut self, state: &State) {
        let n = state.p.dim();
        self.offsets.clear();
        self.offsets.push(0);
        for unit in &self.units {
            let last = self.offsets[self.offsets.len() - 1];
            self.offsets.push(last + unit.rows.count);
        }
        let m = self.rows();
        resize(&mut self.pht, n * m);
        resize(&mut self.pose_columns, n * POSE_DIM);
        resize(&mut self.feature_columns, n * 6);
        resize(&mut self.worn_columns, n * 6);
        state.p.columns(0, POSE_DIM, &mut self.pose_columns);
        let mut worn_at = None;
        for (u, unit) in self.units.iter().enumerate() {
            state.p.columns(unit.feature, 6, &mut self.feature_columns);
            if let Some(w) = unit.worn
                && worn_at != Some(w)
            {
                state.p.columns(w, 6, &mut self.worn_columns);
                worn_at = Some(w);
            }
            for r in 0..unit.rows.count {
                let row = self.offsets[u] + r;
                let out = &mut self.pht[row * n..(row + 1) * n];
                out.fill(0.0);
                for c in 0..POSE_DIM {
                    axpy(unit.rows.by_pose[(r, c)], &self.pose_columns[c * n..], out);
                }
                for c in 0..6 {
                    axpy(
                        unit.rows.by_feature[(r, c)],
                        &self.feature_columns[c * n..],
                        out,
                    );
                }
                if let (Some(by_worn), Some(_)) = (&unit.rows.by_worn, unit.worn) {
                    for c in 0..6 {
                        axpy(by_worn[(r, c)], &self.worn_columns[c * n..], out);
                    }
                }
            }
        }
        self.gather_s(n, m);
        self.collect_noise();
    }

    fn collect_noise(&mut self) {
        self.noise.clear();
        self.noise.extend(self.units.iter().map(|u| u.rows.noise));
    }

    fn gather_s(&mut self, n: usize, m: usize) {
        resize(&mut self.s, m * m);
        resize(&mut self.g, m);
        for (u, unit) in self.units.iter().enumerate() {
            let (from, rows) = (self.offsets[u], &unit.rows);
            for column in 0..m {
                let pht = &self.pht[column * n..(column + 1) * n];
                for r in 0..rows.count {
                    let mut sum = 0.0;
                    for (c, p) in pht[..POSE_DIM].iter().enumerate() {
                        sum += rows.by_pose[(r, c)] * p;
                    }
                    for c in 0..6 {
                        sum += rows.by_feature[(r, c)] * pht[unit.feature + c];
                    }
                    if let (Some(by_worn), Some(w)) = (&rows.by_worn, unit.worn) {
                        for c in 0..6 {
                            sum += by_worn[(r, c)] * pht[w + c];
                        }
                    }
                    self.s[from + r + column * m] = sum;
                }
            }
            for r in 0..rows.count {
                self.g[from + r] = rows.innovation[r];
                for c in 0..rows.count {
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

    /// Leaves out units (increasing indices): their rows go from `P H^T`, S and g. S of the rest is factored anew
    /// by the caller, which at these sizes costs less than deleting rows from the factor one by one.
    pub(crate) fn leave_out(&mut self, state_dim: usize, gone: &[usize]) {
        if gone.is_empty() {
            return;
        }
        let m = self.rows();
        self.kept_rows.clear();
        for u in 0..self.units.len() {
            if gone.binary_search(&u).is_err() {
                self.kept_rows.extend(self.offsets[u]..self.offsets[u + 1]);
            }
        }
        let k = self.kept_rows.len();
        for (new, &old) in self.kept_rows.iter().enumerate() {
            self.pht
                .copy_within(old * state_dim..(old + 1) * state_dim, new * state_dim);
            self.g[new] = self.g[old];
        }
        for (new_j, &j) in self.kept_rows.iter().enumerate() {
            for (new_i, &i) in self.kept_rows.iter().enumerate() {
                self.s[new_i + new_j * k] = self.s[i + j * m];
            }
        }
        self.s.truncate(k * k);
        self.g.truncate(k);
        let mut u = 0;
        self.units.retain(|_| {
            u += 1;
            gone.binary_search(&(u - 1)).is_err()
        });
        self.offsets.truncate(1);
        self.collect_noise();
        for unit in &self.units {
            let last = self.offsets[self.offsets.len() - 1];
            self.offsets.push(last + unit.rows.count);
        }
    }

    /// Adds the gain times the innovation to a mean: `x += V y` before V is formed, `P H^T L^-T y`.
    pub(crate) fn add_gain_times_innovation(&mut self, x: &mut [f64]) {
        let (n, m) = (x.len(), self.rows());
        if m == 0 {
            return;
        }
        resize(&mut self.weights, m);
        self.weights.copy_from_slice(&self.y);
        solve_upper_triangular_in_place(
            MatRef::from_column_major_slice(&self.l, m, m).transpose(),
            MatMut::from_column_major_slice_mut(&mut self.weights, m, 1),
            Par::Seq,
        );
        for (row, &w) in self.weights.iter().enumerate() {
            axpy(w, &self.pht[row * n..(row + 1) * n], x);
        }
    }

    /// Takes units linearised at `moved` in place of those at the last point, if they say something new: if a
    /// measurement is off its linear model by more than `tolerance` sigmas. Their innovation is brought back to
    /// the prior mean: `g = z - h(moved) + H (moved - prior)`. Returns false, and changes nothing, where the linear
    /// model holds or a feature no longer predicts anything.
    pub(crate) fn relinearise(
        &mut self,
        fresh: Vec<Option<Unit>>,
        prior: &[f64],
        moved: &[f64],
        tolerance: f64,
    ) -> bool {
        let mut worst: f64 = 0.0;
        let mut units = Vec::with_capacity(fresh.len());
        for (unit, old) in fresh.into_iter().zip(&self.units) {
            let Some(mut unit) = unit else { return false };
            let rows = &mut unit.rows;
            let linear = old.rows.innovation - old.step(prior, moved);
            for r in 0..rows.count {
                let sigma = rows.noise[(r, r)].sqrt();
                worst = worst.max((rows.innovation[r] - linear[r]).abs() / sigma);
            }
            let step = unit.step(prior, moved);
            unit.rows.innovation += step;
            units.push(unit);
        }
        if worst < tolerance {
            return false;
        }
        self.units = units;
        true
    }

    /// The update itself: `x += V y`, `P -= V V^T` with `V = P H^T L^-T`, quaternions normalised.
    pub(crate) fn apply(&mut self, state: &mut State) {
        let (n, m) = (state.p.dim(), self.rows());
        if m == 0 {
            return;
        }
        let v = MatMut::from_column_major_slice_mut(&mut self.pht[..n * m], n, m);
        solve_lower_triangular_in_place(
            MatRef::from_column_major_slice(&self.l[..m * m], m, m),
            v.transpose_mut(),
            Par::Seq,
        );
        for (row, &y) in self.y[..m].iter().enumerate() {
            axpy(y, &self.pht[row * n..(row + 1) * n], &mut state.x);
        }
        state.p.downdate(&self.pht, m);
        state.normalise_quaternions();
    }
}

fn resize(buffer: &mut Vec<f64>, len: usize) {
    buffer.resize(len, 0.0);
}

fn axpy(a: f64, x: &[f64], y: &mut [f64]) {
    if a != 0.0 {
        for (y, x) in y.iter_mut().zip(x) {
            *y += a * x;
        }
    }
}
