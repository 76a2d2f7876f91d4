//! The individual gate: each match by itself.

use super::batch::{Blocks, Verdict, check};
use super::distance::individual_distance;
use super::workspace::Workspace;

/// Accepts each block whose own squared Mahalanobis distance `g_i^T S_ii^-1 g_i` is within the chi-square quantile at `level`.
///
/// `s` is `S` (lower triangle). The verdict's distance is the joint one of the accepted blocks.
pub fn individual_gate(
    s: &[f64],
    ld: usize,
    g: &[f64],
    blocks: Blocks,
    level: f64,
    ws: &mut Workspace,
) -> Verdict {
    reject_each(s, ld, g, blocks, level, ws);
    ws.joint.clear();
    let mut rejected = ws.rejected.iter().peekable();
    for block in 0..blocks.len() {
        if rejected.next_if_eq(&&block).is_none() {
            ws.joint.push(s, ld, g, blocks, block);
        }
    }
    let accepted = ws.rejected.len() < blocks.len() || blocks.is_empty();
    Verdict::joint(ws.rejected.len(), ws.joint.d2(), ws.joint.len(), accepted)
}

/// Rejects the same blocks as [`individual_gate`] without the joint distance of the others: O(m) instead of O(m^3).
pub(crate) fn reject_each(
    s: &[f64],
    ld: usize,
    g: &[f64],
    blocks: Blocks,
    level: f64,
    ws: &mut Workspace,
) {
    check(s, ld, g, blocks);
    ws.rejected.clear();
    for block in 0..blocks.len() {
        let limit = ws.quantiles.get(level, blocks.count(block));
        let distance = individual_distance(s, ld, g, blocks, block);
        if distance.is_nan() || distance > limit {
            ws.rejected.push(block);
        }
    }
}
