//! Which points of two views may be the same, and which of them look alike (METHOD sections 7 and 9).
//!
//! The relative pose is measured with a covariance: a pair of rays is possible if it passes near the epipolar constraint,
//! in front of both cameras, and at the depth where that is known. Only possible pairs are compared.

use ekf_core::math::pose::Pose;
use ekf_core::math::quat;
use nalgebra::{Matrix3, Matrix6, Vector3};
use pulp::{Arch, Simd, WithSimd};

/// Distance of two descriptors to which a second best one counts at least: what nothing in common looks like.
const UNLIKE: f32 = 1.2;
/// Bilinear forms of a pair of rays: by the rotation, the epipolar constraint, and its change by each error of the pose.
const FORMS: usize = 8;

/// What makes a pair possible.
#[derive(Clone, Debug)]
pub struct Relation<'a> {
    /// `T_CF`.
    pub pose: &'a Pose,
    /// Its covariance over (translation, rotation).
    pub covariance: &'a Matrix6<f64>,
    /// Standard deviations of a pixel of Cs and of Cf, radians.
    pub sigma: [f64; 2],
    /// Radius of the gates in standard deviations.
    pub gate: f64,
}

/// A point of Cs.
#[derive(Clone, Copy, Debug)]
pub struct Point {
    /// Unit ray.
    pub ray: Vector3<f64>,
    /// Least and largest inverse range, 1/m.
    pub range: [f64; 2],
    /// Whether it has one descriptor only, the first, whatever a pair's depth.
    pub known: bool,
}

/// Descriptors, unit vectors, one after the other.
#[derive(Clone, Copy, Debug)]
pub struct Descriptors<'a> {
    /// Numbers of each, a multiple of 32.
    pub length: usize,
    /// Those of the points of Cs, for each of `depths` all points.
    pub of_s: &'a [f32],
    /// Inverse ranges at which they were made, increasing, 1/m.
    pub depths: &'a [f64],
    /// Those of the points of Cf.
    pub of_f: &'a [f32],
}

/// When a match is good.
#[derive(Clone, Copy, Debug)]
pub struct MatchOptions {
    /// Largest ratio of the best to the second best distance.
    pub ratio: f32,
    /// Largest distance.
    pub max_distance: f32,
}

/// Matches, and why other points have none.
#[derive(Clone, Debug, Default)]
pub struct Matches {
    /// Places of the points in their lists, of Cs and Cf.
    pub pairs: Vec<(usize, usize)>,
    /// Points of Cs without a possible partner.
    pub alone: usize,
    /// Points whose best partner is unlike, or hardly more alike than the second best.
    pub indistinct: usize,
    /// Points whose best partner has a better one.
    pub one_sided: usize,
}

/// The best partner of each point of Cs, if it is distinct and the point its best partner as well.
pub fn match_pairs(
    points: &[Point],
    rays_f: &[Vector3<f64>],
    descriptors: &Descriptors<'_>,
    relation: &Relation<'_>,
    options: &MatchOptions,
) -> Option<Matches> {
    let geometry = Geometry::new(rays_f, relation)?;
    let mut best = vec![Best::default(); points.len()];
    Arch::new().dispatch(Compare {
        points,
        geometry: &geometry,
        descriptors,
        best: &mut best,
    });
    let mut of_f: Vec<(f32, usize)> = vec![(f32::NEG_INFINITY, 0); rays_f.len()];
    for (i, best) in best.iter().enumerate() {
        for &(j, alike) in &best.all {
            if alike > of_f[j].0 {
                of_f[j] = (alike, i);
            }
        }
    }
    let mut found = Matches::default();
    let distance = |alike: f32| (2.0 - 2.0 * alike).max(0.0).sqrt();
    for (i, best) in best.iter().enumerate() {
        let Some((j, first, second)) = best.two() else {
            found.alone += 1;
            continue;
        };
        let (near, next) = (distance(first), distance(second).min(UNLIKE));
        if near > options.ratio * next || near > options.max_distance {
            found.indistinct += 1;
        } else if of_f[j].1 != i {
            found.one_sided += 1;
        } else {
            found.pairs.push((i, j));
        }
    }
    Some(found)
}

/// The possible partners of a point, and how alike they are.
#[derive(Clone, Debug, Default)]
struct Best {
    all: Vec<(usize, f32)>,
}

impl Best {
    /// The most alike partner, its similarity and that of the next.
    fn two(&self) -> Option<(usize, f32, f32)> {
        let mut two: Option<(usize, f32, f32)> = None;
        for &(j, alike) in &self.all {
            two = Some(match two {
                None => (j, alike, -1.0),
                Some((_, first, _)) if alike > first => (j, alike, first),
                Some((best, first, second)) => (best, first, second.max(alike)),
            });
        }
        two
    }
}

/// What all pairs share; columns of numbers, so that many pairs are looked at at once.
struct Geometry {
    forms: [Matrix3<f64>; FORMS],
    baseline: Vector3<f64>,
    rays: [Vec<f32>; 3],
    /// `|t x R f|^2`, its inverse, and `t . R f`, of each point of Cf.
    across: Vec<f32>,
    per_across: Vec<f32>,
    along: Vec<f32>,
    /// The gate's radius per range, `gate / |t x R f|`.
    reach: Vec<f32>,
    gate: f32,
    noise: [f32; 2],
    /// Standard deviations of a direction, and of the baseline.
    angle: f32,
    length: f32,
}

impl Geometry {
    /// `None` if the covariance is not positive definite.
    fn new(rays_f: &[Vector3<f64>], relation: &Relation<'_>) -> Option<Self> {
        let Pose {
            rotation,
            translation,
        } = relation.pose;
        let root = relation.covariance.cholesky()?.unpack();
        let cross = quat::skew(translation);
        let epipolar = cross * rotation;
        let mut forms = [*rotation; FORMS];
        forms[1] = epipolar;
        for (k, form) in forms[2..].iter_mut().enumerate() {
            let shift = rotation * root.fixed_view::<3, 1>(0, k);
            let turn = root.fixed_view::<3, 1>(3, k).into_owned();
            *form = quat::skew(&shift) * rotation + epipolar * quat::skew(&turn);
        }
        let largest = |at: usize| {
            let block = relation.covariance.fixed_view::<3, 3>(at, at).into_owned();
            block.symmetric_eigenvalues().max().max(0.0)
        };
        let noise = relation.sigma.map(|s| (s * s) as f32);
        let turned: Vec<Vector3<f64>> = rays_f.iter().map(|ray| rotation * ray).collect();
        let across = turned
            .iter()
            .map(|ray| (cross * ray).norm_squared().max(1e-9) as f32);
        let across: Vec<f32> = across.collect();
        let gate = relation.gate as f32;
        Some(Self {
            forms,
            baseline: *translation,
            rays: [0, 1, 2].map(|k| rays_f.iter().map(|ray| ray[k] as f32).collect()),
            per_across: across.iter().map(|n| 1.0 / n).collect(),
            along: turned.iter().map(|r| r.dot(translation) as f32).collect(),
            reach: across.iter().map(|n| gate / n.sqrt()).collect(),
            across,
            gate,
            noise,
            angle: (largest(3) + 2.0 * relation.sigma[0].powi(2)).sqrt() as f32,
            length: largest(0).sqrt() as f32,
        })
    }

    /// Inverse ranges from Cs at which a point passes all points of Cf, and whether that is possible.
    #[inline(always)]
    fn pass(&self, point: &Point, rho: &mut [f32], possible: &mut [bool]) {
        let n = self.across.len();
        let left = self.forms.map(|form| {
            let row = form.tr_mul(&point.ray);
            [row.x as f32, row.y as f32, row.z as f32]
        });
        let n_s = point.ray.cross(&self.baseline).norm_squared().max(1e-9) as f32;
        let along_s = point.ray.dot(&self.baseline) as f32;
        let (per_s, reach_s) = (1.0 / n_s, self.gate / n_s.sqrt());
        let [low, high] = point.range.map(|r| r as f32);
        let [x, y, z] = [0, 1, 2].map(|k| &self.rays[k][..n]);
        let (across, per_across) = (&self.across[..n], &self.per_across[..n]);
        let (along, reach) = (&self.along[..n], &self.reach[..n]);
        let (rho, possible) = (&mut rho[..n], &mut possible[..n]);
        let limit = self.gate * self.gate;
        for j in 0..n {
            let form = |k: usize| left[k][0] * x[j] + left[k][1] * y[j] + left[k][2] * z[j];
            let (turned, value) = (form(0), form(1));
            let square = value * value;
            let mut variance =
                (across[j] - square) * self.noise[0] + (n_s - square) * self.noise[1];
            for k in 2..FORMS {
                let change = form(k);
                variance += change * change;
            }
            let from_s = (along_s - turned * along[j]) * per_across[j];
            let from_f = (along_s * turned - along[j]) * per_s;
            let slack = (self.angle + self.length * from_s.abs()) * reach[j];
            let slack_f = (self.angle + self.length * from_f.abs()) * reach_s;
            rho[j] = from_s;
            possible[j] = (square <= limit * variance)
                & (from_s >= low - slack)
                & (from_s <= high + slack)
                & (from_f >= -slack_f);
        }
    }
}

/// Similarity of all possible pairs.
struct Compare<'a> {
    points: &'a [Point],
    geometry: &'a Geometry,
    descriptors: &'a Descriptors<'a>,
    best: &'a mut [Best],
}

impl WithSimd for Compare<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        let count = self.geometry.across.len();
        let (mut rho, mut possible) = (vec![0.0; count], vec![false; count]);
        let &Descriptors {
            length,
            of_s,
            depths,
            of_f,
        } = self.descriptors;
        for (i, (point, best)) in self.points.iter().zip(self.best).enumerate() {
            self.geometry.pass(point, &mut rho, &mut possible);
            for j in (0..count).filter(|&j| possible[j]) {
                // The descriptor of the nearest depth.
                let between = |pair: &&[f64]| f64::from(rho[j]) > 0.5 * (pair[0] + pair[1]);
                let level = match point.known {
                    true => 0,
                    false => depths.windows(2).take_while(between).count(),
                };
                let own = &of_s[(level * self.points.len() + i) * length..][..length];
                best.all.push((j, dot(own, &of_f[j * length..][..length])));
            }
        }
    }
}

/// The same sum in the same order, however wide the registers are.
#[inline(always)]
fn dot(a: &[f32], b: &[f32]) -> f32 {
    let mut sums = [0.0_f32; 32];
    let ((a, _), (b, _)) = (a.as_chunks::<32>(), b.as_chunks::<32>());
    for (a, b) in a.iter().zip(b) {
        for k in 0..32 {
            sums[k] += a[k] * b[k];
        }
    }
    for width in [16, 8, 4, 2, 1] {
        for k in 0..width {
            sums[k] += sums[k + width];
        }
    }
    sums[0]
}
