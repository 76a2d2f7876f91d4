//! Camera models.

use crate::arrays_in::{Argument, pixels, rows};
use crate::arrays_out::{Column, Table, column, to_matrix, vectors};
use crate::camera_names::{Given, MODELS, OtherNames};
use crate::errors::to_python;
use crate::gate;
use ekf_core::Camera;
use nalgebra::{Vector2, Vector3};
use pyo3::prelude::*;
use pyo3::types::PyTuple;

/// As many as the model has.
///
/// Python: tuple[float, ...]
type Parameters<'py> = Bound<'py, PyTuple>;

/// A name, of whatever type it is.
///
/// Python: str
type NameArgument<'py> = Bound<'py, PyAny>;

/// A whole number, of whatever type it is.
///
/// Python: int
type WholeArgument<'py> = Bound<'py, PyAny>;

/// Where points lie in an image.
///
/// Attributes
/// ----------
/// uv : (N, 2) float64
///     Pixels; NaN where the point has none.
/// visible : (N,) bool
///     In front of the camera, within the model's range, and inside the image.
#[pyclass(module = "collabslam._core", frozen, get_all)]
pub(crate) struct ProjectedPoints {
    uv: Table,
    visible: Column<bool>,
}

/// A calibrated camera: `Camera("radtan", 640, 480, K, D)`, or by the names of ROS or Kalibr.
///
/// Parameters
/// ----------
/// model : str
///     Distortion model (METHOD 4): "pinhole", none; "radtan", OpenCV's radial-tangential; "fisheye",
///     equidistant; "wideangle", Davison's one parameter.  Or by another name of them, as "plumb_bob",
///     "rational_polynomial", "equidistant"; `models` has all.  "pinhole" if left out without distortion.
/// width, height : int
///     Image size, px.
/// intrinsics : (4,) or (3, 3) array_like
///     ``fx, fy, cx, cy``, px, or the matrix K.
/// distortion : array_like
///     ``[]``, ``[k1, k2, p1, p2(, k3(, k4, k5, k6))]``, ``[k1, k2, k3, k4]`` or ``[K]``, of any shape;
///     zeros behind them are left out.
/// **others : array_like or str
///     The same by other names: ``K`` or ``k`` (intrinsics), ``D``, ``d`` or ``distortion_coeffs``
///     (distortion), ``distortion_model`` (model), ``resolution`` (width and height), and Kalibr's
///     ``camera_model="pinhole"``.
///
/// Raises
/// ------
/// InputError
///     For an unknown model, a wrong number or type of parameters, or impossible values.
#[pyclass(name = "Camera", module = "collabslam._core", frozen, eq)]
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct PyCamera(pub(crate) Camera);

#[pymethods]
impl PyCamera {
    #[new]
    #[pyo3(signature = (model = None, width = None, height = None, intrinsics = None, distortion = None, **others))]
    fn new(
        model: Option<NameArgument<'_>>,
        width: Option<WholeArgument<'_>>,
        height: Option<WholeArgument<'_>>,
        intrinsics: Option<Argument<'_>>,
        distortion: Option<Argument<'_>>,
        others: Option<&OtherNames<'_>>,
    ) -> PyResult<Self> {
        let given = Given {
            model,
            size: [width, height],
            intrinsics,
            distortion,
            others,
        };
        let (model, width, height, intrinsics, distortion) = given.read()?;
        Camera::new(&model, width, height, intrinsics, &distortion)
            .map(Self)
            .map_err(to_python)
    }

    /// Our model of distortion by each name that it has elsewhere, in lower case.
    #[staticmethod]
    fn models() -> Vec<(&'static str, &'static str)> {
        MODELS.to_vec()
    }

    /// Name of the distortion model.
    #[getter]
    fn model(&self) -> &'static str {
        self.0.model()
    }

    /// Image width, px.
    #[getter]
    fn width(&self) -> u32 {
        self.0.width
    }

    /// Image height, px.
    #[getter]
    fn height(&self) -> u32 {
        self.0.height
    }

    /// ``(fx, fy, cx, cy)``, px.
    #[getter]
    fn intrinsics(&self) -> (f64, f64, f64, f64) {
        (self.0.fx, self.0.fy, self.0.cx, self.0.cy)
    }

    /// Parameters of the distortion model.
    #[getter]
    fn distortion<'py>(&self, py: Python<'py>) -> PyResult<Parameters<'py>> {
        PyTuple::new(py, self.0.distortion_parameters())
    }

    /// The (3, 3) matrix K, px.
    #[getter]
    fn matrix(&self, py: Python<'_>) -> Table {
        to_matrix(py, &self.0.matrix())
    }

    /// Pixels of points.
    ///
    /// Parameters
    /// ----------
    /// points : (N, 3) float64
    ///     Points in the camera frame, metres.
    ///
    /// Returns
    /// -------
    /// ProjectedPoints
    ///
    /// Raises
    /// ------
    /// InputError
    ///     For a wrong shape.
    fn project(&self, py: Python<'_>, points: Argument<'_>) -> PyResult<ProjectedPoints> {
        let points = rows::<3>("points", &points)?;
        let nan = Vector2::repeat(f64::NAN);
        let (uv, visible): (Vec<Vector2<f64>>, Vec<bool>) = gate::compute(py, || {
            let pixels = points.iter().map(|p| self.0.project(p));
            let pixels = pixels.map(|uv| {
                let inside = uv.is_some_and(|uv| self.0.in_image(&uv, 0.0));
                (uv.unwrap_or(nan), inside)
            });
            pixels.unzip()
        });
        Ok(ProjectedPoints {
            uv: vectors(py, uv.into_iter()),
            visible: column(py, visible),
        })
    }

    /// Unit rays of pixels.
    ///
    /// Parameters
    /// ----------
    /// uv : (N, 2) float64
    ///     Pixels.
    ///
    /// Returns
    /// -------
    /// (N, 3) float64
    ///     Unit rays in the camera frame; NaN where the model has none.
    ///
    /// Raises
    /// ------
    /// InputError
    ///     For a wrong shape.
    fn unproject(&self, py: Python<'_>, uv: Argument<'_>) -> PyResult<Table> {
        let uv = pixels("uv", &uv)?;
        let nan = Vector3::repeat(f64::NAN);
        let rays: Vec<Vector3<f64>> = gate::compute(py, || {
            let rays = uv.iter().map(|uv| self.0.unproject(uv).unwrap_or(nan));
            rays.collect()
        });
        Ok(vectors(py, rays.into_iter()))
    }

    fn __repr__(&self) -> String {
        let c = &self.0;
        format!(
            "Camera({:?}, {}, {}, ({}, {}, {}, {}), {:?})",
            c.model(),
            c.width,
            c.height,
            c.fx,
            c.fy,
            c.cx,
            c.cy,
            c.distortion_parameters()
        )
    }

    fn __getnewargs__(&self) -> (String, u32, u32, [f64; 4], Vec<f64>) {
        let c = &self.0;
        (
            c.model().into(),
            c.width,
            c.height,
            [c.fx, c.fy, c.cx, c.cy],
            c.distortion_parameters().to_vec(),
        )
    }
}
