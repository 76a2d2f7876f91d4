//! Where a view is linearised, beside the means (METHOD 6).

use nalgebra::{Matrix3x6, RowVector6, Vector3, Vector6};

/// By how much a view's error of T_CF, and the inverse ranges of its births along with it, are taken beside their means.
#[derive(Clone, Debug)]
pub(crate) struct ToldError {
    /// Offset of the error in the state.
    pub(crate) at: usize,
    pub(crate) step: Vector6<f64>,
    /// Offsets of inverse ranges, and by how much.
    pub(crate) births: Vec<(usize, f64)>,
}

impl ToldError {
    pub(crate) fn new(at: usize, step: Vector6<f64>) -> Self {
        let births = Vec::new();
        Self { at, step, births }
    }

    /// A birth's inverse range, at an offset in the state, hangs on the error by these derivatives.
    pub(crate) fn follows(&mut self, offset: usize, by_error: &RowVector6<f64>) {
        self.births.push((offset, (by_error * self.step)[0]));
    }

    /// What a pixel's innovation has more from the means: of the error, and of the inverse range at an offset in the state.
    pub(crate) fn expected(
        &self,
        by_error: &Matrix3x6<f64>,
        by_rho: &Vector3<f64>,
        offset: usize,
    ) -> Vector3<f64> {
        let own = self.births.iter().find(|(at, _)| *at == offset);
        by_error * self.step + by_rho * own.map_or(0.0, |(_, step)| *step)
    }
}
