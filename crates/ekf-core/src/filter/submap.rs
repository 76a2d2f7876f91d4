//! Submaps: what the filter knows about a stretch of the way by itself, taken out of it (METHOD 25).
//!
//! The pose at which a submap begins stays in the state as a clone, and beside it what the submap before handed on: by how
//! much the scale and the bias of T_CF were estimated wrongly there. At the end, the way from the one pose to the other is
//! read off with its covariance, the landmarks in view are taken down as they stand to the camera, and the next submap begins.
//! No estimate changes.

use super::ekf::Filter;
use crate::error::EkfError;
use crate::graph::{Edge, HANDED_ON};
use crate::math::pose::{Pose, tangent_map};
use crate::math::quat;
use crate::observe::POSE_DIM;
use crate::scale::by_state;
use crate::state::{Block, BlockKind, LinearPart, SUBMAP_DIM, State};
use nalgebra::{DMatrix, Matrix6, SMatrix, SVector, Vector3};

/// Largest relative error of a landmark's range with which it is taken down.
const MAX_RANGE_RATIO: f64 = 0.3;

/// The worn camera whose bias is handed on; that of others counts by what it did to the scale.
const FIRST: usize = 0;

/// A submap that has ended.
#[derive(Clone, Debug)]
pub struct Submap {
    /// The way since the last one ended; `None` of the first one in a map.
    pub edge: Option<Edge>,
    /// `T_WC` where it ended.
    pub pose: Pose,
    /// Its covariance, right tangent.
    pub pose_covariance: Matrix6<f64>,
    /// Covariance of what it hands on: the scale's logarithm, and the bias of T_CF.
    pub handed_on: SMatrix<f64, HANDED_ON, HANDED_ON>,
    /// Landmarks in view.
    pub ids: Vec<u64>,
    /// Their points from the camera, metres.
    pub points: Vec<Vector3<f64>>,
    /// Their joint covariance as they stand to the camera, `3n x 3n`, m^2.
    pub covariance: DMatrix<f64>,
    /// Covariance of the points with what is handed on, `3n x 7`.
    pub with_handed_on: DMatrix<f64>,
    /// Standard deviation of a slip while all that is in view is exchanged once (METHOD 20), radians.
    pub slip: f64,
}

impl Filter {
    /// Ends the present submap and begins the next one; `seen` are the features measured in this frame, of which those with a
    /// good depth are taken down.
    ///
    /// # Errors
    /// `InvalidInput` before the start, `UnknownFeature`; the filter stays as it was.
    pub fn end_submap(&mut self, seen: &[u64]) -> Result<Submap, EkfError> {
        self.check_started()?;
        for &id in seen {
            self.known(id)?;
        }
        self.changes();
        let then = self.begun();
        let now = self.begin_submap();
        let (rotation, translation) = self.pose();
        let handed_on = now.offset + POSE_DIM;
        let mut submap = Submap {
            edge: then.map(|then| edge(&self.state, &then, Some(handed_on))),
            pose: Pose {
                rotation,
                translation,
            },
            pose_covariance: self.pose_covariance(),
            handed_on: self.state.p.block(handed_on, handed_on),
            ids: Vec::new(),
            points: Vec::new(),
            covariance: DMatrix::zeros(0, 0),
            with_handed_on: DMatrix::zeros(0, 0),
            slip: self.shared_error(),
        };
        take_down(&self.state, seen, handed_on, &mut submap);
        if let Some(then) = then {
            self.state.remove(|b| b.id == then.id);
        }
        Ok(submap)
    }

    /// The way since the last submap ended, with the covariance of the pose and of what that submap handed on; zeros stand for what
    /// the present one will. `None` where none has ended in this map.
    pub fn since_submap(&self) -> Option<Edge> {
        self.begun().map(|then| edge(&self.state, &then, None))
    }

    /// Where the present submap began.
    fn begun(&self) -> Option<Block> {
        let mut blocks = self.state.layout.of_kind(BlockKind::Submap);
        blocks.next().copied()
    }

    /// Appends the present pose, and the present errors of the scale and of T_CF's bias, O(n).
    fn begin_submap(&mut self) -> Block {
        let state = &self.state;
        let mut by_pose = vec![0.0; SUBMAP_DIM * POSE_DIM];
        for k in 0..POSE_DIM {
            by_pose[SUBMAP_DIM * k + k] = 1.0;
        }
        let mut parts = vec![(0, POSE_DIM, by_pose)];
        if let Some(b) = by_state(state) {
            let stretches = state.layout.features().map(Block::range);
            for stretch in std::iter::once(0..3).chain(stretches) {
                let mut matrix = vec![0.0; SUBMAP_DIM * stretch.len()];
                for (column, i) in matrix.chunks_exact_mut(SUBMAP_DIM).zip(stretch.clone()) {
                    column[POSE_DIM] = b[i];
                }
                parts.push((stretch.start, stretch.len(), matrix));
            }
        }
        for (offset, by) in state.lasting_error(FIRST) {
            let mut matrix = vec![0.0; SUBMAP_DIM * 6];
            for (column, by) in matrix.chunks_exact_mut(SUBMAP_DIM).zip(by.column_iter()) {
                column[POSE_DIM + 1..].copy_from_slice(by.as_slice());
            }
            parts.push((offset, 6, matrix));
        }
        let parts: Vec<LinearPart<'_>> = parts
            .iter()
            .map(|(offset, width, matrix)| LinearPart {
                offset: *offset,
                width: *width,
                matrix,
            })
            .collect();
        let mut mean = SVector::<f64, SUBMAP_DIM>::zeros();
        mean.fixed_rows_mut::<POSE_DIM>(0)
            .copy_from(&self.state.part::<POSE_DIM>(0));
        self.state
            .append::<SUBMAP_DIM>(BlockKind::Submap, &mean, &parts, &SMatrix::zeros())
    }
}

/// The way from where a submap began to the camera; `handed_on` is where the numbers are that the present one hands on.
fn edge(state: &State, then: &Block, handed_on: Option<usize>) -> Edge {
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
    let mut by = SMatrix::<f64, { 6 + 2 * HANDED_ON }, { 4 * POSE_DIM }>::zeros();
    by.fixed_view_mut::<6, POSE_DIM>(0, 0)
        .copy_from(&(by_first * tangent_map(&from.q)));
    by.fixed_view_mut::<6, POSE_DIM>(0, POSE_DIM)
        .copy_from(&tangent_map(&to.q));
    by.fixed_view_mut::<{ 2 * HANDED_ON }, { 2 * HANDED_ON }>(6, 2 * POSE_DIM)
        .fill_with_identity();
    let starts = [
        Some(then.offset),
        Some(0),
        Some(then.offset + POSE_DIM),
        handed_on,
    ];
    let row = |k: usize| starts[k / POSE_DIM].map(|start| start + k % POSE_DIM);
    let entry = |i, j| match (row(i), row(j)) {
        (Some(i), Some(j)) => state.p.get(i, j),
        _ => 0.0,
    };
    let joint = SMatrix::<f64, { 4 * POSE_DIM }, { 4 * POSE_DIM }>::from_fn(entry);
    let covariance = by * joint * by.transpose();
    Edge {
        pose,
        revised: state.part::<HANDED_ON>(then.offset + POSE_DIM),
        covariance: (covariance + covariance.transpose()) * 0.5,
    }
}

/// A landmark's point from the camera, and its derivatives by the camera's pose and by the feature.
struct Seen {
    id: u64,
    offset: usize,
    width: usize,
    point: Vector3<f64>,
    by_pose: SMatrix<f64, 3, POSE_DIM>,
    by_feature: SMatrix<f64, 3, 6>,
}

impl Seen {
    /// `None` of a feature whose range is hardly known.
    fn of(state: &State, block: &Block) -> Option<Self> {
        let (camera, feature) = (state.camera_pose(), state.feature(block));
        let ray = feature.point()? - camera.r;
        let r_cw = quat::rotation(&camera.q).transpose();
        let mut by_pose = SMatrix::<f64, 3, POSE_DIM>::zeros();
        by_pose.fixed_view_mut::<3, 3>(0, 0).copy_from(&-r_cw);
        by_pose
            .fixed_view_mut::<3, 4>(0, 3)
            .copy_from(&quat::rotate_inverse_jacobian(&camera.q, &ray));
        let seen = Self {
            id: block.id,
            offset: block.offset,
            width: block.kind.dim(),
            point: r_cw * ray,
            by_pose,
            by_feature: r_cw * feature.point_jacobian(),
        };
        let p = seen.with(state, &seen);
        let variance = (seen.point.transpose() * p * seen.point)[(0, 0)].max(0.0);
        (variance.sqrt() < MAX_RANGE_RATIO * ray.norm_squared()).then_some(seen)
    }

    /// Covariance with another one.
    fn with(&self, state: &State, other: &Self) -> SMatrix<f64, 3, 3> {
        let p = &state.p;
        let to_feature = |seen: &Self| {
            SMatrix::<f64, POSE_DIM, 6>::from_fn(|i, j| {
                if j < seen.width {
                    p.get(i, seen.offset + j)
                } else {
                    0.0
                }
            })
        };
        let own = SMatrix::<f64, 6, 6>::from_fn(|i, j| {
            if i < self.width && j < other.width {
                p.get(self.offset + i, other.offset + j)
            } else {
                0.0
            }
        });
        let camera = p.block::<POSE_DIM, POSE_DIM>(0, 0);
        (self.by_pose * camera + self.by_feature * to_feature(self).transpose())
            * other.by_pose.transpose()
            + (self.by_pose * to_feature(other) + self.by_feature * own)
                * other.by_feature.transpose()
    }
}

/// Takes down the landmarks among `seen`, and their covariance with the seven numbers at `handed_on`.
fn take_down(state: &State, seen: &[u64], handed_on: usize, submap: &mut Submap) {
    let blocks = seen.iter().filter_map(|&id| state.layout.find(id));
    let landmarks: Vec<Seen> = blocks.filter_map(|b| Seen::of(state, b)).collect();
    let n = landmarks.len();
    submap.ids = landmarks.iter().map(|l| l.id).collect();
    submap.points = landmarks.iter().map(|l| l.point).collect();
    submap.covariance = DMatrix::zeros(3 * n, 3 * n);
    submap.with_handed_on = DMatrix::zeros(3 * n, HANDED_ON);
    let p = &state.p;
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
        let feature = SMatrix::<f64, 6, HANDED_ON>::from_fn(|r, c| {
            if r < one.width {
                p.get(one.offset + r, handed_on + c)
            } else {
                0.0
            }
        });
        let with =
            one.by_pose * p.block::<POSE_DIM, HANDED_ON>(0, handed_on) + one.by_feature * feature;
        submap
            .with_handed_on
            .fixed_view_mut::<3, HANDED_ON>(3 * i, 0)
            .copy_from(&with);
    }
}
