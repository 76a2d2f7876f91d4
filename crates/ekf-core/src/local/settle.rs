//! From a working state and what is outside of it to the whole state, and back.

use super::{Duals, Far, Spare, product};
use crate::state::{Block, BlockKind, CAMERA_DIM, Covariance, State};
use faer::linalg::matmul::triangular::{self, BlockStructure};
use faer::{Accum, MatMut, MatRef, Par};

/// Stored rows of the camera and of the blocks for which `chosen` holds, increasing.
pub(super) fn stored_rows(state: &State, chosen: impl Fn(&Block) -> bool) -> Vec<usize> {
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

/// Factors of a settling, and what they give; every entry is written before it is read.
#[derive(Debug, Default)]
pub(super) struct Products {
    r: Vec<f64>,
    phi: Vec<f64>,
    psi: Vec<f64>,
    psi_r: Vec<f64>,
}

/// So many entries, whatever they are.
fn room(buffer: &mut Vec<f64>, len: usize) -> &mut [f64] {
    buffer.resize(len, 0.0);
    buffer
}

/// The working state of the blocks for which `stays` holds, with dual rows for all of its own; its covariance is written
/// over a spare one if there is one.
pub(super) fn working_state(
    whole: &State,
    stays: impl Fn(&Block) -> bool,
    spare: Option<Covariance>,
) -> State {
    let rows = stored_rows(whole, &stays);
    let a = rows.len();
    let mut near = whole.camera_alone(Covariance::of_stored(2 * a, 4 * a, spare));
    near.p.copy_stored(0, &whole.p, &rows);
    near.p.clear_duals(a);
    let place = |row: usize| rows.partition_point(|&r| r < row);
    for block in whole.layout.blocks().iter().filter(|b| stays(b)) {
        let slots: Vec<usize> = block
            .range()
            .map(|i| place(whole.p.stored().slots[i]))
            .collect();
        let values = (&whole.x[block.range()], &whole.reference[block.range()]);
        near.insert(block.kind, block.id, &slots, values);
    }
    let slots: Vec<usize> = (a..2 * a).collect();
    let zeros = vec![0.0; a];
    near.insert(BlockKind::Dual(a), u64::MAX, &slots, (&zeros, &zeros));
    near
}

impl Far {
    /// The whole state as it is now, its covariance written over a spare one if there is one.
    pub(crate) fn settle(&self, near: &State, spare: &mut Spare) -> State {
        let is_dual = |b: &Block| matches!(b.kind, BlockKind::Dual(_));
        let duals = Duals::of(near);
        let depth = duals.rows.len();
        let near_rows = stored_rows(near, |b| !is_dual(b));
        let place_near = |row: usize| near_rows.partition_point(|&r| r < row);
        // Rows outside, but for anchors that a feature inside has as well.
        let a = near_rows.len();
        let mut place_far: Vec<Option<usize>> = vec![None; self.then.p.stored().n];
        let mut far_rows = Vec::new();
        let mates = self.mates(near);
        for block in self.outside.iter().map(|o| &o.block) {
            let mate = self.mate(&mates, block);
            for k in 0..block.kind.dim() {
                let row = self.then.p.slot(block.offset + k);
                match mate {
                    Some(mate) if k < 3 => place_far[row] = Some(place_near(near.p.slot(mate + k))),
                    _ => far_rows.push(row),
                }
            }
        }
        far_rows.sort_unstable();
        far_rows.dedup();
        for (k, &row) in far_rows.iter().enumerate() {
            place_far[row] = Some(a + k);
        }
        let b = far_rows.len();
        let capacity = self.then.p.stored().ld;
        let mut whole =
            near.camera_alone(Covariance::of_stored(a + b, capacity, spare.whole.take()));
        let p = &mut whole.p;
        p.copy_stored(0, &near.p, &near_rows);
        p.copy_stored(a, &self.then.p, &far_rows);
        // R of the rows outside, and M's columns of the duals.
        let Products { r, phi, psi, psi_r } = &mut spare.products;
        r.clear();
        for &row in &far_rows {
            r.extend_from_slice(self.column(row, depth));
        }
        let r = MatRef::from_column_major_slice(r, depth, b);
        let phi = room(phi, depth * a);
        for (k, &row) in near_rows.iter().enumerate() {
            for (value, &d) in phi[k * depth..].iter_mut().zip(&duals.rows) {
                *value = near.p.stored_entry(row, d);
            }
        }
        let psi = room(psi, depth * depth);
        for (k, &row) in duals.rows.iter().enumerate() {
            for (value, &d) in psi[k * depth..].iter_mut().zip(&duals.rows) {
                *value = near.p.stored_entry(row, d);
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
        self.join(&mut whole, near, place_near, &place_far);
        whole
    }

    /// Puts the blocks of both into the whole state, by id.
    fn join(
        &self,
        whole: &mut State,
        near: &State,
        place_near: impl Fn(usize) -> usize,
        place_far: &[Option<usize>],
    ) {
        let mut blocks = Vec::new();
        for block in near.layout.blocks() {
            if !matches!(block.kind, BlockKind::Dual(_)) {
                let slots: Vec<usize> = block.range().map(|i| place_near(near.p.slot(i))).collect();
                let mean = near.x[block.range()].to_vec();
                let reference = near.reference[block.range()].to_vec();
                blocks.push((block.id, block.kind, slots, mean, reference));
            }
        }
        let mates = self.mates(near);
        for (block, mean) in self.means(near) {
            let place = |i: usize| place_far[self.then.p.slot(i)].expect("placed above");
            let slots = block.range().map(place).collect();
            let mate = self.mate(&mates, &block);
            let reference = self.reference(near, mate, &block);
            let mean = mean.numbers().to_vec();
            blocks.push((block.id, block.kind, slots, mean, reference));
        }
        blocks.sort_by_key(|(id, ..)| *id);
        for (id, kind, slots, mean, reference) in blocks {
            whole.insert(kind, id, &slots, (&mean, &reference));
        }
    }
}
