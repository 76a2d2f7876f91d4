//! The outside set in a snapshot: as it is, not assembled into a whole state, which would round.

use super::outside_set::{Auxiliary, OutsideFeature, OutsideSet};
use crate::error::EkfError;
use crate::state::{State, StateImage};
use nalgebra::Vector3;
use serde::{Deserialize, Serialize};

#[derive(Serialize, Deserialize)]
pub(crate) struct OutsideSetImage {
    then: StateImage,
    /// Id and last point of each feature outside.
    outside: Vec<(u64, [f64; 3])>,
    age: usize,
    columns: Vec<usize>,
    /// `R`, a row for each auxiliary row, column-major.
    r: Vec<f64>,
    first: usize,
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
            first,
            clear_at: _, // saves looking again
        } = self;
        let depth = Auxiliary::of(working).rows.len();
        let outside = features.iter().map(|o| (o.block.id, o.last_point.into()));
        OutsideSetImage {
            then: then.image(),
            outside: outside.collect(),
            age: *age,
            columns: columns.clone(),
            r: r.chunks_exact(*ld)
                .flat_map(|c| &c[..depth])
                .copied()
                .collect(),
            first: *first,
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
        let sized = depth > 0 && (1..=depth).contains(&image.first);
        if !(increasing && within && finite && sized && entries == Some(image.r.len())) {
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
            then,
            features: outside,
            age: image.age,
            column,
            columns: image.columns,
            r,
            ld,
            first: image.first,
            clear_at: None,
        })
    }
}
