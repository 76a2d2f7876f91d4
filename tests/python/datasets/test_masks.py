"""Masks in files: given beside a recording, named by its calibrations, written and read back."""

from __future__ import annotations

import os
from pathlib import Path

import cv2
import numpy as np
import pytest
import yaml

from collabslam import Camera, RecordingWriter, WornView, attach_worn, open_recording
from collabslam.cli.main import main
from collabslam.datasets.recording_writer import write_recording
from collabslam.datasets.source import STATE, Source
from collabslam.errors import DataError, SettingsError
from collabslam.types import Array, Mask

CAMERA = Camera("pinhole", 64, 48, (60.0, 60.0, 32.0, 24.0))
WORN = Camera("pinhole", 48, 48, (60.0, 60.0, 24.0, 24.0))


def _mask(width: int, hidden: int) -> Mask:
    scene = np.ones((48, width), np.bool_)
    scene[:, :hidden] = False
    return scene


OF_CS, OF_CF = _mask(64, 20), _mask(48, 11)


def _image(path: Path, grey: Array) -> Path:
    assert cv2.imwrite(str(path), grey.astype(np.uint8))
    return path


@pytest.fixture
def walk(tmp_path: Path) -> Path:
    """A recording without masks."""
    return _written(tmp_path / "walk")


def _written(folder: Path, **masks: Mask) -> Path:
    rng = np.random.default_rng(1)
    with RecordingWriter(folder, CAMERA, WORN, **masks) as writer:
        for i in range(3):
            worn = WornView(rng.integers(0, 255, (48, 48), np.uint8), np.eye(4), 1e-4 * np.eye(6))
            writer.add(0.1 * i, rng.integers(0, 255, (48, 64), np.uint8), [worn], np.eye(4))
    return folder


def test_the_layout_keeps_both_masks(tmp_path: Path) -> None:
    first = _written(tmp_path / "walk", mask=OF_CS, worn_mask=OF_CF)
    write_recording(open_recording(first), tmp_path / "again")
    for folder in (first, tmp_path / "again"):
        masks = open_recording(folder).masks
        assert masks.robot is not None
        np.testing.assert_array_equal(masks.robot, OF_CS)
        np.testing.assert_array_equal(masks.worn[""], OF_CF)
    assert (first / "cam1" / "mask.png").read_bytes() == (tmp_path / "again/cam1/mask.png").read_bytes()


def test_a_recording_without_one_has_none(walk: Path) -> None:
    assert not open_recording(walk).masks.any


def test_a_mask_that_is_given_is_taken_for_the_recordings_own(tmp_path: Path) -> None:
    folder = _written(tmp_path / "walk", mask=OF_CS, worn_mask=OF_CF)
    given = _image(tmp_path / "given.png", 255 * _mask(64, 5))
    np.testing.assert_array_equal(open_recording(folder, mask=given).masks.robot, _mask(64, 5))
    worn = _image(tmp_path / "worn.png", 255 * _mask(48, 7))
    np.testing.assert_array_equal(Source(folder, worn_masks={"": worn}).open().masks.worn[""], _mask(48, 7))
    with pytest.raises(SettingsError, match="no worn camera of 'ben' whose mask is given"):
        Source(folder, worn_masks={"ben": worn}).open()


def test_a_calibration_that_is_given_names_one(walk: Path, tmp_path: Path) -> None:
    content = yaml.safe_load((walk / "cam0" / "sensor.yaml").read_text())
    (tmp_path / "cam.yaml").write_text(yaml.safe_dump({**content, "mask": "hood.png"}))
    _image(tmp_path / "hood.png", 255 * OF_CS)
    np.testing.assert_array_equal(open_recording(walk, camera=tmp_path / "cam.yaml").masks.robot, OF_CS)


@pytest.mark.parametrize("name", ["../hood.png", "/etc/passwd", "..", "", 7, "a\0b", "x" * 256, ["hood.png"]])
def test_a_calibration_reaches_no_other_file(walk: Path, name: object) -> None:
    sensor = walk / "cam1" / "sensor.yaml"
    sensor.write_text(yaml.safe_dump({**yaml.safe_load(sensor.read_text()), "mask": name}))
    with pytest.raises(DataError, match=r"key 'mask' of .* is no name of an image beside it"):
        open_recording(walk)


@pytest.mark.parametrize(
    ("grey", "suffix", "said"),
    [
        (np.full((48, 63), 255), ".png", "63x48 but its camera is calibrated for 64x48"),
        (np.tile(np.arange(64), (48, 1)), ".png", "63 values beside 0.*JPEG does not"),
        (255 * np.tile(np.arange(64) > 21, (48, 1)), ".jpg", "values beside 0"),
        (np.zeros((48, 64)), ".png", "leaves 0 % of the image.*exchange its colours"),
    ],
)
def test_a_file_that_is_no_mask_is_refused(
    walk: Path, tmp_path: Path, grey: Array, suffix: str, said: str
) -> None:
    path = _image(tmp_path / f"hood{suffix}", grey)
    with pytest.raises(DataError, match=said):
        open_recording(walk, mask=path)


@pytest.mark.parametrize("content", [b"", b"\x89PNG\r\n\x1a\n cut short", b"text"])
def test_what_is_no_image_is_refused(walk: Path, tmp_path: Path, content: bytes) -> None:
    (tmp_path / "hood.png").write_bytes(content)
    with pytest.raises(DataError, match="hood"):
        open_recording(walk, mask=tmp_path / "hood.png")
    with pytest.raises(DataError, match="missing"):
        open_recording(walk, mask=tmp_path / "missing.png")
    os.mkfifo(tmp_path / "pipe.png")
    with pytest.raises(DataError, match="pipe"):
        open_recording(walk, mask=tmp_path / "pipe.png")


def test_an_emulated_camera_has_the_mask_of_the_images_it_takes(tmp_path: Path) -> None:
    folder = _written(tmp_path / "walk", mask=OF_CS, worn_mask=OF_CF)
    recording = open_recording(folder)
    np.testing.assert_array_equal(attach_worn(recording, "lag:0.1").masks.worn[""], OF_CS)
    assert attach_worn(recording, "none").masks.worn == {}
    np.testing.assert_array_equal(attach_worn(recording, "recorded").masks.worn[""], OF_CF)


def test_a_source_keeps_them_for_a_run_that_goes_on(walk: Path, tmp_path: Path) -> None:
    path = _image(tmp_path / "hood.png", 255 * OF_CF)
    state = Source(walk, worn_masks={"": path}).state()
    STATE(state, "source")
    assert Source.from_state(state).worn_masks == {"": path}


def test_the_command_line_takes_and_refuses_them(
    walk: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    good, small = _image(tmp_path / "good.png", 255 * OF_CS), _image(tmp_path / "small.png", 255 * OF_CF)
    assert main(["run", str(walk), "--out", str(tmp_path / "out"), "--mask", str(small)]) == 2
    assert "calibrated for 64x48" in capsys.readouterr().err
    arguments = ["--mask", str(good), "--worn-mask", str(small), "--max-frames", "2"]
    assert main(["run", str(walk), "--out", str(tmp_path / "out"), *arguments]) in (0, 1)
    assert main(["info", str(walk), "--mask", str(good)]) == 0
    assert "leaves 69 % of the image" in capsys.readouterr().out
