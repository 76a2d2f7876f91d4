//! What a worn camera's own gyroscope tells of how it turned while its image was read (METHOD 6).

use crate::filter::ekf::Filter;
use crate::filter::input::measurements::{MeasurementOutcome, Measurements, WornObservation};
use crate::observe::block::MeasurementBlock;
use crate::observe::rows::Rows;
use nalgebra::{Matrix3, Vector3};

impl Filter {
    /// Whether the view that is measured tells a rate, and its shutter may roll.
    pub(crate) fn tells_rate(&self, z: &Measurements) -> bool {
        z.first_view()
            .is_some_and(|worn| self.told_roll(worn).is_some())
    }

    /// Where the state has how the camera of a view that tells its rate moves while the image is read.
    pub(super) fn told_roll(&self, worn: &WornObservation) -> Option<usize> {
        worn.rate.and(self.memory.state.worn_roll_offset(worn.who))
    }

    /// The rate as three rows: it measures how the camera turned while its image was read, which is readout times rate. So the
    /// matches hold against it, and the tests of a frame's matches refuse one that they contradict.
    pub(crate) fn worn_rate(
        &self,
        worn: &WornObservation,
    ) -> Result<MeasurementBlock, MeasurementOutcome> {
        let (Some(roll), Some(rate)) = (self.told_roll(worn), worn.rate) else {
            return Err(MeasurementOutcome::Unused);
        };
        let settings = &self.setup.settings.worn;
        let (readout, sd) = settings.readout_told();
        let of_rate = (settings.readout * settings.rate_sd).powi(2);
        let noise = Matrix3::identity() * of_rate + rate * rate.transpose() * sd.powi(2);
        let turned: Vector3<f64> = self.memory.state.part(roll + 3);
        let rows = Rows::shared_turn(rate * readout - turned, noise);
        let block = MeasurementBlock::of_camera(rows);
        Ok(MeasurementBlock {
            shared: Some(roll),
            ..block
        })
    }
}
