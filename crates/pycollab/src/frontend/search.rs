//! Search of templates around predicted pixels.

use crate::arrays_in::{
    Argument, PixelsArgument, RowsArgument, grey, numbers, pixels, same_length, stack, templates,
    whole_numbers,
};
use crate::arrays_out::{Column, Table, chosen, column, vectors};
use crate::gate;
use ::frontend::search::{Expected, Options, search};
use nalgebra::Vector2;
use pyo3::prelude::*;

/// Where templates are expected in an image.
///
/// Parameters
/// ----------
/// uv : (N, 2) float64
///     Predicted pixels; NaN where there is none.
/// s : (N, 2, 2) float64
///     Covariance of each, pixel noise included, px^2.
/// guess : (N, 2) float64, optional
///     Where something else says that the point is; NaN where it does not say.
///
/// Raises
/// ------
/// InputError
///     If an argument has another type or shape.
#[pyclass(module = "collabslam._core", frozen)]
pub(crate) struct ExpectedPixels(Vec<Expected>);

#[pymethods]
impl ExpectedPixels {
    #[new]
    #[pyo3(signature = (uv, s, guess = None))]
    fn new(uv: Argument<'_>, s: Argument<'_>, guess: Option<Argument<'_>>) -> PyResult<Self> {
        let (uv, s) = (pixels("uv", &uv)?, stack::<2, 2>("s", &s)?);
        let guess = match guess {
            Some(guess) => pixels("guess", &guess)?,
            None => vec![Vector2::repeat(f64::NAN); uv.len()],
        };
        same_length("s", uv.len(), s.len())?;
        same_length("guess", uv.len(), guess.len())?;
        let all = uv.into_iter().zip(s).zip(guess);
        let all = all.map(|((uv, s), guess)| Expected { uv, s, guess });
        Ok(Self(all.collect()))
    }

    fn __len__(&self) -> usize {
        self.0.len()
    }
}

/// How far around a predicted pixel a template is searched.
///
/// Parameters
/// ----------
/// gate : float
///     Radius of the ellipse in standard deviations.
/// min_radius : float
///     Least radius of the ellipse, pixels.
/// large_radius : float
///     Radius above which it is not searched whole if a guess lies in it, pixels.
/// max_radius : float
///     Cap of the window's half side, pixels.
/// guess_radius : float
///     Half side of the window around a guess, pixels.
/// guess_gate : float
///     How generously a guess lies in the ellipse: a factor on ``gate``.
#[pyclass(module = "collabslam._core", frozen, get_all)]
pub(crate) struct SearchWindow {
    gate: f64,
    min_radius: f64,
    large_radius: f64,
    max_radius: f64,
    guess_radius: f64,
    guess_gate: f64,
}

#[pymethods]
impl SearchWindow {
    #[new]
    #[pyo3(signature = (*, gate, min_radius, large_radius, max_radius, guess_radius, guess_gate))]
    fn new(
        gate: f64,
        min_radius: f64,
        large_radius: f64,
        max_radius: f64,
        guess_radius: f64,
        guess_gate: f64,
    ) -> Self {
        Self {
            gate,
            min_radius,
            large_radius,
            max_radius,
            guess_radius,
            guess_gate,
        }
    }
}

/// Which peak of the correlation is a match.
///
/// Parameters
/// ----------
/// min_score : float
///     Least correlation.
/// ambiguity : float
///     Largest share of the best peak that another may reach.
/// peak_distance : float
///     Peaks nearer than this to the best one belong to it, pixels.
/// min_deviation : float
///     Least standard deviation of a template's grey values.
/// scarce : bool
///     Whether less correlation is asked for, by the share of a template that is noise (METHOD 7).
#[pyclass(module = "collabslam._core", frozen, get_all)]
pub(crate) struct PeakTest {
    min_score: f64,
    ambiguity: f64,
    peak_distance: f64,
    min_deviation: f64,
    scarce: bool,
}

#[pymethods]
impl PeakTest {
    #[new]
    #[pyo3(signature = (*, min_score, ambiguity, peak_distance, min_deviation, scarce = false))]
    fn new(
        min_score: f64,
        ambiguity: f64,
        peak_distance: f64,
        min_deviation: f64,
        scarce: bool,
    ) -> Self {
        Self {
            min_score,
            ambiguity,
            peak_distance,
            min_deviation,
            scarce,
        }
    }
}

/// What a search found.
///
/// Parameters
/// ----------
/// uv : (N, 2) float64
///     Sub-pixel position of the best peak; NaN where there is none.
/// score : (N,) float64
///     Its correlation; -1 where there is none.
/// second : (N,) float64
///     Correlation of the next best peak that does not belong to it; -1 where there is none.
/// code : (N,) int64
///     0 found, 1 score too low, 2 ambiguous, 3 outside of the image, 4 not searched as not ``whole``.
///
/// Raises
/// ------
/// InputError
///     If an argument has another type or shape.
#[pyclass(module = "collabslam._core", frozen, get_all)]
pub(crate) struct SearchResult {
    uv: Table,
    score: Column<f64>,
    second: Column<f64>,
    code: Column<i64>,
}

#[pymethods]
impl SearchResult {
    #[new]
    fn new(
        py: Python<'_>,
        uv: Argument<'_>,
        score: Argument<'_>,
        second: Argument<'_>,
        code: Argument<'_>,
    ) -> PyResult<Self> {
        let (uv, code) = (pixels("uv", &uv)?, whole_numbers("code", &code)?);
        let (score, second) = (numbers("score", &score)?, numbers("second", &second)?);
        same_length("score", uv.len(), score.len())?;
        same_length("second", uv.len(), second.len())?;
        same_length("code", uv.len(), code.len())?;
        Ok(Self {
            uv: vectors(py, uv.into_iter()),
            score: column(py, score),
            second: column(py, second),
            code: column(py, code),
        })
    }

    /// Some of the rows.
    ///
    /// Parameters
    /// ----------
    /// which : (N,) bool, (M,) int64 or slice
    ///     A mask, or rows.
    ///
    /// Returns
    /// -------
    /// SearchResult
    ///
    /// Raises
    /// ------
    /// InputError
    ///     If it is none of these, or there is no such row.
    fn subset(&self, which: RowsArgument<'_>) -> PyResult<Self> {
        Ok(Self {
            uv: chosen(&self.uv, &which)?,
            score: chosen(&self.score, &which)?,
            second: chosen(&self.second, &which)?,
            code: chosen(&self.code, &which)?,
        })
    }

    fn __len__(&self, py: Python<'_>) -> PyResult<usize> {
        self.score.bind(py).len()
    }
}

/// Looks for each template inside the ellipse of its predicted pixel, by zero-normalised
/// cross-correlation.
///
/// Parameters
/// ----------
/// image : (H, W) uint8
/// templates : (N, h, h) uint8
///     Side h odd.
/// expected : ExpectedPixels
///     One row for each template.
/// window : SearchWindow
/// peaks : PeakTest
/// whole : bool
///     Whether ellipses above ``large_radius`` are searched where no guess lies in them.
///
/// Returns
/// -------
/// SearchResult
///
/// Raises
/// ------
/// InputError
///     If an argument has another type or shape.
#[pyfunction]
#[pyo3(signature = (image, templates, expected, window, peaks, *, whole = true))]
pub(crate) fn search_templates(
    py: Python<'_>,
    image: PixelsArgument<'_>,
    templates: PixelsArgument<'_>,
    expected: &ExpectedPixels,
    window: &SearchWindow,
    peaks: &PeakTest,
    whole: bool,
) -> PyResult<SearchResult> {
    let options = Options {
        gate: window.gate,
        min_radius: window.min_radius,
        large_radius: window.large_radius,
        max_radius: window.max_radius,
        guess_radius: window.guess_radius,
        guess_gate: window.guess_gate,
        min_score: peaks.min_score,
        scarce: peaks.scarce,
        ambiguity: peaks.ambiguity,
        peak_distance: peaks.peak_distance,
        min_deviation: peaks.min_deviation,
        whole,
    };
    let (grey, templates) = (grey("image", &image)?, self::templates(&templates)?);
    same_length("expected", templates.count, expected.0.len())?;
    let (image, pixels, side) = (grey.image()?, templates.pixels(), templates.side);
    let found = gate::compute(py, || search(&image, pixels, side, &expected.0, &options));
    Ok(SearchResult {
        uv: vectors(py, found.iter().map(|f| f.uv)),
        score: column(py, found.iter().map(|f| f.score)),
        second: column(py, found.iter().map(|f| f.second)),
        code: column(py, found.iter().map(|f| f.outcome as i64)),
    })
}
