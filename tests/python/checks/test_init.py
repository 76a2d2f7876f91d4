"""Calibration from nothing: from pictures of a board, from a photograph's EXIF block, or a guess."""

from __future__ import annotations

import struct
from pathlib import Path

import cv2
import numpy as np
import pytest
from helpers.bags import Maker
from helpers.posted import paint

from collabslam import Board, Camera, DataError, open_recording
from collabslam.checks.calibrate_camera import calibrate_camera
from collabslam.cli import main as cli
from collabslam.datasets import load_camera
from collabslam.datasets.exif import equivalent_focal_length
from collabslam.geometry import pose, rotation_exp

pytestmark = pytest.mark.slow

CAMERA = Camera("radtan", 480, 360, (402.0, 405.0, 244.0, 176.0), [-0.12, 0.05, 0.001, -0.0005])
BOARD = Board(7, 5, 0.03)


@pytest.fixture(scope="module")
def pictures() -> list[np.ndarray]:
    """Fourteen views of a board, moved and tilted as one would."""
    rng = np.random.default_rng(2)
    middle = BOARD.corners().mean(axis=0)
    out = []
    for k in range(14):
        turn = rotation_exp([0.6 * np.cos(2.3 * k), 0.6 * np.sin(2.3 * k), rng.uniform(-0.3, 0.3)])
        away = [rng.uniform(-0.09, 0.09), rng.uniform(-0.06, 0.06), rng.uniform(0.28, 0.45)]
        t_ct = pose(turn, np.asarray(away) - turn @ middle)
        image = paint(np.full((360, 480), 90, np.uint8), CAMERA, np.eye(4), BOARD, t_ct)
        out.append(np.clip(image + rng.normal(0.0, 2.0, image.shape), 0, 255).astype(np.uint8))
    return out


def test_pictures_of_a_board_give_the_camera(pictures: list[np.ndarray]) -> None:
    fit = calibrate_camera(len(pictures), pictures.__getitem__, BOARD)
    assert fit.used >= 8
    assert fit.rms < 0.4
    error = np.asarray(fit.camera.intrinsics) / np.asarray(CAMERA.intrinsics) - 1.0
    assert np.abs(error[:2]).max() < 4.0 * fit.focal_sd < 0.02
    points = np.array([[x, y, 1.0] for x in (-0.5, 0.0, 0.5) for y in (-0.35, 0.35)])
    assert np.abs(fit.camera.project(points).uv - CAMERA.project(points).uv).max() < 3.0


def test_too_few_boards_are_named(pictures: list[np.ndarray]) -> None:
    with pytest.raises(DataError, match=r"a 7x5 board is in view in .*; give --board 7x5:0\.03"):
        calibrate_camera(len(pictures), pictures.__getitem__, Board(8, 6, 0.03))
    blank = np.full((360, 480), 90, np.uint8)
    with pytest.raises(DataError, match="Only 0 of 30 pictures show a board of 8 x 6"):
        calibrate_camera(30, lambda i: blank, Board(8, 6, 0.03))
    with pytest.raises(DataError, match="Only 3 of 3"):
        calibrate_camera(3, pictures.__getitem__, BOARD)
    with pytest.raises(DataError, match="different sizes"):
        calibrate_camera(2, [pictures[0], pictures[0][:300]].__getitem__, BOARD)


def test_init_calibrates_a_folder_and_a_video(
    pictures: list[np.ndarray], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "images"
    folder.mkdir()
    film = cv2.VideoWriter(str(tmp_path / "film.avi"), cv2.VideoWriter_fourcc(*"MJPG"), 5.0, (480, 360))
    for k, image in enumerate(pictures):
        cv2.imwrite(str(folder / f"{k:02}.png"), image)
        film.write(cv2.cvtColor(image, cv2.COLOR_GRAY2BGR))
    film.release()
    with pytest.raises(DataError, match="collabslam init"):
        open_recording(folder)
    with pytest.raises(DataError, match="collabslam init"):
        open_recording(tmp_path / "film.avi")
    for source, out in ((folder, "a"), (tmp_path / "film.avi", "b")):
        words = ["init", str(source), "--out", str(tmp_path / out)]
        assert cli.main([*words, "--board", "7x5:0.03"]) == 0
        printed = capsys.readouterr().out
        assert "views of the board fitted" in printed
        assert "known to" in printed
        found = load_camera(tmp_path / out / "camera.yaml")
        assert found.intrinsics[0] == pytest.approx(402.0, rel=0.01)
        assert (
            open_recording(source, camera=tmp_path / out / "camera.yaml", times=_times(tmp_path)) is not None
        )
    assert cli.main(["init", str(folder), "--out", str(tmp_path / "c"), "--board", "9x6:0.03"]) == 2
    assert "a 7x5 board is in view in" in capsys.readouterr().err


@pytest.mark.parametrize("kind", ["ros1", "mcap"])
def test_init_calibrates_and_guesses_from_a_bag_without_camera_info(
    pictures: list[np.ndarray], kind: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    maker = Maker(tmp_path / "film", kind)
    with maker.writer:
        for k, image in enumerate(pictures):
            maker.image("/phone/image", 1_700_000_000_000_000_000 + k * 200_000_000, image)
    with pytest.raises(DataError, match="collabslam init"):
        open_recording(maker.path, topics={"cs": "/phone/image"})
    words = ["init", str(maker.path)]
    assert cli.main([*words, "--phone", "--out", str(tmp_path / "guess")]) == 0
    assert "10 % off" in capsys.readouterr().out
    assert load_camera(tmp_path / "guess" / "camera.yaml").intrinsics[0] == pytest.approx(0.76 * 480)
    assert cli.main([*words, "--board", "7x5:0.03", "--out", str(tmp_path / "board")]) == 0
    assert "views of the board fitted" in capsys.readouterr().out
    found = load_camera(tmp_path / "board" / "camera.yaml")
    assert found.intrinsics[0] == pytest.approx(402.0, rel=0.01)
    assert len(open_recording(maker.path, camera=tmp_path / "board" / "camera.yaml")) == len(pictures)


def _times(folder: Path) -> Path:
    (folder / "times.txt").write_text("".join(f"{0.2 * k}\n" for k in range(14)))
    return folder / "times.txt"


def with_exif(jpeg: bytes, millimetres: int, order: str) -> bytes:
    """A JPEG file with the equivalent focal length in its EXIF block."""
    mark = "<" if order == "II" else ">"
    entry = struct.pack(f"{mark}HHIHH", 0xA405, 3, 1, millimetres, 0)
    ifd = struct.pack(f"{mark}H", 1) + struct.pack(f"{mark}HHII", 0x8769, 4, 1, 26) + bytes(4)
    tiff = (
        order.encode() + struct.pack(f"{mark}HI", 42, 8) + ifd + struct.pack(f"{mark}H", 1) + entry + bytes(4)
    )
    block = b"Exif\0\0" + tiff
    return jpeg[:2] + b"\xff\xe1" + struct.pack(">H", len(block) + 2) + block + jpeg[2:]


@pytest.mark.parametrize("order", ["II", "MM"])
def test_a_photograph_says_its_focal_length(
    order: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    jpeg = cv2.imencode(".jpg", np.full((300, 400), 120, np.uint8))[1].tobytes()
    folder = tmp_path / "photos"
    folder.mkdir()
    (folder / "0.jpg").write_bytes(with_exif(jpeg, 26, order))
    assert equivalent_focal_length(folder / "0.jpg") == pytest.approx(26 / 43.267)
    assert cli.main(["init", str(folder), "--phone", "--out", str(tmp_path / "new")]) == 0
    assert "EXIF" in capsys.readouterr().out
    assert load_camera(tmp_path / "new" / "camera.yaml").intrinsics[0] == pytest.approx(300.5, abs=0.1)
    data = with_exif(jpeg, 26, order)
    for cut in range(len(data)):  # whatever is in it, it is read or it is not
        (folder / "0.jpg").write_bytes(data[:cut])
        assert equivalent_focal_length(folder / "0.jpg") in (None, pytest.approx(26 / 43.267))
    for k in range(2, 60):
        (folder / "0.jpg").write_bytes(data[:k] + b"\xff" + data[k + 1 :])
        equivalent_focal_length(folder / "0.jpg")
    (folder / "0.jpg").write_bytes(jpeg)
    assert equivalent_focal_length(folder / "0.jpg") is None
    assert cli.main(["init", str(folder), "--phone", "--out", str(tmp_path / "guess")]) == 0
    assert "10 % off" in capsys.readouterr().out
    assert load_camera(tmp_path / "guess" / "camera.yaml").intrinsics[0] == pytest.approx(0.76 * 400)
