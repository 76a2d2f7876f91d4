//! The filter as a textbook would write it: dense matrices, and every derivative by differences.
//!
//! METHOD 2 to 6 in the plainest words; slow, and sharing nothing with the crate but the camera model.

use ekf_core::Camera;
use ekf_core::settings::Settings;
use nalgebra::{DMatrix, DVector, Matrix3, Quaternion, UnitQuaternion, Vector2, Vector3};

pub(crate) struct Block {
    pub(crate) id: u64,
    pub(crate) len: usize,
}

pub(crate) struct Reference {
    pub(crate) x: DVector<f64>,
    pub(crate) p: DMatrix<f64>,
    pub(crate) blocks: Vec<Block>,
    settings: Settings,
    camera: Camera,
}

/// Weights of central differences over one to four steps. What they leave out is of the eighth order in the step, so that
/// steps can be long enough for rounding not to matter: over one step, an inverse depth of 0.05 / m has errors of 1e-7, and an
/// update that reduces a variance ten thousandfold shows as much more of them.
const WEIGHTS: [f64; 4] = [4.0 / 5.0, -1.0 / 5.0, 4.0 / 105.0, -1.0 / 280.0];

/// Derivative by differences.
fn jacobian(f: impl Fn(&DVector<f64>) -> DVector<f64>, x: &DVector<f64>) -> DMatrix<f64> {
    let columns: Vec<_> = (0..x.len())
        .map(|i| {
            let step = 1e-4 * (1.0 + x[i].abs());
            let at = |by: f64| {
                let mut x = x.clone();
                x[i] += by;
                f(&x)
            };
            let parts = (1..).map(|k| f64::from(k) * step).zip(WEIGHTS);
            let parts = parts.map(|(by, weight)| (at(by) - at(-by)) * (weight / step));
            parts.reduce(|a, b| a + b).expect("four of them")
        })
        .collect();
    DMatrix::from_columns(&columns)
}

/// The angle between two directions; from its sine as well, as the cosine of a small one has lost it.
fn angle(a: &Vector3<f64>, b: &Vector3<f64>) -> f64 {
    a.cross(b).norm().atan2(a.dot(b))
}

fn vector(x: &DVector<f64>, at: usize) -> Vector3<f64> {
    Vector3::new(x[at], x[at + 1], x[at + 2])
}

fn turn(x: &DVector<f64>, at: usize) -> UnitQuaternion<f64> {
    UnitQuaternion::from_quaternion(Quaternion::new(x[at], x[at + 1], x[at + 2], x[at + 3]))
}

fn ray(theta: f64, phi: f64) -> Vector3<f64> {
    Vector3::new(phi.cos() * theta.sin(), -phi.sin(), phi.cos() * theta.cos())
}

/// The point of a feature of six numbers or three.
fn point(x: &DVector<f64>, at: usize) -> Vector3<f64> {
    vector(x, at) + ray(x[at + 3], x[at + 4]) / x[at + 5]
}

/// `y = [r, theta, phi, rho]` of a ray `h` in C.
fn feature(pose: &DVector<f64>, h: &Vector3<f64>, rho: f64) -> DVector<f64> {
    let w = turn(pose, 3) * h;
    let (theta, phi) = (w.x.atan2(w.z), (-w.y).atan2(w.x.hypot(w.z)));
    DVector::from_vec(vec![pose[0], pose[1], pose[2], theta, phi, rho])
}

impl Reference {
    pub(crate) fn new(settings: &Settings, camera: &Camera) -> Self {
        let mut x = DVector::zeros(13);
        x[3] = 1.0;
        let mut p = DMatrix::zeros(13, 13);
        for i in 0..3 {
            p[(7 + i, 7 + i)] = settings.process.start_velocity_sd.powi(2);
            p[(10 + i, 10 + i)] = settings.process.start_angular_velocity_sd.powi(2);
        }
        Self {
            x,
            p,
            blocks: Vec::new(),
            settings: settings.clone(),
            camera: camera.clone(),
        }
    }

    pub(crate) fn offset(&self, id: u64) -> usize {
        let before = self.blocks.iter().take_while(|b| b.id != id);
        13 + before.map(|b| b.len).sum::<usize>()
    }

    /// Quaternions of the camera and of the clones.
    fn quaternions(&self) -> Vec<usize> {
        let clones = self.blocks.iter().filter(|b| b.len == 7);
        let clones = clones.map(|b| self.offset(b.id) + 3);
        std::iter::once(3).chain(clones).collect()
    }

    fn normalise(&mut self) {
        let quaternions = self.quaternions();
        let f = |x: &DVector<f64>| {
            let mut x = x.clone();
            for &at in &quaternions {
                let q = x.fixed_rows::<4>(at).normalize();
                x.fixed_rows_mut::<4>(at).copy_from(&q);
            }
            x
        };
        let j = jacobian(f, &self.x);
        self.p = &j * &self.p * j.transpose();
        self.x = f(&self.x);
    }

    pub(crate) fn predict(&mut self, dt: f64) {
        let moved = |x: &DVector<f64>| {
            let mut next = x.clone();
            let r = vector(x, 0) + vector(x, 7) * dt;
            let q = Quaternion::new(x[3], x[4], x[5], x[6])
                * UnitQuaternion::from_scaled_axis(vector(x, 10) * dt).into_inner();
            next.fixed_rows_mut::<3>(0).copy_from(&r);
            next.fixed_rows_mut::<4>(3)
                .copy_from(&nalgebra::Vector4::new(q.w, q.i, q.j, q.k));
            next
        };
        let f = jacobian(moved, &self.x);
        self.x = moved(&self.x);
        // Errors of position, attitude, velocity and angular velocity that the white acceleration leaves behind.
        let pushed = |e: &DVector<f64>| {
            let mut x = self.x.clone();
            let q = turn(&x, 3) * UnitQuaternion::from_scaled_axis(vector(e, 3));
            for i in 0..3 {
                x[i] += e[i];
                x[7 + i] += e[6 + i];
                x[10 + i] += e[9 + i];
            }
            x.fixed_rows_mut::<4>(3)
                .copy_from(&nalgebra::Vector4::new(q.w, q.i, q.j, q.k));
            x
        };
        let g = jacobian(pushed, &DVector::zeros(12));
        let process = &self.settings.process;
        let mut noise = DMatrix::zeros(12, 12);
        for i in 0..6 {
            let density = if i < 3 {
                process.acceleration_density
            } else {
                process.angular_acceleration_density
            };
            noise[(i, i)] = density.powi(2) * dt.powi(3) / 3.0;
            noise[(i, i + 6)] = density.powi(2) * dt.powi(2) / 2.0;
            noise[(i + 6, i)] = noise[(i, i + 6)];
            noise[(i + 6, i + 6)] = density.powi(2) * dt;
        }
        self.p = &f * &self.p * f.transpose() + &g * noise * g.transpose();
        self.normalise();
    }

    /// Appends a block `y = f(x, e)`, `e` being noise of this covariance about this mean.
    fn append(
        &mut self,
        id: u64,
        f: impl Fn(&DVector<f64>, &DVector<f64>) -> DVector<f64>,
        e: &DVector<f64>,
        noise: &DMatrix<f64>,
    ) {
        let y = f(&self.x, e);
        let (n, k) = (self.x.len(), y.len());
        let by_x = jacobian(|x| f(x, e), &self.x);
        let by_e = jacobian(|e| f(&self.x, e), e);
        let mut grow = DMatrix::identity(n + k, n);
        grow.view_mut((n, 0), (k, n)).copy_from(&by_x);
        self.p = &grow * &self.p * grow.transpose();
        let mut own = self.p.view_mut((n, n), (k, k));
        own += &by_e * noise * by_e.transpose();
        self.x = DVector::from_iterator(n + k, self.x.iter().chain(y.iter()).copied());
        self.blocks.push(Block { id, len: k });
    }

    pub(crate) fn clone_pose(&mut self, id: u64) {
        let none = DVector::zeros(1);
        self.append(
            id,
            |x, _| x.rows(0, 7).into_owned(),
            &none,
            &DMatrix::zeros(1, 1),
        );
    }

    pub(crate) fn born_undelayed(&mut self, id: u64, uv: &Vector2<f64>) {
        let (birth, sigma) = (&self.settings.birth, self.settings.pixel.sigma_cs);
        let noise = DVector::from_vec(vec![sigma, sigma, birth.undelayed_rho_sd]);
        let e = DVector::from_vec(vec![uv.x, uv.y, birth.undelayed_rho]);
        let camera = self.camera.clone();
        let f = |x: &DVector<f64>, e: &DVector<f64>| {
            let h = camera.unproject(&Vector2::new(e[0], e[1])).unwrap();
            feature(x, &h, e[2])
        };
        self.append(id, f, &e, &DMatrix::from_diagonal(&noise.map(|s| s * s)));
    }

    pub(crate) fn born_at_depth(&mut self, id: u64, uv: &Vector2<f64>, depth: f64, sd: f64) {
        let sigma = self.settings.pixel.sigma_cs;
        let noise = DVector::from_vec(vec![sigma, sigma, sd]);
        let e = DVector::from_vec(vec![uv.x, uv.y, depth]);
        let camera = self.camera.clone();
        let f = |x: &DVector<f64>, e: &DVector<f64>| {
            let point = at_depth(&camera, e);
            feature(x, &point, 1.0 / point.norm())
        };
        self.append(id, f, &e, &DMatrix::from_diagonal(&noise.map(|s| s * s)));
    }

    /// METHOD 5 by angles: two views of the same camera, the first of which is a clone.
    pub(crate) fn born_delayed(
        &mut self,
        id: u64,
        clone: u64,
        uv: &Vector2<f64>,
        first: &Vector2<f64>,
    ) {
        let at = self.offset(clone);
        let sigma = self.settings.pixel.sigma_cs;
        let e = DVector::from_vec(vec![uv.x, uv.y, first.x, first.y]);
        let camera = self.camera.clone();
        let f = |x: &DVector<f64>, e: &DVector<f64>| {
            let a = camera.unproject(&Vector2::new(e[0], e[1])).unwrap();
            let b = camera.unproject(&Vector2::new(e[2], e[3])).unwrap();
            let back = turn(x, 3).inverse();
            let t = back * (vector(x, at) - vector(x, 0));
            let b = back * (turn(x, at + 3) * b);
            let (beta, gamma) = (angle(&a, &t), angle(&b, &-t));
            let alpha = std::f64::consts::PI - beta - gamma;
            feature(x, &a, alpha.sin() / (t.norm() * gamma.sin()))
        };
        self.append(id, f, &e, &(DMatrix::identity(4, 4) * sigma * sigma));
    }

    /// One update with pixels, and depths in place of the pixels of their features.
    pub(crate) fn update(
        &mut self,
        pixels: &[(u64, Vector2<f64>)],
        depths: &[(u64, Vector2<f64>, f64, f64)],
    ) {
        let sigma = self.settings.pixel.sigma_cs;
        let camera = self.camera.clone();
        let mut h = DMatrix::zeros(0, self.x.len());
        let mut g: Vec<f64> = Vec::new();
        let mut noise: Vec<DMatrix<f64>> = Vec::new();
        let mut push =
            |f: &dyn Fn(&DVector<f64>) -> DVector<f64>, z: DVector<f64>, r: DMatrix<f64>| {
                let rows = jacobian(f, &self.x);
                let m = h.nrows();
                h = h.clone().resize_vertically(m + rows.nrows(), 0.0);
                h.rows_mut(m, rows.nrows()).copy_from(&rows);
                g.extend((z - f(&self.x)).iter());
                noise.push(r);
            };
        for &(id, uv, depth, sd) in depths {
            let at = self.offset(id);
            let f = |x: &DVector<f64>| {
                let w = point(x, at) - vector(x, 0);
                let h = turn(x, 3).inverse() * w;
                DVector::from_column_slice(h.as_slice())
            };
            let e = DVector::from_vec(vec![uv.x, uv.y, depth]);
            let measured =
                |e: &DVector<f64>| DVector::from_column_slice(at_depth(&camera, e).as_slice());
            let j = jacobian(measured, &e);
            let own = Matrix3::from_diagonal(&Vector3::new(sigma * sigma, sigma * sigma, sd * sd));
            push(&f, measured(&e), &j * own * j.transpose());
        }
        for &(id, uv) in pixels {
            if depths.iter().any(|d| d.0 == id) {
                continue;
            }
            let at = self.offset(id);
            let f = |x: &DVector<f64>| {
                let w = point(x, at) - vector(x, 0);
                let uv = camera.project(&(turn(x, 3).inverse() * w)).unwrap();
                DVector::from_column_slice(uv.as_slice())
            };
            push(
                &f,
                DVector::from_column_slice(uv.as_slice()),
                DMatrix::identity(2, 2) * sigma * sigma,
            );
        }
        if g.is_empty() {
            return;
        }
        let mut s = &h * &self.p * h.transpose();
        let mut at = 0;
        for r in &noise {
            let mut own = s.view_mut((at, at), r.shape());
            own += r;
            at += r.nrows();
        }
        let gain = &self.p * h.transpose() * s.clone().try_inverse().unwrap();
        self.x += &gain * DVector::from_vec(g);
        self.p -= &gain * s * gain.transpose();
        self.normalise();
    }

    /// Keeps only the blocks with these ids.
    pub(crate) fn keep(&mut self, ids: &[u64]) {
        let mut rows: Vec<usize> = (0..13).collect();
        for b in self.blocks.iter().filter(|b| ids.contains(&b.id)) {
            let at = self.offset(b.id);
            rows.extend(at..at + b.len);
        }
        self.x = self.x.select_rows(&rows);
        self.p = self.p.select_rows(&rows).select_columns(&rows);
        self.blocks.retain(|b| ids.contains(&b.id));
    }
}

fn at_depth(camera: &Camera, e: &DVector<f64>) -> Vector3<f64> {
    let h = camera.unproject(&Vector2::new(e[0], e[1])).unwrap();
    h * (e[2] / h.z)
}
