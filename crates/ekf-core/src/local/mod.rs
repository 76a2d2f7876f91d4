//! The exact local update (compressed filter): features outside of a working set are touched lazily.
//!
//! A step measures what is in view. Split the state at some time into the working set `A` (camera, features in view)
//! and the rest `B`. As long as only `A` moves and is measured, `B` follows `A` as it did then:
//!
//! ```text
//! P_AB = Phi R        P_BB = P_BB(then) - R^T Psi R        x_B = x_B(then) + R^T theta        R = P_AB(then)
//! ```
//!
//! `Phi <- F Phi` in a prediction, and in an update `Phi <- (I - K H) Phi`, `Psi += Phi^T H^T S^-1 H Phi`,
//! `theta += Phi^T H^T S^-1 g` (Guivant and Nebot, IEEE T-RA 2001). These are the very operations that the filter does
//! to a covariance: give the working state *auxiliary* rows with
//!
//! ```text
//!     [ P_AA   Phi  ]                     [ x_A   ]
//! M = [ Phi^T  -Psi ],   at first I, 0,   [ theta ],   at first 0
//! ```
//!
//! and the plain filter run on `M` keeps all three, with no code of its own: `A` gains and loses blocks as ever.
//!
//! *A feature `J` of `B` that comes into view* joins `A` alone. Its rows of `P(then)` become rows of `R`, copied as they
//! are, and it brings auxiliary rows of its own: what `P_JB = P_JB(then) - R_J^T Psi R` says are its rows
//! `[-R_J^T Psi, I]` of `Phi`, with `Psi = 0` for the new rows. That is O(n) a feature, where writing all of `P_BB` is
//! O(n^2). When auxiliary rows have become too many, [`OutsideSet::assemble`] writes the whole state once and a new working set is
//! chosen.

mod assemble;
mod image;

pub(crate) use image::OutsideSetImage;

use crate::kernel::{LINE, dot};
use crate::observe::point::CameraPose;
use crate::observe::{FeatureState, Form};
use crate::state::{Block, BlockKind, Covariance, State};
use faer::linalg::matmul::matmul;
use faer::{Accum, MatMut, MatRef, Par};
use nalgebra::{SMatrix, Vector3};

/// What is outside of the working set.
#[derive(Clone, Debug)]
pub(crate) struct OutsideSet {
    /// The whole state as it was when the working set was chosen.
    then: State,
    /// Features of `then` that are outside, by id.
    features: Vec<OutsideFeature>,
    /// Frames since their points were last worked out.
    age: usize,
    /// Column of `R` of each stored row of `then`, if it has one.
    column: Vec<Option<usize>>,
    /// Stored row of `then` of each column of `R`.
    columns: Vec<usize>,
    /// `R`, a row for each auxiliary row, column-major with leading dimension `ld`.
    r: Vec<f64>,
    ld: usize,
    /// Auxiliary rows at first.
    first: usize,
    /// Where the camera was when no feature outside was in view.
    clear_at: Option<CameraPose>,
}

/// The storage of the previous working set, megabytes whose pages are mapped already.
#[derive(Debug, Default)]
pub(crate) struct Buffers {
    whole: Option<Covariance>,
    working: Option<Covariance>,
    r: Vec<f64>,
    products: assemble::Products,
}

impl Clone for Buffers {
    /// Nothing is carried over: a copy starts empty.
    fn clone(&self) -> Self {
        Self::default()
    }
}

/// A feature outside of the working set.
#[derive(Clone, Copy, Debug)]
struct OutsideFeature {
    /// Its block of `then`.
    block: Block,
    /// Its point when the points were last worked out: good enough to tell whether it may be in view.
    last_point: Vector3<f64>,
}

/// Features with an anchor. What has one now had it when the working set was chosen.
fn anchored(working: &State) -> impl Iterator<Item = &Block> {
    let inverse_depth = BlockKind::Feature(Form::InverseDepth);
    working.layout.of_kind(inverse_depth)
}

/// Point of a feature; one with `rho <= 0` is in view of nobody.
fn place(feature: &FeatureState) -> Vector3<f64> {
    feature.point().unwrap_or(Vector3::repeat(f64::INFINITY))
}

/// Frames after which the last points of all features outside are worked out anew.
const OLDEST: usize = 32;

/// Where the auxiliary rows of a working state are.
struct Auxiliary {
    /// Index in its mean.
    mean: Vec<usize>,
    /// Row stored in its covariance.
    rows: Vec<usize>,
}

impl Auxiliary {
    fn of(working: &State) -> Self {
        Self {
            mean: working.auxiliary_blocks().flat_map(Block::range).collect(),
            rows: working.auxiliary_rows().flatten().collect(),
        }
    }

    fn theta(&self, working: &State) -> Vec<f64> {
        self.mean.iter().map(|&i| working.x[i]).collect()
    }
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
        let working = assemble::working_state(&whole, stays, buffers.working.take());
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
        let reference = assemble::stored_rows(&whole, stays);
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

    /// Deletes features outside, and brings in those that share an anchor with one inside that is about to be deleted.
    pub(crate) fn remove(&mut self, working: &mut State, gone: impl Fn(u64) -> bool) {
        self.features.retain(|o| !gone(o.block.id));
        self.enter_sharers(working, gone);
    }

    /// Brings in features that share an anchor with one inside that is about to lose it: the row of that anchor is kept
    /// inside.
    pub(crate) fn enter_sharers(&mut self, working: &mut State, loses: impl Fn(u64) -> bool) {
        let slot = |block: &Block| self.then.p.slot(block.offset);
        let before = anchored(working).filter(|b| loses(b.id));
        let before = before.filter_map(|b| self.then.layout.find(b.id));
        let anchors: Vec<usize> = before.map(slot).collect();
        let sharers = self.features.iter().map(|o| &o.block);
        let sharers = sharers.filter(|b| anchors.contains(&self.then.p.slot(b.offset)));
        let sharers: Vec<u64> = sharers.map(|b| b.id).collect();
        self.enter(working, |id| sharers.binary_search(&id).is_ok());
    }

    /// Works out the last points anew when they are too old. To be called in each frame; `jumped` if the last update moved the camera by much, and the map maybe as well.
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
        let theta = Auxiliary::of(working).theta(working);
        let mates = self.mates(working);
        let some = self.features.iter().filter(move |o| may_be(&o.last_point));
        let moved = move |row| dot(&theta, self.column(row, theta.len()));
        some.map(move |o| (o.block, self.mean(working, &mates, &o.block, &moved)))
    }

    /// Whether the working state has grown so much that writing the whole state pays.
    pub(crate) fn is_full(&self, working: &State) -> bool {
        2 * working.p.stored().n > 5 * self.first + 128
    }

    fn column(&self, row: usize, auxiliary: usize) -> &[f64] {
        let k = self.column[row].expect("a row outside has a column");
        &self.r[k * self.ld..k * self.ld + auxiliary]
    }

    /// Present means of all features outside, in their order.
    pub(crate) fn means(&self, working: &State) -> Vec<(Block, FeatureState)> {
        let theta = Auxiliary::of(working).theta(working);
        // R^T theta at once: features that share an anchor share its columns.
        let columns = self.r.chunks_exact(self.ld).take(self.columns.len());
        let moved: Vec<f64> = columns.map(|column| dot(&theta, column)).collect();
        let moved = |row: usize| moved[self.column[row].expect("a row outside has a column")];
        let mates = self.mates(working);
        let all = self.features.iter().map(|o| &o.block);
        all.map(|block| (*block, self.mean(working, &mates, block, &moved)))
            .collect()
    }

    /// Present mean of a feature, from how far its rows have moved.
    fn mean(
        &self,
        working: &State,
        mates: &[(usize, usize)],
        block: &Block,
        moved: &impl Fn(usize) -> f64,
    ) -> FeatureState {
        let mut mean = block.feature(&self.then.x);
        let mate = self.mate(mates, block);
        for (k, value) in mean.numbers_mut().iter_mut().enumerate() {
            match mate {
                Some(mate) if k < 3 => *value = working.x[mate + k],
                _ => *value += moved(self.then.p.slot(block.offset + k)),
            }
        }
        mean
    }

    /// Present covariance of a feature outside with the camera's pose, and of itself; zeros where a point has no numbers.
    pub(crate) fn covariance(
        &self,
        working: &State,
        block: &Block,
    ) -> (SMatrix<f64, 7, 6>, SMatrix<f64, 6, 6>) {
        let auxiliary = Auxiliary::of(working).rows;
        let dim = block.kind.dim();
        let row = |k: usize| self.then.p.slot(block.offset + k.min(dim - 1));
        let rows: [usize; 6] = std::array::from_fn(row);
        let columns = rows.map(|row| self.column(row, auxiliary.len()));
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
        for c in 0..dim {
            let column: Vec<f64> = auxiliary.iter().map(|&d| with(d, c)).collect();
            for i in 0..dim {
                own[(i, c)] = match (inside(i), inside(c)) {
                    (Some(slot), _) => with(slot, c),
                    (None, Some(slot)) => with(slot, i),
                    (None, None) => {
                        self.then.p.stored_entry(rows[i], rows[c]) + dot(columns[i], &column)
                    }
                };
            }
        }
        let cross = SMatrix::from_fn(|i, c| if c < dim { with(i, c) } else { 0.0 });
        (cross, (own + own.transpose()) * 0.5)
    }

    /// Where P holds the gauge's direction for a feature outside.
    fn reference(&self, working: &State, mate: Option<usize>, block: &Block) -> Vec<f64> {
        let mut reference = self.then.reference[block.range()].to_vec();
        if let Some(mate) = mate {
            reference[..3].copy_from_slice(&working.reference[mate..mate + 3]);
        }
        reference
    }

    /// Brings features into the working set: their rows of P as they are now, and auxiliary rows of their own.
    pub(crate) fn enter(&mut self, working: &mut State, wanted: impl Fn(u64) -> bool) {
        let entering = self.features.iter().map(|o| o.block);
        let entering: Vec<Block> = entering.filter(|b| wanted(b.id)).collect();
        if entering.is_empty() {
            return;
        }
        self.features.retain(|o| !wanted(o.block.id));
        let auxiliary = Auxiliary::of(working);
        let (depth, n, theta) = (
            auxiliary.rows.len(),
            working.p.stored().n,
            auxiliary.theta(working),
        );
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
                        let moved = dot(&theta, self.column(row, depth));
                        means.push(self.then.x[block.offset + k] + moved);
                        n + rows.len() - 1
                    }
                };
            }
            slots.push(own);
        }
        let width = rows.len();
        let mut of_rows = Vec::with_capacity(depth * width);
        for &row in &rows {
            of_rows.extend_from_slice(self.column(row, depth));
        }
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
        // R's new rows: as they were.
        self.make_room(depth + width, depth);
        for (column, &b) in self.r.chunks_exact_mut(self.ld).zip(&self.columns) {
            for (value, &row) in column[depth..].iter_mut().zip(&rows) {
                *value = self.then.p.stored_entry(row, b);
            }
        }
        let own = |i: usize, j: usize| {
            let moved = auxiliary
                .rows
                .iter()
                .zip(&of_rows[i * depth..(i + 1) * depth]);
            let moved: f64 = moved.map(|(&d, r)| r * with_auxiliary[j * n + d]).sum();
            self.then.p.stored_entry(rows[i], rows[j]) + moved
        };
        working.p.append_stored(&with_auxiliary, own, width);
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

    /// Anchors of the working state that features outside may have as well: row stored in `then`, and offset of a feature.
    fn mates(&self, working: &State) -> Vec<(usize, usize)> {
        let mates = anchored(working).filter_map(|b| {
            let before = self.then.layout.find(b.id)?;
            Some((self.then.p.slot(before.offset), b.offset))
        });
        let mut mates: Vec<_> = mates.collect();
        mates.sort_unstable();
        mates
    }

    /// Offset, in the working state, of a feature with the same anchor.
    fn mate(&self, mates: &[(usize, usize)], block: &Block) -> Option<usize> {
        let anchor = self.then.p.slot(block.offset);
        let found = mates.partition_point(|mate| mate.0 < anchor);
        mates
            .get(found)
            .filter(|mate| mate.0 == anchor)
            .map(|m| m.1)
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

    /// The whole state as it is now; what it was put together from is kept to be written over.
    pub(crate) fn into_whole(self, working: State, buffers: &mut Buffers) -> State {
        let whole = self.assemble(&working, buffers);
        buffers.whole = Some(self.then.p);
        buffers.working = Some(working.p);
        buffers.r = self.r;
        whole
    }
}

fn product(to: MatMut<'_, f64>, a: MatRef<'_, f64>, b: MatRef<'_, f64>) {
    matmul(to, Accum::Replace, a, b, 1.0, Par::Seq);
}

impl Covariance {
    /// Row of P to row stored.
    fn slot(&self, i: usize) -> usize {
        self.stored().slots[i]
    }
}
