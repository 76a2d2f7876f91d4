//! HOHCT, the highest-order hypothesis compatibility test (METHOD section 8; Guerra, Munguia, Bolea, Grau 2013).
//!
//! Order 0 is the most optimistic hypothesis: all matches are right. If `D^2 = g^T S^-1 g` exceeds the chi-square quantile,
//! hypotheses with one block left out are looked at, then two, and so on; at the first order at which one passes, the
//! one with the largest tail probability is taken.
//!
//! # What leaving out costs
//! With `A = S^-1` and `z = A g`, leaving out the blocks `E` takes
//! `f(E) = z_E^T (A_EE)^-1 z_E = max { 2 z^T x - x^T A x : x zero outside E }` off `D^2`. A change of basis within each
//! block makes its own block of `A` the identity and leaves `f` as it is; below, `A` and `z` are in that basis.
//!
//! # Exact search
//! A greedy set `G` (the best single block given those already out, until the rest passes) is the first answer. Any
//! set is `E = (G \ Y) u F` with `F` outside of `G`; it can only be better if `|Y| >= |F|`. For `|F| = 0, 1, 2, ...` a
//! depth-first search brings blocks of `G` back and adds others, in [`Search::explore`]. A node is a set `X` worked out
//! exactly: `w = A_XX^-1 z_X`, `f(X) = z_X^T w`, `q = z - A_:X w` (zero on `X`), `H = A_XX^-1`.
//!
//! *Bound.* Let `Y` in `X` be what is still brought back and `F` what is still added. Write `x = (w - d, x_F)`, so that
//! `d_Y = w_Y` and the rest of `d` is free:
//!
//! ```text
//! 2 z^T x - x^T A x = f(X) - d^T A_XX d + 2 d^T A_XF x_F + 2 q_F^T x_F - x_F^T A_FF x_F
//! 2 d^T A_XF x_F   <= theta d^T A_XX d + x_F^T P_FF x_F / theta,     P = A_:X H A_X:,  0 < theta <= 1
//! ```
//!
//! (Young's inequality; exact with `theta = 1` if `Y` is empty.) The least `d^T A_XX d` is `w_Y^T (H_YY)^-1 w_Y`, hence
//!
//! ```text
//! f(E) <= f(X) - (1 - theta) w_Y^T (H_YY)^-1 w_Y + q_F^T (M_FF)^-1 q_F,     M = A - P / theta
//! ```
//!
//! *Sums over blocks.* By Gershgorin's theorem for blocks, a symmetric matrix with diagonal blocks `D_i` is at least
//! `blkdiag(b_i D_i)`, and at most `blkdiag(B_i D_i)`, with `b_i = 1 - sum_j c_ij`, `B_i = 1 + sum_j c_ij`, where `c_ij` bounds the
//! norm of block `(i, j)` once the diagonal blocks are scaled to the identity. With the sums taken over the largest
//! `|Y| - 1` (`|F| - 1`) couplings to blocks that may still come,
//!
//! ```text
//! w_Y^T (H_YY)^-1 w_Y >= sum_Y  w_i^T H_ii^-1 w_i / B_i,         q_F^T (M_FF)^-1 q_F <= sum_F  q_i^T M_ii^-1 q_i / b_i
//! ```
//!
//! so that the worst `Y` and `F` are the smallest and the largest terms. A block with `b_i <= 0` has no bound: it is either added
//! or ruled out at once, and the couplings of the others no longer include it.
//!
//! *Blocks of different size.* A set of `k` blocks with `e` rows more than the smallest possible must reach
//! `f(E) >= D^2 - quantile(dof)`, a threshold `T_k,e`. With any `tau`, `f(E) - tau e(E) >= target_k = min_e (T_k,e - tau e)` is
//! necessary, and `tau e(E)` is a sum over blocks again. Once a set of `k` blocks is found, its tail probability gives
//! new thresholds for `k`, and larger sets are out of the question.
//!
//! *Disjoint groups.* With a large `F` the sums over couplings say nothing: no bound of that kind is good for the worst
//! `F`. But deal the blocks outside of `G` into `t + s` disjoint groups: `F`, with `t` blocks, hits at most `t` of them, so `s`
//! whole groups are kept, and `Y` with them. A part of what is kept is never farther than all of it:
//!
//! ```text
//! D^2(kept by E) >= min over s groups K, and Y in G with |Y| >= t:  D^2(K u Y)
//! ```
//!
//! Where that exceeds what the level (or the best set so far) allows, no such `E` is left; one deal into `t + 1` groups
//! serves all smaller `t` as well. In batches with many wrong matches this refutes nearly everything but small `F`, since a few
//! wrong matches cannot agree with any group of right ones.
//!
//! *Budget.* Past `max_nodes` the best set so far stands, at first the greedy one, and the verdict says that it is not
//! exact. A node counts once in a batch of ordinary size and more in a larger one, and choices of groups count by their
//! work, so that the budget bounds the work: about 0.1 ms per count.
//!
//! *Measured* on frames as in the tests (camera uncertain by 3 cm and 1 degree, wrong matches uniform in the 3-sigma
//! ellipse), medians: 0.15 ms for 3 wrong of 40, 0.55 ms for 10 of 40, 0.66 ms for 3 of 100, 1.6 ms for 10 of 100; if
//! all pass, 3 us for 40 and 25 us for 100.

use super::batch::{Blocks, Verdict, check};
use super::distance::whiten;
use super::subsets::pigeonhole::Rows;
use super::subsets::search::Search;
use super::workspace::Workspace;
use crate::settings::ValidateSettings;

/// Largest share of a frame's matches that HOHCT and the conditional gate may each leave out.
pub(crate) const MAX_SHARE: f64 = 0.5;

/// Settings of [`hohct`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HohctSettings {
    /// Confidence level of the joint test, in (0, 1).
    pub level: f64,
    /// Bound on the hypotheses worked out, see the module's page; past it the best so far, or the greedy one, stands.
    pub max_nodes: usize,
    /// Largest share of the blocks that may be left out, in [0, 1]. One block always stays.
    pub max_share: f64,
}

impl Default for HohctSettings {
    fn default() -> Self {
        let ValidateSettings {
            level, max_nodes, ..
        } = ValidateSettings::default();
        Self {
            level,
            max_nodes,
            max_share: MAX_SHARE,
        }
    }
}

/// Leaves out the fewest blocks so that the rest is jointly compatible at `settings.level`.
///
/// `s` is `S`, `l` its Cholesky factor (both lower triangle, column-major, leading dimension `ld`), `g` the innovation. If all blocks
/// pass together this costs one triangular solve; `S^-1` is only formed if they do not.
pub fn hohct(
    s: &[f64],
    l: &[f64],
    ld: usize,
    g: &[f64],
    blocks: Blocks,
    settings: &HohctSettings,
    ws: &mut Workspace,
) -> Verdict {
    check(s, ld, g, blocks);
    check(l, ld, g, blocks);
    let (m, n) = (g.len(), blocks.len());
    ws.rejected.clear();
    let d2 = whiten(l, ld, g, &mut ws.whitened);
    if d2 <= ws.quantiles.get(settings.level, m) {
        return Verdict::joint(0, d2, m, true);
    }
    if !d2.is_finite() {
        ws.reject_all(blocks);
        return Verdict::joint(n, d2, m, false);
    }
    let max_order = ((settings.max_share * n as f64) as usize).min(n - 1);
    let scratch = &mut ws.hohct;
    scratch.prepare_z(l, ld, &ws.whitened, blocks);
    scratch.prepare_a(blocks);
    let greedy_passes =
        scratch.leave_out_greedily(blocks, d2, max_order, settings.level, &mut ws.quantiles);
    let mut search = Search::new(scratch, Rows { s, ld, g, blocks }, d2, settings.max_nodes);
    search.run(max_order, greedy_passes, settings.level, &mut ws.quantiles);
    let (nodes, exact, found) = (search.nodes, !search.struck, search.best.found);
    let scratch = &mut ws.hohct;
    let mut verdict = match found {
        Some(reduction) => {
            ws.rejected.extend_from_slice(&scratch.best);
            ws.rejected.sort_unstable();
            let gone: usize = scratch.best.iter().map(|&block| blocks.count(block)).sum();
            Verdict::joint(
                scratch.best.len(),
                (d2 - reduction).max(0.0),
                m - gone,
                true,
            )
        }
        None => {
            ws.reject_all(blocks);
            Verdict::joint(n, d2, m, false)
        }
    };
    verdict.exact = exact;
    verdict.nodes = nodes;
    verdict
}
