//! `collabslam._core`: the Python face of `ekf_core` and `frontend`. No mathematics and no defaults live here.

mod camera;
mod convert;
mod errors;
mod filter;
mod frontend;
mod settings;

use pyo3::prelude::*;

/// The compiled filter core of collabslam.
#[pymodule]
fn _core(m: &Bound<'_, PyModule>) -> PyResult<()> {
    m.add("__version__", env!("CARGO_PKG_VERSION"))?;
    m.add_class::<camera::PyCamera>()?;
    m.add_class::<filter::PyFilter>()?;
    m.add_class::<filter::PyUpdateReport>()?;
    m.add_function(wrap_pyfunction!(settings::settings_schema, m)?)?;
    m.add_function(wrap_pyfunction!(frontend::search_templates, m)?)?;
    m.add_function(wrap_pyfunction!(frontend::align_templates, m)?)?;
    m.add_function(wrap_pyfunction!(frontend::affine_maps, m)?)?;
    m.add_function(wrap_pyfunction!(frontend::affine_at, m)?)?;
    m.add_function(wrap_pyfunction!(frontend::warp_patches, m)?)?;
    m.add_function(wrap_pyfunction!(frontend::capture_windows, m)?)?;
    m.add_function(wrap_pyfunction!(frontend::corner_peaks, m)?)?;
    m.add_function(wrap_pyfunction!(frontend::spread_corners, m)?)?;
    m.add_function(wrap_pyfunction!(frontend::match_pairs, m)?)?;
    m.add_function(wrap_pyfunction!(frontend::sample_templates, m)?)?;
    m.add_function(wrap_pyfunction!(frontend::describe_windows, m)?)?;
    m.add_function(wrap_pyfunction!(frontend::epipolar_residuals, m)?)?;
    m.add_function(wrap_pyfunction!(frontend::find_consensus, m)?)?;
    Ok(())
}
