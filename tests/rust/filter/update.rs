//! The batch update against a textbook dense EKF, its failures, and what it does with outliers.

use crate::scene::{DT, Scene, Warm, name, settings, warm};
use ekf_core::birth::two_view::TwoView;
use ekf_core::observe::{PointInCamera, Rows};
use ekf_core::settings::{Settings, Value};
use ekf_core::state::{BlockKind, ErrorOwner};
use ekf_core::{
    Bearing, DepthObservation, EkfError, Filter, MeasurementOutcome, Measurements, UpdateReport,
    WornObservation,
};
use nalgebra::{DMatrix, DVector, Matrix3, Matrix6, SMatrix, Vector2, Vector3, Vector4, Vector6};
use std::collections::BTreeMap;

/// A warm filter with two candidates in its state, so one clone, predicted to the next frame.
pub(crate) fn with_clone(seed: u64, changes: &[(&str, Value)]) -> Warm {
    let mut warm = warm(seed, changes);
    let pixels = [Vector2::new(300.0, 200.0), Vector2::new(420.0, 260.0)];
    warm.filter.add_candidates(&pixels).expect("started");
    warm.next_frame();
    warm
}

/// Measurements of the present frame; worn pairs of known features only, so that nothing is born. Views say what lasts of their
/// errors, so that no overlap begins with another one.
pub(crate) fn measure(warm: &mut Warm, with_worn: bool) -> Measurements {
    let (mut z, _) = warm.scene.measure(warm.t, &warm.known, with_worn);
    let share = warm.filter.settings().worn.bias_share;
    for worn in &mut z.views {
        worn.pairs.retain(|p| p.id.is_some());
        worn.bias = Some(worn.covariance * share);
    }
    z
}

/// Mean and covariance as plain dense matrices, the frame's error of T_CF at the end where there is one.
#[derive(Clone)]
pub(crate) struct Dense {
    pub(crate) x: DVector<f64>,
    pub(crate) p: DMatrix<f64>,
    worn: Option<usize>,
    /// Where the error of the calibration is.
    calibration: Option<usize>,
    /// Blocks that are considered and not estimated, the calibration's error and the worn camera's bias, each with what its
    /// gain is multiplied by.
    considered: Vec<(usize, Matrix6<f64>)>,
}

impl Dense {
    pub(crate) fn of(filter: &Filter, worn: Option<&WornObservation>) -> Self {
        let x = DVector::from_column_slice(filter.state().mean());
        let p = filter.state().covariance().to_dense();
        let n = x.len();
        let find = |kind| filter.state().layout().of_kind(kind).next();
        let calibration = find(BlockKind::Calibration).map(|b| b.offset);
        let Some(worn) = worn else {
            return Self {
                x,
                p,
                worn: None,
                calibration,
                considered: nothing_of(calibration).collect(),
            };
        };
        // The frame's error is the bias, if there is one, plus white noise; the camera's motion during the readout follows.
        let mut grow = DMatrix::<f64>::identity(n + 12, n);
        let bias = find(BlockKind::WornBias(ErrorOwner::Of(0)));
        if let Some(bias) = bias {
            for i in 0..6 {
                for k in 0..3 {
                    let at = i / 3 * 3;
                    grow[(n + i, bias.offset + at + k)] = worn.t_cf.rotation[(k, i - at)];
                }
            }
        }
        let white = worn.covariance * (1.0 - filter.settings().worn.bias_share);
        let mut p = &grow * p * grow.transpose();
        for c in 0..6 {
            for r in 0..6 {
                p[(n + r, n + c)] += white[(r, c)];
            }
            // 1 m/s and 1 rad/s.
            p[(n + 6 + c, n + 6 + c)] += filter.settings().worn.readout.powi(2);
        }
        // All but the length of the baseline, along which it is where the bias puts it.
        let x = grow * x;
        let t_cf = worn.t_cf.retract(&x.fixed_rows::<6>(n).into_owned());
        let along = t_cf.translation.normalize();
        let mut learned = Matrix6::identity();
        let mut shift = learned.fixed_view_mut::<3, 3>(0, 0);
        shift -= along * along.transpose();
        let bias = bias.map(|b| (b.offset, learned));
        Self {
            x,
            p,
            worn: Some(n),
            calibration,
            considered: nothing_of(calibration).chain(bias).collect(),
        }
    }

    fn error(&self) -> Vector6<f64> {
        self.worn
            .map_or(Vector6::zeros(), |w| self.x.fixed_rows::<6>(w).into_owned())
    }

    /// The textbook update, in Joseph's form, which holds for any gain; returns `1 - K H`.
    pub(crate) fn update(&mut self, units: &[(Rows, usize, Option<usize>)]) -> DMatrix<f64> {
        let n = self.x.len();
        let m: usize = units.iter().map(|(rows, _, _)| rows.count).sum();
        let mut h = DMatrix::<f64>::zeros(m, n);
        let mut r = DMatrix::<f64>::zeros(m, m);
        let mut g = DVector::<f64>::zeros(m);
        let mut at = 0;
        for (rows, feature, shared) in units {
            for i in 0..rows.count {
                g[at + i] = rows.innovation[i];
                for c in 0..7 {
                    h[(at + i, c)] = rows.by_pose[(i, c)];
                }
                for c in 0..6 {
                    h[(at + i, feature + c)] = rows.by_feature[(i, c)];
                    if let (Some(by), Some(shared)) = (&rows.by_shared, shared) {
                        h[(at + i, shared + c)] = by[(i, c)];
                        if let Some(share) = rows.roll {
                            h[(at + i, shared + 6 + c)] = by[(i, c)] * share;
                        }
                    }
                }
                for c in 0..rows.count {
                    r[(at + i, at + c)] = rows.noise[(i, c)];
                }
            }
            at += rows.count;
        }
        let pht = &self.p * h.transpose();
        let s = &h * &pht + &r;
        let s = s.cholesky().expect("S is positive definite");
        let mut gain = &pht * s.inverse();
        for (at, learned) in &self.considered {
            let rows = learned * gain.rows(*at, 6);
            gain.rows_mut(*at, 6).copy_from(&rows);
        }
        self.x += &gain * g;
        let left = DMatrix::identity(n, n) - &gain * h;
        self.p = &left * &self.p * left.transpose() + &gain * r * gain.transpose();
        left
    }

    /// The quaternions of the camera and the clones normalised, P through the Jacobian.
    pub(crate) fn normalise(&mut self, quaternions: &[usize]) {
        let n = self.x.len();
        for &offset in quaternions {
            let q: Vector4<f64> = self.x.fixed_rows::<4>(offset).into_owned();
            let norm = q.norm();
            let mut j = DMatrix::<f64>::identity(n, n);
            let own = (SMatrix::<f64, 4, 4>::identity() - q * q.transpose() / (norm * norm)) / norm;
            j.fixed_view_mut::<4, 4>(offset, offset).copy_from(&own);
            self.p = &j * &self.p * j.transpose();
            self.x.fixed_rows_mut::<4>(offset).copy_from(&(q / norm));
        }
    }

    /// Against the filter after its update, in units of the standard deviations before it.
    pub(crate) fn compare(&self, filter: &Filter, before: &Filter) {
        let (x, p) = (filter.state().mean(), filter.state().covariance());
        assert!(x.len() <= self.x.len() && x.len() == p.dim());
        let prior = before.state().covariance();
        let sd = |i: usize| prior.get(i, i).sqrt();
        for i in 0..x.len() {
            let off = (x[i] - self.x[i]).abs();
            assert!(off <= 1e-9 * sd(i), "mean {i} is off by {off:e}");
            for j in 0..x.len() {
                // The anchors of the start are exact: both sides are zero there.
                let scale = (sd(i) * sd(j)).max(1e-30);
                let off = (p.get(i, j) - self.p[(i, j)]).abs() / scale;
                assert!(
                    off < 1e-9,
                    "P[{i},{j}] is off by {off:e} standard deviations"
                );
            }
        }
    }
}

/// A block of which nothing is learned.
fn nothing_of(block: Option<usize>) -> impl Iterator<Item = (usize, Matrix6<f64>)> {
    block.map(|at| (at, Matrix6::zeros())).into_iter()
}

pub(crate) fn quaternions(filter: &Filter) -> Vec<usize> {
    let clones = filter.state().layout().of_kind(BlockKind::Clone);
    let mut offsets: Vec<usize> = clones.map(|b| b.offset + 3).collect();
    assert!(!offsets.is_empty(), "the warm filter holds a clone");
    offsets.push(3);
    offsets
}

/// A depth along the axis as a point in C with its covariance, differentiated numerically.
fn point_at_depth(
    scene: &Scene,
    depth: &DepthObservation,
    sigma_px: f64,
) -> (Vector3<f64>, Matrix3<f64>) {
    let at = |du: f64, dv: f64| -> Vector3<f64> {
        let uv = depth.uv + Vector2::new(du, dv);
        let (ray, _) = scene.camera.unproject_jac(&uv).expect("in the image");
        ray * (depth.depth / ray.z)
    };
    let h = 0.05;
    let difference = |du: f64, dv: f64| {
        (at(-2.0 * du, -2.0 * dv) - at(2.0 * du, 2.0 * dv) + (at(du, dv) - at(-du, -dv)) * 8.0)
            / (12.0 * h)
    };
    let by_uv = SMatrix::<f64, 3, 2>::from_columns(&[difference(h, 0.0), difference(0.0, h)]);
    let point = at(0.0, 0.0);
    let along = point / depth.depth;
    let noise = by_uv * by_uv.transpose() * sigma_px.powi(2)
        + along * along.transpose() * depth.sigma.powi(2);
    (point, noise)
}

/// Rows, where their feature is, and where the six numbers are that they share.
type Unit = (Rows, usize, Option<usize>);

/// The rows of the accepted measurements, each built from the prior mean.
pub(crate) fn units(
    warm: &Warm,
    before: &Filter,
    dense: &Dense,
    z: &Measurements,
    report: &UpdateReport,
) -> Vec<(Rows, usize, Option<usize>)> {
    let state = before.state();
    let pose = state.camera_pose();
    let pixel = &before.settings().pixel;
    let camera = &warm.scene.camera;
    let feature = |id: u64| {
        let block = state.layout().find(id).expect("in the map");
        (state.feature(block), block.offset)
    };
    let mut units = Vec::new();
    for (bearing, outcome) in z.bearings.iter().zip(&report.bearings) {
        if *outcome == MeasurementOutcome::Pixel {
            let (y, offset) = feature(bearing.id);
            let rows = Rows::bearing(camera, &pose, &y, &bearing.uv, pixel.sigma_cs, None);
            units.push((rows.expect("visible"), offset, dense.calibration));
        }
    }
    for (depth, outcome) in z.depths.iter().zip(&report.depths) {
        assert_eq!(*outcome, MeasurementOutcome::Depth);
        let (y, offset) = feature(depth.id.expect("known"));
        let (point, noise) = point_at_depth(&warm.scene, depth, pixel.sigma_cs);
        let rows = Rows::depth(&pose, &y, &point, &noise, None);
        units.push((rows.expect("rho > 0"), offset, None));
    }
    let Some(worn) = z.views.first() else {
        return units;
    };
    let error = dense.error();
    for (pair, outcome) in worn.pairs.iter().zip(&report.views[0]) {
        let (y, offset) = feature(pair.id.expect("known"));
        let rows = match outcome {
            MeasurementOutcome::Pixel => {
                let t_cf = (&worn.t_cf, &error);
                Rows::worn_pixel(camera, t_cf, &pose, &y, &pair.uv_f, pixel.sigma_cf)
            }
            MeasurementOutcome::Depth => {
                let predicted = PointInCamera::metric(&pose, &y).expect("rho > 0").value;
                let t_cf = worn.t_cf.retract(&error);
                let uv = pair.uv.expect("seen by both");
                let view = TwoView::new(camera, &uv, camera, &pair.uv_f, &t_cf)
                    .expect("rays meet")
                    .at_point(&predicted);
                let j = view.point_by_tangent();
                let mut noise = view.point_noise(pixel.sigma_cs, pixel.sigma_cf);
                let shared = dense.worn.map(|_| (&error, &j));
                if shared.is_none() {
                    noise += j * worn.covariance * j.transpose();
                }
                let point = view.point() - j * error;
                Rows::depth(&pose, &y, &point, &noise, shared)
            }
            _ => continue,
        };
        let mut rows = rows.expect("visible");
        let share = pair.uv_f.y / f64::from(camera.height) - 0.5;
        rows.roll = dense.worn.map(|_| share);
        units.push((rows, offset, dense.worn));
    }
    units
}

/// The rows again, those of Cf linearised at the error of T_CF that all of them give.
fn told(
    warm: &Warm,
    before: &Filter,
    dense: &Dense,
    z: &Measurements,
    report: &UpdateReport,
    units_before: &[Unit],
) -> Vec<Unit> {
    let mut there = dense.clone();
    there.update(units_before);
    let error = there.error();
    let step = error - dense.error();
    let mut there = dense.clone();
    if let Some(worn) = there.worn {
        there.x.fixed_rows_mut::<6>(worn).copy_from(&error);
    }
    let mut again = units(warm, before, &there, z, report);
    for (rows, _, shared) in &mut again {
        if let (Some(by_error), true) = (rows.by_shared, shared.is_some() && *shared == dense.worn)
        {
            rows.innovation += by_error * step;
        }
    }
    again
}

fn against_dense(seed: u64, changes: &[(&str, Value)], worn: bool, depths: bool) -> UpdateReport {
    let mut all = vec![
        ("validate.test", name("none")),
        ("estimator.consistency", name("none")),
    ];
    all.extend_from_slice(changes);
    let mut warm = with_clone(seed, &all);
    let mut z = measure(&mut warm, worn);
    if depths {
        let pose = warm.scene.pose(warm.t).inverse();
        for bearing in z.bearings.iter().step_by(3) {
            let point = pose.apply(&warm.scene.points[warm.known[&bearing.id]]);
            z.depths.push(DepthObservation {
                id: Some(bearing.id),
                uv: bearing.uv,
                depth: point.z + 0.02,
                sigma: 0.03,
            });
        }
    }
    let before = warm.filter.clone();
    let shared = changes.iter().all(|(key, _)| *key != "worn.errors");
    let mut dense = Dense::of(&before, z.views.first().filter(|_| shared));
    let report = warm.filter.update(&z).expect("good measurements");
    let units = units(&warm, &before, &dense, &z, &report);
    assert_eq!(
        report.dof,
        units.iter().map(|(rows, _, _)| rows.count).sum::<usize>()
    );
    let units = match before
        .state()
        .layout()
        .of_kind(BlockKind::WornBias(ErrorOwner::Of(0)))
        .next()
    {
        // Only the tight form measures pixels of Cf.
        Some(_) if count(&report.views.concat(), MeasurementOutcome::Depth) == 0 => {
            told(&warm, &before, &dense, &z, &report, &units)
        }
        _ => units,
    };
    dense.update(&units);
    dense.normalise(&quaternions(&before));
    dense.compare(&warm.filter, &before);
    report
}

fn count(outcomes: &[MeasurementOutcome], wanted: MeasurementOutcome) -> usize {
    outcomes.iter().filter(|o| **o == wanted).count()
}

#[test]
fn bearings_agree_with_a_dense_filter() {
    let report = against_dense(1, &[], false, false);
    assert!(count(&report.bearings, MeasurementOutcome::Pixel) >= 8);
}

#[test]
fn depths_agree_with_a_dense_filter() {
    let report = against_dense(2, &[], false, true);
    assert!(count(&report.depths, MeasurementOutcome::Depth) >= 3);
    assert_eq!(
        count(&report.bearings, MeasurementOutcome::Replaced),
        report.depths.len()
    );
    assert!(count(&report.bearings, MeasurementOutcome::Pixel) >= 5);
}

#[test]
fn worn_points_agree_with_a_dense_filter() {
    let rolls = ("worn.readout", Value::Float(0.02));
    for more in [
        &[][..],
        &[rolls][..],
        &[("worn.errors", name("independent"))][..],
    ] {
        let mut changes = vec![("estimator.mode", name("collab"))];
        changes.extend_from_slice(more);
        let report = against_dense(3, &changes, true, false);
        assert!(
            count(&report.views[0], MeasurementOutcome::Depth) >= 3,
            "{report:?}"
        );
        assert!(
            count(&report.bearings, MeasurementOutcome::Pixel) >= 1,
            "{report:?}"
        );
    }
}

#[test]
fn worn_pixels_agree_with_a_dense_filter() {
    for readout in [0.0, 0.02] {
        let changes = [
            ("estimator.mode", name("collab-tight")),
            ("worn.readout", Value::Float(readout)),
        ];
        let report = against_dense(4, &changes, true, false);
        assert!(
            count(&report.views[0], MeasurementOutcome::Pixel) >= 5,
            "{report:?}"
        );
        assert_eq!(
            count(&report.bearings, MeasurementOutcome::Pixel),
            report.bearings.len()
        );
    }
}

#[test]
fn a_bias_of_the_worn_camera_agrees_with_a_dense_filter() {
    for mode in ["collab", "collab-tight"] {
        let changes = [
            ("estimator.mode", name(mode)),
            ("worn.bias_share", Value::Float(0.6)),
        ];
        let report = against_dense(5, &changes, true, false);
        assert!(report.dof > 20);
        assert!(report.worn_error.norm() > 0.0);
    }
}

/// A calibration that is known to a typical half a percent.
pub(crate) const CALIBRATION: [(&str, Value); 4] = [
    ("calibration.focal_sd", Value::Float(0.005)),
    ("calibration.aspect_sd", Value::Float(0.001)),
    ("calibration.centre_sd", Value::Float(2.0)),
    ("calibration.radial_sd", Value::Float(0.01)),
];

#[test]
fn an_error_of_the_calibration_agrees_with_a_dense_filter() {
    for (mode, bias) in [("mono", 0.0), ("collab-tight", 0.0), ("collab-tight", 0.6)] {
        let mut changes = CALIBRATION.to_vec();
        changes.push(("estimator.mode", name(mode)));
        changes.push(("worn.bias_share", Value::Float(bias)));
        let report = against_dense(5, &changes, mode != "mono", false);
        assert!(report.dof > 20);
    }
}

#[test]
fn an_error_of_the_calibration_is_considered_and_not_estimated() {
    let after = |changes: &[(&str, Value)]| {
        let mut warm = with_clone(5, changes);
        let z = measure(&mut warm, false);
        warm.filter.update(&z).expect("valid measurements");
        warm.filter.check().expect("sound");
        warm.filter
    };
    let (exact, filter) = (after(&[]), after(&CALIBRATION));
    let state = filter.state();
    let block = state.layout().of_kind(BlockKind::Calibration).next();
    let at = block.expect("it is considered").offset;
    let sds = [0.005, 0.001, 2.0, 2.0, 0.01, 0.01];
    for (i, sd) in sds.iter().enumerate() {
        assert_eq!(state.mean()[at + i], 0.0);
        assert!((state.covariance().get(at + i, at + i) / (sd * sd) - 1.0).abs() < 1e-12);
    }
    // What it does is the same in all features: it does not average out.
    let volume = |filter: &Filter| filter.pose_covariance().fixed_view::<3, 3>(3, 3).trace();
    let (with, without) = (volume(&filter), volume(&exact));
    assert!(with > 1.002 * without, "{with:e} {without:e}");
    // Search follows: a new pixel is as uncertain as its update will say.
    let wide = |filter: &Filter| {
        filter
            .predict_pixels()
            .iter()
            .map(|f| f.s.trace())
            .sum::<f64>()
    };
    assert!(wide(&filter) > wide(&exact));
}

#[test]
fn a_view_says_which_part_of_its_covariance_lasts() {
    let bias = |scale: f64| {
        let mut warm = with_clone(5, &[("estimator.mode", name("collab-tight"))]);
        let mut z = measure(&mut warm, true);
        let worn = &mut z.views[0];
        worn.bias = Some(worn.covariance * scale);
        let expected = worn.t_cf.rotation * worn.covariance.fixed_view::<3, 3>(0, 0) * scale;
        let expected = expected * worn.t_cf.rotation.transpose();
        let baseline = worn.t_cf.translation.normalize();
        let variance = |of: SMatrix<f64, 3, 3>| baseline.dot(&(of * baseline));
        let result = warm.filter.update(&z);
        let state = warm.filter.state();
        let block = state
            .layout()
            .of_kind(BlockKind::WornBias(ErrorOwner::Of(0)))
            .next()
            .copied();
        (
            result,
            block.map(|b| {
                let own = state.covariance().block::<3, 3>(b.offset, b.offset);
                variance(own) / variance(expected)
            }),
        )
    };
    let (result, left) = bias(0.7);
    result.expect("good measurements");
    // Along C's axes, and along the baseline as large after the update as before it.
    assert!((left.expect("a bias") - 1.0).abs() < 1e-12);
    let (result, block) = bias(1.1);
    assert!(matches!(
        result,
        Err(EkfError::InvalidInput {
            what: "bias of T_CF",
            ..
        })
    ));
    assert!(block.is_none(), "nothing is changed");
}

fn bits(filter: &Filter) -> Vec<u64> {
    let state = filter.state();
    let p = state.covariance().to_dense();
    let entries = state.mean().iter().chain(p.iter());
    entries.map(|v| v.to_bits()).collect()
}

#[test]
fn a_failed_update_changes_nothing() {
    let mut warm = with_clone(6, &[("estimator.mode", name("collab-tight"))]);
    let (good, _) = warm.scene.measure(warm.t, &warm.known, true);
    let spoil = |change: &dyn Fn(&mut Measurements)| {
        let mut z = good.clone();
        change(&mut z);
        z
    };
    let worn = |change: &dyn Fn(&mut WornObservation)| spoil(&|z| change(&mut z.views[0]));
    let non_finite = |e: &EkfError| matches!(e, EkfError::NonFinite { .. });
    let invalid = |e: &EkfError| matches!(e, EkfError::InvalidInput { .. });
    let unknown = |e: &EkfError| *e == EkfError::UnknownFeature { id: 999_999 };
    let depth = |depth: f64, sigma: f64| {
        spoil(&|z| {
            z.depths.push(DepthObservation {
                id: None,
                uv: Vector2::new(300.0, 200.0),
                depth,
                sigma,
            });
        })
    };
    type Check<'a> = &'a dyn Fn(&EkfError) -> bool;
    let cases: Vec<(&str, Measurements, Check<'_>)> = vec![
        (
            "pixel",
            spoil(&|z| z.bearings[2].uv.x = f64::NAN),
            &non_finite,
        ),
        (
            "Cf pixel",
            worn(&|w| w.pairs[1].uv_f.y = f64::INFINITY),
            &non_finite,
        ),
        (
            "Cf's pixel of a new point",
            worn(&|w| (w.pairs[0].id, w.pairs[0].uv) = (None, None)),
            &invalid,
        ),
        (
            "T_CF",
            worn(&|w| w.t_cf.translation.x = f64::NAN),
            &non_finite,
        ),
        (
            "bearing's id",
            spoil(&|z| z.bearings[2].id = 999_999),
            &unknown,
        ),
        (
            "searched id",
            spoil(&|z| z.searched.push(999_999)),
            &unknown,
        ),
        (
            "pair's id",
            worn(&|w| w.pairs[0].id = Some(999_999)),
            &unknown,
        ),
        (
            "twice",
            spoil(&|z| z.bearings.push(z.bearings[0])),
            &invalid,
        ),
        (
            "covariance",
            worn(&|w| w.covariance[(2, 2)] = -0.1),
            &invalid,
        ),
        (
            "asymmetry",
            worn(&|w| w.covariance[(0, 1)] = 1e-4),
            &invalid,
        ),
        ("rotation", worn(&|w| w.t_cf.rotation *= 1.01), &invalid),
        ("mirror", worn(&|w| w.t_cf.rotation *= -1.0), &invalid),
        ("depth", depth(-1.0, 0.1), &invalid),
        ("depth's sd", depth(2.0, 0.0), &invalid),
        ("wide covariance", worn(&|w| w.covariance *= 1e60), &invalid),
    ];
    let before = bits(&warm.filter);
    let blocks = warm.filter.state().layout().blocks().to_vec();
    for (what, z, is_right) in &cases {
        let error = warm.filter.update(z).expect_err(what);
        assert!(is_right(&error), "{what}: {error:?}");
        assert_eq!(bits(&warm.filter), before, "{what}");
        assert_eq!(warm.filter.state().layout().blocks(), blocks, "{what}");
    }
    // And nothing hidden has changed either: the next update is that of an untouched filter.
    let mut fresh = with_clone(6, &[("estimator.mode", name("collab-tight"))]).filter;
    let (a, b) = (warm.filter.update(&good), fresh.update(&good));
    assert_eq!(
        a.expect("good").nis.to_bits(),
        b.expect("good").nis.to_bits()
    );
    assert_eq!(bits(&warm.filter), bits(&fresh));
}

#[test]
fn a_worn_frame_needs_a_worn_camera() {
    let mut scene = Scene::new(7, 30);
    let mut filter = Filter::new(settings(&[]), scene.camera.clone(), None);
    filter.predict(0.0).expect("first frame");
    let (z, _) = scene.measure(0.0, &BTreeMap::new(), true);
    let error = filter.update(&z).expect_err("no model of Cf");
    assert!(matches!(error, EkfError::InvalidInput { .. }), "{error:?}");
}

#[test]
fn every_test_rejects_an_outlier() {
    // The camera's motion is uncertain by some 60 px, common to all matches: 15 px off passes alone, not together.
    for (test, pixels) in [
        ("hohct", 15.0),
        ("jcbb", 15.0),
        ("one-point", 15.0),
        ("individual", 200.0),
        ("none", 15.0),
    ] {
        let mut warm = with_clone(8, &[("validate.test", name(test))]);
        let mut z = measure(&mut warm, false);
        let wrong = 3;
        z.bearings[wrong].uv.x += pixels;
        let report = warm.filter.update(&z).expect("good measurements");
        let accepted = count(&report.bearings, MeasurementOutcome::Pixel);
        if test == "none" {
            assert_eq!(report.bearings[wrong], MeasurementOutcome::Pixel);
            assert_eq!(accepted, z.bearings.len());
            continue;
        }
        assert_eq!(
            report.bearings[wrong],
            MeasurementOutcome::RejectedBatch,
            "{test}"
        );
        assert!(accepted + 3 >= z.bearings.len(), "{test}: {report:?}");
        let rejected = count(&report.bearings, MeasurementOutcome::RejectedBatch);
        assert_eq!(report.order, rejected, "{test}");
        let mask: Vec<bool> = report.inliers().collect();
        assert_eq!(mask.len(), z.bearings.len());
        assert_eq!(mask.iter().filter(|&&inlier| inlier).count(), accepted);
        assert!(!mask[wrong], "{test}");
    }
}

#[test]
fn a_wrong_worn_pair_falls_back_to_its_bearing() {
    for mode in ["collab", "collab-tight"] {
        let mut warm = with_clone(3, &[("estimator.mode", name(mode))]);
        let z = measure(&mut warm, true);
        let mut untouched = warm.filter.clone();
        let report = untouched.update(&z).expect("good measurements");
        let used = if mode == "collab" {
            MeasurementOutcome::Depth
        } else {
            MeasurementOutcome::Pixel
        };
        let i = report.views[0]
            .iter()
            .position(|o| *o == used)
            .expect("one is used");
        let mut spoilt = z.clone();
        let pair = &mut spoilt.views[0].pairs[i];
        pair.uv_f.x -= 60.0;
        let id = pair.id;
        let report = warm.filter.update(&spoilt).expect("good measurements");
        assert!(
            matches!(
                report.views[0][i],
                MeasurementOutcome::RejectedGate | MeasurementOutcome::RejectedBatch
            ),
            "{mode}: {:?}",
            report.views[0][i]
        );
        let bearing = z
            .bearings
            .iter()
            .position(|b| Some(b.id) == id)
            .expect("seen");
        assert_eq!(
            report.bearings[bearing],
            MeasurementOutcome::Pixel,
            "{mode}"
        );
        assert!(count(&report.views[0], used) >= 2, "{mode}: {report:?}");
    }
}

#[test]
fn a_feature_that_cf_alone_sees_is_measured_in_the_tight_form_alone() {
    for (mode, outcome) in [
        ("collab", MeasurementOutcome::NotVisible),
        ("collab-tight", MeasurementOutcome::Pixel),
    ] {
        let mut warm = with_clone(3, &[("estimator.mode", name(mode))]);
        let mut z = measure(&mut warm, true);
        let pairs = &mut z.views[0].pairs;
        pairs.truncate(8);
        let ids: Vec<Option<u64>> = pairs.iter().map(|pair| pair.id).collect();
        z.bearings.retain(|b| !ids.contains(&Some(b.id)));
        let mut none = z.clone();
        none.views[0].pairs.clear();
        for pair in &mut z.views[0].pairs {
            pair.uv = None;
        }
        let mut without = warm.filter.clone();
        without.update(&none).expect("good measurements");
        let report = warm.filter.update(&z).expect("good measurements");
        assert_eq!(count(&report.views[0], outcome), 8, "{mode}: {report:?}");
        let [alone, more] = [&without, &warm.filter].map(|f| f.pose_covariance().trace());
        assert_eq!(more < alone, outcome == MeasurementOutcome::Pixel, "{mode}");
        warm.filter.check().expect("sound");
    }
}

#[test]
fn time_must_increase() {
    let mut warm = with_clone(9, &[]);
    let before = bits(&warm.filter);
    for t in [warm.t, warm.t - 0.05] {
        let error = warm
            .filter
            .predict(t)
            .expect_err("not after the last frame");
        assert_eq!(error, EkfError::BadTime { t, last: warm.t });
    }
    let error = warm.filter.predict(f64::NAN).expect_err("NaN");
    assert_eq!(error, EkfError::NonFinite { what: "time" });
    assert_eq!(bits(&warm.filter), before);
    warm.filter
        .predict(warm.t + DT)
        .expect("after the last frame");
}

#[test]
fn removing_features_deletes_rows_and_columns() {
    let mut warm = with_clone(10, &[]);
    let (x, p) = (
        warm.filter.state().mean().to_vec(),
        warm.filter.state().covariance().to_dense(),
    );
    let ids: Vec<u64> = warm.known.keys().copied().step_by(4).collect();
    let blocks: Vec<_> = warm.filter.state().layout().blocks().to_vec();
    let gone: Vec<usize> = blocks
        .iter()
        .filter(|b| ids.contains(&b.id))
        .flat_map(|b| b.range())
        .collect();
    assert_eq!(gone.len(), 6 * ids.len());
    let before = bits(&warm.filter);
    let error = warm.filter.remove_features(&[ids[0], 999_999]);
    assert_eq!(error, Err(EkfError::UnknownFeature { id: 999_999 }));
    assert_eq!(bits(&warm.filter), before);
    warm.filter.remove_features(&ids).expect("in the map");
    let p = p.remove_columns_at(&gone).remove_rows_at(&gone);
    let x = DVector::from_vec(x).remove_rows_at(&gone);
    assert_eq!(warm.filter.state().mean(), x.as_slice());
    assert_eq!(warm.filter.state().covariance().to_dense(), p);
    for block in warm.filter.state().layout().blocks() {
        assert!(!ids.contains(&block.id));
        assert!(
            blocks
                .iter()
                .any(|b| b.id == block.id && b.kind == block.kind)
        );
    }
}

#[test]
fn the_worn_error_stays_for_one_frame_only() {
    let mut warm = with_clone(11, &[("estimator.mode", name("collab-tight"))]);
    let dim = warm.filter.state().mean().len();
    let z = measure(&mut warm, true);
    let report = warm.filter.update(&z).expect("good measurements");
    assert!(report.worn_error.norm() > 0.0);
    assert_eq!(warm.filter.state().mean().len(), dim);
    let kinds = warm.filter.state().layout();
    assert_eq!(
        kinds
            .of_kind(BlockKind::WornError(ErrorOwner::Of(0)))
            .count(),
        0
    );
}

/// Points of known place at a range from a camera that then goes a tenth of that to the side; whether the next frame is used,
/// and the sd of its speed along x before.
fn starts_at(range: f64) -> (bool, f64) {
    let camera = crate::scene::camera();
    let mut filter = Filter::new(Settings::default(), camera.clone(), None);
    filter.predict(0.0).expect("first frame");
    let points: Vec<_> = (0..16)
        .map(|i| Vector3::new(0.1 * f64::from(i % 4 - 1), 0.1 * f64::from(i / 4 - 1), 1.0) * range)
        .collect();
    let noise = vec![Matrix3::identity() * (1e-3 * range).powi(2); points.len()];
    let shared = vec![SMatrix::<f64, 3, 6>::zeros(); points.len()];
    let ids = filter
        .add_points(&points, &noise, &shared, &Matrix6::identity())
        .expect("good points");
    let speed = filter.pose_and_twist_covariance()[(6, 6)].sqrt();
    filter.predict(0.1).expect("time goes on");
    let moved = Vector3::new(0.1 * range, 0.0, 0.0);
    let bearings = ids.iter().zip(&points).map(|(&id, point)| Bearing {
        id,
        uv: camera.project(&(point - moved)).expect("in view"),
    });
    let z = Measurements {
        searched: ids.clone(),
        bearings: bearings.collect(),
        min_inliers: 8,
        ..Measurements::default()
    };
    (
        filter.update(&z).expect("good measurements").accepted,
        speed,
    )
}

#[test]
fn a_start_before_a_near_scene_goes_on_in_the_next_frame() {
    let (used, speed) = starts_at(0.2);
    assert!(used, "20 cm away");
    assert!((2.0..2.1).contains(&speed), "{speed}");
    let (used, speed) = starts_at(5.0);
    assert!(used, "5 m away");
    assert!((speed - 10.0).abs() < 1e-9, "{speed}");
}
