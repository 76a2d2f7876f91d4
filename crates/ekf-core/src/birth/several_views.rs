//! Where one camera has been, and where the points that it has followed are, from several views of them (METHOD 5).
//!
//! The scale-free start. While the camera has hardly moved, a turn and a step to the side look alike, and a filter that is
//! linearised there takes one for the other and is sure of it. So nothing is linearised before the views tell them apart:
//! all of them are fitted at once (Gauss-Newton, damped, by the Schur complement over the points), from several first
//! guesses of the direction of motion, and an answer is one only if no other fits nearly as well.
//!
//! Unknown are the poses of all views but the first, `T_0k = T_hat Exp(xi)`, and `(theta, phi, rho)` of each point from the
//! first view. Nothing tells the scale: it is chosen such that the mean of rho is what the caller says.

mod normal;

use crate::camera::Camera;
use crate::math::{inverse_depth, pose::Pose, quat};
use nalgebra::{DMatrix, DVector, Matrix3, SMatrix, Vector2, Vector3};
use normal::{Normal, Step};

/// Steps of one fit at most: of a first guess from two views, and of all views.
const STEPS: (usize, usize) = (12, 20);
/// A step that lessens the cost by less than this share is the last.
const SETTLED: f64 = 1e-4;
/// Residuals count in full up to so many sigma, and linearly beyond.
const HUBER: f64 = 3.0;
/// A point is wrong if it fits worse than so many times the median residual, and worse than sigma.
const WRONG: f64 = 5.0;
/// By how many variances of the residuals another answer must fit worse: chi-square of two numbers at 0.999.
const DISTINCT: f64 = 13.8;
/// Answers whose directions of motion differ by less, radians, are one.
const SAME: f64 = 0.1;
/// Inverse depth of all points in a first guess; the baseline is one.
const FIRST_RHO: f64 = 0.2;

/// What the views say.
#[derive(Clone, Debug)]
pub(crate) struct Structure {
    /// Poses of the last view and of the one before it, in the first.
    pub last: [Pose; 2],
    /// Which track each point is.
    pub tracks: Vec<usize>,
    /// `(theta, phi, rho)` of each point, from the first view.
    pub points: Vec<Vector3<f64>>,
    /// Joint covariance: both poses' tangents (6 and 6; zeros where the one before is the first), then the points (3 each).
    pub covariance: DMatrix<f64>,
}

impl Structure {
    /// Fits the views: `views[k][i]` is the pixel of track i in view k. None if they do not tell it yet: fewer than
    /// `least` points, or than half of all, whose rho is known to `max_rho_ratio`, or two answers that fit alike.
    pub(crate) fn of(
        camera: &Camera,
        views: &[Vec<Vector2<f64>>],
        sigma: f64,
        (rho, max_rho_ratio, least): (f64, f64, usize),
    ) -> Option<Self> {
        let all: Vec<usize> = (0..views.first()?.len()).collect();
        let fit = Fit::new(camera, views, sigma, all)?;
        let (best, next) = fit.answers();
        let mut best = best?;
        if let Some(next) = next {
            let variance = best.cost / fit.freedom();
            if next.cost - best.cost < DISTINCT * variance {
                return None;
            }
        }
        let right = fit.right(&best);
        if right.len() < fit.tracks.len() {
            let fewer = Fit::new(
                camera,
                views,
                sigma,
                right.iter().map(|&i| fit.tracks[i]).collect(),
            )?;
            best.points = right.iter().map(|&i| best.points[i]).collect();
            let settled = fewer.settle(best, STEPS.1)?;
            return fewer.structure(settled, rho, max_rho_ratio, least.max(fit.tracks.len() / 2));
        }
        fit.structure(best, rho, max_rho_ratio, least.max(fit.tracks.len() / 2))
    }
}

/// Poses of all views, points, and how well they fit.
#[derive(Clone, Debug)]
struct Estimate {
    poses: Vec<Pose>,
    points: Vec<Vector3<f64>>,
    cost: f64,
}

/// The views as they are fitted.
struct Fit<'a> {
    camera: &'a Camera,
    sigma: f64,
    tracks: Vec<usize>,
    pixels: Vec<Vec<Vector2<f64>>>,
    rays: Vec<Vec<Vector3<f64>>>,
}

/// Derivative of a pixel by the view's pose and by the point, over sigma.
struct Row {
    residual: Vector2<f64>,
    by_pose: SMatrix<f64, 2, 6>,
    by_point: SMatrix<f64, 2, 3>,
}

impl<'a> Fit<'a> {
    /// None with fewer than two views or a pixel that has no ray.
    fn new(
        camera: &'a Camera,
        views: &[Vec<Vector2<f64>>],
        sigma: f64,
        tracks: Vec<usize>,
    ) -> Option<Self> {
        if views.len() < 2 || tracks.is_empty() {
            return None;
        }
        let pixels: Vec<Vec<_>> = views
            .iter()
            .map(|view| tracks.iter().map(|&i| view[i]).collect())
            .collect();
        let rays = pixels
            .iter()
            .map(|view| view.iter().map(|uv| camera.unproject(uv)).collect())
            .collect::<Option<_>>()?;
        Some(Self {
            camera,
            sigma,
            tracks,
            pixels,
            rays,
        })
    }

    /// Numbers measured less numbers unknown.
    fn freedom(&self) -> f64 {
        let (views, points) = (self.pixels.len(), self.tracks.len());
        let free = (2 * views * points) as f64 - (6 * (views - 1) + 3 * points) as f64 + 1.0;
        free.max(1.0)
    }

    /// The best fit, and the next best that is another.
    fn answers(&self) -> (Option<Estimate>, Option<Estimate>) {
        let last = self.pixels.len() - 1;
        let two = Fit {
            camera: self.camera,
            sigma: self.sigma,
            tracks: self.tracks.clone(),
            pixels: vec![self.pixels[0].clone(), self.pixels[last].clone()],
            rays: vec![self.rays[0].clone(), self.rays[last].clone()],
        };
        let s = std::f64::consts::FRAC_1_SQRT_2;
        let ahead = [[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];
        let aslant = [[s, 0.0, s], [s, 0.0, -s], [0.0, s, s], [0.0, s, -s]];
        let mut found: Vec<Estimate> = Vec::new();
        for direction in ahead.iter().chain(&aslant) {
            let guess = two.guess(&Vector3::from(*direction));
            let settled = guess.and_then(|guess| two.settle(guess, STEPS.0));
            found.extend(settled.map(Estimate::in_front));
        }
        keep_distinct(&mut found);
        found.truncate(2);
        let whole = found.iter().map(|e| self.spread(e));
        let mut whole: Vec<Estimate> = whole
            .filter_map(|e| self.settle(e, STEPS.1))
            .map(Estimate::in_front)
            .collect();
        keep_distinct(&mut whole);
        let mut whole = whole.into_iter();
        (whole.next(), whole.next())
    }

    /// All points equally far, the camera turned as far points say, and moved by one along `direction`.
    fn guess(&self, direction: &Vector3<f64>) -> Option<Estimate> {
        let last = self.rays.len() - 1;
        let poses = vec![
            Pose::identity(),
            Pose {
                rotation: self.turn(last)?,
                translation: *direction,
            },
        ];
        self.estimate(poses, self.straight(FIRST_RHO))
    }

    /// Directions of the first view, at one inverse depth.
    fn straight(&self, rho: f64) -> Vec<Vector3<f64>> {
        let rays = self.rays[0].iter();
        rays.map(|ray| {
            let (angles, _) = inverse_depth::angles(ray);
            Vector3::new(angles.x, angles.y, rho)
        })
        .collect()
    }

    /// The rotation of a view in the first that turns its rays best into those of the first.
    fn turn(&self, k: usize) -> Option<Matrix3<f64>> {
        let pairs = self.rays[0].iter().zip(&self.rays[k]);
        let sum: Matrix3<f64> = pairs.map(|(a, b)| a * b.transpose()).sum();
        let svd = sum.svd(true, true);
        let (u, vt) = (svd.u?, svd.v_t?);
        let mut flip = Matrix3::identity();
        flip[(2, 2)] = (u * vt).determinant().signum();
        Some(u * flip * vt)
    }

    /// An answer of first and last view, with those between on the straight way from one to the other.
    fn spread(&self, two: &Estimate) -> Estimate {
        let last = self.pixels.len() - 1;
        let poses = (0..=last)
            .map(|k| two.poses[0].interpolate(&two.poses[1], k as f64 / last as f64))
            .collect();
        Estimate {
            poses,
            points: two.points.clone(),
            cost: f64::INFINITY,
        }
    }

    fn estimate(&self, poses: Vec<Pose>, points: Vec<Vector3<f64>>) -> Option<Estimate> {
        let mut cost = 0.0;
        for (k, pose) in poses.iter().enumerate() {
            for (i, point) in points.iter().enumerate() {
                let seen = self.camera.project(&in_view(pose, point))?;
                let e = (self.pixels[k][i] - seen).norm() / self.sigma;
                cost += if e < HUBER {
                    e * e
                } else {
                    HUBER * (2.0 * e - HUBER)
                };
            }
        }
        Some(Estimate {
            poses,
            points,
            cost,
        })
    }

    /// Damped Gauss-Newton; None if the guess puts a point where the camera cannot see it.
    fn settle(&self, guess: Estimate, steps: usize) -> Option<Estimate> {
        let mut now = self.estimate(guess.poses, guess.points)?;
        let mut damping = 1e-3;
        for _ in 0..steps {
            let normal = self.normal(&now)?;
            let mut next = None;
            for _ in 0..5 {
                let tried = normal.solve(damping).and_then(|d| self.moved(&now, &d));
                next = tried.filter(|e| e.cost < now.cost);
                if next.is_some() {
                    break;
                }
                damping *= 10.0;
            }
            let Some(next) = next else { break };
            let settled = now.cost - next.cost < SETTLED * now.cost;
            now = next;
            damping = (damping * 0.1).max(1e-9);
            if settled {
                break;
            }
        }
        Some(now)
    }

    fn moved(&self, from: &Estimate, step: &Step) -> Option<Estimate> {
        let mut poses = vec![from.poses[0].clone()];
        poses.extend(
            from.poses[1..]
                .iter()
                .zip(&step.poses)
                .map(|(p, d)| p.retract(d)),
        );
        let points = from.points.iter().zip(&step.points).map(|(y, d)| y + d);
        self.estimate(poses, points.collect())
    }

    fn row(&self, e: &Estimate, k: usize, i: usize) -> Option<Row> {
        let (pose, y) = (&e.poses[k], &e.points[i]);
        let h = in_view(pose, y);
        let (seen, by_h) = self.camera.project_jac(&h)?;
        let by_h = by_h / self.sigma;
        let residual = (self.pixels[k][i] - seen) / self.sigma;
        let weight = (HUBER / residual.norm().max(HUBER)).sqrt();
        let by_h = by_h * weight;
        let mut by_pose = SMatrix::<f64, 2, 6>::zeros();
        by_pose
            .fixed_view_mut::<2, 3>(0, 0)
            .copy_from(&(by_h * -y.z));
        by_pose
            .fixed_view_mut::<2, 3>(0, 3)
            .copy_from(&(by_h * quat::skew(&h)));
        let by_first = by_h * pose.rotation.transpose();
        let (theta, phi) = inverse_depth::ray_jacobian(y.x, y.y);
        let by_point = by_first * Matrix3::from_columns(&[theta, phi, -pose.translation]);
        Some(Row {
            residual: residual * weight,
            by_pose,
            by_point,
        })
    }

    /// With the baseline held, which fixes the scale.
    fn normal(&self, e: &Estimate) -> Option<Normal> {
        let (views, count) = (self.pixels.len(), self.tracks.len());
        let mut normal = Normal::new(views - 1, count);
        for k in 0..views {
            for i in 0..count {
                let row = self.row(e, k, i)?;
                normal.add(
                    k.checked_sub(1),
                    i,
                    &row.by_pose,
                    &row.by_point,
                    &row.residual,
                );
            }
        }
        let last = &e.poses[views - 1];
        let length = last.translation.norm();
        let along = last.rotation.transpose() * last.translation / (length * length) * 1e3;
        normal.hold_last(&along);
        Some(normal)
    }

    /// Which points fit all views.
    fn right(&self, e: &Estimate) -> Vec<usize> {
        let worst: Vec<f64> = (0..self.tracks.len())
            .map(|i| {
                let of_view = |k: usize| {
                    let seen = self.camera.project(&in_view(&e.poses[k], &e.points[i]));
                    seen.map_or(f64::INFINITY, |uv| (self.pixels[k][i] - uv).norm())
                };
                (0..self.pixels.len()).map(of_view).fold(0.0, f64::max)
            })
            .collect();
        let mut sorted = worst.clone();
        sorted.sort_unstable_by(f64::total_cmp);
        let bound = (WRONG * sorted[sorted.len() / 2]).max(self.sigma);
        let right = |&i: &usize| worst[i] <= bound && e.points[i].z > 0.0;
        (0..worst.len()).filter(right).collect()
    }

    /// The answer in the unit in which the mean of rho is `rho`, with its joint covariance.
    fn structure(
        &self,
        e: Estimate,
        rho: f64,
        max_rho_ratio: f64,
        least: usize,
    ) -> Option<Structure> {
        let views = self.pixels.len();
        let count = self.tracks.len();
        let cov = self
            .normal(&e)?
            .covariance([views - 2, views.saturating_sub(3)], views > 2)?;
        let mean = e.points.iter().map(|y| y.z).sum::<f64>() / count as f64;
        if mean <= 0.0 {
            return None;
        }
        // d of every number by the logarithm of the scale, and that logarithm by every rho.
        let scale = mean / rho;
        let points: Vec<_> = e
            .points
            .iter()
            .map(|y| Vector3::new(y.x, y.y, y.z / scale))
            .collect();
        let mut last = [views - 1, views - 2].map(|k| e.poses[k].clone());
        for pose in &mut last {
            pose.translation *= scale;
        }
        let n = cov.nrows();
        let mut unit = DVector::from_element(n, 1.0);
        let mut grows = DVector::zeros(n);
        let mut tells = DVector::zeros(n);
        for (at, pose) in [0, 6].into_iter().zip(&last) {
            let r = pose.rotation.transpose() * pose.translation;
            for j in 0..3 {
                unit[at + j] = scale;
                grows[at + j] = r[j];
            }
        }
        for (i, y) in points.iter().enumerate() {
            let at = 12 + 3 * i + 2;
            unit[at] = 1.0 / scale;
            grows[at] = -y.z;
            tells[at] = 1.0 / (count as f64 * rho);
        }
        let cov = DMatrix::from_fn(n, n, |i, j| cov[(i, j)] * unit[i] * unit[j]);
        // (1 + grows tells^T) cov (1 + grows tells^T)^T
        let told = &cov * &tells;
        let pull = &told + &grows * (0.5 * tells.dot(&told));
        let covariance = cov + &grows * pull.transpose() + &pull * grows.transpose();
        let known = |i: &usize| {
            let variance = covariance[(12 + 3 * i + 2, 12 + 3 * i + 2)];
            variance.max(0.0).sqrt() <= max_rho_ratio * points[*i].z
        };
        if (0..count).filter(known).count() < least {
            return None;
        }
        Some(Structure {
            last,
            tracks: self.tracks.clone(),
            points,
            covariance,
        })
    }
}

impl Estimate {
    /// Points and motion that are mirrored at the camera look the same: the one with most points before it.
    fn in_front(mut self) -> Self {
        let behind = self.points.iter().filter(|y| y.z < 0.0).count();
        if 2 * behind > self.points.len() {
            for y in &mut self.points {
                y.z = -y.z;
            }
            for pose in &mut self.poses {
                pose.translation = -pose.translation;
            }
        }
        self
    }

    fn direction(&self) -> Vector3<f64> {
        self.poses
            .last()
            .map_or_else(Vector3::zeros, |p| p.translation)
    }
}

/// A point of the first view in another one, times its inverse depth.
fn in_view(pose: &Pose, y: &Vector3<f64>) -> Vector3<f64> {
    pose.rotation.transpose() * (inverse_depth::ray(y.x, y.y) - pose.translation * y.z)
}

/// Best first, one of each direction of motion.
fn keep_distinct(found: &mut Vec<Estimate>) {
    found.sort_by(|a, b| a.cost.total_cmp(&b.cost));
    let mut kept: Vec<Estimate> = Vec::new();
    for e in found.drain(..) {
        if kept
            .iter()
            .all(|other| other.direction().angle(&e.direction()) > SAME)
        {
            kept.push(e);
        }
    }
    *found = kept;
}
