//! The greedy set `G` of HOHCT: blocks are left out one at a time, each the best choice given those already out.

use crate::chi2;
use crate::validate::batch::{Blocks, MAX_ROWS};
use crate::validate::distance::block_distance;

/// The greedy set, by pivoted Cholesky of the whitened `A`: `O(m)` per row taken and row taken before.
#[derive(Clone, Debug, Default)]
pub(in crate::validate) struct Greedy {
    pub(in crate::validate) blocks: Vec<usize>,
    pub(in crate::validate) reduction: f64,
    pub(in crate::validate) taken: Vec<bool>,
    /// `z` given that the blocks so far are out.
    pub(in crate::validate) z: Vec<f64>,
    /// Diagonal blocks of `A` likewise, `3 x 3` each.
    pub(in crate::validate) diagonal: Vec<[[f64; MAX_ROWS]; MAX_ROWS]>,
    /// Columns of the factor, `m` each.
    pub(in crate::validate) columns: Vec<f64>,
}

impl Greedy {
    pub(in crate::validate) fn start(&mut self, z: &[f64], blocks: Blocks) {
        let mut identity = [[0.0; MAX_ROWS]; MAX_ROWS];
        for (k, row) in identity.iter_mut().enumerate() {
            row[k] = 1.0;
        }
        self.blocks.clear();
        self.reduction = 0.0;
        self.taken.clear();
        self.taken.resize(blocks.len(), false);
        self.z.clear();
        self.z.extend_from_slice(z);
        self.diagonal.clear();
        self.diagonal.resize(blocks.len(), identity);
        self.columns.clear();
    }

    /// The block whose removal leaves the largest tail probability.
    pub(in crate::validate) fn choose(&self, blocks: Blocks, d2: f64, dof: usize) -> usize {
        let mut best = [(f64::NEG_INFINITY, usize::MAX); MAX_ROWS];
        for block in 0..blocks.len() {
            if !self.taken[block] {
                let rows = blocks.count(block);
                let z = &self.z[blocks.start(block)..][..rows];
                let gain = block_distance(&self.diagonal[block], z);
                if gain > best[rows - 1].0 {
                    best[rows - 1] = (gain, block);
                }
            }
        }
        let mut kinds = best.iter().filter(|kind| kind.1 != usize::MAX);
        if let (Some(only), None) = (kinds.next(), kinds.next()) {
            return only.1;
        }
        let mut choice = (f64::NEG_INFINITY, usize::MAX);
        for (rows, &(gain, block)) in (1..=MAX_ROWS).zip(&best) {
            if block != usize::MAX {
                let left = chi2::ln_survival((d2 - gain).max(0.0), (dof - rows) as f64);
                if choice.1 == usize::MAX || left > choice.0 {
                    choice = (left, block);
                }
            }
        }
        choice.1
    }

    pub(in crate::validate) fn remove(&mut self, a: &[f64], blocks: Blocks, block: usize) {
        let m = self.z.len();
        self.taken[block] = true;
        self.blocks.push(block);
        for row in blocks.start(block)..blocks.start(block) + blocks.count(block) {
            let base = self.columns.len();
            self.columns.extend_from_slice(&a[row * m..(row + 1) * m]);
            let (before, column) = self.columns.split_at_mut(base);
            for earlier in before.chunks_exact(m) {
                let factor = earlier[row];
                for (value, e) in column.iter_mut().zip(earlier) {
                    *value -= factor * e;
                }
            }
            let scale = 1.0 / column[row].max(f64::MIN_POSITIVE).sqrt();
            for value in column.iter_mut() {
                *value *= scale;
            }
            let weight = self.z[row] * scale;
            self.reduction += weight * weight;
            for (z, v) in self.z.iter_mut().zip(column.iter()) {
                *z -= weight * v;
            }
            for (other, matrix) in self.diagonal.iter_mut().enumerate() {
                let part = &column[blocks.start(other)..blocks.start(other) + blocks.count(other)];
                for (r, p) in part.iter().enumerate() {
                    for (c, q) in part.iter().enumerate() {
                        matrix[r][c] -= p * q;
                    }
                }
            }
        }
    }
}
