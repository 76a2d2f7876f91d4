//! The map: its upkeep, its working set, its landmarks, and a camera that is lost in it (METHOD 7, 19, 20, 25).

pub(super) mod carried_velocity;
pub(super) mod known_map;
pub(super) mod landmarks;
pub(super) mod map_drift;
pub(super) mod relocalisation;
pub(super) mod restart;
pub(super) mod scale;
pub(super) mod submap;
pub(super) mod upkeep;
pub(super) mod working_set;
