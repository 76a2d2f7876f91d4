//! Inner loops of the front end: the binding of the crate `frontend`.

use crate::camera::PyCamera;
use crate::convert::{
    Argument, covariance6, invalid, numbers, pixels, pose, rows, same_length, stack, stacked,
    to_matrix, to_pose, vectors,
};
use crate::errors::bad_shape;
use ::frontend::consensus::{self, Noise, Pair};
use ::frontend::describe::{LENGTH, describe};
use ::frontend::search::{Expected, Options, search};
use ::frontend::{Image, warp};
use nalgebra::{Matrix2, Vector2};
use numpy::{PyArray1, PyArray2, PyArray3, PyArrayMethods, PyReadonlyArray2, PyReadonlyArray3};
use pyo3::prelude::*;
use std::borrow::Cow;

type Uv<'py> = Bound<'py, PyArray2<f64>>;
type Column<'py, T> = Bound<'py, PyArray1<T>>;

/// Pixels in row order, copied only if they are not.
macro_rules! in_order {
    ($array:expr) => {
        match $array.as_slice() {
            Ok(slice) => Cow::Borrowed(slice),
            Err(_) => Cow::Owned($array.as_array().iter().copied().collect::<Vec<u8>>()),
        }
    };
}

fn grey<'py>(what: &'static str, value: &Argument<'py>) -> PyResult<PyReadonlyArray2<'py, u8>> {
    value
        .extract()
        .map_err(|_| invalid(what, "a (H, W) array of uint8 is needed".into()))
}

fn image<'a>(pixels: &'a [u8], shape: &[usize]) -> PyResult<Image<'a>> {
    Image::new(pixels, shape[1], shape[0])
        .ok_or_else(|| bad_shape("image", "(H, W), not empty", shape))
}

fn odd_side(what: &'static str, side: usize) -> PyResult<()> {
    if side % 2 == 1 && side >= 3 {
        return Ok(());
    }
    Err(invalid(
        what,
        format!("a template's side must be odd and at least 3, it is {side}"),
    ))
}

/// Looks for each template inside the ellipse of its predicted pixel, by zero-normalised cross-correlation.
///
/// Parameters
/// ----------
/// image : (H, W) uint8
/// templates : (N, h, h) uint8
///     Side h odd.
/// uv : (N, 2) float64
///     Predicted pixels; NaN where there is none.
/// s : (N, 2, 2) float64
///     Covariance of each, pixel noise included, px^2.
/// guess : (N, 2) float64
///     Where something else says that the point is; NaN where it does not say.
/// gate, min_radius, large_radius, max_radius, guess_radius, guess_gate, min_score, ambiguity, peak_distance : float
///     The settings ``search.*``.
/// min_deviation : float
///     The setting ``patch.min_deviation``.
///
/// Returns
/// -------
/// uv : (N, 2) float64
///     Sub-pixel position of the best peak; NaN where there is none.
/// score, second : (N,) float64
///     Correlation of the best peak and of the next best one; -1 where there is none.
/// code : (N,) int64
///     0 found, 1 score too low, 2 ambiguous, 3 outside of the image.
///
/// Raises
/// ------
/// InputError
///     If an argument has another type or shape.
#[pyfunction]
#[pyo3(signature = (image, templates, uv, s, guess, *, gate, min_radius, large_radius, max_radius, guess_radius,
    guess_gate, min_score, ambiguity, peak_distance, min_deviation))]
#[expect(clippy::too_many_arguments, reason = "keywords in Python")]
pub(crate) fn search_templates<'py>(
    py: Python<'py>,
    image: Argument<'py>,
    templates: Argument<'py>,
    uv: Argument<'py>,
    s: Argument<'py>,
    guess: Argument<'py>,
    gate: f64,
    min_radius: f64,
    large_radius: f64,
    max_radius: f64,
    guess_radius: f64,
    guess_gate: f64,
    min_score: f64,
    ambiguity: f64,
    peak_distance: f64,
    min_deviation: f64,
) -> PyResult<(
    Uv<'py>,
    Column<'py, f64>,
    Column<'py, f64>,
    Column<'py, i64>,
)> {
    let options = Options {
        gate,
        min_radius,
        large_radius,
        max_radius,
        guess_radius,
        guess_gate,
        min_score,
        ambiguity,
        peak_distance,
        min_deviation,
    };
    let grey = grey("image", &image)?;
    let windows: PyReadonlyArray3<'_, u8> = templates
        .extract()
        .map_err(|_| invalid("templates", "an (N, h, h) array of uint8 is needed".into()))?;
    let shape = windows.as_array().raw_dim();
    let (count, side) = (shape[0], shape[1]);
    if shape[2] != side {
        return Err(bad_shape(
            "templates",
            "(N, h, h)",
            &[count, side, shape[2]],
        ));
    }
    odd_side("templates", side)?;
    let (uv, s, guess) = (
        pixels("uv", &uv)?,
        stack::<2, 2>("s", &s)?,
        pixels("guess", &guess)?,
    );
    same_length("uv", count, uv.len())?;
    same_length("s", count, s.len())?;
    same_length("guess", count, guess.len())?;
    let expected: Vec<Expected> = uv
        .into_iter()
        .zip(s)
        .zip(guess)
        .map(|((uv, s), guess)| Expected { uv, s, guess })
        .collect();
    let (pixels, windows) = (in_order!(grey), in_order!(windows));
    let view = self::image(&pixels, grey.as_array().shape())?;
    let found = py.detach(|| search(&view, &windows, side, &expected, &options));
    Ok((
        vectors(py, found.iter().map(|f| f.uv), count),
        PyArray1::from_iter(py, found.iter().map(|f| f.score)),
        PyArray1::from_iter(py, found.iter().map(|f| f.second)),
        PyArray1::from_iter(py, found.iter().map(|f| f.outcome as i64)),
    ))
}

/// Predicted pixel of patches in another view, and the affine map of pixel offsets into it.
///
/// Parameters
/// ----------
/// camera_ref, camera_now : Camera
/// uv_ref : (N, 2) float64
///     Points in the reference image.
/// t_now_ref : (N, 4, 4) float64
///     Each maps points of its reference camera into the camera now.
/// inverse_range : (N,) float64
///     Inverse distance of each landmark from its reference camera, 1/m; NaN or 0: infinitely far.
///
/// Returns
/// -------
/// uv : (N, 2) float64
///     Predicted pixel; NaN where the landmark is not in front of the camera.
/// affine : (N, 2, 2) float64
///     ``offset_now = affine @ offset_ref``; the identity where there is none.
/// ok : (N,) bool
///     Whether there is one that keeps its orientation.
///
/// Raises
/// ------
/// InputError
///     If an argument has another type or shape.
#[pyfunction]
pub(crate) fn affine_maps<'py>(
    py: Python<'py>,
    camera_ref: &PyCamera,
    uv_ref: Argument<'py>,
    camera_now: &PyCamera,
    t_now_ref: Argument<'py>,
    inverse_range: Argument<'py>,
) -> PyResult<(Uv<'py>, Bound<'py, PyArray3<f64>>, Column<'py, bool>)> {
    let uv_ref = pixels("uv_ref", &uv_ref)?;
    let motions = stack::<4, 4>("t_now_ref", &t_now_ref)?;
    let inverse_range = numbers("inverse_range", &inverse_range)?;
    let count = uv_ref.len();
    same_length("t_now_ref", count, motions.len())?;
    same_length("inverse_range", count, inverse_range.len())?;
    let warps: Vec<warp::Warp> = uv_ref
        .iter()
        .zip(&motions)
        .zip(&inverse_range)
        .map(|((uv, motion), &rho)| {
            let rotation = motion.fixed_view::<3, 3>(0, 0).into_owned();
            let translation = motion.fixed_view::<3, 1>(0, 3).into_owned();
            warp::affine_map(
                &camera_ref.0,
                *uv,
                &camera_now.0,
                (&rotation, &translation),
                rho,
            )
        })
        .collect();
    let nowhere = Vector2::repeat(f64::NAN);
    Ok((
        vectors(py, warps.iter().map(|w| w.uv.unwrap_or(nowhere)), count),
        stacked(
            py,
            warps
                .iter()
                .map(|w| w.affine.unwrap_or_else(Matrix2::identity)),
            count,
        ),
        PyArray1::from_iter(py, warps.iter().map(|w| w.affine.is_some())),
    ))
}

/// Templates sampled around points of an image under affine maps.
///
/// Parameters
/// ----------
/// image : (H, W) uint8
///     Beyond its edge the edge repeats.
/// centres : (N, 2) float64
///     Centre of each template in the image (u, v).
/// affine : (N, 2, 2) float64
///     Map from image offsets to template offsets.
/// size : int
///     Side of a template, pixels (odd).
///
/// Returns
/// -------
/// templates : (N, size, size) uint8
///     Bilinear samples; where the map shrinks, each pixel is the mean of 2 x 2 of them.
/// reach : (N, 2) float64
///     Largest distance in u and v between a sample and its centre, image pixels.
///
/// Raises
/// ------
/// InputError
///     If an argument has another type or shape, or a map has no inverse.
#[pyfunction]
pub(crate) fn sample_templates<'py>(
    py: Python<'py>,
    image: Argument<'py>,
    centres: Argument<'py>,
    affine: Argument<'py>,
    size: usize,
) -> PyResult<(Bound<'py, PyArray3<u8>>, Uv<'py>)> {
    let grey = grey("image", &image)?;
    let (centres, affine) = (
        pixels("centres", &centres)?,
        stack::<2, 2>("affine", &affine)?,
    );
    same_length("affine", centres.len(), affine.len())?;
    odd_side("size", size)?;
    let pixels = in_order!(grey);
    let view = self::image(&pixels, grey.as_array().shape())?;
    let mut templates = Vec::with_capacity(centres.len() * size * size);
    let mut reach = Vec::with_capacity(centres.len());
    for (centre, affine) in centres.iter().zip(&affine) {
        let sampled = warp::sample(&view, *centre, affine, size, &mut templates);
        reach.push(sampled.ok_or_else(|| invalid("affine", "a map has no inverse".into()))?);
    }
    let count = reach.len();
    let templates = PyArray1::from_vec(py, templates)
        .reshape([count, size, size])
        .expect("count * size^2 pixels");
    Ok((templates, vectors(py, reach.into_iter(), count)))
}

/// SIFT's histogram of gradients over windows warped by affine maps.
///
/// Parameters
/// ----------
/// image : (H, W) uint8
/// centres : (N, 2) float64
///     Pixels (u, v).
/// axes : (N, 2, 2) float64
///     Maps offsets in the described view to pixel offsets in the image.
/// step : float
///     Distance of the window's 8 x 8 samples in the described view.
///
/// Returns
/// -------
/// (N, 128) float32
///     Square roots of the L1-normalised histogram (RootSIFT): unit vectors.
///
/// Raises
/// ------
/// InputError
///     If an argument has another type or shape.
#[pyfunction]
pub(crate) fn describe_windows<'py>(
    py: Python<'py>,
    image: Argument<'py>,
    centres: Argument<'py>,
    axes: Argument<'py>,
    step: f64,
) -> PyResult<Bound<'py, PyArray2<f32>>> {
    let grey = grey("image", &image)?;
    let (centres, axes) = (pixels("centres", &centres)?, stack::<2, 2>("axes", &axes)?);
    same_length("axes", centres.len(), axes.len())?;
    let windows: Vec<_> = centres.into_iter().zip(axes).collect();
    let pixels = in_order!(grey);
    let view = self::image(&pixels, grey.as_array().shape())?;
    let mut out = Vec::new();
    describe(&view, &windows, step, &mut out);
    Ok(PyArray1::from_vec(py, out)
        .reshape([windows.len(), LENGTH])
        .expect("one descriptor a window"))
}

fn pairs(rays_s: &Argument<'_>, rays_f: &Argument<'_>) -> PyResult<Vec<Pair>> {
    let (rays_s, rays_f) = (rows::<3>("rays_s", rays_s)?, rows::<3>("rays_f", rays_f)?);
    same_length("rays_f", rays_s.len(), rays_f.len())?;
    Ok(rays_s.into_iter().zip(rays_f).collect())
}

/// Sampson residual of each pair of rays, and its derivative by an error of the pose.
///
/// Parameters
/// ----------
/// rays_s, rays_f : (M, 3) float64
///     Unit rays in C and F.
/// t_cf : (4, 4) float64
/// focal : (float, float)
///     Focal lengths of Cs and Cf, pixels per radian.
///
/// Returns
/// -------
/// residual : (M,) float64
///     In units of the pixel noise: its standard deviation is that of one pixel coordinate.
/// jacobian : (M, 6) float64
///     By (translation, rotation) on the right of ``t_cf``, pixels per metre and per radian.
///
/// Raises
/// ------
/// InputError
///     If an argument has another shape.
#[pyfunction]
pub(crate) fn epipolar_residuals<'py>(
    py: Python<'py>,
    rays_s: Argument<'py>,
    rays_f: Argument<'py>,
    t_cf: Argument<'py>,
    focal: [f64; 2],
) -> PyResult<(Column<'py, f64>, Bound<'py, PyArray2<f64>>)> {
    let (pairs, pose) = (pairs(&rays_s, &rays_f)?, pose("t_cf", &t_cf)?);
    let found: Vec<_> = pairs
        .iter()
        .map(|pair| consensus::epipolar_residual(pair, &pose, focal))
        .collect();
    Ok((
        PyArray1::from_iter(py, found.iter().map(|f| f.0)),
        vectors(py, found.iter().map(|f| f.1), pairs.len()),
    ))
}

/// Correction of a measured pose that most pairs agree on, under the prior of its covariance.
///
/// Parameters
/// ----------
/// rays_s, rays_f : (M, 3) float64
///     Matched unit rays in C and F; fewer than three leave the pose as it is.
/// t_cf : (4, 4) float64
///     Measured pose.
/// covariance : (6, 6) float64
///     Over (translation, rotation), tangent on the right.
/// focal : (float, float)
///     Focal lengths of Cs and Cf, pixels per radian.
/// sigma : float
///     Standard deviation of a right match's residual, pixels.
/// limit : float
///     Largest residual of a match that agrees, pixels.
/// start : (4, 4) float64, optional
///     The pose that nearly the same matches agreed on; it takes the place of the sampling.
///
/// Returns
/// -------
/// t_cf : (4, 4) float64
/// covariance : (6, 6) float64
/// agree : (M,) bool
///     Matches whose residual is within the limit under the pose.
///
/// Raises
/// ------
/// InputError
///     If an argument has another shape, or the covariance is not positive definite.
#[pyfunction]
#[pyo3(signature = (rays_s, rays_f, t_cf, covariance, focal, sigma, limit, start = None))]
#[expect(clippy::too_many_arguments, reason = "names in Python")]
pub(crate) fn find_consensus<'py>(
    py: Python<'py>,
    rays_s: Argument<'py>,
    rays_f: Argument<'py>,
    t_cf: Argument<'py>,
    covariance: Argument<'py>,
    focal: [f64; 2],
    sigma: f64,
    limit: f64,
    start: Option<Argument<'py>>,
) -> PyResult<(
    Bound<'py, PyArray2<f64>>,
    Bound<'py, PyArray2<f64>>,
    Column<'py, bool>,
)> {
    let (pairs, prior) = (pairs(&rays_s, &rays_f)?, pose("t_cf", &t_cf)?);
    let covariance = covariance6("covariance", &covariance)?;
    let start = start.map(|start| pose("start", &start)).transpose()?;
    let noise = Noise {
        focal,
        sigma,
        limit,
    };
    let found = consensus::find_consensus(&pairs, &prior, &covariance, &noise, start.as_ref());
    let found = found.ok_or_else(|| invalid("covariance", "it is not positive definite".into()))?;
    Ok((
        to_pose(py, &found.pose.rotation, &found.pose.translation),
        to_matrix(py, &found.covariance),
        PyArray1::from_vec(py, found.agree),
    ))
}
