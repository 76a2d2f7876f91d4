//! A shutter that rolls: each row of an image of Cs is taken at a time of its own, while the camera moves (METHOD 4).
//!
//! The frame's pose is that of the middle row. A row above or below it was seen from `r + v tau`, `q (x) q(w tau)`, with
//! `tau` its share of the image's height, from -1/2 to 1/2, times the readout.

use super::point::{CameraPose, POSE_DIM};
use crate::camera::Camera;
use crate::math::quat;
use nalgebra::{SMatrix, Vector2, Vector3};

/// Numbers that a row's time brings in: `[v w]` of the camera, and the readout.
pub(crate) const MOTION_DIM: usize = 7;

/// The camera's motion while its shutter rolls.
#[derive(Clone, Copy, Debug)]
pub struct Shutter {
    /// Offset of the readout in the state.
    pub offset: usize,
    /// Seconds from the first row to the last one.
    pub readout: f64,
    /// Rows of the image.
    pub height: f64,
    /// `v_W`, m/s.
    pub velocity: Vector3<f64>,
    /// `w_C`, rad/s.
    pub turning: Vector3<f64>,
    /// Whether `velocity` was told by anything but these rows: what they leave of a speed that may be any is garbage.
    pub is_speed_known: bool,
}

/// The camera at the time of one row.
#[derive(Clone, Debug)]
pub struct RowPose {
    /// Its pose.
    pub pose: CameraPose,
    /// Derivative of that pose by the frame's pose.
    by_pose: SMatrix<f64, 7, 7>,
    /// Derivative by `[v w readout]`.
    by_motion: SMatrix<f64, 7, MOTION_DIM>,
}

/// Derivative of a row of grad H by the camera's velocities and the readout.
#[derive(Clone, Copy, Debug)]
pub struct ByMotion {
    /// Offset of the readout in the state.
    pub readout: usize,
    /// By `[v w readout]`.
    pub by: SMatrix<f64, 3, MOTION_DIM>,
}

impl ByMotion {
    /// Where in the state its columns are.
    pub(crate) fn columns(&self) -> impl Iterator<Item = usize> {
        (POSE_DIM..POSE_DIM + MOTION_DIM - 1).chain([self.readout])
    }
}

/// A pixel as it would be if all rows were taken with the middle one.
#[derive(Clone, Copy, Debug)]
pub struct Unrolled {
    /// The pixel.
    pub uv: Vector2<f64>,
    /// Its derivative by the quaternion of the frame's attitude.
    pub by_attitude: SMatrix<f64, 2, 4>,
    /// Offset of the readout in the state, and the derivative by `[v w readout]`, where the shutter may roll.
    pub by_motion: Option<(usize, SMatrix<f64, 2, MOTION_DIM>)>,
    /// Its derivative by the inverse range of its point: that and the velocity tell by how much the way moves it, so that a
    /// scene twice as large, crossed twice as fast, is moved alike.
    pub by_rho: Vector2<f64>,
}

impl Unrolled {
    /// A pixel that no shutter has moved.
    pub(crate) fn as_seen(uv: &Vector2<f64>) -> Self {
        Self {
            uv: *uv,
            by_attitude: SMatrix::zeros(),
            by_motion: None,
            by_rho: Vector2::zeros(),
        }
    }
}

/// How far down an image of so many rows that of a pixel is: -1/2 for the first, 1/2 for the last.
pub(crate) fn down_the_image(uv: &Vector2<f64>, height: f64) -> f64 {
    uv.y / height - 0.5
}

impl Shutter {
    fn share(&self, uv: &Vector2<f64>) -> f64 {
        down_the_image(uv, self.height)
    }

    /// The camera at the time of a pixel's row.
    pub fn at(&self, frame: &CameraPose, uv: &Vector2<f64>) -> RowPose {
        let share = self.share(uv);
        let tau = share * self.readout;
        let turn = self.turning * tau;
        let step = quat::exp(&turn);
        let by_turn = quat::left(&frame.q) * quat::exp_jacobian(&turn);
        let mut by_pose = SMatrix::<f64, 7, 7>::identity();
        by_pose
            .fixed_view_mut::<4, 4>(3, 3)
            .copy_from(&quat::right(&step));
        let mut by_motion = SMatrix::<f64, 7, MOTION_DIM>::zeros();
        if self.is_speed_known {
            by_motion.fixed_view_mut::<3, 3>(0, 0).fill_diagonal(tau);
        }
        by_motion
            .fixed_view_mut::<4, 3>(3, 3)
            .copy_from(&(by_turn * tau));
        by_motion
            .fixed_view_mut::<3, 1>(0, 6)
            .copy_from(&(self.velocity * share));
        by_motion
            .fixed_view_mut::<4, 1>(3, 6)
            .copy_from(&(by_turn * self.turning * share));
        RowPose {
            pose: CameraPose {
                r: frame.r + self.velocity * tau,
                q: quat::left(&frame.q) * step,
            },
            by_pose,
            by_motion,
        }
    }

    /// A pixel as it would be if all rows were taken with the middle one; `q` is the frame's attitude, `rho` the inverse range of
    /// the point from the camera, 1/m. `None` where the pixel has no ray, or no place in the image then.
    pub fn unrolled(
        &self,
        camera: &Camera,
        q: &quat::Quat,
        uv: &Vector2<f64>,
        rho: f64,
    ) -> Option<Unrolled> {
        let share = self.share(uv);
        let tau = share * self.readout;
        let turned = quat::rotation_exp(&(self.turning * tau)) * camera.unproject(uv)?;
        let r_cw = quat::rotation(q).transpose();
        let (way, step) = (r_cw * rho, r_cw * self.velocity * tau);
        let (seen, by_ray) = camera.project_jac(&(turned + step * rho))?;
        let by_turn = -quat::skew(&turned);
        let mut by_step = SMatrix::<f64, 3, 6>::zeros();
        by_step.fixed_view_mut::<3, 3>(0, 0).copy_from(&way);
        by_step.fixed_view_mut::<3, 3>(0, 3).copy_from(&by_turn);
        let mut by = SMatrix::<f64, 3, MOTION_DIM>::zeros();
        by.fixed_view_mut::<3, 6>(0, 0).copy_from(&(by_step * tau));
        by.fixed_view_mut::<3, 1>(0, 6)
            .copy_from(&((way * self.velocity + by_turn * self.turning) * share));
        // Only what the motion changes: a lens model is not exactly undone by its inverse.
        let unmoved = camera.project(&camera.unproject(uv)?)?;
        Some(Unrolled {
            uv: uv + seen - unmoved,
            by_attitude: by_ray * quat::skew(&step) * quat::tangent(q) * rho,
            by_motion: Some((self.offset, by_ray * by)),
            by_rho: by_ray * step,
        })
    }
}

impl RowPose {
    /// A derivative by this pose, as one by the frame's pose and one by the motion.
    pub fn split<const R: usize>(
        &self,
        by_row_pose: &SMatrix<f64, R, 7>,
    ) -> (SMatrix<f64, R, 7>, SMatrix<f64, R, MOTION_DIM>) {
        (by_row_pose * self.by_pose, by_row_pose * self.by_motion)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Vector4;

    fn camera() -> Camera {
        Camera::new(
            "radtan",
            640,
            480,
            [500.0, 510.0, 322.0, 238.0],
            &[-0.1, 0.05, 1e-3, -1e-3],
        )
        .expect("a calibration")
    }

    fn shutter(numbers: &[f64]) -> Shutter {
        Shutter {
            offset: 13,
            readout: numbers[6],
            height: 480.0,
            velocity: Vector3::from_column_slice(&numbers[..3]),
            turning: Vector3::from_column_slice(&numbers[3..6]),
            is_speed_known: true,
        }
    }

    const MOTION: [f64; 7] = [0.4, -0.7, 1.1, 0.8, -1.3, 0.5, 0.03];

    fn pose() -> CameraPose {
        let q = Vector4::new(0.8, 0.3, -0.4, 0.2);
        CameraPose {
            r: Vector3::new(0.5, -1.0, 2.0),
            q: q / q.norm(),
        }
    }

    #[test]
    fn the_pose_of_a_row_has_its_derivatives() {
        let uv = Vector2::new(100.0, 420.0);
        let at = shutter(&MOTION).at(&pose(), &uv);
        let numbers = |pose: &CameraPose| {
            nalgebra::SVector::<f64, 7>::from_iterator(pose.r.iter().chain(pose.q.iter()).copied())
        };
        for k in 0..7 {
            let moved = |h: f64| {
                let mut motion = MOTION;
                motion[k] += h;
                numbers(&shutter(&motion).at(&pose(), &uv).pose)
            };
            let slope = (moved(1e-6) - moved(-1e-6)) / 2e-6;
            assert!((slope - at.by_motion.column(k)).norm() < 1e-8, "{k}");
            let from = |h: f64| {
                let mut frame = pose();
                if k < 3 {
                    frame.r[k] += h;
                } else {
                    frame.q[k - 3] += h;
                }
                numbers(&shutter(&MOTION).at(&frame, &uv).pose)
            };
            let slope = (from(1e-6) - from(-1e-6)) / 2e-6;
            assert!((slope - at.by_pose.column(k)).norm() < 1e-8, "{k}");
        }
    }

    #[test]
    fn an_unrolled_pixel_is_what_the_frame_pose_sees() {
        let (camera, frame, shutter) = (camera(), pose(), shutter(&MOTION));
        let point = frame.r + quat::rotation(&frame.q) * Vector3::new(-0.6, 0.5, 2.0);
        let project = |pose: &CameraPose| {
            let seen = quat::rotation(&pose.q).transpose() * (point - pose.r);
            camera.project(&seen).expect("in front")
        };
        // The row in which a moving camera sees the point.
        let mut seen = project(&frame);
        for _ in 0..20 {
            seen = project(&shutter.at(&frame, &seen).pose);
        }
        let rho = 1.0 / (point - shutter.at(&frame, &seen).pose.r).norm();
        let unrolled = shutter.unrolled(&camera, &frame.q, &seen, rho);
        let uv = unrolled.expect("a ray").uv;
        assert!(
            (project(&frame) - seen).norm() > 5.0,
            "the test's shutter does not roll"
        );
        assert!(
            (uv - project(&frame)).norm() < 0.02,
            "{uv} {}",
            project(&frame)
        );
    }

    #[test]
    fn an_unrolled_pixel_has_its_derivatives() {
        let (camera, q, rho) = (camera(), pose().q, 0.4);
        let pixel = Vector2::new(100.0, 420.0);
        let moved = |motion: &[f64], q: &quat::Quat, rho: f64| {
            let unrolled = shutter(motion).unrolled(&camera, q, &pixel, rho);
            unrolled.expect("a ray")
        };
        let at = moved(&MOTION, &q, rho);
        let (_, by) = at.by_motion.expect("it rolls");
        // The turn's second order is left out: 1 % at 15 ms.
        let same = |plus: Unrolled, minus: Unrolled, by: Vector2<f64>, what: &str| {
            let slope = (plus.uv - minus.uv) / 2e-6;
            assert!((slope - by).norm() < 0.02 * by.norm() + 1e-6, "{what}");
        };
        for k in 0..7 {
            let motion = |h: f64| {
                let mut motion = MOTION;
                motion[k] += h;
                moved(&motion, &q, rho)
            };
            same(motion(1e-6), motion(-1e-6), by.column(k).into(), "motion");
        }
        for k in 0..4 {
            let attitude = |h: f64| {
                let mut q = q;
                q[k] += h;
                moved(&MOTION, &(q / q.norm()), rho)
            };
            let by = at.by_attitude.column(k).into();
            same(attitude(1e-6), attitude(-1e-6), by, "attitude");
        }
        let range = |h: f64| moved(&MOTION, &q, rho + h);
        same(range(1e-6), range(-1e-6), at.by_rho, "range");
    }
}
