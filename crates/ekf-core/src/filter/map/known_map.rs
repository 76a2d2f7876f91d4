//! A map taken out of a filter, and a filter that starts in a map: landmarks with their joint covariance.
//!
//! Landmarks are handed over as they are in the state, inverse depth with its anchor, so that nothing of the first
//! run's uncertainty is lost or added: their marginal of P, and the covariance of the map's place in W.

use crate::error::EkfError;
use crate::filter::ekf::Filter;
use crate::filter::memory::record::FeatureRecord;
use crate::map_frame::MapFrame;
use crate::observe::{FEATURE_DIM as DIM, FeatureState};
use crate::state::{BlockKind, CAMERA_DIM, Covariance, State};
use nalgebra::{DMatrix, Matrix6, Vector6};
use std::collections::HashMap;

/// Numbers of its anchor, which come first.
const ANCHOR: usize = 3;

/// How far below zero an eigenvalue of the scaled covariance may be by rounding.
const ROUNDING: f64 = 1e-9;

/// Standard deviation of the attitude of a camera that has not found itself in the map, radians.
const ANY_ATTITUDE: f64 = 1.0;

/// Landmarks and their joint covariance.
#[derive(Clone, Debug)]
pub struct KnownMap {
    /// `[p(3) theta phi rho]` of each in W, metres, radians, 1/m.
    pub landmarks: Vec<Vector6<f64>>,
    /// `6 N x 6 N`, in their order.
    pub covariance: DMatrix<f64>,
    /// Covariance of the map's place in W, (translation, rotation) of W, m^2 and rad^2.
    pub place: Matrix6<f64>,
}

impl Filter {
    /// The map, and the ids of its landmarks. Features with `rho <= 0` have no point and are left out.
    pub fn known_map(&self) -> (Vec<u64>, KnownMap) {
        let state = self.state();
        let blocks = state.layout.features();
        let blocks: Vec<_> = blocks.filter(|b| state.feature(b).scale() > 0.0).collect();
        let rows: Vec<usize> = blocks.iter().flat_map(|b| b.range()).collect();
        let map = KnownMap {
            landmarks: blocks.iter().map(|b| state.feature(b).0).collect(),
            covariance: DMatrix::from_fn(rows.len(), rows.len(), |i, j| {
                state.p.get(rows[i], rows[j])
            }),
            place: self.memory.map_frame.0,
        };
        (blocks.iter().map(|b| b.id).collect(), map)
    }

    /// Starts in a map, not knowing where the camera is: [`Self::relocalise`] is to follow. Returns the landmarks' ids.
    ///
    /// Until then the pose is the origin of W, with a covariance as wide as the map.
    ///
    /// # Errors
    /// `BadShape`, `NonFinite`, `InvalidInput` (an empty map, a landmark with `rho <= 0`, a covariance that is none, a
    /// filter that has started); the filter stays as it was.
    pub fn start_from_map(&mut self, map: &KnownMap) -> Result<Vec<u64>, EkfError> {
        self.start_from_map_after(map, 0)
    }

    /// As [`Self::start_from_map`], with ids from `first` on.
    pub(crate) fn start_from_map_after(
        &mut self,
        map: &KnownMap,
        first: u64,
    ) -> Result<Vec<u64>, EkfError> {
        self.check_map(map)?;
        self.changes();
        let (slots, rows) = shared_rows(map);
        let capacity =
            CAMERA_DIM + DIM * self.setup.settings.map.max_features.max(slots.len()) + 64;
        let n = CAMERA_DIM + rows.len();
        let origin = State::at_origin(0);
        let mut state = origin.camera_alone(Covariance::of_stored(n, capacity, None));
        state.layout.set_next_id(first);
        for (j, &column) in rows.iter().enumerate() {
            for (i, &row) in rows.iter().enumerate().skip(j) {
                let value = (map.covariance[(row, column)] + map.covariance[(column, row)]) * 0.5;
                state.p.set_stored(CAMERA_DIM + i, CAMERA_DIM + j, value);
            }
        }
        let record = FeatureRecord {
            last_found: self.memory.time.unwrap_or(0.0),
            ..FeatureRecord::default()
        };
        let kind = BlockKind::Feature;
        let landmarks = map.landmarks.iter().zip(&slots);
        let ids: Vec<u64> = landmarks
            .map(|(mean, slots)| state.push_stored(kind, slots, mean.as_slice()))
            .collect();
        let points = map.landmarks.iter().map(|y| FeatureState(*y).point());
        let far = points.flatten().map(|p| p.norm()).fold(1.0, f64::max);
        for i in 0..3 {
            state.p.set(i, i, far * far);
            // At the identity a small rotation w is the quaternion (1, w / 2).
            state.p.set(4 + i, 4 + i, (ANY_ATTITUDE / 2.0).powi(2));
        }
        if let Some(readout) = self.setup.settings.calibration.readout() {
            state.append_readout(readout);
        }
        for clock in (0..).map_while(|who| self.worn_clock(who)) {
            state.append_worn_clock(clock);
        }
        self.memory.records = ids.iter().map(|&id| (id, record.clone())).collect();
        self.memory.state = state;
        self.memory.map_frame = MapFrame(map.place);
        self.memory.map_transfer.known = self.memory.state.layout.next_id();
        self.start();
        Ok(ids)
    }

    fn check_map(&self, map: &KnownMap) -> Result<(), EkfError> {
        let invalid = |what, why: &str| {
            let why = why.into();
            Err(EkfError::InvalidInput { what, why })
        };
        if self.memory.started || self.map_size() > 0 {
            return invalid("start", "the filter has started already; make a new one");
        }
        let n = DIM * map.landmarks.len();
        if map.covariance.shape() != (n, n) {
            return Err(EkfError::BadShape {
                what: "covariance of the map",
                expected: format!("({n}, {n}), six rows a landmark"),
                got: format!("{:?}", map.covariance.shape()),
            });
        }
        let numbers = map.landmarks.iter().flat_map(|y| y.iter());
        let mut numbers = numbers.chain(map.covariance.iter()).chain(map.place.iter());
        if !numbers.all(|x| x.is_finite()) {
            return Err(EkfError::NonFinite {
                what: "the map or its covariance",
            });
        }
        if map.landmarks.is_empty() || map.landmarks.iter().any(|y| y[5] <= 0.0) {
            let why = "there must be at least one landmark, each with an inverse depth above zero";
            return invalid("map", why);
        }
        let place = DMatrix::from_column_slice(6, 6, map.place.as_slice());
        if !is_sound(&map.covariance) || !is_sound(&place) {
            let why = "it is not symmetric positive semi-definite";
            return invalid("covariance of the map", why);
        }
        Ok(())
    }
}

/// Rows of the map's covariance that are to be stored, and where each landmark's six are among P's: landmarks with the same
/// anchor, their rows of the covariance included, share it as in the filter that they come from.
fn shared_rows(map: &KnownMap) -> (Vec<[usize; DIM]>, Vec<usize>) {
    let p = &map.covariance;
    let mut rows = Vec::new();
    let mut slots: Vec<[usize; DIM]> = Vec::new();
    let mut first: HashMap<[u64; ANCHOR], usize> = HashMap::new();
    for (k, mean) in map.landmarks.iter().enumerate() {
        let key = std::array::from_fn(|i| mean[i].to_bits());
        let sharer = *first.entry(key).or_insert(k);
        let same =
            sharer < k && (0..ANCHOR).all(|i| p.column(DIM * sharer + i) == p.column(DIM * k + i));
        slots.push(std::array::from_fn(|i| {
            if same && i < ANCHOR {
                return slots[sharer][i];
            }
            rows.push(DIM * k + i);
            CAMERA_DIM + rows.len() - 1
        }));
    }
    (slots, rows)
}

/// Whether a finite matrix is symmetric and positive semi-definite up to rounding.
fn is_sound(p: &DMatrix<f64>) -> bool {
    let n = p.nrows();
    let sd: Vec<f64> = p.diagonal().iter().map(|d| d.sqrt()).collect();
    if sd.iter().any(|s| s.is_nan()) {
        return false;
    }
    let over = |i: usize, j: usize| {
        if sd[i] * sd[j] > 0.0 {
            p[(i, j)] / (sd[i] * sd[j])
        } else {
            p[(i, j)]
        }
    };
    let symmetric = (0..n).all(|j| (0..j).all(|i| (over(i, j) - over(j, i)).abs() <= ROUNDING));
    let rounding = ROUNDING * n as f64;
    let scaled = DMatrix::from_fn(n, n, |i, j| {
        over(i, j) + if i == j { rounding } else { 0.0 }
    });
    symmetric && scaled.cholesky().is_some()
}
