//! A frame's rows again, linearised where the frame itself puts what multiplies other unknowns (METHOD 4, 6).

use super::ekf::Filter;
use super::measurements::{Measurements, Outcome};
use super::sources::{Scratch, Source, WornForm};
use crate::error::EkfError;
use crate::observe::POSE_DIM;
use crate::observe::block::MeasurementBlock;
use nalgebra::Vector6;

/// Six numbers of the state, and how far the frame moves them.
struct Step {
    at: usize,
    by: Vector6<f64>,
}

impl Filter {
    /// Linearises the accepted rows at what all of them together give for the velocities under a shutter that may roll, and for
    /// the error of T_CF that lasts, and factors S again.
    ///
    /// A rolling shutter shows by the product of readout and velocities. Those that a frame starts from say how the one before
    /// moved: where the camera begins to turn, they would have the covariance hold that nothing rolls.
    ///
    /// A pixel of Cf says the product of an inverse range and the baseline. With the derivative taken at the measured baseline,
    /// the innovation and its weight share the noise of that measurement: a view that measured too long a baseline pulls the map
    /// apart harder than one that measured too short a one draws it together. Where T_CF is exact but for white noise that
    /// averages to little, and nothing is done; a lasting error of the baseline gives way to it in every view.
    ///
    /// Once is enough, as the product is linear in each. The rows stay as they are where one of them predicts nothing there.
    ///
    /// # Errors
    /// `NotPositiveDefinite` if S is not; nothing of the state has changed then.
    pub(super) fn linearise_again(
        &mut self,
        z: &Measurements,
        form: WornForm,
        scratch: &Scratch,
    ) -> Result<(), EkfError> {
        let rolls = self.shutter().map(|_| POSE_DIM);
        let error = z.worn.as_ref().filter(|_| form == WornForm::Tight);
        let error = error.and_then(|worn| {
            let lasts = self.state.lasting_error(worn.who).next().is_some()
                || self.state.worn_clock_block(worn.who).is_some();
            self.worn_error_offset(worn.who).filter(|_| lasts)
        });
        if (rolls, error) == (None, None) || self.batch.rows() == 0 {
            return Ok(());
        }
        let moved = self.batch.moved_by_first(self.batch.rows());
        let slots = self.state.p.stored().slots;
        let step = |at| Step {
            at,
            by: Vector6::from_fn(|i, _| moved[slots[at + i]]),
        };
        let (motion, error) = (rolls.map(step), error.map(step));
        let steps: Vec<&Step> = motion.iter().chain(&error).collect();
        let before: Vec<Vector6<f64>> = steps.iter().map(|step| self.state.part(step.at)).collect();
        for (step, before) in steps.iter().zip(&before) {
            self.state.set_part(step.at, &(before + step.by));
        }
        let blocks: Result<Vec<MeasurementBlock>, _> = scratch
            .sources
            .iter()
            .map(|&source| {
                let mut block = self.measurement_block(z, source)?;
                let rows = &mut block.rows;
                if let (Some(step), Some(by)) = (&motion, &rows.by_motion) {
                    rows.innovation += by.by.fixed_columns::<6>(0) * step.by;
                }
                if let (Some(step), Source::WornPixel(..), Some(by)) = (&error, source, &rows.by_shared) {
                    rows.innovation += by * step.by;
                }
                Ok::<_, Outcome>(block)
            })
            .collect();
        for (step, before) in steps.iter().zip(&before) {
            self.state.set_part(step.at, before);
        }
        let Ok(blocks) = blocks else { return Ok(()) };
        self.batch.clear();
        for block in blocks {
            self.batch.push(block);
        }
        self.batch.build(&self.state);
        self.batch.factor()
    }
}
