//! Where a person should look next (METHOD 24).

use super::error::roll_sds;
use crate::error::EkfError;
use crate::filter::ekf::Filter;
use crate::math::pose::Pose;
use crate::view_planning::{self, CandidateView, Known, Place, ViewPlan};
use nalgebra::{Matrix3, Matrix6, SMatrix, Vector3};

/// Most directions of which the gain is worked out: those with the most matches.
const MOST_DIRECTIONS: usize = 36;
/// How far the places around are, as a share of the median range of what Cs sees.
const STEP: f64 = 0.2;

impl Filter {
    /// 7x7 covariance of the pose, (translation, rotation), right tangent, and the logarithm of the scale (see
    /// [`Self::scale_sd`]): what a view of Cf is to improve. `None` where no feature has a depth.
    pub fn pose_and_scale_covariance(&self) -> Option<SMatrix<f64, 7, 7>> {
        view_planning::wanted(&self.memory.state)
    }

    /// Views of Cf that a person at `t_cf` could offer next, and how much each would tell of pose and scale.
    ///
    /// `covariance` is that of the next measured T_CF, 6x6, (translation, rotation), m^2 and rad^2, right tangent, and
    /// `bias` the part of it that lasts from frame to frame (`worn.bias_share` of it if `None`); they count along the axes of
    /// Cs, whichever way Cf turns. Views of fewer than `least` matches are taken to be of no use. Nothing is there before
    /// the start, and where Cs sees nothing of known depth.
    ///
    /// `who` is the worn camera's number.
    ///
    /// # Errors
    /// As [`Self::check_worn`].
    pub fn next_best_view(
        &self,
        t_cf: &Pose,
        covariance: &Matrix6<f64>,
        bias: Option<&Matrix6<f64>>,
        least: usize,
        who: usize,
    ) -> Result<ViewPlan, EkfError> {
        self.check_worn(t_cf, covariance, bias, who)?;
        let worn = self.setup.worn_model(who)?;
        let time_correlated = self.bias_covariance(covariance, bias);
        let in_view = |point: &Vector3<f64>| {
            let uv = self.setup.camera.project(point);
            uv.is_some_and(|uv| self.setup.camera.in_image(&uv, 0.0))
        };
        let known = self
            .memory
            .started
            .then(|| self.memory.state.clone().into_told())
            .map(|told| Known::new(&told, in_view, (t_cf, covariance, &time_correlated), who));
        let Some(known) = known.flatten() else {
            return Ok(ViewPlan::default());
        };
        let (sigma, least) = (self.setup.settings.pixel.sigma_cf, least as f64);
        let roll = roll_sds(self.setup.settings.worn.readout);
        let view = |place: &Place, at: &Vector3<f64>, attitude: &Matrix3<f64>| {
            let expected = place.expected(worn, attitude, (sigma, &roll), least);
            CandidateView {
                t_cf: Pose {
                    rotation: *attitude,
                    translation: *at,
                },
                matches: expected.matches,
                gain: expected.gain,
            }
        };
        let place = Place::new(&known, &t_cf.translation);
        let directions = view_planning::directions().map(|r| (place.matches(worn, &r), r));
        let mut directions: Vec<_> = directions.filter(|(matches, _)| *matches > 0.0).collect();
        directions.sort_by(|(a, _), (b, _)| b.total_cmp(a));
        directions.truncate(MOST_DIRECTIONS);
        let here = directions
            .iter()
            .map(|(_, r)| view(&place, &t_cf.translation, r));
        let (middle, range) = known.middle();
        let elsewhere = view_planning::turns_around().filter_map(|turn| {
            let at = t_cf.translation + turn * (STEP * range);
            let attitude = view_planning::attitude(&(middle - at))?;
            Some(view(&Place::new(&known, &at), &at, &attitude))
        });
        Ok(ViewPlan {
            here: here.collect(),
            elsewhere: elsewhere.collect(),
        })
    }
}
