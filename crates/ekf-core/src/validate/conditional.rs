//! The conditional gate: each match against what all the other accepted matches say.

use super::{Quantiles, Units, Verdict, Workspace, block_distance, check};
use crate::validate::hohct::Scratch;

/// Leaves out, the worst first, every unit that the others contradict: whose distance given all of them,
/// `z_i^T (A_ii)^-1 z_i` with `A = S^-1` and `z = A g`, exceeds the chi-square quantile at `level`.
///
/// A joint test at the degrees of freedom of a whole batch does not see one wrong match among many that fit better
/// than their noise says: its distance drowns in theirs. Given the others, its distance is its own.
///
/// `l` is the Cholesky factor of `S` (lower triangle, column-major, leading dimension `ld`), `g` the innovation. At most
/// `max_share` of the units are left out; the verdict says whether the rest passed. Without an offender this costs the
/// inverse of `l`. [`Workspace::given_others`] has the distances.
pub fn conditional_gate(
    l: &[f64],
    ld: usize,
    g: &[f64],
    units: Units,
    level: f64,
    max_share: f64,
    ws: &mut Workspace,
) -> Verdict {
    check(l, ld, g, units);
    let n = units.len();
    ws.rejected.clear();
    ws.given_others.clear();
    if units.is_empty() {
        return Verdict::joint(0, 0.0, 0, true);
    }
    let d2 = super::whiten(l, ld, g, &mut ws.whitened);
    let most = (max_share * n as f64) as usize;
    let scratch = &mut ws.hohct;
    scratch.prepare_z(l, ld, &ws.whitened, units);
    scratch.greedy.start(&scratch.z, units);
    let mut dof = g.len();
    let passed = loop {
        let Some(unit) = worst(scratch, units, level, &mut ws.quantiles) else {
            break true;
        };
        if ws.rejected.len() == most {
            break false;
        }
        if ws.rejected.is_empty() {
            scratch.prepare_a(units);
        }
        scratch.greedy.remove(&scratch.a, units, unit);
        ws.rejected.push(unit);
        dof -= units.count(unit);
    };
    let scratch = &ws.hohct;
    ws.given_others.extend((0..n).map(|unit| {
        if scratch.greedy.taken[unit] {
            f64::INFINITY
        } else {
            given_others(scratch, units, unit)
        }
    }));
    ws.rejected.sort_unstable();
    let left = (d2 - scratch.greedy.reduction).max(0.0);
    Verdict::joint(ws.rejected.len(), left, dof, passed)
}

/// The unit that exceeds its quantile by the largest factor, if one does.
fn worst(scratch: &Scratch, units: Units, level: f64, quantiles: &mut Quantiles) -> Option<usize> {
    let mut worst = (1.0, None);
    for unit in 0..units.len() {
        if scratch.greedy.taken[unit] {
            continue;
        }
        let distance = given_others(scratch, units, unit);
        let ratio = distance / quantiles.get(level, units.count(unit));
        if ratio > worst.0 {
            worst = (ratio, Some(unit));
        }
    }
    worst.1
}

/// Squared distance of a unit given all others that are not left out.
fn given_others(scratch: &Scratch, units: Units, unit: usize) -> f64 {
    let z = &scratch.greedy.z[units.start(unit)..][..units.count(unit)];
    block_distance(&scratch.greedy.blocks[unit], z)
}
