//! How well the innovations of a run fit what its settings claim.

use crate::error::EkfError;
use serde::{Deserialize, Serialize};

/// Updates over which what is usual changes, and by how many times it one of them may exceed it to count as more.
const MEMORY: f64 = 50.0;
const MOST: f64 = 2.0;
/// Fewest degrees of freedom of an update that says what is usual.
const LEAST_DOF: usize = 20;

/// NIS of all updates since the start, and their degrees of freedom.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(crate) struct NisAccumulator {
    pub(crate) nis: f64,
    pub(crate) dof: f64,
    /// By how much less than 1 the NIS per degree of freedom usually is.
    less: f64,
}

impl NisAccumulator {
    /// Adds an update.
    pub(crate) fn add(&mut self, nis: f64, dof: usize) {
        self.nis += nis;
        self.dof += dof as f64;
        if dof >= LEAST_DOF {
            let usual = self.usual();
            let now = (nis / dof as f64).min(MOST * usual);
            self.less = 1.0 - (usual + (now - usual) / MEMORY).min(1.0);
        }
    }

    /// What the NIS per degree of freedom usually is, 1 at most: what a few frames say by far does not move it.
    pub(crate) fn usual(&self) -> f64 {
        1.0 - self.less
    }

    /// That of the updates after another one was all there was.
    pub(crate) fn since(&self, before: &Self) -> Self {
        Self {
            nis: self.nis - before.nis,
            dof: self.dof - before.dof,
            less: self.less,
        }
    }

    /// Whether what a snapshot says can be: these updates were among the `later` ones.
    pub(crate) fn check(&self, later: &Self) -> Result<(), EkfError> {
        let among = |part: f64, whole: f64| (0.0..=whole).contains(&part) && whole.is_finite();
        let usual = (0.0..1.0).contains(&self.less);
        if usual && among(self.nis, later.nis) && among(self.dof, later.dof) {
            return Ok(());
        }
        let why = "its normalised innovations are impossible";
        Err(EkfError::bad_snapshot(why))
    }

    /// NIS per degree of freedom; 1 before any update.
    pub(crate) fn share(&self) -> f64 {
        if self.dof > 0.0 {
            self.nis / self.dof
        } else {
            1.0
        }
    }
}

#[cfg(test)]
mod tests {
    use super::NisAccumulator;

    #[test]
    fn it_is_the_mean_over_all_degrees_of_freedom() {
        let mut nis = NisAccumulator::default();
        assert!(nis.share() == 1.0);
        nis.add(80.0, 10);
        nis.add(0.0, 30);
        assert!(nis.share() == 2.0);
        let before = nis;
        nis.add(30.0, 10);
        assert!(nis.since(&before).share() == 3.0);
    }

    #[test]
    fn what_is_usual_follows_many_updates_and_no_burst() {
        let mut nis = NisAccumulator::default();
        assert!(nis.usual() == 1.0);
        (0..300).for_each(|_| nis.add(8.0, 80));
        assert!((nis.usual() - 0.1).abs() < 0.01);
        (0..10).for_each(|_| nis.add(100.0, 80));
        assert!(nis.usual() < 0.13, "ten updates of another kind");
        (0..300).for_each(|_| nis.add(100.0, 80));
        assert!(nis.usual() == 1.0, "never more than is stated");
        (0..300).for_each(|_| nis.add(0.0, 4));
        assert!(nis.usual() == 1.0, "small updates say nothing");
    }
}
