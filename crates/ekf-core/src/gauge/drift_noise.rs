//! A small random motion of the camera and what it sees, against the rest of the map (METHOD 20).

use super::directions::{SCALE, directions};
use super::{Gauge, carried_blocks, refill};
use crate::state::{Block, BlockKind, CAMERA_DIM, State};
use nalgebra::Vector3;

/// Three turns, three translations and the scale.
const MOTIONS: usize = 7;
const TRANSLATION: usize = 4;

/// Standard deviations of a small random motion about the camera, the same along every axis.
#[derive(Clone, Copy, Debug)]
pub(crate) struct DriftNoise {
    /// Radians.
    pub(crate) turn: f64,
    /// Metres.
    pub(crate) translation: f64,
    /// Of the logarithm of the scale.
    pub(crate) scale: f64,
}

impl Gauge {
    /// Error modes of map drift noise of the camera, its clones and the features `followed` that were born with the id `free` or a
    /// later one; where a submap began is out of view. What they are to each other is as certain as before.
    pub(crate) fn drift_noise(
        &mut self,
        state: &State,
        noise: &DriftNoise,
        followed: &[u64],
        free: u64,
    ) -> &[f64] {
        let (n, rows) = (state.p.stored().n, state.x.len());
        directions(&state.x, &state.layout, &mut self.from);
        self.from.resize(MOTIONS * rows, 0.0);
        let moved = |block: &Block| match block.kind {
            BlockKind::Feature => block.id >= free,
            BlockKind::Submap(_) => false,
            _ => true,
        };
        let blocks = carried_blocks(&state.layout, followed).filter(|b| moved(b));
        let carried: Vec<&Block> = blocks.collect();
        for block in &carried {
            for k in 0..3 {
                // Anchor, or the position of a clone.
                self.from[(TRANSLATION + k) * rows + block.offset + k] = 1.0;
            }
        }
        for k in 0..3 {
            self.from[(TRANSLATION + k) * rows + k] = 1.0;
        }
        let sds = [noise.turn, noise.turn, noise.turn, noise.scale];
        let camera = state.camera_pose().r;
        // About the camera, in place of the origin of W.
        let arms = [
            -Vector3::x().cross(&camera),
            -Vector3::y().cross(&camera),
            -Vector3::z().cross(&camera),
            -camera,
        ];
        refill(&mut self.stored, MOTIONS * n);
        let slots = state.p.stored().slots;
        for i in (0..CAMERA_DIM).chain(carried.iter().flat_map(|b| b.range())) {
            let slot = slots[i];
            let shift: [f64; 3] = std::array::from_fn(|k| self.from[(TRANSLATION + k) * rows + i]);
            for k in 0..=SCALE {
                let arm: f64 = (0..3).map(|c| shift[c] * arms[k][c]).sum();
                self.stored[k * n + slot] = sds[k] * (self.from[k * rows + i] + arm);
            }
            for (k, shift) in shift.iter().enumerate() {
                self.stored[(TRANSLATION + k) * n + slot] = noise.translation * shift;
            }
        }
        &self.stored
    }
}
