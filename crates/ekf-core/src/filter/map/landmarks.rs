//! The map as points in W.

use crate::filter::ekf::Filter;
use crate::math::plus_transpose;
use crate::state::Block;
use nalgebra::{Matrix3, Vector3};

/// A landmark of the map.
#[derive(Clone, Debug)]
pub struct Landmark {
    /// Its id.
    pub id: u64,
    /// Point in W, metres.
    pub point: Vector3<f64>,
    /// 3x3 covariance of the point, m^2.
    pub covariance: Matrix3<f64>,
    /// sd(rho) / rho, the relative error of its distance from its anchor.
    pub rho_ratio: f64,
}

impl Filter {
    /// All landmarks with their covariance in W. Features with rho <= 0 have no point and are left out.
    pub fn landmarks(&self) -> Vec<Landmark> {
        let state = self.state();
        let landmark = |block: &Block| {
            let feature = state.feature(block);
            let point = feature.point()?;
            let j = feature.point_jacobian();
            let (_, own) = state.feature_covariance(block);
            let covariance = j * own * j.transpose();
            let map_frame = self.memory.map_frame.of_point(&point);
            let rho_ratio = own[(5, 5)].max(0.0).sqrt() / feature.scale();
            Some(Landmark {
                id: block.id,
                point,
                covariance: plus_transpose(covariance + map_frame) * 0.5,
                rho_ratio,
            })
        };
        state.layout.features().filter_map(landmark).collect()
    }
}
