//! The worn cameras: the error of each T_CF, views of another time, clocks, several views in a frame (METHOD 6, 21, 26).

pub(super) mod clock;
pub(super) mod error;
pub(super) mod interpolated_pose;
pub(super) mod kept_poses;
pub(super) mod later_views;
pub(super) mod length;
pub(super) mod other_time;
pub(super) mod overlapping;
pub(super) mod pose;
pub(super) mod rate;
pub(super) mod relinearised;
pub(super) mod view_planning;
