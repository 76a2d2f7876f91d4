//! Camera models.

use crate::arrays_in::{Argument, pixels, rows};
use crate::arrays_out::{Column, Table, column, to_matrix, vectors};
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

/// A calibrated camera.
///
/// Parameters
/// ----------
/// model : {"pinhole", "radtan", "fisheye", "wideangle"}
///     Distortion model (METHOD 4): none; OpenCV's radial-tangential; equidistant; Davison's one
///     parameter.
/// width, height : int
///     Image size, px.
/// intrinsics : sequence of 4 floats
///     ``fx, fy, cx, cy``, px.
/// distortion : sequence of floats
///     ``[]``, ``[k1, k2, p1, p2(, k3(, k4, k5, k6))]``, ``[k1, k2, k3, k4]`` or ``[K]``.
///
/// Raises
/// ------
/// InputError
///     For an unknown model, a wrong number of parameters or impossible values.
#[pyclass(name = "Camera", module = "collabslam._core", frozen, eq)]
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct PyCamera(pub(crate) Camera);

#[pymethods]
impl PyCamera {
    #[new]
    #[pyo3(signature = (model, width, height, intrinsics, distortion = Vec::new()))]
    fn new(
        model: &str,
        width: u32,
        height: u32,
        intrinsics: [f64; 4],
        distortion: Vec<f64>,
    ) -> PyResult<Self> {
        Camera::new(model, width, height, intrinsics, &distortion)
            .map(Self)
            .map_err(to_python)
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
