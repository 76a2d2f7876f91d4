//! The map as points in W.

use crate::filter::ekf::Filter;
use crate::math::plus_transpose;
use crate::observe::FeatureState;
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
    /// sd(rho) / rho, the relative error of its depth: from its anchor, of a feature that has become a point from the camera now.
    pub rho_ratio: f64,
}

impl Filter {
    /// All landmarks with their covariance in W. Features with rho <= 0 have no point and are left out.
    pub fn landmarks(&self) -> Vec<Landmark> {
        let state = self.state();
        let camera = state.camera_pose().r;
        let p_camera = state.p.block::<3, 3>(0, 0);
        let landmark = |block: &Block| {
            let feature = state.feature(block);
            let point = feature.point()?;
            let j = feature.point_jacobian();
            let (cross, own) = state.feature_covariance(block);
            let covariance = j * own * j.transpose();
            let placed = self.memory.placed.of_point(&point);
            let rho_ratio = match feature {
                FeatureState::InverseDepth(y) => own[(5, 5)].max(0.0).sqrt() / y[5],
                FeatureState::Point(_) => {
                    let with_camera = cross.fixed_view::<3, 6>(0, 0) * j.transpose();
                    let ray = point - camera;
                    let relative = covariance + p_camera - plus_transpose(with_camera);
                    let variance = (ray.transpose() * relative * ray)[(0, 0)];
                    variance.max(0.0).sqrt() / ray.norm_squared()
                }
            };
            Some(Landmark {
                id: block.id,
                point,
                covariance: plus_transpose(covariance + placed) * 0.5,
                rho_ratio,
            })
        };
        state.layout.features().filter_map(landmark).collect()
    }
}
