//! A view's rows again, linearised where the view itself puts its error (METHOD 6).

use crate::error::EkfError;
use crate::filter::ekf::Filter;
use crate::filter::input::measurements::Measurements;
use crate::filter::input::sources::Scratch;
use crate::filter::input::told_error::ToldError;
use nalgebra::Vector6;

impl Filter {
    /// Linearises the accepted rows of a view at the error of T_CF that all of them together give, and factors S again.
    ///
    /// A pixel of Cf says the product of an inverse range and the baseline. With the derivative taken at the measured baseline,
    /// the innovation and its weight share the noise of that measurement: a view that measured too long a baseline pulls the map
    /// apart harder than one that measured too short a one draws it together. Where T_CF is exact but for white noise that
    /// averages to little, and nothing is done; a time-correlated error of the baseline gives way to it in every view. Once is enough, as
    /// the product is linear in each. The rows stay as they are where one of them predicts nothing there.
    ///
    /// # Errors
    /// `NotPositiveDefinite` if S is not; nothing of the state has changed then.
    pub(crate) fn linearise_at_told_error(
        &mut self,
        z: &Measurements,
        scratch: &Scratch,
    ) -> Result<(), EkfError> {
        // The view that starts a map is linearised there from the beginning.
        let at_means = self.workspace.told.is_none();
        let Some(worn) = z.first_view().filter(|_| at_means) else {
            return Ok(());
        };
        let lasts = self
            .memory
            .state
            .time_correlated_error(worn.who)
            .next()
            .is_some()
            || self.memory.state.worn_clock_block(worn.who).is_some();
        let Some(at) = self.worn_error_offset(worn.who).filter(|_| lasts) else {
            return Ok(());
        };
        if self.workspace.batch.rows() == 0 {
            return Ok(());
        }
        let moved = self
            .workspace
            .batch
            .moved_by_first(self.workspace.batch.rows());
        let slots = self.memory.state.p.stored().slots;
        let mut step = Vector6::from_fn(|i, _| moved[slots[at + i]]);
        if self.setup.carries() {
            let gauge = &self.workspace.gauge;
            step -= self.workspace.batch.moved_with_scale(gauge, slots, at);
        }
        let before = self.memory.state.part::<6>(at);
        self.memory.state.set_part(at, &(before + step));
        self.workspace.told = Some(ToldError::new(at, step));
        let blocks = scratch.sources.iter();
        let blocks: Result<Vec<_>, _> = blocks.map(|&s| self.measurement_block(z, s)).collect();
        self.workspace.told = None;
        self.memory.state.set_part(at, &before);
        let Ok(blocks) = blocks else { return Ok(()) };
        self.workspace.batch.clear();
        for block in blocks {
            self.workspace.batch.push(block);
        }
        self.workspace.batch.build(&self.memory.state);
        self.workspace.batch.factor()
    }
}
