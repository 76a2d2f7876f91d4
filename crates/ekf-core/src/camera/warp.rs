//! The error of a calibration, as a small warp of the image (METHOD 4): what the considered state stands for.
//!
//! Whatever the camera's model, a wrong calibration shifts a pixel by a smooth function of where it is. With `d = (u, v) -
//! (cx, cy)`, `m = (d_u / fx, d_v / fy)` and the six numbers `(focal, aspect, centre u, centre v, radial 3, radial 5)`,
//!
//! ```text
//! shift = focal d + aspect (0, d_v) + (centre u, centre v) + (radial3 |m|^2 + radial5 |m|^4) d
//! ```
//!
//! What was measured is the pixel of the camera as it is given, plus that shift.

use super::Camera;
use nalgebra::{SMatrix, Vector2};

impl Camera {
    /// How a pixel moves with the six numbers of a calibration's error, pixels.
    pub fn warp_jacobian(&self, uv: &Vector2<f64>) -> SMatrix<f64, 2, 6> {
        let d = uv - Vector2::new(self.cx, self.cy);
        let r2 = (d.x / self.fx).powi(2) + (d.y / self.fy).powi(2);
        let mut j = SMatrix::<f64, 2, 6>::zeros();
        j.set_column(0, &d);
        j[(1, 1)] = d.y;
        j[(0, 2)] = 1.0;
        j[(1, 3)] = 1.0;
        j.set_column(4, &(d * r2));
        j.set_column(5, &(d * (r2 * r2)));
        j
    }
}
