//! The shutter of Cs as the filter has it: its readout, and pixels as they would be if it did not roll (METHOD 4).

use crate::filter::ekf::Filter;
use crate::observe::Shutter;
use crate::observe::shutter::{MOTION_DIM, Unrolled};
use crate::state::Learned;
use nalgebra::{SMatrix, Vector2};

impl Filter {
    /// Time from the first row of an image of Cs to the last one as far as the filter knows, and the standard deviation of that,
    /// seconds; `None` for a shutter that is known not to roll (METHOD 4).
    pub fn readout(&self) -> Option<(f64, f64)> {
        let at = self.memory.state.readout_block()?.offset;
        Some((
            self.memory.state.x[at],
            self.memory.state.p.get(at, at).max(0.0).sqrt(),
        ))
    }

    /// The present motion under the shutter; `None` where it is known not to roll. So it is where nothing is told of it and the
    /// motion is that of wheels: when they slip, what such a motion may bend in an image would explain a part of it.
    pub(crate) fn shutter(&self) -> Option<Shutter> {
        if self.memory.wheels.followed && !self.setup.settings.calibration.is_readout_told() {
            return None;
        }
        let offset = self.memory.state.readout_block()?.offset;
        Some(Shutter {
            offset,
            readout: self.memory.state.x[offset],
            height: f64::from(self.setup.camera.height),
            velocity: self.memory.state.velocity(),
            turning: self.memory.state.angular_velocity(),
            is_speed_known: !self.workspace.found_again,
        })
    }

    /// Has the update at hand take a readout of which nothing is told to the end of its range at most: from there on it is
    /// considered, and what its images cannot owe to it moves the camera.
    pub(crate) fn keep_readout_possible(&self, learned: &mut Learned) {
        let state = &self.memory.state;
        let possible = self.setup.settings.calibration.possible_readouts();
        let Some(((least, most), block)) = possible.zip(state.readout_block()) else {
            return;
        };
        let slot = state.p.stored().slots[block.offset];
        let (now, moved) = (state.x[block.offset], self.workspace.batch.moved_at(slot));
        let left = if moved < 0.0 { least - now } else { most - now };
        if moved.abs() > left.abs() {
            learned.share(block.offset, left / moved);
        }
    }

    /// A pixel of the present view without the shutter's rolling; `rho` is the inverse range of its point, 1/m.
    pub(crate) fn unrolled(&self, uv: &Vector2<f64>, rho: f64) -> Unrolled {
        let q = self.memory.state.camera_pose().q;
        let shutter = self.shutter();
        let unrolled = shutter.and_then(|it| it.unrolled(&self.setup.camera, &q, uv, rho));
        unrolled.unwrap_or_else(|| Unrolled::as_seen(uv))
    }

    /// Pixels by which a pixel of the present view moves with each second of readout: by the camera's turning, and by its way
    /// for each 1/m of the point's inverse range.
    pub(crate) fn roll(&self, uv: &Vector2<f64>) -> SMatrix<f64, 2, 2> {
        let by_readout = |rho| {
            let by = self.unrolled(uv, rho).by_motion;
            by.map_or(Vector2::zeros(), |(_, by)| {
                by.column(MOTION_DIM - 1).into_owned()
            })
        };
        let turning = by_readout(0.0);
        SMatrix::from_columns(&[turning, by_readout(1.0) - turning])
    }
}
