//! How well the innovations of a run fit what its settings claim.

use crate::error::EkfError;
use serde::{Deserialize, Serialize};

/// NIS of all updates since the start, and their degrees of freedom.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(crate) struct NisAccumulator {
    pub(crate) nis: f64,
    pub(crate) dof: f64,
}

impl NisAccumulator {
    /// Adds an update.
    pub(crate) fn add(&mut self, nis: f64, dof: usize) {
        self.nis += nis;
        self.dof += dof as f64;
    }

    /// That of the updates after another one was all there was.
    pub(crate) fn since(&self, before: &Self) -> Self {
        Self {
            nis: self.nis - before.nis,
            dof: self.dof - before.dof,
        }
    }

    /// Whether what a snapshot says can be: these updates were among the `later` ones.
    pub(crate) fn check(&self, later: &Self) -> Result<(), EkfError> {
        let among = |part: f64, whole: f64| (0.0..=whole).contains(&part) && whole.is_finite();
        if among(self.nis, later.nis) && among(self.dof, later.dof) {
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
}
