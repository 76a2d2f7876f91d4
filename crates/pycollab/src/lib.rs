//! `collabslam._core`: the Python face of `ekf_core` and `frontend`. No mathematics and no defaults live here.

mod arrays_in;
mod arrays_out;
mod camera;
mod camera_names;
mod errors;
mod filter;
mod frontend;
mod gate;
mod geometry;
mod graph;
mod settings;
mod submap;
mod turn;

use pyo3::prelude::*;

/// The compiled core of collabslam: the filter, the cameras, and the inner loops of the front end.
#[pymodule]
mod _core {
    #[pymodule_export]
    #[expect(non_upper_case_globals, reason = "Python's name for it")]
    const __version__: &str = env!("CARGO_PKG_VERSION");

    /// Samples along the side of a window that is described.
    #[pymodule_export]
    const DESCRIPTOR_SAMPLES: usize = ::frontend::describe::SAMPLES;

    /// Fewest matches that tell one pose.
    #[pymodule_export]
    const FEWEST_MATCHES: usize = ekf_core::FEWEST_MATCHES;

    /// Largest rate about an axis that a gyroscope is believed, rad/s: twice what common sensors can measure.
    #[pymodule_export]
    const FASTEST_RATE: f64 = ekf_core::FASTEST_RATE;

    /// Longest silence between two stamps of one source, seconds; beyond it they are taken to be wrong.
    #[pymodule_export]
    const LONGEST_GAP: f64 = ekf_core::LONGEST_GAP;

    /// Longest time between two samples of a gyroscope that the rate is known in, seconds.
    #[pymodule_export]
    const GYRO_GAP: f64 = ekf_core::GYRO_GAP;

    /// Longest time that one sample of odometry tells of, seconds.
    #[pymodule_export]
    const ODOMETRY_GAP: f64 = ekf_core::ODOMETRY_GAP;

    /// Largest coordinate of a pixel that is taken, pixels.
    #[pymodule_export]
    const LARGEST_PIXEL: f64 = ekf_core::LARGEST_PIXEL;

    /// Largest time stamp that is taken, seconds: some thousand years.
    #[pymodule_export]
    const LAST_TIME: f64 = ekf_core::LAST_TIME;

    /// Largest relative error of a landmark's range with which it is kept, or helps to find the camera.
    #[pymodule_export]
    const MAX_RANGE_RATIO: f64 = ekf_core::MAX_RANGE_RATIO;

    /// Most frames whose poses the filter keeps for views of Cf of another time.
    #[pymodule_export]
    const MOST_KEPT_POSES: usize = ekf_core::MOST_KEPT_POSES;

    /// Information of a direction, over what was thought possible, from which on it counts as told: its
    /// standard deviation falls to a third.
    #[pymodule_export]
    const TOLD_INFORMATION: f64 = ekf_core::TOLD_INFORMATION;

    /// Level of a test that calls something impossible: right ones fail it once in ten thousand.
    #[pymodule_export]
    const SURE_LEVEL: f64 = ekf_core::chi2::SURE_LEVEL;

    /// Standard deviation of each component of the velocity of Cs where nothing tells it, m/s.
    #[pymodule_export]
    const UNKNOWN_SPEED: f64 = ekf_core::UNKNOWN_SPEED;

    /// The same of its angular velocity, rad/s.
    #[pymodule_export]
    const UNKNOWN_TURN: f64 = ekf_core::UNKNOWN_TURN;

    #[pymodule_export]
    use crate::camera::{ProjectedPoints, PyCamera};
    #[pymodule_export]
    use crate::filter::measurements::{PyDepthMeasurement, PyWornMeasurement};
    #[pymodule_export]
    use crate::filter::{
        Block, CandidateReport, CandidateViews, PyConditionalPrediction, PyFilter, PyKnownMap,
        PyLandmarks, PyMapRelocalisation, PyMeasurementOutcomes, PyOverlap, PyPrediction,
        PyUpdateReport,
    };
    #[pymodule_export]
    use crate::frontend::consensus::{
        Consensus, EpipolarResiduals, MatchNoise, epipolar_residuals, find_consensus,
    };
    #[pymodule_export]
    use crate::frontend::corners::{corner_peaks, spread_corners};
    #[pymodule_export]
    use crate::frontend::describe::describe_windows;
    #[pymodule_export]
    use crate::frontend::pairs::{PairMatches, PairOptions, PairPoints, match_pairs};
    #[pymodule_export]
    use crate::frontend::patch::{
        SampledTemplates, WarpedPatches, Windows, capture_windows, sample_templates, warp_patches,
    };
    #[pymodule_export]
    use crate::frontend::search::{
        ExpectedPixels, PeakTest, SearchResult, SearchWindow, search_templates,
    };
    #[pymodule_export]
    use crate::frontend::warp::{AffineMaps, WarpLimits, affine_at, affine_maps};
    #[pymodule_export]
    use crate::geometry::{
        adjoint, chi2_quantile, fixed_to_tangent, interpolate_pose, is_rotation, left_jacobian,
        pose_inverse, quaternion_wxyz, ray_angles, rotation_exp, rotation_from_quaternion,
        rotation_log, se3_exp, se3_log, skew, tangent_to_fixed,
    };
    #[pymodule_export]
    use crate::graph::{PyFactor, PyPoseGraph, PyPosedNode};
    #[pymodule_export]
    use crate::settings::{
        BirthSettings, CalibrationSettings, EstimatorSettings, ImuSettings, LostSettings,
        MapSettings, OdometrySettings, OverlapSettings, PixelSettings, ProcessSettings,
        PyFilterSettings, ValidateSettings, WornSettings, settings_schema,
    };
    #[pymodule_export]
    use crate::submap::{PyEdge, PySubmap, PySubmapLandmarks, PySubmapPnp};
    #[pymodule_export]
    use crate::turn::Turn;
}
