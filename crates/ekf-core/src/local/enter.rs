//! Features that leave the outside set: into the working state, or for good.

use super::buffers::product;
use super::outside_set::{Auxiliary, OutsideSet};
use super::renewal::SnapshotRows;
use crate::state::{Block, BlockKind, State};
use faer::{MatMut, MatRef};

impl OutsideSet {
    /// Brings features into the working set: their rows of P as they are now, and auxiliary rows of their own.
    pub(crate) fn enter(&mut self, working: &mut State, wanted: impl Fn(u64) -> bool) {
        let entering = self.features.iter().map(|o| o.block);
        let entering: Vec<Block> = entering.filter(|b| wanted(b.id)).collect();
        if entering.is_empty() {
            return;
        }
        self.features.retain(|o| !wanted(o.block.id));
        let auxiliary = Auxiliary::of(working);
        let (depth, n) = (auxiliary.rows.len(), working.p.stored().n);
        let moved = self.moved(working);
        // Rows of `then` that enter, and where each feature's rows will be stored.
        let mut rows: Vec<usize> = Vec::new();
        let mut means: Vec<f64> = Vec::new();
        let mut slots: Vec<Vec<usize>> = Vec::new();
        let mates = self.mates(working);
        for block in &entering {
            let mate = self.mate(&mates, block);
            let mut own = vec![0; block.kind.dim()];
            for (k, slot) in own.iter_mut().enumerate() {
                let row = self.then.p.slot(block.offset + k);
                *slot = match (mate, rows.iter().position(|&r| r == row)) {
                    (Some(mate), _) if k < 3 => working.p.slot(mate + k),
                    (_, Some(at)) => n + at,
                    _ => {
                        rows.push(row);
                        means.push(self.then.x[block.offset + k] + moved.of(row));
                        n + rows.len() - 1
                    }
                };
            }
            slots.push(own);
        }
        let width = rows.len();
        let of_rows = self.columns_of(&rows, depth);
        let mut by_auxiliary = vec![0.0; n * depth];
        for (column, &d) in by_auxiliary.chunks_exact_mut(n).zip(&auxiliary.rows) {
            working.p.stored_column(d, column);
        }
        // `M R_J`: the rows of A are P_AJ, those of the auxiliary rows -Psi R_J, the new rows of Phi.
        let mut with_auxiliary = vec![0.0; n * width];
        product(
            MatMut::from_column_major_slice_mut(&mut with_auxiliary, n, width),
            MatRef::from_column_major_slice(&by_auxiliary, n, depth),
            MatRef::from_column_major_slice(&of_rows, depth, width),
        );
        let then = SnapshotRows::new(&self.then.p, self.renewal.as_ref(), &rows, true);
        let own = |i: usize, j: usize| {
            let moved = auxiliary
                .rows
                .iter()
                .zip(&of_rows[i * depth..(i + 1) * depth]);
            let moved: f64 = moved.map(|(&d, r)| r * with_auxiliary[j * n + d]).sum();
            then.entry(i, rows[j]) + moved
        };
        working.p.append_stored(&with_auxiliary, own, width);
        // R's new rows: as they were.
        let mut new_rows = Vec::with_capacity(width * self.columns.len());
        for &b in &self.columns {
            new_rows.extend((0..width).map(|i| then.entry(i, b)));
        }
        self.make_room(depth + width, depth);
        let new_rows = new_rows.chunks_exact(width.max(1));
        for (column, values) in self.r.chunks_exact_mut(self.ld).zip(new_rows) {
            column[depth..depth + width].copy_from_slice(values);
        }
        for (block, slots) in entering.iter().zip(&slots) {
            let mate = self.mate(&mates, block);
            let value = |(k, slot): (usize, &usize)| match (slot.checked_sub(n), mate) {
                (Some(at), _) => means[at],
                (None, mate) => working.x[mate.expect("its slot is there") + k],
            };
            let mean: Vec<f64> = slots.iter().enumerate().map(value).collect();
            let reference = self.reference(working, mate, block);
            working.insert(block.kind, block.id, slots, (&mean, &reference));
        }
        let slots: Vec<usize> = (n + width..n + 2 * width).collect();
        let zeros = vec![0.0; width];
        working.insert(
            BlockKind::Auxiliary(width),
            u64::MAX,
            &slots,
            (&zeros, &zeros),
        );
    }

    /// Deletes features outside, and brings in those that share an anchor with one inside that is about to be deleted: the row
    /// of that anchor is kept inside.
    pub(crate) fn remove(&mut self, working: &mut State, gone: impl Fn(u64) -> bool) {
        self.features.retain(|o| !gone(o.block.id));
        let slot = |block: &Block| self.then.p.slot(block.offset);
        let before = working.layout.features().filter(|b| gone(b.id));
        let before = before.filter_map(|b| self.then.layout.find(b.id));
        let anchors: Vec<usize> = before.map(slot).collect();
        let sharers = self.features.iter().map(|o| &o.block);
        let sharers = sharers.filter(|b| anchors.contains(&slot(b)));
        let sharers: Vec<u64> = sharers.map(|b| b.id).collect();
        self.enter(working, |id| sharers.binary_search(&id).is_ok());
    }

    fn make_room(&mut self, rows: usize, used: usize) {
        if rows <= self.ld {
            return;
        }
        let ld = 2 * rows;
        let mut r = vec![0.0; ld * self.columns.len()];
        for (to, from) in r.chunks_exact_mut(ld).zip(self.r.chunks_exact(self.ld)) {
            to[..used].copy_from_slice(&from[..used]);
        }
        (self.r, self.ld) = (r, ld);
    }
}
