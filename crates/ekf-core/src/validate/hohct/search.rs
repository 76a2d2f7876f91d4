//! HOHCT's search: depth first over all sets, see the page of [`hohct`](super).

use super::greedy::Greedy;
use super::level::{Level, PerTheta, Sums, THETAS, sum_of_largest};
use super::pigeonhole::{Pigeonhole, Rows};
use super::scratch::Scratch;
use super::thresholds::Thresholds;
use crate::chi2;
use crate::validate::batch::Blocks;
use crate::validate::quantiles::Quantiles;

/// Most groups that are looked at together.
const MOST_INTACT: usize = 6;
/// Most choices of groups that are looked at for one size.
const MOST_CHOICES: usize = 600;
/// Rows out times rows squared that make one more node for the budget.
const WORK_PER_NODE: usize = 250_000;

/// Depth-first search over all sets.
pub(super) struct Search<'a> {
    batch: Rows<'a>,
    blocks: Blocks<'a>,
    a: &'a [f64],
    z: &'a [f64],
    greedy: &'a Greedy,
    levels: &'a mut Vec<Level>,
    pigeonhole: &'a mut Pigeonhole,
    sums: &'a mut Sums,
    thresholds: &'a mut Thresholds,
    best: &'a mut Vec<usize>,
    quantiles: &'a mut Quantiles,
    d2: f64,
    level: f64,
    least_rows: usize,
    /// Largest order of interest: that of the best set so far.
    order: usize,
    pub(super) nodes: usize,
    max_nodes: usize,
    pub(super) struck: bool,
    /// `f` of the best set so far.
    pub(super) found: Option<f64>,
}

/// What the bounds say about a node.
enum Outlook {
    /// No set below it can win.
    Refuted,
    /// Decide next whether this candidate is added.
    Decide(usize),
    /// Decide next which block of `G` is brought back first.
    BringBack,
}

impl<'a> Search<'a> {
    pub(super) fn new(
        scratch: &'a mut Scratch,
        batch: Rows<'a>,
        d2: f64,
        level: f64,
        max_nodes: usize,
        quantiles: &'a mut Quantiles,
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
            thresholds: &mut scratch.thresholds,
            best: &mut scratch.best,
            quantiles,
            d2,
            level,
            least_rows,
            order: 0,
            nodes: 0,
            max_nodes,
            struck: false,
            found: None,
        }
    }

    /// Searches all sets of at most `max_order` blocks.
    pub(super) fn run(&mut self, max_order: usize, greedy_passes: bool) {
        let greedy = self.greedy;
        let size = greedy.blocks.len();
        self.order = max_order.min(size);
        self.set_level_thresholds();
        if greedy_passes {
            let extra = greedy.blocks.iter().map(|&u| self.extra_rows(u)).sum();
            self.best.clone_from(&greedy.blocks);
            self.accept(size, greedy.reduction, extra);
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
            if left > self.order || self.struck {
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
            let allowed = if order == 0 || order > self.order {
                f64::NEG_INFINITY
            } else {
                self.d2 - self.thresholds.least(order)
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

    /// All sets that follow from the level's `X` by adding exactly `left` of its candidates and bringing back blocks of
    /// `G` at positions from `position` on.
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

    /// Sets with `block`, which was a candidate until now.
    fn add(&mut self, depth: usize, position: usize, left: usize, block: usize) {
        let level = &self.levels[depth];
        if left == 1 {
            // Its gain is known exactly. The set needs to be worked out only for what may be brought back as well.
            let order = level.blocks.len() + 1;
            let reduction = level.reduction + level.gains[0][block];
            let extra = level.extra + self.extra_rows(block);
            if self.improves(order, reduction, extra) {
                self.best.clone_from(&level.blocks);
                self.best.push(block);
                self.accept(order, reduction, extra);
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

    /// Sets without some of the blocks of `G` at positions from `position` on, by the first of them.
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
                if self.improves(order, reduction, extra) {
                    self.best.clear();
                    let rest = level.blocks.iter().filter(|&&other| other != block);
                    self.best.extend(rest);
                    self.accept(order, reduction, extra);
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

    /// Bounds the sets below a node, see [`Search::explore`], and chooses how to go on.
    fn outlook(&mut self, depth: usize, position: usize, left: usize) -> Outlook {
        self.work_out_losses(depth, position);
        if left == 0 {
            return if self.can_win(depth, position, left, 1, [0.0; THETAS.len()], 0.0) {
                Outlook::BringBack
            } else {
                Outlook::Refuted
            };
        }
        self.levels[depth].work_out_gains(self.a, self.blocks);
        // As if candidates were not coupled, and X and F neither: no bound, but the branch to follow.
        let level = &self.levels[depth];
        let mut best = (f64::NEG_INFINITY, level.candidates[0]);
        self.sums.terms.clear();
        for &block in &level.candidates {
            let gain = level.gains[0][block] - self.penalty(block);
            self.sums.terms.push(gain);
            if gain > best.0 {
                best = (gain, block);
            }
        }
        let hope = sum_of_largest(&mut self.sums.terms, left);
        let must = level_order(&self.levels[depth], left) > self.order;
        if self.can_win(depth, position, left, 0, [hope; THETAS.len()], 0.0) {
            return if must {
                Outlook::BringBack
            } else {
                Outlook::Decide(best.1)
            };
        }
        if left > 1 {
            self.levels[depth].work_out_couplings(self.a, self.blocks);
        }
        // Each share bounds by itself; as a rule the first one is enough.
        let mut gains = [f64::INFINITY; THETAS.len()];
        let mut worst = 0;
        for k in if must { 1 } else { 0 }..THETAS.len() {
            (gains[k], worst) = self.bounded_gain(depth, left, k);
            if !self.can_win(depth, position, left, 0, gains, 0.0) {
                return Outlook::Refuted;
            }
        }
        if must {
            gains[0] = self.bounded_gain(depth, left, 0).0;
        }
        // Is it Young's inequality that is too loose, or the couplings?
        let exact = [gains[0]; THETAS.len()];
        if must && !self.can_win(depth, position, left, 0, exact, 0.0) {
            Outlook::BringBack
        } else {
            Outlook::Decide(worst)
        }
    }

    /// Bound on what `left` candidates add for the share `k` (the first if nothing is brought back), and the candidate
    /// whose couplings loosen it most.
    fn bounded_gain(&mut self, depth: usize, left: usize, k: usize) -> (f64, usize) {
        let n = self.blocks.len();
        let level = &self.levels[depth];
        let mut worst = (f64::NEG_INFINITY, f64::NEG_INFINITY, usize::MAX);
        self.sums.terms.clear();
        for &block in &level.candidates {
            let mut coupling = 0.0;
            if left > 1 {
                let row = &level.gain_coupling[k][block * n..(block + 1) * n];
                // A block is not coupled to itself: its own entry is zero.
                self.sums.picked.clear();
                self.sums
                    .picked
                    .extend(level.candidates.iter().map(|&other| row[other]));
                coupling = sum_of_largest(&mut self.sums.picked, left - 1);
            }
            let bounded = if coupling < 1.0 {
                level.gains[k][block] / (1.0 - coupling)
            } else {
                f64::INFINITY
            };
            let excess = bounded - level.gains[0][block];
            if excess > worst.0 || (excess == worst.0 && coupling > worst.1) {
                worst = (excess, coupling, block);
            }
            self.sums.terms.push(bounded - self.penalty(block));
        }
        (sum_of_largest(&mut self.sums.terms, left), worst.2)
    }

    /// Whether a set below a node may win that brings back at least `fewest` blocks and gains at most `gains` (if
    /// nothing, if something is brought back), `own` being the loss of a block that is brought back for certain.
    fn can_win(
        &self,
        depth: usize,
        position: usize,
        left: usize,
        fewest: usize,
        gains: PerTheta<f64>,
        own: f64,
    ) -> bool {
        let level = &self.levels[depth];
        let base = level.reduction - self.thresholds.tau * level.extra as f64;
        let largest = level_order(level, left);
        let available = self.greedy.blocks.len() - position;
        let rows = self.thresholds.tau * self.thresholds.spread as f64;
        (fewest.max(largest.saturating_sub(self.order))..=available.min(largest.saturating_sub(1)))
            .any(|number| {
                let loss = |k: usize, share: f64| {
                    level.losses[k][number].max(share * own - rows * number as f64)
                };
                let bound = if number == 0 {
                    base + gains[0]
                } else if left == 0 {
                    base - loss(0, 1.0)
                } else {
                    let best = (1..THETAS.len()).map(|k| gains[k] - loss(k, 1.0 - THETAS[k]));
                    base + best.fold(f64::INFINITY, f64::min)
                };
                // A margin for rounding.
                bound + 1e-10 * bound.abs() >= self.thresholds.target[largest - number]
            })
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

    fn work_out_losses(&mut self, depth: usize, position: usize) {
        let first = self.first_index(depth, position);
        let available = self.greedy.blocks.len() - position;
        let (tau, blocks, least) = (self.thresholds.tau, self.blocks, self.least_rows);
        let penalty = |block| tau * (blocks.count(block) - least) as f64;
        let range = first..first + available;
        self.levels[depth].work_out_losses(blocks, position, range, penalty, self.sums);
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
        self.thresholds.tau * self.extra_rows(block) as f64
    }

    /// Thresholds that the level sets, for all orders up to `self.order`.
    fn set_level_thresholds(&mut self) {
        let table = &mut *self.thresholds;
        table.values.clear();
        table.target.clear();
        table.target.resize(self.order + 1, f64::INFINITY);
        table.tau = f64::INFINITY;
        for order in 0..=self.order {
            let start = table.values.len();
            for extra in 0..=order * table.spread {
                let gone = order * self.least_rows + extra;
                let value = match self.z.len().checked_sub(gone) {
                    Some(dof) => self.d2 - self.quantiles.get(self.level, dof),
                    None => f64::INFINITY,
                };
                table.values.push(value);
                if extra > 0 {
                    let slope = (value - table.values[start]) / extra as f64;
                    table.tau = table.tau.min(slope);
                }
            }
        }
        if table.tau == f64::INFINITY {
            table.tau = 0.0;
        }
        for order in 0..=self.order {
            table.update_target(order);
        }
    }

    /// Whether a set beats the best so far: a smaller one must pass the level, one of the same order must be better.
    fn improves(&self, order: usize, reduction: f64, extra: usize) -> bool {
        if order == 0 || order > self.order {
            return false;
        }
        let threshold = self.thresholds.at(order, extra);
        if order == self.order && self.found.is_some() {
            reduction > threshold
        } else {
            reduction >= threshold
        }
    }

    /// Takes a set as the best so far; from now on sets of its order must have a larger tail probability.
    fn accept(&mut self, order: usize, reduction: f64, extra: usize) {
        self.found = Some(reduction);
        self.order = order;
        let table = &mut *self.thresholds;
        let start = table.start(order);
        if table.spread > 0 {
            let dof = |extra: usize| self.z.len().checked_sub(order * self.least_rows + extra);
            let rest = (self.d2 - reduction).max(0.0);
            let ln_tail = chi2::ln_survival(rest, dof(extra).unwrap_or(0) as f64);
            for other in 0..=order * table.spread {
                table.values[start + other] = match dof(other) {
                    Some(dof) => self.d2 - chi2::inverse_ln_survival(ln_tail, dof as f64),
                    None => f64::INFINITY,
                };
            }
        }
        table.values[start + extra] = reduction;
        table.update_target(order);
    }
}

/// `n` choose `k`.
fn choices(n: usize, k: usize) -> usize {
    (0..k).fold(1, |product, i| product * (n - i) / (i + 1))
}

/// Order of the sets below a level if nothing is brought back.
fn level_order(level: &Level, left: usize) -> usize {
    level.blocks.len() + left
}
