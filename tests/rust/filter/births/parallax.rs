//! Covariances of births and of triangulated points against Monte Carlo, and when births wait.

use crate::scene::{DT, Scene, Warm, name, normal, normals, rng, settings, warm, worn_covariance};
use ekf_core::CandidateOutcome;
use ekf_core::birth::held::{Held, held};
use ekf_core::birth::two_view::TwoView;
use ekf_core::camera::Camera;
use ekf_core::math::{inverse_depth, pose::Pose, quat};
use ekf_core::observe::point::CameraPose;
use ekf_core::settings::Value;
use ekf_core::state::BlockKind;
use ekf_core::{Filter, MeasurementOutcome, WornObservation, WornPair};
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
    Vector6::new(pose.r.x, pose.r.y, pose.r.z, angles[0], angles[1], view.rho)
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
    filter
        .state()
        .layout()
        .find(id)
        .expect("in the map")
        .range()
        .collect()
}

/// Pairs of new points at moderate parallax, the camera's pose known from bearings of the old ones.
fn instant(errors: &str) -> (Warm, WornObservation, Vec<u64>) {
    let changes = [
        ("estimator.mode", name("collab-init")),
        ("worn.errors", name(errors)),
        ("worn.readout", Value::Float(0.02)),
    ];
    let mut warm = warm(21, &changes);
    warm.scene.worn_covariance = small_worn_covariance();
    let (mut z, _) = warm.scene.measure(warm.t, &warm.known, false);
    let (all, _) = warm.scene.measure(warm.t, &BTreeMap::new(), true);
    let mut worn = all.views[0].clone();
    let camera = &warm.scene.camera;
    worn.pairs.retain(|pair| {
        let uv = pair.uv.expect("a new point");
        TwoView::new(camera, &uv, camera, &pair.uv_f, &worn.t_cf)
            .is_some_and(|view| view.parallax > 5.0_f64.to_radians())
    });
    worn.pairs.truncate(4);
    z.views = vec![worn.clone()];
    let report = warm.filter.update(&z).expect("good measurements");
    let born: Vec<u64> = report.views[0]
        .iter()
        .filter_map(|o| match o {
            MeasurementOutcome::Born(id) => Some(*id),
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
    // The camera's pose and an old feature (its anchor is exact), jointly; then the births.
    let old = *warm.known.keys().next().expect("an old feature");
    let mut given: Vec<usize> = (0..7).collect();
    given.extend(&indices_of(filter, old)[3..]);
    let gaussian = Gaussian::of(filter, &given);
    let chol = worn.covariance.cholesky().expect("positive definite").l();
    let camera = &warm.scene.camera;
    let mut rng = rng(22);
    let samples: Vec<DVector<f64>> = (0..SAMPLES)
        .map(|_| {
            let x = gaussian.draw(&mut rng);
            let pose = pose_of(&x, 0);
            let error = chol * normals::<6>(&mut rng);
            // 1 m/s and 1 rad/s while the image is read.
            let roll = normals::<6>(&mut rng) * filter.settings().worn.readout;
            let mut out: Vec<f64> = x.rows(7, 3).iter().copied().collect();
            for WornPair { uv, uv_f, .. } in &worn.pairs {
                let uv = uv.expect("a new point") + normals::<2>(&mut rng);
                let row = uv_f.y / f64::from(camera.height) - 0.5;
                let t_cf = worn.t_cf.retract(&(error + roll * row));
                let uv_f = uv_f + normals::<2>(&mut rng);
                let view = TwoView::new(camera, &uv, camera, &uv_f, &t_cf).expect("rays meet");
                out.extend(feature_of(&pose, &view).iter());
            }
            DVector::from_vec(out)
        })
        .collect();
    let mut listed = indices_of(filter, old)[3..].to_vec();
    for &id in &born {
        listed.extend(indices_of(filter, id));
    }
    compare("instant", &samples, &part(filter, &listed), 0.04);
    let rho = |k: usize| indices_of(filter, born[k])[5];
    let p = filter.state().covariance();
    let correlation =
        p.get(rho(0), rho(1)) / (p.get(rho(0), rho(0)) * p.get(rho(1), rho(1))).sqrt();
    assert!(correlation > 0.3, "shared T_CF: correlation {correlation}");
}

#[test]
fn independent_births_claim_to_share_nothing() {
    let (warm, _, born) = instant("independent");
    let rho = |k: usize| indices_of(&warm.filter, born[k])[5];
    let p = warm.filter.state().covariance();
    assert!(p.get(rho(0), rho(0)) > 0.0);
    assert_eq!(p.get(rho(0), rho(1)), 0.0);
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
        let pair_uv = pair.uv.expect("a new point");
        let view = at(&pair_uv, &pair.uv_f, &worn.t_cf);
        let j = view.point_by_tangent();
        let stated = view.point_noise(sigma, sigma_f) + j * worn.covariance * j.transpose();
        let mut draw = |linear: bool| -> Vec<DVector<f64>> {
            (0..SAMPLES)
                .map(|_| {
                    let uv = pair_uv + normals::<2>(&mut rng) * sigma;
                    let uv_f = pair.uv_f + normals::<2>(&mut rng) * sigma_f;
                    let sample = at(
                        &uv,
                        &uv_f,
                        &worn.t_cf.retract(&(chol * normals::<6>(&mut rng))),
                    );
                    let sample = if linear {
                        sample.at_point(&view.point())
                    } else {
                        sample
                    };
                    DVector::from_column_slice(sample.point().as_slice())
                })
                .collect()
        };
        let stated = DMatrix::from_column_slice(3, 3, stated.as_slice());
        compare("point", &draw(false), &stated, 0.06);
        compare("point at a given range", &draw(true), &stated, 0.04);
    }
}

/// A candidate: its id, its point and its first pixel.
type Tracked = (u64, usize, Vector2<f64>);

/// Candidates at the nearer points, then `frames` of motion.
fn delayed(changes: &[(&str, Value)], frames: usize) -> (Warm, Vec<Tracked>) {
    let mut warm = warm(24, changes);
    warm.update(false);
    let pose = warm.scene.pose(warm.t);
    let near = (0..warm.scene.points.len()).filter(|&p| warm.scene.points[p].z < 6.0);
    let near: Vec<usize> = near.collect();
    let seen: Vec<(usize, Vector2<f64>)> = near
        .into_iter()
        .filter_map(|p| Some((p, warm.scene.pixel(&pose, p)?)))
        .collect();
    let pixels: Vec<Vector2<f64>> = seen.iter().map(|(_, uv)| *uv).collect();
    let ids = warm.filter.add_candidates(&pixels).expect("started");
    let tracked = ids
        .iter()
        .zip(&seen)
        .map(|(&id, &(point, uv))| (id, point, uv));
    let tracked = tracked.collect();
    for _ in 0..frames {
        warm.next_frame();
        warm.update(false);
    }
    (warm, tracked)
}

/// The candidates in the present view, with their pixels.
fn see(warm: &mut Warm, tracked: &[Tracked]) -> Vec<(u64, Vector2<f64>)> {
    let pose = warm.scene.pose(warm.t);
    tracked
        .iter()
        .filter_map(|&(id, point, _)| Some((id, warm.scene.pixel(&pose, point)?)))
        .collect()
}

fn clones(filter: &Filter) -> usize {
    filter.state().layout().of_kind(BlockKind::Clone).count()
}

fn first_in_c(now: &CameraPose, first: &CameraPose) -> Pose {
    let r_cw = quat::rotation(&now.q).transpose();
    Pose {
        rotation: r_cw * quat::rotation(&first.q),
        translation: r_cw * (first.r - now.r),
    }
}

#[test]
fn a_promoted_candidate_is_the_undelayed_feature_of_its_first_view() {
    for first_pose in ["clone", "independent"] {
        let first_pose = Value::Name(first_pose.into());
        let changes = [
            ("birth.first_pose", first_pose.clone()),
            ("lost.min_matches", Value::Int(1000)), // so that the map does not tell a depth
            ("birth.undelayed_rho", Value::Float(0.1)),
            ("birth.undelayed_rho_sd", Value::Float(0.2)),
        ];
        let mut warm = warm(26, &changes);
        warm.update(false);
        let pixels = [Vector2::new(150.0, 120.0), Vector2::new(260.0, 200.0)];
        let (mut patient, mut eager) = (warm.filter.clone(), warm.filter.clone());
        let waiting = patient.add_candidates(&pixels).expect("started");
        let born = eager.add_undelayed(&pixels).expect("pixels");
        for filter in [&mut patient, &mut eager] {
            filter.predict(warm.t + 0.1).expect("time goes on");
        }
        assert!(
            patient
                .promote_candidates(&[waiting[0], 77], false)
                .is_err()
        );
        let promoted = patient
            .promote_candidates(&waiting, false)
            .expect("candidates");
        assert_eq!(patient.candidate_ids().count(), 0);
        let rows = |filter: &Filter, ids: &[Option<u64>]| -> Vec<usize> {
            let own = ids
                .iter()
                .flat_map(|id| indices_of(filter, id.expect("born")));
            own.chain(0..13).collect()
        };
        let (a, b) = (rows(&patient, &promoted), rows(&eager, &born));
        let (p, q) = (patient.state().covariance(), eager.state().covariance());
        for (i, (&ia, &ib)) in a.iter().zip(&b).enumerate() {
            assert!((patient.state().mean()[ia] - eager.state().mean()[ib]).abs() < 1e-12);
            for (j, (&ja, &jb)) in a.iter().zip(&b).enumerate() {
                // A first pose that is only noted has nothing in common with the rest.
                let apart = i / 6 != j / 6 && i.min(j) < 12;
                let expected = match &first_pose {
                    Value::Name(kind) if apart && kind == "independent" => 0.0,
                    _ => q.get(ib, jb),
                };
                let scale = (q.get(ib, ib) * q.get(jb, jb)).sqrt();
                assert!((p.get(ia, ja) - expected).abs() < 1e-10 * scale, "{i} {j}");
            }
        }
    }
}

/// However many guesses there are, their mean is known to the share that they have in common.
#[test]
fn vague_depths_that_are_alike_tell_little_of_the_scale() {
    let of_mean = |alike: bool| {
        let mut warm = warm(26, &[]);
        warm.update(false);
        let pixels: Vec<_> = (0..8)
            .map(|k| Vector2::new(60.0 + 25.0 * f64::from(k), 120.0))
            .collect();
        let candidates = warm.filter.add_candidates(&pixels).expect("started");
        let [some, others] = [&candidates[..3], &candidates[3..]];
        let mut born = warm
            .filter
            .promote_candidates(some, alike)
            .expect("candidates");
        warm.next_frame();
        born.extend(
            warm.filter
                .promote_candidates(others, alike)
                .expect("candidates"),
        );
        let state = warm.filter.state();
        let at: Vec<usize> = born
            .into_iter()
            .map(|id| {
                state
                    .layout()
                    .find(id.expect("born"))
                    .expect("in the state")
                    .offset
                    + 5
            })
            .collect();
        let n = at.len() as f64;
        let p = state.covariance();
        let sum: f64 = at
            .iter()
            .flat_map(|&i| at.iter().map(move |&j| p.get(i, j)))
            .sum();
        let own: f64 = at.iter().map(|&i| p.get(i, i)).sum();
        warm.filter.check().expect("sound");
        (sum / (n * n)).sqrt() / (own / n).sqrt()
    };
    let [alike, apart] = [true, false].map(of_mean);
    assert!((0.6..0.8).contains(&alike), "{alike}");
    assert!((0.3..0.4).contains(&apart), "{apart}");
}

#[test]
fn a_vague_depth_is_that_of_the_scene_in_any_unit() {
    let mut warm = warm(26, &[]);
    warm.update(false);
    let candidates = warm.filter.add_candidates(&[Vector2::new(150.0, 120.0)]);
    let camera = warm.filter.pose().1;
    let ranges = warm.filter.landmarks();
    let mut inverse: Vec<f64> = ranges
        .iter()
        .filter(|l| l.rho_ratio < warm.filter.settings().birth.max_rho_ratio)
        .map(|l| 1.0 / (l.point - camera).norm())
        .collect();
    inverse.sort_unstable_by(f64::total_cmp);
    let median = inverse[inverse.len() / 2];
    let born = warm
        .filter
        .promote_candidates(&candidates.expect("started"), false);
    let id = born.expect("a candidate")[0].expect("born");
    let block = *warm.filter.state().layout().find(id).expect("in the state");
    let rho = warm.filter.state().mean()[block.offset + 5];
    let at = block.offset + 5;
    let sd = warm.filter.state().covariance().get(at, at).sqrt();
    assert!((rho - 0.5 * median).abs() < 1e-9 * median, "{rho} {median}");
    // With what the median itself may err by.
    assert!((0.5..0.51).contains(&(sd / median)), "{sd} {median}");
    assert!(rho > 0.05); // the points are 3 to 9 m off: not the 0.1 +- 0.2 of an open field
}

#[test]
fn delayed_births_depend_on_both_poses() {
    let (mut warm, tracked) = delayed(&[("birth.min_parallax", Value::Float(2.0))], 20);
    let seen = see(&mut warm, &tracked);
    let clone = warm
        .filter
        .state()
        .layout()
        .of_kind(BlockKind::Clone)
        .next();
    let clone = *clone.expect("one clone for all candidates");
    let old = *warm.known.keys().next().expect("an old feature");
    let mut given: Vec<usize> = (0..7).collect();
    given.extend(clone.range());
    given.extend(&indices_of(&warm.filter, old)[3..]);
    let gaussian = Gaussian::of(&warm.filter, &given);
    let outcomes = warm.filter.observe_candidates(&seen).expect("candidates");
    let camera = warm.scene.camera.clone();
    let mut rng = rng(25);
    let mut tested = 0;
    for ((candidate, uv), outcome) in seen.iter().zip(&outcomes) {
        let CandidateOutcome::Born(id) = outcome else {
            continue;
        };
        tested += 1;
        if tested > 3 {
            break;
        }
        let first_uv = tracked
            .iter()
            .find(|c| c.0 == *candidate)
            .expect("tracked")
            .2;
        let samples: Vec<DVector<f64>> = (0..SAMPLES)
            .map(|_| {
                let x = gaussian.draw(&mut rng);
                let (now, first) = (pose_of(&x, 0), pose_of(&x, 7));
                let uv = uv + normals::<2>(&mut rng);
                let uv_first = first_uv + normals::<2>(&mut rng);
                let in_c = first_in_c(&now, &first);
                let view = TwoView::new(&camera, &uv, &camera, &uv_first, &in_c);
                let born = feature_of(&now, &view.expect("rays meet"));
                let mut out = x.rows(14, 3).as_slice().to_vec();
                out.extend(x.rows(7, 3).iter());
                out.extend(born.iter());
                DVector::from_vec(out)
            })
            .collect();
        let mut listed = indices_of(&warm.filter, old)[3..].to_vec();
        listed.extend(clone.range().take(3));
        listed.extend(indices_of(&warm.filter, *id));
        compare("delayed", &samples, &part(&warm.filter, &listed), 0.06);
    }
    assert_eq!(tested.min(3), 3, "{outcomes:?}");
}

#[test]
fn independent_first_pose_needs_no_clone() {
    let changes = [
        ("birth.first_pose", name("independent")),
        ("birth.min_parallax", Value::Float(2.0)),
    ];
    let (mut warm, tracked) = delayed(&changes, 20);
    assert_eq!(clones(&warm.filter), 0);
    let (twin, _) = delayed(&changes[1..], 20);
    assert_eq!(clones(&twin.filter), 1);
    let seen = see(&mut warm, &tracked);
    let outcomes = warm.filter.observe_candidates(&seen).expect("candidates");
    let mut twin = twin;
    let cloned = twin.filter.observe_candidates(&seen).expect("candidates");
    // The same geometry; only the stated covariance differs, as the common error of both poses counts as baseline.
    let mut born = 0;
    for (a, b) in outcomes.iter().zip(&cloned) {
        if let (CandidateOutcome::Born(a), CandidateOutcome::Born(b)) = (a, b) {
            let sd = |filter: &Filter, id: u64| {
                let i = indices_of(filter, id)[5];
                filter.state().covariance().get(i, i).sqrt()
            };
            let (independent, exact) = (sd(&warm.filter, *a), sd(&twin.filter, *b));
            assert!(independent > 1.02 * exact, "{independent} and {exact}");
            born += 1;
        }
    }
    assert!(born >= 3, "{outcomes:?}");
}

#[test]
fn births_wait_for_parallax_and_the_clone_waits_with_them() {
    let (mut warm, tracked) = delayed(&[("birth.min_parallax", Value::Float(4.0))], 1);
    let size = warm.filter.map_size();
    let seen = see(&mut warm, &tracked);
    let outcomes = warm.filter.observe_candidates(&seen).expect("candidates");
    assert!(outcomes.iter().all(CandidateOutcome::waits), "{outcomes:?}");
    assert_eq!(warm.filter.map_size(), size);
    assert_eq!(warm.filter.candidate_count(), tracked.len());
    for _ in 0..19 {
        warm.next_frame();
        warm.update(false);
    }
    let seen = see(&mut warm, &tracked);
    let outcomes = warm.filter.observe_candidates(&seen).expect("candidates");
    let born = outcomes
        .iter()
        .filter(|o| matches!(o, CandidateOutcome::Born(_)))
        .count();
    assert!(born >= 3);
    assert_eq!(warm.filter.map_size(), size + born);
    // One candidate keeps the clone alive; without any it goes.
    let keep = seen.iter().zip(&outcomes).find(|(_, o)| o.waits());
    let keep = keep.expect("a far one waits").0.0;
    let others: Vec<u64> = warm
        .filter
        .candidate_ids()
        .filter(|id| *id != keep)
        .collect();
    warm.filter.drop_candidates(&others);
    warm.filter.manage_map(&[]);
    assert_eq!(
        (warm.filter.candidate_count(), clones(&warm.filter)),
        (1, 1)
    );
    let dim = warm.filter.state().mean().len();
    warm.filter.drop_candidates(&[keep]);
    warm.filter.manage_map(&[]);
    assert_eq!(
        (warm.filter.candidate_count(), clones(&warm.filter)),
        (0, 0)
    );
    assert_eq!(warm.filter.state().mean().len(), dim - 7);
}

/// The rays of a wrong match pass each other: its candidate is dropped, where a right one with a poor pixel is born.
#[test]
fn a_match_off_the_plane_of_both_views_is_no_birth() {
    let parallax = [("birth.min_parallax", Value::Float(2.0))];
    // The camera moves sideways, so what is up and down in the image is off the plane. The gate is 11 px.
    let outcomes = |up: f64| {
        let (mut warm, tracked) = delayed(&parallax, 20);
        let mut seen = see(&mut warm, &tracked);
        seen.iter_mut().for_each(|(_, uv)| uv.y -= up);
        let size = warm.filter.map_size();
        let outcomes = warm.filter.observe_candidates(&seen).expect("candidates");
        (outcomes, warm.filter.map_size() - size)
    };
    let (right, born) = outcomes(0.0);
    let is_born = |o: &CandidateOutcome| matches!(o, CandidateOutcome::Born(_));
    assert_eq!(right.iter().filter(|o| is_born(o)).count(), born);
    assert!(born >= 3, "{right:?}");
    for up in [-4.0, 4.0] {
        assert_eq!(outcomes(up).1, born, "{up} px is within the noise");
    }
    for up in [-24.0, 24.0] {
        let (wrong, none) = outcomes(up);
        assert_eq!(none, 0, "{wrong:?}");
        for (right, wrong) in right.iter().zip(&wrong) {
            let off_arc = matches!(wrong, CandidateOutcome::OffArc(by) if *by > 1.0);
            assert!(!is_born(right) || off_arc, "{up} px: {wrong:?}");
        }
    }
}

/// What moves by itself against the parallax never has any: it is dropped as soon as no point at rest would be there, and does not
/// wait until the view runs out of features. The camera moves sideways, so a point at rest moves one way only.
#[test]
fn what_moves_against_the_parallax_does_not_wait() {
    let outcomes = |back: f64| {
        let (mut warm, tracked) = delayed(&[], 20);
        let (then, now) = (warm.scene.pose(warm.t - 20.0 * DT), warm.scene.pose(warm.t));
        let turned = now.rotation.transpose() * then.rotation;
        let camera = warm.scene.camera.clone();
        let there = see(&mut warm, &tracked);
        let moved = there.iter().map(|&(id, uv)| {
            let (_, _, first) = tracked.iter().find(|t| t.0 == id).expect("tracked");
            let ray = turned * camera.unproject(first).expect("in the image");
            let far = camera.project(&ray).expect("in front");
            (id, far - (uv - far) * back)
        });
        let seen: Vec<_> = moved.collect();
        let size = warm.filter.map_size();
        let outcomes = warm.filter.observe_candidates(&seen).expect("candidates");
        assert_eq!(warm.filter.map_size(), size, "{outcomes:?}");
        outcomes
    };
    let against = outcomes(1.0);
    assert!(against.len() >= 3);
    let off_arc = |o: &CandidateOutcome| matches!(o, CandidateOutcome::OffArc(by) if *by > 1.0);
    assert!(against.iter().all(off_arc), "{against:?}");
    // A little of it is noise.
    let little = outcomes(0.02);
    assert!(little.iter().all(CandidateOutcome::waits), "{little:?}");
}

/// A point that is in its place in the image though the camera has turned is fixed to it, or may be: no birth either way.
#[test]
fn what_is_fixed_to_the_camera_is_no_birth() {
    let (mut warm, tracked) = delayed(&[], 20);
    let (size, count) = (warm.filter.map_size(), tracked.len());
    let mut still: Vec<(u64, Vector2<f64>)> = tracked.iter().map(|t| (t.0, t.2)).collect();
    // Noise of a pixel is not a motion.
    still.iter_mut().for_each(|(_, uv)| uv.x += 0.9);
    let outcomes = warm.filter.observe_candidates(&still).expect("candidates");
    let is = |outcome| outcomes.iter().filter(|o| **o == outcome).count();
    let (held, fixed) = (is(CandidateOutcome::Held), is(CandidateOutcome::Fixed));
    assert_eq!(warm.filter.map_size(), size, "{outcomes:?}");
    assert!(held + fixed > 0, "{outcomes:?}");
    assert_eq!(warm.filter.candidate_count(), count - fixed);
}

/// What has not moved in the image yet may be fixed to the camera, whether or not the camera has turned.
#[test]
fn what_stands_in_the_image_is_held() {
    let mut warm = warm(24, &[]);
    warm.update(false);
    let first = [Vector2::new(150.0, 120.0), Vector2::new(260.0, 200.0)];
    let ids = warm.filter.add_candidates(&first).expect("started");
    warm.next_frame();
    warm.update(false);
    let seen = [
        (ids[0], first[0] + Vector2::new(4.0, -3.0)),
        (ids[1], first[1] + Vector2::new(5.0, -3.0)),
    ];
    let outcomes = warm.filter.observe_candidates(&seen).expect("candidates");
    assert_eq!(
        outcomes,
        [CandidateOutcome::Held, CandidateOutcome::Waiting]
    );
}

/// Where a point at rest can be, from infinity to the place of the first view, and where none can.
#[test]
fn a_point_is_fixed_to_the_camera_where_no_distance_explains_it() {
    let intrinsics = [500.0, 500.0, 320.0, 240.0];
    let camera = Camera::new("pinhole", 640, 480, intrinsics, &[]).expect("camera");
    let (sigma, gate) = (1.0, 8.0 / 500.0);
    let at = |px: f64, x: f64, z: f64, uv: (f64, f64), moved: f64| {
        let first_in_c = Pose {
            rotation: *nalgebra::Rotation3::from_euler_angles(0.0, px / 500.0, 0.0).matrix(),
            translation: nalgebra::Vector3::new(x, 0.0, z),
        };
        let first = Vector2::new(uv.0, uv.1);
        let now = Vector2::new(uv.0 + moved, uv.1);
        held(&camera, &now, &first, &first_in_c, sigma, gate)
    };
    let middle = (320.0, 240.0);
    // Without a turn it may be far; one of 20 px moves a far point to the right, and near ones further towards the first view.
    assert_eq!(at(0.0, -0.2, 0.0, middle, 0.0), Some(Held::Perhaps));
    // A turn by less than the gate gives what stands in the image a parallax all the same.
    assert_eq!(at(7.0, -0.2, 0.0, middle, 0.0), Some(Held::Perhaps));
    assert_eq!(at(7.0, 0.2, 0.0, middle, 0.0), Some(Held::Perhaps));
    assert_eq!(at(20.0, -0.2, 0.0, middle, 0.0), Some(Held::Perhaps));
    assert_eq!(at(20.0, 0.2, 0.0, middle, 0.0), Some(Held::RigFixed));
    // Straight ahead, beside the way: nearer points move outwards, away from the middle.
    assert_eq!(
        at(20.0, 0.0, -0.2, (520.0, 240.0), 0.0),
        Some(Held::RigFixed)
    );
    assert_eq!(
        at(20.0, 0.0, -0.2, (120.0, 240.0), 0.0),
        Some(Held::Perhaps)
    );
    assert_eq!(
        at(20.0, 0.0, -0.2, (320.0, 40.0), 0.0),
        Some(Held::RigFixed)
    );
    // On the spot nobody can tell; what moves by more than its noise is not held.
    assert_eq!(at(20.0, 0.0, 0.0, middle, 0.0), Some(Held::Perhaps));
    assert_eq!(at(20.0, 0.2, 0.0, middle, 1.1), None);
}

/// What is still vague after its pixel in Cf was measured waits for a better view.
#[test]
fn a_tight_birth_of_vague_depth_is_taken_back() {
    let start = |largest: f64, covariance: Matrix6<f64>| {
        let changes = [
            ("estimator.mode", name("collab-tight")),
            ("birth.max_rho_ratio", Value::Float(largest)),
            ("worn.start_births", Value::Int(1)),
        ];
        let mut scene = Scene::new(21, 60);
        scene.worn_covariance = covariance;
        let mut filter = scene.filter(settings(&changes));
        filter.predict(0.0).expect("first frame");
        let (z, _) = scene.measure(0.0, &BTreeMap::new(), true);
        let report = filter.update(&z).expect("good measurements");
        (filter, report.views.concat())
    };
    // What all births share, the error of T_CF, does not count: a T_CF that is exact leaves what is each one's own.
    let (all, outcomes) = start(10.0, worn_covariance() * 1e-8);
    let ratio = |outcome: &MeasurementOutcome| match outcome {
        MeasurementOutcome::Born(id) => {
            let rho = indices_of(&all, *id)[5];
            let variance = all.state().covariance().get(rho, rho);
            Some(variance.sqrt() / all.state().mean()[rho])
        }
        _ => None,
    };
    let ratios: Vec<f64> = outcomes.iter().filter_map(ratio).collect();
    assert!(ratios.len() >= 20, "{outcomes:?}");
    let mut sorted = ratios.clone();
    sorted.sort_by(f64::total_cmp);
    let middle = ratios.len() / 2;
    let largest = 0.5 * (sorted[middle - 1] + sorted[middle]);
    let (_, judged) = start(largest, worn_covariance());
    let (mut kept, mut vague) = (0, 0);
    for (before, after) in outcomes.iter().zip(&judged) {
        let Some(ratio) = ratio(before) else { continue };
        let is_vague = *after == MeasurementOutcome::TooUncertain;
        // The pixels of all of them tell T_CF, so that the point that it is judged at is a little elsewhere.
        if (ratio / largest).ln().abs() > 0.2 {
            assert_eq!(ratio > largest, is_vague, "{ratio} {largest}");
            kept += usize::from(!is_vague);
            vague += usize::from(is_vague);
        }
    }
    assert!(kept > 3 && vague > 3, "{kept} {vague}");
}

#[test]
fn undelayed_births_take_the_prior_on_depth() {
    let mut warm = warm(26, &[("estimator.mode", name("mono-undelayed"))]);
    warm.update(false);
    let gaussian = Gaussian::of(&warm.filter, &[0, 1, 2, 3, 4, 5, 6]);
    let pixels = [Vector2::new(150.0, 90.0), Vector2::new(600.0, 300.0)];
    let ids = warm.filter.add_undelayed(&pixels).expect("finite pixels");
    let birth = warm.filter.settings().birth.clone();
    let camera = &warm.scene.camera;
    let mut rng = rng(27);
    let samples: Vec<DVector<f64>> = (0..SAMPLES)
        .map(|_| {
            let pose = pose_of(&gaussian.draw(&mut rng), 0);
            let mut out = Vec::new();
            for uv in &pixels {
                let (ray, _) = camera
                    .unproject_jac(&(uv + normals::<2>(&mut rng)))
                    .expect("in the image");
                let (angles, _) = inverse_depth::angles(&(quat::rotation(&pose.q) * ray));
                let rho = birth.undelayed_rho + birth.undelayed_rho_sd * normal(&mut rng);
                out.extend(pose.r.iter().chain(angles.iter()));
                out.push(rho);
            }
            DVector::from_vec(out)
        })
        .collect();
    let mut listed = Vec::new();
    for id in ids {
        listed.extend(indices_of(&warm.filter, id.expect("visible")));
    }
    // Both anchors are the same position.
    compare("undelayed", &samples, &part(&warm.filter, &listed), 0.04);
}
