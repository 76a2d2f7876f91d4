//! Joint compatibility branch and bound (Neira and Tardos, IEEE T-RA 2001), to compare HOHCT with.
//!
//! Each block has one candidate match or none. The interpretation tree decides block by block, the most plausible first;
//! a branch is followed while its matches are jointly compatible (`g_A^T S_AA^-1 g_A` within the chi-square quantile at
//! the level) and while it can still beat the best. The answer is a largest jointly compatible set; among equals the
//! first one found. The tree is exponential in the number of wrong matches: past the node budget the best set so far stands
//! and the verdict says so.

use super::batch::{Blocks, Verdict, check};
use super::distance::individual_distance;
use super::workspace::{JcbbScratch, Workspace};
use crate::settings::ValidateSettings;

/// Settings of [`jcbb`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct JcbbSettings {
    /// Confidence level of the individual and the joint test, in (0, 1).
    pub level: f64,
    /// Largest number of nodes of the interpretation tree that are visited.
    pub max_nodes: usize,
}

impl Default for JcbbSettings {
    fn default() -> Self {
        let ValidateSettings {
            level, max_nodes, ..
        } = ValidateSettings::default();
        Self { level, max_nodes }
    }
}

/// Largest jointly compatible set of blocks; `s` is `S` (lower triangle, column-major).
pub fn jcbb(
    s: &[f64],
    ld: usize,
    g: &[f64],
    blocks: Blocks,
    settings: &JcbbSettings,
    ws: &mut Workspace,
) -> Verdict {
    check(s, ld, g, blocks);
    let Workspace {
        rejected,
        quantiles,
        joint,
        jcbb: scratch,
        ..
    } = ws;
    let JcbbScratch {
        distance,
        order,
        branch,
        best,
    } = scratch;
    let n = blocks.len();
    distance.clear();
    distance.extend((0..n).map(|block| individual_distance(s, ld, g, blocks, block)));
    order.clear();
    order
        .extend((0..n).filter(|&block| {
            distance[block] <= quantiles.get(settings.level, blocks.count(block))
        }));
    order.sort_unstable_by(|&a, &b| distance[a].total_cmp(&distance[b]).then(a.cmp(&b)));

    joint.clear();
    branch.clear();
    best.clear();
    let mut nodes = 0;
    let mut exact = true;
    let mut next = 0;
    loop {
        // Down: take each block that fits, skip each that does not.
        while next < order.len() && branch.len() + (order.len() - next) > best.len() {
            if nodes == settings.max_nodes {
                exact = false;
                break;
            }
            nodes += 1;
            let rows = joint.len();
            joint.push(s, ld, g, blocks, order[next]);
            if joint.d2() <= quantiles.get(settings.level, joint.len()) {
                branch.push(next);
            } else {
                joint.truncate(rows);
            }
            next += 1;
        }
        if branch.len() > best.len() {
            best.clone_from(branch);
        }
        if !exact {
            break;
        }
        // Back: leave out the last block taken, and go on after it.
        let Some(last) = branch.pop() else { break };
        joint.truncate(joint.len() - blocks.count(order[last]));
        next = last + 1;
    }

    joint.clear();
    for &position in best.iter() {
        joint.push(s, ld, g, blocks, order[position]);
    }
    rejected.clear();
    rejected.extend(0..n);
    rejected.retain(|block| !best.iter().any(|&position| order[position] == *block));
    let mut verdict = Verdict::joint(
        rejected.len(),
        joint.d2(),
        joint.len(),
        !best.is_empty() || n == 0,
    );
    verdict.exact = exact;
    verdict.nodes = nodes;
    verdict
}
