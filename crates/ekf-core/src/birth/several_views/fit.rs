//! Poses and points fitted to the pixels of several views: damped Gauss-Newton with a robust cost.

use super::normal::{Normal, Step};
use crate::camera::Camera;
use crate::math::{inverse_depth, pose::Pose, quat};
use nalgebra::{Matrix3, SMatrix, Vector2, Vector3};

/// A step that lessens the cost by less than this share is the last.
const SETTLED: f64 = 1e-4;
/// Residuals count in full up to so many sigma, and linearly beyond.
const HUBER: f64 = 3.0;
/// A point is wrong if it fits worse than so many times the median residual, and worse than sigma.
const WRONG: f64 = 5.0;

/// Poses of all views, points, and how well they fit.
#[derive(Clone, Debug)]
pub(super) struct Estimate {
    pub poses: Vec<Pose>,
    pub points: Vec<Vector3<f64>>,
    pub cost: f64,
}

/// The views as they are fitted.
pub(super) struct Fit<'a> {
    pub camera: &'a Camera,
    pub sigma: f64,
    pub tracks: Vec<usize>,
    pub pixels: Vec<Vec<Vector2<f64>>>,
    pub rays: Vec<Vec<Vector3<f64>>>,
}

/// Derivative of a pixel by the view's pose and by the point, over sigma.
struct Row {
    residual: Vector2<f64>,
    by_pose: SMatrix<f64, 2, 6>,
    by_point: SMatrix<f64, 2, 3>,
}

impl<'a> Fit<'a> {
    /// None with fewer than two views or a pixel that has no ray.
    pub(super) fn new(
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
    pub(super) fn freedom(&self) -> f64 {
        let (views, points) = (self.pixels.len(), self.tracks.len());
        let free = (2 * views * points) as f64 - (6 * (views - 1) + 3 * points) as f64 + 1.0;
        free.max(1.0)
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
    pub(super) fn settle(&self, guess: Estimate, steps: usize) -> Option<Estimate> {
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
    pub(super) fn normal(&self, e: &Estimate) -> Option<Normal> {
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
    pub(super) fn right(&self, e: &Estimate) -> Vec<usize> {
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
}

/// A point of the first view in another one, times its inverse depth.
fn in_view(pose: &Pose, y: &Vector3<f64>) -> Vector3<f64> {
    pose.rotation.transpose() * (inverse_depth::ray(y.x, y.y) - pose.translation * y.z)
}
