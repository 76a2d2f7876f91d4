//! `V = A L^-T` where `A` lies, what it does to the mean, and what it takes off the variances.

use super::{HEIGHT, Kernel, Panels, dispatch, tile};
use pulp::Simd;

/// `a <- a L^-T`, `x = a w` with the new `a`. `l` is `m x m`, lower triangle; `w` has up to six columns, and `x` as many;
/// all are column-major. `squares` are the sums of squares of the new rows of `a`. `packed` is scratch.
pub(crate) fn solve(
    a: &mut Panels,
    l: &[f64],
    w: &[f64],
    (x, squares): (&mut [f64], &mut [f64]),
    packed: &mut Vec<f64>,
) {
    dispatch(Solve {
        a,
        l,
        w,
        x,
        squares,
        packed,
    });
}

pub(super) struct Solve<'a> {
    pub(super) a: &'a mut Panels,
    pub(super) l: &'a [f64],
    pub(super) w: &'a [f64],
    pub(super) x: &'a mut [f64],
    pub(super) squares: &'a mut [f64],
    pub(super) packed: &'a mut Vec<f64>,
}

impl Kernel for Solve<'_> {
    type Output = ();
    #[inline(always)]
    fn run<S: Simd, const V: usize, const W: usize, const C: usize>(self, simd: S) {
        let Self {
            a,
            l,
            w,
            x,
            squares,
            packed,
        } = self;
        let (m, n) = (a.columns, a.rows);
        let products = x.len() / n;
        assert!(products <= W, "the products of a row fit a tile");
        pack::<W>(l, m, packed);
        let factor = packed.len();
        pack_columns(w, m, a.stride / HEIGHT, packed);
        let (blocks, weights) = packed.split_at(factor);
        for (index, panel) in a.data.chunks_exact_mut(a.stride).enumerate() {
            for at in (0..C).step_by(V) {
                // Row block after row block of L: `W` rows up to the diagonal, then their triangle.
                let mut rest = blocks;
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
                        for v in 0..V {
                            let mut value = simd.sub_f64s(open[j][at + v], sums[j][v]);
                            for i in 0..j {
                                let factor = simd.splat_f64s(-diagonal[i * HEIGHT + j]);
                                value = simd.mul_add_f64s(open[i][at + v], factor, value);
                            }
                            value = simd.mul_f64s(value, inverse);
                            open[j][at + v] = value;
                        }
                    }
                }
            }
            for at in (0..C).step_by(V) {
                let first = index * HEIGHT + at * S::F64_LANES;
                if first >= n {
                    break;
                }
                let rows = (V * S::F64_LANES).min(n - first);
                let sums = tile::<S, V, W, C>(simd, panel, at, weights, 0);
                for (column, sums) in sums.iter().enumerate().take(products) {
                    write::<S, V>(sums, &mut x[column * n + first..][..rows]);
                }
                let sums = row_squares::<S, V, C>(simd, &panel[..m * HEIGHT], at);
                write::<S, V>(&sums, &mut squares[first..][..rows]);
            }
        }
    }
}

/// Sums of squares of a panel's rows, those of the vectors from `at` on.
#[inline(always)]
fn row_squares<S: Simd, const V: usize, const C: usize>(
    simd: S,
    panel: &[f64],
    at: usize,
) -> [S::f64s; V] {
    let (columns, _) = S::as_simd_f64s(panel);
    let (columns, _) = columns.as_chunks::<C>();
    let mut sums = [simd.splat_f64s(0.0); V];
    for column in columns {
        for v in 0..V {
            let entry = column[at + v];
            sums[v] = simd.mul_add_f64s(entry, entry, sums[v]);
        }
    }
    sums
}

/// The first numbers of some vectors.
#[inline(always)]
fn write<S: Simd, const V: usize>(vectors: &[S::f64s; V], to: &mut [f64]) {
    let mut values = [0.0; HEIGHT];
    let whole = &mut values[..V * S::F64_LANES];
    S::as_mut_simd_f64s(whole).0.copy_from_slice(vectors);
    to.copy_from_slice(&values[..to.len()]);
}

/// The few columns of `w`, `m` rows each, row by row, a row taking the room of a panel's column.
fn pack_columns(w: &[f64], m: usize, rows: usize, packed: &mut Vec<f64>) {
    for row in 0..rows {
        let mut values = [0.0; HEIGHT];
        if row < m {
            for (value, column) in values.iter_mut().zip(w.chunks_exact(m)) {
                *value = column[row];
            }
        }
        packed.extend_from_slice(&values);
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
