//! The conditional gate: each match against what all the other accepted matches say.

use super::batch::{Blocks, Verdict, check};
use super::distance::{block_distance, whiten};
use super::quantiles::Quantiles;
use super::subsets::scratch::Scratch;
use super::workspace::Workspace;

/// Leaves out, the worst first, every block that disagrees with the others: whose distance given all of them,
/// `z_i^T (A_ii)^-1 z_i` with `A = S^-1` and `z = A g`, exceeds the chi-square quantile at `level`.
///
/// A joint test at the degrees of freedom of a whole batch does not see one wrong match among many that fit better
/// than their noise says: its distance drowns in theirs. Given the others, its distance is its own.
///
/// `l` is the Cholesky factor of `S` (lower triangle, column-major, leading dimension `ld`), `g` the innovation. At most
/// `max_share` of the blocks are left out; the verdict says whether the rest passed. Without an offender this costs the
/// inverse of `l`.
pub fn conditional_gate(
    l: &[f64],
    ld: usize,
    g: &[f64],
    blocks: Blocks,
    level: f64,
    max_share: f64,
    ws: &mut Workspace,
) -> Verdict {
    check(l, ld, g, blocks);
    ws.rejected.clear();
    if blocks.is_empty() {
        return Verdict::joint(0, 0.0, 0, true);
    }
    let d2 = whiten(l, ld, g, &mut ws.whitened);
    let most = (max_share * blocks.len() as f64) as usize;
    let scratch = &mut ws.hohct;
    scratch.prepare_z(l, ld, &ws.whitened, blocks);
    scratch.greedy.start(&scratch.z, blocks);
    let mut dof = g.len();
    let passed = loop {
        let Some(block) = worst(scratch, blocks, level, &mut ws.quantiles) else {
            break true;
        };
        if ws.rejected.len() == most {
            break false;
        }
        if ws.rejected.is_empty() {
            scratch.prepare_a(blocks);
        }
        scratch.greedy.remove(&scratch.a, blocks, block);
        ws.rejected.push(block);
        dof -= blocks.count(block);
    };
    let left = (d2 - scratch.greedy.reduction).max(0.0);
    ws.rejected.sort_unstable();
    Verdict::joint(ws.rejected.len(), left, dof, passed)
}

/// The block that exceeds its quantile by the largest factor, if one does.
fn worst(
    scratch: &Scratch,
    blocks: Blocks,
    level: f64,
    quantiles: &mut Quantiles,
) -> Option<usize> {
    let mut worst = (1.0, None);
    for block in 0..blocks.len() {
        if scratch.greedy.taken[block] {
            continue;
        }
        let distance = conditional_d2(scratch, blocks, block);
        let ratio = distance / quantiles.get(level, blocks.count(block));
        if ratio > worst.0 {
            worst = (ratio, Some(block));
        }
    }
    worst.1
}

/// Squared distance of a block given all others that are not left out.
fn conditional_d2(scratch: &Scratch, blocks: Blocks, block: usize) -> f64 {
    let z = &scratch.greedy.z[blocks.start(block)..][..blocks.count(block)];
    block_distance(&scratch.greedy.diagonal[block], z)
}
