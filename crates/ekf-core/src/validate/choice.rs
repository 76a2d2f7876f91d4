//! The choice of a batch test.

use super::batch::{Batch, Verdict};
use super::distance::whiten;
use super::gate::individual_gate;
use super::hohct::{HohctSettings, MAX_SHARE, hohct};
use super::jcbb::{JcbbSettings, jcbb};
use super::one_point::{OnePointSettings, one_point};
use super::workspace::Workspace;
use crate::settings::{BatchTestKind, ValidateSettings};

/// Choice of a test, with its settings.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum BatchTest {
    /// [`hohct`].
    Hohct(HohctSettings),
    /// [`jcbb`].
    Jcbb(JcbbSettings),
    /// [`one_point`].
    OnePoint(OnePointSettings),
    /// [`individual_gate`] at a level.
    Individual(f64),
    /// Accepts everything.
    None,
}

impl BatchTest {
    /// The test that the settings name.
    pub fn chosen(options: &ValidateSettings) -> Self {
        let &ValidateSettings {
            level, max_nodes, ..
        } = options;
        match options.test {
            BatchTestKind::Hohct => Self::Hohct(HohctSettings {
                level,
                max_nodes,
                max_share: MAX_SHARE,
            }),
            BatchTestKind::Jcbb => Self::Jcbb(JcbbSettings { level, max_nodes }),
            BatchTestKind::OnePoint => Self::OnePoint(OnePointSettings {
                level,
                ..OnePointSettings::default()
            }),
            BatchTestKind::Individual => Self::Individual(level),
            BatchTestKind::None => Self::None,
        }
    }

    /// Runs the test on a batch.
    pub fn run(&self, batch: &Batch, ws: &mut Workspace) -> Verdict {
        let Batch {
            s,
            l,
            ld,
            g,
            noise,
            blocks,
        } = *batch;
        match self {
            Self::Hohct(settings) => hohct(s, l, ld, g, blocks, settings, ws),
            Self::Jcbb(settings) => jcbb(s, ld, g, blocks, settings, ws),
            Self::OnePoint(settings) => one_point(s, ld, g, noise, blocks, settings, ws),
            Self::Individual(level) => individual_gate(s, ld, g, blocks, *level, ws),
            Self::None => {
                ws.rejected.clear();
                let d2 = whiten(l, ld, g, &mut ws.whitened);
                Verdict::joint(0, d2, g.len(), true)
            }
        }
    }
}
