//! How well the scale is known.

use crate::filter::ekf::Filter;
use crate::scale::told_variance;

impl Filter {
    /// Relative standard deviation of the scale: by how much all distances from the camera to its map may be too long
    /// or too short together. `None` where no feature has a depth.
    ///
    /// Features outside of the working set do not count. O(n^2), one pass over P.
    ///
    /// It says what P says. In a map of arbitrary unit P holds how far the unit has drifted since the start, which is no
    /// statement about metres.
    pub fn scale_sd(&self) -> Option<f64> {
        told_variance(&self.memory.state).map(f64::sqrt)
    }
}
