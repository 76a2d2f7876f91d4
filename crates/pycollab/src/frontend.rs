//! Inner loops of the front end: the binding of the crate `frontend`.

use crate::camera::PyCamera;
use crate::convert::{
    Argument, covariance6, invalid, numbers, pixels, pose, rows, same_length, stack, stacked,
    to_matrix, to_pose, vectors,
};
use crate::errors::bad_shape;
use ::frontend::Image;
use ::frontend::affine::align_affine;
use ::frontend::consensus::{self, Noise, Pair};
use ::frontend::corners::{self, Grid, PeakOptions, Response};
use ::frontend::describe::{LENGTH, describe};
use ::frontend::pairs::{self, Descriptors, MatchOptions, Point, Relation};
use ::frontend::search::{Expected, Options, search};
use ::frontend::warp::{self, Limits, Patch, Views};
use nalgebra::{Matrix2, Vector2, Vector4};
use numpy::{
    PyArray1, PyArray2, PyArray3, PyArrayMethods, PyReadonlyArray2, PyReadonlyArray3,
    PyUntypedArrayMethods,
};
use pyo3::intern;
use pyo3::prelude::*;
use pyo3::types::PyList;
use std::borrow::Cow;

type Uv<'py> = Bound<'py, PyArray2<f64>>;
type Column<'py, T> = Bound<'py, PyArray1<T>>;

/// Pixels in row order, copied only if they are not.
macro_rules! in_order {
    ($array:expr) => {
        match $array.as_slice() {
            Ok(slice) => Cow::Borrowed(slice),
            Err(_) => Cow::Owned($array.as_array().iter().copied().collect::<Vec<_>>()),
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
/// whole : bool
///     Whether ellipses above ``large_radius`` are searched where no guess lies in them.
///
/// Returns
/// -------
/// uv : (N, 2) float64
///     Sub-pixel position of the best peak; NaN where there is none.
/// score, second : (N,) float64
///     Correlation of the best peak and of the next best one; -1 where there is none.
/// code : (N,) int64
///     0 found, 1 score too low, 2 ambiguous, 3 outside of the image, 4 not searched as not ``whole``.
///
/// Raises
/// ------
/// InputError
///     If an argument has another type or shape.
#[pyfunction]
#[pyo3(signature = (image, templates, uv, s, guess, *, gate, min_radius, large_radius, max_radius, guess_radius,
    guess_gate, min_score, ambiguity, peak_distance, min_deviation, whole = true))]
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
    whole: bool,
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
        whole,
    };
    let grey = grey("image", &image)?;
    let (windows, count, side) = windows(&templates)?;
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

/// Fits each template to the image around a position by an affine map, gain and offset.
///
/// Parameters
/// ----------
/// image : (H, W) uint8
/// templates : (N, h, h) uint8
///     Side h odd.
/// uv : (N, 2) float64
///     Where their middles are, to some pixels.
///
/// Returns
/// -------
/// uv : (N, 2) float64
///     Where they are exactly; NaN where the template fits nowhere near.
/// score : (N,) float64
///     Correlation of template and image under the map; -1 where there is none.
///
/// Raises
/// ------
/// InputError
///     If an argument has another type or shape.
#[pyfunction]
pub(crate) fn align_templates<'py>(
    py: Python<'py>,
    image: Argument<'py>,
    templates: Argument<'py>,
    uv: Argument<'py>,
) -> PyResult<(Uv<'py>, Column<'py, f64>)> {
    let grey = grey("image", &image)?;
    let (windows, count, side) = windows(&templates)?;
    let uv = pixels("uv", &uv)?;
    same_length("uv", count, uv.len())?;
    let (pixels, windows) = (in_order!(grey), in_order!(windows));
    let view = self::image(&pixels, grey.as_array().shape())?;
    let nowhere = (Vector2::repeat(f64::NAN), -1.0);
    let found: Vec<_> = py.detach(|| {
        let pairs = windows.chunks_exact(side * side).zip(uv);
        pairs
            .map(|(template, uv)| align_affine(&view, template, side, uv).unwrap_or(nowhere))
            .collect()
    });
    Ok((
        vectors(py, found.iter().map(|f| f.0), count),
        PyArray1::from_iter(py, found.iter().map(|f| f.1)),
    ))
}

/// Templates of one odd side, how many, and that side.
fn windows<'py>(templates: &Argument<'py>) -> PyResult<(PyReadonlyArray3<'py, u8>, usize, usize)> {
    let windows: PyReadonlyArray3<'_, u8> = templates
        .extract()
        .map_err(|_| invalid("templates", "an (N, h, h) array of uint8 is needed".into()))?;
    let shape = windows.as_array().raw_dim();
    if shape[2] != shape[1] {
        let got = [shape[0], shape[1], shape[2]];
        return Err(bad_shape("templates", "(N, h, h)", &got));
    }
    odd_side("templates", shape[1])?;
    Ok((windows, shape[0], shape[1]))
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

/// Affine maps of pixel offsets from one camera's image into another's, at given depths.
///
/// Parameters
/// ----------
/// camera_ref, camera_now : Camera
/// uv_ref : (N, 2) float64
///     Points in the reference image.
/// t_now_ref : (4, 4) float64
///     Maps points of the reference camera into the camera now.
/// inverse_range : (N,) float64
///     Inverse distance of each point from its reference camera, 1/m; NaN or 0: infinitely far.
/// min_area, max_area, max_stretch : float
///     The settings ``patch.*``.
///
/// Returns
/// -------
/// (N, 2, 2) float64
///     ``offset_now = affine @ offset_ref``; where that is not allowed at the depth, the map of the rotation alone; where
///     this is not either, the identity.
///
/// Raises
/// ------
/// InputError
///     If an argument has another type or shape.
#[pyfunction]
#[expect(clippy::too_many_arguments, reason = "names in Python")]
pub(crate) fn affine_at<'py>(
    py: Python<'py>,
    camera_ref: &PyCamera,
    uv_ref: Argument<'py>,
    camera_now: &PyCamera,
    t_now_ref: Argument<'py>,
    inverse_range: Argument<'py>,
    min_area: f64,
    max_area: f64,
    max_stretch: f64,
) -> PyResult<Bound<'py, PyArray3<f64>>> {
    let (uv_ref, motion) = (pixels("uv_ref", &uv_ref)?, pose("t_now_ref", &t_now_ref)?);
    let inverse_range = numbers("inverse_range", &inverse_range)?;
    same_length("inverse_range", uv_ref.len(), inverse_range.len())?;
    let limits = Limits {
        area: [min_area, max_area],
        stretch: max_stretch,
    };
    let motion = (&motion.rotation, &motion.translation);
    let affine = uv_ref.iter().zip(&inverse_range);
    let affine = affine
        .map(|(uv, &rho)| warp::affine_at(&camera_ref.0, *uv, &camera_now.0, motion, rho, &limits));
    Ok(stacked(py, affine, uv_ref.len()))
}

/// Templates as patches are expected to look from another pose.
///
/// Parameters
/// ----------
/// camera_ref, camera_now : Camera
///     The camera that captured the patches, and the one that looks now.
/// patches : list of N Patch
/// t_wc : (4, 4) float64
///     Pose of the camera now.
/// points : (N, 3) float64
///     Landmarks in W, metres; a row of NaN: only the rotation between the poses counts.
/// size : int
///     Side of a template, pixels (odd).
/// min_area, max_area, max_stretch : float
///     The settings ``patch.*``.
///
/// Returns
/// -------
/// templates : (N, size, size) uint8
///     Zeros where there is none.
/// ok : (N,) bool
///     False where the change of area or the stretch is out of bounds, or the warp leaves the stored window.
/// affine : (N, 2, 2) float64
///     Maps pixel offsets at capture to pixel offsets now; the identity where there is none.
///
/// Raises
/// ------
/// InputError
///     If an argument has another type or shape.
#[pyfunction]
#[expect(clippy::too_many_arguments, reason = "names in Python")]
pub(crate) fn warp_patches<'py>(
    py: Python<'py>,
    camera_ref: &PyCamera,
    camera_now: &PyCamera,
    patches: Vec<Argument<'py>>,
    t_wc: Argument<'py>,
    points: Argument<'py>,
    size: usize,
    min_area: f64,
    max_area: f64,
    max_stretch: f64,
) -> PyResult<(
    Bound<'py, PyArray3<u8>>,
    Column<'py, bool>,
    Bound<'py, PyArray3<f64>>,
)> {
    odd_side("size", size)?;
    let (now, points) = (pose("t_wc", &t_wc)?, rows::<3>("points", &points)?);
    let count = patches.len();
    same_length("points", count, points.len())?;
    let limits = Limits {
        area: [min_area, max_area],
        stretch: max_stretch,
    };
    let views = Views {
        camera_ref: &camera_ref.0,
        camera_now: &camera_now.0,
        pose: &now,
    };
    let mut templates = Vec::with_capacity(count * size * size);
    let mut affine = Vec::with_capacity(count);
    for (patch, point) in patches.iter().zip(&points) {
        let window = grey("pixels", &patch.getattr(intern!(py, "pixels"))?)?;
        let pixels = in_order!(window);
        let inside = quadruple("inside", &patch.getattr(intern!(py, "inside"))?)?;
        let uv_ref = numbers("uv_ref", &patch.getattr(intern!(py, "uv_ref"))?)?;
        same_length("uv_ref", 2, uv_ref.len())?;
        let patch = Patch {
            window: image(&pixels, window.shape())?,
            uv_ref: Vector2::new(uv_ref[0], uv_ref[1]),
            pose: pose("t_wc", &patch.getattr(intern!(py, "t_wc"))?)?,
            inside,
        };
        affine.push(patch.template(&views, point, size, &limits, &mut templates));
    }
    let templates = PyArray1::from_vec(py, templates)
        .reshape([count, size, size])
        .expect("count * size^2 pixels");
    let ok = PyArray1::from_iter(py, affine.iter().map(Option::is_some));
    let affine = affine
        .into_iter()
        .map(|a| a.unwrap_or_else(Matrix2::identity));
    Ok((templates, ok, stacked(py, affine, count)))
}

fn quadruple(what: &'static str, value: &Argument<'_>) -> PyResult<[Vector2<f64>; 2]> {
    let all = numbers(what, value)?;
    same_length(what, 4, all.len())?;
    Ok([Vector2::new(all[0], all[1]), Vector2::new(all[2], all[3])])
}

/// Cuts windows around points rounded to whole pixels out of an image.
///
/// Parameters
/// ----------
/// image : (H, W) uint8
///     Beyond its edge the edge repeats.
/// uv : (N, 2) float64
/// half : int
///     Pixels of a window on each side of its middle.
///
/// Returns
/// -------
/// windows : list of N (2 half + 1, 2 half + 1) uint8
/// inside : (N, 4) float64
///     First and last column and row that hold image (u0, v0, u1, v1).
///
/// Raises
/// ------
/// InputError
///     If an argument has another type or shape, or a point is not finite.
#[pyfunction]
pub(crate) fn capture_windows<'py>(
    py: Python<'py>,
    image: Argument<'py>,
    uv: Argument<'py>,
    half: usize,
) -> PyResult<(Bound<'py, PyList>, Uv<'py>)> {
    let (grey, uv) = (grey("image", &image)?, pixels("uv", &uv)?);
    if !uv.iter().all(|uv| uv.amax() < 1e9) {
        return Err(invalid("uv", "a point is not finite".into()));
    }
    let pixels = in_order!(grey);
    let view = self::image(&pixels, grey.shape())?;
    let side = 2 * half + 1;
    let windows = PyList::empty(py);
    let mut inside = Vec::with_capacity(uv.len());
    for uv in &uv {
        let mut window = Vec::with_capacity(side * side);
        let [first, last] = warp::capture(&view, *uv, half, &mut window);
        inside.push(Vector4::new(first.x, first.y, last.x, last.y));
        let window = PyArray1::from_vec(py, window).reshape([side, side]);
        windows.append(window.expect("side^2 pixels"))?;
    }
    Ok((windows, vectors(py, inside.into_iter(), uv.len())))
}

/// Local maxima of a corner response, the strongest first.
///
/// Parameters
/// ----------
/// response : (H, W) float32
///     Not below zero.
/// reach : int
///     A peak is the largest response within so many pixels (square neighbourhood).
/// border : int
///     Pixels along the edge without peaks.
/// quality, least : float
///     Least response as a share of the best, and as a number.
///
/// Returns
/// -------
/// (M, 2) float64
///     Sub-pixel places (u, v), by a parabola through each peak.
///
/// Raises
/// ------
/// InputError
///     If an argument has another type or shape.
#[pyfunction]
pub(crate) fn corner_peaks<'py>(
    py: Python<'py>,
    response: Argument<'py>,
    reach: usize,
    border: usize,
    quality: f32,
    least: f32,
) -> PyResult<Uv<'py>> {
    let array: PyReadonlyArray2<'_, f32> = response
        .extract()
        .map_err(|_| invalid("response", "an (H, W) array of float32 is needed".into()))?;
    let values = in_order!(array);
    let (height, width) = (array.shape()[0], array.shape()[1]);
    let response = Response::new(&values, width, height).expect("as many values as pixels");
    let peaks = response.peaks(&PeakOptions {
        reach,
        border,
        quality,
        least,
    });
    let count = peaks.len();
    Ok(vectors(py, peaks.into_iter(), count))
}

/// At most ``count`` peaks, those first whose part of the image needs them most.
///
/// Parameters
/// ----------
/// peaks : (M, 2) float64
///     The most wanted first.
/// existing : (N, 2) float64
///     Points that there are already; those that are not finite do not count.
/// count : int
/// shape : (int, int)
///     Rows and columns of the image.
/// cells : int
///     Of the grid, along the image's longer side.
/// distance : float
///     Least distance between a peak and an existing point, pixels.
///
/// Returns
/// -------
/// (K,) int64
///     Rows of ``peaks``.
///
/// Raises
/// ------
/// InputError
///     If an argument has another type or shape.
#[pyfunction]
pub(crate) fn spread_corners<'py>(
    py: Python<'py>,
    peaks: Argument<'py>,
    existing: Argument<'py>,
    count: usize,
    shape: (usize, usize),
    cells: usize,
    distance: f64,
) -> PyResult<Column<'py, i64>> {
    let (peaks, existing) = (pixels("peaks", &peaks)?, pixels("existing", &existing)?);
    if shape.0.min(shape.1).min(cells) == 0 {
        return Err(invalid("shape", "an image and a cell are not empty".into()));
    }
    let grid = Grid {
        size: (shape.1, shape.0),
        cells,
        distance,
    };
    let chosen = corners::spread(&peaks, &existing, count, &grid);
    Ok(PyArray1::from_iter(
        py,
        chosen.into_iter().map(|i| i as i64),
    ))
}

/// Matches points of Cs with points of Cf by their descriptors, among the pairs that the measured pose allows.
///
/// Parameters
/// ----------
/// rays_s, rays_f : (N, 3), (M, 3) float64
///     Unit rays.
/// ranges : (N, 2) float64
///     Least and largest inverse range of each point from Cs, 1/m.
/// known : (N,) bool
///     Points that have one descriptor, the first, whatever the depth of a pair.
/// described_s : (D, N, K) float32
///     Descriptors of the points of Cs, made at each of the depths; K is a multiple of 32.
/// depths : (D,) float64
///     Inverse ranges, increasing, 1/m.
/// described_f : (M, K) float32
/// t_cf : (4, 4) float64
/// covariance : (6, 6) float64
///     Of it, over (translation, rotation), tangent on the right.
/// sigma : (float, float)
///     Standard deviations of a pixel of Cs and of Cf, radians.
/// gate, ratio, max_distance : float
///     The settings ``worn.*``.
///
/// Returns
/// -------
/// index_s, index_f : (K,) int64
///     Rows of the points matched.
/// alone, indistinct, one_sided : int
///     Points of Cs without a match, by reason: no pair is allowed; the best is unlike or hardly better than the next;
///     the best has a better partner.
///
/// Raises
/// ------
/// InputError
///     If an argument has another type or shape, or the covariance is not positive definite.
#[pyfunction]
#[expect(clippy::too_many_arguments, reason = "names in Python")]
pub(crate) fn match_pairs<'py>(
    py: Python<'py>,
    rays_s: Argument<'py>,
    rays_f: Argument<'py>,
    ranges: Argument<'py>,
    known: Vec<bool>,
    described_s: PyReadonlyArray3<'py, f32>,
    depths: Argument<'py>,
    described_f: PyReadonlyArray2<'py, f32>,
    t_cf: Argument<'py>,
    covariance: Argument<'py>,
    sigma: [f64; 2],
    gate: f64,
    ratio: f32,
    max_distance: f32,
) -> PyResult<(Column<'py, i64>, Column<'py, i64>, usize, usize, usize)> {
    let (rays_s, rays_f) = (rows::<3>("rays_s", &rays_s)?, rows::<3>("rays_f", &rays_f)?);
    let (ranges, depths) = (rows::<2>("ranges", &ranges)?, numbers("depths", &depths)?);
    same_length("ranges", rays_s.len(), ranges.len())?;
    same_length("known", rays_s.len(), known.len())?;
    let length = described_s.shape()[2];
    let expected = [depths.len(), rays_s.len(), length];
    if described_s.shape() != expected || depths.is_empty() || length % 32 != 0 {
        let expected = "(D, N, a multiple of 32)";
        return Err(bad_shape("described_s", expected, described_s.shape()));
    }
    if described_f.shape() != [rays_f.len(), length] {
        return Err(bad_shape(
            "described_f",
            "(M, as described_s)",
            described_f.shape(),
        ));
    }
    let points: Vec<Point> = rays_s
        .into_iter()
        .zip(ranges)
        .zip(known)
        .map(|((ray, range), known)| Point {
            ray,
            range: range.into(),
            known,
        })
        .collect();
    let relation = Relation {
        pose: &pose("t_cf", &t_cf)?,
        covariance: &covariance6("covariance", &covariance)?,
        sigma,
        gate,
    };
    let (of_s, of_f) = (in_order!(described_s), in_order!(described_f));
    let descriptors = Descriptors {
        length,
        of_s: &of_s,
        depths: &depths,
        of_f: &of_f,
    };
    let options = MatchOptions {
        ratio,
        max_distance,
    };
    let found =
        py.detach(|| pairs::match_pairs(&points, &rays_f, &descriptors, &relation, &options));
    let found = found.ok_or_else(|| invalid("covariance", "it is not positive definite".into()))?;
    Ok((
        PyArray1::from_iter(py, found.pairs.iter().map(|p| p.0 as i64)),
        PyArray1::from_iter(py, found.pairs.iter().map(|p| p.1 as i64)),
        found.alone,
        found.indistinct,
        found.one_sided,
    ))
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
