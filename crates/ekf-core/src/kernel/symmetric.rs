//! `P -= V V^T` on the lower triangle.

use super::{HEIGHT, Kernel, Panels, dispatch, tile};
use pulp::Simd;

/// Columns of `V` that are taken at a time, so that two panels fit the first cache.
const DEPTH: usize = 128;
/// Numbers of `V` that stay in the second cache while the columns of `P` pass by.
const BLOCK: usize = 32 * 1024;

/// `P <- P - V V^T`; the lower triangle of `P` is stored column-major with leading dimension `ld`.
pub(crate) fn downdate(p: &mut [f64], ld: usize, v: &Panels) {
    dispatch(Downdate { p, ld, v });
}

struct Downdate<'a> {
    p: &'a mut [f64],
    ld: usize,
    v: &'a Panels,
}

impl Kernel for Downdate<'_> {
    type Output = ();
    #[inline(always)]
    fn run<S: Simd, const V: usize, const W: usize, const C: usize>(self, simd: S) {
        let Self { p, ld, v } = self;
        let panels = v.rows.div_ceil(HEIGHT);
        let depth = v.filled(W);
        for from in (0..depth).step_by(DEPTH) {
            let to = depth.min(from + DEPTH);
            let panel = |i: usize| &v.data[i * v.stride..][from * HEIGHT..to * HEIGHT];
            let block = (BLOCK / ((to - from) * HEIGHT)).max(1);
            for top in (0..panels).step_by(block) {
                let bottom = panels.min(top + block);
                for left in 0..bottom {
                    let columns = panel(left);
                    for row in top.max(left)..bottom {
                        let rows = panel(row);
                        let whole = row > left && (row + 1) * HEIGHT <= v.rows;
                        for at in (0..C).step_by(V) {
                            // On the diagonal, what is above it is left out.
                            let end = if row > left {
                                HEIGHT
                            } else {
                                (at + V) * S::F64_LANES
                            };
                            for first in (0..end).step_by(W) {
                                let sums = tile::<S, V, W, C>(simd, rows, at, columns, first);
                                let corner =
                                    (row * HEIGHT + at * S::F64_LANES, left * HEIGHT + first);
                                if whole {
                                    subtract(simd, p, ld, corner, &sums);
                                } else {
                                    subtract_part(simd, p, ld, v.rows, corner, &sums);
                                }
                            }
                        }
                    }
                }
            }
        }
    }
}

/// Takes a whole tile off.
#[inline(always)]
fn subtract<S: Simd, const V: usize, const W: usize>(
    simd: S,
    p: &mut [f64],
    ld: usize,
    (row, column): (usize, usize),
    sums: &[[S::f64s; V]; W],
) {
    for (w, sums) in sums.iter().enumerate() {
        let from = row + (column + w) * ld;
        let (to, _) = S::as_mut_simd_f64s(&mut p[from..from + V * S::F64_LANES]);
        for (to, sum) in to.iter_mut().zip(sums) {
            *to = simd.sub_f64s(*to, *sum);
        }
    }
}

/// Takes off what of a tile is on or below the diagonal and inside of the matrix.
#[inline(always)]
fn subtract_part<S: Simd, const V: usize, const W: usize>(
    _: S,
    p: &mut [f64],
    ld: usize,
    n: usize,
    (row, column): (usize, usize),
    sums: &[[S::f64s; V]; W],
) {
    let height = V * S::F64_LANES;
    for (w, sums) in sums.iter().enumerate() {
        let j = column + w;
        let mut values = [0.0; HEIGHT];
        S::as_mut_simd_f64s(&mut values[..height])
            .0
            .copy_from_slice(sums);
        for i in row.max(j)..n.min(row + height) {
            if j < n {
                p[i + j * ld] -= values[i - row];
            }
        }
    }
}
