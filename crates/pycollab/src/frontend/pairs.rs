//! Points of Cs and Cf that may be the same, by their descriptors.

use crate::arrays_in::{
    Argument, InRows, SinglesArgument, covariance6, mask, numbers, pose, rows, same_length,
};
use crate::arrays_out::{Column, to_rows};
use crate::errors::{bad_shape, invalid};
use crate::gate;
use ::frontend::pairs::{self, Descriptors, MatchOptions, Point, Relation};
use numpy::ndarray::{Ix2, Ix3};
use pyo3::prelude::*;

/// Points of Cs for which partners in Cf are wanted.
///
/// Parameters
/// ----------
/// rays : (N, 3) float64
///     Unit rays in C.
/// ranges : (N, 2) float64
///     Least and largest inverse range of each, 1/m.
/// known : (N,) bool
///     Points that have one descriptor, the first, whatever the depth of a pair.
/// descriptors : (D, N, K) float32
///     Made at each of the depths; unit vectors, K is a multiple of 32.
/// depths : (D,) float64
///     Inverse ranges, increasing, 1/m.
///
/// Raises
/// ------
/// InputError
///     If an argument has another type or shape.
#[pyclass(module = "collabslam._core", frozen)]
pub(crate) struct PairPoints {
    points: Vec<Point>,
    descriptors: Py<PyAny>,
    depths: Vec<f64>,
}

const DESCRIPTORS: &str = "a (D, N, K) array of float32";

#[pymethods]
impl PairPoints {
    #[new]
    fn new(
        rays: Argument<'_>,
        ranges: Argument<'_>,
        known: Argument<'_>,
        descriptors: SinglesArgument<'_>,
        depths: Argument<'_>,
    ) -> PyResult<Self> {
        let (rays, ranges) = (rows::<3>("rays", &rays)?, rows::<2>("ranges", &ranges)?);
        let (known, depths) = (mask("known", &known)?, numbers("depths", &depths)?);
        same_length("ranges", rays.len(), ranges.len())?;
        same_length("known", rays.len(), known.len())?;
        let array: InRows<'_, f32, Ix3> = InRows::new("descriptors", DESCRIPTORS, &descriptors)?;
        let length = array.shape()[2];
        if array.shape() != [depths.len(), rays.len(), length]
            || depths.is_empty()
            || !length.is_multiple_of(32)
        {
            let expected = "(D, N, a multiple of 32)";
            return Err(bad_shape("descriptors", expected, array.shape()));
        }
        let points = rays.into_iter().zip(ranges).zip(known);
        let points = points.map(|((ray, range), known)| Point {
            ray,
            range: range.into(),
            known,
        });
        Ok(Self {
            points: points.collect(),
            descriptors: descriptors.unbind(),
            depths,
        })
    }

    fn __len__(&self) -> usize {
        self.points.len()
    }
}

/// When points are partners.
///
/// Parameters
/// ----------
/// sigma : (float, float)
///     Standard deviations of a pixel of Cs and of Cf, radians.
/// gate : float
///     Radius of the gates in standard deviations.
/// ratio : float
///     Largest ratio of the best to the second best distance of descriptors.
/// max_distance : float
///     Largest distance of descriptors.
#[pyclass(module = "collabslam._core", frozen, get_all)]
pub(crate) struct PairOptions {
    sigma: (f64, f64),
    gate: f64,
    ratio: f32,
    max_distance: f32,
}

#[pymethods]
impl PairOptions {
    #[new]
    #[pyo3(signature = (*, sigma, gate, ratio, max_distance))]
    fn new(sigma: (f64, f64), gate: f64, ratio: f32, max_distance: f32) -> Self {
        Self {
            sigma,
            gate,
            ratio,
            max_distance,
        }
    }
}

/// Partners, and why other points of Cs have none.
///
/// Attributes
/// ----------
/// index_s, index_f : (K,) int64
///     Rows of the points matched.
/// alone : int
///     Points without any pair that is allowed.
/// indistinct : int
///     Points whose best partner is unlike, or hardly better than the next.
/// one_sided : int
///     Points whose best partner has a better one.
#[pyclass(module = "collabslam._core", frozen, get_all)]
pub(crate) struct PairMatches {
    index_s: Column<i64>,
    index_f: Column<i64>,
    alone: usize,
    indistinct: usize,
    one_sided: usize,
}

/// Matches points of Cs with points of Cf by their descriptors, among the pairs that the measured pose
/// allows.
///
/// Parameters
/// ----------
/// points : PairPoints
///     Of Cs.
/// rays_f : (M, 3) float64
///     Unit rays of the points of Cf, in F.
/// descriptors_f : (M, K) float32
/// t_cf : (4, 4) float64
///     Measured pose of Cf relative to Cs: maps points of F into C, metres.
/// covariance : (6, 6) float64
///     Of it, over (translation m, rotation rad), tangent on the right.
/// options : PairOptions
///
/// Returns
/// -------
/// PairMatches
///
/// Raises
/// ------
/// InputError
///     If an argument has another type or shape, or the covariance is not positive definite.
#[pyfunction]
pub(crate) fn match_pairs(
    py: Python<'_>,
    points: &PairPoints,
    rays_f: Argument<'_>,
    descriptors_f: SinglesArgument<'_>,
    t_cf: Argument<'_>,
    covariance: Argument<'_>,
    options: &PairOptions,
) -> PyResult<PairMatches> {
    let rays_f = rows::<3>("rays_f", &rays_f)?;
    let of_s: InRows<'_, f32, Ix3> =
        InRows::new("descriptors", DESCRIPTORS, points.descriptors.bind(py))?;
    let of_f: InRows<'_, f32, Ix2> =
        InRows::new("descriptors_f", "a (M, K) array of float32", &descriptors_f)?;
    let length = of_s.shape()[2];
    if of_f.shape() != [rays_f.len(), length] {
        let expected = "(M, as those of Cs)";
        return Err(bad_shape("descriptors_f", expected, of_f.shape()));
    }
    let relation = Relation {
        pose: &pose("t_cf", &t_cf)?,
        covariance: &covariance6("covariance", &covariance)?,
        sigma: options.sigma.into(),
        gate: options.gate,
    };
    let descriptors = Descriptors {
        length,
        of_s: of_s.entries(),
        depths: &points.depths,
        of_f: of_f.entries(),
    };
    let good = MatchOptions {
        ratio: options.ratio,
        max_distance: options.max_distance,
    };
    let found = gate::compute(py, || {
        pairs::match_pairs(&points.points, &rays_f, &descriptors, &relation, &good)
    });
    let found = found.ok_or_else(|| invalid("covariance", "it is not positive definite"))?;
    Ok(PairMatches {
        index_s: to_rows(py, found.pairs.iter().map(|p| p.0)),
        index_f: to_rows(py, found.pairs.iter().map(|p| p.1)),
        alone: found.alone,
        indistinct: found.indistinct,
        one_sided: found.one_sided,
    })
}
