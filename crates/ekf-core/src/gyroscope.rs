//! A visual gyroscope (METHOD 27): the camera's turn between two images, from points that were followed from one to the other.
//!
//! It asks nothing of the map. Of the depths only the scene's as a whole is known, of the way what prediction says; both are
//! fitted along with the turn, so that its covariance has what they leave open.

use crate::math::quat;
use nalgebra::{Matrix2, Matrix3, Matrix3x2, SMatrix, SVector, Vector2, Vector3};

/// Fewest points that must agree, and their least share: fewer have been followed by chance, or are on what moves.
const MIN_POINTS: usize = 15;
const MIN_SHARE: f64 = 0.85;
/// Squared distance up to which a point agrees: chi2 with two degrees of freedom, 99 %.
const AGREES: f64 = 9.21;
/// Points that follow each other at these shares of their number give a turn to begin with.
const PAIRED: [f64; 3] = [0.5, 0.37, 0.23];
/// Most pairs tried of each: what many points cost grows with their number, not with its square.
const TRIED: usize = 100;
const STEPS: usize = 30;
const LEAST_DAMPING: f64 = 1e-3;
/// Two rays closer than this, the sine of their angle, say nothing of a roll.
const APART: f64 = 0.05;

/// What is known beside the points.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Surroundings {
    /// Way of the camera along its axes at the first image, metres, and its covariance.
    pub(crate) way: Vector3<f64>,
    pub(crate) way_covariance: Matrix3<f64>,
    /// Inverse ranges of the points, mean and standard deviation, 1/m.
    pub(crate) rho: f64,
    pub(crate) rho_sd: f64,
    /// Standard deviation of a direction, radians.
    pub(crate) sigma: f64,
}

/// The camera's turn between the two images, a rotation vector along its axes, radians.
#[derive(Clone, Debug)]
pub(crate) struct ImageTurn {
    pub(crate) turn: Vector3<f64>,
    pub(crate) covariance: Matrix3<f64>,
    /// Which of the points agree with it.
    pub(crate) agreeing: Vec<usize>,
}

/// Rays of length 1 along which a point was seen in both images.
pub(crate) type Pair = (Vector3<f64>, Vector3<f64>);

/// One point's distance from where it is expected, and its derivatives.
struct Row {
    off: Vector2<f64>,
    information: Matrix2<f64>,
    by: SMatrix<f64, 2, FITTED>,
    /// What the noise's determinant says of the way: information, and its pull on a change of it.
    unspread: (Matrix3<f64>, Vector3<f64>),
}

impl Row {
    fn distance(&self) -> f64 {
        self.off.dot(&(self.information * self.off))
    }
}

/// The turn between two images in which points were seen along `pairs`; `None` where too few agree.
pub(crate) fn seen_turn(pairs: &[Pair], around: &Surroundings) -> Option<ImageTurn> {
    if pairs.len() < MIN_POINTS {
        return None;
    }
    let way_prior = (around.way_covariance + Matrix3::identity() * 1e-10).try_inverse()?;
    let mut prior = Information::zeros();
    prior.fixed_view_mut::<3, 3>(0, 0).copy_from(&way_prior);
    let walls = Matrix3::identity() / around.rho_sd.powi(2);
    prior.fixed_view_mut::<3, 3>(WALL, WALL).copy_from(&walls);
    let mut fit = Fit::new(pairs, begin(pairs, around)?, around, &prior)?;
    let mut damping = 0.0;
    for _ in 0..STEPS {
        let next = fit.guess.stepped(&fit.step(&prior, damping)?);
        match Fit::new(pairs, next, around, &prior) {
            Some(next) if next.cost < fit.cost => (fit, damping) = (next, 0.1 * damping),
            _ => damping = (10.0 * damping).max(LEAST_DAMPING),
        }
    }
    let Fit { guess, rows, .. } = fit;
    let agreeing = rows
        .iter()
        .zip(0..)
        .filter(|(row, _)| row.distance() < AGREES);
    let agreeing: Vec<usize> = agreeing.map(|(_, i)| i).collect();
    if agreeing.len() < MIN_POINTS || (agreeing.len() as f64) < MIN_SHARE * pairs.len() as f64 {
        return None;
    }
    let (information, _) = joined(&rows, &prior, &guess);
    let covariance = information.try_inverse()?;
    let covariance = covariance.fixed_view::<3, 3>(TURN, TURN).into_owned();
    Some(ImageTurn {
        turn: quat::rotation_log(&guess.rotation),
        covariance: (covariance + covariance.transpose()) * 0.5,
        agreeing,
    })
}

/// Numbers that are fitted: by how much the way differs from the predicted one, the turn, and what all depths have in common: on a
/// plane the inverse range is `p . a` along the ray `a`.
const FITTED: usize = 9;
type Parameters = SVector<f64, FITTED>;
type Information = SMatrix<f64, FITTED, FITTED>;

/// Where the turn is among them, and the plane.
const TURN: usize = 3;
const WALL: usize = 6;

/// The numbers so far; the turn is in the rotation.
#[derive(Clone, Debug)]
struct Guess {
    rotation: Matrix3<f64>,
    shift: Parameters,
}

impl Guess {
    fn stepped(&self, step: &Parameters) -> Self {
        let turn = quat::rotation_exp(&step.fixed_rows::<3>(TURN).into_owned());
        let mut shift = self.shift + step;
        shift.fixed_rows_mut::<3>(TURN).fill(0.0);
        Self {
            rotation: self.rotation * turn,
            shift,
        }
    }
}

/// The fit so far.
struct Fit {
    guess: Guess,
    rows: Vec<Row>,
    /// Minus twice the logarithm of how likely the points are, up to a constant. The noise of a point hangs on the way, so its
    /// determinant belongs here: without it the longest way fits best, as it allows every point any place along it.
    cost: f64,
}

impl Fit {
    fn new(
        pairs: &[Pair],
        guess: Guess,
        around: &Surroundings,
        prior: &Information,
    ) -> Option<Self> {
        let rows = rows(pairs, &guess, around)?;
        let of_points = rows.iter().map(|row| {
            let d = row.distance();
            d / (1.0 + d / AGREES) - row.information.determinant().ln()
        });
        let cost = of_points.sum::<f64>() + guess.shift.dot(&(prior * guess.shift));
        Some(Self { guess, rows, cost })
    }

    /// Levenberg's and Marquardt's.
    fn step(&self, prior: &Information, damping: f64) -> Option<Parameters> {
        let (mut information, mut pull) = joined(&self.rows, prior, &self.guess);
        let mut on_way = information.fixed_view_mut::<3, 3>(0, 0);
        let mut pull_on_way = pull.fixed_rows_mut::<3>(0);
        for row in &self.rows {
            on_way += row.unspread.0;
            pull_on_way += row.unspread.1;
        }
        information.set_diagonal(&(information.diagonal() * (1.0 + damping)));
        Some(information.cholesky()?.solve(&pull))
    }
}

/// What the points and a prior say of the parameters: information, and its pull on a change of them.
fn joined(rows: &[Row], prior: &Information, guess: &Guess) -> (Information, Parameters) {
    let (mut information, mut pull) = (*prior, -prior * guess.shift);
    for row in rows {
        let weight = (1.0 + row.distance() / AGREES).powi(-2);
        let weighted = row.by.transpose() * row.information * weight;
        information += weighted * row.by;
        pull += weighted * row.off;
    }
    (information, pull)
}

/// The turn that two of the points give, whichever two explain most of them.
fn begin(pairs: &[Pair], around: &Surroundings) -> Option<Guess> {
    let n = pairs.len();
    let mut best: Option<(f64, Guess)> = None;
    for share in PAIRED {
        let apart = (share * n as f64) as usize;
        for i in (0..n).step_by(n.div_ceil(TRIED)) {
            let Some(rotation) = turn_of_two(&pairs[i], &pairs[(i + apart) % n]) else {
                continue;
            };
            let guess = Guess {
                rotation,
                shift: Parameters::zeros(),
            };
            let Some(rows) = rows(pairs, &guess, around) else {
                continue;
            };
            let cost: f64 = rows.iter().map(|row| row.distance().min(AGREES)).sum();
            if best.as_ref().is_none_or(|(least, _)| cost < *least) {
                best = Some((cost, guess));
            }
        }
    }
    best.map(|(_, guess)| guess)
}

/// The turn that takes two rays of the second image to those of the first, as closely as their angles allow.
fn turn_of_two(one: &Pair, other: &Pair) -> Option<Matrix3<f64>> {
    let axes = |a: &Vector3<f64>, b: &Vector3<f64>| {
        let (along, across) = ((a + b).try_normalize(APART)?, (a - b).try_normalize(APART)?);
        Some(Matrix3::from_columns(&[
            along,
            across,
            along.cross(&across),
        ]))
    };
    Some(axes(&one.0, &other.0)? * axes(&one.1, &other.1)?.transpose())
}

fn rows(pairs: &[Pair], guess: &Guess, around: &Surroundings) -> Option<Vec<Row>> {
    pairs.iter().map(|pair| row(pair, guess, around)).collect()
}

/// Where the second image shows a point, against where it is expected.
fn row((before, now): &Pair, guess: &Guess, around: &Surroundings) -> Option<Row> {
    let back = guess.rotation.transpose();
    let way = around.way + guess.shift.fixed_rows::<3>(0);
    let rho = around.rho + before.dot(&guess.shift.fixed_rows::<3>(WALL));
    let point = back * (before - way * rho);
    let range = point.norm();
    let expected = point.try_normalize(1e-3)?;
    let across = plane(&expected);
    let by_point = across.transpose() / range;
    let by_rho = -by_point * back * way;
    let mut by = SMatrix::<f64, 2, FITTED>::zeros();
    by.fixed_view_mut::<2, 3>(0, 0)
        .copy_from(&(-by_point * back * rho));
    by.fixed_view_mut::<2, 3>(0, TURN)
        .copy_from(&(across.transpose() * quat::skew(&expected)));
    by.fixed_view_mut::<2, 3>(0, WALL)
        .copy_from(&(by_rho * before.transpose()));
    let noise = Matrix2::identity() * around.sigma.powi(2)
        + by_rho * by_rho.transpose() * around.rho_sd.powi(2);
    let off = across.transpose() * (now - expected);
    let unspread = unspread(&off, &by_rho, &(by_point * back), &way, around);
    Some(Row {
        off,
        information: noise.try_inverse()?,
        by,
        unspread,
    })
}

/// What the noise's determinant says of the way, less what the spread that is seen takes away.
fn unspread(
    off: &Vector2<f64>,
    by_rho: &Vector2<f64>,
    by_way: &SMatrix<f64, 2, 3>,
    way: &Vector3<f64>,
    around: &Surroundings,
) -> (Matrix3<f64>, Vector3<f64>) {
    let spread = around.sigma.powi(2) + by_rho.norm_squared() * around.rho_sd.powi(2);
    let along = by_rho
        .try_normalize(1e-12)
        .map_or(0.0, |axis| off.dot(&axis).powi(2));
    let share = (1.0 - along / spread).max(0.0);
    let information = by_way.transpose() * by_way * (around.rho_sd.powi(2) / spread * share);
    (information, -information * way)
}

/// Two axes at right angles to a direction.
fn plane(direction: &Vector3<f64>) -> Matrix3x2<f64> {
    let least = direction.iamin();
    let first = direction.cross(&Vector3::ith(least, 1.0)).normalize();
    Matrix3x2::from_columns(&[first, direction.cross(&first)])
}
