//! A feature whose depth was a guess when it was born.

use crate::observe::feature::FARTHEST;
use serde::{Deserialize, Serialize};

/// A guess as it was made.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(crate) struct Guess {
    /// The feature.
    pub(crate) id: u64,
    /// Inverse depth, 1/m.
    pub(crate) rho: f64,
    /// Its standard deviation, 1/m.
    pub(crate) sd: f64,
}

impl Guess {
    /// Whether what a snapshot says can be, where ids end before `next`: a guess is between infinity and anything that is near,
    /// as far as its standard deviation says.
    pub(crate) fn is_sane(&self, next: u64) -> bool {
        let least = 0.5 / FARTHEST;
        self.id < next
            && (least..=FARTHEST).contains(&self.sd)
            && (0.0..=self.sd).contains(&self.rho)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn guesses_that_no_filter_makes_are_not_sane() {
        let good = Guess {
            id: 7,
            rho: 0.1,
            sd: 0.2,
        };
        assert!(good.is_sane(8));
        assert!(!good.is_sane(7));
        for sd in [0.0, 1e-300, -0.2, 1e300, f64::NAN] {
            assert!(!Guess { sd, ..good.clone() }.is_sane(8), "{sd}");
        }
        for rho in [-0.1, 0.3, f64::INFINITY, f64::NAN] {
            assert!(
                !Guess {
                    rho,
                    ..good.clone()
                }
                .is_sane(8),
                "{rho}"
            );
        }
    }
}
