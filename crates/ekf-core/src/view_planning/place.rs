//! What Cf can tell from one place, by direction.

use super::known::{Known, Wanted, WantedWith};
use super::matching::{at_least, probability};
use crate::camera::Camera;
use crate::math::quat;
use crate::observe::shutter::down_the_image;
use faer::dyn_stack::{MemBuffer, MemStack};
use faer::linalg::cholesky::llt::factor;
use faer::linalg::triangular_solve::solve_lower_triangular_in_place;
use faer::{MatMut, MatRef, Par, Spec};
use nalgebra::{DMatrix, Matrix2x3, Matrix3, Matrix6, SMatrix, Vector3, Vector6};

/// What is known better than this, in radians, shares of the scene's range, and of the scale, counts as known: what a
/// twentieth of a pixel is in most cameras.
const KNOWN: f64 = 1e-4;

/// The points as seen from a place of Cf, `from[i] = point - place`, with what the error of T_CF adds to their covariance.
pub(crate) struct Place {
    from: Vec<Vector3<f64>>,
    /// Probability of each point's match, if it is in the image.
    matched: Vec<f64>,
    /// Joint covariance of the points as they appear from Cf, along the axes of C; the blocks on and below the diagonal.
    covariance: DMatrix<f64>,
    /// Covariance of what is wanted with each.
    wanted_with: Vec<WantedWith<3>>,
    wanted: Wanted,
}

/// A point in the image of Cf.
struct Pixel {
    index: usize,
    by_point: Matrix2x3<f64>,
    /// How far down the image its row is, -1/2 to 1/2.
    row: f64,
    matched: f64,
}

/// What a direction is expected to give.
pub(crate) struct Expected {
    /// Matches.
    pub(crate) matches: f64,
    /// Gain, nats.
    pub(crate) gain: f64,
}

impl Place {
    /// Cf at `place`, in C. A small error `(v, w)` of T_CF, along the axes of C, moves a point at `x` from Cf by
    /// `-v + [x]_x w` as Cf sees it: all points share it.
    pub(crate) fn new(known: &Known, place: &Vector3<f64>) -> Self {
        let from: Vec<Vector3<f64>> = known.points.iter().map(|p| p - place).collect();
        let by_error: Vec<SMatrix<f64, 3, 6>> = from.iter().map(by_error).collect();
        let mut covariance = known.covariance.clone();
        for j in 0..from.len() {
            let shared: SMatrix<f64, 6, 3> = known.error * by_error[j].transpose();
            let other = known.with_error[j].transpose();
            for i in j..from.len() {
                let added = (known.with_error[i] * by_error[j].transpose())
                    + by_error[i] * (other + shared);
                let mut block = covariance.fixed_view_mut::<3, 3>(3 * i, 3 * j);
                block += added;
            }
        }
        let wanted_with = known.wanted_with_points.iter().zip(&by_error);
        let wanted_with = wanted_with
            .map(|(with, by)| with + known.wanted_with_error * by.transpose())
            .collect();
        let (_, range) = known.middle();
        let mut wanted = known.wanted;
        for i in 0..wanted.nrows() {
            let unit = if i < 3 { range } else { 1.0 };
            wanted[(i, i)] += (KNOWN * unit).powi(2);
        }
        Self {
            matched: known
                .points
                .iter()
                .zip(&from)
                .map(|(p, x)| probability(p, x))
                .collect(),
            from,
            covariance,
            wanted_with,
            wanted,
        }
    }

    /// The matches to be expected of Cf with this attitude in C.
    pub(crate) fn matches(&self, camera: &Camera, attitude: &Matrix3<f64>) -> f64 {
        self.pixels(camera, attitude)
            .map(|pixel| pixel.matched)
            .sum()
    }

    /// What Cf with this attitude in C would give: pixels of `sigma` in it, a view of fewer than `least` matches being of no
    /// use, and of a camera that moves by so much, `[v w]` (standard deviations, metres and radians), while its image is read. A
    /// match of probability p tells the share p of what a certain one does.
    pub(crate) fn expected(
        &self,
        camera: &Camera,
        attitude: &Matrix3<f64>,
        (sigma, roll): (f64, &Vector6<f64>),
        least: f64,
    ) -> Expected {
        let pixels: Vec<Pixel> = self.pixels(camera, attitude).collect();
        let matches: f64 = pixels.iter().map(|pixel| pixel.matched).sum();
        let variance: f64 = pixels.iter().map(|p| p.matched * (1.0 - p.matched)).sum();
        let gain = self.told(&pixels, sigma, roll).unwrap_or(0.0);
        Expected {
            matches,
            gain: gain * at_least(least, matches, variance),
        }
    }

    fn pixels<'a>(
        &'a self,
        camera: &'a Camera,
        attitude: &Matrix3<f64>,
    ) -> impl Iterator<Item = Pixel> + 'a {
        let to_f = attitude.transpose();
        self.from.iter().enumerate().filter_map(move |(index, x)| {
            let (uv, j) = camera.project_jac(&(to_f * x))?;
            camera.in_image(&uv, 0.0).then(|| Pixel {
                index,
                by_point: j * to_f,
                row: down_the_image(&uv, f64::from(camera.height)),
                matched: self.matched[index],
            })
        })
    }

    /// By how much these pixels lower `ln det / 2` of what is wanted; `None` if S or what is left is not positive definite.
    fn told(&self, pixels: &[Pixel], sigma: f64, roll: &Vector6<f64>) -> Option<f64> {
        let m = 2 * pixels.len();
        let roll = Matrix6::from_diagonal(roll);
        let by_roll =
            |pixel: &Pixel| pixel.by_point * by_error(&self.from[pixel.index]) * roll * pixel.row;
        let by_roll: Vec<SMatrix<f64, 2, 6>> = pixels.iter().map(by_roll).collect();
        let mut s = vec![0.0; m * m];
        let mut with = vec![0.0; m * self.wanted.nrows()];
        for (b, at) in pixels.iter().enumerate() {
            for (a, of) in pixels.iter().enumerate().skip(b) {
                let (i, j) = (3 * of.index, 3 * at.index);
                let points = self.covariance.fixed_view::<3, 3>(i, j);
                let block = of.by_point * points * at.by_point.transpose()
                    + by_roll[a] * by_roll[b].transpose();
                for r in 0..2 {
                    for c in 0..2 {
                        s[2 * a + r + (2 * b + c) * m] = block[(r, c)];
                    }
                }
            }
            let wanted = at.by_point * self.wanted_with[at.index].transpose();
            for r in 0..2 {
                s[2 * b + r + (2 * b + r) * m] += sigma * sigma / at.matched;
                for c in 0..self.wanted.nrows() {
                    with[2 * b + r + c * m] = wanted[(r, c)];
                }
            }
        }
        factor(&mut s, m)?;
        solve_lower_triangular_in_place(
            MatRef::from_column_major_slice(&s, m, m),
            MatMut::from_column_major_slice_mut(&mut with, m, self.wanted.nrows()),
            Par::Seq,
        );
        let column = |c: usize| &with[c * m..(c + 1) * m];
        let told = Wanted::from_fn(|r, c| dot(column(r), column(c)));
        let left = log_det(self.wanted - told)?;
        Some((0.5 * (log_det(self.wanted)? - left)).max(0.0))
    }
}

fn by_error(x: &Vector3<f64>) -> SMatrix<f64, 3, 6> {
    let mut out = SMatrix::<f64, 3, 6>::zeros();
    out.fixed_view_mut::<3, 3>(0, 0)
        .copy_from(&-Matrix3::identity());
    out.fixed_view_mut::<3, 3>(0, 3).copy_from(&quat::skew(x));
    out
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

/// `ln det` of a positive definite matrix, scaled to a unit diagonal first.
fn log_det(a: Wanted) -> Option<f64> {
    let scale = a.diagonal().map(f64::sqrt);
    let unit = Wanted::from_fn(|r, c| a[(r, c)] / (scale[r] * scale[c]));
    let l = unit.cholesky()?.unpack();
    let sum: f64 = (0..l.nrows()).map(|i| (l[(i, i)] * scale[i]).ln()).sum();
    sum.is_finite().then_some(2.0 * sum)
}

/// Cholesky factor of the lower triangle, in place; `None` if it is not positive definite.
fn factor(s: &mut [f64], m: usize) -> Option<()> {
    if m == 0 {
        return Some(());
    }
    let params: Spec<factor::LltParams, f64> = Spec::default();
    let mut memory = MemBuffer::new(factor::cholesky_in_place_scratch::<f64>(
        m,
        Par::Seq,
        params,
    ));
    factor::cholesky_in_place(
        MatMut::from_column_major_slice_mut(s, m, m),
        Default::default(),
        Par::Seq,
        MemStack::new(&mut memory),
        params,
    )
    .ok()
    .map(|_| ())
}
