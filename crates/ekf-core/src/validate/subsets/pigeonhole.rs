//! HOHCT's bound for sets with many blocks from outside of the greedy set: some of several disjoint groups are kept whole.

use crate::validate::batch::Blocks;
use crate::validate::distance::Joint;

/// Most choices from `G` that are looked at for one choice of groups.
const MAX_STEPS: usize = 500;

/// `S`, `g` and the blocks.
#[derive(Clone, Copy)]
pub(in crate::validate) struct Rows<'a> {
    pub(in crate::validate) s: &'a [f64],
    pub(in crate::validate) ld: usize,
    pub(in crate::validate) g: &'a [f64],
    pub(in crate::validate) blocks: Blocks<'a>,
}

/// Refutes sets with many blocks from outside of `G`, see the module's page.
#[derive(Clone, Debug, Default)]
pub(super) struct Pigeonhole {
    /// Blocks outside of `G`, the loosest predictions first.
    outside: Vec<usize>,
    /// Groups, then `G`.
    joint: Joint,
    /// Covariance and innovation of `G` given the groups, and the row offsets of its blocks.
    covariance: Vec<f64>,
    innovation: Vec<f64>,
    offsets: Vec<usize>,
    /// By the number of blocks brought back, the largest distance that a set may keep; negative if no set can pass.
    pub(super) allowed: Vec<f64>,
    groups: Vec<usize>,
    /// Rows before each group taken.
    marks: Vec<usize>,
    /// Blocks of `G` chosen, given the groups.
    chosen: Joint,
    positions: Vec<usize>,
}

impl Pigeonhole {
    /// Takes the blocks outside of `G`, sorted so that groups dealt out in turn are alike.
    pub(super) fn sort(&mut self, rows: Rows, outside: &[usize]) {
        let spread = |block: usize| {
            let start = rows.blocks.start(block);
            (start..start + rows.blocks.count(block))
                .map(|row| rows.s[row * rows.ld + row])
                .sum::<f64>()
        };
        self.outside.clear();
        self.outside.extend_from_slice(outside);
        self.outside
            .sort_unstable_by(|&a, &b| spread(b).total_cmp(&spread(a)).then(a.cmp(&b)));
    }

    /// Whether every set with at most `most` blocks from outside of `G` keeps a larger distance than allowed.
    ///
    /// Of `most + intact` disjoint groups `F` hits at most `most`, so that `intact` of them are kept, and with them `Y`.
    /// Each choice of groups takes its work from `budget`, rows of `G` times all its rows squared; once that is spent the
    /// answer is no.
    pub(super) fn refutes(
        &mut self,
        rows: Rows,
        greedy: &[usize],
        most: usize,
        intact: usize,
        budget: &mut usize,
    ) -> bool {
        self.offsets.clear();
        self.offsets.push(0);
        let mut size = 0;
        for &block in greedy {
            size += rows.blocks.count(block);
            self.offsets.push(size);
        }
        let number = most + intact;
        self.groups.clear();
        self.groups.extend(0..intact);
        self.marks.clear();
        self.marks.resize(intact, 0);
        self.joint.clear();
        let mut changed = 0;
        loop {
            self.joint.truncate(self.marks[changed]);
            for k in changed..intact {
                self.marks[k] = self.joint.len();
                for &block in self.outside.iter().skip(self.groups[k]).step_by(number) {
                    self.joint.push(rows.s, rows.ld, rows.g, rows.blocks, block);
                }
            }
            let before = self.joint.len();
            let kept = self.joint.d2();
            for &block in greedy {
                self.joint.push(rows.s, rows.ld, rows.g, rows.blocks, block);
            }
            *budget = budget.saturating_sub(size * self.joint.len().pow(2));
            if *budget == 0 {
                return false;
            }
            self.joint
                .conditional(before, &mut self.covariance, &mut self.innovation);
            if !self.all_exceed(kept) {
                return false;
            }
            // The next choice of groups, in lexicographic order.
            let Some(last) = (0..intact).rev().find(|&k| self.groups[k] < most + k) else {
                return true;
            };
            self.groups[last] += 1;
            for k in last + 1..intact {
                self.groups[k] = self.groups[k - 1] + 1;
            }
            changed = last;
        }
    }

    /// Whether every choice of blocks of `G` has a larger distance than allowed, `kept` being that of the groups.
    fn all_exceed(&mut self, kept: f64) -> bool {
        let blocks = Blocks::new(&self.offsets);
        let size = blocks.rows();
        let largest = self
            .allowed
            .iter()
            .copied()
            .fold(f64::NEG_INFINITY, f64::max);
        if kept > largest {
            return true;
        }
        if kept <= self.allowed[0] {
            return false;
        }
        let fewest = self
            .allowed
            .iter()
            .take_while(|&&a| a == f64::NEG_INFINITY)
            .count();
        self.chosen.clear();
        self.positions.clear();
        let mut next = 0;
        let mut steps = 0;
        loop {
            // Distances only grow: a choice beyond the largest that is ever allowed needs no more blocks.
            while next < blocks.len() && self.positions.len() + (blocks.len() - next) >= fewest {
                let rows = self.chosen.len();
                steps += 1;
                self.chosen
                    .push(&self.covariance, size, &self.innovation, blocks, next);
                let distance = kept + self.chosen.d2();
                if distance > largest {
                    self.chosen.truncate(rows);
                } else {
                    self.positions.push(next);
                    if distance <= self.allowed[self.positions.len()] || steps > MAX_STEPS {
                        return false;
                    }
                }
                next += 1;
            }
            let Some(last) = self.positions.pop() else {
                return true;
            };
            self.chosen.truncate(self.chosen.len() - blocks.count(last));
            next = last + 1;
        }
    }
}
