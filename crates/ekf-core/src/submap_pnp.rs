//! An earlier submap in sight: where the camera is in it, from the pixels of its landmarks and their covariance (METHOD 25).

mod unsupported;

use crate::camera::Camera;
use crate::chi2;
use crate::error::EkfError;
use crate::math::pose::Pose;
use crate::math::quat;
use nalgebra::{DMatrix, DVector, Matrix6, SMatrix, SVector, Vector2, Vector3};

/// Directions of map drift: three translations, three turns and the size.
const DRIFT: usize = 7;
/// Most steps of a fit, and the step after which it stands (metres, radians).
const MOST_STEPS: usize = 20;
const STANDS: f64 = 1e-9;

/// A submap's landmarks as they stood to the camera where it ended.
#[derive(Clone, Copy, Debug)]
pub struct Landmarks<'a> {
    /// Metres.
    pub points: &'a [Vector3<f64>],
    /// `3n x 3n`, m^2.
    pub covariance: &'a DMatrix<f64>,
    /// With what the submap transferred, `3n x k`.
    pub with_transferred: &'a DMatrix<f64>,
    /// Covariance of what it transferred, `k x k`.
    pub transferred: &'a DMatrix<f64>,
}

/// By how much a match of an old landmark is off.
#[derive(Clone, Copy, Debug)]
pub struct Noise {
    /// Standard deviation of its pixel, by itself.
    pub sigma: f64,
    /// Of what all matches share, radians: the old landmarks and those that the camera sees now have drifted against one another
    /// by this much as their view was exchanged (METHOD 20).
    pub map_drift: f64,
}

/// Where the camera is in a submap.
#[derive(Clone, Debug)]
pub struct SubmapPnp {
    /// Pose of the camera in the frame of the submap's end.
    pub pose: Pose,
    /// What the matches say about the pose (right tangent) and about what the submap transferred.
    pub information: DMatrix<f64>,
    /// Which matches it rests on.
    pub accepted: Vec<bool>,
    /// Their squared residual against all noise, and its degrees of freedom.
    pub chi2: f64,
    /// See `chi2`.
    pub dof: usize,
}

/// Fits the pose to matches of landmarks (by their place) with pixels, and tests them by chi-square: the worst is
/// taken out until each agrees with the others and all together pass. So are matches, close together or very few, that decide
/// something alone: a pattern that repeats is found in the wrong place by all that lie on it. `None` if fewer than `least`, or fewer than
/// half of them, are left, or they leave the pose open.
///
/// # Errors
/// `BadShape`, `NonFinite`, `InvalidInput` (no such landmark).
pub fn submap_pnp(
    camera: &Camera,
    noise: Noise,
    landmarks: &Landmarks<'_>,
    matches: &[(usize, Vector2<f64>)],
    guess: &Pose,
    least: usize,
) -> Result<Option<SubmapPnp>, EkfError> {
    check(landmarks, matches, noise)?;
    let mut kept: Vec<usize> = (0..matches.len()).collect();
    let mut pose = guess.clone();
    while kept.len() >= least.max(4) && 2 * kept.len() >= matches.len() {
        let some: Vec<_> = kept.iter().map(|&k| matches[k]).collect();
        let Some((fitted, rows)) = fit(camera, noise, landmarks, &some, &pose) else {
            return Ok(None);
        };
        pose = fitted;
        let all_noise = rows.noise(landmarks.covariance, noise);
        let Some(inverse) = all_noise.cholesky().map(|l| l.inverse()) else {
            return Ok(None);
        };
        let weighted = &inverse * &rows.residual;
        let squared = rows.residual.dot(&weighted);
        let dof = 2 * some.len() - 6;
        let by_itself = |k: &usize| {
            let own = inverse.fixed_view::<2, 2>(2 * k, 2 * k).try_inverse();
            let z = weighted.fixed_rows::<2>(2 * k);
            own.map_or(f64::INFINITY, |own| z.dot(&(own * z)))
        };
        let all: Vec<f64> = (0..some.len()).map(|k| by_itself(&k)).collect();
        let worst = (0..all.len()).max_by(|&a, &b| all[a].total_cmp(&all[b]));
        let Some(worst) = worst else {
            return Ok(None);
        };
        let fits = all[worst] <= chi2::quantile(chi2::SURE_LEVEL, 2.0)
            && squared <= chi2::quantile(chi2::SURE_LEVEL, dof as f64);
        if !fits {
            kept.remove(worst);
            continue;
        }
        let uv: Vec<_> = some.iter().map(|(_, uv)| *uv).collect();
        let alone = unsupported::alone(&uv, f64::from(camera.width), &rows.by_pose, &inverse);
        if !alone.is_empty() {
            let mut place = 0..;
            kept.retain(|_| place.next().is_some_and(|k| !alone.contains(&k)));
            continue;
        }
        let mut accepted = vec![false; matches.len()];
        kept.iter().for_each(|&k| accepted[k] = true);
        let information = rows.information(landmarks, noise);
        return Ok(information.map(|information| SubmapPnp {
            pose,
            information,
            accepted,
            chi2: squared,
            dof,
        }));
    }
    Ok(None)
}

fn check(
    landmarks: &Landmarks<'_>,
    matches: &[(usize, Vector2<f64>)],
    noise: Noise,
) -> Result<(), EkfError> {
    let (n, transferred) = (3 * landmarks.points.len(), landmarks.transferred.nrows());
    let shapes = [
        ("covariance of the landmarks", landmarks.covariance, (n, n)),
        (
            "covariance of the landmarks with what is transferred",
            landmarks.with_transferred,
            (n, transferred),
        ),
        (
            "covariance of what is transferred",
            landmarks.transferred,
            (transferred, transferred),
        ),
    ];
    for (what, matrix, shape) in shapes {
        if matrix.shape() != shape {
            let expected = format!("{shape:?}");
            let got = format!("{:?}", matrix.shape());
            return Err(EkfError::BadShape {
                what,
                expected,
                got,
            });
        }
        if !matrix.iter().all(|v| v.is_finite()) {
            return Err(EkfError::NonFinite { what });
        }
    }
    let numbers = landmarks.points.iter().flat_map(|p| p.iter());
    let mut numbers = numbers.chain(matches.iter().flat_map(|(_, uv)| uv.iter()));
    let Noise { sigma, map_drift } = noise;
    let stated = sigma.is_finite() && sigma > 0.0 && map_drift.is_finite() && map_drift >= 0.0;
    let good = numbers.all(|v| v.is_finite()) && stated;
    if !good {
        let what = "landmarks, pixels or noise of a submap PnP";
        return Err(EkfError::NonFinite { what });
    }
    match matches.iter().find(|(k, _)| *k >= n / 3) {
        Some((k, _)) => Err(EkfError::InvalidInput {
            what: "matches",
            why: format!("there is no landmark {k} among {}", n / 3),
        }),
        None => Ok(()),
    }
}

/// Linearised matches.
struct Rows {
    residual: DVector<f64>,
    /// By the pose's right tangent.
    by_pose: DMatrix<f64>,
    /// By the points, each match by its own.
    by_point: Vec<(usize, SMatrix<f64, 2, 3>)>,
    /// By map drift of one radian: a motion of the camera along each axis and about it, and the size of all.
    by_drift: DMatrix<f64>,
}

impl Rows {
    /// `None` where a landmark has no pixel.
    fn of(
        camera: &Camera,
        landmarks: &Landmarks<'_>,
        matches: &[(usize, Vector2<f64>)],
        pose: &Pose,
    ) -> Option<Self> {
        let into = pose.inverse();
        let mut rows = Self {
            residual: DVector::zeros(2 * matches.len()),
            by_pose: DMatrix::zeros(2 * matches.len(), 6),
            by_point: Vec::with_capacity(matches.len()),
            by_drift: DMatrix::zeros(2 * matches.len(), DRIFT),
        };
        let mut log_range = 0.0;
        for (k, &(landmark, uv)) in matches.iter().enumerate() {
            let seen = into.apply(&landmarks.points[landmark]);
            let (expected, by_seen) = camera.project_jac(&seen)?;
            log_range += seen.norm().ln() / matches.len() as f64;
            let mut moved = SMatrix::<f64, 3, 6>::zeros();
            moved.fixed_view_mut::<3, 3>(0, 0).fill_diagonal(-1.0);
            moved
                .fixed_view_mut::<3, 3>(0, 3)
                .copy_from(&quat::skew(&seen));
            rows.residual
                .fixed_rows_mut::<2>(2 * k)
                .copy_from(&(uv - expected));
            rows.by_pose
                .fixed_view_mut::<2, 6>(2 * k, 0)
                .copy_from(&(by_seen * moved));
            let by_point = by_seen * into.rotation;
            rows.by_drift
                .fixed_view_mut::<2, 1>(2 * k, DRIFT - 1)
                .copy_from(&(by_point * landmarks.points[landmark]));
            rows.by_point.push((landmark, by_point));
        }
        let along = rows.by_pose.columns(0, 3) * log_range.exp();
        rows.by_drift.columns_mut(0, 3).copy_from(&along);
        rows.by_drift
            .columns_mut(3, 3)
            .copy_from(&rows.by_pose.columns(3, 3));
        Some(rows)
    }

    /// The residual's covariance, with this one of all points.
    fn noise(&self, points: &DMatrix<f64>, noise: Noise) -> DMatrix<f64> {
        let m = self.residual.len();
        let mut s = &self.by_drift * self.by_drift.transpose() * noise.map_drift.powi(2);
        s += DMatrix::identity(m, m) * noise.sigma.powi(2);
        for (i, (a, by_a)) in self.by_point.iter().enumerate() {
            for (j, (b, by_b)) in self.by_point.iter().enumerate() {
                let p = points.fixed_view::<3, 3>(3 * a, 3 * b);
                let mut block = s.fixed_view_mut::<2, 2>(2 * i, 2 * j);
                block += by_a * p * by_b.transpose();
            }
        }
        (&s + s.transpose()) * 0.5
    }

    /// What is said about the pose and what was transferred: the points by themselves are uncertain by what that leaves.
    fn information(&self, landmarks: &Landmarks<'_>, noise: Noise) -> Option<DMatrix<f64>> {
        let n = landmarks.transferred.nrows();
        let least = DMatrix::identity(n, n) * 1e-12;
        let transferred = (landmarks.transferred + least).cholesky()?;
        let with = landmarks.with_transferred;
        let solved = transferred.solve(&with.transpose());
        let own = landmarks.covariance - with * &solved;
        let noise = self.noise(&own, noise).cholesky()?;
        let m = self.residual.len();
        let mut by = DMatrix::<f64>::zeros(m, 6 + n);
        by.columns_mut(0, 6).copy_from(&self.by_pose);
        for (k, (landmark, by_point)) in self.by_point.iter().enumerate() {
            let gain = solved.columns(3 * landmark, 3).transpose();
            by.view_mut((2 * k, 6), (2, n))
                .copy_from(&(by_point * gain));
        }
        let information = by.transpose() * noise.solve(&by);
        let information = (&information + information.transpose()) * 0.5;
        let pose: Matrix6<f64> = information.fixed_view::<6, 6>(0, 0).into_owned();
        pose.cholesky()?;
        Some(information)
    }
}

/// The pose of least squares, and the matches linearised there; `None` where they leave it open.
fn fit(
    camera: &Camera,
    noise: Noise,
    landmarks: &Landmarks<'_>,
    matches: &[(usize, Vector2<f64>)],
    guess: &Pose,
) -> Option<(Pose, Rows)> {
    let mut pose = guess.clone();
    for _ in 0..MOST_STEPS {
        let rows = Rows::of(camera, landmarks, matches, &pose)?;
        let noise = rows.noise(landmarks.covariance, noise).cholesky()?;
        let information = rows.by_pose.transpose() * noise.solve(&rows.by_pose);
        let information: Matrix6<f64> = information.fixed_view::<6, 6>(0, 0).into_owned();
        let pull = rows.by_pose.transpose() * noise.solve(&rows.residual);
        let pull = SVector::<f64, 6>::from_column_slice(pull.as_slice());
        let step = information.cholesky()?.solve(&pull);
        pose = pose.retract(&step);
        if step.amax() < STANDS {
            break;
        }
    }
    let rows = Rows::of(camera, landmarks, matches, &pose)?;
    Some((pose, rows))
}
