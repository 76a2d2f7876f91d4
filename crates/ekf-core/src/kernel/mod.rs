//! The hot loops of the update, in SIMD chosen at run time ([`pulp`], no `unsafe`).
//!
//! A tall matrix is kept in *panels*: `height` rows at a time, column after column, so that a register tile reads it
//! in one sweep. `P H^T` is built in panels, becomes `V = P H^T L^-T` where it lies, and feeds `P -= V V^T` from both
//! sides: nothing is packed or copied on the way. See [`performance`](crate::performance) for the figures.

mod aligned;
mod dot;
mod gather;
mod panels;
mod solve;
mod symmetric;
#[cfg(test)]
mod tests;
mod transform;

pub(crate) use aligned::{Aligned, LINE};
pub(crate) use dot::dot;
pub(crate) use gather::fill;
pub(crate) use panels::{Panels, Stored};
pub(crate) use solve::solve;
pub(crate) use symmetric::{Product, downdate, times};
pub(crate) use transform::transform;

use pulp::{Arch, Simd, WithSimd};

/// Rows of a panel: some whole tiles of every SIMD width, and some whole widths of a tile.
const HEIGHT: usize = 24;

/// A kernel for register tiles of `V` vectors by `W` columns; a panel is `C` vectors high.
trait Kernel: Sized {
    type Output;
    fn run<S: Simd, const V: usize, const W: usize, const C: usize>(self, simd: S) -> Self::Output;
}

struct Dispatch<K>(K);

impl<K: Kernel> WithSimd for Dispatch<K> {
    type Output = K::Output;
    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> K::Output {
        // The sums, the vectors of a tile and one number broadcast fit 16 registers (AVX2) or 32 (the others).
        match S::F64_LANES {
            8 => self.0.run::<S, 3, 8, 3>(simd),
            4 => self.0.run::<S, 2, 6, 6>(simd),
            2 => self.0.run::<S, 4, 6, 12>(simd),
            _ => self.0.run::<S, 4, 6, 24>(simd),
        }
    }
}

fn dispatch<K: Kernel>(kernel: K) -> K::Output {
    Arch::new().dispatch(Dispatch(kernel))
}

/// Sums of products of a panel's vectors from `at` on and a panel's numbers from `from` on, column by column:
/// `sum_k a[k][at + v] * b[k][from + w]`.
#[inline(always)]
fn tile<S: Simd, const V: usize, const W: usize, const C: usize>(
    simd: S,
    a: &[f64],
    at: usize,
    b: &[f64],
    from: usize,
) -> [[S::f64s; V]; W] {
    let none = [[simd.splat_f64s(0.0); V]; W];
    add_tile::<S, V, W, C>(simd, none, a, at, b, from)
}

/// The same, added to sums of before.
#[inline(always)]
fn add_tile<S: Simd, const V: usize, const W: usize, const C: usize>(
    simd: S,
    mut sums: [[S::f64s; V]; W],
    a: &[f64],
    at: usize,
    b: &[f64],
    from: usize,
) -> [[S::f64s; V]; W] {
    let (a, _) = S::as_simd_f64s(a);
    let (a, _) = a.as_chunks::<C>();
    let (b, _) = b.as_chunks::<HEIGHT>();
    // What the compiler needs to leave out every check below.
    let depth = a.len();
    let b = &b[..depth];
    assert!(at + V <= C && from + W <= HEIGHT, "a tile of a panel");
    for k in 0..depth {
        let (a, b) = (&a[k], &b[k]);
        for w in 0..W {
            let b = simd.splat_f64s(b[from + w]);
            for v in 0..V {
                sums[w][v] = simd.mul_add_f64s(a[at + v], b, sums[w][v]);
            }
        }
    }
    sums
}
