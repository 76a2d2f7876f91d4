//! A visual gyroscope (METHOD 27): the camera's turn between two images, from points that were followed from one to the other.
//!
//! It asks nothing of the map. Of the depths only the scene's as a whole is known, of the way what prediction says; both are
//! fitted along with the turn, so that its covariance has what they leave open.

use crate::math::quat;
use nalgebra::{Matrix2, Matrix3, Matrix3x2, Matrix6, SMatrix, Vector2, Vector3, Vector6};

/// Fewest points that must agree, and their least share: fewer have been followed by chance, or are on what moves.
const MIN_POINTS: usize = 15;
const MIN_SHARE: f64 = 0.85;
/// Squared distance up to which a point agrees: chi2 with two degrees of freedom, 99 %.
const AGREES: f64 = 9.21;
/// Points that follow each other at these shares of their number give a turn to begin with.
const PAIRED: [f64; 3] = [0.5, 0.37, 0.23];
/// Most pairs tried of each: what many points cost grows with their number, not with its square.
const TRIED: usize = 100;
const STEPS: usize = 12;
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
    by: SMatrix<f64, 2, 6>,
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
    let mut guess = begin(pairs, around)?;
    for _ in 0..STEPS {
        let (information, pull) = joined(&rows(pairs, &guess, around)?, &prior, &guess);
        guess.step(&information.cholesky()?.solve(&pull));
    }
    let rows = rows(pairs, &guess, around)?;
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

/// Numbers that are fitted: by how much the way differs from the predicted one, and the turn.
type Parameters = Vector6<f64>;
type Information = Matrix6<f64>;

/// Where the turn is among them.
const TURN: usize = 3;

/// The fit so far; the turn is in the rotation.
#[derive(Clone, Debug)]
struct Guess {
    rotation: Matrix3<f64>,
    shift: Parameters,
}

impl Guess {
    fn step(&mut self, step: &Parameters) {
        self.rotation *= quat::rotation_exp(&step.fixed_rows::<3>(TURN).into_owned());
        self.shift += step;
        self.shift.fixed_rows_mut::<3>(TURN).fill(0.0);
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
    let point = back * (before - way * around.rho);
    let range = point.norm();
    let expected = point.try_normalize(1e-3)?;
    let across = plane(&expected);
    let by_point = across.transpose() / range;
    let by_rho = -by_point * back * way;
    let mut by = SMatrix::<f64, 2, 6>::zeros();
    by.fixed_view_mut::<2, 3>(0, 0)
        .copy_from(&(-by_point * back * around.rho));
    by.fixed_view_mut::<2, 3>(0, TURN)
        .copy_from(&(across.transpose() * quat::skew(&expected)));
    let noise = Matrix2::identity() * around.sigma.powi(2)
        + by_rho * by_rho.transpose() * around.rho_sd.powi(2);
    Some(Row {
        off: across.transpose() * (now - expected),
        information: noise.try_inverse()?,
        by,
    })
}

/// Two axes at right angles to a direction.
fn plane(direction: &Vector3<f64>) -> Matrix3x2<f64> {
    let least = direction.iamin();
    let first = direction.cross(&Vector3::ith(least, 1.0)).normalize();
    Matrix3x2::from_columns(&[first, direction.cross(&first)])
}
