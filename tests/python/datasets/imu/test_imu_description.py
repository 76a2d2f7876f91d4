"""How an inertial sensor sits: Kalibr's, EuRoC's, ORB-SLAM3's and our own files, and axes by name."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import yaml

from collabslam.datasets.gate import listening
from collabslam.datasets.imu.beside import GyroGiven
from collabslam.datasets.imu.description import MOUNTS, mapping, of_camera_file, read_imu_file
from collabslam.errors import DataError
from collabslam.geometry import pose, pose_inverse, rotation_exp
from collabslam.types import Imu

R_CI = rotation_exp([0.3, -1.2, 0.4])
T_CI = pose(R_CI, [0.1, 0.2, 0.3])
KALIBR = """
accelerometer_noise_density: 0.01
accelerometer_random_walk: 0.0002
gyroscope_noise_density: 0.005
gyroscope_random_walk: 4.0e-06
rostopic: /imu0
update_rate: 200.0
"""
LENS = {
    "camera_model": "pinhole", "intrinsics": [30.0, 31.0, 15.5, 11.5], "distortion_model": "radtan",
    "distortion_coeffs": [0.0, 0.0, 0.0, 0.0], "resolution": [32, 24], "rostopic": "/cam0/image_raw",
}  # fmt: skip


def written(path: Path, content: object) -> Path:
    path.write_text(content if isinstance(content, str) else yaml.safe_dump(content))
    return path


def test_kalibrs_imu_yaml(tmp_path: Path) -> None:
    with listening() as facts:
        found = read_imu_file(written(tmp_path / "imu.yaml", KALIBR))
    assert found.numbers == {"gyro_noise": 0.005, "gyro_bias_walk": 4e-6, "accel_noise": 0.01}
    assert found.r_ci is None
    assert any("rostopic" in fact.value and fact.what == "passed over" for fact in facts)
    # Its report of a calibration has the same in a block, with more.
    block = yaml.safe_load(KALIBR) | {
        "T_i_b": np.eye(4).tolist(), "time_offset": 0.0, "model": "scale-misalignment",
        "gyroscopes": {"M": np.eye(3).tolist(), "A": np.zeros((3, 3)).tolist(), "C_gyro_i": R_CI.T.tolist()},
        "accelerometers": {"M": np.eye(3).tolist()}, "T_cam_imu": np.eye(4).tolist(),
    }  # fmt: skip
    found = read_imu_file(written(tmp_path / "imu-calibrated.yaml", {"imu0": block}))
    assert found.r_ci is not None
    np.testing.assert_allclose(found.r_ci, R_CI, atol=1e-12)
    block["gyroscopes"]["M"] = [[1.2, 0, 0], [0, 1.0, 0], [0, 0, 1.0]]
    with pytest.raises(DataError, match="scales or skews the gyroscope by more than 5 %"):
        read_imu_file(written(tmp_path / "skewed.yaml", {"imu0": block}))


def test_a_camchain_tells_mount_and_clock(tmp_path: Path) -> None:
    """Kalibr: T_cam_imu maps points of the IMU into the camera, and t_imu = t_cam + timeshift_cam_imu."""
    content = {
        "cam0": LENS | {"T_cam_imu": T_CI.tolist(), "timeshift_cam_imu": 0.007},
        "cam1": LENS | {"T_cam_imu": np.eye(4).tolist(), "T_cn_cnm1": np.eye(4).tolist()},
    }
    file = written(tmp_path / "camchain-imucam.yaml", content)
    for found in (read_imu_file(file), of_camera_file(file)):
        assert found.r_ci is not None
        np.testing.assert_allclose(found.r_ci, R_CI, atol=1e-12)
        assert found.numbers == {"time_offset": -0.007}
    inverse = {"cam0": LENS | {"T_imu_cam": pose_inverse(T_CI).tolist()}}
    found = read_imu_file(written(tmp_path / "inverse.yaml", inverse))
    assert found.r_ci is not None
    np.testing.assert_allclose(found.r_ci, R_CI, atol=1e-12)
    # A camchain of cameras alone tells nothing, and is not a description of a sensor.
    file = written(tmp_path / "camchain.yaml", {"cam0": LENS})
    assert of_camera_file(file).r_ci is None
    with pytest.raises(DataError, match="does not say how the sensor sits"):
        read_imu_file(file)


def test_what_is_told_twice_is_believed_from_the_first(tmp_path: Path) -> None:
    noise = read_imu_file(written(tmp_path / "imu.yaml", KALIBR))
    chain = {"cam0": LENS | {"T_cam_imu": T_CI.tolist(), "timeshift_cam_imu": 0.007}}
    both = noise.over(of_camera_file(written(tmp_path / "chain.yaml", chain)))
    assert both.r_ci is not None
    assert both.numbers["gyro_noise"] == 0.005
    assert both.numbers["time_offset"] == -0.007
    axes = GyroGiven(imu="ros").description().over(both)
    np.testing.assert_array_equal(axes.r_ci, MOUNTS["ros"])
    assert axes.numbers == both.numbers


def test_orb_slams_settings(tmp_path: Path) -> None:
    text = f"""%YAML:1.0
File.version: "1.0"
Camera.type: "PinHole"
Camera1.fx: 458.654
ORBextractor.nFeatures: 1000
IMU.NoiseGyro: 1.7e-4
IMU.NoiseAcc: 2.0e-3
IMU.GyroWalk: 1.9393e-05
IMU.AccWalk: 3.0e-03
IMU.Frequency: 200.0
IMU.T_b_c1: !!opencv-matrix
   rows: 4
   cols: 4
   dt: f
   data: {pose_inverse(T_CI).ravel().tolist()}
"""
    found = read_imu_file(written(tmp_path / "EuRoC.yaml", text))
    assert found.r_ci is not None
    np.testing.assert_allclose(found.r_ci, R_CI, atol=1e-12)
    assert found.numbers == {"gyro_noise": 1.7e-4, "gyro_bias_walk": 1.9393e-5, "accel_noise": 2e-3}


def test_our_own_reads_back_as_it_was_written(tmp_path: Path) -> None:
    sensor = Imu(R_CI, 0.01, 1e-3, 0.02, 1e-4, 0.01, 0.004, 0.002, 0.01, 0.1)
    found = read_imu_file(written(tmp_path / "imu.yaml", mapping(sensor)))
    assert found.r_ci is not None
    again = found.sensor(found.r_ci)
    np.testing.assert_allclose(again.r_ci, R_CI, atol=1e-12)
    for name in ("mount_sd", "gyro_noise", "gyro_bias_sd", "gyro_bias_walk", "gyro_scale_sd", "time_offset",
                 "time_offset_sd", "accel_noise", "accel_bias_sd"):  # fmt: skip
        assert getattr(again, name) == pytest.approx(getattr(sensor, name), rel=1e-12)
    plain = read_imu_file(written(tmp_path / "plain.yaml", mapping(Imu(np.eye(3)))))
    assert plain.numbers == {"time_offset": 0.0}
    assert read_imu_file(written(tmp_path / "axes.yaml", "axes: phone-left\n")).r_ci is MOUNTS["phone-left"]


def test_the_axes_of_a_phone() -> None:
    """x right, y up, z out of the screen; its camera looks out of its back."""
    back = [0.0, 0.0, -1.0]
    for name, up in (
        ("opengl", [0.0, 1.0, 0.0]),
        ("phone-left", [1.0, 0.0, 0.0]),
        ("phone-right", [-1.0, 0, 0]),
    ):
        np.testing.assert_array_equal(MOUNTS[name] @ back, [0.0, 0.0, 1.0])
        np.testing.assert_array_equal(MOUNTS[name] @ up, [0.0, -1.0, 0.0])
        assert np.linalg.det(MOUNTS[name]) == pytest.approx(1.0)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ({"gyroscope_noise_densty": 0.1}, "not understood.*gyroscope_noise_densty"),
        ({"gyroscope_noise_density": -0.1}, "gyroscope_noise_density.*positive"),
        ({"gyroscope_noise_density": 17.0}, "gyroscope_noise_density.*at most 1"),
        ({"gyroscope_noise_density": float("nan")}, "not finite"),
        ({"gyro_bias_sd": -1.0}, "gyro_bias_sd.*positive"),
        ({"T_cam_imu": [0.0] * 15}, "has 15 numbers; 16"),
        ({"T_cam_imu": (2.0 * np.eye(4)).ravel().tolist()}, "not a rotation"),
        ({"T_cam_imu": np.diag([1.0, 1.0, -1.0, 1.0]).ravel().tolist()}, "not a rotation"),
        ({"axes": "sideways"}, "no such axes as 'sideways'"),
        ({"axes": "ros", "T_cam_imu": np.eye(4).ravel().tolist()}, "both T_cam_imu and axes"),
        ({"axes": "ros", "timeshift_cam_imu": 1.7e9}, "timeshift_cam_imu.*more than 10"),
    ],
)
def test_what_cannot_be_is_refused_by_its_key(tmp_path: Path, content: object, message: str) -> None:
    with pytest.raises(DataError, match=message):
        read_imu_file(written(tmp_path / "imu.yaml", content))


def test_no_such_file(tmp_path: Path) -> None:
    with pytest.raises(DataError, match=r"no axes of that name; give an imu.yaml, or one of optical"):
        GyroGiven(imu=str(tmp_path / "imu.yaml")).description()
