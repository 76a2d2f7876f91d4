//! The state vector, its layout and its covariance.
//!
//! ```text
//! x = [ r(3) q(4) v(3) w(3) | bias(6) ... | readout(1)? | clock(1) ... | odometry scale(2)? | gyroscope(3 + 4 + 1)? | feature(6) ... | clone(7) ... | submap(8 + 6 n)? | worn error(6) ... ]
//!       camera, always 13     blocks in order of birth, each with an id
//! ```

mod considered;
pub mod cov;
mod error_modes;
mod image;
pub mod layout;
mod readout;
mod time_correlated;
mod worn_clock;

pub(crate) use considered::{Considered, Learned};
pub(crate) use cov::Rest;
pub use cov::{Covariance, LinearPart};
pub(crate) use error_modes::ToldRows;
pub(crate) use image::StateImage;
pub(crate) use layout::InWorld;
pub use layout::{Block, BlockKind, CAMERA_DIM, ErrorOwner, Layout, transferred_dim};
pub(crate) use time_correlated::{TimeCorrelatedBias, root};
pub(crate) use worn_clock::ToldOfClock;

use crate::math::quat;
use crate::observe::point::CameraPose;
use crate::observe::{FeatureState, POSE_DIM};
use nalgebra::allocator::Allocator;
use nalgebra::{
    DefaultAllocator, Dim, OMatrix, OVector, SMatrix, SVector, Vector3, Vector4, Vector6,
};
use std::ops::Range;

/// Mean, covariance and layout, always of the same dimension.
#[derive(Clone, Debug)]
pub struct State {
    /// The mean.
    pub(crate) x: Vec<f64>,
    /// The covariance.
    pub(crate) p: Covariance,
    /// The mean at which P holds the gauge's direction, row by row, see [`gauge`](crate::gauge).
    pub(crate) reference: Vec<f64>,
    /// The blocks and where each of them is.
    pub(crate) layout: Layout,
    /// What lasts of the errors of the worn cameras' poses, in the order in which it came into the state.
    pub(crate) time_correlated: Vec<TimeCorrelatedBias>,
    /// What is told of the worn cameras' clocks, by their numbers; of none where they are exact.
    pub(crate) clocks: Vec<ToldOfClock>,
    /// A feature whose anchor is the camera's position now.
    newborn: Option<u64>,
}

/// Where a state stands before blocks are appended.
#[derive(Clone, Debug)]
pub(crate) struct Mark {
    dim: usize,
    next_id: u64,
    time_correlated: usize,
    newborn: Option<u64>,
}

impl Default for State {
    fn default() -> Self {
        Self::at_origin(0)
    }
}

impl State {
    /// Camera at the origin of W, at rest, without uncertainty and without map.
    pub fn at_origin(capacity: usize) -> Self {
        let mut x = vec![0.0; CAMERA_DIM];
        x[3] = 1.0;
        Self {
            reference: x.clone(),
            x,
            p: Covariance::zeros(CAMERA_DIM, capacity),
            layout: Layout::default(),
            time_correlated: Vec::new(),
            clocks: Vec::new(),
            newborn: None,
        }
    }

    /// Copies another state into the memory of this one.
    pub(crate) fn copy_from(&mut self, other: &Self) {
        let Self {
            x,
            p,
            reference,
            layout,
            time_correlated,
            clocks,
            newborn,
        } = other;
        self.x.clone_from(x);
        self.p.copy_from(p);
        self.reference.clone_from(reference);
        self.layout.clone_from(layout);
        self.time_correlated.clone_from(time_correlated);
        self.clocks.clone_from(clocks);
        self.newborn = *newborn;
    }

    /// The mean.
    pub fn mean(&self) -> &[f64] {
        &self.x
    }

    /// The covariance.
    pub fn covariance(&self) -> &Covariance {
        &self.p
    }

    /// The blocks after the camera.
    pub fn layout(&self) -> &Layout {
        &self.layout
    }

    /// `N` entries of the mean from `offset`.
    pub fn part<const N: usize>(&self, offset: usize) -> SVector<f64, N> {
        SVector::from_column_slice(&self.x[offset..offset + N])
    }

    pub(crate) fn set_part<const N: usize>(&mut self, offset: usize, value: &SVector<f64, N>) {
        self.x[offset..offset + N].copy_from_slice(value.as_slice());
    }

    /// The camera's pose.
    pub fn camera_pose(&self) -> CameraPose {
        self.pose_at(0)
    }

    /// The pose of a block `[r q]`.
    pub(crate) fn pose_at(&self, offset: usize) -> CameraPose {
        CameraPose {
            r: self.part::<3>(offset),
            q: self.part::<4>(offset + 3),
        }
    }

    /// `v_W`, m/s.
    pub fn velocity(&self) -> Vector3<f64> {
        self.part::<3>(7)
    }

    /// `w_C`, rad/s.
    pub fn angular_velocity(&self) -> Vector3<f64> {
        self.part::<3>(10)
    }

    /// The auxiliary blocks of a working state.
    pub(crate) fn auxiliary_blocks(&self) -> impl Iterator<Item = &Block> {
        let blocks = self.layout.blocks().iter();
        blocks.filter(|b| matches!(b.kind, BlockKind::Auxiliary(_)))
    }

    /// Where the rows of the present submap's beginning are stored, if there is one.
    pub(crate) fn submap_rows(&self) -> Option<Range<usize>> {
        let (block, _) = self.layout.submap()?;
        let first = self.p.stored().slots[block.offset];
        Some(first..first + block.kind.dim())
    }

    /// Where the rows of the auxiliary blocks are stored, increasing.
    pub(crate) fn auxiliary_rows(&self) -> impl Iterator<Item = Range<usize>> {
        self.auxiliary_blocks().map(|b| {
            let first = self.p.stored().slots[b.offset];
            first..first + b.kind.dim()
        })
    }

    /// The landmark of a feature's block.
    pub fn feature(&self, block: &Block) -> FeatureState {
        block.feature(&self.x)
    }

    /// Covariance of the camera's pose with a feature, and of the feature.
    pub(crate) fn feature_covariance(
        &self,
        block: &Block,
    ) -> (SMatrix<f64, 7, 6>, SMatrix<f64, 6, 6>) {
        let at = block.offset;
        (self.p.block(0, at), self.p.block(at, at))
    }

    /// Covariance of six numbers from `at` on with a feature.
    pub(crate) fn covariance_with(&self, at: usize, block: &Block) -> SMatrix<f64, 6, 6> {
        self.p.block(at, block.offset)
    }

    /// 6x6 covariance of the camera's pose, (translation, rotation), right tangent (METHOD 1).
    pub fn pose_covariance(&self) -> SMatrix<f64, 6, 6> {
        let g = crate::math::pose::tangent_map(&self.camera_pose().q);
        let p = g * self.p.block::<7, 7>(0, 0) * g.transpose();
        (p + p.transpose()) * 0.5
    }

    /// Covariance of six numbers that are linear in the state, plus noise.
    pub(crate) fn covariance_of(
        &self,
        parts: &[LinearPart<'_>],
        noise: &SMatrix<f64, 6, 6>,
    ) -> SMatrix<f64, 6, 6> {
        let column = |part: &LinearPart<'_>, k: usize| {
            Vector6::from_column_slice(&part.matrix[6 * k..6 * (k + 1)])
        };
        let mut sum = *noise;
        for a in parts {
            for b in parts {
                let mut product = SMatrix::<f64, 6, 6>::zeros();
                for j in 0..b.width {
                    let terms =
                        (0..a.width).map(|i| column(a, i) * self.p.get(a.offset + i, b.offset + j));
                    let with_a: Vector6<f64> = terms.fold(Vector6::zeros(), |sum, term| sum + term);
                    product += with_a * column(b, j).transpose();
                }
                sum += product;
            }
        }
        sum
    }

    /// Appends a block whose value is linear in the state plus noise. O(n).
    pub(crate) fn append<K: Dim>(
        &mut self,
        kind: BlockKind,
        mean: &OVector<f64, K>,
        parts: &[LinearPart<'_>],
        noise: &OMatrix<f64, K, K>,
    ) -> Block
    where
        DefaultAllocator: Allocator<K> + Allocator<K, K>,
    {
        debug_assert_eq!(kind.dim(), mean.len());
        self.p.augment(parts, noise, None);
        self.x.extend_from_slice(mean.as_slice());
        self.reference.extend_from_slice(mean.as_slice());
        self.layout.push(kind)
    }

    /// Appends a feature whose anchor is the camera's position now, which all features born now share. O(n).
    pub(crate) fn append_feature(
        &mut self,
        mean: &Vector6<f64>,
        parts: &[LinearPart<'_>],
        noise: &SMatrix<f64, 6, 6>,
    ) -> Block {
        let sharer = self.newborn.and_then(|id| self.layout.find(id));
        let anchor = sharer.map(|block| block.offset);
        debug_assert!(anchor.is_none_or(|a| self.x[a..a + 3] == mean.as_slice()[..3]));
        self.p.augment(parts, noise, anchor);
        self.x.extend_from_slice(mean.as_slice());
        self.reference.extend_from_slice(mean.as_slice());
        let block = self.layout.push(BlockKind::Feature);
        self.newborn = Some(block.id);
        block
    }

    /// Camera and ids of this state, no blocks, and a covariance of zeros whose first rows are the camera's.
    pub(crate) fn camera_alone(&self, p: Covariance) -> Self {
        Self {
            x: self.x[..CAMERA_DIM].to_vec(),
            p,
            reference: self.reference[..CAMERA_DIM].to_vec(),
            layout: self.layout.emptied(),
            time_correlated: self.time_correlated.clone(),
            clocks: self.clocks.clone(),
            newborn: self.newborn,
        }
    }

    /// Appends a block that has an id, whose rows are stored already.
    pub(crate) fn insert(
        &mut self,
        kind: BlockKind,
        id: u64,
        slots: &[usize],
        (mean, reference): (&[f64], &[f64]),
    ) {
        debug_assert!(kind.dim() == slots.len() && kind.dim() == mean.len());
        debug_assert!(mean.len() == reference.len());
        self.layout.insert(kind, id);
        self.p.place(slots);
        self.x.extend_from_slice(mean);
        self.reference.extend_from_slice(reference);
    }

    /// Records what appending blocks changes besides the end of the state, for [`Self::take_back`].
    pub(crate) fn mark(&self) -> Mark {
        Mark {
            dim: self.layout.dim(),
            next_id: self.layout.next_id(),
            time_correlated: self.time_correlated.len(),
            newborn: self.newborn,
        }
    }

    /// Removes what was appended since `mark` and frees its ids; nothing else may have changed since.
    pub(crate) fn take_back(&mut self, mark: &Mark) {
        self.remove(|b| b.offset >= mark.dim);
        self.layout.set_next_id(mark.next_id);
        self.time_correlated.truncate(mark.time_correlated);
        self.newborn = mark.newborn;
    }

    /// Appends a block whose rows are stored already; returns its id.
    pub(crate) fn push_stored(&mut self, kind: BlockKind, slots: &[usize], mean: &[f64]) -> u64 {
        debug_assert!(kind.dim() == slots.len() && kind.dim() == mean.len());
        self.p.place(slots);
        self.x.extend_from_slice(mean);
        self.reference.extend_from_slice(mean);
        self.layout.push(kind).id
    }

    /// Call it when the camera has moved or the state was corrected: the next feature born gets a new anchor.
    pub(crate) fn camera_moved(&mut self) {
        self.newborn = None;
    }

    /// Puts the camera at a pose, at rest, without uncertainty and without correlation with anything else.
    pub(crate) fn reset_camera(&mut self, pose: &CameraPose) {
        self.x[POSE_DIM..CAMERA_DIM].fill(0.0);
        self.p.clear_first(CAMERA_DIM);
        self.reset_pose(pose);
    }

    /// The same of the pose alone: the velocities stay, and what they have in common with all but the pose.
    pub(crate) fn reset_pose(&mut self, pose: &CameraPose) {
        self.set_part(0, &pose.r);
        self.set_part(3, &pose.q);
        self.reference[..CAMERA_DIM].copy_from_slice(&self.x[..CAMERA_DIM]);
        self.p.clear_first(POSE_DIM);
        self.camera_moved();
    }

    /// Second moment of the camera's speed, (m/s)^2.
    pub(crate) fn squared_speed(&self) -> f64 {
        let covariance = self.p.block::<3, 3>(POSE_DIM, POSE_DIM);
        self.velocity().norm_squared() + covariance.trace()
    }

    /// Makes a clone that of the camera's present pose: its rows of P are written over. O(n).
    pub(crate) fn clone_again(&mut self, block: &Block) {
        debug_assert!(block.kind == BlockKind::Clone);
        let at = block.offset;
        self.x.copy_within(..POSE_DIM, at);
        self.reference.copy_within(..POSE_DIM, at);
        self.p.repeat_rows(at, POSE_DIM);
    }

    /// Removes blocks in one compaction.
    pub(crate) fn remove(&mut self, gone: impl Fn(&Block) -> bool) {
        if !self.layout.blocks().iter().any(&gone) {
            return;
        }
        let mut keep: Vec<usize> = (0..CAMERA_DIM).collect();
        for block in self.layout.blocks() {
            if !gone(block) {
                keep.extend(block.range());
            }
        }
        self.p.keep(&keep);
        for (new, &old) in keep.iter().enumerate() {
            self.x[new] = self.x[old];
            self.reference[new] = self.reference[old];
        }
        self.x.truncate(keep.len());
        self.reference.truncate(keep.len());
        self.layout.remove(gone);
    }

    /// Normalises every quaternion of the state and maps P through the Jacobian (METHOD 3).
    pub(crate) fn normalise_quaternions(&mut self) {
        self.normalise_quaternion_at(3);
        for i in 0..self.layout.blocks().len() {
            let block = self.layout.blocks()[i];
            if matches!(block.kind, BlockKind::Clone | BlockKind::Submap(_)) {
                self.normalise_quaternion_at(block.offset + 3);
            }
        }
    }

    fn normalise_quaternion_at(&mut self, offset: usize) {
        let q: Vector4<f64> = self.part::<4>(offset);
        self.p.project(offset, &quat::normalise_jacobian(&q));
        self.set_part(offset, &(q / q.norm()));
    }
}
