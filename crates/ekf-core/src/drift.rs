//! Gauge directions of the map: what no camera can see (METHOD 13, 14).
//!
//! Moving or turning camera and map together changes no measurement, so uncertainty along these directions never
//! interacts with the filter: it is kept apart, as a 6x6 covariance of the world frame, and added to the pose that is
//! reported.
//!
//! What makes the world frame drift unnoticed (calibration, patches, linearisation, a scene that is not quite still)
//! also leaves residuals. How large they are beside the noise that the settings claim, NIS per degree of freedom, says
//! how good camera and scene are, so the drift's variance grows in proportion to it.

use crate::math::quat;
use crate::observe::point::CameraPose;
use crate::settings::ProcessSettings;
use nalgebra::{Matrix3, Matrix6};

/// Right tangent of the pose from a small motion `(translation, rotation)` of the world frame.
fn seen_from_camera(pose: &CameraPose) -> Matrix6<f64> {
    let r_cw = quat::rotation(&pose.q).transpose();
    let mut a = Matrix6::zeros();
    a.fixed_view_mut::<3, 3>(0, 0).copy_from(&r_cw);
    a.fixed_view_mut::<3, 3>(0, 3)
        .copy_from(&(-r_cw * quat::skew(&pose.r)));
    a.fixed_view_mut::<3, 3>(3, 3).copy_from(&r_cw);
    a
}

/// Covariance of the world frame's drift since the start.
#[derive(Clone, Debug, Default)]
pub(crate) struct FrameDrift(pub(crate) Matrix6<f64>);

/// NIS of all updates since the start, and their degrees of freedom.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Misfit {
    pub(crate) nis: f64,
    pub(crate) dof: f64,
}

impl Misfit {
    /// Adds an update.
    pub(crate) fn add(&mut self, nis: f64, dof: usize) {
        self.nis += nis;
        self.dof += dof as f64;
    }

    /// NIS per degree of freedom; 1 before any update.
    pub(crate) fn share(&self) -> f64 {
        if self.dof > 0.0 {
            self.nis / self.dof
        } else {
            1.0
        }
    }
}

impl FrameDrift {
    /// Grows over `dt` seconds and `distance` metres of a run with that misfit; the noise is that of the camera where it is now.
    pub(crate) fn grow(
        &mut self,
        pose: &CameraPose,
        dt: f64,
        distance: f64,
        misfit: f64,
        settings: &ProcessSettings,
    ) {
        let position = settings.position_drift.powi(2) * distance * misfit;
        let attitude = settings.attitude_drift.to_radians().powi(2) * dt * misfit;
        // Isotropic noise in C is the same in W, taken about the camera.
        let lever = quat::skew(&pose.r);
        let mut noise = Matrix6::zeros();
        noise
            .fixed_view_mut::<3, 3>(0, 0)
            .copy_from(&(Matrix3::identity() * position + lever * lever.transpose() * attitude));
        noise
            .fixed_view_mut::<3, 3>(0, 3)
            .copy_from(&(lever * attitude));
        noise
            .fixed_view_mut::<3, 3>(3, 0)
            .copy_from(&(lever.transpose() * attitude));
        noise
            .fixed_view_mut::<3, 3>(3, 3)
            .copy_from(&(Matrix3::identity() * attitude));
        self.0 += noise;
    }

    /// What it adds to the covariance of the pose, right tangent.
    pub(crate) fn of_pose(&self, pose: &CameraPose) -> Matrix6<f64> {
        let a = seen_from_camera(pose);
        a * self.0 * a.transpose()
    }
}

#[cfg(test)]
mod tests {
    use super::{FrameDrift, Misfit};
    use crate::observe::point::CameraPose;
    use crate::settings::ProcessSettings;
    use nalgebra::{Matrix6, Vector3, Vector4, Vector6};

    #[test]
    fn its_variance_grows_in_proportion_to_the_misfit() {
        let mut misfit = Misfit::default();
        assert!(misfit.share() == 1.0);
        misfit.add(80.0, 10);
        misfit.add(0.0, 30);
        assert!(misfit.share() == 2.0);
        let pose = CameraPose {
            r: Vector3::new(1.0, 2.0, 3.0),
            q: Vector4::new(1.0, 0.0, 0.0, 0.0),
        };
        let of_pose = |misfit: f64| {
            let mut drift = FrameDrift::default();
            drift.grow(&pose, 0.1, 0.5, misfit, &ProcessSettings::default());
            drift.of_pose(&pose)
        };
        let once = of_pose(1.0);
        assert!(once.diagonal().min() > 0.0);
        assert!((of_pose(2.0) - once * 2.0).abs().max() <= 1e-15 * once.max());
    }
    /// What drifts is the camera's own knowledge: where it is now, translation and rotation are on their own, however far the
    /// origin of W is away.
    #[test]
    fn at_the_camera_its_noise_has_no_lever() {
        let pose = CameraPose {
            r: Vector3::new(1.0, -2.0, 3.0),
            q: Vector4::new(0.8, 0.2, -0.4, 0.4).normalize(),
        };
        let settings = ProcessSettings {
            position_drift: 0.02,
            attitude_drift: 3.0,
            ..ProcessSettings::default()
        };
        let mut drift = FrameDrift::default();
        drift.grow(&pose, 0.1, 0.5, 1.5, &settings);
        let sds = [
            0.02 * f64::sqrt(0.5 * 1.5),
            f64::to_radians(3.0) * f64::sqrt(0.1 * 1.5),
        ];
        let expected = Vector6::from_fn(|i, _| sds[i / 3].powi(2));
        let off = drift.of_pose(&pose) - Matrix6::from_diagonal(&expected);
        assert!(off.abs().max() < 1e-15, "{off}");
    }
}
