//! `V = A L^-T` where `A` lies, and what it does to the mean.

use super::{HEIGHT, Kernel, Panels, dispatch, tile};
use pulp::Simd;

/// `a <- a L^-T`, `x = a y` with the new `a`. `l` is `m x m`, lower triangle, column-major; `packed` is scratch.
pub(crate) fn solve(a: &mut Panels, l: &[f64], y: &[f64], x: &mut [f64], packed: &mut Vec<f64>) {
    dispatch(Solve { a, l, y, x, packed });
}

struct Solve<'a> {
    a: &'a mut Panels,
    l: &'a [f64],
    y: &'a [f64],
    x: &'a mut [f64],
    packed: &'a mut Vec<f64>,
}

impl Kernel for Solve<'_> {
    type Output = ();
    #[inline(always)]
    fn run<S: Simd, const V: usize, const W: usize, const C: usize>(self, simd: S) {
        let Self { a, l, y, x, packed } = self;
        let m = y.len();
        pack::<W>(l, m, packed);
        for (panel, x) in a.data.chunks_exact_mut(a.stride).zip(x.chunks_mut(HEIGHT)) {
            let mut moved = [0.0; HEIGHT];
            let (moved_vectors, _) = S::as_mut_simd_f64s(&mut moved);
            for at in (0..C).step_by(V) {
                // Row block after row block of L: `W` rows up to the diagonal, then their triangle.
                let mut rest = packed.as_slice();
                for first in (0..m).step_by(W) {
                    let (block, later) = rest.split_at((first + W) * HEIGHT);
                    rest = later;
                    let (before, diagonal) = block.split_at(first * HEIGHT);
                    let (done, open) = panel.split_at_mut(first * HEIGHT);
                    let sums = tile::<S, V, W, C>(simd, done, at, before, 0);
                    let (open, _) = S::as_mut_simd_f64s(&mut open[..W * HEIGHT]);
                    let (open, _) = open.as_chunks_mut::<C>();
                    assert!(open.len() == W && at + V <= C, "a tile of a panel");
                    for j in 0..W {
                        let inverse = simd.splat_f64s(diagonal[j * HEIGHT + j]);
                        let weight = simd.splat_f64s(y.get(first + j).copied().unwrap_or(0.0));
                        for v in 0..V {
                            let mut value = simd.sub_f64s(open[j][at + v], sums[j][v]);
                            for i in 0..j {
                                let factor = simd.splat_f64s(-diagonal[i * HEIGHT + j]);
                                value = simd.mul_add_f64s(open[i][at + v], factor, value);
                            }
                            value = simd.mul_f64s(value, inverse);
                            let sum = &mut moved_vectors[at + v];
                            *sum = simd.mul_add_f64s(value, weight, *sum);
                            open[j][at + v] = value;
                        }
                    }
                }
            }
            for (x, moved) in x.iter_mut().zip(&moved) {
                *x = *moved;
            }
        }
    }
}

/// Row blocks of `L`, `W` rows each, column after column up to the diagonal; the diagonal inverted, zeros past the end.
/// A column takes the room of a panel's.
fn pack<const W: usize>(l: &[f64], m: usize, packed: &mut Vec<f64>) {
    packed.clear();
    for first in (0..m).step_by(W) {
        for column in 0..first + W {
            let mut rows = [0.0; HEIGHT];
            for (value, row) in rows.iter_mut().zip(first.max(column)..m.min(first + W)) {
                *value = l[row + column * m];
            }
            if column > first {
                rows.rotate_right(column - first);
            }
            if column >= first && column < m {
                rows[column - first] = 1.0 / rows[column - first];
            }
            packed.extend_from_slice(&rows);
        }
    }
}
