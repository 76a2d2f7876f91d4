//! A small graph of poses beside the filter (METHOD 25): what was measured of each pose relative to another, and the poses
//! that agree best with all of it, with the covariance of any of them.
//!
//! A node is the pose of a submap and what the submap transferred ([`Transferred`]): the errors that the filter's estimates before
//! and after it share. A factor ([`Factor`]) says what was measured of two nodes, and how well. Nothing of the graph goes
//! back into the filter.

mod factor;
mod marginals;
mod node;
mod normal;
mod posed_node;
mod poses;

pub use factor::{Edge, Factor};
pub use marginals::Marginals;
pub use node::{Node, Transferred};
pub use posed_node::PosedNode;
pub use poses::{PoseGraph, Solved};

use nalgebra::DMatrix;

/// `a b`, column by column. Other products of large matrices sum in blocks, as the processor at hand likes them: the last bit
/// of a pose would depend on it.
fn times(a: &DMatrix<f64>, b: &DMatrix<f64>) -> DMatrix<f64> {
    let mut product = DMatrix::zeros(a.nrows(), b.ncols());
    for (mut to, column) in product.column_iter_mut().zip(b.column_iter()) {
        to.gemv(1.0, a, &column, 0.0);
    }
    product
}
