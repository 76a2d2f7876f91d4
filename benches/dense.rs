//! The plain dense update, as a textbook writes it: what the core is compared with.

use nalgebra::{DMatrix, DVector};

/// Mean, covariance and dense measurement.
#[derive(Clone, Debug)]
pub struct Dense {
    x: DVector<f64>,
    p: DMatrix<f64>,
    h: DMatrix<f64>,
    r: DMatrix<f64>,
    g: DVector<f64>,
}

impl Dense {
    /// A state of `13 + 6 n` and `m` rows, `H` with its 13 columns of a pixel row at random places.
    pub fn new(n: usize, m: usize) -> Self {
        let dim = 13 + 6 * n;
        let wave = |i: usize, j: usize| ((i * 7919 + j * 104_729) % 1013) as f64 / 1013.0 - 0.5;
        let root = DMatrix::from_fn(dim, dim, wave);
        let mut h = DMatrix::zeros(m, dim);
        for row in 0..m {
            let feature = 13 + 6 * (row / 2 % n);
            for c in (0..7).chain(feature..feature + 6) {
                h[(row, c)] = wave(row, c);
            }
        }
        Self {
            x: DVector::zeros(dim),
            p: &root * root.transpose() / dim as f64 + DMatrix::identity(dim, dim),
            h,
            r: DMatrix::identity(m, m),
            g: DVector::from_fn(m, |i, _| wave(i, 1)),
        }
    }

    /// `K = P H^T S^-1; x += K g; P -= K S K^T`, nothing left out of the products.
    pub fn update(&mut self) {
        let pht = &self.p * self.h.transpose();
        let s = &self.h * &pht + &self.r;
        let factor = s.clone().cholesky().expect("S is positive definite");
        let gain = factor.solve(&pht.transpose()).transpose();
        self.x += &gain * &self.g;
        self.p -= &gain * s * gain.transpose();
    }
}
