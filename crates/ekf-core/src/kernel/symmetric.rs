//! `P -= V V^T` on the lower triangle, and `P b`.

use super::{HEIGHT, Kernel, Panels, add_tile, dispatch, tile};
use pulp::Simd;
use std::ops::Range;

/// Columns of `V` that are taken at a time, so that two panels fit the first cache.
const DEPTH: usize = 128;
/// Numbers of `V` that stay in the second cache while the columns of `P` pass by.
const BLOCK: usize = 32 * 1024;

/// `X Y^T`, symmetric, of a few columns.
#[derive(Clone, Debug, Default)]
pub(crate) struct Product {
    pub(crate) x: Panels,
    pub(crate) y: Panels,
}

/// `P <- P - V V^T - X Y^T` in one pass; the lower triangle of `P` is stored column-major with leading dimension `ld`.
pub(crate) fn downdate(p: &mut [f64], ld: usize, v: &Panels, also: Option<&Product>) {
    dispatch(Downdate { p, ld, v, also });
}

pub(super) struct Downdate<'a> {
    pub(super) p: &'a mut [f64],
    pub(super) ld: usize,
    pub(super) v: &'a Panels,
    pub(super) also: Option<&'a Product>,
}

impl Kernel for Downdate<'_> {
    type Output = ();
    #[inline(always)]
    fn run<S: Simd, const V: usize, const W: usize, const C: usize>(self, simd: S) {
        let Self { p, ld, v, also } = self;
        let n = also.map_or(v.rows, |also| also.x.rows);
        let panels = n.div_ceil(HEIGHT);
        let depth = v.filled(W);
        for from in (0..depth.max(1)).step_by(DEPTH) {
            let to = depth.min(from + DEPTH);
            let also = also.filter(|_| to == depth);
            let panel = |i: usize| &v.data[i * v.stride..][from * HEIGHT..to * HEIGHT];
            let block = (BLOCK / ((to - from) * HEIGHT).max(1)).max(1);
            for top in (0..panels).step_by(block) {
                let bottom = panels.min(top + block);
                for left in 0..bottom {
                    let columns = panel(left);
                    for row in top.max(left)..bottom {
                        let rows = panel(row);
                        let whole = row > left && (row + 1) * HEIGHT <= n;
                        for at in (0..C).step_by(V) {
                            // On the diagonal, what is above it is left out.
                            let end = if row > left {
                                HEIGHT
                            } else {
                                (at + V) * S::F64_LANES
                            };
                            for first in (0..end).step_by(W) {
                                let mut sums = tile::<S, V, W, C>(simd, rows, at, columns, first);
                                if let Some(Product { x, y }) = also {
                                    let x = &x.data[row * x.stride..][..x.columns * HEIGHT];
                                    let y = &y.data[left * y.stride..][..y.columns * HEIGHT];
                                    sums = add_tile::<S, V, W, C>(simd, sums, x, at, y, first);
                                }
                                let corner =
                                    (row * HEIGHT + at * S::F64_LANES, left * HEIGHT + first);
                                if whole {
                                    subtract(simd, p, ld, corner, &sums);
                                } else {
                                    subtract_part(simd, p, ld, n, corner, &sums);
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

/// `P b`, one pass over the lower triangle, but for the triangles of the stretches `idle` (increasing), where `b` is zero.
pub(crate) fn times(p: &[f64], ld: usize, b: &[f64], idle: &[Range<usize>], out: &mut [f64]) {
    dispatch(Times {
        p,
        ld,
        b,
        idle,
        out,
    });
}

pub(super) struct Times<'a> {
    pub(super) p: &'a [f64],
    pub(super) ld: usize,
    pub(super) b: &'a [f64],
    pub(super) idle: &'a [Range<usize>],
    pub(super) out: &'a mut [f64],
}

impl Kernel for Times<'_> {
    type Output = ();
    #[inline(always)]
    fn run<S: Simd, const V: usize, const W: usize, const C: usize>(self, simd: S) {
        let Self {
            p,
            ld,
            b,
            idle,
            out,
        } = self;
        let n = b.len();
        let mut idle = idle.iter().peekable();
        out.fill(0.0);
        for j in 0..n {
            while idle.next_if(|stretch| stretch.end <= j).is_some() {}
            let stretch = idle.peek().filter(|stretch| stretch.start <= j);
            let next = stretch.map_or(j + 1, |stretch| stretch.end);
            let (above, out) = out[..n].split_at_mut(next);
            let own = &mut above[j];
            let (column, column_tail) = S::as_simd_f64s(&p[next + j * ld..n + j * ld]);
            let (below, below_tail) = S::as_simd_f64s(&b[next..]);
            let (out, out_tail) = S::as_mut_simd_f64s(out);
            let weight = simd.splat_f64s(b[j]);
            let mut sums = [simd.splat_f64s(0.0); 2];
            for i in 0..column.len() {
                out[i] = simd.mul_add_f64s(column[i], weight, out[i]);
                sums[i % 2] = simd.mul_add_f64s(column[i], below[i], sums[i % 2]);
            }
            let mut sum = p[j * (ld + 1)] * b[j];
            for i in 0..column_tail.len() {
                out_tail[i] += column_tail[i] * b[j];
                sum += column_tail[i] * below_tail[i];
            }
            *own += sum + simd.reduce_sum_f64s(simd.add_f64s(sums[0], sums[1]));
        }
    }
}
