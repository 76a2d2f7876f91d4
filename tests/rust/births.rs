//! Covariances of births and of triangulated points against Monte Carlo, and when births wait.

use crate::scene::{Warm, name, normal, normals, rng, warm, worn_covariance};
use ekf_core::birth::two_view::TwoView;
use ekf_core::map::CandidateOutcome;
use ekf_core::math::{inverse_depth, pose::Pose, quat};
use ekf_core::observe::point::CameraPose;
use ekf_core::settings::Value;
use ekf_core::state::BlockKind;
use ekf_core::{Camera, Filter, Outcome, WornObservation, WornPair};
use nalgebra::{DMatrix, DVector, Matrix6, Vector2, Vector6};
use rand_pcg::Pcg64;
use std::collections::BTreeMap;

const SAMPLES: usize = 20_000;

/// Small enough errors of T_CF that births are linear in them: a quarter of Table C1.
fn small_worn_covariance() -> Matrix6<f64> {
    worn_covariance() / 16.0
}

/// Draws from a Gaussian whose covariance may be singular.
struct Gaussian {
    mean: DVector<f64>,
    root: DMatrix<f64>,
}

impl Gaussian {
    /// Entries `indices` of the filter's state.
    fn of(filter: &Filter, indices: &[usize]) -> Self {
        let (x, p) = (filter.state().mean(), filter.state().covariance());
        let n = indices.len();
        let own = DMatrix::from_fn(n, n, |i, j| p.get(indices[i], indices[j]));
        let eigen = own.symmetric_eigen();
        let scale = eigen.eigenvalues.map(|v| v.max(0.0).sqrt());
        Self {
            mean: DVector::from_fn(n, |i, _| x[indices[i]]),
            root: eigen.eigenvectors * DMatrix::from_diagonal(&scale),
        }
    }

    fn draw(&self, rng: &mut Pcg64) -> DVector<f64> {
        let white = DVector::from_fn(self.mean.len(), |_, _| normal(rng));
        &self.mean + &self.root * white
    }
}

fn pose_of(x: &DVector<f64>, at: usize) -> CameraPose {
    let q: quat::Quat = x.fixed_rows::<4>(at + 3).into_owned();
    CameraPose {
        r: x.fixed_rows::<3>(at).into_owned(),
        q: q / q.norm(),
    }
}

/// Eq. 8's mean, written out: the anchor at the camera, the angles of the ray in W, the inverse range.
fn feature_of(pose: &CameraPose, view: &TwoView) -> Vector6<f64> {
    let (angles, _) = inverse_depth::angles(&(quat::rotation(&pose.q) * view.ray));
    Vector6::new(
        pose.r.x, pose.r.y, pose.r.z, angles[0], angles[1], view.rho,
    )
}

/// Sample covariance against `p`: standard deviations within `share`, correlations within 0.04.
fn compare(what: &str, samples: &[DVector<f64>], p: &DMatrix<f64>, share: f64) {
    let n = p.nrows();
    let mean = samples.iter().sum::<DVector<f64>>() / samples.len() as f64;
    let mut found = DMatrix::<f64>::zeros(n, n);
    for s in samples {
        let d = s - &mean;
        found.ger(1.0 / (samples.len() - 1) as f64, &d, &d, 1.0);
    }
    for i in 0..n {
        let ratio = (p[(i, i)] / found[(i, i)]).sqrt();
        assert!(
            (ratio - 1.0).abs() < share,
            "{what}: sd {i} is {ratio} of the sampled one"
        );
        for j in 0..i {
            let correlation = |m: &DMatrix<f64>| m[(i, j)] / (m[(i, i)] * m[(j, j)]).sqrt();
            let (stated, sampled) = (correlation(p), correlation(&found));
            assert!(
                (stated - sampled).abs() < 0.04,
                "{what}: correlation {i}, {j} is {stated}, sampled {sampled}"
            );
        }
    }
}

fn part(filter: &Filter, indices: &[usize]) -> DMatrix<f64> {
    let p = filter.state().covariance();
    let n = indices.len();
    DMatrix::from_fn(n, n, |i, j| p.get(indices[i], indices[j]))
}

fn indices_of(filter: &Filter, id: u64) -> Vec<usize> {
    filter.state().layout().find(id).expect("in the map").range().collect()
}

/// Pairs of new points at moderate parallax, the camera's pose known from bearings of the old ones.
fn instant(errors: &str) -> (Warm, WornObservation, Vec<u64>) {
    let changes = [
        ("estimator.mode", name("collab-init")),
        ("worn.errors", name(errors)),
    ];
    let mut warm = warm(21, &changes);
    warm.scene.worn_covariance = small_worn_covariance();
    let (mut z, _) = warm.scene.measure(warm.t, &warm.known, false);
    let (all, _) = warm.scene.measure(warm.t, &BTreeMap::new(), true);
    let mut worn = all.worn.expect("a worn frame");
    let camera = &warm.scene.camera;
    worn.pairs.retain(|pair| {
        TwoView::new(camera, &pair.uv, camera, &pair.uv_f, &worn.t_cf)
            .is_some_and(|view| view.parallax > 5.0_f64.to_radians())
    });
    worn.pairs.truncate(4);
    z.worn = Some(worn.clone());
    let report = warm.filter.update(&z).expect("good measurements");
    let born: Vec<u64> = report
        .pairs
        .iter()
        .filter_map(|o| match o {
            Outcome::Born(id) => Some(*id),
            _ => None,
        })
        .collect();
    assert_eq!(born.len(), 4);
    (warm, worn, born)
}

#[test]
fn instant_births_share_the_error_of_the_worn_camera() {
    let (warm, worn, born) = instant("shared");
    let filter = &warm.filter;
    // The camera's pose and an old feature, jointly; then the births.
    let old = *warm.known.keys().next().expect("an old feature");
    let mut given: Vec<usize> = (0..7).collect();
    given.extend(indices_of(filter, old));
    let gaussian = Gaussian::of(filter, &given);
    let chol = worn.covariance.cholesky().expect("positive definite").l();
    let camera = &warm.scene.camera;
    let mut rng = rng(22);
    let samples: Vec<DVector<f64>> = (0..SAMPLES)
        .map(|_| {
            let x = gaussian.draw(&mut rng);
            let pose = pose_of(&x, 0);
            let t_cf = worn.t_cf.retract(&(chol * normals::<6>(&mut rng)));
            let mut out: Vec<f64> = x.rows(7, 6).iter().copied().collect();
            for WornPair { uv, uv_f, .. } in &worn.pairs {
                let (uv, uv_f) = (uv + normals::<2>(&mut rng), uv_f + normals::<2>(&mut rng));
                let view = TwoView::new(camera, &uv, camera, &uv_f, &t_cf).expect("rays meet");
                out.extend(feature_of(&pose, &view).iter());
            }
            DVector::from_vec(out)
        })
        .collect();
    let mut listed = indices_of(filter, old);
    for &id in &born {
        listed.extend(indices_of(filter, id));
    }
    compare("instant", &samples, &part(filter, &listed), 0.04);
    let rho = |k: usize| indices_of(filter, born[k])[5];
    let p = filter.state().covariance();
    let correlation = p.get(rho(0), rho(1)) / (p.get(rho(0), rho(0)) * p.get(rho(1), rho(1))).sqrt();
    assert!(correlation > 0.3, "shared T_CF: correlation {correlation}");
}

#[test]
fn independent_births_claim_to_share_nothing() {
    let (warm, _, born) = instant("independent");
    let (shared, ..) = instant("shared");
    let rho = |k: usize| indices_of(&warm.filter, born[k])[5];
    let p = warm.filter.state().covariance();
    assert_eq!(p.get(rho(0), rho(1)), 0.0);
    // One birth by itself is the same in both.
    let q = shared.filter.state().covariance();
    let same = shared.filter.state().layout().blocks().len();
    assert!(same >= 4 && q.get(6, 6) > 0.0);
    assert!(p.get(rho(0), rho(0)) > 0.0);
}

#[test]
fn triangulated_points() {
    let (warm, worn, _) = instant("shared");
    let camera = &warm.scene.camera;
    let chol = worn.covariance.cholesky().expect("positive definite").l();
    let mut rng = rng(23);
    let (sigma, sigma_f) = (0.8, 1.3);
    for pair in &worn.pairs {
        let at = |uv: &Vector2<f64>, uv_f: &Vector2<f64>, t_cf: &Pose| {
            TwoView::new(camera, uv, camera, uv_f, t_cf).expect("rays meet")
        };
        let view = at(&pair.uv, &pair.uv_f, &worn.t_cf);
        let j = view.point_by_tangent();
        let stated = view.point_noise(sigma, sigma_f) + j * worn.covariance * j.transpose();
        let range = 1.0 / view.rho;
        let mut draw = |linear: bool| -> Vec<DVector<f64>> {
            (0..SAMPLES)
                .map(|_| {
                    let uv = pair.uv + normals::<2>(&mut rng) * sigma;
                    let uv_f = pair.uv_f + normals::<2>(&mut rng) * sigma_f;
                    let sample = at(&uv, &uv_f, &worn.t_cf.retract(&(chol * normals::<6>(&mut rng))));
                    let sample = if linear { sample.at_range(range) } else { sample };
                    DVector::from_column_slice(sample.point().as_slice())
                })
                .collect()
        };
        let stated = DMatrix::from_column_slice(3, 3, stated.as_slice());
        compare("point", &draw(false), &stated, 0.06);
        compare("point at a given range", &draw(true), &stated, 0.04);
    }
}

/// Candidates at fixed points, then two seconds of motion.
fn delayed(changes: &[(&str, Value)]) -> (Warm, Vec<(u64, usize)>) {
    let mut warm = warm(24, changes);
    warm.update(false);
    let pose = warm.scene.pose(warm.t);
    let mut points = Vec::new();
    let mut pixels = Vec::new();
    for point in 0..warm.scene.points.len() {
        let near = warm.scene.points[point].z < 6.0;
        if let (true, Some(uv)) = (near, warm.scene.pixel(&pose, point)) {
            points.push(point);
            pixels.push(uv);
        }
    }
    let ids = warm.filter.add_candidates(&pixels).expect("started");
    let candidates = ids.into_iter().zip(points).collect();
    for _ in 0..20 {
        warm.next_frame();
        warm.update(false);
    }
    (warm, candidates)
}

fn see(warm: &mut Warm, candidates: &[(u64, usize)]) -> Vec<(u64, Vector2<f64>)> {
    let pose = warm.scene.pose(warm.t);
    candidates
        .iter()
        .filter_map(|&(id, point)| Some((id, warm.scene.pixel(&pose, point)?)))
        .collect()
}

fn first_in_c(now: &CameraPose, first: &CameraPose) -> Pose {
    let r_cw = quat::rotation(&now.q).transpose();
    Pose {
        rotation: r_cw * quat::rotation(&first.q),
        translation: r_cw * (first.r - now.r),
    }
}

#[test]
fn delayed_births_depend_on_both_poses() {
    let (mut warm, candidates) = delayed(&[("birth.min_parallax", Value::Float(2.0))]);
    let seen = see(&mut warm, &candidates);
    let clone = warm.filter.state().layout().of_kind(BlockKind::Clone).next().copied();
    let clone = clone.expect("one clone for all candidates");
    let mut given: Vec<usize> = (0..7).collect();
    given.extend(clone.range());
    let gaussian = Gaussian::of(&warm.filter, &given);
    let first_pixels: BTreeMap<u64, Vector2<f64>> = {
        // What the filter noted of the first view: re-simulated from the same seed.
        let (twin, _) = delayed(&[("birth.min_parallax", Value::Float(2.0))]);
        assert_eq!(twin.filter.state().mean(), warm.filter.state().mean());
        warm.filter.candidate_pixels().collect()
    };
    let outcomes = warm.filter.observe_candidates(&seen).expect("candidates");
    let camera = warm.scene.camera.clone();
    let mut rng = rng(25);
    let mut tested = 0;
    for ((candidate, uv), outcome) in seen.iter().zip(&outcomes) {
        let CandidateOutcome::Born(id) = outcome else {
            continue;
        };
        tested += 1;
        if tested > 4 {
            break;
        }
        let samples: Vec<DVector<f64>> = (0..SAMPLES)
            .map(|_| {
                let x = gaussian.draw(&mut rng);
                let (now, first) = (pose_of(&x, 0), pose_of(&x, 7));
                let uv = uv + normals::<2>(&mut rng);
                let uv_first = first_pixels[candidate] + normals::<2>(&mut rng);
                let view = two_view(&camera, &uv, &uv_first, &first_in_c(&now, &first));
                let mut out = x.as_slice().to_vec();
                out.extend(feature_of(&now, &view).iter());
                DVector::from_vec(out)
            })
            .collect();
        let mut listed = given.clone();
        listed.extend(indices_of(&warm.filter, *id));
        compare("delayed", &samples, &part(&warm.filter, &listed), 0.06);
    }
    assert!(tested >= 2, "{outcomes:?}");
}

fn two_view(camera: &Camera, uv: &Vector2<f64>, first: &Vector2<f64>, pose: &Pose) -> TwoView {
    TwoView::new(camera, uv, camera, first, pose).expect("rays meet")
}
