//! A measurement block: the rows of one match, and where in the state they apply.

use super::feature::Form;
use super::rows::Rows;

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
}

impl MeasurementBlock {
    /// Where the feature's numbers are stored, in threes: the anchor's and its own, or only the point's.
    pub(crate) fn slots(&self, slots: &[usize]) -> (usize, Option<usize>) {
        let own = match self.rows.form {
            Form::InverseDepth => Some(slots[self.feature + 3]),
            Form::Point => None,
        };
        (slots[self.feature], own)
    }
}
