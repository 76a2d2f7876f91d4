//! A string of bytes as a life of a filter: settings, then calls in any order, plausible ones and impossible ones.

use crate::Broken;
use crate::bytes::Bytes;
use crate::sound::{check_filter, check_state, fingerprint};
use ekf_core::math::pose::Pose;
use ekf_core::math::quat;
use ekf_core::settings::Value;
use ekf_core::{
    Bearing, Camera, DepthObservation, EkfError, Filter, Followed, MeasurementOutcome,
    Measurements, PredictedFeature, Settings, WornObservation, WornPair,
};
use nalgebra::{Matrix3, Matrix6, SMatrix, Vector2, Vector3, Vector6};

/// Calls that one input makes at most.
const MOST_CALLS: u64 = 24;
/// Sides of the image, pixels.
const IMAGE: (u32, u32) = (320, 240);

/// How many calls an input made, and how many of them were refused.
#[derive(Clone, Copy, Debug, Default)]
pub struct Calls {
    /// All of them.
    pub made: u64,
    /// Those that returned an error.
    pub refused: u64,
}

/// Plays the bytes and checks after every call: what was refused has changed nothing, what was taken has left
/// dimensions, ids and numbers in order; at the end P is sound.
///
/// # Errors
/// The first promise that was broken, and the call.
pub fn filter(bytes: &[u8]) -> Result<Calls, Broken> {
    let mut bytes = Bytes::new(bytes);
    let mut life = Life::new(&mut bytes);
    let mut calls = Calls::default();
    while !bytes.is_empty() && calls.made < MOST_CALLS {
        let before = fingerprint(&life.filter);
        let (call, done) = life.call(&mut bytes);
        let number = calls.made;
        let at = |broken| format!("after call {number} ({call}): {broken}");
        calls.made += 1;
        match done {
            Err(error) => {
                calls.refused += 1;
                if fingerprint(&life.filter) != before {
                    return Err(at(format!("refused ({error}), but the state has changed")));
                }
            }
            Ok(()) => check_state(&life.filter).map_err(at)?,
        }
    }
    let kind = if bytes.rough { "rough" } else { "plausible" };
    check_filter(&life.filter).map_err(|broken| format!("at the end of {kind} input: {broken}"))?;
    Ok(calls)
}

/// A filter, and what is around it.
pub(crate) struct Life {
    pub(crate) filter: Filter,
    camera: Camera,
    worn: Camera,
    t: f64,
    /// Time of the last checkpoint.
    kept: f64,
}

type Done = (&'static str, Result<(), EkfError>);

impl Life {
    pub(crate) fn new(bytes: &mut Bytes<'_>) -> Self {
        let intrinsics = [200.0, 210.0, 159.0, 121.0];
        let camera = match bytes.below(4) {
            0 => Camera::new(
                "radtan",
                IMAGE.0,
                IMAGE.1,
                intrinsics,
                &[-0.1, 0.02, 1e-3, -1e-3],
            ),
            1 => Camera::new(
                "fisheye",
                IMAGE.0,
                IMAGE.1,
                intrinsics,
                &[0.05, -0.01, 0.002, 0.0],
            ),
            _ => Camera::new("pinhole", IMAGE.0, IMAGE.1, intrinsics, &[]),
        }
        .expect("valid calibration");
        let worn =
            Camera::new("pinhole", IMAGE.0, IMAGE.1, intrinsics, &[]).expect("valid calibration");
        let settings = settings(bytes);
        bytes.rough = bytes.coin();
        let mut filter = Filter::new(settings, camera.clone(), Some(worn.clone()));
        filter.predict(0.0).expect("first frame");
        Self {
            filter,
            camera,
            worn,
            t: 0.0,
            kept: 0.0,
        }
    }

    /// The next call, as the bytes say.
    pub(crate) fn call(&mut self, bytes: &mut Bytes<'_>) -> Done {
        match bytes.below(19) {
            0..=2 => ("predict", self.predict(bytes)),
            3..=5 => ("update", self.update(bytes, false, false)),
            6 | 7 => ("update with worn", self.update(bytes, true, false)),
            8 => ("update with depths", self.update(bytes, false, true)),
            9 => {
                let uv = pixels(bytes, 3);
                (
                    "add_candidates",
                    self.filter.add_candidates(&uv).map(|_| ()),
                )
            }
            10 => ("observe_candidates", self.observe(bytes)),
            11 => {
                let uv = pixels(bytes, 2);
                ("add_undelayed", self.filter.add_undelayed(&uv).map(|_| ()))
            }
            12 => ("remove_features", self.remove(bytes)),
            13 => {
                self.filter.manage_map(&[]);
                ("manage_map", Ok(()))
            }
            14 => ("add_points", self.start(bytes)),
            15 => ("snapshot and restore", self.save()),
            16 => ("promote_candidates", self.promote(bytes)),
            17 => ("start_from_views", self.start_from_views(bytes)),
            _ => ("overlap", self.overlap(bytes)),
        }
    }

    fn predict(&mut self, bytes: &mut Bytes<'_>) -> Result<(), EkfError> {
        let dt = match bytes.below(16) {
            0 => 0.0,
            1 => -0.1,
            2 => 5.0,
            3 if bytes.rough => 3599.0,
            4 => 1e-9,
            _ => 0.01 + 0.1 * bytes.signed().abs(),
        };
        let t = bytes.or_nasty(self.t + dt);
        self.filter.checkpoint();
        self.kept = self.t;
        self.filter.predict(t)?;
        self.t = t;
        Ok(())
    }

    /// Points all over the image that went one way, or here and there.
    fn follow(&self, bytes: &mut Bytes<'_>) -> Followed {
        let (way, spread) = (30.0 * bytes.signed(), if bytes.rough { 9.0 } else { 0.5 });
        let before: Vec<Vector2<f64>> = (0..24)
            .map(|k| Vector2::new(f64::from(20 + 50 * (k % 6)), f64::from(30 + 55 * (k / 6))))
            .collect();
        let now = before
            .iter()
            .map(|uv| near(bytes, &(uv + Vector2::new(way, 0.0)), spread));
        let now = now.collect();
        let since = bytes.or_nasty(self.kept);
        Followed { since, before, now }
    }

    fn update(&mut self, bytes: &mut Bytes<'_>, worn: bool, depths: bool) -> Result<(), EkfError> {
        let seen = self.filter.predict_pixels();
        let mut z = Measurements::default();
        for f in &seen {
            z.searched.push(f.id);
            let choice = bytes.byte();
            if choice & 3 != 0 {
                let spread = if choice & 0x70 == 0 { 60.0 } else { 1.5 };
                let uv = near(bytes, &f.uv, spread);
                z.bearings.push(Bearing { id: f.id, uv });
            }
        }
        if bytes.rough && bytes.below(16) == 0 {
            // What a caller gets wrong: ids that are not there, or twice.
            let id = bytes.byte().into();
            z.bearings.push(Bearing {
                id,
                uv: Vector2::new(100.0, 100.0),
            });
        }
        if worn {
            z.views = vec![self.worn_observation(bytes, &seen, &z.bearings)];
        }
        if depths {
            for b in z.bearings.iter().take(2) {
                let range = seen
                    .iter()
                    .find(|f| f.id == b.id)
                    .map_or(3.0, |f| 1.0 / f.rho);
                z.depths.push(DepthObservation {
                    id: Some(b.id),
                    uv: b.uv,
                    depth: bytes.near(range, 0.1 * range),
                    sigma: bytes.or_nasty(0.05),
                });
            }
            for uv in pixels(bytes, 2) {
                z.depths.push(DepthObservation {
                    id: None,
                    uv,
                    depth: bytes.near(4.0, 3.0),
                    sigma: bytes.or_nasty(0.1),
                });
            }
        }
        if bytes.below(4) == 0 {
            z.followed = Some(self.follow(bytes));
        }
        let report = self.filter.update(&z)?;
        if let Some(followed) = z.followed.filter(|_| report.turn_excluded) {
            self.filter.predict_again(&followed)?;
        }
        let counts = [
            (report.bearings.len(), z.bearings.len()),
            (report.depths.len(), z.depths.len()),
            (
                report.views.iter().map(Vec::len).sum(),
                z.views.iter().map(|w| w.pairs.len()).sum(),
            ),
        ];
        assert!(counts.iter().all(|(a, b)| a == b), "outcomes {counts:?}");
        assert!(
            report.nis >= 0.0 && report.nis.is_finite(),
            "nis {}",
            report.nis
        );
        for outcome in report.views.iter().flatten().chain(&report.depths) {
            if let MeasurementOutcome::Born(id) = outcome {
                let layout = self.filter.state().layout();
                assert!(layout.find(*id).is_some(), "{id} was born but is not there");
            }
        }
        Ok(())
    }

    fn worn_observation(
        &self,
        bytes: &mut Bytes<'_>,
        seen: &[PredictedFeature],
        bearings: &[Bearing],
    ) -> WornObservation {
        let (t_cf, covariance) = worn_pose(bytes);
        let inverse = t_cf.inverse();
        let (rotation, r) = self.filter.pose();
        let mut pairs = Vec::new();
        for b in bearings {
            let Some(f) = seen.iter().find(|f| f.id == b.id) else {
                continue;
            };
            let in_c = rotation.transpose() * (f.point - r);
            if let Some(uv_f) = self.worn.project(&inverse.apply(&in_c)) {
                let uv_f = near(bytes, &uv_f, 2.0);
                pairs.push(WornPair {
                    id: Some(b.id),
                    uv: Some(b.uv),
                    uv_f,
                });
            }
        }
        for uv in pixels(bytes, 4) {
            let depth = 1.5 + 3.0 * bytes.signed().abs();
            let Some(ray) = self.camera.unproject(&uv) else {
                continue;
            };
            if let Some(uv_f) = self.worn.project(&inverse.apply(&(ray * depth))) {
                let uv_f = near(bytes, &uv_f, 1.0);
                pairs.push(WornPair {
                    id: None,
                    uv: Some(uv),
                    uv_f,
                });
            }
        }
        let rate = bytes
            .coin()
            .then(|| Vector3::from_fn(|_, _| 4.0 * bytes.signed()));
        WornObservation {
            who: 0,
            capture: None,
            bias: None,
            t_cf,
            covariance,
            rate,
            pairs,
        }
    }

    fn observe(&mut self, bytes: &mut Bytes<'_>) -> Result<(), EkfError> {
        let mut seen = Vec::new();
        for id in self.filter.candidate_ids() {
            if bytes.coin() {
                seen.push((id, pixel(bytes)));
            }
        }
        if bytes.rough && bytes.below(16) == 0 {
            seen.push((bytes.byte().into(), Vector2::new(50.0, 60.0)));
        }
        self.filter.observe_candidates(&seen).map(|_| ())
    }

    fn promote(&mut self, bytes: &mut Bytes<'_>) -> Result<(), EkfError> {
        let mut ids: Vec<u64> = self
            .filter
            .candidate_ids()
            .filter(|_| bytes.coin())
            .collect();
        if bytes.rough && bytes.below(16) == 0 {
            ids.push(bytes.byte().into());
        }
        self.filter
            .promote_candidates(&ids, ids.len() > 2)
            .map(|_| ())
    }

    fn remove(&mut self, bytes: &mut Bytes<'_>) -> Result<(), EkfError> {
        let all: Vec<u64> = self.filter.landmarks().iter().map(|l| l.id).collect();
        let mut ids: Vec<u64> = all.into_iter().filter(|_| bytes.below(3) == 0).collect();
        if bytes.below(8) == 0 {
            ids.push(bytes.byte().into());
        }
        self.filter.remove_features(&ids)?;
        let candidates: Vec<u64> = self
            .filter
            .candidate_ids()
            .filter(|_| bytes.below(3) == 0)
            .collect();
        self.filter.drop_candidates(&candidates);
        Ok(())
    }

    fn start(&mut self, bytes: &mut Bytes<'_>) -> Result<(), EkfError> {
        let n = bytes.below(5);
        let points: Vec<_> = (0..n)
            .map(|_| {
                Vector3::new(
                    bytes.near(0.0, 1.0),
                    bytes.near(0.0, 1.0),
                    bytes.near(3.0, 2.0),
                )
            })
            .collect();
        let noise: Vec<_> = (0..n)
            .map(|_| Matrix3::identity() * bytes.or_nasty(1e-4))
            .collect();
        let shared: Vec<_> = (0..n)
            .map(|_| {
                SMatrix::<f64, 3, 6>::from_fn(|i, j| if i == j { 1.0 } else { bytes.or_nasty(0.1) })
            })
            .collect();
        let covariance = Matrix6::identity() * bytes.or_nasty(1e-3);
        let born = self
            .filter
            .add_points(&points, &noise, &shared, &covariance);
        born.map(|_| ())
    }

    /// Up to four views of ten points: of a camera that moves sideways, or anything.
    fn start_from_views(&mut self, bytes: &mut Bytes<'_>) -> Result<(), EkfError> {
        let first = pixels(bytes, 10);
        let moved: Vec<f64> = first.iter().map(|_| bytes.near(8.0, 6.0)).collect();
        let count = bytes.below(5);
        let views: Vec<Vec<_>> = (0..count)
            .map(|k| {
                let shifted = first.iter().zip(&moved);
                let step = Vector2::new(k as f64, 0.0);
                shifted
                    .map(|(uv, by)| near(bytes, &(uv + step * *by), 0.3))
                    .collect()
            })
            .collect();
        let times: Vec<f64> = (0..count)
            .map(|k| bytes.near(0.1 * k as f64, 0.01))
            .collect();
        self.filter.start_from_views(&times, &views).map(|_| ())
    }

    /// Goes on with the filter restored from a snapshot, whose own snapshot is the same.
    fn save(&mut self) -> Result<(), EkfError> {
        let snapshot = self.filter.snapshot();
        let restored = Filter::restore(&snapshot)?;
        assert!(
            restored.snapshot() == snapshot,
            "the snapshot of what was restored is another"
        );
        self.filter = restored;
        Ok(())
    }

    fn overlap(&mut self, bytes: &mut Bytes<'_>) -> Result<(), EkfError> {
        let (t_cf, covariance) = worn_pose(bytes);
        if let Some(overlap) = self.filter.overlap(&t_cf, &covariance, 0)? {
            let numbers = overlap.roi_s.iter().chain(&overlap.roi_f);
            let numbers = numbers.chain([&overlap.d_max, &overlap.baseline]);
            assert!(numbers.into_iter().all(|x| x.is_finite()), "{overlap:?}");
        }
        Ok(())
    }
}

/// A pose some half metre beside Cs, and its covariance.
fn worn_pose(bytes: &mut Bytes<'_>) -> (Pose, Matrix6<f64>) {
    let turn = Vector3::new(bytes.signed(), bytes.signed(), bytes.signed()) * 0.1;
    let mut rotation = quat::rotation(&quat::exp(&turn));
    rotation[(0, 0)] = bytes.or_nasty(rotation[(0, 0)]);
    let translation = Vector3::new(
        bytes.near(0.5, 0.2),
        bytes.near(-0.3, 0.2),
        bytes.near(0.1, 0.2),
    );
    let sd = Vector6::new(0.03, 0.03, 0.03, 0.01, 0.02, 0.01);
    let mut covariance = Matrix6::from_diagonal(&sd.map(|s| s * s));
    let scale = bytes.or_nasty(1.0);
    covariance *= scale;
    covariance[(0, 3)] = bytes.or_nasty(0.0);
    (
        Pose {
            rotation,
            translation,
        },
        covariance,
    )
}

fn pixel(bytes: &mut Bytes<'_>) -> Vector2<f64> {
    Vector2::new(bytes.near(160.0, 180.0), bytes.near(120.0, 140.0))
}

fn pixels(bytes: &mut Bytes<'_>, most: usize) -> Vec<Vector2<f64>> {
    (0..bytes.below(most + 1)).map(|_| pixel(bytes)).collect()
}

fn near(bytes: &mut Bytes<'_>, uv: &Vector2<f64>, spread: f64) -> Vector2<f64> {
    Vector2::new(bytes.near(uv.x, spread), bytes.near(uv.y, spread))
}

/// A small map, and any of the modes, tests and forms.
fn settings(bytes: &mut Bytes<'_>) -> Settings {
    let mut settings = Settings::default();
    let local = bytes.below(8) == 0;
    let names = [
        (
            "estimator.mode",
            [
                "mono",
                "mono-undelayed",
                "collab-init",
                "collab",
                "collab-tight",
            ][bytes.below(5)],
        ),
        (
            "estimator.consistency",
            if local {
                "none"
            } else {
                ["gauge", "none"][bytes.below(2)]
            },
        ),
        ("birth.first_pose", ["clone", "independent"][bytes.below(2)]),
        (
            "worn.errors",
            ["shared", "shared", "independent", "pixels"][bytes.below(4)],
        ),
        (
            "validate.test",
            ["hohct", "hohct", "jcbb", "one-point", "individual", "none"][bytes.below(6)],
        ),
    ];
    let numbers = [
        ("map.in_view", Value::Int(4)),
        ("map.max_features", Value::Int(6)),
        ("map.local_from", Value::Int(if local { 0 } else { 150 })),
        ("worn.start_births", Value::Int(2)),
        (
            "worn.bias_share",
            Value::Float([0.0, 0.3, 1.0][bytes.below(3)]),
        ),
        (
            "birth.min_parallax",
            Value::Float([1.0, 0.1][bytes.below(2)]),
        ),
        (
            "birth.min_baseline",
            Value::Float([0.02, 0.0][bytes.below(2)]),
        ),
        ("pixel.sigma_cs", Value::Float([1.0, 0.1][bytes.below(2)])),
        (
            "calibration.focal_sd",
            Value::Float([0.0, 0.003, 0.1][bytes.below(3)]),
        ),
        (
            "process.start_velocity_sd",
            Value::Float([1.0, 10.0][bytes.below(2)]),
        ),
    ];
    let names = names.map(|(key, name)| (key, Value::Name(name.into())));
    for (key, value) in names.into_iter().chain(numbers) {
        settings.set(key, &value).expect("within the range");
    }
    settings
}
