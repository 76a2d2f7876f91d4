//! From a working state and its outside set to the whole state, and back.

use super::buffers::Buffers;
use super::outside_set::{Auxiliary, OutsideFeature, OutsideSet, place};
use super::renewal::Renewal;
use crate::kernel::LINE;
use crate::state::{Block, BlockKind, CAMERA_DIM, Covariance, State};
use std::ops::Range;
use std::sync::Arc;

impl OutsideSet {
    /// Takes the features for which `is_working` holds, and all that is not a feature, out of a whole state as working state.
    pub(crate) fn split(
        whole: State,
        is_working: impl Fn(&Block) -> bool,
        buffers: &mut Buffers,
    ) -> (State, Self) {
        Self::around(whole, None, is_working, buffers)
    }

    /// Chooses a new working set, features that are all inside now. All of P that is not inside is left to be written by
    /// [`Self::advance`]; of this set everything must be written.
    pub(crate) fn renew(
        &self,
        working: &State,
        is_working: impl Fn(&Block) -> bool,
        buffers: &mut Buffers,
    ) -> (State, Self) {
        let (whole, renewal) = self.begin(working, buffers);
        Self::around(whole, Some(renewal), is_working, buffers)
    }

    fn around(
        whole: State,
        renewal: Option<Renewal>,
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
        let ld = 2 * reference.len();
        let mut r = std::mem::take(&mut buffers.r);
        if r.capacity() < ld * columns.len() {
            // Zeros of the system's, which cost nothing before they are written over.
            r = vec![0.0; ld * (columns.len() + columns.len() / 8)];
        }
        r.resize(ld * columns.len(), 0.0);
        let written = renewal.as_ref().map_or(n, |renewal| renewal.inside);
        let mut outside = Self {
            then: Arc::new(whole),
            features: outside,
            age: 0,
            column,
            columns,
            r,
            ld,
            reference,
            renewal,
            clear_at: None,
        };
        outside.fill_columns(0..written);
        (working, outside)
    }

    /// Writes the rows of `then` that are a frame's share, as long as there are some.
    pub(crate) fn advance(&mut self, buffers: &mut Buffers) {
        if let Some(renewal) = &self.renewal {
            self.write(renewal.share(), buffers);
        }
    }

    /// Writes all rows of `then`.
    pub(crate) fn finish(&mut self, buffers: &mut Buffers) {
        if let Some(renewal) = &self.renewal {
            self.write(renewal.rows.len(), buffers);
        }
    }

    fn write(&mut self, end: usize, buffers: &mut Buffers) {
        if let Some(renewal) = &mut self.renewal
            && renewal.done < end
        {
            let rows = renewal.inside + renewal.done..renewal.inside + end;
            renewal.write(&mut Arc::make_mut(&mut self.then).p, end, buffers);
            self.fill_columns(rows);
        }
    }

    /// Copies the columns of `R` of these rows of `then` out of it.
    fn fill_columns(&mut self, rows: Range<usize>) {
        let place = |row: usize| self.columns.partition_point(|&b| b < row);
        let (first, end) = (place(rows.start), place(rows.end));
        // Some columns at a time: they lie side by side in P's cache lines.
        for (k, some) in self.columns[first..end].chunks(LINE).enumerate() {
            let at = first + k * LINE;
            for (i, &a) in self.reference.iter().enumerate() {
                for (c, &b) in some.iter().enumerate() {
                    self.r[(at + c) * self.ld + i] = self.then.p.stored_entry(a, b);
                }
            }
        }
    }

    /// Gives up what a finished renewal needed.
    pub(crate) fn settle(&mut self, buffers: &mut Buffers) {
        if let Some(renewal) = self.renewal.take_if(|renewal| renewal.is_done()) {
            buffers.kept_r = renewal.r;
            buffers.take_whole(renewal.before);
        }
    }

    /// Gives what is this set's own back to the buffers.
    pub(crate) fn give_up(mut self, buffers: &mut Buffers) {
        self.settle(buffers);
        buffers.r = self.r;
    }

    /// The whole state as it is now; its covariance is written over a buffer if there is one.
    pub(crate) fn assemble(&self, working: &State, buffers: &mut Buffers) -> State {
        if self
            .renewal
            .as_ref()
            .is_some_and(|renewal| !renewal.is_done())
        {
            let mut finished = self.clone();
            finished.finish(buffers);
            return finished.assemble(working, buffers);
        }
        let (mut whole, mut renewal) = self.begin(working, buffers);
        renewal.write(&mut whole.p, renewal.rows.len(), buffers);
        buffers.kept_r = renewal.r;
        whole
    }

    /// The whole state as it is now, but for the rows outside of its covariance.
    fn begin(&self, working: &State, buffers: &mut Buffers) -> (State, Renewal) {
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
        let (stored, n) = (self.then.p.stored().ld, a + b);
        // With room to grow, so that a map that grows does not need other pages each time.
        let capacity = if n > stored { n + n / 8 } else { stored };
        let mut whole =
            working.camera_alone(Covariance::of_stored(n, capacity, buffers.whole.take()));
        whole.p.copy_rows(0, &working.p, &working_rows, 0..a);
        let mut r = std::mem::take(&mut buffers.kept_r);
        r.clear();
        for &row in &outside_rows {
            r.extend_from_slice(self.column(row, depth));
        }
        // M's auxiliary columns.
        let along = |rows: &[usize]| {
            let entries = rows.iter().flat_map(|&row| {
                let of = auxiliary.rows.iter();
                of.map(move |&d| working.p.stored_entry(row, d))
            });
            entries.collect::<Vec<f64>>()
        };
        let renewal = Renewal {
            before: Arc::clone(&self.then),
            inside: a,
            rows: outside_rows,
            done: 0,
            depth,
            r,
            phi: along(&working_rows),
            psi: along(&auxiliary.rows),
        };
        self.join(&mut whole, working, place_working, &place_outside);
        (whole, renewal)
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
            let mean = mean.0.as_slice().to_vec();
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
    working.p.copy_rows(0, &whole.p, &rows, 0..a);
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
