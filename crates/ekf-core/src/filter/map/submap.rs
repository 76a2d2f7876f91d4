//! Submaps: what the filter knows about a stretch of the way by itself, taken out of it (METHOD 25).
//!
//! The pose at which a submap begins stays in the state as a clone, and beside it what the submap before transferred: by how
//! much the scale and the time-correlated error of each T_CF were estimated wrongly there. At the end, the way from the one pose to the other is
//! read off with its covariance, the landmarks in view are taken down as they stand to the camera, and the next submap begins.
//! No estimate changes.

use crate::error::EkfError;
use crate::filter::ekf::Filter;
use crate::graph::Edge;
use crate::math::pose::{Pose, tangent_map};
use crate::math::quat;
use crate::observe::{FEATURE_DIM, POSE_DIM};
use crate::scale::by_state;
use crate::state::{Block, BlockKind, LinearPart, State, ToldRows, transferred_dim};
use nalgebra::{DMatrix, DVector, Matrix6, SMatrix, SVector, Vector3};

/// Largest relative error of a landmark's range with which it is taken down, or helps to find the camera.
pub const MAX_RANGE_RATIO: f64 = 0.3;

/// A submap that has ended.
#[derive(Clone, Debug)]
pub struct Submap {
    /// The way since the last one ended; `None` of the first one in a map.
    pub edge: Option<Edge>,
    /// `T_WC` where it ended.
    pub pose: Pose,
    /// Its covariance, right tangent.
    pub pose_covariance: Matrix6<f64>,
    /// Covariance of what it transfers, see [`transferred_dim`].
    pub transferred: DMatrix<f64>,
    /// Landmarks in view.
    pub ids: Vec<u64>,
    /// Their points from the camera, metres.
    pub points: Vec<Vector3<f64>>,
    /// Their joint covariance as they stand to the camera, `3n x 3n`, m^2.
    pub covariance: DMatrix<f64>,
    /// Covariance of the points with what is transferred, `3n` rows.
    pub with_transferred: DMatrix<f64>,
    /// Standard deviation of map drift while all that is in view is exchanged once (METHOD 20), radians.
    pub map_drift: f64,
}

impl Filter {
    /// Ends the present submap and begins the next one; `seen` are the features measured in this frame, of which those with a
    /// good depth are taken down.
    ///
    /// # Errors
    /// `InvalidInput` before the start, `UnknownFeature`; the filter stays as it was.
    pub fn end_submap(&mut self, seen: &[u64]) -> Result<Submap, EkfError> {
        self.memory.check_started()?;
        for &id in seen {
            self.memory.known(id)?;
        }
        self.changes();
        let then = self.begun();
        let now = self.begin_submap();
        let (rotation, translation) = self.pose();
        let transferred: Vec<usize> = now.range().skip(POSE_DIM).collect();
        let told = self.memory.state.told();
        let mut submap = Submap {
            edge: then.map(|then| edge(&self.memory.state, &then, &transferred)),
            pose: Pose {
                rotation,
                translation,
            },
            pose_covariance: self.pose_covariance(),
            transferred: dense(&transferred, &transferred, |i, j| told.get(i, j)),
            ids: Vec::new(),
            points: Vec::new(),
            covariance: DMatrix::zeros(0, 0),
            with_transferred: DMatrix::zeros(0, 0),
            map_drift: self.shared_error(&self.memory.nis),
        };
        take_down(&self.memory.state, seen, &transferred, &mut submap);
        if let Some(then) = then {
            self.memory.state.remove(|b| b.id == then.id);
        }
        Ok(submap)
    }

    /// The way since the last submap ended, with the covariance of the pose and of what that submap transferred; the present one
    /// transfers nothing yet. `None` where none has ended in this map.
    pub fn since_submap(&self) -> Option<Edge> {
        self.begun()
            .map(|then| edge(&self.memory.state, &then, &[]))
    }

    /// Where the present submap began.
    fn begun(&self) -> Option<Block> {
        self.memory.state.layout.submap().map(|(block, _)| block)
    }

    /// Appends the present pose, and the present errors of the scale and of each T_CF, O(n).
    fn begin_submap(&mut self) -> Block {
        let state = &self.memory.state;
        let kind = BlockKind::Submap(transferred_dim(self.setup.worn_cameras.len()));
        let dim = kind.dim();
        let mut by_pose = vec![0.0; dim * POSE_DIM];
        for k in 0..POSE_DIM {
            by_pose[dim * k + k] = 1.0;
        }
        let mut parts = vec![(0, POSE_DIM, by_pose)];
        if let Some(b) = by_state(state) {
            let stretches = state.layout.features().map(Block::range);
            for stretch in std::iter::once(0..3).chain(stretches) {
                let mut matrix = vec![0.0; dim * stretch.len()];
                for (column, i) in matrix.chunks_exact_mut(dim).zip(stretch.clone()) {
                    column[POSE_DIM] = b[i];
                }
                parts.push((stretch.start, stretch.len(), matrix));
            }
        }
        for who in 0..self.setup.worn_cameras.len() {
            let to = POSE_DIM + transferred_dim(who);
            for (offset, by) in state.time_correlated_error(who) {
                let mut matrix = vec![0.0; dim * 6];
                for (column, by) in matrix.chunks_exact_mut(dim).zip(by.column_iter()) {
                    column[to..to + 6].copy_from_slice(by.as_slice());
                }
                parts.push((offset, 6, matrix));
            }
            // What the clock does in all views alike.
            let told = state.clocks.get(who);
            if let (Some(told), Some(block)) = (told, state.worn_clock_block(who)) {
                let mut matrix = vec![0.0; dim];
                matrix[to..to + 6].copy_from_slice(told.mean.as_slice());
                parts.push((block.offset, 1, matrix));
            }
        }
        let parts: Vec<LinearPart<'_>> = parts
            .iter()
            .map(|(offset, width, matrix)| LinearPart {
                offset: *offset,
                width: *width,
                matrix,
            })
            .collect();
        let mut mean = DVector::zeros(dim);
        mean.fixed_rows_mut::<POSE_DIM>(0)
            .copy_from(&self.memory.state.part::<POSE_DIM>(0));
        self.memory
            .state
            .append(kind, &mean, &parts, &DMatrix::zeros(dim, dim))
    }
}

/// Entries of a matrix.
fn dense(rows: &[usize], columns: &[usize], entry: impl Fn(usize, usize) -> f64) -> DMatrix<f64> {
    DMatrix::from_fn(rows.len(), columns.len(), |i, j| entry(rows[i], columns[j]))
}

/// The way from where a submap began to the camera; `transferred` is where the numbers are that the present one transfers.
fn edge(state: &State, then: &Block, transferred: &[usize]) -> Edge {
    let (from, to) = (state.pose_at(then.offset), state.camera_pose());
    let [first, second] = [&from, &to].map(|at| Pose::from_quat(at.r, &at.q));
    let pose = first.inverse().compose(&second);
    // By increments of both poses as they stand in the state: METHOD 1's tangent keeps its halves apart.
    let back = pose.rotation.transpose();
    let mut by_first = Matrix6::zeros();
    by_first.fixed_view_mut::<3, 3>(0, 0).copy_from(&-back);
    by_first
        .fixed_view_mut::<3, 3>(0, 3)
        .copy_from(&(back * quat::skew(&pose.translation)));
    by_first.fixed_view_mut::<3, 3>(3, 3).copy_from(&-back);
    let mut by = SMatrix::<f64, 6, { 2 * POSE_DIM }>::zeros();
    by.fixed_view_mut::<6, POSE_DIM>(0, 0)
        .copy_from(&(by_first * tangent_map(&from.q)));
    by.fixed_view_mut::<6, POSE_DIM>(0, POSE_DIM)
        .copy_from(&tangent_map(&to.q));
    let starts = [then.offset, 0];
    let ends = |k: usize| starts[k / POSE_DIM] + k % POSE_DIM;
    let p = state.told();
    let poses =
        SMatrix::<f64, { 2 * POSE_DIM }, { 2 * POSE_DIM }>::from_fn(|i, j| p.get(ends(i), ends(j)));
    let way = by * poses * by.transpose();
    let was_handed = then.range().skip(POSE_DIM);
    let handed: Vec<usize> = was_handed
        .clone()
        .chain(transferred.iter().copied())
        .collect();
    let n = 6 + handed.len();
    let mut covariance = DMatrix::zeros(n, n);
    covariance
        .fixed_view_mut::<6, 6>(0, 0)
        .copy_from(&((way + way.transpose()) * 0.5));
    for (j, &at) in (6..n).zip(&handed) {
        let with = by * SVector::<f64, { 2 * POSE_DIM }>::from_fn(|i, _| p.get(ends(i), at));
        covariance.fixed_view_mut::<6, 1>(0, j).copy_from(&with);
        covariance
            .fixed_view_mut::<1, 6>(j, 0)
            .copy_from(&with.transpose());
    }
    covariance
        .view_mut((6, 6), (n - 6, n - 6))
        .copy_from(&dense(&handed, &handed, |i, j| p.get(i, j)));
    Edge {
        pose,
        revised: DVector::from_iterator(was_handed.len(), was_handed.map(|i| state.x[i])),
        covariance,
    }
}

/// A landmark's point from the camera, and its derivatives by the camera's pose and by the feature.
struct VisibleLandmark {
    id: u64,
    rows: ToldRows<FEATURE_DIM>,
    point: Vector3<f64>,
    by_pose: SMatrix<f64, 3, POSE_DIM>,
    by_feature: SMatrix<f64, 3, FEATURE_DIM>,
    /// Covariance of the camera's pose with the feature.
    to_feature: SMatrix<f64, POSE_DIM, FEATURE_DIM>,
    /// Covariance of the point with the camera's pose.
    with_pose: SMatrix<f64, 3, POSE_DIM>,
}

impl VisibleLandmark {
    /// `None` of a feature whose range is hardly known; `camera_covariance` is that of the camera's pose.
    fn of(
        state: &State,
        block: &Block,
        camera_covariance: &SMatrix<f64, POSE_DIM, POSE_DIM>,
    ) -> Option<Self> {
        let (camera, feature) = (state.camera_pose(), state.feature(block));
        let ray = feature.point()? - camera.r;
        let r_cw = quat::rotation(&camera.q).transpose();
        let mut by_pose = SMatrix::<f64, 3, POSE_DIM>::zeros();
        by_pose.fixed_view_mut::<3, 3>(0, 0).copy_from(&-r_cw);
        by_pose
            .fixed_view_mut::<3, 4>(0, 3)
            .copy_from(&quat::rotate_inverse_jacobian(&camera.q, &ray));
        let by_feature = r_cw * feature.point_jacobian();
        let to_feature = state.told().block::<POSE_DIM, FEATURE_DIM>(0, block.offset);
        let seen = Self {
            id: block.id,
            rows: state.told().rows(block.offset),
            point: r_cw * ray,
            by_pose,
            by_feature,
            to_feature,
            with_pose: by_pose * camera_covariance + by_feature * to_feature.transpose(),
        };
        let p = seen.with(state, &seen);
        let variance = (seen.point.transpose() * p * seen.point)[(0, 0)].max(0.0);
        (variance.sqrt() < MAX_RANGE_RATIO * ray.norm_squared()).then_some(seen)
    }

    /// Covariance with another one.
    fn with(&self, state: &State, other: &Self) -> SMatrix<f64, 3, 3> {
        let own = state.told().between(&self.rows, &other.rows);
        self.with_pose * other.by_pose.transpose()
            + (self.by_pose * other.to_feature + self.by_feature * own)
                * other.by_feature.transpose()
    }
}

/// Takes down the landmarks among `seen`, and their covariance with the numbers at `transferred`.
fn take_down(state: &State, seen: &[u64], transferred: &[usize], submap: &mut Submap) {
    let blocks = seen.iter().filter_map(|&id| state.layout.find(id));
    let camera = state.told().block::<POSE_DIM, POSE_DIM>(0, 0);
    let landmarks: Vec<VisibleLandmark> = blocks
        .filter_map(|b| VisibleLandmark::of(state, b, &camera))
        .collect();
    let n = landmarks.len();
    submap.ids = landmarks.iter().map(|l| l.id).collect();
    submap.points = landmarks.iter().map(|l| l.point).collect();
    submap.covariance = DMatrix::zeros(3 * n, 3 * n);
    submap.with_transferred = DMatrix::zeros(3 * n, transferred.len());
    let p = state.told();
    for (i, one) in landmarks.iter().enumerate() {
        for (j, other) in landmarks.iter().enumerate().take(i + 1) {
            let mut block = one.with(state, other);
            if i == j {
                block = (block + block.transpose()) * 0.5;
            }
            submap
                .covariance
                .fixed_view_mut::<3, 3>(3 * i, 3 * j)
                .copy_from(&block);
            submap
                .covariance
                .fixed_view_mut::<3, 3>(3 * j, 3 * i)
                .copy_from(&block.transpose());
        }
        for (c, &at) in transferred.iter().enumerate() {
            let feature = SVector::<f64, FEATURE_DIM>::from_fn(|r, _| p.get(one.rows.from + r, at));
            let pose = SVector::<f64, POSE_DIM>::from_fn(|r, _| p.get(r, at));
            submap
                .with_transferred
                .fixed_view_mut::<3, 1>(3 * i, c)
                .copy_from(&(one.by_pose * pose + one.by_feature * feature));
        }
    }
}
