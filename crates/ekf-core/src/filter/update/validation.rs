//! The tests that the matches of a frame must pass before they are used (METHOD 8).

use crate::filter::ekf::Filter;
use crate::filter::input::measurements::{MeasurementOutcome, UpdateReport};
use crate::settings::BatchTestKind;
use crate::validate;
use crate::validate::{BatchTest, conditional_gate};

/// Level of the gate that each match passes before the batch is tested: wide, as the tests of the batch are to decide.
const GATE_LEVEL: f64 = 0.999;

/// A batch is held to be worse than the run's others are if it is so many times as far off, in squares, as these usually.
const USUALLY: f64 = 2.5;
/// Least share of the stated variances that is held against it.
const LEAST_NOISE: f64 = 0.2;
/// Numbers of the camera that are predicted, and T_CF's, which are off by all that is stated, spread over the batch.
const PREDICTED: f64 = 3.0;

/// One test: lists the blocks of the batch that fail it, and names their outcome.
pub(crate) type Test = fn(&mut Filter, &mut UpdateReport, &mut Vec<usize>) -> MeasurementOutcome;

impl Filter {
    /// All tests, in the order in which they are made.
    pub(crate) const TESTS: [Test; 4] = [
        Self::poorly_predicted,
        Self::gated,
        Self::batch_test,
        Self::conditional_gate,
    ];

    /// Matches whose predicted pixel has a standard deviation as wide as the image: no linearisation holds there.
    fn poorly_predicted(
        &mut self,
        _: &mut UpdateReport,
        gone: &mut Vec<usize>,
    ) -> MeasurementOutcome {
        gone.clear();
        let (s, m) = (self.workspace.batch.s(), self.workspace.batch.rows());
        let widest = f64::from(self.setup.camera.width.max(self.setup.camera.height)).powi(2);
        for (u, (block, &at)) in self
            .workspace
            .batch
            .blocks()
            .iter()
            .zip(self.workspace.batch.offsets())
            .enumerate()
        {
            let mut rows = at..at + block.rows.count;
            if block.rows.is_pixel() && rows.any(|row| s[row * m + row] > widest) {
                gone.push(u);
            }
        }
        MeasurementOutcome::TooUncertain
    }

    /// Matches that fail their individual gate.
    fn gated(&mut self, _: &mut UpdateReport, gone: &mut Vec<usize>) -> MeasurementOutcome {
        gone.clear();
        if self.setup.settings.validate.test == BatchTestKind::None {
            return MeasurementOutcome::RejectedGate;
        }
        validate::reject_each(
            self.workspace.batch.s(),
            self.workspace.batch.rows(),
            self.workspace.batch.g(),
            validate::Blocks::new(self.workspace.batch.offsets()),
            GATE_LEVEL,
            &mut self.workspace.test,
        );
        gone.extend_from_slice(self.workspace.test.rejected());
        MeasurementOutcome::RejectedGate
    }

    /// How many times as far off as it is a match counts where matches usually fit better than their stated noise (METHOD 8).
    fn closer(&self) -> f64 {
        let rows = self.workspace.batch.rows().max(1) as f64;
        let usual = (USUALLY * self.memory.nis.usual()).max(LEAST_NOISE);
        (usual + PREDICTED / rows).min(1.0).sqrt().recip()
    }

    /// Matches that the batch test leaves out.
    fn batch_test(
        &mut self,
        report: &mut UpdateReport,
        gone: &mut Vec<usize>,
    ) -> MeasurementOutcome {
        gone.clear();
        let test = BatchTest::chosen(&self.setup.settings.validate);
        let times = self.closer();
        let batch = self.workspace.batch.as_batch_of(times);
        if batch.blocks.is_empty() {
            return MeasurementOutcome::RejectedBatch;
        }
        let verdict = test.run(&batch, &mut self.workspace.test);
        report.order = verdict.order;
        report.exact &= verdict.exact;
        gone.extend_from_slice(self.workspace.test.rejected());
        MeasurementOutcome::RejectedBatch
    }

    /// Matches that disagree with the other accepted ones.
    fn conditional_gate(
        &mut self,
        _: &mut UpdateReport,
        gone: &mut Vec<usize>,
    ) -> MeasurementOutcome {
        gone.clear();
        let options = &self.setup.settings.validate;
        if options.test == BatchTestKind::None || options.conditional_level >= 1.0 {
            return MeasurementOutcome::RejectedConditional;
        }
        let times = self.closer();
        let options = &self.setup.settings.validate;
        let batch = self.workspace.batch.as_batch_of(times);
        conditional_gate(
            batch.l,
            batch.ld,
            batch.g,
            batch.blocks,
            options.conditional_level,
            validate::MAX_SHARE,
            &mut self.workspace.test,
        );
        gone.extend_from_slice(self.workspace.test.rejected());
        MeasurementOutcome::RejectedConditional
    }
}
