//! A pose between two others, and its derivatives (METHOD 21).

use super::pose::Pose;
use super::quat;
use nalgebra::{Matrix3, Matrix6, Vector6};

/// The pose at a share of the way from one to another: straight in translation, at a constant rate in rotation.
#[derive(Clone, Debug)]
pub struct Between {
    /// `T_WC` there.
    pub pose: Pose,
    /// Derivative of its right tangent by that of the first pose, 6x6.
    pub by_first: Matrix6<f64>,
    /// ... by that of the second, 6x6.
    pub by_second: Matrix6<f64>,
    /// The whole way from first to second, along the axes of the pose there: metres, radians.
    pub way: Vector6<f64>,
}

impl Between {
    /// At `share` of the way, 0 for the first pose and 1 for the second; they differ by less than half a turn.
    pub fn new(first: &Pose, second: &Pose, share: f64) -> Self {
        let pose = first.interpolate(second, share);
        let turn = quat::rotation_log(&(first.rotation.transpose() * second.rotation));
        let part = turn * share;
        let back = quat::rotation_exp(&-part);
        let inverse = quat::right_jacobian(&turn)
            .try_inverse()
            .unwrap_or_else(Matrix3::identity);
        let along = quat::right_jacobian(&part) * share;
        let into = pose.rotation.transpose();
        let mut by_first = Matrix6::zeros();
        by_first
            .fixed_view_mut::<3, 3>(0, 0)
            .copy_from(&(into * first.rotation * (1.0 - share)));
        // The left Jacobian is the right one transposed.
        by_first
            .fixed_view_mut::<3, 3>(3, 3)
            .copy_from(&(back - along * inverse.transpose()));
        let mut by_second = Matrix6::zeros();
        by_second
            .fixed_view_mut::<3, 3>(0, 0)
            .copy_from(&(into * second.rotation * share));
        by_second
            .fixed_view_mut::<3, 3>(3, 3)
            .copy_from(&(along * inverse));
        let straight = into * (second.translation - first.translation);
        let way = Vector6::new(straight.x, straight.y, straight.z, turn.x, turn.y, turn.z);
        Self {
            pose,
            by_first,
            by_second,
            way,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::Between;
    use crate::math::pose::Pose;
    use nalgebra::{Matrix6, Vector6};

    fn poses() -> (Pose, Pose) {
        let first = Pose::exp(&Vector6::new(1.0, -2.0, 0.5, 0.3, -1.1, 0.7));
        let step = Vector6::new(0.4, 0.1, -0.2, 0.2, 0.5, -0.3);
        (first.clone(), first.retract(&step))
    }

    #[test]
    fn its_derivatives_are_those_of_finite_differences() {
        let (first, second) = poses();
        let e = 1e-6;
        for share in [0.0, 0.2, 0.5, 0.9, 1.0] {
            let at = Between::new(&first, &second, share);
            let numeric = |moved: &dyn Fn(&Vector6<f64>) -> Pose| {
                let column = |k: usize| {
                    let [to, from] = [e, -e].map(|e| {
                        let mut xi = Vector6::zeros();
                        xi[k] = e;
                        at.pose.inverse().compose(&moved(&xi)).log()
                    });
                    (to - from) / (2.0 * e)
                };
                Matrix6::from_columns(&std::array::from_fn::<_, 6, _>(column))
            };
            let by_first = numeric(&|xi| first.retract(xi).interpolate(&second, share));
            let by_second = numeric(&|xi| first.interpolate(&second.retract(xi), share));
            assert!((at.by_first - by_first).abs().max() < 1e-8, "{share}");
            assert!((at.by_second - by_second).abs().max() < 1e-8, "{share}");
        }
    }

    #[test]
    fn at_its_ends_it_is_the_one_or_the_other_pose() {
        let (first, second) = poses();
        for (share, pose) in [(0.0, &first), (1.0, &second)] {
            let at = Between::new(&first, &second, share);
            assert!(pose.inverse().compose(&at.pose).log().norm() < 1e-12);
            assert!(
                (at.by_first - Matrix6::identity() * (1.0 - share))
                    .abs()
                    .max()
                    < 1e-12
            );
            assert!((at.by_second - Matrix6::identity() * share).abs().max() < 1e-12);
        }
    }
}
