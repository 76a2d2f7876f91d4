//! The shutter of Cs as the filter has it: its readout, and pixels as they would be if it did not roll (METHOD 4).

use super::ekf::Filter;
use crate::math::quat;
use crate::observe::shutter::MOTION_DIM;
use crate::observe::{POSE_DIM, Shutter};
use nalgebra::{Matrix2, SMatrix, Vector2};

/// A pixel as it would be if all rows were taken with the middle one.
#[derive(Clone, Copy, Debug)]
pub(super) struct Unrolled {
    /// The pixel.
    pub(super) uv: Vector2<f64>,
    /// Offset of the readout, and the pixel's derivative by `[v w readout]`, where the shutter may roll.
    pub(super) by_motion: Option<(usize, SMatrix<f64, 2, MOTION_DIM>)>,
    /// Its covariance from the product of the errors of velocities and readout, px^2.
    pub(super) noise: Matrix2<f64>,
}

impl Filter {
    /// Time from the first row of an image of Cs to the last one as it is estimated, and its standard deviation, seconds; `None`
    /// for a shutter that is known not to roll.
    pub fn readout(&self) -> Option<(f64, f64)> {
        let at = self.state.readout_block()?.offset;
        Some((self.state.x[at], self.state.p.get(at, at).max(0.0).sqrt()))
    }

    /// Puts an estimate of the readout in the place of the one that there is; for a filter without map.
    pub(super) fn set_readout(&mut self, readout: Option<(f64, f64)>) {
        if let (Some(block), Some((mean, sd))) = (self.state.readout_block().copied(), readout) {
            self.state.set_part(block.offset, &SMatrix::from([[mean]]));
            self.state.reference[block.offset] = mean;
            self.state.p.set(block.offset, block.offset, sd * sd);
        }
    }

    /// The present motion under the shutter; `None` where it is known not to roll.
    pub(super) fn shutter(&self) -> Option<Shutter> {
        let offset = self.state.readout_block()?.offset;
        Some(Shutter {
            offset,
            readout: self.state.x[offset],
            height: f64::from(self.camera.height),
            velocity: self.state.velocity(),
            turning: self.state.angular_velocity(),
            spread: self.state.p.block::<6, 6>(POSE_DIM, POSE_DIM)
                * self.state.p.get(offset, offset),
        })
    }

    /// A pixel of the present view without the shutter's rolling; `rho` is the inverse range of its point, 1/m.
    pub(super) fn unrolled(&self, uv: &Vector2<f64>, rho: f64) -> Unrolled {
        let r_wc = quat::rotation(&self.state.camera_pose().q);
        let moved = self.shutter().and_then(|shutter| {
            let (uv, by, noise) = shutter.unrolled(&self.camera, &r_wc, uv, rho)?;
            Some(Unrolled {
                uv,
                by_motion: Some((shutter.offset, by)),
                noise,
            })
        });
        moved.unwrap_or(Unrolled {
            uv: *uv,
            by_motion: None,
            noise: Matrix2::zeros(),
        })
    }

    /// Pixels by which a pixel of the present view moves with each second of readout: by the camera's turning, and by its way
    /// for each 1/m of the point's inverse range.
    pub(super) fn roll(&self, uv: &Vector2<f64>) -> SMatrix<f64, 2, 2> {
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
