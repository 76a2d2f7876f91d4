//! `P <- F P F^T` for a small square `F` in the middle of an identity.

use super::{Kernel, dispatch};
use nalgebra::SMatrix;
use pulp::Simd;

/// Maps the rows below a diagonal block, `P[below, start ..] <- P[below, start ..] F^T`. Column-major, `ld`; `n` rows.
pub(crate) fn transform<const K: usize>(
    p: &mut [f64],
    ld: usize,
    n: usize,
    start: usize,
    f: &SMatrix<f64, K, K>,
) {
    dispatch(Transform { p, ld, n, start, f });
}

pub(super) struct Transform<'a, const K: usize> {
    pub(super) p: &'a mut [f64],
    pub(super) ld: usize,
    pub(super) n: usize,
    pub(super) start: usize,
    pub(super) f: &'a SMatrix<f64, K, K>,
}

impl<const K: usize> Kernel for Transform<'_, K> {
    type Output = ();
    #[inline(always)]
    fn run<S: Simd, const V: usize, const W: usize, const C: usize>(self, simd: S) {
        let Self { p, ld, n, start, f } = self;
        let lanes = S::F64_LANES;
        let mut row = start + K;
        while row < n {
            let count = lanes.min(n - row);
            let mut old = [simd.splat_f64s(0.0); K];
            for (c, old) in old.iter_mut().enumerate() {
                let from = row + (start + c) * ld;
                *old = simd.partial_load_f64s(&p[from..from + count]);
            }
            for r in 0..K {
                let mut sum = simd.splat_f64s(0.0);
                for (c, old) in old.iter().enumerate() {
                    // F is close to an identity.
                    if f[(r, c)] != 0.0 {
                        sum = simd.mul_add_f64s(*old, simd.splat_f64s(f[(r, c)]), sum);
                    }
                }
                let to = row + (start + r) * ld;
                simd.partial_store_f64s(&mut p[to..to + count], sum);
            }
            row += count;
        }
    }
}
