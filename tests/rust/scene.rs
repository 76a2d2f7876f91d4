//! A simulated camera among random points, for the tests that need a filter in use.

use ekf_core::math::pose::Pose;
use ekf_core::math::quat;
use ekf_core::settings::Value;
use ekf_core::{Bearing, Camera, Filter, Measurements, Settings, WornObservation, WornPair};
use nalgebra::{Matrix6, SMatrix, Vector2, Vector3, Vector6};
use rand::{Rng, SeedableRng};
use rand_distr::{Distribution, StandardNormal};
use rand_pcg::Pcg64;
use std::collections::BTreeMap;

pub(crate) fn rng(seed: u64) -> Pcg64 {
    Pcg64::seed_from_u64(seed)
}

pub(crate) fn normal(rng: &mut Pcg64) -> f64 {
    StandardNormal.sample(rng)
}

pub(crate) fn normals<const N: usize>(rng: &mut Pcg64) -> SMatrix<f64, N, 1> {
    SMatrix::from_fn(|_, _| normal(rng))
}

pub(crate) fn camera() -> Camera {
    Camera::new(
        "radtan",
        720,
        480,
        [600.0, 605.0, 362.0, 238.0],
        &[-0.1, 0.02, 1e-4, -2e-4],
    )
    .expect("valid calibration")
}

/// 3 cm and 0.5, 0.5, 1 degree, as in Table C1.
pub(crate) fn worn_covariance() -> Matrix6<f64> {
    let degree = std::f64::consts::PI / 180.0;
    Matrix6::from_diagonal(
        &Vector6::new(0.03, 0.03, 0.03, 0.5 * degree, degree, 0.5 * degree).map(|s| s * s),
    )
}

pub(crate) fn settings(changes: &[(&str, Value)]) -> Settings {
    let mut settings = Settings::default();
    // The simulated cameras take all rows at once, each T_CF has an error of its own, and lengths have none for good.
    for key in [
        "calibration.readout",
        "calibration.readout_sd",
        "worn.readout",
        "worn.bias_share",
        "worn.length_sd",
    ] {
        settings.set(key, &Value::Float(0.0)).expect("a setting");
    }
    for (key, value) in changes {
        settings.set(key, value).expect("valid setting");
    }
    settings
}

pub(crate) fn name(text: &str) -> Value {
    Value::Name(text.into())
}

/// How the camera moves, from the origin at 0.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Trajectory {
    /// It sways slowly.
    Swaying,
    /// It turns, and changes its speed, as one that is carried.
    Lively,
    /// As lively, in a hand that shakes.
    Shaken,
    /// At constant velocity.
    Straight,
    /// Straight ahead, at constant velocity.
    Ahead,
    /// At a constant twist, about a point 6 m in front of it.
    Round,
}

/// Points in front of a camera that wanders about, and a worn camera half a metre beside it.
#[derive(Clone)]
pub(crate) struct Scene {
    pub(crate) camera: Camera,
    pub(crate) points: Vec<Vector3<f64>>,
    pub(crate) sigma_px: f64,
    pub(crate) worn_covariance: Matrix6<f64>,
    /// Seconds from the first row of an image of Cs to the last one.
    pub(crate) readout: f64,
    /// The same of Cf, which moves by 1 m/s and turns by 1 rad/s on each axis meanwhile, standard deviations drawn for each view.
    pub(crate) worn_readout: f64,
    pub(crate) trajectory: Trajectory,
    /// Seconds after its stamp that a view of Cf is taken.
    pub(crate) clock: f64,
    /// Whether the camera is at rest at 0.
    pub(crate) from_rest: bool,
    /// Whether Cf goes about, instead of being fixed to Cs.
    pub(crate) goes_about: bool,
    rng: Pcg64,
}

impl Scene {
    pub(crate) fn new(seed: u64, points: usize) -> Self {
        let mut rng = rng(seed);
        let points = (0..points)
            .map(|_| {
                Vector3::new(
                    rng.random_range(-4.0..4.0),
                    rng.random_range(-2.0..2.0),
                    rng.random_range(3.0..9.0),
                )
            })
            .collect();
        Self {
            camera: camera(),
            points,
            sigma_px: 1.0,
            worn_covariance: worn_covariance(),
            readout: 0.0,
            worn_readout: 0.0,
            trajectory: Trajectory::Swaying,
            clock: 0.0,
            from_rest: false,
            goes_about: false,
            rng,
        }
    }

    /// Pose of the camera at time `t`: at the origin at 0, slowly swaying.
    pub(crate) fn pose(&self, t: f64) -> Pose {
        let t = if self.from_rest {
            t * t / (t.abs() + 1.0)
        } else {
            t
        };
        let (turn, translation) = match self.trajectory {
            Trajectory::Swaying => (
                Vector3::new(0.05 * (0.7 * t).sin(), 0.2 * (0.3 * t).sin(), 0.0),
                Vector3::new(
                    0.6 * (0.4 * t).sin(),
                    0.1 * (0.9 * t).sin(),
                    0.5 * (1.0 - (0.25 * t).cos()),
                ),
            ),
            Trajectory::Lively => (
                Vector3::new(0.1 * (1.7 * t).sin(), 0.25 * (0.9 * t).sin(), 0.0),
                Vector3::new(
                    0.8 * (1.3 * t).sin(),
                    0.2 * (2.1 * t).sin(),
                    0.4 * (1.0 - (0.9 * t).cos()),
                ),
            ),
            Trajectory::Shaken => (
                Vector3::new(
                    0.05 * (8.3 * t).sin(),
                    0.07 * (7.1 * t).sin(),
                    0.04 * (9.7 * t).sin(),
                ),
                Vector3::new(0.8 * (1.3 * t).sin(), 0.2 * (2.1 * t).sin(), 0.3 * t),
            ),
            Trajectory::Straight => (Vector3::zeros(), Vector3::new(0.8 * t, 0.1 * t, 0.0)),
            Trajectory::Ahead => (Vector3::zeros(), Vector3::new(0.0, 0.0, 1.5 * t)),
            Trajectory::Round => {
                let angle: f64 = 0.15 * t;
                let way = Vector3::new(-angle.sin(), 0.0, 1.0 - angle.cos());
                (Vector3::new(0.0, angle, 0.0), way * 6.0)
            }
        };
        Pose {
            rotation: quat::rotation(&quat::exp(&turn)),
            translation,
        }
    }

    pub(crate) fn pixel(&mut self, pose: &Pose, point: usize) -> Option<Vector2<f64>> {
        let uv = self
            .camera
            .project(&pose.inverse().apply(&self.points[point]))?;
        let noise: Vector2<f64> = normals(&mut self.rng);
        self.camera
            .in_image(&uv, 2.0)
            .then(|| uv + noise * self.sigma_px)
    }

    /// As [`Self::pixel`], from where the camera is at the time of the pixel's row in the frame at `t`.
    pub(crate) fn rolling_pixel(&mut self, t: f64, point: usize) -> Option<Vector2<f64>> {
        let mut tau = 0.0;
        for _ in 0..5 {
            let seen = self.pose(t + tau).inverse().apply(&self.points[point]);
            let row = self.camera.project(&seen)?.y;
            tau = (row / f64::from(self.camera.height) - 0.5) * self.readout;
        }
        self.pixel(&self.pose(t + tau), point)
    }

    /// The pixel of a point in Cf at this pose, which moves by `roll` while its image is read.
    fn worn_pixel(
        &mut self,
        pose: &Pose,
        roll: &Vector6<f64>,
        point: usize,
    ) -> Option<Vector2<f64>> {
        let mut row = 0.0;
        for _ in 0..5 {
            let seen = pose
                .retract(&(roll * row))
                .inverse()
                .apply(&self.points[point]);
            row = self.camera.project(&seen)?.y / f64::from(self.camera.height) - 0.5;
        }
        self.pixel(&pose.retract(&(roll * row)), point)
    }

    /// One frame: what `known` (feature id to point) sees, and the worn camera's pairs for all points.
    pub(crate) fn measure(
        &mut self,
        t: f64,
        known: &BTreeMap<u64, usize>,
        with_worn: bool,
    ) -> (Measurements, Vec<usize>) {
        let stamp = t;
        let mut z = Measurements::default();
        for (&id, &point) in known {
            z.searched.push(id);
            if let Some(uv) = self.rolling_pixel(t, point) {
                z.bearings.push(Bearing { id, uv });
            }
        }
        let mut pair_points = Vec::new();
        if with_worn {
            let t = t + self.clock;
            let pose = self.pose(t);
            let about = if self.goes_about {
                Vector3::new(
                    0.5 * (0.8 * t).cos() - 0.5,
                    0.3 * (1.1 * t).sin(),
                    0.2 * (0.6 * t).sin(),
                )
            } else {
                Vector3::zeros()
            };
            let t_cf = Pose {
                rotation: quat::rotation(&quat::exp(&Vector3::new(0.0, -0.08, 0.02))),
                translation: Vector3::new(0.5, -0.3, 0.1) + about,
            };
            let chol = self.worn_covariance.cholesky().expect("positive definite");
            let error = chol.l() * normals::<6>(&mut self.rng);
            // T_true = T_measured Exp(error), to first order.
            let measured = t_cf.retract(&-error);
            let worn_pose = Pose {
                rotation: pose.rotation * t_cf.rotation,
                translation: pose.apply(&t_cf.translation),
            };
            let of_point: BTreeMap<usize, u64> = known.iter().map(|(id, p)| (*p, *id)).collect();
            let mut roll = Vector6::zeros();
            if self.worn_readout > 0.0 {
                roll = normals(&mut self.rng) * self.worn_readout;
            }
            let mut pairs = Vec::new();
            for point in 0..self.points.len() {
                let id = of_point.get(&point).copied();
                let bearing = id.and_then(|id| z.bearings.iter().find(|b| b.id == id));
                let uv = match (id, bearing) {
                    (Some(_), Some(b)) => Some(b.uv),
                    (Some(_), None) => None,
                    (None, _) => self.rolling_pixel(stamp, point),
                };
                if let (Some(_), Some(uv_f)) = (uv, self.worn_pixel(&worn_pose, &roll, point)) {
                    pairs.push(WornPair { id, uv, uv_f });
                    pair_points.push(point);
                }
            }
            z.views.push(WornObservation {
                who: 0,
                capture: None,
                rate: None,
                bias: None,
                t_cf: measured,
                covariance: self.worn_covariance,
                pairs,
            });
        }
        (z, pair_points)
    }

    /// A filter with three worn cameras.
    pub(crate) fn filter(&self, settings: Settings) -> Filter {
        let worn = std::iter::repeat_n(self.camera.clone(), 3);
        Filter::new(settings, self.camera.clone(), worn)
    }
}

/// Which feature is which point, after an update.
pub(crate) fn adopt(
    known: &mut BTreeMap<u64, usize>,
    report: &ekf_core::UpdateReport,
    pair_points: &[usize],
) {
    for (outcome, &point) in report.views.iter().flatten().zip(pair_points) {
        if let ekf_core::MeasurementOutcome::Born(id) = outcome {
            known.insert(*id, point);
        }
    }
}

/// Seconds between frames.
pub(crate) const DT: f64 = 0.1;

/// A filter after a worn start and five more frames, predicted to the next one at `t`.
pub(crate) struct Warm {
    pub(crate) scene: Scene,
    pub(crate) filter: Filter,
    pub(crate) known: BTreeMap<u64, usize>,
    pub(crate) t: f64,
}

pub(crate) fn warm(seed: u64, changes: &[(&str, Value)]) -> Warm {
    warm_in(Scene::new(seed, 30), changes)
}

/// The same in this scene.
pub(crate) fn warm_in(scene: Scene, changes: &[(&str, Value)]) -> Warm {
    let mut filter = scene.filter(settings(changes));
    filter.predict(0.0).expect("first frame");
    let mut warm = Warm {
        scene,
        filter,
        known: BTreeMap::new(),
        t: 0.0,
    };
    for frame in 0..6 {
        warm.update(frame == 0);
        warm.next_frame();
    }
    assert!(warm.filter.started());
    assert!(warm.known.len() >= 8, "{} features", warm.known.len());
    warm
}

impl Warm {
    /// Measures the present frame.
    pub(crate) fn update(&mut self, with_worn: bool) {
        let (z, points) = self.scene.measure(self.t, &self.known, with_worn);
        let report = self.filter.update(&z).expect("good measurements");
        adopt(&mut self.known, &report, &points);
    }

    pub(crate) fn next_frame(&mut self) {
        self.t += DT;
        self.filter.predict(self.t).expect("increasing time");
    }
}
