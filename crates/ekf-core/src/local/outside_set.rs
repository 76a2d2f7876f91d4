//! The outside set, and the present means and covariances of its features.

use super::renewal::{Renewal, SnapshotRows};
use crate::kernel::dot;
use crate::observe::point::CameraPose;
use crate::observe::{FEATURE_DIM, FeatureState};
use crate::state::{Block, Covariance, State};
use nalgebra::{DMatrix, DVector, SMatrix, Vector3};
use std::sync::Arc;

/// What is outside of the working set.
#[derive(Clone, Debug)]
pub(crate) struct OutsideSet {
    /// The whole state as it was when the working set was chosen.
    pub(super) then: Arc<State>,
    /// Features of `then` that are outside, by id.
    pub(super) features: Vec<OutsideFeature>,
    /// Frames since their points were last worked out.
    pub(super) age: usize,
    /// Column of `R` of each stored row of `then`, if it has one.
    pub(super) column: Vec<Option<usize>>,
    /// Stored row of `then` of each column of `R`.
    pub(super) columns: Vec<usize>,
    /// `R`, a row for each auxiliary row, column-major with leading dimension `ld`.
    pub(super) r: Vec<f64>,
    pub(super) ld: usize,
    /// Rows of `then` that were inside when the working set was chosen, increasing: the first rows of `R`.
    pub(super) reference: Vec<usize>,
    /// What rows of `then`, and columns of `R`, are not written yet.
    pub(super) renewal: Option<Renewal>,
    /// Where the camera was when no feature outside was in view.
    pub(super) clear_at: Option<CameraPose>,
}

/// A feature outside of the working set.
#[derive(Clone, Copy, Debug)]
pub(super) struct OutsideFeature {
    /// Its block of `then`.
    pub(super) block: Block,
    /// Its point when the points were last computed, which is good enough to tell whether it may be in view.
    pub(super) last_point: Vector3<f64>,
}

/// What later calls change in an outside set, except for rows that an earlier state never reads.
#[derive(Debug)]
pub(crate) struct OutsideMark {
    features: Vec<OutsideFeature>,
    age: usize,
    /// Rows that a renewal had written.
    written: usize,
    clear_at: Option<CameraPose>,
}

/// Frames after which the last points of all features outside are worked out anew.
const OLDEST: usize = 32;

/// Most features outside that are asked where error modes are put together.
const SOME: usize = 64;

/// Point of a feature; one with `rho <= 0` is in view of nobody.
pub(super) fn place(feature: &FeatureState) -> Vector3<f64> {
    feature.point().unwrap_or(Vector3::repeat(f64::INFINITY))
}

/// Where the auxiliary rows of a working state are.
pub(super) struct Auxiliary {
    /// Index in its mean.
    pub(super) mean: Vec<usize>,
    /// Row stored in its covariance.
    pub(super) rows: Vec<usize>,
}

impl Auxiliary {
    pub(super) fn of(working: &State) -> Self {
        Self {
            mean: working.auxiliary_blocks().flat_map(Block::range).collect(),
            rows: working.auxiliary_rows().flatten().collect(),
        }
    }

    pub(super) fn theta(&self, working: &State) -> Vec<f64> {
        self.mean.iter().map(|&i| working.x[i]).collect()
    }
}

impl OutsideSet {
    /// Ids of the features outside.
    pub(crate) fn ids(&self) -> impl Iterator<Item = u64> {
        self.features.iter().map(|o| o.block.id)
    }

    /// Number of features outside.
    pub(crate) fn len(&self) -> usize {
        self.features.len()
    }

    /// Whether a feature is outside.
    pub(crate) fn has(&self, id: u64) -> bool {
        self.features
            .binary_search_by_key(&id, |o| o.block.id)
            .is_ok()
    }

    /// Whether the working state has grown so much that a new working set pays, and `then` is there for it.
    pub(crate) fn is_full(&self, working: &State) -> bool {
        let grown = 2 * working.p.stored().n > 5 * self.reference.len() + 128;
        grown && self.renewal.as_ref().is_none_or(Renewal::is_done)
    }

    /// Where it stands now, for [`Self::go_back`].
    pub(crate) fn mark(&self) -> OutsideMark {
        let Self {
            features,
            age,
            renewal,
            clear_at,
            // As the working set was chosen, for good; rows that R has gained belong to auxiliary rows that the working
            // state of before does not have, and what a renewal has written since is not read before it is written again.
            then: _,
            column: _,
            columns: _,
            r: _,
            ld: _,
            reference: _,
        } = self;
        OutsideMark {
            features: features.clone(),
            age: *age,
            written: renewal.as_ref().map_or(0, |renewal| renewal.done),
            clear_at: *clear_at,
        }
    }

    /// Undoes what was done since `mark`; the working state has to go back as well.
    pub(crate) fn go_back(&mut self, mark: &OutsideMark) {
        let OutsideMark {
            features,
            age,
            written,
            clear_at,
        } = mark;
        self.features.clone_from(features);
        self.age = *age;
        if let Some(renewal) = &mut self.renewal {
            renewal.done = *written;
        }
        self.clear_at = *clear_at;
    }

    /// Computes the points again when they are too old. Call it in each frame; `jumped` if the last update moved the camera
    /// by much, and with it perhaps the map.
    pub(crate) fn refresh_points(&mut self, working: &State, jumped: bool) {
        self.age += 1;
        if self.age < OLDEST && !jumped {
            return;
        }
        self.age = 0;
        let means: Vec<_> = self.means(working).iter().map(|(_, y)| place(y)).collect();
        for (outside, mean) in self.features.iter_mut().zip(means) {
            outside.last_point = mean;
        }
    }

    /// Remembers that no feature outside is in view from here.
    pub(crate) fn mark_clear(&mut self, pose: &CameraPose) {
        self.clear_at = Some(*pose);
    }

    /// Whether [`Self::mark_clear`] was last called from here: the map only moves when the camera does.
    pub(crate) fn is_clear(&self, pose: &CameraPose) -> bool {
        self.clear_at == Some(*pose)
    }

    /// Present means of the features outside that may be in view, judged by their last point.
    pub(crate) fn maybe_in_view(
        &self,
        working: &State,
        may_be: impl Fn(&Vector3<f64>) -> bool,
    ) -> impl Iterator<Item = (Block, FeatureState)> {
        let mates = self.mates(working);
        let some = self.features.iter().filter(move |o| may_be(&o.last_point));
        let moved = self.moved(working);
        let moved = move |row| moved.of(row);
        some.map(move |o| (o.block, self.mean(working, &mates, &o.block, &moved)))
    }

    /// Present means of all features outside, in their order.
    pub(crate) fn means(&self, working: &State) -> Vec<(Block, FeatureState)> {
        let moved = self.moved(working);
        // R^T theta at once: features that share an anchor share its columns.
        let moved: Vec<f64> = self.columns.iter().map(|&row| moved.of(row)).collect();
        let moved = |row: usize| moved[self.column[row].expect("a row outside has a column")];
        let mates = self.mates(working);
        let all = self.features.iter().map(|o| &o.block);
        all.map(|block| (*block, self.mean(working, &mates, block, &moved)))
            .collect()
    }

    /// Present mean of a feature, from how far its rows have moved.
    pub(super) fn mean(
        &self,
        working: &State,
        mates: &[(usize, usize)],
        block: &Block,
        moved: &impl Fn(usize) -> f64,
    ) -> FeatureState {
        let mut mean = block.feature(&self.then.x);
        let mate = self.mate(mates, block);
        for (k, value) in mean.0.iter_mut().enumerate() {
            match mate {
                Some(mate) if k < 3 => *value = working.x[mate + k],
                _ => *value += moved(self.then.p.slot(block.offset + k)),
            }
        }
        mean
    }

    /// Present covariance of a feature outside with the camera's pose, and of itself.
    pub(crate) fn covariance(
        &self,
        working: &State,
        block: &Block,
    ) -> (SMatrix<f64, 7, 6>, SMatrix<f64, 6, 6>) {
        let auxiliary = Auxiliary::of(working).rows;
        let rows: [usize; FEATURE_DIM] =
            std::array::from_fn(|k| self.then.p.slot(block.offset + k));
        let columns = self.columns_of(&rows, auxiliary.len());
        let columns: Vec<&[f64]> = columns.chunks_exact(auxiliary.len()).collect();
        let then = SnapshotRows::new(&self.then.p, self.renewal.as_ref(), &rows, false);
        // An anchor that a feature inside has as well is stored there.
        let mate = self.mate(&self.mates(working), block);
        let inside = |k: usize| mate.filter(|_| k < 3).map(|mate| working.p.slot(mate + k));
        let with = |i: usize, c: usize| -> f64 {
            if let Some(slot) = inside(c) {
                return working.p.stored_entry(i, slot);
            }
            let along = auxiliary.iter().zip(columns[c]);
            along.map(|(&d, r)| working.p.stored_entry(i, d) * r).sum()
        };
        let mut own = SMatrix::<f64, 6, 6>::zeros();
        for c in 0..FEATURE_DIM {
            let column: Vec<f64> = auxiliary.iter().map(|&d| with(d, c)).collect();
            for i in 0..FEATURE_DIM {
                own[(i, c)] = match (inside(i), inside(c)) {
                    (Some(slot), _) => with(slot, c),
                    (None, Some(slot)) => with(slot, i),
                    (None, None) => then.entry(i, rows[c]) + dot(columns[i], &column),
                };
            }
        }
        let cross = SMatrix::from_fn(with);
        (cross, (own + own.transpose()) * 0.5)
    }

    /// Present covariance of six numbers of the working state, from `at` on, with a feature outside.
    pub(crate) fn covariance_with(
        &self,
        working: &State,
        at: usize,
        block: &Block,
    ) -> SMatrix<f64, 6, 6> {
        let auxiliary = Auxiliary::of(working).rows;
        let depth = auxiliary.len();
        let slots = block.range().map(|i| self.then.p.slot(i));
        let columns = self.columns_of(&slots.collect::<Vec<_>>(), depth);
        let mate = self.mate(&self.mates(working), block);
        SMatrix::from_fn(|i, c| {
            let row = working.p.slot(at + i);
            if let Some(mate) = mate.filter(|_| c < 3) {
                return working.p.stored_entry(row, working.p.slot(mate + c));
            }
            let along = auxiliary.iter().zip(&columns[c * depth..]);
            along
                .map(|(&d, r)| working.p.stored_entry(row, d) * r)
                .sum()
        })
    }

    /// `G^T V^-1 G` of the error modes G of some features outside, taken evenly, in place of all; V are their variances.
    pub(crate) fn modes_of_some(&self, working: &State, modes: &Block) -> DMatrix<f64> {
        let count = modes.kind.dim();
        let mut gram = DMatrix::zeros(count, count);
        let every = self.features.len().div_ceil(SOME).max(1);
        for feature in self.features.iter().step_by(every) {
            let block = &feature.block;
            let (_, own) = self.covariance(working, block);
            let six = modes.range().step_by(6);
            let by_six: Vec<_> = six
                .map(|at| self.covariance_with(working, at, block))
                .collect();
            for number in 0..block.kind.dim() {
                let g = DVector::from_fn(count, |k, _| by_six[k / 6][(k % 6, number)]);
                let variance = own[(number, number)];
                if variance > 0.0 {
                    gram.ger(every as f64 / variance, &g, &g, 1.0);
                }
            }
        }
        gram
    }

    /// Where P holds the gauge's direction for a feature outside.
    pub(super) fn reference(
        &self,
        working: &State,
        mate: Option<usize>,
        block: &Block,
    ) -> Vec<f64> {
        let mut reference = self.then.reference[block.range()].to_vec();
        if let Some(mate) = mate {
            reference[..3].copy_from_slice(&working.reference[mate..mate + 3]);
        }
        reference
    }

    /// Column of `R` of a row of `then` that is written.
    pub(super) fn column(&self, row: usize, auxiliary: usize) -> &[f64] {
        let k = self.column[row].expect("a row outside has a column");
        &self.r[k * self.ld..k * self.ld + auxiliary]
    }

    /// Anchors of the working state that features outside may have as well: row stored in `then`, and offset of a feature.
    pub(super) fn mates(&self, working: &State) -> Vec<(usize, usize)> {
        let mates = working.layout.features().filter_map(|b| {
            let before = self.then.layout.find(b.id)?;
            Some((self.then.p.slot(before.offset), b.offset))
        });
        let mut mates: Vec<_> = mates.collect();
        mates.sort_unstable();
        mates
    }

    /// Offset, in the working state, of a feature with the same anchor.
    pub(super) fn mate(&self, mates: &[(usize, usize)], block: &Block) -> Option<usize> {
        let anchor = self.then.p.slot(block.offset);
        let found = mates.partition_point(|mate| mate.0 < anchor);
        mates
            .get(found)
            .filter(|mate| mate.0 == anchor)
            .map(|m| m.1)
    }
}

impl Covariance {
    /// Row of P to row stored.
    pub(super) fn slot(&self, i: usize) -> usize {
        self.stored().slots[i]
    }
}
