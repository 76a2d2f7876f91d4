//! What must hold for a filter at any time.

use crate::Broken;
use ekf_core::Filter;
use ekf_core::state::{BlockKind, CAMERA_DIM};

/// METHOD 3: the least eigenvalue of P's diagonal-scaled form lies above minus this.
const LEAST_EIGENVALUE: f64 = 1e-10;

/// The state's bits, folded: equal before and after a call that failed.
pub(crate) fn fingerprint(filter: &Filter) -> u64 {
    let state = filter.state();
    let p = state.covariance();
    let mut hash = 0xcbf2_9ce4_8422_2325_u64 ^ filter.candidate_count() as u64;
    let mut fold =
        |x: f64| hash = (hash.rotate_left(5) ^ x.to_bits()).wrapping_mul(0x9e37_79b9_7f4a_7c15);
    state.mean().iter().for_each(|&x| fold(x));
    for j in 0..p.dim() {
        (j..p.dim()).for_each(|i| fold(p.get(i, j)));
    }
    fold(filter.time().unwrap_or(-1.0));
    fold(f64::from(u8::from(filter.started())));
    hash
}

/// Dimensions, ids and finiteness: cheap, for after every call.
pub(crate) fn check_state(filter: &Filter) -> Result<(), Broken> {
    let state = filter.state();
    let (x, p, layout) = (state.mean(), state.covariance(), state.layout());
    let blocks = layout.blocks();
    let dim = CAMERA_DIM + blocks.iter().map(|b| b.kind.dim()).sum::<usize>();
    if x.len() != dim || p.dim() != dim || layout.dim() != dim {
        return Err(format!("dimensions {} {} {dim}", x.len(), p.dim()));
    }
    if blocks.windows(2).any(|w| w[0].id >= w[1].id) {
        return Err("ids do not increase".into());
    }
    if blocks
        .iter()
        .any(|b| matches!(b.kind, BlockKind::WornError(_) | BlockKind::Auxiliary(_)))
    {
        return Err("a block of one frame is left over".into());
    }
    if layout.features().count() != filter.map_size() {
        return Err("map_size is not the number of features".into());
    }
    if let Some(i) = x.iter().position(|v| !v.is_finite()) {
        return Err(format!("mean[{i}] is {}", x[i]));
    }
    let q: f64 = x[3..7].iter().map(|v| v * v).sum();
    if (q - 1.0).abs() > 3e-9 {
        return Err(format!("|q|^2 is {q}"));
    }
    for i in 0..dim {
        let variance = p.get(i, i);
        if !variance.is_finite() {
            return Err(format!("P[{i}, {i}] is {variance}"));
        }
    }
    Ok(())
}

/// All that [`check_state`] checks, P's soundness, and that all that can be read is finite.
///
/// # Errors
/// Which of them does not hold.
pub fn check_filter(filter: &Filter) -> Result<(), Broken> {
    check_state(filter)?;
    check_covariance(filter)?;
    for f in filter.predict_pixels() {
        let numbers = f.uv.iter().chain(f.s.iter()).chain(f.point.iter());
        if !numbers.chain([&f.rho, &f.rho_sd]).all(|v| v.is_finite()) {
            return Err(format!("a predicted pixel is not finite: {f:?}"));
        }
        if f.s.determinant() <= 0.0 {
            return Err(format!("S of a predicted pixel is not positive: {:?}", f.s));
        }
    }
    for l in filter.landmarks() {
        if !l
            .point
            .iter()
            .chain(l.covariance.iter())
            .chain([&l.rho_ratio])
            .all(|v| v.is_finite())
        {
            return Err(format!("a landmark is not finite: {l:?}"));
        }
    }
    if !filter.pose_covariance().iter().all(|v| v.is_finite()) {
        return Err("the pose's covariance is not finite".into());
    }
    Ok(())
}

/// Cholesky of the diagonal-scaled form, its diagonal raised by the tolerance: it fails where the least eigenvalue
/// lies below minus the tolerance. A sixth of what the eigenvalues cost.
fn check_covariance(filter: &Filter) -> Result<(), Broken> {
    let p = filter.state().covariance();
    let n = p.dim();
    let scale: Vec<f64> = (0..n).map(|i| p.get(i, i).max(0.0).sqrt()).collect();
    let mut l = vec![0.0; n * n];
    for j in 0..n {
        for i in j..n {
            let value = p.get(i, j);
            if !value.is_finite() {
                return Err(format!("P[{i}, {j}] is {value}"));
            }
            let by = scale[i] * scale[j];
            l[i + j * n] = if by > 0.0 { value / by } else { value };
        }
        l[j + j * n] += LEAST_EIGENVALUE;
    }
    for j in 0..n {
        for k in 0..j {
            let factor = l[j + k * n];
            if factor != 0.0 {
                for i in j..n {
                    l[i + j * n] -= l[i + k * n] * factor;
                }
            }
        }
        let pivot = l[j + j * n];
        if pivot <= 0.0 {
            let least = p.least_scaled_eigenvalue();
            return Err(format!(
                "P is unsound: pivot {pivot:e} in row {j}, least eigenvalue {least:e}"
            ));
        }
        let root = pivot.sqrt();
        (j..n).for_each(|i| l[i + j * n] /= root);
    }
    Ok(())
}
