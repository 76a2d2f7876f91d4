//! From a working state and its outside set to the whole state, and back.

use super::enter::product;
use super::outside_set::{Auxiliary, OutsideFeature, OutsideSet, place};
use crate::kernel::LINE;
use crate::state::{Block, BlockKind, CAMERA_DIM, Covariance, State};
use faer::linalg::matmul::triangular::{self, BlockStructure};
use faer::{Accum, MatMut, MatRef, Par};

/// The storage of the previous working set, megabytes whose pages are mapped already.
#[derive(Debug, Default)]
pub(crate) struct Buffers {
    whole: Option<Covariance>,
    working: Option<Covariance>,
    r: Vec<f64>,
    products: Products,
}

impl Clone for Buffers {
    /// Nothing is carried over: a copy starts empty.
    fn clone(&self) -> Self {
        Self::default()
    }
}

/// Factors and products of an assembly; every entry is written before it is read.
#[derive(Debug, Default)]
struct Products {
    r: Vec<f64>,
    phi: Vec<f64>,
    psi: Vec<f64>,
    psi_r: Vec<f64>,
}

impl OutsideSet {
    /// Takes the features for which `is_working` holds, and all that is no feature, out of a whole state as working state.
    pub(crate) fn split(
        whole: State,
        is_working: impl Fn(&Block) -> bool,
        buffers: &mut Buffers,
    ) -> (State, Self) {
        let stays = |b: &Block| !b.kind.is_feature() || is_working(b);
        let n = whole.p.stored().n;
        let working = working_state(&whole, stays, buffers.working.take());
        let outside = whole.layout.blocks().iter().filter(|b| !stays(b));
        let outside = outside.map(|block| OutsideFeature {
            block: *block,
            last_point: place(&whole.feature(block)),
        });
        let outside: Vec<OutsideFeature> = outside.collect();
        let mut needed = vec![false; n];
        for i in outside.iter().flat_map(|o| o.block.range()) {
            needed[whole.p.slot(i)] = true;
        }
        let columns: Vec<usize> = (0..n).filter(|&row| needed[row]).collect();
        let mut column = vec![None; n];
        for (k, &row) in columns.iter().enumerate() {
            column[row] = Some(k);
        }
        let reference = stored_rows(&whole, stays);
        let first = reference.len();
        let ld = 2 * first;
        let mut r = std::mem::take(&mut buffers.r);
        r.resize(ld * columns.len(), 0.0);
        // Some columns at a time: they lie side by side in P's cache lines.
        for (k, some) in columns.chunks(LINE).enumerate() {
            for (i, &a) in reference.iter().enumerate() {
                for (c, &b) in some.iter().enumerate() {
                    r[(k * LINE + c) * ld + i] = whole.p.stored_entry(a, b);
                }
            }
        }
        let outside = Self {
            then: whole,
            features: outside,
            age: 0,
            column,
            columns,
            r,
            ld,
            first,
            clear_at: None,
        };
        (working, outside)
    }

    /// The whole state as it is now; what it was put together from is kept to be written over.
    pub(crate) fn into_whole(self, working: State, buffers: &mut Buffers) -> State {
        let whole = self.assemble(&working, buffers);
        buffers.whole = Some(self.then.p);
        buffers.working = Some(working.p);
        buffers.r = self.r;
        whole
    }

    /// The whole state as it is now; its covariance is written over a buffer if there is one.
    pub(crate) fn assemble(&self, working: &State, buffers: &mut Buffers) -> State {
        let is_auxiliary = |b: &Block| matches!(b.kind, BlockKind::Auxiliary(_));
        let auxiliary = Auxiliary::of(working);
        let depth = auxiliary.rows.len();
        let working_rows = stored_rows(working, |b| !is_auxiliary(b));
        let place_working = |row: usize| working_rows.partition_point(|&r| r < row);
        // Rows outside, but for anchors that a feature inside has as well.
        let a = working_rows.len();
        let mut place_outside: Vec<Option<usize>> = vec![None; self.then.p.stored().n];
        let mut outside_rows = Vec::new();
        let mates = self.mates(working);
        for block in self.features.iter().map(|o| &o.block) {
            let mate = self.mate(&mates, block);
            for k in 0..block.kind.dim() {
                let row = self.then.p.slot(block.offset + k);
                match mate {
                    Some(mate) if k < 3 => {
                        place_outside[row] = Some(place_working(working.p.slot(mate + k)))
                    }
                    _ => outside_rows.push(row),
                }
            }
        }
        outside_rows.sort_unstable();
        outside_rows.dedup();
        for (k, &row) in outside_rows.iter().enumerate() {
            place_outside[row] = Some(a + k);
        }
        let b = outside_rows.len();
        let capacity = self.then.p.stored().ld;
        let mut whole =
            working.camera_alone(Covariance::of_stored(a + b, capacity, buffers.whole.take()));
        let p = &mut whole.p;
        p.copy_stored(0, &working.p, &working_rows);
        p.copy_stored(a, &self.then.p, &outside_rows);
        // R of the rows outside, and M's auxiliary columns.
        let Products { r, phi, psi, psi_r } = &mut buffers.products;
        r.clear();
        for &row in &outside_rows {
            r.extend_from_slice(self.column(row, depth));
        }
        let r = MatRef::from_column_major_slice(r, depth, b);
        let phi = room(phi, depth * a);
        for (k, &row) in working_rows.iter().enumerate() {
            for (value, &d) in phi[k * depth..].iter_mut().zip(&auxiliary.rows) {
                *value = working.p.stored_entry(row, d);
            }
        }
        let psi = room(psi, depth * depth);
        for (k, &row) in auxiliary.rows.iter().enumerate() {
            for (value, &d) in psi[k * depth..].iter_mut().zip(&auxiliary.rows) {
                *value = working.p.stored_entry(row, d);
            }
        }
        let psi_r = room(psi_r, depth * b);
        product(
            MatMut::from_column_major_slice_mut(psi_r, depth, b),
            MatRef::from_column_major_slice(psi, depth, depth),
            r,
        );
        let (entries, ld) = p.entries();
        let all = MatMut::from_column_major_slice_with_stride_mut(entries, a + b, a + b, ld);
        let (_, _, cross, outside) = all.split_at_mut(a, a);
        let phi = MatRef::from_column_major_slice(phi, depth, a);
        product(cross, r.transpose(), phi);
        triangular::matmul(
            outside,
            BlockStructure::TriangularLower,
            Accum::Add,
            r.transpose(),
            BlockStructure::Rectangular,
            MatRef::from_column_major_slice(psi_r, depth, b),
            BlockStructure::Rectangular,
            1.0,
            Par::Seq,
        );
        self.join(&mut whole, working, place_working, &place_outside);
        whole
    }

    /// Puts the blocks of the working state and of the outside set into the whole state, in the order of their ids.
    fn join(
        &self,
        whole: &mut State,
        working: &State,
        place_working: impl Fn(usize) -> usize,
        place_outside: &[Option<usize>],
    ) {
        let mut blocks = Vec::new();
        for block in working.layout.blocks() {
            if !matches!(block.kind, BlockKind::Auxiliary(_)) {
                let slots: Vec<usize> = block
                    .range()
                    .map(|i| place_working(working.p.slot(i)))
                    .collect();
                let mean = working.x[block.range()].to_vec();
                let reference = working.reference[block.range()].to_vec();
                blocks.push((block.id, block.kind, slots, mean, reference));
            }
        }
        let mates = self.mates(working);
        for (block, mean) in self.means(working) {
            let place = |i: usize| place_outside[self.then.p.slot(i)].expect("placed above");
            let slots = block.range().map(place).collect();
            let mate = self.mate(&mates, &block);
            let reference = self.reference(working, mate, &block);
            let mean = mean.numbers().to_vec();
            blocks.push((block.id, block.kind, slots, mean, reference));
        }
        blocks.sort_by_key(|(id, ..)| *id);
        for (id, kind, slots, mean, reference) in blocks {
            whole.insert(kind, id, &slots, (&mean, &reference));
        }
    }
}

/// The working state of the blocks for which `stays` holds, with auxiliary rows for all of its own; its covariance is written
/// over a buffer if there is one.
fn working_state(
    whole: &State,
    stays: impl Fn(&Block) -> bool,
    buffers: Option<Covariance>,
) -> State {
    let rows = stored_rows(whole, &stays);
    let a = rows.len();
    let mut working = whole.camera_alone(Covariance::of_stored(2 * a, 4 * a, buffers));
    working.p.copy_stored(0, &whole.p, &rows);
    working.p.clear_auxiliary(a);
    let place = |row: usize| rows.partition_point(|&r| r < row);
    for block in whole.layout.blocks().iter().filter(|b| stays(b)) {
        let slots: Vec<usize> = block
            .range()
            .map(|i| place(whole.p.stored().slots[i]))
            .collect();
        let values = (&whole.x[block.range()], &whole.reference[block.range()]);
        working.insert(block.kind, block.id, &slots, values);
    }
    let slots: Vec<usize> = (a..2 * a).collect();
    let zeros = vec![0.0; a];
    working.insert(BlockKind::Auxiliary(a), u64::MAX, &slots, (&zeros, &zeros));
    working
}

/// Stored rows of the camera and of the blocks for which `chosen` holds, increasing.
fn stored_rows(state: &State, chosen: impl Fn(&Block) -> bool) -> Vec<usize> {
    let stored = state.p.stored();
    let mut used = vec![false; stored.n];
    used[..CAMERA_DIM].fill(true);
    for block in state.layout.blocks().iter().filter(|b| chosen(b)) {
        for i in block.range() {
            used[stored.slots[i]] = true;
        }
    }
    (0..stored.n).filter(|&row| used[row]).collect()
}

/// `len` entries of the buffer, with whatever they hold.
fn room(buffer: &mut Vec<f64>, len: usize) -> &mut [f64] {
    buffer.resize(len, 0.0);
    buffer
}
