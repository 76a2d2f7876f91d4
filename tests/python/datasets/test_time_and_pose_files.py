"""Stamps in any unit, names in any order and poses in any form are read as they are meant, or refused."""

from __future__ import annotations

import json
from pathlib import Path

import cv2
import numpy as np
import pytest

from collabslam.datasets import open_recording
from collabslam.datasets.frame_poses import poses_of_frames
from collabslam.datasets.gate import LONGEST_LINE, MOST_COLUMNS, data_lines, listening
from collabslam.datasets.images import list_images
from collabslam.datasets.poses import OPENGL_FROM_OPTICAL, read_track
from collabslam.datasets.recording import stamps_in_names, times_at_rate
from collabslam.datasets.units import as_nanoseconds, as_seconds, listed_stamps, read_stamps
from collabslam.errors import DataError
from collabslam.formats.trajectory import position_quaternion
from collabslam.geometry import rotation_log
from collabslam.types import Array

NS = 1_700_000_000_000_000_000
CAMERA = (
    "camera_model: pinhole\nintrinsics: [60, 60, 31.5, 23.5]\nresolution: [64, 48]\ndistortion_model: none\n"
)


def folder(path: Path, names: list[str], more: str = "rate: 20\n") -> Path:
    """Images of these names, each with its number as its brightness."""
    path.mkdir()
    for k, name in enumerate(names):
        cv2.imwrite(str(path / name), np.full((48, 64), k, np.uint8))
    (path / "camera.yaml").write_text(CAMERA + more)
    return path


@pytest.mark.parametrize("unit", [1, 10**3, 10**6, 10**9])
@pytest.mark.parametrize("start", [0, 100, 1_403_715_285])
@pytest.mark.parametrize("form", ["{}", "{:.18e}", "{:.3f}"])
def test_the_unit_is_found_by_the_years_and_the_rate(unit: int, start: int, form: str) -> None:
    times = [start * unit + k * unit // 20 if unit > 1 else start + k / 20 for k in range(12)]
    found = as_seconds(read_stamps([form.format(t) for t in times], "x"))
    np.testing.assert_allclose(found - found[0], np.arange(12) / 20, atol=1e-6)
    assert found[0] == pytest.approx(start)


def test_nanoseconds_lose_no_digit() -> None:
    stamps = [NS + 1, NS + 50_000_003]
    assert as_nanoseconds(read_stamps(map(str, stamps), "x")) == stamps
    assert as_seconds(read_stamps(["1403715285.262142976"], "x"))[0] == 1403715285.262142976


def test_a_layouts_own_unit_is_left_only_where_its_rate_is_impossible() -> None:
    own = {"usual": "nanoseconds"}
    assert as_nanoseconds(read_stamps(["5000000000", "10000000000"], "x", **own)) == [5 * 10**9, 10**10]
    assert as_nanoseconds(read_stamps(["7"], "x", **own)) == [7]
    assert (
        as_nanoseconds(read_stamps(["1403715285262", "1403715285312"], "x", **own))[0]
        == 1403715285262 * 10**6
    )


@pytest.mark.parametrize("texts", [["nan"], ["abc"], ["1e400"], ["9" * 30], ["9" * 19], ["²"], ["0", "1e13"]])
def test_what_is_no_stamp_is_refused(texts: list[str]) -> None:
    with pytest.raises(DataError):
        read_stamps(texts, "x")


def test_nanoseconds_that_lack_their_zeros_are_padded(tmp_path: Path) -> None:
    texts = [f"{1_700_000_000 + k // 20}.{k % 20 * 50_000_000}" for k in range(45)]
    found = as_seconds(read_stamps(texts, "x"))
    np.testing.assert_allclose(found - found[0], np.arange(45) / 20, atol=1e-6)
    names = folder(tmp_path / "a", [f"{text}.png" for text in texts])
    assert [p.stem for p in list_images(names)] == texts
    decimals = [f"{1_700_000_000 + 0.05 * k:.9f}".rstrip("0") for k in range(45)]
    np.testing.assert_allclose(np.diff(as_seconds(read_stamps(decimals, "x"))), 0.05, atol=1e-6)


@pytest.mark.parametrize(
    "texts",
    [
        [str(1_700_000_000 + k // 4) for k in range(12)],
        [f"{1.7e18 + 5e7 * k:.6e}" for k in range(12)],
        ["0.05"] * 12,
        [f"{0.05 * (11 - k):.2f}" for k in range(12)],
        [f"1,700,000,000,{50 * k:03d}" for k in range(12)],
    ],
    ids=["whole seconds", "digits cut off", "intervals", "reversed", "thousands"],
)
def test_stamps_of_which_most_cannot_be_used_are_refused(tmp_path: Path, texts: list[str]) -> None:
    path = folder(tmp_path / "a", [f"{k}.png" for k in range(12)])
    (tmp_path / "times").write_text("\n".join(texts))
    with pytest.raises(DataError, match=r"only . have stamps that increase"):
        open_recording(path, camera=path / "camera.yaml", times=tmp_path / "times")


@pytest.mark.parametrize("each", [1, 2])
def test_stamps_that_repeat_in_pairs_are_of_doubled_images_or_refused(tmp_path: Path, each: int) -> None:
    path = folder(tmp_path / "a", [f"{k:02d}.png" for k in range(12)])
    for k in range(12):
        cv2.imwrite(str(path / f"{k:02d}.png"), np.full((48, 64), k // each, np.uint8))
    (tmp_path / "times").write_text("".join(f"{0.1 * (k // 2):.1f}\n" for k in range(12)))
    given = {"camera": path / "camera.yaml", "times": tmp_path / "times"}
    if each == 1:
        with pytest.raises(DataError, match=r"6 of the 12 frames .* digits of the stamps were cut off"):
            open_recording(path, **given)
        return
    with listening() as facts:
        assert open_recording(path, **given).left_out == 6
    assert any("6 of 12 frames" in fact.value for fact in facts if fact.what == "passed over")


def test_names_may_stand_before_their_times(tmp_path: Path) -> None:
    path = folder(tmp_path / "a", [f"{k}.png" for k in range(3)])
    (tmp_path / "times").write_text("file,t\n" + "\n".join(f"{k}.png,{2.0 - 0.05 * k}" for k in (2, 1, 0)))
    recording = open_recording(path, camera=path / "camera.yaml", times=tmp_path / "times")
    assert [p.name for p in recording.paths] == ["2.png", "1.png", "0.png"]
    assert recording.times[0] == 1.9


@pytest.mark.parametrize(
    ("names", "words"),
    [
        ([f"{side}_{k}.png" for k in range(3) for side in ("left", "right")], "several kinds"),
        ([f"{k}.{kind}" for k in range(3) for kind in ("png", "jpg")], "several kinds"),
        ([f"{k}_cam{of}.png" for k in range(3) for of in (0, 1)], "several cameras"),
    ],
)
def test_a_folder_of_two_cameras_is_no_film(tmp_path: Path, names: list[str], words: str) -> None:
    with pytest.raises(DataError, match=words):
        list_images(folder(tmp_path / "a", names))


def test_what_is_named_otherwise_is_left_out_and_told(tmp_path: Path) -> None:
    path = folder(tmp_path / "a", ["mask.png", *(f"{k}.png" for k in (0, 1, 2, 10))])
    with listening() as facts:
        assert [p.name for p in list_images(path)] == ["0.png", "1.png", "2.png", "10.png"]
    assert any("mask.png" in fact.value for fact in facts if fact.what == "passed over")


def test_a_column_that_counts_is_no_time() -> None:
    rows = [(k, [str(k), f"{100 + k / 30:.6f}", "8.3"]) for k in range(5)]
    assert as_seconds(listed_stamps(rows, "x")[0])[1] == pytest.approx(100 + 1 / 30)
    with pytest.raises(DataError, match="counts its lines"):
        listed_stamps([(k, [str(k)]) for k in range(5)], "x")
    for ticks in (512, 3003, 4500):  # of a film, of whose clock nobody says how many there are in a second
        with pytest.raises(DataError, match="ticks"):
            listed_stamps([(k, [str(ticks * k)]) for k in range(5)], "x")


def test_images_come_in_the_order_of_their_numbers(tmp_path: Path) -> None:
    path = folder(tmp_path / "a", [f"{k}.png" for k in range(12)])
    recording = open_recording(path, camera=path / "camera.yaml")
    assert [int(recording.image(k)[0, 0]) for k in range(12)] == list(range(12))
    np.testing.assert_allclose(np.diff(recording.times), 0.05)
    path = folder(tmp_path / "b", ["1.05.png", "1.1.png", "1.2.png"])
    assert [p.stem for p in list_images(path)] == ["1.05", "1.1", "1.2"]


def test_names_that_count_to_the_base_16_are_in_order(tmp_path: Path) -> None:
    for k, form in enumerate(("frame_{:04x}.png", "{:x}.png", "IMG{:03X}.png")):
        names = [form.format(n) for n in range(5, 40)]
        path = folder(tmp_path / str(k), names)
        recording = open_recording(path, camera=path / "camera.yaml")
        assert [p.name for p in recording.paths] == names
        np.testing.assert_allclose(recording.times, np.arange(35) / 20)


@pytest.mark.parametrize(
    "names",
    [
        ["one.png", "two.png", "three.png"],
        ["3f9a.png", "a01c.png", "b7d0.png"],
        ["0_9.png", "1_0.png", "x.png"],
    ],
    ids=["words", "hashes", "some without"],
)
def test_names_that_tell_no_order_are_refused(tmp_path: Path, names: list[str]) -> None:
    path = folder(tmp_path / "a", names)
    with pytest.raises(DataError, match="have no numbers that increase, and tell no order"):
        open_recording(path, camera=path / "camera.yaml")
    (tmp_path / "times").write_text("".join(f"{0.05 * k:.2f} {name}\n" for k, name in enumerate(names)))
    recording = open_recording(path, camera=path / "camera.yaml", times=tmp_path / "times")
    assert [p.name for p in recording.paths] == names


def test_a_counter_that_ran_over_is_refused(tmp_path: Path) -> None:
    names = [f"IMG_{(9990 + k) % 10000:04d}.JPG" for k in range(20)]
    with pytest.raises(DataError, match=r"from IMG_9999.JPG to IMG_0000.JPG: IMG_9990.JPG is the first"):
        list_images(folder(tmp_path / "a", names))


@pytest.mark.parametrize("power", [3, 6, 9])
def test_numbers_in_names_that_fit_the_rate_as_times_are_times(power: int) -> None:
    names = [Path(f"{round(k * 10**power / 30):012d}.png") for k in range(8)]
    np.testing.assert_allclose(times_at_rate(names, 30.0), np.arange(8) / 30, atol=6e-4)
    np.testing.assert_allclose(
        times_at_rate([Path(f"{5 * k}.png") for k in range(8)], 30.0), np.arange(8) / 6
    )


def test_stamps_in_names_hold_whatever_the_rate_says(tmp_path: Path) -> None:
    path = folder(tmp_path / "a", [f"{NS + 50_000_000 * k}.png" for k in range(12)], "rate: 30\n")
    with listening() as facts:
        recording = open_recording(path, camera=path / "camera.yaml")
    np.testing.assert_allclose(np.diff(recording.times), 0.05, atol=1e-6)
    assert any("rate" in fact.value for fact in facts if fact.what == "passed over")
    for unit in (10**3, 10**6):
        found = stamps_in_names([Path(f"img_{(1_700_000_000 * 20 + k) * unit // 20}.png") for k in range(3)])
        assert found is not None
        np.testing.assert_allclose(np.diff(found), 0.05, atol=1e-6)
    assert stamps_in_names([Path(f"frame_{k}.png") for k in range(3)]) is None


def test_seconds_and_nanoseconds_may_stand_in_two_columns() -> None:
    rows = [(k, [str(1_700_000_000 + k // 20), str(k % 20 * 50_000_000)]) for k in range(45)]
    stamps, _ = listed_stamps(rows, "x")
    np.testing.assert_allclose(np.diff(as_seconds(stamps)), 0.05, atol=1e-6)


def test_degrees_of_the_earth_are_no_positions(tmp_path: Path) -> None:
    (tmp_path / "p").write_text("time,latitude,longitude,altitude,qx,qy,qz,qw\n0,48,11,500,0,0,0,1\n")
    with pytest.raises(DataError, match="latitude and longitude are degrees"):
        poses_of_frames(tmp_path / "p", np.arange(1.0))


def test_names_count_by_the_number_that_rises() -> None:
    np.testing.assert_allclose(times_at_rate([Path(f"a_{k}_v2.png") for k in range(3)], 10.0), [0, 0.1, 0.2])
    with pytest.raises(DataError, match="times of day"):
        times_at_rate([Path("IMG_20240501_101158.jpg"), Path("IMG_20240501_101201.jpg")], 10.0)
    with pytest.raises(DataError, match="times of day"):
        times_at_rate([Path(f"2026-05-01T10-11-{k}.png") for k in range(12, 16)], 10.0)


@pytest.mark.parametrize("stamps", [[0.0, 1e-5, 2e-5], [0.0, 0.05, 0.1, 2e5, 2e5 + 0.05, 2e5 + 0.1]])
def test_rates_and_gaps_that_no_camera_has_are_refused(tmp_path: Path, stamps: list[float]) -> None:
    path = folder(tmp_path / "a", [f"{k}.png" for k in range(len(stamps))])
    (path / "times.txt").write_text("".join(f"{t!r}\n" for t in stamps))
    with pytest.raises(DataError, match="no camera"):
        open_recording(path, camera=path / "camera.yaml", times=path / "times.txt")


@pytest.mark.parametrize("text", ["0,05\n0,1\n", "1 0,5 2\n", "0,1;0,2;1\n"])
def test_decimal_commas_are_refused_by_name(tmp_path: Path, text: str) -> None:
    (tmp_path / "a.csv").write_text(text)
    with pytest.raises(DataError, match="decimal comma"):
        data_lines(tmp_path / "a.csv")


def test_columns_may_have_names_and_semicolons(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text("t;x\n1.5;2\n")
    assert data_lines(tmp_path / "a.csv") == [(2, ["1.5", "2"])]


# --- poses ------------------------------------------------------------------------------------

TIMES = np.arange(12) * 0.05
QUATERNION = (0.1, 0.2, 0.3, np.sqrt(1 - 0.14))
"""x y z w."""


def pose(k: int) -> Array:
    x, y, z, w = QUATERNION
    out = np.eye(4)
    out[:3, :3] = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
    out[0, 3] = 0.1 * k
    return out


def line(stamp: object, k: int, order: str = "xyzw") -> str:
    q = dict(zip("xyzw", QUATERNION, strict=True))
    return f"{stamp} {0.1 * k:.6f} 0 0 " + " ".join(f"{q[a]:.9f}" for a in order)


def columns_turned(k: int) -> str:
    """As a data frame is written: quoted, with its index, the quaternion first."""
    stamp, x, y, z, *q = line(0.05 * k, k, "wxyz").split()
    return ",".join(f'"{text}"' for text in (k, stamp, *q, x, y, z))


def written(path: Path, lines: list[str]) -> Path:
    (path / "poses.txt").write_text("\n".join(lines) + "\n")
    return path / "poses.txt"


TRUE = np.array([pose(k) for k in range(12)])


@pytest.mark.parametrize(
    "lines",
    [
        [line(f"{0.05 * k:.3f}", k) for k in range(12)],
        [line(50 * k, k) for k in range(12)],
        [line(50_000_000 * k, k) for k in range(12)],
        [line(k, k) for k in range(12)],
        [line(k + 1, k) for k in range(12)],
        [f"{k} " + line(f"{0.05 * k:.3f}", k) for k in range(12)],
        [" ".join(f"{v:.9f}" for v in pose(k)[:3].ravel()) for k in range(12)],
        [" ".join(f"{v:.9f}" for v in pose(k).ravel()) for k in range(12)],
        ["#timestamp [ns], p_RS_R_x [m], p_y, p_z, q_RS_w [], q_RS_x [], q_RS_y [], q_RS_z []"]
        + [line(50_000_000 * k, k, "wxyz").replace(" ", ",") for k in range(12)],
        ["# by a robot", "# .position.x, y, z, orientation.w, orientation.x, orientation.y, orientation.z"]
        + [line(0.05 * k, k, "wxyz") for k in range(12)],
        ["timestamp, frame, x, y, z, qx, qy, qz, qw"]
        + [line(f"{0.05 * k:.3f} {k + 7:06d}", k).replace(" ", ", ") for k in range(12)],
        [
            "%time,field.header.seq,field.header.frame_id,"
            + ",".join(f"field.pose.position.{a}" for a in "xyz")
            + "".join(f",field.pose.orientation.{a}" for a in "xyzw")
        ]
        + [line(f"{50_000_000 * k},{k},world", k).replace(" ", ",") for k in range(12)],
        ['"","t","qw","qx","qy","qz","tx","ty","tz"'] + [columns_turned(k) for k in range(12)],
        ["# timestamp(s) tx ty tz qx qy qz qw P1 P2"] + [f"{line(0.05 * k, k)} 0.1 0.2" for k in range(12)],
        [f"{0.05 * k:.3f} " + " ".join(f"{v:.9f}" for v in pose(k)[:3].ravel()) for k in range(12)],
        [f"{0.05 * k:.3f} " + " ".join(f"{v:.9f}" for v in pose(k).ravel()) for k in range(12)],
        ["time,tx,ty,tz,qw,qx,qy,qz"] + [line(0.05 * k, k, "wxyz").replace(" ", ", ") for k in range(12)],
        ["# kapture format: 1.1", "# timestamp, device_id, qw, qx, qy, qz, tx, ty, tz"]
        + [f"{k}, cam0, " + ", ".join(columns_turned(k).replace('"', "").split(",")[2:]) for k in range(12)],
    ],
    ids=[
        "tum",
        "ms",
        "ns",
        "ids",
        "ids from 1",
        "id and stamp",
        "kitti",
        "4x4",
        "euroc",
        "ros",
        "stray scanner",
        "rostopic",
        "quoted",
        "openvins",
        "stamp and 3x4",
        "stamp and 4x4",
        "named columns",
        "kapture, whose stamps count frames",
    ],
)
def test_poses_of_every_form_are_those_of_the_frames(tmp_path: Path, lines: list[str]) -> None:
    np.testing.assert_allclose(poses_of_frames(written(tmp_path, lines), TIMES), TRUE, atol=1e-8)


def test_record3ds_poses(tmp_path: Path) -> None:
    rows = [[*QUATERNION, 0.1 * k, 0, 0] for k in range(12)]
    path = tmp_path / "metadata"
    path.write_text(json.dumps({"K": [1] * 9, "w": 64, "poses": rows}))
    found = poses_of_frames(path, TIMES)  # its axes are OpenGL's, and ours after
    np.testing.assert_allclose(found, TRUE @ OPENGL_FROM_OPTICAL, atol=1e-8)
    np.testing.assert_allclose(poses_of_frames(path, TIMES, "optical"), TRUE, atol=1e-8)


NAMES = [f"{k:03}.jpg" for k in range(12)]


def test_poses_by_name_are_those_of_the_images(tmp_path: Path) -> None:
    """In any order, of some images, with other folders or endings; COLMAP's map the world into cameras."""
    rows, frames = [], []
    for k in (5, 0, 11, 3):
        x, y, z, qx, qy, qz, qw = position_quaternion(np.linalg.inv(TRUE[k]))
        rows += [f"{k + 1} {qw} {qx} {qy} {qz} {x} {y} {z} 1 left/{NAMES[k]}", "1.5 2.5 -1"]
        matrix = (TRUE[k] @ OPENGL_FROM_OPTICAL).tolist()
        frames.append({"file_path": f"./images/{k:03}", "transform_matrix": matrix, "colmap_im_id": k})
    for text in ("# Image list\n" + "\n".join(rows), json.dumps({"fl_x": 1.0, "frames": frames})):
        path = tmp_path / "poses"
        path.write_text(text)
        found = poses_of_frames(path, TIMES, names=NAMES)
        known = [0, 3, 5, 11]
        np.testing.assert_allclose(found[known], TRUE[known], atol=1e-8)
        assert np.isnan(np.delete(found, known, 0)).all()
        with pytest.raises(DataError, match="none of this recording's images"):
            poses_of_frames(path, TIMES, names=["a.png"] * 12)


def test_arkit_scenes_trajectory(tmp_path: Path) -> None:
    lines = []
    for k in range(12):
        t_cw = np.linalg.inv(TRUE[k])
        vector = [*rotation_log(t_cw[:3, :3]), *t_cw[:3, 3]]
        lines.append(" ".join(f"{v:.12f}" for v in (TIMES[k], *vector)))
    path = tmp_path / "lowres_wide.traj"
    path.write_text("\n".join(lines))
    np.testing.assert_allclose(poses_of_frames(path, TIMES), TRUE, atol=1e-8)


@pytest.mark.parametrize(
    ("lines", "words"),
    [
        ([line(k, k) for k in range(11)], "11 poses for 12 frames"),
        ([" ".join(f"{v:.9f}" for v in pose(k)[:3].ravel()) for k in range(11)], "11 poses for 12 frames"),
        (["1 1 0 0 0 0 0 0 1 a.jpg", "10.5 20.5 -1"], "images are no files"),
        (['{"frames": [{"file_path": "a.png"}]}'], "4x4 is needed"),
        ([line(0.05 * (k - 11), k) for k in range(12)], "share no time but for 1"),
        ([line(0.05 * k, k).replace(" 0 0 ", " 0 0 0.9 ") for k in range(12)], "no unit quaternion"),
        ([" ".join(f"{v:.9f}" for v in pose(k).T.ravel()) for k in range(12)], "last row is not 0 0 0 1"),
        ([line(NS + 50_000_000 * k, k, "wxyz").replace(" ", ",") for k in range(12)], "begin with w"),
        ([line(5 * k, k) for k in range(12)], "whole numbers 5 apart"),
        ([line(f"{0.05 * k:.3f}", 1000 * k) for k in range(12)], "2000 m/s"),
        (['{"parameters": []}'], "no poses that are known"),
    ],
)
def test_poses_that_cannot_be_meant_are_refused(tmp_path: Path, lines: list[str], words: str) -> None:
    with pytest.raises(DataError, match=words):
        poses_of_frames(written(tmp_path, lines), TIMES)


def test_a_tracker_that_counts_frames_and_is_lost_keeps_their_order(tmp_path: Path) -> None:
    lines = [line(k, k) for k in range(12)]
    lines[4] = "4 nan nan nan nan nan nan nan"
    found = poses_of_frames(written(tmp_path, lines), TIMES)
    assert np.isnan(found[4]).all()
    np.testing.assert_allclose(np.delete(found, 4, 0), np.delete(TRUE, 4, 0), atol=1e-8)


def test_lines_of_a_tracker_that_is_lost_are_left_out_and_told(tmp_path: Path) -> None:
    lines = [line(0.05 * k, k) for k in range(40)]
    lines[4] = lines[5] = "0.2 nan nan nan nan nan nan nan"
    lines[39] = "1.95 0.1 0."
    with listening() as facts:
        stamps, poses = read_track(written(tmp_path, lines))
    assert len(stamps) == len(poses) == 37
    assert any("37 of 40 lines" in f.value and "2 not finite and 1 broken" in f.value for f in facts)


def test_a_line_without_end_is_parted_no_farther_than_any_table_is_wide(tmp_path: Path) -> None:
    (tmp_path / "a.txt").write_text("1 2\n" + "3 " * 10 * LONGEST_LINE + "\n4 5\n")
    lines = data_lines(tmp_path / "a.txt")
    assert [number for number, _ in lines] == [1, 2, 3]
    assert MOST_COLUMNS < len(lines[1][1]) <= LONGEST_LINE
    (tmp_path / "a.txt").write_text("1 2\n3 4" + "0" * LONGEST_LINE)
    with pytest.raises(DataError, match=r"Line 2 of .* in 2 columns; no number is so long"):
        data_lines(tmp_path / "a.txt")
