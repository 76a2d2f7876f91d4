//! Dot product.

use super::{Kernel, dispatch};
use pulp::Simd;

/// `a^T b` over the shorter of both.
pub(crate) fn dot(a: &[f64], b: &[f64]) -> f64 {
    dispatch(Dot { a, b })
}

pub(super) struct Dot<'a> {
    pub(super) a: &'a [f64],
    pub(super) b: &'a [f64],
}

impl Kernel for Dot<'_> {
    type Output = f64;
    #[inline(always)]
    fn run<S: Simd, const V: usize, const W: usize, const C: usize>(self, simd: S) -> f64 {
        let len = self.a.len().min(self.b.len());
        let (a, a_tail) = S::as_simd_f64s(&self.a[..len]);
        let (b, b_tail) = S::as_simd_f64s(&self.b[..len]);
        let (a4, a_rest) = a.as_chunks::<4>();
        let (b4, b_rest) = b.as_chunks::<4>();
        let mut sums = [simd.splat_f64s(0.0); 4];
        for k in 0..a4.len() {
            for v in 0..4 {
                sums[v] = simd.mul_add_f64s(a4[k][v], b4[k][v], sums[v]);
            }
        }
        for k in 0..a_rest.len() {
            sums[0] = simd.mul_add_f64s(a_rest[k], b_rest[k], sums[0]);
        }
        let pairs = simd.add_f64s(
            simd.add_f64s(sums[0], sums[1]),
            simd.add_f64s(sums[2], sums[3]),
        );
        let mut total = simd.reduce_sum_f64s(pairs);
        for k in 0..a_tail.len() {
            total += a_tail[k] * b_tail[k];
        }
        total
    }
}
