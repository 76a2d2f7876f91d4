//! Features that the others contradict a little, frame after frame: the gate of one frame never sees them.
//!
//! A feature with a wrong depth that is believed fits each frame within its sigmas and pulls the camera along. But the
//! distance of a match given all the others is chi-square, and independent from frame to frame: its sum over the
//! last frames is chi-square as well, and tells.

use super::{Filter, Outcome, UpdateReport};
use crate::settings::BatchTestKind;
use crate::validate::{Quantiles, conditional_gate};
use serde::{Deserialize, Serialize};

/// Frames of half a memory: what is remembered are 8 to 16 frames in which a feature was measured.
const HALF: usize = 8;

/// Squared distances given the others, and their degrees of freedom.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
struct Sum {
    d2: f64,
    dof: usize,
    frames: usize,
}

/// How far a feature was off what the others say, in the last frames in which it was measured.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Contradiction {
    before: Sum,
    now: Sum,
}

impl Contradiction {
    fn add(&mut self, d2: f64, rows: usize) {
        if self.now.frames == HALF {
            self.before = std::mem::take(&mut self.now);
        }
        self.now.d2 += d2;
        self.now.dof += rows;
        self.now.frames += 1;
    }

    /// Whether half a memory or more is contradicted at this level.
    fn lasts(&self, level: f64, quantiles: &mut Quantiles) -> bool {
        let frames = self.before.frames + self.now.frames;
        let dof = self.before.dof + self.now.dof;
        frames >= HALF && self.before.d2 + self.now.d2 > quantiles.get(level, dof)
    }

    /// Whether its numbers can be those of a filter.
    pub(crate) fn is_sane(&self) -> bool {
        let sums = [self.before, self.now];
        sums.iter()
            .all(|s| s.d2.is_finite() && s.d2 >= 0.0 && s.frames <= HALF)
    }
}

/// What this frame makes of them, by feature, until the update is made; and quantiles.
#[derive(Clone, Debug, Default)]
pub(crate) struct Contradictions {
    news: Vec<(u64, Contradiction)>,
    quantiles: Quantiles,
}

impl Filter {
    /// Matches that the other accepted ones contradict, in this frame or for long.
    pub(super) fn contradicted(&mut self, _: &mut UpdateReport, gone: &mut Vec<usize>) -> Outcome {
        gone.clear();
        let options = &self.settings.validate;
        let Contradictions { news, quantiles } = &mut self.contradictions;
        news.clear();
        if options.test == BatchTestKind::None || options.conditional_level >= 1.0 {
            return Outcome::RejectedConditional;
        }
        let batch = self.batch.as_batch();
        conditional_gate(
            batch.l,
            batch.ld,
            batch.g,
            batch.units,
            options.conditional_level,
            options.max_share,
            &mut self.test,
        );
        gone.extend_from_slice(self.test.rejected());
        if options.lasting_level >= 1.0 {
            return Outcome::RejectedConditional;
        }
        let units = self.batch.units().iter().zip(self.test.given_others());
        for (u, (unit, &d2)) in units.enumerate() {
            let Some(record) = self.records.get(&unit.id) else {
                continue;
            };
            let rows = unit.rows.count;
            // What the gate leaves out counts as what it lets pass at most.
            let d2 = d2.min(quantiles.get(options.conditional_level, rows));
            let mut with_this = record.contradiction;
            with_this.add(d2, rows);
            if with_this.lasts(options.lasting_level, quantiles) {
                gone.push(u);
            }
            news.push((unit.id, with_this));
        }
        gone.sort_unstable();
        gone.dedup();
        Outcome::RejectedConditional
    }

    /// Notes what the frame's last test said, once its update is made.
    pub(super) fn note_contradictions(&mut self) {
        for (id, with_this) in self.contradictions.news.drain(..) {
            if let Some(record) = self.records.get_mut(&id) {
                record.contradiction = with_this;
            }
        }
    }
}
