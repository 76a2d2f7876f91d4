//! An earlier submap in sight: consistent where all is as stated, and not taken in by wrong matches.

use crate::scene::{camera, normals, rng};
use ekf_core::EkfError;
use ekf_core::graph::Factor;
use ekf_core::math::pose::Pose;
use ekf_core::submap_pnp::{Landmarks, Noise, SubmapPnp, submap_pnp};
use nalgebra::{DMatrix, Matrix6, SMatrix, Vector2, Vector3, Vector6};
use rand::Rng;
use rand_pcg::Pcg64;

const TRANSFERRED: usize = 7;
const SCALE_SD: f64 = 0.03;
const SIGMA: f64 = 0.7;
const NOISE: Noise = Noise {
    sigma: SIGMA,
    map_drift: 0.0,
};

/// Landmarks whose errors are their own along the ray, and one of the scale; what they are in truth; and a view of them.
struct Case {
    points: Vec<Vector3<f64>>,
    covariance: DMatrix<f64>,
    with_transferred: DMatrix<f64>,
    transferred: DMatrix<f64>,
    truth: Vec<Vector3<f64>>,
    pose: Pose,
    scale: f64,
    matches: Vec<(usize, Vector2<f64>)>,
}

impl Case {
    fn new(rng: &mut Pcg64, count: usize) -> Self {
        Self::drifted(rng, count, 0.0)
    }

    /// The camera sees all of it where it is not: moved, turned, and another size of everything.
    fn drifted(rng: &mut Pcg64, count: usize, map_drift: f64) -> Self {
        let pose = Pose::exp(&Vector6::new(0.4, -0.2, 0.5, 0.05, -0.1, 0.03));
        let scale = SCALE_SD * normals::<1>(rng)[0];
        let off = normals::<7>(rng) * map_drift;
        let [x, y, z] = [0, 1, 2].map(|k| 6.0 * off[k]);
        let seen_from = pose.retract(&Vector6::new(x, y, z, off[3], off[4], off[5]));
        let mut case = Self {
            points: Vec::new(),
            covariance: DMatrix::zeros(3 * count, 3 * count),
            with_transferred: DMatrix::zeros(3 * count, TRANSFERRED),
            transferred: DMatrix::zeros(TRANSFERRED, TRANSFERRED),
            truth: Vec::new(),
            pose,
            scale,
            matches: Vec::new(),
        };
        case.transferred[(0, 0)] = SCALE_SD * SCALE_SD;
        while case.points.len() < count {
            let point = Vector3::new(
                rng.random_range(-2.0..2.0),
                rng.random_range(-1.2..1.2),
                rng.random_range(4.0..8.0),
            );
            let ray = point.normalize();
            // One error by itself, one that all share with the scale.
            let own = 0.1 * normals::<1>(rng)[0];
            let truth = point + ray * own + point * scale;
            let uv = camera().project(&seen_from.inverse().apply(&(truth * (1.0 + off[6]))));
            let Some(uv) = uv.filter(|uv| camera().in_image(uv, 5.0)) else {
                continue;
            };
            case.matches
                .push((case.points.len(), uv + normals::<2>(rng) * SIGMA));
            case.points.push(point);
            case.truth.push(truth);
        }
        case.tell_covariance();
        case
    }

    /// Of points that stand where they are said to, seen with a noise of `sigma` pixels.
    fn of(points: Vec<Vector3<f64>>, rng: &mut Pcg64, sigma: f64) -> Self {
        let mut case = Self::new(rng, points.len());
        let into = case.pose.inverse();
        let pixel = |p: &Vector3<f64>| camera().project(&into.apply(p)).expect("in view");
        let seen = points.iter().map(|p| pixel(p) + normals::<2>(rng) * sigma);
        case.matches = seen.enumerate().collect();
        case.points = points.clone();
        case.truth = points;
        case.tell_covariance();
        case
    }

    fn tell_covariance(&mut self) {
        for (i, a) in self.points.iter().enumerate() {
            for (j, b) in self.points.iter().enumerate() {
                let mut block = a * b.transpose() * (SCALE_SD * SCALE_SD);
                if i == j {
                    let ray = a.normalize();
                    block += ray * ray.transpose() * 0.01 + SMatrix::identity() * 1e-8;
                }
                self.covariance
                    .fixed_view_mut::<3, 3>(3 * i, 3 * j)
                    .copy_from(&block);
            }
            self.with_transferred
                .fixed_view_mut::<3, 1>(3 * i, 0)
                .copy_from(&(a * (SCALE_SD * SCALE_SD)));
        }
    }

    fn landmarks(&self) -> Landmarks<'_> {
        Landmarks {
            points: &self.points,
            covariance: &self.covariance,
            with_transferred: &self.with_transferred,
            transferred: &self.transferred,
        }
    }

    fn pnp(&self, noise: Noise) -> Option<SubmapPnp> {
        let guess = self
            .pose
            .retract(&Vector6::new(0.1, -0.1, 0.1, 0.02, 0.02, -0.02));
        submap_pnp(
            &camera(),
            noise,
            &self.landmarks(),
            &self.matches,
            &guess,
            8,
        )
        .unwrap()
    }

    /// Of the pose, with the scale as known as the filter says it is.
    fn nees(&self, found: &SubmapPnp) -> f64 {
        let mut information = found.information.clone();
        for i in 0..TRANSFERRED {
            information[(6 + i, 6 + i)] += 1.0 / (self.transferred[(i, i)] + 1e-12);
        }
        let p = information.try_inverse().unwrap();
        let p: Matrix6<f64> = p.fixed_view::<6, 6>(0, 0).into_owned();
        let error = found.pose.inverse().compose(&self.pose).log();
        let p = (p + p.transpose()) * 0.5;
        error.dot(&p.cholesky().unwrap().solve(&error))
    }
}

#[test]
fn what_all_matches_share_does_not_average_out() {
    let (draws, map_drift) = (60, 0.01);
    let nees = |noise: Noise| {
        let cases = (0..draws).map(|seed| Case::drifted(&mut rng(seed), 25, map_drift));
        let all = cases.map(|case| case.nees(&case.pnp(noise).unwrap()));
        all.sum::<f64>() / draws as f64
    };
    let consistent = nees(Noise { map_drift, ..NOISE });
    assert!((4.2..7.8).contains(&consistent), "{consistent}");
    let claimed = nees(NOISE);
    assert!(claimed > 20.0, "{claimed}");
}

#[test]
fn it_is_consistent_about_the_pose_and_leaves_the_scale_to_what_knows_it() {
    let (draws, mut nees, mut kept) = (60, 0.0, 0);
    for seed in 0..draws {
        let case = Case::new(&mut rng(seed), 25);
        let found = case.pnp(NOISE).unwrap();
        kept += found.accepted.iter().filter(|a| **a).count();
        nees += case.nees(&found) / draws as f64;
        // Nothing is said of the size of it all: larger by a share, and as much farther away.
        let mut along = SMatrix::<f64, { 6 + TRANSFERRED }, 1>::zeros();
        let back = found.pose.rotation.transpose() * found.pose.translation;
        along.fixed_rows_mut::<3>(0).copy_from(&back);
        along[6] = 1.0;
        let said = (&found.information * along).dot(&along);
        assert!(said * SCALE_SD * SCALE_SD < 0.1, "{said}");
        assert!(Factor::submap_pnp(0, 1, &found.pose, &found.information).is_ok());
        assert!(case.scale.abs() < 5.0 * SCALE_SD && case.truth.len() == 25);
    }
    assert!((4.2..7.8).contains(&nees), "{nees}");
    assert!(kept as f64 > 0.99 * (25 * draws) as f64, "{kept}");
}

#[test]
fn wrong_matches_are_taken_out_and_too_many_of_them_are_no_pose() {
    let mut case = Case::new(&mut rng(7), 24);
    for k in [3, 11, 20] {
        case.matches[k].1 += Vector2::new(25.0, -18.0);
    }
    let found = case.pnp(NOISE).unwrap();
    let out: Vec<usize> = (0..24).filter(|&k| !found.accepted[k]).collect();
    assert_eq!(out, [3, 11, 20]);
    assert!(
        found.chi2 < 80.0 && found.dof == 36,
        "{} {}",
        found.chi2,
        found.dof
    );
    for (k, (_, uv)) in case.matches.iter_mut().enumerate() {
        if k % 2 == 0 {
            *uv += Vector2::new(7.0 * k as f64, 200.0 - 15.0 * k as f64);
        }
    }
    assert!(case.pnp(NOISE).is_none());
    case.matches.truncate(5);
    assert!(case.pnp(NOISE).is_none());
}

/// A wall far away, and two points much nearer: they alone say which part of what the wall shows is a turn, and which a way up or
/// down.
fn wall_and_two(two: [Vector3<f64>; 2], rng: &mut Pcg64) -> Case {
    let mut points: Vec<_> = (0..25)
        .map(|k| Vector3::new(0.5 * (k % 5) as f64 - 1.3, 0.5 * (k / 5) as f64 - 1.0, 7.5))
        .collect();
    points.extend(two);
    Case::of(points, rng, 0.3)
}

#[test]
fn a_pattern_that_repeats_is_not_believed_by_those_alone_that_lie_on_it() {
    let noise = Noise {
        sigma: 1.0,
        map_drift: 0.0,
    };
    let near = Vector3::new(1.1, 0.35, 4.7);
    let close_by = Vector3::new(1.1, 0.45, 4.7);
    let elsewhere = Vector3::new(-1.2, -0.5, 4.7);
    for other in [close_by, elsewhere] {
        let mut case = wall_and_two([near, other], &mut rng(3));
        let consistent = case.nees(&case.pnp(noise).unwrap());
        for k in [25, 26] {
            case.matches[k].1.y += 20.0; // the next one of the same
        }
        let found = case.pnp(noise).unwrap();
        let out: Vec<usize> = (0..27).filter(|&k| !found.accepted[k]).collect();
        assert_eq!(out, [25, 26]);
        let nees = case.nees(&found);
        assert!(nees < 16.8 && consistent < 16.8, "{nees} {consistent}"); // chi-square of six, 99 %
    }
}

#[test]
fn what_makes_no_sense_is_refused() {
    let case = Case::new(&mut rng(1), 10);
    let ask = |landmarks: &Landmarks<'_>, matches: &[(usize, Vector2<f64>)], noise| {
        submap_pnp(&camera(), noise, landmarks, matches, &case.pose, 8)
    };
    let small = DMatrix::zeros(3, 3);
    let wrong = Landmarks {
        covariance: &small,
        ..case.landmarks()
    };
    let found = ask(&wrong, &case.matches, NOISE);
    assert!(matches!(found, Err(EkfError::BadShape { .. })));
    let found = ask(&case.landmarks(), &[(10, Vector2::zeros())], NOISE);
    assert!(matches!(found, Err(EkfError::InvalidInput { .. })));
    let found = ask(&case.landmarks(), &[(0, Vector2::repeat(f64::NAN))], NOISE);
    assert!(matches!(found, Err(EkfError::NonFinite { .. })));
    for (sigma, map_drift) in [(0.0, 0.0), (SIGMA, -0.1), (SIGMA, f64::NAN)] {
        let found = ask(&case.landmarks(), &case.matches, Noise { sigma, map_drift });
        assert!(matches!(found, Err(EkfError::NonFinite { .. })));
    }
}
