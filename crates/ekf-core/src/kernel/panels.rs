//! A tall matrix in panels.

use super::{Aligned, HEIGHT};

/// Where the lower triangle of a symmetric matrix is stored: entry `(i, j)`, `i >= j`, at `i + j * ld`.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Stored<'a> {
    pub(crate) data: &'a [f64],
    pub(crate) ld: usize,
    pub(crate) n: usize,
    /// Row of P to row stored.
    pub(crate) slots: &'a [usize],
}

/// `rows x columns` in panels; entry `(i, k)` at `(i / HEIGHT) * stride + k * HEIGHT + i % HEIGHT`.
///
/// Rows past the end, up to a whole panel, and columns past the end, up to a multiple of `HEIGHT`, are zero.
#[derive(Clone, Debug, Default)]
pub(crate) struct Panels {
    pub(super) data: Aligned,
    pub(super) stride: usize,
    pub(super) rows: usize,
    pub(super) columns: usize,
}

impl Panels {
    /// Takes a new shape; the entries are whatever they were. Allocates only to grow.
    pub(crate) fn reshape(&mut self, rows: usize, columns: usize) {
        self.stride = columns.max(1).next_multiple_of(HEIGHT) * HEIGHT;
        (self.rows, self.columns) = (rows, columns);
        self.data.reshape(rows.div_ceil(HEIGHT) * self.stride);
    }

    /// Adds `by` (3 x N, column-major) times the `N` entries of column `k` from row `i` on.
    #[inline(always)]
    pub(crate) fn add<const N: usize>(&self, sums: &mut [f64; 3], i: usize, k: usize, by: &[f64]) {
        let entries: [f64; N] = match self.data[self.at(i, k)..].first_chunk::<N>() {
            Some(whole) if i % HEIGHT + N <= HEIGHT => *whole,
            _ => std::array::from_fn(|c| self.get(i + c, k)),
        };
        for (by, entry) in by.as_chunks::<3>().0.iter().zip(&entries) {
            for r in 0..3 {
                sums[r] += by[r] * entry;
            }
        }
    }

    /// Number of rows.
    pub(crate) fn rows(&self) -> usize {
        self.rows
    }

    /// One entry.
    pub(crate) fn get(&self, i: usize, k: usize) -> f64 {
        self.data[self.at(i, k)]
    }

    fn at(&self, i: usize, k: usize) -> usize {
        i / HEIGHT * self.stride + k * HEIGHT + i % HEIGHT
    }

    /// Writes a whole column, and zeros past its end.
    pub(crate) fn set_column(&mut self, k: usize, values: impl Iterator<Item = f64>) {
        let mut values = values.fuse();
        for panel in self.data.chunks_exact_mut(self.stride) {
            for entry in &mut panel[k * HEIGHT..(k + 1) * HEIGHT] {
                *entry = values.next().unwrap_or(0.0);
            }
        }
    }

    /// Keeps the columns listed in `kept` (increasing).
    pub(crate) fn keep_columns(&mut self, kept: &[usize]) {
        for panel in self.data.chunks_exact_mut(self.stride) {
            for (new, &old) in kept.iter().enumerate() {
                panel.copy_within(old * HEIGHT..(old + 1) * HEIGHT, new * HEIGHT);
            }
            panel[kept.len() * HEIGHT..].fill(0.0);
        }
        self.columns = kept.len();
    }

    /// Columns, with those that fill the last tile of width `w`.
    pub(super) fn filled(&self, w: usize) -> usize {
        self.columns.next_multiple_of(w)
    }
}
