//! HOHCT's search: depth first over all sets, see the page of [`hohct`](crate::validate::hohct).

mod bounds;

use super::best_set::BestSet;
use super::greedy::Greedy;
use super::level::{Level, Sums, THETAS};
use super::pigeonhole::{Pigeonhole, Rows};
use super::scratch::Scratch;
use crate::validate::batch::Blocks;
use crate::validate::quantiles::Quantiles;

/// Most groups that are looked at together.
const MOST_INTACT: usize = 6;
/// Most choices of groups that are looked at for one size.
const MOST_CHOICES: usize = 600;
/// Work, rows left out times rows squared, that counts as one more node of the budget.
const WORK_PER_NODE: usize = 250_000;

/// What the bounds say about a node.
enum Outlook {
    /// No set below it can win.
    Refuted,
    /// Decide next whether this candidate is added.
    Decide(usize),
    /// Decide next which block of `G` is brought back first.
    BringBack,
}

/// Depth-first search over all sets.
pub(in crate::validate) struct Search<'a> {
    batch: Rows<'a>,
    blocks: Blocks<'a>,
    a: &'a [f64],
    z: &'a [f64],
    greedy: &'a Greedy,
    levels: &'a mut Vec<Level>,
    pigeonhole: &'a mut Pigeonhole,
    sums: &'a mut Sums,
    pub(in crate::validate) best: BestSet<'a>,
    d2: f64,
    least_rows: usize,
    pub(in crate::validate) nodes: usize,
    max_nodes: usize,
    pub(in crate::validate) struck: bool,
}

impl<'a> Search<'a> {
    pub(in crate::validate) fn new(
        scratch: &'a mut Scratch,
        batch: Rows<'a>,
        d2: f64,
        max_nodes: usize,
    ) -> Self {
        let blocks = batch.blocks;
        let counts = (0..blocks.len()).map(|block| blocks.count(block));
        let least_rows = counts.clone().min().unwrap_or(0);
        scratch.thresholds.spread = counts.max().unwrap_or(0) - least_rows;
        Self {
            batch,
            blocks,
            a: &scratch.a[..scratch.z.len().pow(2)],
            z: &scratch.z,
            greedy: &scratch.greedy,
            levels: &mut scratch.levels,
            pigeonhole: &mut scratch.pigeonhole,
            sums: &mut scratch.sums,
            best: BestSet {
                blocks: &mut scratch.best,
                thresholds: &mut scratch.thresholds,
                rows: scratch.z.len(),
                d2,
                least_rows,
                order: 0,
                found: None,
            },
            d2,
            least_rows,
            nodes: 0,
            max_nodes,
            struck: false,
        }
    }

    /// Searches all sets of at most `max_order` blocks for the best one that passes `level`.
    pub(in crate::validate) fn run(
        &mut self,
        max_order: usize,
        greedy_passes: bool,
        level: f64,
        quantiles: &mut Quantiles,
    ) {
        let greedy = self.greedy;
        let size = greedy.blocks.len();
        self.best.start(max_order.min(size), level, quantiles);
        if greedy_passes {
            let extra = greedy.blocks.iter().map(|&u| self.extra_rows(u)).sum();
            self.best.blocks.clone_from(&greedy.blocks);
            self.best.accept(size, greedy.reduction, extra);
        }
        if size == 0 {
            return;
        }
        self.grow_level(0);
        let root = &mut self.levels[0];
        root.blocks.clone_from(&greedy.blocks);
        root.added = 0;
        root.universe.clear();
        root.universe
            .extend((0..self.blocks.len()).filter(|&block| !greedy.taken[block]));
        if !self.condition(0) {
            return;
        }
        let most = size.min(self.blocks.len() - size);
        self.pigeonhole.sort(self.batch, &self.levels[0].universe);
        for left in 0..=most {
            // The order may fall on the way.
            if left > self.best.order || self.struck {
                break;
            }
            let root = &mut self.levels[0];
            root.candidates.clone_from(&root.universe);
            if matches!(self.outlook(0, 0, left), Outlook::Refuted) {
                continue;
            }
            if left > 0 {
                if self.refute_by_groups(left, most, 1) {
                    break;
                }
                let refuted = (1..=MOST_INTACT)
                    .filter(|&intact| choices(left + intact, intact) <= MOST_CHOICES)
                    .any(|intact| self.refute_by_groups(left, left, intact));
                if refuted {
                    continue;
                }
            }
            self.explore(0, 0, left);
        }
    }

    /// Tries to refute all sets with `low <= |F| <= high` by disjoint groups of which `intact` are sure to be kept.
    fn refute_by_groups(&mut self, low: usize, high: usize, intact: usize) -> bool {
        let size = self.greedy.blocks.len();
        self.pigeonhole.allowed.clear();
        for back in 0..=size {
            // By bringing back `back` blocks and adding at least `low` the order becomes, at least,
            let order = (size + low).saturating_sub(back);
            let allowed = if order == 0 || order > self.best.order {
                f64::NEG_INFINITY
            } else {
                self.d2 - self.best.thresholds.least(order)
            };
            // A margin for rounding.
            self.pigeonhole.allowed.push(allowed + 1e-9 * allowed.abs());
        }
        self.nodes += 1 + self.z.len().pow(3) / WORK_PER_NODE / 8;
        let left = self.max_nodes.saturating_sub(self.nodes);
        let before = left.saturating_mul(WORK_PER_NODE);
        let mut budget = before;
        let blocks = &self.greedy.blocks;
        let refuted = self
            .pigeonhole
            .refutes(self.batch, blocks, high, intact, &mut budget);
        self.nodes += (before - budget) / WORK_PER_NODE;
        self.struck |= budget == 0 && !refuted;
        refuted
    }

    /// Visits all sets made from the level's `X` by adding exactly `left` of its candidates and bringing back blocks of `G` at
    /// positions from `position` on.
    fn explore(&mut self, depth: usize, position: usize, left: usize) {
        while !self.struck && self.levels[depth].candidates.len() >= left {
            match self.outlook(depth, position, left) {
                Outlook::Refuted => return,
                Outlook::Decide(block) => {
                    self.levels[depth].candidates.retain(|&u| u != block);
                    self.add(depth, position, left, block);
                }
                Outlook::BringBack => return self.bring_back(depth, position, left),
            }
        }
    }

    /// Visits the sets that contain `block`, which was a candidate until now.
    fn add(&mut self, depth: usize, position: usize, left: usize, block: usize) {
        let level = &self.levels[depth];
        if left == 1 {
            // The gain of a single block is known exactly. The set is worked out only for what may also be brought back.
            let order = level.blocks.len() + 1;
            let reduction = level.reduction + level.gains[0][block];
            let extra = level.extra + self.extra_rows(block);
            if self.best.is_beaten_by(order, reduction, extra) {
                self.best.blocks.clone_from(&level.blocks);
                self.best.blocks.push(block);
                self.best.accept(order, reduction, extra);
            }
            let penalty = self.penalty(block);
            let gains = self.levels[depth]
                .gains
                .each_ref()
                .map(|gain| gain[block] - penalty);
            if !self.can_win(depth, position, left, 1, gains, 0.0) {
                return;
            }
        }
        if self.descend(depth, |blocks| blocks.push(block), 1) {
            self.explore(depth + 1, position, left - 1);
        }
    }

    /// Visits the sets that bring back blocks of `G` at positions from `position` on, by the first one brought back.
    fn bring_back(&mut self, depth: usize, position: usize, left: usize) {
        let mut gains = [0.0; THETAS.len()];
        if left > 0 {
            if left > 1 {
                self.levels[depth].work_out_couplings(self.a, self.blocks);
            }
            for (k, gain) in gains.iter_mut().enumerate().skip(1) {
                *gain = self.bounded_gain(depth, left, k).0;
            }
        }
        let first = self.first_index(depth, position);
        for at in position..self.greedy.blocks.len() {
            let block = self.greedy.blocks[at];
            let level = &self.levels[depth];
            let own = level.own_loss[first + at - position];
            let mut fewest = 1;
            if left == 0 {
                // As in `add`.
                let order = level.blocks.len() - 1;
                let reduction = level.reduction - own;
                let extra = level.extra - self.extra_rows(block);
                if self.best.is_beaten_by(order, reduction, extra) {
                    self.best.blocks.clear();
                    let rest = level.blocks.iter().filter(|&&other| other != block);
                    self.best.blocks.extend(rest);
                    self.best.accept(order, reduction, extra);
                }
                fewest = 2;
            }
            if self.can_win(depth, position, left, fewest, gains, own)
                && self.descend(depth, |blocks| blocks.retain(|&u| u != block), 0)
            {
                self.explore(depth + 1, at + 1, left);
            }
        }
    }

    /// Makes the next level from this one; false if the budget has struck.
    fn descend(&mut self, depth: usize, edit: impl FnOnce(&mut Vec<usize>), added: usize) -> bool {
        self.grow_level(depth + 1);
        let (upper, lower) = self.levels.split_at_mut(depth + 1);
        let (from, to) = (&upper[depth], &mut lower[0]);
        to.blocks.clone_from(&from.blocks);
        edit(&mut to.blocks);
        to.added = from.added + added;
        to.universe.clone_from(&from.candidates);
        to.candidates.clone_from(&from.candidates);
        self.condition(depth + 1)
    }

    fn grow_level(&mut self, depth: usize) {
        if self.levels.len() <= depth {
            self.levels.resize_with(depth + 1, Level::default);
        }
    }

    fn condition(&mut self, depth: usize) -> bool {
        self.struck |= self.nodes >= self.max_nodes;
        if !self.struck {
            let rows = self.rows_out(depth) * self.z.len().pow(2);
            self.nodes += 1 + rows / WORK_PER_NODE;
            self.levels[depth].condition(self.a, self.z, self.blocks, self.least_rows);
        }
        !self.struck
    }

    /// Rows of the blocks that are out.
    fn rows_out(&self, depth: usize) -> usize {
        let blocks = self.levels[depth].blocks.iter();
        blocks.map(|&block| self.blocks.count(block)).sum()
    }

    /// Index in the level's `X` of the block of `G` at `position`; all from there on are in `X`.
    fn first_index(&self, depth: usize, position: usize) -> usize {
        let level = &self.levels[depth];
        level.blocks.len() - level.added - (self.greedy.blocks.len() - position)
    }

    fn extra_rows(&self, block: usize) -> usize {
        self.blocks.count(block) - self.least_rows
    }

    fn penalty(&self, block: usize) -> f64 {
        self.best.thresholds.tau * self.extra_rows(block) as f64
    }
}

/// `n` choose `k`.
fn choices(n: usize, k: usize) -> usize {
    (0..k).fold(1, |product, i| product * (n - i) / (i + 1))
}
