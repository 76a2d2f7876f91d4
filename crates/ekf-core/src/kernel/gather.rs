//! `P H^T` from the stored triangle of `P`: each row of `H` touches 13 to 19 columns.

use super::{HEIGHT, Kernel, Panels, Stored, dispatch};
use crate::observe::POSE_DIM;
use crate::observe::block::MeasurementBlock;
use crate::observe::shutter::MOTION_DIM;
use pulp::Simd;

/// Rows of a block's derivatives.
const MAX_ROWS: usize = 3;
/// Columns that a row can touch: the pose, velocities and readout, a feature, the error that matches share.
const TOUCHED: usize = POSE_DIM + MOTION_DIM + 12;
/// Numbers of a panel in the columns that matches share.
const SHARED: usize = 6 * HEIGHT;

/// `out = P H^T`, `out` being of that shape.
pub(crate) fn fill(p: Stored<'_>, blocks: &[MeasurementBlock], out: &mut Panels) {
    dispatch(Fill { p, blocks, out });
}

pub(super) struct Fill<'a> {
    pub(super) p: Stored<'a>,
    pub(super) blocks: &'a [MeasurementBlock],
    pub(super) out: &'a mut Panels,
}

impl Kernel for Fill<'_> {
    type Output = ();
    #[inline(always)]
    fn run<S: Simd, const V: usize, const W: usize, const C: usize>(self, simd: S) {
        let Self { p, blocks, out } = self;
        let columns = out.columns;
        let rolling = blocks.iter().find_map(|block| block.rows.by_motion);
        let mut touched = [0.0; TOUCHED * HEIGHT];
        let (mut error, mut roll) = ([0.0; SHARED], [0.0; SHARED]);
        for (index, panel) in out.data.chunks_exact_mut(out.stride).enumerate() {
            let row = index * HEIGHT;
            let (pose, others) = touched.split_at_mut(POSE_DIM * HEIGHT);
            let (motion, others) = others.split_at_mut(MOTION_DIM * HEIGHT);
            let (feature, shared) = others.split_at_mut(6 * HEIGHT);
            gather::<POSE_DIM>(p, row, 0, pose);
            if let Some(rolling) = rolling {
                let (velocities, readout) = motion.split_at_mut(6 * HEIGHT);
                gather::<6>(p, row, POSE_DIM, velocities);
                gather::<1>(p, row, p.slots[rolling.readout], readout);
            }
            let (mut error_at, mut roll_at) = (None, None);
            let mut column = 0;
            for block in blocks {
                let (first, own) = feature.split_at_mut(3 * HEIGHT);
                let (first_at, own_at) = block.slots(p.slots);
                gather::<3>(p, row, first_at, first);
                gather::<3>(p, row, own_at, own);
                if let Some(at) = block.shared {
                    if error_at != Some(at) {
                        gather::<6>(p, row, p.slots[at], &mut error);
                        error_at = Some(at);
                    }
                    if block.rows.roll.is_some() && roll_at != Some(at) {
                        gather::<6>(p, row, p.slots[at + 6], &mut roll);
                        roll_at = Some(at);
                    }
                    // The derivative by the roll is that by the error times the row's share of it.
                    let share = block.rows.roll.unwrap_or(0.0);
                    for ((both, error), roll) in shared.iter_mut().zip(&error).zip(&roll) {
                        *both = error + share * roll;
                    }
                }
                let columns = Touched {
                    pose: S::as_simd_f64s(pose).0.as_chunks::<C>().0,
                    motion: S::as_simd_f64s(motion).0.as_chunks::<C>().0,
                    feature: S::as_simd_f64s(feature).0.as_chunks::<C>().0,
                    shared: S::as_simd_f64s(shared).0.as_chunks::<C>().0,
                };
                let (to, _) = S::as_mut_simd_f64s(&mut panel[column * HEIGHT..]);
                let (to, _) = to.as_chunks_mut::<C>();
                combine::<S, C, 2>(simd, &columns, block, 0, to);
                if block.rows.count == 3 {
                    combine::<S, C, 1>(simd, &columns, block, 2, &mut to[2..]);
                }
                column += block.rows.count;
            }
            panel[columns * HEIGHT..].fill(0.0);
        }
    }
}

/// A panel's columns that a block touches.
struct Touched<'a, T, const C: usize> {
    pose: &'a [[T; C]],
    motion: &'a [[T; C]],
    feature: &'a [[T; C]],
    shared: &'a [[T; C]],
}

/// `R` rows of a block, from `first` on: as many columns of `P H^T`.
#[inline(always)]
fn combine<S: Simd, const C: usize, const R: usize>(
    simd: S,
    columns: &Touched<'_, S::f64s, C>,
    block: &MeasurementBlock,
    first: usize,
    out: &mut [[S::f64s; C]],
) {
    let mut sums = [[simd.splat_f64s(0.0); C]; R];
    let rows = &block.rows;
    add::<S, C, R>(
        simd,
        &mut sums,
        columns.pose,
        rows.by_pose.as_slice(),
        first,
    );
    if let Some(motion) = &rows.by_motion {
        add::<S, C, R>(simd, &mut sums, columns.motion, motion.by.as_slice(), first);
    }
    add::<S, C, R>(
        simd,
        &mut sums,
        columns.feature,
        rows.by_feature.as_slice(),
        first,
    );
    if let (Some(by_shared), Some(_)) = (&rows.by_shared, block.shared) {
        add::<S, C, R>(simd, &mut sums, columns.shared, by_shared.as_slice(), first);
    }
    out[..R].copy_from_slice(&sums);
}

/// Adds columns times the rows `first ..` of their derivatives. (A closure would not be inlined: it would lose SIMD.)
#[inline(always)]
fn add<S: Simd, const C: usize, const R: usize>(
    simd: S,
    sums: &mut [[S::f64s; C]; R],
    columns: &[[S::f64s; C]],
    by: &[f64],
    first: usize,
) {
    for (column, by) in columns.iter().zip(by.as_chunks::<MAX_ROWS>().0) {
        for r in 0..R {
            let factor = simd.splat_f64s(by[first + r]);
            for v in 0..C {
                sums[r][v] = simd.mul_add_f64s(column[v], factor, sums[r][v]);
            }
        }
    }
}

/// A panel of rows from `row` on, of `N` columns from `first` on.
#[inline(always)]
fn gather<const N: usize>(p: Stored<'_>, row: usize, first: usize, out: &mut [f64]) {
    let Some(out) = out.as_chunks_mut::<HEIGHT>().0.first_chunk_mut::<N>() else {
        return;
    };
    let rows = HEIGHT.min(p.n - row);
    if row >= first + N - 1 && rows == HEIGHT {
        for (c, column) in out.iter_mut().enumerate() {
            let from = row + (first + c) * p.ld;
            column.copy_from_slice(&p.data[from..from + HEIGHT]);
        }
        return;
    }
    if rows < HEIGHT {
        out.as_flattened_mut().fill(0.0);
    }
    for r in 0..rows {
        let i = row + r;
        if i <= first {
            let mirror = &p.data[first + i * p.ld..][..N];
            for c in 0..N {
                out[c][r] = mirror[c];
            }
        } else {
            for (c, column) in out.iter_mut().enumerate() {
                let (low, high) = (i.min(first + c), i.max(first + c));
                column[r] = p.data[high + low * p.ld];
            }
        }
    }
}
