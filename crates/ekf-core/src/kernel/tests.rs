//! Every kernel against plain sums, with the SIMD of this machine and without.

use super::panels::{Panels, Stored};
use super::symmetric::{Downdate, Product, Times};
use super::{Dispatch, HEIGHT, Kernel, dot, gather, solve, transform};
use crate::observe::block::MeasurementBlock;
use crate::observe::{ByMotion, FEATURE_DIM, Rows};
use nalgebra::{DMatrix, DVector, Matrix3, SMatrix, Vector3};
use pulp::{Arch, Scalar, WithSimd};

/// One number of a fixed sequence.
fn wave(i: usize, j: usize) -> f64 {
    ((i * 7919 + j * 104_729 + 13) % 1013) as f64 / 1013.0 - 0.5
}

fn matrix(rows: usize, columns: usize) -> DMatrix<f64> {
    DMatrix::from_fn(rows, columns, wave)
}

fn symmetric(n: usize) -> DMatrix<f64> {
    let root = matrix(n, n);
    &root * root.transpose() + DMatrix::identity(n, n)
}

/// How a kernel is run: as the filter does, or without SIMD.
#[derive(Clone, Copy, Debug)]
enum With {
    Simd,
    Scalar,
}

fn run<K: Kernel>(with: With, kernel: K) -> K::Output {
    match with {
        With::Simd => Arch::new().dispatch(Dispatch(kernel)),
        With::Scalar => Dispatch(kernel).with_simd(Scalar),
    }
}

/// The lower triangle, column-major with leading dimension `ld`; NaN where nothing may be read.
fn lower(p: &DMatrix<f64>, ld: usize) -> Vec<f64> {
    let n = p.nrows();
    let mut data = vec![f64::NAN; ld * ld];
    for j in 0..n {
        for i in j..n {
            data[i + j * ld] = p[(i, j)];
        }
    }
    data
}

fn panels(a: &DMatrix<f64>) -> Panels {
    let mut out = Panels::default();
    out.reshape(a.nrows(), a.ncols());
    for k in 0..out.stride / HEIGHT {
        let column = (0..a.nrows()).map(|i| if k < a.ncols() { a[(i, k)] } else { 0.0 });
        out.set_column(k, column);
    }
    out
}

fn close(what: &str, got: f64, expected: f64) {
    let off = (got - expected).abs();
    assert!(off < 1e-11 * (1.0 + expected.abs()), "{what}: {off:e}");
}

/// Sizes with whole and broken panels, vectors and tiles; some deeper than what is taken at a time.
const SIZES: [(usize, usize); 6] = [(13, 2), (24, 6), (47, 13), (61, 24), (96, 80), (75, 150)];
const BOTH: [With; 2] = [With::Simd, With::Scalar];

#[test]
fn downdate_is_its_sum() {
    for with in BOTH {
        for (n, m) in SIZES {
            let (p, v) = (symmetric(n), matrix(n, m));
            let x = DMatrix::from_fn(n, 8, |i, j| wave(i, j + 500));
            let swap = |j: usize| (j + 4) % 8;
            // Symmetric: the second half is the first one with both sides exchanged.
            let y = DMatrix::from_fn(n, 8, |i, j| -x[(i, swap(j))]);
            let also = Product {
                x: panels(&x),
                y: panels(&y),
            };
            for also in [None, Some(&also)] {
                let mut data = lower(&p, n + 3);
                let v_panels = panels(&v);
                let kernel = Downdate {
                    p: &mut data,
                    ld: n + 3,
                    v: &v_panels,
                    also,
                };
                run(with, kernel);
                let mut expected = &p - &v * v.transpose();
                if also.is_some() {
                    expected -= &x * y.transpose();
                }
                for j in 0..n {
                    for i in j..n {
                        let what = format!("{with:?} downdate {n} {m} at {i} {j}");
                        close(&what, data[i + j * (n + 3)], expected[(i, j)]);
                    }
                }
            }
        }
    }
}

#[test]
fn times_is_its_sum() {
    for with in BOTH {
        for (n, _) in SIZES {
            let p = symmetric(n);
            for idle in [vec![], vec![2..5, 9..n]] {
                let is_idle = |i: usize| idle.iter().any(|stretch| stretch.contains(&i));
                let b = DVector::from_fn(n, |i, _| if is_idle(i) { 0.0 } else { wave(i, 3) });
                let (data, mut out) = (lower(&p, n + 5), vec![f64::NAN; n]);
                let kernel = Times {
                    p: &data,
                    ld: n + 5,
                    b: b.as_slice(),
                    idle: &idle,
                    out: &mut out,
                };
                run(with, kernel);
                for (got, expected) in out.iter().zip((&p * b).iter()) {
                    close(&format!("{with:?} times {n} {idle:?}"), *got, *expected);
                }
            }
        }
    }
}

#[test]
fn solve_is_its_inverse() {
    for with in BOTH {
        for (n, m) in SIZES {
            let (a, w) = (matrix(n, m), matrix(m, 5));
            let l = symmetric(m).cholesky().expect("positive definite").l();
            let expected = l.solve_lower_triangular(&a.transpose()).expect("regular");
            let (expected, mut moved) = (expected.transpose(), vec![f64::NAN; 5 * n]);
            let mut squares = vec![f64::NAN; n];
            let (mut out, mut packed) = (panels(&a), Vec::new());
            let kernel = solve::Solve {
                a: &mut out,
                l: l.as_slice(),
                w: w.as_slice(),
                x: &mut moved,
                squares: &mut squares,
                packed: &mut packed,
            };
            run(with, kernel);
            let products = &expected * &w;
            for i in 0..n {
                close(
                    &format!("{with:?} squares {n} {m}"),
                    squares[i],
                    expected.row(i).norm_squared(),
                );
                for k in 0..m {
                    close(
                        &format!("{with:?} solve {n} {m}"),
                        out.get(i, k),
                        expected[(i, k)],
                    );
                }
                for k in 0..5 {
                    close(
                        &format!("{with:?} product {n} {m}"),
                        moved[i + k * n],
                        products[(i, k)],
                    );
                }
            }
        }
    }
}

#[test]
fn dot_is_its_sum() {
    for with in BOTH {
        for n in [0, 1, 3, 4, 7, 16, 33, 100] {
            let (a, b) = (matrix(n, 1), DMatrix::from_fn(n, 1, |i, _| wave(i, 9)));
            let kernel = dot::Dot {
                a: a.as_slice(),
                b: b.as_slice(),
            };
            close(&format!("{with:?} dot {n}"), run(with, kernel), a.dot(&b));
        }
    }
}

#[test]
fn transform_maps_the_rows_below() {
    let f = SMatrix::<f64, 4, 4>::from_fn(|i, j| wave(i, j + 40) + f64::from(u8::from(i == j)));
    for with in BOTH {
        for n in [9, 24, 53] {
            let p = symmetric(n);
            let mut data = lower(&p, n + 1);
            let kernel = transform::Transform {
                p: &mut data,
                ld: n + 1,
                n,
                start: 3,
                f: &f,
            };
            run(with, kernel);
            for i in 7..n {
                for r in 0..4 {
                    let expected: f64 = (0..4).map(|c| f[(r, c)] * p[(i, 3 + c)]).sum();
                    close(
                        &format!("{with:?} transform {n}"),
                        data[i + (3 + r) * (n + 1)],
                        expected,
                    );
                }
            }
        }
    }
}

#[test]
fn fill_is_p_times_h() {
    for with in BOTH {
        let n = 67;
        let p = symmetric(n);
        let (data, slots): (Vec<f64>, Vec<usize>) = (lower(&p, n), (0..n).collect());
        let block = |count: usize, feature: usize, worn: Option<usize>| MeasurementBlock {
            rows: Rows {
                innovation: Vector3::zeros(),
                by_pose: SMatrix::from_fn(|i, j| wave(i + feature, j)),
                by_motion: (feature == 13).then(|| ByMotion {
                    readout: 54,
                    by: SMatrix::from_fn(|i, j| wave(i + feature, j + 40)),
                }),
                by_feature: SMatrix::from_fn(|i, j| wave(i + feature, j + 20)),
                by_shared: worn.map(|_| SMatrix::from_fn(|i, j| wave(i + feature, j + 60))),
                roll: (feature == 55).then_some(-0.3),
                noise: Matrix3::identity(),
                count,
            },
            id: 0,
            feature,
            shared: worn,
            told: None,
        };
        let blocks = [
            block(2, 13, None),
            block(3, 31, Some(37)),
            block(2, 55, Some(37)),
            block(3, 19, None),
            block(2, 61, None),
        ];
        let mut out = Panels::default();
        out.reshape(n, 12);
        let stored = Stored {
            data: &data,
            ld: n,
            n,
            slots: &slots,
        };
        let kernel = gather::Fill {
            p: stored,
            blocks: &blocks,
            out: &mut out,
        };
        run(with, kernel);
        let mut k = 0;
        for block in &blocks {
            for r in 0..block.rows.count {
                let mut h = DVector::zeros(n);
                for c in 0..7 {
                    h[c] = block.rows.by_pose[(r, c)];
                }
                if let Some(motion) = &block.rows.by_motion {
                    for (c, at) in (7..13).chain([motion.readout]).enumerate() {
                        h[at] = motion.by[(r, c)];
                    }
                }
                for c in 0..FEATURE_DIM {
                    h[block.feature + c] = block.rows.by_feature[(r, c)];
                }
                for c in 0..6 {
                    if let (Some(by_shared), Some(at)) = (&block.rows.by_shared, block.shared) {
                        h[at + c] = by_shared[(r, c)];
                        if let Some(share) = block.rows.roll {
                            h[at + 6 + c] = share * by_shared[(r, c)];
                        }
                    }
                }
                let expected = &p * h;
                for i in 0..n {
                    close(&format!("{with:?} fill {k}"), out.get(i, k), expected[i]);
                }
                k += 1;
            }
        }
    }
}
