//! Buffers of [`hohct`](crate::validate::hohct), and what is prepared in them: the whitened `A` and `z`, and the greedy set.

use super::greedy::Greedy;
use super::level::{Level, Sums};
use super::pigeonhole::Pigeonhole;
use super::thresholds::Thresholds;
use crate::validate::batch::Blocks;
use crate::validate::distance::dot;
use crate::validate::quantiles::Quantiles;
use faer::linalg::matmul::triangular::{BlockStructure, matmul};
use faer::linalg::triangular_inverse::invert_lower_triangular;
use faer::{Accum, MatMut, MatRef, Par};

/// Buffers of the search.
#[derive(Clone, Debug, Default)]
pub(in crate::validate) struct Scratch {
    pub(super) inverse: Vec<f64>,
    /// Whitened `A`, both triangles, `m x m`.
    pub(in crate::validate) a: Vec<f64>,
    /// Whitened `z`.
    pub(in crate::validate) z: Vec<f64>,
    pub(in crate::validate) greedy: Greedy,
    pub(super) levels: Vec<Level>,
    pub(super) pigeonhole: Pigeonhole,
    pub(super) sums: Sums,
    pub(super) thresholds: Thresholds,
    pub(in crate::validate) best: Vec<usize>,
}

impl Scratch {
    /// Whitened `z`, from `y = L^-1 g`.
    ///
    /// With `A = L^-T L^-1`, scaling the columns of `L^-1` by `K_i^-1`, `A_ii = K_i^T K_i` with `K_i` lower
    /// triangular, keeps them lower triangular: the whitened `A` is `B^T B`, the whitened `z` is `B^T (L^-1 g)`.
    pub(in crate::validate) fn prepare_z(
        &mut self,
        l: &[f64],
        ld: usize,
        y: &[f64],
        blocks: Blocks,
    ) {
        let (m, n) = (y.len(), blocks.len());
        self.inverse.resize(m * m, 0.0);
        invert_lower_triangular(
            MatMut::from_column_major_slice_mut(&mut self.inverse[..m * m], m, m),
            MatRef::from_column_major_slice_with_stride(l, m, m, ld),
            Par::Seq,
        );
        self.z.clear();
        for block in 0..n {
            whiten_columns(
                &mut self.inverse,
                m,
                blocks.start(block),
                blocks.count(block),
            );
            for row in blocks.start(block)..blocks.start(block) + blocks.count(block) {
                let column = &self.inverse[row * m + row..(row + 1) * m];
                self.z.push(dot(column, &y[row..]));
            }
        }
    }

    /// Whitened `A`, after [`Self::prepare_z`].
    pub(in crate::validate) fn prepare_a(&mut self, blocks: Blocks) {
        let m = blocks.rows();
        self.a.resize(m * m, 0.0);
        let b = MatRef::from_column_major_slice(&self.inverse[..m * m], m, m);
        matmul(
            MatMut::from_column_major_slice_mut(&mut self.a[..m * m], m, m),
            BlockStructure::TriangularLower,
            Accum::Replace,
            b.transpose(),
            BlockStructure::TriangularUpper,
            b,
            BlockStructure::TriangularLower,
            1.0,
            Par::Seq,
        );
        for column in 0..m {
            for row in column + 1..m {
                self.a[row * m + column] = self.a[column * m + row];
            }
        }
    }

    /// Grows `G` until the rest passes (then true) or `max_order` blocks are out.
    pub(in crate::validate) fn leave_out_greedily(
        &mut self,
        blocks: Blocks,
        d2: f64,
        max_order: usize,
        level: f64,
        quantiles: &mut Quantiles,
    ) -> bool {
        let Self { a, z, greedy, .. } = self;
        greedy.start(z, blocks);
        let mut dof = z.len();
        while greedy.blocks.len() < max_order {
            let block = greedy.choose(blocks, d2 - greedy.reduction, dof);
            greedy.remove(a, blocks, block);
            dof -= blocks.count(block);
            if d2 - greedy.reduction <= quantiles.get(level, dof) {
                return true;
            }
        }
        false
    }
}

/// Replaces columns `start .. start + rows` of the lower triangular `b` by `b K^-1`, where `K^T K` is their Gram matrix.
fn whiten_columns(b: &mut [f64], m: usize, start: usize, rows: usize) {
    for j in (start..start + rows).rev() {
        let (left, right) = b.split_at_mut((j + 1) * m);
        let column = &mut left[j * m..];
        for later in j + 1..start + rows {
            let done = &right[(later - j - 1) * m..][later..m];
            let shared = dot(&column[later..], done);
            for (value, d) in column[later..].iter_mut().zip(done) {
                *value -= shared * d;
            }
        }
        let scale = 1.0 / dot(&column[j..], &column[j..]).sqrt();
        for value in &mut column[j..] {
            *value *= scale;
        }
    }
}
