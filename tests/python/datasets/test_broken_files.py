"""Files and bags whose stamps repeat or jump, with marks and numbers that nobody meant; sources kept."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from helpers.bags import IMAGES, KINDS, START, STEP, Maker
from helpers.folders import make_euroc, picture, write_images
from helpers.stand_ins import FakeSlam, Walk

from collabslam import run
from collabslam.cli import main as cli
from collabslam.datasets import attach_worn, load_camera, open_recording, write_recording
from collabslam.errors import DataError
from collabslam.runs import runner
from collabslam.settings.table import Settings


def test_a_repeated_stamp_in_a_file_is_left_out_and_counted(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    stamps = make_euroc(tmp_path, frames=6)
    listing = tmp_path / "mav0" / "cam0" / "data.csv"
    lines = listing.read_text().splitlines()
    name = lines[4].split(",")[1]
    lines[4] = lines[3].split(",")[0] + "," + name
    listing.write_text("\n".join(lines))
    recording = open_recording(tmp_path)
    assert recording.left_out == 1
    assert len(recording) == len(recording.paths) == 5
    assert np.all(np.diff(recording.times) > 0.0)
    # whatever stood beside a frame stands there still
    np.testing.assert_array_equal(recording.times[3:], [s / 1e9 for s in stamps[4:]])
    np.testing.assert_array_equal(recording.image(3), picture(4))
    np.testing.assert_array_equal(recording.image(2), picture(2))  # the first of both had its own stamp
    assert recording.rig is not None
    assert recording.rig.paths[4].name == f"{stamps[5]}.png"
    assert attach_worn(recording, "rig").frame(4).views
    # and the run says so
    monkeypatch.setattr(runner, "make_engine", lambda *_: FakeSlam(Walk()))
    out = tmp_path / "out"
    assert cli.main(["run", str(tmp_path), "--mode", "mono", "--start", "scale-free", "--out", str(out)]) == 0
    assert "1 frames left out" in capsys.readouterr().err
    summary = json.loads((out / "summary.json").read_text())
    assert (summary["frames"], summary["frames_out_of_order"]) == (5, 1)


@pytest.mark.parametrize("kind", KINDS)
def test_a_repeated_stamp_and_one_far_ahead_in_a_bag(tmp_path: Path, kind: str) -> None:
    maker = Maker(tmp_path / "walk", kind)
    offsets = [0, STEP, STEP, 2 * STEP, 3 * STEP, 1000 * 10**9]
    with maker.writer:
        maker.camera("/camera_info", START)
        for k, offset in enumerate(offsets):
            maker.image("/image_raw", START + offset, IMAGES[k])
    recording = open_recording(maker.path)
    assert recording.left_out == 2
    np.testing.assert_allclose(recording.times, START / 1e9 + 0.1 * np.arange(4), atol=1e-6)
    np.testing.assert_array_equal(recording.frame(3).image, IMAGES[4])


def test_one_last_stamp_far_ahead_does_not_lose_the_camera() -> None:
    walk = Walk()
    walk.times[-1] += 1000.0
    summary = run(walk, slam=FakeSlam(walk)).summary
    assert summary["frames_out_of_order"] == 1
    assert summary["frames"] == 29


def test_a_byte_order_mark_is_no_part_of_a_file(tmp_path: Path) -> None:
    make_euroc(tmp_path)
    camera = tmp_path / "mav0" / "cam0"
    for path in (camera / "data.csv", camera / "sensor.yaml"):
        path.write_bytes(b"\xef\xbb\xbf" + path.read_bytes())
    (camera / "data.csv").write_bytes(
        (camera / "data.csv").read_bytes().replace(b"#timestamp [ns],filename\n", b"")
    )
    assert len(open_recording(tmp_path)) == 4
    assert load_camera(camera / "sensor.yaml").width > 0
    settings = tmp_path / "settings.yaml"
    settings.write_bytes(b"\xef\xbb\xbffilter: {map: {in_view: 33}}\n")
    assert Settings.load(settings)["filter.map.in_view"] == 33


@pytest.mark.parametrize("value", ["1e300", "-1e200", "1e10"])
def test_poses_beyond_all_bounds_are_refused(tmp_path: Path, value: str) -> None:
    write_images(tmp_path / "images", ["0.png", "1.png", "2.png"])
    (tmp_path / "cam.yaml").write_text(
        "camera_model: pinhole\nintrinsics: [30.0, 30.0, 15.5, 11.5]\nresolution: [32, 24]\nrate: 10\n"
    )
    poses = tmp_path / "poses.txt"
    poses.write_text(f"0.0 0 0 0 0 0 0 1\n0.1 {value} 0 0 0 0 0 1\n0.2 0 0 0 0 0 0 1\n")
    with pytest.raises(DataError, match=r"Line 2 of .* away from its origin"):
        open_recording(tmp_path / "images", camera=tmp_path / "cam.yaml", poses=poses)


@pytest.mark.parametrize("place", [".", ".."])
def test_a_recording_is_not_written_over_its_source(tmp_path: Path, place: str) -> None:
    source = write_recording(Walk(4), tmp_path / "outer" / "walk")
    (tmp_path / "outer" / "recording.yaml").write_text("format: collabslam-recording\nversion: 1\n")
    before = {p: p.read_bytes() for p in source.rglob("*") if p.is_file()}
    out = source / place
    assert cli.main(["record", str(source), str(out), "--overwrite"]) == 2
    with pytest.raises(DataError, match="would be destroyed"):
        write_recording(open_recording(source), out, overwrite=True)
    assert {p: p.read_bytes() for p in source.rglob("*") if p.is_file()} == before
    assert write_recording(open_recording(source), tmp_path / "copy").is_dir()
