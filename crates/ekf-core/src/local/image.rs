//! The outside set in a snapshot: as it is, not assembled into a whole state, which would round.

use super::outside_set::{Auxiliary, OutsideFeature, OutsideSet};
use super::renewal::Renewal;
use crate::error::EkfError;
use crate::state::{State, StateImage};
use nalgebra::Vector3;
use serde::{Deserialize, Serialize};
use std::sync::Arc;

#[derive(Serialize, Deserialize)]
pub(crate) struct OutsideSetImage {
    then: StateImage,
    /// Id and last point of each feature outside.
    outside: Vec<(u64, [f64; 3])>,
    age: usize,
    columns: Vec<usize>,
    /// `R`, a row for each auxiliary row, column-major.
    r: Vec<f64>,
    reference: Vec<usize>,
    renewal: Option<RenewalImage>,
}

/// What is left to be written; those rows of `then` and columns of `r` are zeros.
#[derive(Serialize, Deserialize)]
struct RenewalImage {
    before: StateImage,
    inside: usize,
    rows: Vec<usize>,
    done: usize,
    depth: usize,
    r: Vec<f64>,
    phi: Vec<f64>,
    psi: Vec<f64>,
}

impl RenewalImage {
    fn of(renewal: &Renewal) -> Self {
        let Renewal {
            before,
            inside,
            rows,
            done,
            depth,
            r,
            phi,
            psi,
        } = renewal;
        Self {
            before: before.image(),
            inside: *inside,
            rows: rows.clone(),
            done: *done,
            depth: *depth,
            r: r.clone(),
            phi: phi.clone(),
            psi: psi.clone(),
        }
    }

    /// The renewal of a `then` of `n` stored rows, if there can be such a one.
    fn renewal(self, n: usize) -> Result<Option<Renewal>, EkfError> {
        let Self {
            before,
            inside,
            rows,
            done,
            depth,
            r,
            phi,
            psi,
        } = self;
        let before = State::from_image(&before)?;
        let increasing = rows.windows(2).all(|w| w[0] < w[1]);
        let within = rows.last().is_some_and(|&row| row < before.p.stored().n);
        let sized = depth > 0
            && inside.checked_add(rows.len()) == Some(n)
            && rows.len().checked_mul(depth) == Some(r.len())
            && inside.checked_mul(depth) == Some(phi.len())
            && depth.checked_mul(depth) == Some(psi.len());
        let finite = r.iter().chain(&phi).chain(&psi).all(|v| v.is_finite());
        if !(increasing && within && sized && finite && done < rows.len()) {
            return Ok(None);
        }
        Ok(Some(Renewal {
            before: Arc::new(before),
            inside,
            rows,
            done,
            depth,
            r,
            phi,
            psi,
        }))
    }
}

impl OutsideSet {
    pub(crate) fn image(&self, working: &State) -> OutsideSetImage {
        let Self {
            then,
            features,
            age,
            column: _, // the inverse of `columns`
            columns,
            r,
            ld,
            reference,
            renewal,
            clear_at: _, // saves looking again
        } = self;
        let depth = Auxiliary::of(working).rows.len();
        let renewal = renewal.as_ref().filter(|renewal| !renewal.is_done());
        let lacks = |row: usize| renewal.is_some_and(|renewal| renewal.lacks(row));
        let mut then = then.image();
        if let Some(renewal) = renewal {
            then.clear_from(renewal.inside + renewal.done);
        }
        let mut used = Vec::with_capacity(depth * columns.len());
        for (column, &row) in r.chunks_exact(*ld).zip(columns) {
            let at = used.len();
            used.extend_from_slice(&column[..depth]);
            if lacks(row) {
                used[at..at + reference.len()].fill(0.0);
            }
        }
        let outside = features.iter().map(|o| (o.block.id, o.last_point.into()));
        OutsideSetImage {
            then,
            outside: outside.collect(),
            age: *age,
            columns: columns.clone(),
            r: used,
            reference: reference.clone(),
            renewal: renewal.map(RenewalImage::of),
        }
    }

    pub(crate) fn from_image(image: OutsideSetImage, working: &State) -> Result<Self, EkfError> {
        let wrong = || EkfError::bad_snapshot("what is outside of its working set is impossible");
        let depth = Auxiliary::of(working).rows.len();
        let then = State::from_image(&image.then)?;
        let n = then.p.stored().n;
        let increasing = image.columns.windows(2).all(|w| w[0] < w[1]);
        let within = image.columns.last().is_none_or(|&row| row < n);
        let entries = image.columns.len().checked_mul(depth);
        let finite = image.r.iter().all(|v| v.is_finite());
        let renewal = match image.renewal {
            Some(renewal) => Some(renewal.renewal(n)?.ok_or_else(wrong)?),
            None => None,
        };
        let inside = renewal.as_ref().map_or(n, |renewal| renewal.inside);
        let reference = image.reference;
        let chosen = (1..=depth).contains(&reference.len())
            && reference.windows(2).all(|w| w[0] < w[1])
            && reference.last().is_some_and(|&row| row < inside);
        if !(increasing && within && finite && chosen && entries == Some(image.r.len())) {
            return Err(wrong());
        }
        let mut column = vec![None; n];
        for (k, &row) in image.columns.iter().enumerate() {
            column[row] = Some(k);
        }
        let mut outside: Vec<OutsideFeature> = Vec::with_capacity(image.outside.len());
        for (id, last_point) in image.outside {
            let block = then.layout.find(id).copied().ok_or_else(wrong)?;
            let has_columns = block.range().all(|i| column[then.p.slot(i)].is_some());
            let in_order = outside.last().is_none_or(|before| before.block.id < id);
            if !block.kind.is_feature() || !has_columns || !in_order {
                return Err(wrong());
            }
            let last_point = Vector3::from(last_point);
            outside.push(OutsideFeature { block, last_point });
        }
        let ld = 2 * depth;
        let mut r = vec![0.0; ld * image.columns.len()];
        for (to, from) in r.chunks_exact_mut(ld).zip(image.r.chunks_exact(depth)) {
            to[..depth].copy_from_slice(from);
        }
        Ok(Self {
            then: Arc::new(then),
            features: outside,
            age: image.age,
            column,
            columns: image.columns,
            r,
            ld,
            reference,
            renewal,
            clear_at: None,
        })
    }
}
