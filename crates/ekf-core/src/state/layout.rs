//! The only owner of offsets: which block of the state lives where.

use crate::observe::{FEATURE_DIM, FeatureState, POSE_DIM};
use nalgebra::Vector6;
use serde::{Deserialize, Serialize};

/// Dimension of the camera's block `[r(3) q(4) v(3) w(3)]` (METHOD 2).
pub const CAMERA_DIM: usize = 13;

/// Numbers that a submap transfers with this many worn cameras: the logarithm of the scale, and the time-correlated error of each one's
/// T_CF, metres and radians along the axes of C.
pub const fn transferred_dim(worn_cameras: usize) -> usize {
    1 + 6 * worn_cameras
}

/// Whose error of T_CF a block of the state is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum ErrorOwner {
    /// The part that all worn cameras have in common (`worn.common_share`), in standard deviations.
    Common,
    /// Of the worn camera with this number.
    Of(usize),
}

/// What a block of the state is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum BlockKind {
    /// A landmark in inverse depth, 6 numbers.
    Feature,
    /// A camera pose kept for the exact delayed birth, `[r(3) q(4)]`.
    Clone,
    /// The slowly varying error of a worn camera's pose, along the axes of C, 6 numbers.
    WornBias(ErrorOwner),
    /// The error of Cs's calibration, 6 numbers of a warp of its image.
    Calibration,
    /// Time from the first row of an image of Cs to the last one, seconds, 1 number.
    Readout,
    /// By how much a worn camera's images were taken after their stamps, by the clock of Cs, seconds, 1 number.
    WornClock(usize),
    /// The logarithm of a worn camera's lengths, as they were told over as they are, 1 number.
    WornLength(usize),
    /// The errors of the odometry's scales, of translation and of turns, relative, 2 numbers.
    OdometryScale,
    /// The gyroscope's bias, along its axes, rad/s, 3 numbers.
    GyroBias,
    /// The errors of the gyroscope's scale, relative, and of its mounting, a small rotation along the axes of C, 4 numbers.
    GyroFrame,
    /// By how much the gyroscope's stamps are to be raised to be those of Cs, seconds, 1 number.
    GyroClock,
    /// The error of one frame's T_CF, tangent, 6 numbers; lives for that frame only.
    WornError(ErrorOwner),
    /// By how much a worn camera moves while one image of it is read, from the first row to the last, tangent, 6 numbers; stands
    /// right after the error of that view's T_CF and lives as long.
    WornRoll(usize),
    /// Where the present submap began: the camera's pose there `[r(3) q(4)]`, and by how much what it transfers was estimated
    /// wrongly, that many numbers.
    Submap(usize),
    /// Error modes, that many: what they do to the rest of the state stands as their covariances with it; only the filter
    /// itself has them, never the state that is shown.
    ErrorModes(usize),
    /// Auxiliary rows of the local update; only a working state has them, never the state that is shown.
    Auxiliary(usize),
}

/// What of a block a motion of W moves.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum InWorld {
    /// A landmark in inverse depth.
    Landmark,
    /// The pose that it begins with.
    Pose,
    /// Nothing.
    Nowhere,
}

impl BlockKind {
    /// Number of state entries.
    pub const fn dim(self) -> usize {
        match self {
            Self::Clone => POSE_DIM,
            Self::Submap(transferred) => POSE_DIM.saturating_add(transferred),
            Self::Auxiliary(rows) | Self::ErrorModes(rows) => rows,
            Self::Feature => FEATURE_DIM,
            Self::Readout | Self::WornClock(_) | Self::WornLength(_) | Self::GyroClock => 1,
            Self::OdometryScale => 2,
            Self::GyroBias => 3,
            Self::GyroFrame => 4,
            Self::WornBias(_) | Self::Calibration | Self::WornError(_) | Self::WornRoll(_) => 6,
        }
    }

    /// Whether it is a landmark.
    pub const fn is_feature(self) -> bool {
        matches!(self, Self::Feature)
    }

    /// Where its numbers are in W.
    pub(crate) const fn in_world(self) -> InWorld {
        match self {
            Self::Feature => InWorld::Landmark,
            Self::Clone | Self::Submap(_) => InWorld::Pose,
            // T_CF is metric and seen from C; auxiliary rows come with a working set only.
            Self::WornBias(_)
            | Self::Calibration
            | Self::Readout
            | Self::WornClock(_)
            | Self::WornLength(_)
            | Self::OdometryScale
            | Self::GyroBias
            | Self::GyroFrame
            | Self::GyroClock
            | Self::WornError(_)
            | Self::WornRoll(_)
            | Self::ErrorModes(_)
            | Self::Auxiliary(_) => InWorld::Nowhere,
        }
    }

    /// Whether it is of a device, not of a map or of a frame: what is known of it outlives both.
    pub(crate) const fn is_of_device(self) -> bool {
        matches!(
            self,
            Self::WornBias(_)
                | Self::Calibration
                | Self::Readout
                | Self::WornClock(_)
                | Self::WornLength(_)
                | Self::OdometryScale
                | Self::GyroBias
                | Self::GyroFrame
                | Self::GyroClock
        )
    }

    /// Whether it is considered, not estimated, but for what an update may learn of it.
    pub(crate) const fn is_considered(self) -> bool {
        matches!(
            self,
            Self::WornBias(_)
                | Self::Calibration
                | Self::WornClock(_)
                | Self::WornLength(_)
                | Self::GyroFrame
                | Self::GyroClock
        )
    }

    /// Its name.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Feature => "Feature",
            Self::Clone => "Clone",
            Self::WornBias(_) => "WornBias",
            Self::Calibration => "Calibration",
            Self::Readout => "Readout",
            Self::WornClock(_) => "WornClock",
            Self::WornLength(_) => "WornLength",
            Self::OdometryScale => "OdometryScale",
            Self::GyroBias => "GyroBias",
            Self::GyroFrame => "GyroFrame",
            Self::GyroClock => "GyroClock",
            Self::WornError(_) => "WornError",
            Self::WornRoll(_) => "WornRoll",
            Self::Submap(_) => "Submap",
            Self::Auxiliary(_) => "Auxiliary",
            Self::ErrorModes(_) => "ErrorModes",
        }
    }
}

/// One block of the state after the camera.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Block {
    /// Unique for the life of the filter.
    pub id: u64,
    /// What it is.
    pub kind: BlockKind,
    /// First state index.
    pub offset: usize,
}

impl Block {
    /// State indices of the block.
    pub fn range(&self) -> std::ops::Range<usize> {
        self.offset..self.offset + self.kind.dim()
    }

    /// The landmark that it is, with the numbers of a mean.
    ///
    /// # Panics
    /// If it is none.
    pub fn feature(&self, mean: &[f64]) -> FeatureState {
        assert!(
            self.kind.is_feature(),
            "block {} is not a landmark",
            self.id
        );
        FeatureState(Vector6::from_column_slice(&mean[self.range()]))
    }
}

/// The order of blocks. Ids grow with birth and blocks keep their order, so a look-up is a binary search; only in the
/// working state of the local update they come and go as the camera looks about.
#[derive(Clone, Debug, Default)]
pub struct Layout {
    blocks: Vec<Block>,
    shuffled: bool,
    next_id: u64,
}

impl Layout {
    /// Dimension of the whole state.
    pub fn dim(&self) -> usize {
        self.blocks.last().map_or(CAMERA_DIM, |b| b.range().end)
    }

    /// All blocks in state order.
    pub fn blocks(&self) -> &[Block] {
        &self.blocks
    }

    /// The blocks of one kind, in state order.
    pub fn of_kind(&self, kind: BlockKind) -> impl Iterator<Item = &Block> {
        self.blocks.iter().filter(move |b| b.kind == kind)
    }

    /// Where the present submap began, and how many numbers were transferred there.
    pub(crate) fn submap(&self) -> Option<(Block, usize)> {
        self.blocks.iter().find_map(|b| match b.kind {
            BlockKind::Submap(transferred) => Some((*b, transferred)),
            _ => None,
        })
    }

    /// The landmarks, in state order.
    pub fn features(&self) -> impl Iterator<Item = &Block> {
        self.blocks.iter().filter(|b| b.kind.is_feature())
    }

    /// The block with this id.
    pub fn find(&self, id: u64) -> Option<&Block> {
        if self.shuffled {
            return self.blocks.iter().find(|b| b.id == id);
        }
        self.blocks
            .binary_search_by_key(&id, |b| b.id)
            .ok()
            .map(|i| &self.blocks[i])
    }

    /// Without blocks; ids go on.
    pub(crate) fn emptied(&self) -> Self {
        Self {
            next_id: self.next_id,
            ..Self::default()
        }
    }

    /// The id that the next block will have.
    pub(crate) fn next_id(&self) -> u64 {
        self.next_id
    }

    /// Lets ids go on from here.
    pub(crate) fn set_next_id(&mut self, id: u64) {
        self.next_id = id;
    }

    /// Appends a block that has an id.
    pub(crate) fn insert(&mut self, kind: BlockKind, id: u64) {
        let offset = self.dim();
        self.shuffled |= self.blocks.last().is_some_and(|b| b.id >= id);
        self.blocks.push(Block { id, kind, offset });
    }

    /// Appends a block at the end of the state.
    pub(crate) fn push(&mut self, kind: BlockKind) -> Block {
        let block = Block {
            id: self.next_id,
            kind,
            offset: self.dim(),
        };
        self.next_id += 1;
        self.shuffled |= self.blocks.last().is_some_and(|b| b.id >= block.id);
        self.blocks.push(block);
        block
    }

    /// Removes the blocks for which `gone` holds and closes the gaps.
    pub(crate) fn remove(&mut self, gone: impl Fn(&Block) -> bool) {
        self.blocks.retain(|b| !gone(b));
        let mut offset = CAMERA_DIM;
        for b in &mut self.blocks {
            b.offset = offset;
            offset += b.kind.dim();
        }
    }
}
