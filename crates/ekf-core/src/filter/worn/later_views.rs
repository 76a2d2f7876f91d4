//! Views of other worn cameras in the same frame, one after another (METHOD 6).

use crate::filter::ekf::Filter;
use crate::filter::input::measurements::{
    MeasurementOutcome, Measurements, UpdateReport, WornObservation,
};
use crate::filter::input::sources::Scratch;
use crate::math::pose::Pose;
use nalgebra::Vector2;

/// A new point that a view before gave: time of its frame, pixel there, and the feature that it became.
type Born = (Option<f64>, Vector2<f64>, u64);

impl Filter {
    /// Measures the views of `z` that were not measured `together` with what Cs found, each with what all before it have told;
    /// a view that would break the filter is refused by itself. `used` are the worn cameras measured so far, with T_CF for the
    /// present pose.
    pub(crate) fn measure_later(
        &mut self,
        together: &Measurements,
        z: &Measurements,
        used: &mut Vec<(usize, Pose)>,
        report: &mut UpdateReport,
        scratch: &mut Scratch,
    ) {
        let mut born = Vec::new();
        for worn in &together.views {
            self.list_born(worn, report.pairs(), &mut born);
        }
        for worn in &z.views[together.views.len()..] {
            let worn = self.with_known_points(worn, &born);
            let mut outcome = self.measure_one_more(&worn, used, scratch);
            self.list_born(&worn, outcome.pairs(), &mut born);
            report.views.append(&mut outcome.views);
            report.rates.append(&mut outcome.rates);
            report.nis += outcome.nis;
            report.dof += outcome.dof;
        }
    }

    fn measure_one_more(
        &mut self,
        worn: &WornObservation,
        used: &mut Vec<(usize, Pose)>,
        scratch: &mut Scratch,
    ) -> UpdateReport {
        let mut report = UpdateReport::default();
        let alone = |worn| Measurements {
            views: vec![worn],
            ..Measurements::default()
        };
        let measured = self.time_compensated(worn).and_then(|compensated| {
            let (here, compensated) = match compensated {
                Some((here, compensated)) => (here, Some(compensated)),
                None => (worn.clone(), None),
            };
            let z = alone(here);
            self.measure_view(&z, compensated.as_ref(), used, &mut report, scratch)
        });
        match measured {
            Ok(true) => report,
            Ok(false) => {
                report.start(&alone(worn.clone()));
                report
            }
            Err(error) => UpdateReport::refused(&alone(worn.clone()), error),
        }
    }

    /// The view with the points that a view before has given already.
    fn with_known_points(&self, worn: &WornObservation, born: &[Born]) -> WornObservation {
        let (mut worn, frame) = (worn.clone(), self.frame_of(worn));
        for pair in worn.pairs.iter_mut().filter(|pair| pair.id.is_none()) {
            let same = born.iter().find(|(at, uv, id)| {
                (*at, Some(*uv)) == (frame, pair.uv) && self.memory.known(*id).is_ok()
            });
            pair.id = same.map(|(_, _, id)| *id);
        }
        worn
    }

    fn list_born(
        &self,
        worn: &WornObservation,
        pairs: &[MeasurementOutcome],
        born: &mut Vec<Born>,
    ) {
        let frame = self.frame_of(worn);
        for (pair, outcome) in worn.pairs.iter().zip(pairs) {
            if let (MeasurementOutcome::Born(id), Some(uv)) = (outcome, pair.uv) {
                born.push((frame, uv, *id));
            }
        }
    }

    /// Time of the frame of Cs that a view's pairs are of.
    fn frame_of(&self, worn: &WornObservation) -> Option<f64> {
        worn.capture.map(|c| c.frame).or(self.memory.time)
    }
}
