//! The covariance P. Nothing else writes its entries, except `local` where it puts a whole P together.
//!
//! Only the LOWER triangle is stored meaningfully (column-major, with spare capacity, so that growing by a
//! feature copies nothing). Reading an entry above the diagonal reads its mirror image. Keeping one triangle
//! saves the mirror copy that a full matrix would need after every symmetric downdate.
//!
//! Features born from one camera position have the same anchor: three rows of P that are equal for ever, since
//! nothing tells them apart. Such rows are stored once: row `i` of P is row `slots[i]` of what is stored.

mod compaction;
mod rounding;

use super::CAMERA_DIM;
use crate::kernel::{self, Aligned, LINE, Panels, Product, Stored};
use nalgebra::allocator::Allocator;
use nalgebra::{DMatrix, DefaultAllocator, Dim, OMatrix, SMatrix, SVector};
use std::ops::Range;

/// Rows of a feature's anchor, which come first.
const ANCHOR: usize = 3;
/// A linear map from one stretch of the state, used to append rows that are linear in the state.
#[derive(Clone, Copy, Debug)]
pub struct LinearPart<'a> {
    /// First state index of the stretch.
    pub offset: usize,
    /// Its width.
    pub width: usize,
    /// `k x width`, column-major.
    pub matrix: &'a [f64],
}

impl LinearPart<'_> {
    /// The rows, of `k`, from the first to the last that is not zero.
    fn rows(&self, k: usize) -> Range<usize> {
        let filled = |r: &usize| self.matrix.iter().skip(*r).step_by(k).any(|by| *by != 0.0);
        let first = (0..k).find(filled).unwrap_or(k);
        let last = (first..k).rfind(filled);
        first..last.map_or(first, |last| last + 1)
    }
}

/// Room for the rows that [`Covariance::times_apart`] does not leave apart.
#[derive(Clone, Debug, Default)]
pub(crate) struct Rest {
    p: Vec<f64>,
    b: Vec<f64>,
    idle: Vec<Range<usize>>,
    out: Vec<f64>,
}

/// Rounding error of a few products and sums, relative.
const OF_SUMS: f64 = 16.0 * f64::EPSILON;

/// Symmetric covariance matrix of the state.
#[derive(Clone, Debug)]
pub struct Covariance {
    data: Aligned,
    ld: usize,
    /// Rows stored.
    n: usize,
    /// Where each row of P is stored.
    slots: Vec<usize>,
}

impl Covariance {
    /// `n x n` zeros with room for `capacity` rows.
    pub fn zeros(n: usize, capacity: usize) -> Self {
        let ld = leading(capacity.max(n));
        Self {
            data: Aligned::zeros(ld * ld),
            ld,
            n,
            slots: (0..n).collect(),
        }
    }

    /// Number of rows.
    pub fn dim(&self) -> usize {
        self.slots.len()
    }

    /// One entry.
    #[inline]
    pub fn get(&self, i: usize, j: usize) -> f64 {
        self.stored_entry(self.slots[i], self.slots[j])
    }

    /// One entry by stored rows.
    #[inline]
    pub(crate) fn stored_entry(&self, i: usize, j: usize) -> f64 {
        let (i, j) = if i >= j { (i, j) } else { (j, i) };
        self.data[i + j * self.ld]
    }

    /// Sets one entry (and so its mirror image).
    pub(crate) fn set(&mut self, i: usize, j: usize, value: f64) {
        let (i, j) = (self.slots[i], self.slots[j]);
        let (i, j) = if i >= j { (i, j) } else { (j, i) };
        self.data[i + j * self.ld] = value;
    }

    /// The `R x C` block whose corner is `(i, j)`.
    pub fn block<const R: usize, const C: usize>(&self, i: usize, j: usize) -> SMatrix<f64, R, C> {
        SMatrix::from_fn(|r, c| self.get(i + r, j + c))
    }

    /// Overwrites a block (and its mirror image).
    pub(crate) fn set_block<const R: usize, const C: usize>(
        &mut self,
        i: usize,
        j: usize,
        value: &SMatrix<f64, R, C>,
    ) {
        for c in 0..C {
            for r in 0..R {
                self.set(i + r, j + c, value[(r, c)]);
            }
        }
    }

    /// The whole matrix, both triangles.
    pub fn to_dense(&self) -> DMatrix<f64> {
        DMatrix::from_fn(self.dim(), self.dim(), |i, j| self.get(i, j))
    }

    /// The stored triangle.
    pub(crate) fn stored(&self) -> Stored<'_> {
        Stored {
            data: &self.data,
            ld: self.ld,
            n: self.n,
            slots: &self.slots,
        }
    }

    /// Becomes a copy of another covariance; allocates only to grow. One pass over the stored triangle.
    pub(crate) fn copy_from(&mut self, other: &Self) {
        let Self { data, ld, n, slots } = other;
        if self.ld < *n {
            *self = Self::zeros(0, n + n / 4);
        }
        for j in 0..*n {
            self.data[j + j * self.ld..n + j * self.ld]
                .copy_from_slice(&data[j + j * ld..n + j * ld]);
        }
        self.n = *n;
        self.slots.clone_from(slots);
    }

    /// `n` stored rows, of which only the camera's are placed: zeros, or whatever the entries of `reuse` are if it has
    /// room for them.
    pub(crate) fn of_stored(n: usize, capacity: usize, reuse: Option<Self>) -> Self {
        let reuse = reuse.filter(|p| p.ld >= capacity.max(n));
        let mut p = reuse.unwrap_or_else(|| Self::zeros(n, capacity));
        p.n = n;
        p.slots.clear();
        p.slots.extend(0..CAMERA_DIM);
        p
    }

    /// Says where the rows that follow in P are stored.
    pub(crate) fn place(&mut self, slots: &[usize]) {
        self.slots.extend_from_slice(slots);
    }

    /// Sets one entry by stored rows, `i >= j`.
    pub(crate) fn set_stored(&mut self, i: usize, j: usize, value: f64) {
        self.data[i + j * self.ld] = value;
    }

    /// Makes the stored rows from `n` on, half of all, the auxiliary rows of those before: 1 where an auxiliary row meets its own,
    /// else 0.
    pub(crate) fn clear_auxiliary(&mut self, n: usize) {
        debug_assert!(self.n == 2 * n);
        for j in 0..2 * n {
            self.data[j.max(n) + j * self.ld..2 * n + j * self.ld].fill(0.0);
        }
        for j in 0..n {
            self.set_stored(n + j, j, 1.0);
        }
    }

    /// Copies stored rows of another matrix, `rows[range]` with those of `rows` up to themselves (increasing), to the places in
    /// `rows` from `at` on.
    pub(crate) fn copy_rows(
        &mut self,
        at: usize,
        from: &Self,
        rows: &[usize],
        range: Range<usize>,
    ) {
        let ends = |i: usize| i + 1 == range.end || rows[i + 1] != rows[i] + 1;
        let ends: Vec<usize> = range.clone().filter(|&i| ends(i)).collect();
        let mut run = 0;
        for (j, &column) in rows[..range.end].iter().enumerate() {
            debug_assert!(j == 0 || rows[j - 1] < column);
            let from = &from.data[column * from.ld..][..from.n];
            let to = &mut self.data[at + (at + j) * self.ld..][..range.end];
            // Stretch after stretch of rows that follow one another.
            let mut first = j.max(range.start);
            for &last in &ends[run..] {
                to[first..=last].copy_from_slice(&from[rows[first]..=rows[last]]);
                first = last + 1;
            }
            if ends.get(run) == Some(&j) {
                run += 1;
            }
        }
    }

    /// The stored triangle, to write to, and its leading dimension.
    pub(crate) fn entries(&mut self) -> (&mut [f64], usize) {
        (&mut self.data, self.ld)
    }

    /// Copies a whole column by stored rows.
    pub(crate) fn stored_column(&self, j: usize, to: &mut [f64]) {
        for (i, value) in to[..j].iter_mut().enumerate() {
            *value = self.data[j + i * self.ld];
        }
        to[j..].copy_from_slice(&self.data[j + j * self.ld..self.n + j * self.ld]);
    }

    /// Appends `width` stored rows with these covariances (one column each, of the rows before; `own` among
    /// themselves), and as many auxiliary rows: 1 where an auxiliary row meets its own, else 0.
    pub(crate) fn append_stored(
        &mut self,
        before: &[f64],
        own: impl Fn(usize, usize) -> f64,
        width: usize,
    ) {
        let n = self.n;
        self.reserve(n + 2 * width);
        self.n = n + 2 * width;
        for j in 0..n {
            let to = &mut self.data[n + j * self.ld..][..2 * width];
            to.fill(0.0);
            for (value, column) in to.iter_mut().zip(before.chunks_exact(n)) {
                *value = column[j];
            }
        }
        for j in 0..2 * width {
            for i in j..2 * width {
                let value = match (i < width, j < width) {
                    (true, true) => (own(i, j) + own(j, i)) * 0.5,
                    (false, true) if i == j + width => 1.0,
                    _ => 0.0,
                };
                self.set_stored(n + i, n + j, value);
            }
        }
    }

    /// Applies the square map `f` to rows and columns `start .. start + K`: `P <- F P F^T`, `F` the identity
    /// elsewhere. O(K^2 n). Not for rows that are stored once for several features.
    pub(crate) fn transform<const K: usize>(&mut self, start: usize, f: &SMatrix<f64, K, K>) {
        let own: SMatrix<f64, K, K> = self.block(start, start);
        let own = f * own * f.transpose();
        let first = self.slots[start];
        for i in 0..first {
            let row = &mut self.data[first + i * self.ld..][..K];
            let mapped = f * SVector::<f64, K>::from_column_slice(row);
            row.copy_from_slice(mapped.as_slice());
        }
        kernel::transform(&mut self.data, self.ld, self.n, first, f);
        self.set_block(start, start, &((own + own.transpose()) * 0.5));
    }

    /// `x_c <- x_c + G y`, for the camera's rows `x_c` and `M` others, `y`, from `from` on. O(n).
    pub(crate) fn add_to_camera<const M: usize>(
        &mut self,
        from: usize,
        g: &SMatrix<f64, CAMERA_DIM, M>,
    ) {
        let with = g * self.block::<M, CAMERA_DIM>(from, 0);
        let own = g * self.block::<M, M>(from, from) * g.transpose();
        let rows: [usize; M] = std::array::from_fn(|m| self.slots[from + m]);
        for j in CAMERA_DIM..self.n {
            let more = g * SVector::<f64, M>::from_fn(|m, _| self.stored_entry(rows[m], j));
            for c in 0..CAMERA_DIM {
                self.data[j + c * self.ld] += more[c];
            }
        }
        let own = with + with.transpose() + (own + own.transpose()) * 0.5;
        self.add_block(0, &own);
    }

    /// Makes `count` rows from `at` on, stored side by side and for no other, the same as the first ones. O(n).
    pub(crate) fn repeat_rows(&mut self, at: usize, count: usize) {
        let to = self.slots[at];
        for i in 0..count {
            for j in (0..self.n).filter(|j| !(to..to + count).contains(j)) {
                let value = self.stored_entry(i, j);
                self.set_stored(j.max(to + i), j.min(to + i), value);
            }
        }
        for i in 0..count {
            for j in 0..=i {
                self.set_stored(to + i, to + j, self.stored_entry(i, j));
            }
        }
    }

    /// Makes the first rows and columns, of the camera, zero.
    pub(crate) fn clear_first(&mut self, count: usize) {
        for j in 0..count {
            self.data[j + j * self.ld..self.n + j * self.ld].fill(0.0);
        }
    }

    /// Adds a symmetric block on the diagonal.
    pub(crate) fn add_block<const K: usize>(&mut self, start: usize, value: &SMatrix<f64, K, K>) {
        let first = self.slots[start];
        for c in 0..K {
            for r in c..K {
                self.data[first + r + (first + c) * self.ld] += value[(r, c)];
            }
        }
    }

    /// Appends `K` rows `y = sum_b G_b x_b + noise`: cross-covariances `G P` and the new block
    /// `G P G^T + noise` (Eq. 8). O(n), amortised: capacity doubles.
    ///
    /// With `anchor`, the first three rows of `y` are those of P from there on, and are not stored again.
    pub(crate) fn augment<K: Dim>(
        &mut self,
        parts: &[LinearPart<'_>],
        noise: &OMatrix<f64, K, K>,
        anchor: Option<usize>,
    ) where
        DefaultAllocator: Allocator<K> + Allocator<K, K>,
    {
        let (dim, _) = noise.shape_generic();
        let (n, k) = (self.n, dim.value());
        let known = if anchor.is_some() { ANCHOR } else { 0 };
        self.reserve(n + k - known);
        self.n = n + k - known;
        for j in 0..n {
            self.data[n + j * self.ld..][..k - known].fill(0.0);
        }
        for part in parts {
            let rows = part.rows(k);
            let rows = rows.start.max(known)..rows.end;
            let (slots, ld) = (&self.slots[part.offset..][..part.width], self.ld);
            let data: &mut [f64] = &mut self.data;
            for j in 0..n {
                for r in rows.clone() {
                    let to = n + j * ld + r - known;
                    let mut sum = data[to];
                    for (by, &slot) in part.matrix[r..].iter().step_by(k).zip(slots) {
                        sum += by * data[slot.max(j) + slot.min(j) * ld];
                    }
                    data[to] = sum;
                }
            }
        }
        let mut own = noise.clone();
        for part in parts {
            for w in 0..part.width {
                let from = n + self.slots[part.offset + w] * self.ld;
                for c in known..k {
                    for r in known..k {
                        own[(r, c)] += part.matrix[c + w * k] * self.data[from + r - known];
                    }
                }
            }
        }
        if let Some(anchor) = anchor {
            self.slots.extend_from_within(anchor..anchor + known);
        }
        self.slots.extend(n..self.n);
        let at = self.dim() - k;
        for c in known..k {
            for r in known..k {
                self.set(at + r, at + c, (own[(r, c)] + own[(c, r)]) * 0.5);
            }
        }
    }

    /// `P <- P - V V^T` on the stored triangle (B2), and less a further symmetric product.
    pub(crate) fn downdate(&mut self, v: &Panels, also: Option<&Product>) {
        kernel::downdate(&mut self.data, self.ld, v, also);
    }

    /// `P b` by stored rows, one pass over the stored triangle; `b` is zero in the stretches `idle` (increasing).
    pub(crate) fn times(&self, b: &[f64], idle: &[Range<usize>], out: &mut [f64]) {
        kernel::times(&self.data, self.ld, b, idle, out);
    }

    /// As [`Self::times`], to the bit what it would be if the stored rows `apart` were not there; `b` is zero in them. They are
    /// multiplied by themselves.
    pub(crate) fn times_apart(
        &self,
        apart: &Range<usize>,
        b: &[f64],
        idle: &[Range<usize>],
        out: &mut [f64],
        rest: &mut Rest,
    ) {
        let (n, gone) = (self.n, apart.len());
        let m = n - gone;
        let others = || (0..apart.start).chain(apart.end..n);
        let place = |row: usize| if row < apart.start { row } else { row - gone };
        rest.p.resize(m * m, 0.0);
        for j in others() {
            let to = &mut rest.p[place(j) * m..][place(j)..m];
            let column = &self.data[j * self.ld..][..n];
            let (before, after) = to.split_at_mut(apart.start.saturating_sub(j));
            before.copy_from_slice(&column[j.min(apart.start)..apart.start]);
            after.copy_from_slice(&column[j.max(apart.end)..]);
        }
        rest.b.clear();
        rest.b.extend(others().map(|j| b[j]));
        rest.idle.clear();
        let idle = idle
            .iter()
            .map(|r| place(r.start)..place(r.start) + r.len());
        rest.idle.extend(idle);
        rest.out.resize(m, 0.0);
        kernel::times(&rest.p, m, &rest.b, &rest.idle, &mut rest.out);
        for j in others() {
            out[j] = rest.out[place(j)];
        }
        for i in apart.clone() {
            out[i] = (0..n).map(|j| self.stored_entry(i, j) * b[j]).sum();
        }
    }

    fn reserve(&mut self, n: usize) {
        if n <= self.ld {
            return;
        }
        let ld = leading(n.max(2 * self.ld));
        let mut data = Aligned::zeros(ld * ld);
        for j in 0..self.n {
            data[j + j * ld..self.n + j * ld]
                .copy_from_slice(&self.data[j + j * self.ld..self.n + j * self.ld]);
        }
        (self.data, self.ld) = (data, ld);
    }
}

/// Leading dimension with room for `n` rows: columns begin cache lines, and not all of them the same set of the cache.
fn leading(n: usize) -> usize {
    let lines = n.div_ceil(LINE);
    (lines + usize::from(lines.is_multiple_of(LINE))) * LINE
}
