//! A state in a snapshot. P keeps its slots: which rows are stored once decides the order of sums, hence the bits.

use super::{
    Block, BlockKind, CAMERA_DIM, Covariance, Layout, State, TimeCorrelatedBias, ToldOfClock,
};
use crate::error::EkfError;
use serde::{Deserialize, Serialize};

#[derive(Serialize, Deserialize)]
pub(crate) struct StateImage {
    mean: Vec<f64>,
    reference: Vec<f64>,
    blocks: Vec<(u64, BlockKind)>,
    next_id: u64,
    time_correlated: Vec<TimeCorrelatedBias>,
    clocks: Vec<ToldOfClock>,
    newborn: Option<u64>,
    /// Where each row of P is stored.
    slots: Vec<usize>,
    /// The stored lower triangle, column after column.
    triangle: Vec<f64>,
}

impl StateImage {
    /// Makes the entries of the stored rows from `row` on zero.
    pub(crate) fn clear_from(&mut self, row: usize) {
        let n = self.slots.iter().max().map_or(0, |last| last + 1);
        let mut rest = self.triangle.as_mut_slice();
        for j in 0..n {
            let (column, after) = rest.split_at_mut(n - j);
            column[row.saturating_sub(j).min(n - j)..].fill(0.0);
            rest = after;
        }
    }
}

impl State {
    pub(crate) fn image(&self) -> StateImage {
        let Self {
            x,
            p,
            reference,
            layout,
            time_correlated,
            clocks,
            newborn,
        } = self;
        let stored = p.stored();
        let mut triangle = Vec::with_capacity(stored.n * (stored.n + 1) / 2);
        for j in 0..stored.n {
            triangle.extend_from_slice(&stored.data[j * stored.ld..][j..stored.n]);
        }
        StateImage {
            mean: x.clone(),
            reference: reference.clone(),
            blocks: layout.blocks().iter().map(|b| (b.id, b.kind)).collect(),
            next_id: layout.next_id(),
            time_correlated: time_correlated.clone(),
            clocks: clocks.clone(),
            newborn: *newborn,
            slots: stored.slots.to_vec(),
            triangle,
        }
    }

    pub(crate) fn from_image(image: &StateImage) -> Result<Self, EkfError> {
        let StateImage {
            mean,
            reference,
            blocks,
            next_id,
            time_correlated,
            clocks,
            newborn,
            slots,
            triangle,
        } = image;
        let rows = stored_rows(slots, triangle.len())?;
        if slots.len() != mean.len() || reference.len() != mean.len() {
            return Err(EkfError::bad_snapshot(
                "its mean and covariance differ in size",
            ));
        }
        let numbers = mean.iter().chain(reference).chain(triangle);
        let told = clocks.iter().map(|clock| &clock.information);
        if !numbers.chain(told).all(|v| v.is_finite()) {
            let why = "a number of its state is not finite";
            return Err(EkfError::bad_snapshot(why));
        }
        let mut p = Covariance::of_stored(rows, rows + 64, None);
        let mut entries = triangle.iter();
        for j in 0..rows {
            for (i, &value) in (j..rows).zip(entries.by_ref()) {
                p.set_stored(i, j, value);
            }
        }
        let mut state = Self {
            x: mean[..CAMERA_DIM].to_vec(),
            reference: reference[..CAMERA_DIM].to_vec(),
            p,
            layout: Layout::default(),
            time_correlated: time_correlated.clone(),
            clocks: clocks.clone(),
            newborn: *newborn,
        };
        let mut ids = std::collections::BTreeSet::new();
        for &(id, kind) in blocks {
            let is_auxiliary = matches!(kind, BlockKind::Auxiliary(_));
            let again = |b: &Block| match kind {
                BlockKind::Submap(_) => matches!(b.kind, BlockKind::Submap(_)),
                BlockKind::WornBias(_) | BlockKind::WornLength(_) => b.kind == kind,
                _ => false,
            };
            if matches!(kind, BlockKind::WornError(_) | BlockKind::WornRoll(_))
                || state.layout.blocks().iter().any(again)
                || (!is_auxiliary && (id >= *next_id || !ids.insert(id)))
            {
                return Err(EkfError::bad_snapshot("a block of its state is impossible"));
            }
            let from = state.x.len();
            let range = from..from.saturating_add(kind.dim());
            let Some(slots) = slots.get(range.clone()) else {
                return Err(EkfError::bad_snapshot(
                    "its blocks are larger than its state",
                ));
            };
            if !in_order(kind, slots) {
                return Err(EkfError::bad_snapshot(
                    "the rows of a block are out of order",
                ));
            }
            state.insert(kind, id, slots, (&mean[range.clone()], &reference[range]));
        }
        if state.x.len() != mean.len() {
            return Err(EkfError::bad_snapshot(
                "its blocks are smaller than its state",
            ));
        }
        state.layout.set_next_id(*next_id);
        state.check_time_correlated()?;
        state.check_clocks()?;
        state.check_newborn()?;
        Ok(state)
    }

    /// Each time-correlated error of a worn camera has its block, and no block is without.
    fn check_time_correlated(&self) -> Result<(), EkfError> {
        let blocks = self.layout.blocks().iter().filter_map(|b| match b.kind {
            BlockKind::WornBias(owner) => Some(owner),
            _ => None,
        });
        if blocks.eq(self.time_correlated.iter().map(|l| l.owner)) {
            return Ok(());
        }
        Err(EkfError::bad_snapshot(
            "its blocks and what it says of the worn cameras' errors disagree",
        ))
    }

    /// Each clock of a worn camera has its block, in their order, and no block is without.
    fn check_clocks(&self) -> Result<(), EkfError> {
        let blocks = self.layout.blocks().iter().filter_map(|b| match b.kind {
            BlockKind::WornClock(who) => Some(who),
            _ => None,
        });
        if blocks.eq(0..self.clocks.len()) {
            return Ok(());
        }
        Err(EkfError::bad_snapshot(
            "its blocks and what it says of the worn cameras' clocks disagree",
        ))
    }

    /// What is born next shares the anchor of `newborn`, which must be the camera's position.
    fn check_newborn(&self) -> Result<(), EkfError> {
        let block = self.newborn.and_then(|id| self.layout.find(id));
        let at_camera = |b: &Block| self.x[b.offset..b.offset + 3] == self.x[..3];
        if block.is_none_or(|b| b.kind.is_feature() && at_camera(b)) {
            return Ok(());
        }
        Err(EkfError::bad_snapshot(
            "a feature that was just born is elsewhere",
        ))
    }
}

/// Number of stored rows, if a triangle of that many has all slots and no others.
fn stored_rows(slots: &[usize], entries: usize) -> Result<usize, EkfError> {
    let rows = slots.iter().max().map_or(0, |last| last.saturating_add(1));
    let wanted = rows.checked_mul(rows + 1).map(|twice| twice / 2);
    if wanted != Some(entries) || slots.len() < CAMERA_DIM {
        return Err(EkfError::bad_snapshot(
            "its covariance has a wrong number of entries",
        ));
    }
    let mut used = vec![false; rows];
    slots.iter().for_each(|&slot| used[slot] = true);
    let camera_first = slots[..CAMERA_DIM].iter().copied().eq(0..CAMERA_DIM);
    if !camera_first || used.contains(&false) {
        return Err(EkfError::bad_snapshot("its covariance has rows of nothing"));
    }
    Ok(rows)
}

/// Rows that are read side by side are stored so; a feature's anchor may be another one's.
fn in_order(kind: BlockKind, slots: &[usize]) -> bool {
    let side_by_side = |s: &[usize]| s.windows(2).all(|w| w[1] == w[0] + 1);
    match kind {
        BlockKind::Feature => side_by_side(&slots[..3]) && side_by_side(&slots[3..]),
        BlockKind::Auxiliary(_) => true,
        _ => side_by_side(slots),
    }
}
