//! Normal equations of a fit of poses and points, solved by the Schur complement over the points.

use nalgebra::{DMatrix, DVector, Matrix3, Matrix6, SMatrix, Vector2, Vector3, Vector6};

/// What one step changes: tangents of the poses, and numbers of the points.
pub(super) struct Step {
    pub poses: Vec<Vector6<f64>>,
    pub points: Vec<Vector3<f64>>,
}

/// Normal equations: of the poses, of each point, and between them.
pub(super) struct Normal {
    poses: Vec<(Matrix6<f64>, Vector6<f64>)>,
    points: Vec<(Matrix3<f64>, Vector3<f64>)>,
    between: Vec<Vec<SMatrix<f64, 6, 3>>>,
}

impl Normal {
    pub(super) fn new(poses: usize, points: usize) -> Self {
        Self {
            poses: vec![(Matrix6::zeros(), Vector6::zeros()); poses],
            points: vec![(Matrix3::zeros(), Vector3::zeros()); points],
            between: vec![vec![SMatrix::zeros(); points]; poses],
        }
    }

    /// Adds a pixel of point `i`, seen from a pose, or from the first one, which is known.
    pub(super) fn add(
        &mut self,
        pose: Option<usize>,
        i: usize,
        by_pose: &SMatrix<f64, 2, 6>,
        by_point: &SMatrix<f64, 2, 3>,
        residual: &Vector2<f64>,
    ) {
        let point = &mut self.points[i];
        point.0 += by_point.transpose() * by_point;
        point.1 += by_point.transpose() * residual;
        if let Some(k) = pose {
            self.poses[k].0 += by_pose.transpose() * by_pose;
            self.poses[k].1 += by_pose.transpose() * residual;
            self.between[k][i] = by_pose.transpose() * by_point;
        }
    }

    /// Holds the last pose along a direction of its tangent's translation, as exactly as that is long.
    pub(super) fn hold_last(&mut self, along: &Vector3<f64>) {
        if let Some((matrix, _)) = self.poses.last_mut() {
            let mut corner = matrix.fixed_view_mut::<3, 3>(0, 0);
            corner += along * along.transpose();
        }
    }

    /// Inverse of a point's own matrix, damped.
    fn own(&self, i: usize, damping: f64) -> Option<Matrix3<f64>> {
        let mut own = self.points[i].0;
        for d in 0..3 {
            own[(d, d)] *= 1.0 + damping;
        }
        own.try_inverse()
    }

    /// Matrix and right-hand side of the poses without the points.
    fn poses_alone(&self, damping: f64, own: &[Matrix3<f64>]) -> (DMatrix<f64>, DVector<f64>) {
        let n = 6 * self.poses.len();
        let (mut s, mut g) = (DMatrix::zeros(n, n), DVector::zeros(n));
        for (k, (h, b)) in self.poses.iter().enumerate() {
            let mut damped = *h;
            for d in 0..6 {
                damped[(d, d)] *= 1.0 + damping;
            }
            s.fixed_view_mut::<6, 6>(6 * k, 6 * k).copy_from(&damped);
            g.fixed_rows_mut::<6>(6 * k).copy_from(b);
        }
        for (i, inverse) in own.iter().enumerate() {
            for (k, row) in self.between.iter().enumerate() {
                let gain = row[i] * inverse;
                let mut part = g.fixed_rows_mut::<6>(6 * k);
                part -= gain * self.points[i].1;
                for (l, other) in self.between.iter().enumerate() {
                    let mut block = s.fixed_view_mut::<6, 6>(6 * k, 6 * l);
                    block -= gain * other[i].transpose();
                }
            }
        }
        (s, g)
    }

    /// The damped step; None if the matrix is singular.
    pub(super) fn solve(&self, damping: f64) -> Option<Step> {
        let count = self.points.len();
        let own: Vec<_> = (0..count)
            .map(|i| self.own(i, damping))
            .collect::<Option<_>>()?;
        let (s, g) = self.poses_alone(damping, &own);
        let step = s.cholesky()?.solve(&g);
        let poses: Vec<Vector6<f64>> = (0..self.poses.len())
            .map(|k| step.fixed_rows::<6>(6 * k).into_owned())
            .collect();
        let points = (0..count).map(|i| {
            let pulled = poses.iter().zip(&self.between);
            let pulled: Vector3<f64> = pulled.map(|(d, row)| row[i].transpose() * d).sum();
            own[i] * (self.points[i].1 - pulled)
        });
        let points = points.collect();
        Some(Step { poses, points })
    }

    /// Joint covariance of two poses (the second zero where there is none) and all points.
    pub(super) fn covariance(&self, two: [usize; 2], second: bool) -> Option<DMatrix<f64>> {
        let count = self.points.len();
        let own: Vec<_> = (0..count)
            .map(|i| self.own(i, 0.0))
            .collect::<Option<_>>()?;
        let (s, _) = self.poses_alone(0.0, &own);
        let poses = s.cholesky()?.inverse();
        // Rows of what is asked for by the poses' errors, and what each point adds by itself.
        let n = 12 + 3 * count;
        let mut by_poses = DMatrix::zeros(n, poses.nrows());
        for (at, &k) in [0, 6].into_iter().zip(&two) {
            if at == 0 || second {
                by_poses
                    .fixed_view_mut::<6, 6>(at, 6 * k)
                    .fill_with_identity();
            }
        }
        for i in 0..count {
            for (k, row) in self.between.iter().enumerate() {
                let gain = -own[i] * row[i].transpose();
                by_poses
                    .fixed_view_mut::<3, 6>(12 + 3 * i, 6 * k)
                    .copy_from(&gain);
            }
        }
        let mut joint = &by_poses * poses * by_poses.transpose();
        for (i, inverse) in own.iter().enumerate() {
            let mut block = joint.fixed_view_mut::<3, 3>(12 + 3 * i, 12 + 3 * i);
            block += inverse;
        }
        let turned = joint.transpose();
        Some((joint + turned) * 0.5)
    }
}
