//! What a map transfers to the landmarks that grow on it (METHOD 20).
//!
//! Innovations that are larger than a patch's own noise come from what the model does not have: calibration, shutter,
//! patches that change. Such errors are shared by all that is in view, so that new landmarks stand beside old ones less
//! exactly than the noise of their pixels, averaged, would say. Where the view has moved on and new ones have come in, the
//! camera and all that is in view drift against what is out of view, by a small random motion.

use crate::camera::Camera;
use crate::filter::ekf::Filter;
use crate::filter::memory::map_transfer::LastTransfer;
use crate::gauge::DriftNoise;
use crate::math::quat;
use crate::nis_accumulator::NisAccumulator;
use crate::observe::point::CameraPose;
use crate::state::State;

/// Variance of a patch's pixel where camera and scene are as the model says, px^2: what images that were rendered without
/// any error leave (0.12 to 0.14).
const PATCH_VARIANCE: f64 = 0.14;

/// Share of the view that must be a new one before the map transfers: less is how a hand trembles.
const STEP: f64 = 0.1;

impl Filter {
    /// The map drift noise for what has been born since the view was another one.
    pub(crate) fn add_map_drift(&mut self, pose: &CameraPose) {
        let followed = self.memory.followed.ids();
        let Some(range) = mean_range(&self.memory.state, followed) else {
            return;
        };
        let now = LastTransfer {
            until: self.memory.state.layout.next_id(),
            pose: *pose,
            nis: self.memory.nis,
        };
        let Some(last) = self.memory.map_transfer.last else {
            self.memory.map_transfer.last = Some(now);
            return;
        };
        let moved = view_change(&self.setup.camera, &last.pose, pose, range);
        if moved < STEP {
            return;
        }
        self.memory.map_transfer.last = Some(now);
        let born = followed.len() - followed.partition_point(|&id| id < last.until);
        let share = moved.min(born as f64 / followed.len() as f64);
        let angle = self.shared_error(&self.memory.nis.since(&last.nis)) * share.sqrt();
        if angle > 0.0 {
            let noise = DriftNoise {
                turn: angle,
                translation: angle * range,
                scale: angle,
            };
            let (state, known) = (&self.memory.state, self.memory.map_transfer.known);
            let gauge = &mut self.workspace.gauge;
            let modes = gauge.drift_noise(state, &noise, followed, known);
            self.memory.add_error_modes(modes);
        }
    }

    /// Standard deviation of the map drift while all that is in view is exchanged once, radians, by the innovations of some updates.
    pub(super) fn shared_error(&self, of: &NisAccumulator) -> f64 {
        let variance = self.setup.settings.pixel.sigma_cs.powi(2) * of.share() - PATCH_VARIANCE;
        let focal = (self.setup.camera.fx * self.setup.camera.fy).sqrt();
        self.setup.settings.process.map_drift * variance.max(0.0).sqrt() / focal
    }
}

/// How far the view has moved on, in widths of the image: by the camera's turn, and by its way past things at this range,
/// metres.
fn view_change(camera: &Camera, from: &CameraPose, to: &CameraPose, range: f64) -> f64 {
    let between = quat::rotation(&from.q).transpose() * quat::rotation(&to.q);
    let turn = ((between.trace() - 1.0) * 0.5).clamp(-1.0, 1.0).acos();
    let way = (to.r - from.r).norm() / range;
    let width = 2.0 * (0.5 * f64::from(camera.width) / camera.fx).atan();
    (turn + way) / width
}

/// Geometric mean of the distances from the camera, metres; `None` where nothing has a depth.
fn mean_range(state: &State, among: &[u64]) -> Option<f64> {
    let camera = state.camera_pose().r;
    let (mut sum, mut count) = (0.0, 0.0);
    for block in state.layout.features() {
        if among.binary_search(&block.id).is_ok()
            && let Some(point) = state.feature(block).point()
        {
            sum += (point - camera).norm().ln();
            count += 1.0;
        }
    }
    (count > 0.0).then(|| (sum / count).exp())
}
