"""Calibrations of every kind that people have give the right camera, or are refused by the key's name."""

from __future__ import annotations

import ast
import gzip
import json
import re
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import cv2
import numpy as np
import pytest

from collabslam.datasets import load_camera, open_recording
from collabslam.datasets.calibration import load_rig, read_calibration
from collabslam.datasets.gate import Fact, listening
from collabslam.datasets.lens import lens
from collabslam.datasets.poses import read_track
from collabslam.datasets.readers import collab, davison, folder, kitti, stamped, tum_rgbd, video
from collabslam.datasets.ros.messages import camera_of
from collabslam.datasets.ros.sensors import read_sensors
from collabslam.datasets.worn_calibration import WornCalibration
from collabslam.errors import DataError

DATASETS = Path(str(collab.__file__)).parents[1]
FILM: Any = SimpleNamespace(times=[0.0, 0.1])
K = [40.0, 0.0, 31.5, 0.0, 41.0, 23.5, 0.0, 0.0, 1.0]
LENS = [-0.28, 0.07, 0.0002, 2e-05]
RADTAN = ("radtan", (64, 48), (40, 41, 31.5, 23.5), tuple(LENS))
PINHOLE = ("pinhole", (64, 48), (40, 41, 31.5, 23.5), ())
OPENCV = """%YAML:1.0
---
calibration_time: "Mon 12 May 2025 10:11:12"
nr_of_frames: 25
image_width: 64
image_height: 48
board_width: 9
board_height: 6
square_size: 2.5e-02
flags: 778
fisheye_model: {fisheye}
camera_matrix: !!opencv-matrix
   rows: 3
   cols: 3
   dt: d
   data: [ 40., 0., 31.5, 0., 41., 23.5, 0., 0., 1. ]
distortion_coefficients: !!opencv-matrix
   rows: 4
   cols: 1
   dt: d
   data: [ -0.28, 0.07, 0.0002, 2e-05 ]
avg_reprojection_error: 2.1e-01
"""
SIZE = "image_width: 64\nimage_height: 48\n"
SCRIPT = f"camera_matrix: {np.reshape(K, (3, 3)).tolist()}\ndist_coeff: [{LENS}]\n{SIZE}"
KALIBR = (
    "cam0:\n  camera_model: pinhole\n  intrinsics: [40, 41, 31.5, 23.5]\n  resolution: [64, 48]\n"
    f"  distortion_model: radtan\n  distortion_coeffs: {LENS}\n  rostopic: /cam0/image_raw\n"
    "  cam_overlaps: [1]\n"
)
SECOND = (
    "cam1:\n  camera_model: pinhole\n  intrinsics: [50, 51, 31.5, 23.5]\n  resolution: [64, 48]\n"
    f"  distortion_model: equidistant\n  distortion_coeffs: {LENS}\n  rostopic: /cam1/image_raw\n"
    "  T_cn_cnm1: [1, 0, 0, -0.12, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]\n  timeshift_cam_imu: 0.01\n"
)
EUROC = (
    "sensor_type: camera\ncomment: left\nT_BS: {cols: 4, rows: 4, "
    "data: [1, 0, 0, 0.1, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]}\n"
    "rate_hz: 20\nresolution: [64, 48]\ncamera_model: pinhole\nintrinsics: [40, 41, 31.5, 23.5]\n"
    f"distortion_model: radial-tangential\ndistortion_coefficients: {LENS}\n"
)
VINS = (
    "%YAML:1.0\n---\nmodel_type: PINHOLE\ncamera_name: camera\nimage_width: 64\nimage_height: 48\n"
    "distortion_parameters:\n   k1: -0.28\n   k2: 0.07\n   p1: 0.0002\n   p2: 2e-05\n"
    "projection_parameters:\n   fx: 40\n   fy: 41\n   cx: 31.5\n   cy: 23.5\n"
)
VINS_FISHEYE = (
    "model_type: KANNALA_BRANDT\nimage_width: 64\nimage_height: 48\n"
    "projection_parameters: {k2: -0.28, k3: 0.07, k4: 0.0002, k5: 2.0e-05, mu: 40, mv: 41, u0: 31.5, "
    "v0: 23.5}\n"
)
ORB_SLAM = (
    '%YAML:1.0\nFile.version: "1.0"\nCamera.type: "PinHole"\nCamera1.fx: 40\nCamera1.fy: 41\n'
    "Camera1.cx: 31.5\nCamera1.cy: 23.5\n"
    "Camera1.k1: -0.28\nCamera1.k2: 0.07\nCamera1.p1: 0.0002\nCamera1.p2: 2e-05\n"
    "Camera.width: 64\nCamera.height: 48\nCamera.fps: 20\nCamera.RGB: 1\nRGBD.DepthMapFactor: 1000.0\n"
    "ORBextractor.nFeatures: 1000\nViewer.PointSize: 2.0\n"
)
NERF = {
    "w": 64, "h": 48, "fl_x": 40, "fl_y": 41, "cx": 32, "cy": 24, "k1": LENS[0], "k2": LENS[1], "p1": LENS[2],
    "p2": LENS[3], "camera_model": "OPENCV", "camera_angle_x": 1.3, "frames": [{"file_path": "a.png"}],
}  # fmt: skip
RECORD3D = {
    "w": 64,
    "h": 48,
    "fps": 20,
    "K": [40, 0, 0, 0, 41, 0, 31.5, 23.5, 1],
    "poses": [[0, 0, 0, 1, 0, 0, 0]],
}
SCENELIB = {
    "model": "wideangle", "width": 64, "height": 48, "focal_length_x": 40, "focal_length_y": 41, "skew": 0,
    "principal_point_x": 31.5, "principal_point_y": 23.5, "radial_distortion_x": 9e-6,
}  # fmt: skip
COLMAP = "# Camera list\n1 OPENCV 64 48 40 41 32 24 -0.28 0.07 0.0002 2e-05\n"
PLAIN = (
    "fx: 40\nfy: 41\ncx: 31.5\ncy: 23.5\nk1: -0.28\nk2: 0.07\np1: 0.0002\np2: 2e-05\nwidth: 64\nheight: 48\n"
)
REALSENSE = {
    "width": 64, "height": 48, "ppx": 31.5, "ppy": 23.5, "fx": 40, "fy": 41, "coeffs": [0, 0, 0, 0, 0],
    "model": "distortion.inverse_brown_conrady",
}  # fmt: skip
ECHO = (
    "header:\n  stamp:\n    sec: SEC\n  frame_id: cam\nheight: 48\nwidth: 64\ndistortion_model: plumb_bob\n"
    f"d: {[*LENS, 0.0]}\nk: {K}\nr: [1, 0, 0, 0, 1, 0, 0, 0, 1]\n"
    "p: [40, 0, 31.5, 0, 0, 41, 23.5, 0, 0, 0, 1, 0]\nbinning_x: 0\nbinning_y: 0\n"
    "roi: {x_offset: 0, y_offset: 0, height: 0, width: 0, do_rectify: false}\n---\n"
)
STELLA = (
    "Camera:\n  name: a\n  setup: monocular\n  model: perspective\n  fx: 40\n  fy: 41\n  cx: 31.5\n"
    "  cy: 23.5\n  k1: -0.28\n  k2: 0.07\n  p1: 0.0002\n  p2: 2e-05\n  fps: 20\n  cols: 64\n  rows: 48\n"
    "Feature: {name: a}\n"
)
OPENVSLAM = (
    "Camera.model: fisheye\nCamera.fx: 40\nCamera.fy: 41\nCamera.cx: 31.5\nCamera.cy: 23.5\n"
    "Camera.k1: -0.28\nCamera.k2: 0.07\nCamera.k3: 0.0002\nCamera.k4: 2e-05\n"
    "Camera.cols: 64\nCamera.rows: 48\n"
)
KB4 = dict(zip(["fx", "fy", "cx", "cy", "k1", "k2", "k3", "k4"], [40, 41, 31.5, 23.5, *LENS], strict=True))
BASALT = {
    "value0": {
        "T_imu_cam": [{"px": 0}],
        "intrinsics": [{"camera_type": "kb4", "intrinsics": KB4}],
        "resolution": [[64, 48]],
    }
}
INSTANT_NGP = {k: v for k, v in NERF.items() if k not in ("camera_model", "p1", "p2")} | {
    "is_fisheye": True,
    "k3": LENS[2],
    "k4": LENS[3],
}
XML = (
    '<?xml version="1.0"?>\n<opencv_storage>\n<image_width>64</image_width>\n'
    "<image_height>48</image_height>\n"
    '<camera_matrix type_id="opencv-matrix">\n  <rows>3</rows>\n  <cols>3</cols>\n  <dt>d</dt>\n'
    f"  <data>\n    {' '.join(map(str, K))}</data></camera_matrix>\n"
    '<distortion_coefficients type_id="opencv-matrix">\n  <rows>5</rows>\n  <cols>1</cols>\n  <dt>d</dt>\n'
    f"  <data>\n    {' '.join(map(str, LENS))} 0.</data></distortion_coefficients>\n</opencv_storage>\n"
)
FISHEYE = ("fisheye", *RADTAN[1:])
# As the sample of OpenCV 2 wrote it.
OPENCV_2 = (
    "%YAML:1.0\n---\ncalibration_Time: x\nnrOfFrames: 25\nimage_Width: 64\nimage_Height: 48\nflagValue: 14\n"
    f"Camera_Matrix: !!opencv-matrix\n   rows: 3\n   cols: 3\n   dt: d\n   data: {K}\n"
    f"Distortion_Coefficients: !!opencv-matrix\n   rows: 4\n   cols: 1\n   dt: d\n   data: {LENS}\n"
    "Avg_Reprojection_Error: 2.1e-01\n"
)
FILES = {
    "opencv-2": (OPENCV_2, RADTAN),
    "plain": (PLAIN, RADTAN),
    "plain-straight": (
        re.sub(r"(?m)^[kp](\d): .*$", r"k\1: 0", PLAIN.replace("p1", "k3").replace("p2", "k4")),
        PINHOLE,
    ),
    "plain-fisheye": (PLAIN.replace("p1", "k3").replace("p2", "k4") + "distortion_model: kb4\n", FISHEYE),
    "realsense": (json.dumps(REALSENSE), PINHOLE),
    "echo": (ECHO.replace("SEC", "1") + ECHO.replace("SEC", "2"), RADTAN),
    "stella": (STELLA, RADTAN),
    "openvslam": (OPENVSLAM, FISHEYE),
    "basalt": (json.dumps(BASALT), FISHEYE),
    "instant-ngp": (json.dumps(INSTANT_NGP), FISHEYE),
    "open3d": (
        '{"width": 64, "height": 48, "intrinsic_matrix": [40, 0, 0, 0, 41, 0, 31.5, 23.5, 1]}',
        PINHOLE,
    ),
    "xml": (XML, RADTAN),
    "dso": ("RadTan 40 41 31.5 23.5 -0.28 0.07 0.0002 0.00002\n64 48\ncrop\n64 48\n", RADTAN),
    "dso-shares": ("Pinhole 0.625 0.75 0.5 0.5 0\n64 48\n", (*PINHOLE[:2], (40, 36, 31.5, 23.5), ())),
    "tabs": (PLAIN.replace(": ", ":\t"), RADTAN),
    "opencv": (OPENCV.format(fisheye=0), RADTAN),
    "opencv-fisheye": (OPENCV.format(fisheye=1), ("fisheye", *RADTAN[1:])),
    "script": (SCRIPT, RADTAN),
    "kalibr": (KALIBR, RADTAN),
    "euroc": (EUROC, RADTAN),
    "vins": (VINS, RADTAN),
    "vins-fisheye": (VINS_FISHEYE, ("fisheye", *RADTAN[1:])),
    "orb-slam": (ORB_SLAM, RADTAN),
    "nerfstudio": (json.dumps(NERF), RADTAN),
    "record3d": (json.dumps(RECORD3D), PINHOLE),
    "scenelib": (json.dumps(SCENELIB), ("wideangle", *PINHOLE[1:3], (9e-6,))),
    "colmap": (COLMAP, RADTAN),
    "pincam": ("64 48 40 41 31.5 23.5\n", PINHOLE),
}


def read(folder: Path, text: str, **more: Any) -> Any:
    path = folder / "camera.yaml"
    path.write_text(text)
    return load_camera(path, **more)


def numbers(camera: Any) -> tuple[Any, ...]:
    return camera.model, (camera.width, camera.height), camera.intrinsics, camera.distortion


@pytest.mark.parametrize("name", FILES)
def test_the_lens_is_what_the_file_says(tmp_path: Path, name: str) -> None:
    text, expected = FILES[name]
    assert numbers(read(tmp_path, text)) == expected


def test_what_stands_beside_the_lens_is_heard(tmp_path: Path) -> None:
    path = tmp_path / "settings.yaml"
    path.write_text(ORB_SLAM)
    found = read_calibration(path)
    assert (found.rate, found.depth_scale) == (20.0, 1000.0)
    path.write_text(EUROC)
    assert read_calibration(path).t_bs[0, 3] == 0.1  # type: ignore[index]


LEFT_OVER = {
    **{name: (load_camera, text) for name, (text, _) in FILES.items() if ":" in text and name != "echo"},
    "recording": (
        lambda p: collab._read_header(p.parent),
        "format: collabslam-recording\nversion: 1\nname: a\n",
    ),
    "persons": (WornCalibration.load, ""),
    "sensors": (
        read_sensors,
        "scanners: {front: {topic: /scan}}\n"
        "ahrs: {robot: {topic: /a}, worn: {topic: /b}}\ncamera_height: 0.95\n",
    ),
    "odometry": (
        lambda p: collab._read_odometry(p.parent),
        "T_BC: [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]\n",
    ),
    "start": (
        lambda p: davison._target(p.parent, p),
        json.dumps({"xv": [0] * 13, "pxx": [], "features": []}),
    ),
}


@pytest.mark.parametrize("name", LEFT_OVER)
def test_no_key_is_passed_over_without_a_word(tmp_path: Path, name: str) -> None:
    reader, text = LEFT_OVER[name]
    if name == "persons":
        WornCalibration(np.zeros(6), np.zeros((6, 6))).save(tmp_path / "sensor.yaml")
        text = (tmp_path / "sensor.yaml").read_text()
    file = tmp_path / ("recording.yaml" if name == "recording" else "sensor.yaml")
    (tmp_path / "data.csv").write_text(f"1,{','.join('0' * 27)}\n")
    strange = '{"strange": 7, ' + text.lstrip()[1:] if text.lstrip()[:1] == "{" else f"{text}strange: 7\n"
    file.write_text(strange)
    with listening() as facts:
        try:
            reader(file)
        except DataError as error:
            if "strange" in str(error):
                return
    assert any("strange" in fact.value for fact in facts if fact.what == "passed over"), facts


def test_whoever_reads_keys_refuses_those_that_nobody_asked_for() -> None:
    """`Keys` does so where the block ends that it is opened in."""
    for path in DATASETS.rglob("*.py"):
        tree = ast.parse(path.read_text())
        for function in (n for n in ast.walk(tree) if isinstance(n, ast.FunctionDef)):
            opened = [n for n in ast.walk(function) if isinstance(n, ast.Call) and _opens_keys(n)]
            blocks = [n for n in ast.walk(function) if isinstance(n, ast.With)]
            closed = [item.context_expr for block in blocks for item in block.items]
            names = {n.id for n in closed if isinstance(n, ast.Name)}
            named = [
                n.value
                for n in ast.walk(function)
                if isinstance(n, ast.Assign) and {ast.unparse(to) for to in n.targets} <= names
            ]
            if path.name != "gate.py":
                assert all(n in (*closed, *named) for n in opened), (path, function.name)


def _opens_keys(call: ast.Call) -> bool:
    name = ast.unparse(call.func)
    return name in ("read_keys", "Keys") or name.endswith(".inside")


STRICT = {
    "frame_poses",
    "named_poses",
    "lens_lines",
    "seven_scenes",
    "posed_images",
    "odometry",
    "collab",
    "files",
}
"""Modules whose tables have exactly their columns, or are none: those of columns by name tell the others."""


def test_every_reader_of_tables_tells_its_further_columns() -> None:
    for path in DATASETS.rglob("*.py"):
        text = path.read_text()
        if "data_lines(" in text and path.stem not in STRICT | {"gate"}:
            assert "leave_columns(" in text, path


@pytest.mark.parametrize(
    ("name", "text", "read", "said"),
    [
        ("rgb.txt", "0.0 0.png 7\n0.1 0.png\n", lambda p: tum_rgbd._images(p.parent, p.name), "column 3"),
        ("data.csv", "1,0.png,7,8\n2,0.png\n", lambda p: stamped.read_stream(p.parent), "columns 3 to 4"),
        ("times", "0.0 5\n0.1 5\n", lambda p: folder.read_times(p, [p, p]), "column 1"),
        ("times", "0.0 0.png 5\n0.1 0.png 5\n", lambda p: folder.read_times(p, [p, p]), "column 2"),
        ("times", "0.0 5 6\n0.1 5 6\n", lambda p: video.read_stamps(p, FILM), "columns 1 to 2"),
        ("times.txt", "0.0 5\n0.1 5\n", lambda p: kitti._times(p.parent, [p, p]), "column 2"),
        ("calib.txt", "P0: {0}\nP1: {0}\nTr: {0}\n", lambda p: kitti._projections(p, 0), "Tr:"),
        ("poses", "0 1 2 3 0 0 0 1 9\n", read_track, "column 9"),
        ("poses", "t,x,y,z,qw,qx,qy,qz,a,b\n0,1,2,3,1,0,0,0,8,9\n", read_track, "2 columns"),
    ],
)
def test_no_column_is_passed_over_without_a_word(
    tmp_path: Path, name: str, text: str, read: Any, said: str
) -> None:
    (tmp_path / name).write_text(text.format("1 0 0 0 0 1 0 0 0 0 1 0"))
    for place in (tmp_path, tmp_path / "data"):
        place.mkdir(exist_ok=True)
        cv2.imwrite(str(place / "0.png"), np.zeros((48, 64), np.uint8))
    with listening() as facts:
        read(tmp_path / name)
    assert any(said in fact.value for fact in facts if fact.what == "passed over"), facts


def test_a_rate_that_is_not_used_is_told(tmp_path: Path) -> None:
    (tmp_path / "camera.yaml").write_text(EUROC + "rate: 20\n")
    with listening() as facts:
        load_camera(tmp_path / "camera.yaml")
    assert any("rate" in fact.value for fact in facts if fact.what == "passed over")


def test_only_the_gate_reads_keys() -> None:
    for path in DATASETS.rglob("*.py"):
        if path.name == "gate.py":
            continue
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name):
                assert (node.value.id, node.attr) not in {("yaml", "safe_load"), ("json", "loads")}, path
            if isinstance(node, ast.ImportFrom):
                assert not {"load_yaml", "read_text"} & {alias.name for alias in node.names}, path


def test_what_was_read_is_told_with_its_key_and_its_file(tmp_path: Path) -> None:
    with listening() as facts:
        read(tmp_path, SCRIPT)
    path = str(tmp_path / "camera.yaml")
    assert Fact("dist_coeff", "-0.28 0.07 0.0002 2e-05", path) in facts
    assert Fact("image_width", "64", path) in facts


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (("dist_coeff", "dist_coef_"), "'dist_coef_'"),
        (("[0.0, 0.0, 1.0]", "[31.5, 23.5, 1.0]"), "not 0 0 1.*MATLAB"),
        (("[0.0, 41.0", "[0.0, 1.0"), "fx 40 and fy 1"),
        (("31.5]", "310.5]"), "centre at 310.5.*outside"),
        (("40.0, 0.0", "40.0, 3.0"), "skew"),
        (("image_width: 64", "image_width: 64000"), "focal length of 40 for 64000"),
        (("image_width: 64", "image_width: 64\nimage_width: 64"), "'image_width' stands twice"),
        ((f"dist_coeff: [{LENS}]", "distortion_model: plumb_bob"), "'plumb_bob' and has 0"),
        ((f"dist_coeff: [{LENS}]", "cam0_calib: a.yaml"), "another file .a.yaml"),
    ],
)  # fmt: skip
def test_what_no_camera_has_is_refused(tmp_path: Path, change: tuple[str, str], words: str) -> None:
    assert change[0] in SCRIPT
    with pytest.raises(DataError, match=words):
        read(tmp_path, SCRIPT.replace(*change))


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (ECHO.replace("x_offset: 0", "x_offset: 10"), "cropped"),
        (ECHO + ECHO.replace("40.0", "50.0"), "documents that differ"),
        (json.dumps(REALSENSE | {"coeffs": [0.1, 0, 0, 0, 0]}), "inverse_brown_conrady.*not supported"),
        (SCRIPT.replace(str(LENS), "[-0.01, 0.02, -0.03, 0.01]"), "does not say of which lens"),
        (PLAIN.replace("p1", "k3").replace("p2", "k4").replace("2e-05", "0.1"), "does not say of which lens"),
        (PLAIN.replace("40", "40,5"), "decimal comma"),
        (SCRIPT.replace(str(LENS), "[-0,28, 0,07, 0,0002, 0,00002]"), "whole numbers"),
        (KALIBR.replace("[40, 41, 31.5, 23.5]", "[40,1, 41,1, 31,5, 23,5]"), "decimal commas"),
        (KALIBR.replace("[40, 41, 31.5, 23.5]", "[50, 31.5, 50.1, 23.5]"), "looks like fx, cx, fy, cy"),
        (KALIBR.replace("[40, 41, 31.5, 23.5]", "[31.6, 23.4, 40, 41]"), "looks like cx, cy, fx, fy"),
        (KALIBR.replace("[40, 41, 31.5, 23.5]", "[40, 41, 23.4, 31.6]"), "looks like fx, fy, cy, cx"),
        ("Calibration results\n===\nCamera-system parameters:\ncam0 (/a):\n    type: b\n", "camchain.yaml"),
        (" Intrinsic of Color\n  Width:  \t64\n  PPX:  \t31.5\n Fx: 40 \n", "RealSense's list; write"),
        ("fc = [ 40 ; 41 ];\ncc = [ 31.5 ; 23.5 ];\nkc = [ 0 ; 0 ; 0 ];\n", "MATLAB toolbox's; write"),
        ("M1: [1, 2]\nD1: [0]\n", "lacks the key 'intrinsics'.*'M1', 'D1'"),
        ("<calibration><f>40</f></calibration>", "XML of another kind"),
        ('<!DOCTYPE a [<!ENTITY b "c">]><opencv_storage>&b;</opencv_storage>', "declarations"),
        (COLMAP + COLMAP.replace("\n1 ", "\n2 "), "2 cameras"),
        ("1 THIN_PRISM_FISHEYE 64 48 40 41 32 24 0 0 0 0 0 0 0 0\n", "THIN_PRISM_FISHEYE.*not read"),
        ("40 0 31.5\n0 41 23.5\n0 0 1\n", "does not say the size"),
    ],
)  # fmt: skip
def test_what_may_be_meant_in_two_ways_is_refused(tmp_path: Path, text: str, words: str) -> None:
    with pytest.raises(DataError, match=words):
        read(tmp_path, text)


def test_texts_are_utf_8_or_say_what_they_are(tmp_path: Path) -> None:
    path = tmp_path / "camera.yaml"
    path.write_bytes(PLAIN.encode("utf-16"))
    assert numbers(load_camera(path)) == RADTAN
    for data, words in (
        (gzip.compress(b"a"), "gzip"),
        (b"a: 1\n# f\xfcr\n", "line 2 is not UTF-8"),
        (b"\x93NUMPY\x01\0v\0", "an array of NumPy; write its numbers as text"),
        (b"MATLAB 5.0 MAT-file\xff", "a file of MATLAB; write"),
        (b"\x80\x04\x95", "a pickle of Python; write"),
    ):
        path.write_bytes(data)
        with pytest.raises(DataError, match=words):
            load_camera(path)


def test_arrays_of_numpy_are_named(tmp_path: Path) -> None:
    np.savez(tmp_path / "calib.npz", mtx=np.eye(3))
    with pytest.raises(DataError, match="arrays of NumPy; write its numbers as text"):
        load_camera(tmp_path / "calib.npz")


def test_numbers_may_stand_by_their_names(tmp_path: Path) -> None:
    text = (
        "model: radtan\nresolution: {width: 64, height: 48}\n"
        "intrinsics: {cy: 23.5, fx: 40, fy: 41, cx: 31.5}\n"
        "distortion: {k1: -0.28, k2: 0.07, p1: 0.0002, p2: 2e-05}\n"
    )
    assert numbers(read(tmp_path, text)) == RADTAN
    with pytest.raises(DataError, match=r"'intrinsics' of .* is not a list of numbers"):
        read(tmp_path, text.replace("cy: 23.5, ", ""))


@pytest.mark.parametrize("name", ["colmap", "pincam", "dso", "xml"])
def test_a_recording_takes_a_lens_without_keys(tmp_path: Path, name: str) -> None:
    for k in range(3):
        cv2.imwrite(str(tmp_path / f"{k}.png"), np.full((48, 64), 100 + k, np.uint8))
    (tmp_path / "lens").write_text(FILES[name][0])
    (tmp_path / "times").write_text("0.0\n0.1\n0.2\n")
    recording = open_recording(tmp_path, camera=tmp_path / "lens", times=tmp_path / "times")
    assert numbers(recording.camera) == FILES[name][1]


def test_a_camchain_gives_the_camera_that_is_meant(tmp_path: Path) -> None:
    chain = KALIBR + SECOND
    assert read(tmp_path, chain).intrinsics[0] == 40
    assert read(tmp_path, chain, topic="/cam1/image_raw/compressed").intrinsics[0] == 50
    with pytest.raises(DataError, match=r"images of /other/image_raw.*cam0: /cam0/image_raw"):
        read(tmp_path, chain, topic="/other/image_raw")
    (tmp_path / "cam1.yaml").write_text(chain)
    assert load_camera(tmp_path / "cam1.yaml").intrinsics[0] == 50
    camera, t_cf, shift = load_rig(tmp_path / "cam1.yaml")
    assert (camera.intrinsics[0], t_cf[0, 3], shift) == (50, 0.12, 0.01)
    camera, t_cf, shift = load_rig(tmp_path / "cam1.yaml", ("/cam1/image_raw", "/cam0/image_raw"))
    assert (camera.intrinsics[0], t_cf[0, 3], shift) == (40, -0.12, -0.01)


def message(d: list[float], p: list[float], model: str = "plumb_bob") -> Any:
    roi = SimpleNamespace(width=64, height=48, x_offset=0, y_offset=0)
    return SimpleNamespace(
        k=np.array(K), d=np.array(d), r=np.eye(3).ravel(), p=np.array(p), width=64, height=48, roi=roi,
        binning_x=0, binning_y=0, distortion_model=model,
    )  # fmt: skip


def test_rectified_images_have_the_lens_p() -> None:
    p = [34.0, 0, 31, 0, 0, 34, 23, 0, 0, 0, 1, 0]
    camera = camera_of(message(LENS, p), "x", "/cam/image_rect_color/compressed")
    assert numbers(camera) == ("pinhole", (64, 48), (34, 34, 31, 23), ())
    assert camera_of(message(LENS, p), "x", "/cam/imageRectified").model == "pinhole"
    assert camera_of(message(LENS, p), "x", "/cam/direct/image_raw").model == "radtan"
    with pytest.raises(DataError, match="undistorted by their name"):
        camera_of(message(LENS, p), "x", "/cam/image_undistorted")
    raw = [40.0, 0, 31.5, 0, 0, 41, 23.5, 0, 0, 0, 1, 0]
    assert camera_of(message([], raw), "x").model == "pinhole"  # nothing is changed by rectifying it
    with pytest.raises(DataError, match="'plumb_bob' and has 0 numbers"):
        camera_of(message([], p), "x")


def test_a_rational_lens_is_opencvs() -> None:
    """Eight numbers as of an Azure Kinect."""
    d = [0.536, -2.62, 8e-4, -1.4e-4, 1.52, 0.414, -2.45, 1.45]
    camera = lens("rational_polynomial", (1280, 720), (608, 608.5, 638, 366), d, "x")
    uv = np.stack(np.meshgrid(np.linspace(0, 1279, 9), np.linspace(0, 719, 7)), -1).reshape(-1, 2)
    rays = camera.unproject(uv)
    expected = cv2.projectPoints(rays[:, None], np.zeros(3), np.zeros(3), camera.matrix, np.array(d))[0][:, 0]
    np.testing.assert_allclose(uv, expected, atol=1e-8)


def test_lenses_of_other_models_are_carried_to_the_nearest() -> None:
    xi, alpha = -0.17, 0.59
    camera = lens("ds", (512, 512), (xi, alpha, 158, 158, 255, 256), (), "x")
    rays = np.random.default_rng(0).uniform(-1.5, 1.5, (50, 3))
    rays[:, 2] = 1.0
    # Usenko, Demmel and Cremers (2018), equations 40 to 45.
    d1 = np.linalg.norm(rays, axis=1)
    z = xi * d1 + rays[:, 2]
    d2 = np.sqrt(rays[:, 0] ** 2 + rays[:, 1] ** 2 + z**2)
    expected = 158 * rays[:, :2] / (alpha * d2 + (1 - alpha) * z)[:, None] + (255, 256)
    assert np.abs(camera.project(rays).uv - expected).max() < 0.05
    with pytest.raises(DataError, match="px off"):
        lens("omni", (512, 512), (1.4, 500, 500, 255, 256), (-0.3, 0.1, 0.02, 0.02), "x")
    assert lens("eucm", (64, 48), (0.5, 1.0, 40, 41, 31.5, 23.5), (), "x").model == "fisheye"
    assert lens("fov", (64, 48), (40, 41, 31.5, 23.5), (0.9,), "x").model == "fisheye"
