//! Covariance that moves with the estimate (METHOD 14): what no camera can see stays unseen.
//!
//! Turning or scaling camera and map about the origin changes no bearing, so a bearing must not reduce the
//! uncertainty along those directions `N(x)`. grad H respects that at the point where it is taken; but the update
//! moves the estimate, `N` moves with it, and the next update would gain information that no measurement holds.
//! So P is carried along. With coordinates `B` of the gauge, `B^T N = 1`,
//!
//! ```text
//! T = 1 + (N(x+) - N(x)) B(x)^T,    P <- T P T^T    (rank 4)
//! ```
//!
//! takes `N(x)` to `N(x+)`. The coordinates are the attitude of the camera, and the mean logarithm of the range of
//! points in view from it, each weighted by how well it is known. Translations need none of this: their direction is the same
//! everywhere.
//!
//! The mean follows it, too: a linear step `1 + a` along the scale takes lengths to `1 + a` times as much but inverse depths to
//! `1 - a`, another shape of the map. What of the step of an inverse depth is along the scale becomes `1 / (1 + a)`.
//!
//! Only rows that a measurement may touch need to follow at once: those of the camera, of the clones, and of the
//! features in view. A feature that leaves the view keeps its direction (`State::reference` has the mean that belongs to it) and
//! is carried to the present mean when it comes back, so none of this touches what is out of view.

mod directions;
mod drift_noise;

pub use directions::{GAUGES, coordinates, directions};
pub(crate) use drift_noise::DriftNoise;

use crate::kernel::Product;
use crate::observe::block::MeasurementBlock;
use crate::observe::{FEATURE_DIM, POSE_DIM};
use crate::state::{Block, CAMERA_DIM, InWorld, Layout, Rest, State};
pub(crate) use directions::SCALE;
use nalgebra::SMatrix;
use std::ops::Range;

/// Past it a step along the scale is no small one, and what it would make of an inverse depth is no better than the linear one.
const LARGEST_SHRINKAGE: f64 = -0.5;

/// Buffers that only grow.
#[derive(Clone, Debug, Default)]
pub(crate) struct Gauge {
    from: Vec<f64>,
    to: Vec<f64>,
    coordinates: Vec<f64>,
    /// `B`, then `D`, by stored rows.
    stored: Vec<f64>,
    /// `P B`, then `P+ B + D (B^T P+ B) / 2`.
    along: Vec<f64>,
    column: Vec<f64>,
    /// Stored rows on which no coordinate depends: the auxiliary ones.
    idle: Vec<Range<usize>>,
    /// Rows that a submap's beginning leaves.
    rest: Rest,
    carried: Vec<bool>,
    change: Product,
}

impl Gauge {
    /// Works out `B` and `P B` at the reference mean, where the rows of P that follow, those of the features `followed` among
    /// them, have their direction.
    pub(crate) fn prepare(&mut self, state: &State, followed: &[u64]) {
        let b = &mut self.coordinates;
        coordinates(&state.reference, &state.layout, &state.p, followed, b);
        let (stored, rows) = (state.p.stored(), state.x.len());
        refill(&mut self.stored, stored.n * GAUGES);
        refill(&mut self.along, stored.n * GAUGES);
        // A row that several features share tells the sum of what they tell.
        for k in 0..GAUGES {
            for (i, &slot) in stored.slots.iter().enumerate() {
                self.stored[k * stored.n + slot] += self.coordinates[k * rows + i];
            }
        }
        self.project(state);
    }

    /// `along = P B`. The coordinates of the turns touch the quaternion only.
    fn project(&mut self, state: &State) {
        let n = state.p.stored().n;
        refill(&mut self.column, n);
        let (turns, scale) = self.along.split_at_mut(n * SCALE);
        for i in 3..POSE_DIM {
            let slot = state.p.stored().slots[i];
            state.p.stored_column(slot, &mut self.column);
            for (k, out) in turns.chunks_exact_mut(n).enumerate() {
                let weight = self.stored[k * n + slot];
                for (out, p) in out.iter_mut().zip(&self.column) {
                    *out += weight * p;
                }
            }
        }
        let by_scale = column(&self.stored, n, SCALE);
        if by_scale.iter().any(|&b| b != 0.0) {
            self.idle.clear();
            self.idle.extend(state.auxiliary_rows());
            // Where a submap began is not part of what the filter estimates: it must not change its sums.
            match state.submap_rows() {
                Some(apart) => {
                    let (idle, rest) = (&self.idle, &mut self.rest);
                    state.p.times_apart(&apart, by_scale, idle, scale, rest);
                }
                None => state.p.times(by_scale, &self.idle, scale),
            }
        }
    }

    /// Variance of the scale by its coordinate, before the update. Zero where nothing tells it.
    pub(crate) fn scale_variance(&self) -> f64 {
        let n = self.along.len() / GAUGES;
        let (b, along) = (
            column(&self.stored, n, SCALE),
            column(&self.along, n, SCALE),
        );
        b.iter().zip(along).map(|(b, p)| b * p).sum()
    }

    /// Covariance of a stored row with the scale's coordinate, before the update.
    pub(crate) fn with_scale(&self, slot: usize) -> f64 {
        column(&self.along, self.along.len() / GAUGES, SCALE)[slot]
    }

    /// `H P B` of a block with the prepared `P B`, row `r` of it for the coordinate `k`.
    pub(crate) fn seen_by(
        &self,
        block: &MeasurementBlock,
        slots: &[usize],
        r: usize,
        k: usize,
    ) -> f64 {
        let n = self.along.len() / GAUGES;
        let along = column(&self.along, n, k);
        let rows = &block.rows;
        let mut sum = 0.0;
        for c in 0..POSE_DIM {
            sum += rows.by_pose[(r, c)] * along[slots[c]];
        }
        if let Some(motion) = &rows.by_motion {
            for (c, at) in motion.columns().enumerate() {
                sum += motion.by[(r, c)] * along[slots[at]];
            }
        }
        for c in 0..FEATURE_DIM {
            sum += rows.by_feature[(r, c)] * along[slots[block.feature + c]];
        }
        if let (Some(by_shared), Some(at)) = (&rows.by_shared, block.shared) {
            for c in 0..6 {
                let rolled = rows
                    .roll
                    .map_or(0.0, |share| share * along[slots[at + 6 + c]]);
                sum += by_shared[(r, c)] * (along[slots[at + c]] + rolled);
            }
        }
        sum
    }

    /// What carries P from the reference to the present mean, as `-(T P T^T - P)`; `taken` is what has changed of
    /// the prepared `P B` since. Before quaternions are normalised.
    pub(crate) fn change(
        &mut self,
        state: &State,
        followed: &[u64],
        taken: Option<&[f64]>,
    ) -> &Product {
        let n = state.p.stored().n;
        for (along, taken) in self.along.iter_mut().zip(taken.unwrap_or(&[])) {
            *along -= taken;
        }
        let own: SMatrix<f64, GAUGES, GAUGES> = SMatrix::from_fn(|a, b| {
            let (c, p) = (column(&self.stored, n, a), column(&self.along, n, b));
            c.iter().zip(p).map(|(c, p)| c * p).sum()
        });
        self.gather(state, followed);
        // With D = N(x+) - N(x) and A = P B + D (B^T P B) / 2 it is P + D A^T + A D^T = P - [D A] [-A -D]^T.
        for a in 0..GAUGES {
            for b in 0..GAUGES {
                let half = 0.5 * own[(b, a)];
                let d = column(&self.stored, n, b);
                for (out, d) in self.along[a * n..(a + 1) * n].iter_mut().zip(d) {
                    *out += half * d;
                }
            }
        }
        let Product { x, y } = &mut self.change;
        x.reshape(n, 2 * GAUGES);
        y.reshape(n, 2 * GAUGES);
        for k in 0..GAUGES {
            let (d, a) = (column(&self.stored, n, k), column(&self.along, n, k));
            x.set_column(k, d.iter().copied());
            x.set_column(GAUGES + k, a.iter().copied());
            y.set_column(k, a.iter().map(|a| -a));
            y.set_column(GAUGES + k, d.iter().map(|d| -d));
        }
        &self.change
    }

    /// By how much a step `moved` of the stored rows makes camera and map grow, as a share, to first order.
    fn growth(&self, moved: &[f64]) -> f64 {
        let by_scale = column(&self.stored, moved.len(), SCALE).iter();
        by_scale.zip(moved).map(|(b, d)| b * d).sum()
    }

    /// Moves inverse depths of the features `followed` as the lengths of the map have moved, of what a step `moved` of the stored
    /// rows, made already, holds along the scale. Before [`Self::change`].
    pub(crate) fn keep_shape(&self, state: &mut State, followed: &[u64], moved: &[f64]) {
        let all = self.growth(moved).max(LARGEST_SHRINKAGE);
        let (x, slots) = (&mut state.x, state.p.stored().slots);
        for block in state.layout.features() {
            if followed.binary_search(&block.id).is_err() {
                continue;
            }
            let at = block.offset + 5;
            let step = moved[slots[at]];
            let before = x[at] - step;
            if before > 0.0 {
                // The rest of the step is the feature's own and stays linear, as pixels are in rho.
                let growth = (-step / before).clamp(all.min(0.0), all.max(0.0));
                x[at] += before * (1.0 / (1.0 + growth) - 1.0 + growth);
            }
        }
    }

    /// `stored = D` of the rows that follow, a row that several features share being moved once.
    fn gather(&mut self, state: &State, followed: &[u64]) {
        directions(&state.reference, &state.layout, &mut self.from);
        directions(&state.x, &state.layout, &mut self.to);
        let (n, rows) = (state.p.stored().n, state.x.len());
        self.stored.fill(0.0);
        self.carried.clear();
        self.carried.resize(n, false);
        let blocks = carried_blocks(&state.layout, followed);
        for i in (0..CAMERA_DIM).chain(blocks.flat_map(Block::range)) {
            let slot = state.p.stored().slots[i];
            self.carried[slot] = true;
            for k in 0..GAUGES {
                self.stored[k * n + slot] = self.to[k * rows + i] - self.from[k * rows + i];
            }
        }
    }

    /// Moves the reference of the carried rows to the present mean.
    pub(crate) fn mark_carried(&self, state: &mut State) {
        let slots = state.p.stored().slots;
        for (i, &slot) in slots.iter().enumerate() {
            if self.carried[slot] {
                state.reference[i] = state.x[i];
            }
        }
    }
}

/// What moves with the camera: its clones, and the features that are followed.
fn carried_blocks<'a>(layout: &'a Layout, followed: &'a [u64]) -> impl Iterator<Item = &'a Block> {
    layout.blocks().iter().filter(|b| match b.kind.in_world() {
        InWorld::Landmark => followed.binary_search(&b.id).is_ok(),
        InWorld::Pose => true,
        InWorld::Nowhere => false,
    })
}

fn refill(buffer: &mut Vec<f64>, len: usize) {
    buffer.clear();
    buffer.resize(len, 0.0);
}

fn column(matrix: &[f64], n: usize, j: usize) -> &[f64] {
    &matrix[j * n..(j + 1) * n]
}

#[cfg(test)]
mod tests {
    use super::{GAUGES, Gauge, coordinates, directions};
    use crate::kernel::Panels;
    use crate::observe::POSE_DIM;
    use crate::state::{Block, LinearPart, State};
    use nalgebra::{DMatrix, SMatrix, Vector6};

    fn wave(i: usize) -> f64 {
        ((i * 7919 + 13) % 101) as f64 / 101.0 - 0.5
    }

    /// An uncertain camera and three features of good depth; the last two share their anchor.
    fn state() -> (State, [Block; 3]) {
        let mut state = State::at_origin(64);
        for i in 0..13 {
            state.p.set(i, i, 0.01 + 0.002 * i as f64);
        }
        let block = |state: &mut State, k: usize| {
            let r = state.camera_pose().r;
            let depth = [0.1 * k as f64 - 0.1, 0.05, 0.3 + 0.1 * k as f64];
            let mean = Vector6::new(r.x, r.y, r.z, depth[0], depth[1], depth[2]);
            let mut by_pose = SMatrix::<f64, 6, 7>::from_fn(|i, j| 0.1 * wave(7 * k + i + 6 * j));
            by_pose.fixed_view_mut::<3, 7>(0, 0).fill(0.0);
            by_pose.fixed_view_mut::<3, 3>(0, 0).fill_with_identity();
            let part = LinearPart {
                offset: 0,
                width: POSE_DIM,
                matrix: by_pose.as_slice(),
            };
            let noise = Vector6::new(0.0, 0.0, 0.0, 1e-4, 1e-4, 1e-5);
            state.append_feature(&mean, &[part], &SMatrix::from_diagonal(&noise))
        };
        let first = block(&mut state, 0);
        state.camera_moved();
        for i in 0..3 {
            state.x[i] += 0.2 + 0.1 * i as f64;
            state.reference[i] = state.x[i];
        }
        let second = block(&mut state, 1);
        let third = block(&mut state, 2);
        (state, [first, second, third])
    }

    fn all_directions(x: &[f64], state: &State) -> DMatrix<f64> {
        let mut out = Vec::new();
        directions(x, &state.layout, &mut out);
        DMatrix::from_vec(x.len(), GAUGES, out)
    }

    /// `T P T^T` with the rows of `D` for which `moves` holds.
    fn carried(state: &State, among: &[u64], moves: impl Fn(usize) -> bool) -> DMatrix<f64> {
        let n = state.x.len();
        let mut d = all_directions(&state.x, state) - all_directions(&state.reference, state);
        for i in (0..n).filter(|&i| !moves(i)) {
            d.row_mut(i).fill(0.0);
        }
        let mut b = Vec::new();
        coordinates(&state.reference, &state.layout, &state.p, among, &mut b);
        let t = DMatrix::identity(n, n) + d * DMatrix::from_vec(n, GAUGES, b).transpose();
        &t * state.p.to_dense() * t.transpose()
    }

    #[test]
    fn a_map_that_grows_keeps_its_shape() {
        let (mut state, [first, second, third]) = state();
        let mut gauge = Gauge::default();
        let followed = [first.id, second.id];
        gauge.prepare(&state, &followed);
        let before = state.x.clone();
        let (grown, own) = (0.4, 0.05);
        let mut step = all_directions(&before, &state).column(3) * grown;
        let rho = |block: &Block| block.offset + 5;
        step[rho(&second)] += own;
        let slots = state.p.stored().slots.to_vec();
        let mut moved = vec![0.0; state.p.stored().n];
        for (i, &slot) in slots.iter().enumerate() {
            state.x[i] += step[i];
            moved[slot] = step[i];
        }
        // The own step of one of the two is in the mean of what they tell.
        let all = gauge.growth(&moved);
        assert!((all - grown).abs() < 0.1, "{all}");
        gauge.keep_shape(&mut state, &followed, &moved);
        let expected = |block: &Block, growth: f64| {
            let (from, linear) = (before[rho(block)], before[rho(block)] + step[rho(block)]);
            linear + from * (1.0 / (1.0 + growth) - 1.0 + growth)
        };
        let telling = |block: &Block| (-step[rho(block)] / before[rho(block)]).min(all);
        for block in [&first, &second] {
            let off = state.x[rho(block)] - expected(block, telling(block));
            assert!(off.abs() < 1e-14, "{off:e}");
        }
        let unseen = state.x[rho(&third)] - before[rho(&third)] - step[rho(&third)];
        assert_eq!(unseen, 0.0, "what is not followed is as the step left it");
    }

    #[test]
    fn a_scale_that_hardly_anything_tells_has_no_coordinate() {
        let (mut state, [first, second, _]) = state();
        let followed = [first.id, second.id];
        let tells = |state: &State| {
            let mut b = Vec::new();
            coordinates(&state.x, &state.layout, &state.p, &followed, &mut b);
            b[3 * state.x.len()..].iter().any(|&b| b != 0.0)
        };
        for (ratio, expected) in [(0.9, true), (1.1, false)] {
            for block in [&first, &second] {
                let at = block.offset + 5;
                state.p.set(at, at, (ratio * state.x[at]).powi(2));
            }
            assert_eq!(tells(&state), expected, "sd(rho) / rho = {ratio}");
        }
    }

    fn carry(gauge: &mut Gauge, state: &mut State, followed: &[u64]) {
        let change = gauge.change(state, followed, None);
        state.p.downdate(&Panels::default(), Some(change));
        gauge.mark_carried(state);
    }

    #[test]
    fn what_is_out_of_view_is_carried_when_it_comes_back() {
        let (mut state, [first, second, third]) = state();
        let mut gauge = Gauge::default();
        let followed = [first.id, second.id];
        gauge.prepare(&state, &followed);
        let b = &gauge.coordinates[3 * state.x.len()..];
        assert!(b.iter().any(|&b| b != 0.0), "depths are good enough");
        for i in 0..state.x.len() {
            state.x[i] += 0.02 * wave(i);
        }
        // One anchor, one value.
        for k in 0..3 {
            state.x[third.offset + k] = state.x[second.offset + k];
        }
        let own = third.offset + 3..third.offset + 6;
        let expected = carried(&state, &followed, |i| !own.contains(&i));
        let before = state.p.to_dense();
        carry(&mut gauge, &mut state, &followed);
        let off = (state.p.to_dense() - &expected).abs().max();
        assert!(off < 1e-14, "{off:e}");
        assert!((&expected - before).abs().max() > 1e-5, "it does something");
        for i in 0..state.x.len() {
            let at = if own.contains(&i) { "before" } else { "now" };
            let is = if state.reference[i] == state.x[i] {
                "now"
            } else {
                "before"
            };
            assert_eq!(at, is, "row {i}");
        }
        // Back in view: its own three rows move, nothing else.
        gauge.prepare(&state, &followed);
        let expected = carried(&state, &followed, |i| own.contains(&i));
        let before = state.p.to_dense();
        let followed = [first.id, second.id, third.id];
        carry(&mut gauge, &mut state, &followed);
        let off = (state.p.to_dense() - &expected).abs().max();
        assert!(off < 1e-14, "{off:e}");
        assert!((&expected - before).abs().max() > 1e-5, "it does something");
        assert_eq!(state.reference, state.x);
    }
}
