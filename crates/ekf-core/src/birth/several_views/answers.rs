//! Answers that fit the views, from several first guesses of the direction of motion, and whether there is but one.

use super::STEPS;
use super::fit::{Estimate, Fit};
use crate::math::{inverse_depth, pose::Pose};
use nalgebra::{Matrix3, Vector3};

/// Answers whose directions of motion differ by less, radians, are one.
const SAME: f64 = 0.1;
/// Inverse depth of all points in a first guess; the baseline is one.
const FIRST_RHO: f64 = 0.2;

impl Fit<'_> {
    /// The best fit, and the next best that is another.
    pub(super) fn answers(&self) -> (Option<Estimate>, Option<Estimate>) {
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
        let turned = two.turn();
        let mut found: Vec<Estimate> = Vec::new();
        for direction in ahead.iter().chain(&aslant) {
            let settled = turned.and_then(|turn| two.settle(two.guess(turn, direction), STEPS.0));
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
    fn guess(&self, turn: Matrix3<f64>, direction: &[f64; 3]) -> Estimate {
        let moved = Pose {
            rotation: turn,
            translation: Vector3::from(*direction),
        };
        Estimate {
            poses: vec![Pose::identity(), moved],
            points: self.straight(FIRST_RHO),
            cost: f64::INFINITY,
        }
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

    /// The rotation of the last view in the first that turns its rays best into those of the first.
    fn turn(&self) -> Option<Matrix3<f64>> {
        let pairs = self.rays[0].iter().zip(self.rays.last()?);
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
