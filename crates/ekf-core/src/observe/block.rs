//! A measurement block: the rows of one match, and where in the state they apply.

use super::rows::Rows;
use nalgebra::Vector3;

/// A measurement that is accepted or rejected as a whole.
#[derive(Clone, Debug)]
pub struct MeasurementBlock {
    /// Rows of the innovation and of grad H.
    pub rows: Rows,
    /// Id of its feature.
    pub id: u64,
    /// Offset of its feature in the state.
    pub feature: usize,
    /// Offset of the six numbers that [`Rows::by_shared`] belongs to, if they are in the state.
    pub shared: Option<usize>,
    /// Inverse depth at which the rows are taken, 1/m, where that is not the feature's.
    pub told: Option<f64>,
}

impl MeasurementBlock {
    /// Rows that no feature has a part in.
    pub(crate) fn of_camera(rows: Rows) -> Self {
        Self {
            rows,
            id: 0,
            feature: 0,
            shared: None,
            told: None,
        }
    }

    /// The same rows, linearised at the mean `x`, with the innovation that is expected from the mean `prior`.
    pub(crate) fn expected_from(mut self, x: &[f64], prior: &[f64]) -> Self {
        let by_pose = self.rows.by_pose.as_slice().as_chunks::<3>().0;
        let by_feature = self.rows.by_feature.as_slice().as_chunks::<3>().0;
        let pose = by_pose.iter().zip(0..);
        let feature = by_feature.iter().zip(self.feature..);
        let mut shift = Vector3::zeros();
        let motion = self.rows.by_motion.iter().flat_map(|motion| {
            let columns = motion.by.as_slice().as_chunks::<3>().0.iter();
            columns.zip(motion.columns())
        });
        for (by, i) in pose.chain(feature).chain(motion) {
            shift += Vector3::from(*by) * (x[i] - prior[i]);
        }
        self.rows.innovation += shift;
        self
    }

    /// Where the feature's numbers are stored, in threes: the anchor's and its own.
    pub(crate) fn slots(&self, slots: &[usize]) -> (usize, usize) {
        (slots[self.feature], slots[self.feature + 3])
    }
}
