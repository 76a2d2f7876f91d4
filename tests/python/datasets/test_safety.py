"""Reading a recording or a settings file runs no code, and names lead nowhere else."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest
from helpers.clip import Clip, Short

import collabslam
from collabslam.datasets import open_recording, write_recording
from collabslam.errors import DataError, SettingsError
from collabslam.settings.table import Settings

PACKAGE = Path(collabslam.__file__).parent
OUTSIDE = [
    "../../../etc/passwd",
    "/etc/passwd",
    "..",
    "a/../../b.png",
    "..\\b.png",
    "C:/b.png",
    "\\\\host\\b.png",
]


def _calls() -> list[tuple[Path, str, ast.Call]]:
    return [
        (path.relative_to(PACKAGE), ast.unparse(node.func), node)
        for path in sorted(PACKAGE.rglob("*.py"))
        for node in ast.walk(ast.parse(path.read_text()))
        if isinstance(node, ast.Call)
    ]


PIPES = Path("batch/isolated.py")
"""Pickles go between a process and the child that it started itself, never through a file or a network."""


@pytest.mark.slow
def test_nothing_that_is_read_can_run() -> None:
    for path, name, call in _calls():
        assert name not in {"eval", "exec", "compile", "__import__", "os.system", "os.popen"}, path
        if path != PIPES:
            assert not name.startswith(("pickle.", "marshal.", "shelve.", "joblib.")), path
        assert name != "pickle.load", path
        assert name not in {"yaml.load", "yaml.unsafe_load", "yaml.full_load", "yaml.load_all"}, path
        options = {k.arg: ast.unparse(k.value) for k in call.keywords}
        assert options.get("shell", "False") == "False", path
        if name in {"np.load", "numpy.load"}:
            assert options.get("allow_pickle") == "False", path
        assert not name.endswith((".extractall", ".unpack_archive")), path
    for path in PACKAGE.rglob("*.py"):
        modules = {
            alias.name
            for node in ast.walk(ast.parse(path.read_text()))
            if isinstance(node, ast.Import)
            for alias in node.names
        }
        allowed = {"pickle"} if path.relative_to(PACKAGE) == PIPES else set()
        assert not modules & ({"pickle", "marshal", "shelve", "dill", "joblib"} - allowed), path


def test_a_settings_file_makes_no_objects(tmp_path: Path) -> None:
    mark = tmp_path / "ran"
    for text in (
        f"filter: !!python/object/apply:os.mkdir ['{mark}']\n",
        f"!!python/object/new:os.mkdir ['{mark}']\n",
        "filter: !!python/name:os.system\n",
    ):
        path = tmp_path / "settings.yaml"
        path.write_text(text)
        with pytest.raises(SettingsError):
            Settings.load(path)
        assert not mark.exists()


@pytest.fixture
def walk(clip: Clip, tmp_path: Path) -> Path:
    return write_recording(Short(clip, 3), tmp_path / "walk")


@pytest.mark.slow
def test_a_calibration_makes_no_objects(walk: Path, tmp_path: Path) -> None:
    mark = tmp_path / "ran"
    sensor = walk / "cam0" / "sensor.yaml"
    sensor.write_text(sensor.read_text() + f"x: !!python/object/apply:os.mkdir ['{mark}']\n")
    with pytest.raises(DataError):
        open_recording(walk)
    assert not mark.exists()


@pytest.mark.parametrize("name", OUTSIDE)
@pytest.mark.parametrize("camera", ["cam0", "cam1"])
def test_images_of_a_list_lie_in_the_recording(walk: Path, camera: str, name: str) -> None:
    listing = walk / camera / "data.csv"
    lines = listing.read_text().splitlines()
    lines[1] = f"{lines[1].split(',')[0]},{name}"
    listing.write_text("\n".join(lines) + "\n")
    with pytest.raises(DataError, match="leads out of the recording"):
        open_recording(walk)


@pytest.mark.parametrize("name", OUTSIDE)
def test_images_of_a_tum_list_lie_in_the_recording(tmp_path: Path, name: str) -> None:
    folder = tmp_path / "freiburg1_desk"
    folder.mkdir()
    (folder / "rgb.txt").write_text(f"1.0 {name}\n")
    with pytest.raises(DataError, match="leads out of the recording"):
        open_recording(folder)


@pytest.mark.parametrize("name", ["../evil", "/evil", "a/b", "..", "", ".hidden", "a\\b"])
def test_a_recordings_name_is_no_path(walk: Path, name: str) -> None:
    header = walk / "recording.yaml"
    header.write_text(f"format: collabslam-recording\nversion: 1\nname: '{name}'\n")
    with pytest.raises(DataError, match="not a name of a folder"):
        open_recording(walk)


def test_opening_and_running_write_nowhere_else(walk: Path, tmp_path: Path) -> None:
    before = sorted(p.relative_to(tmp_path) for p in tmp_path.rglob("*"))
    recording = open_recording(walk)
    collabslam.run(recording, out=collabslam.Output(tmp_path / "out", latest=False, checkpoint_every=1))
    after = {p.relative_to(tmp_path) for p in tmp_path.rglob("*")} - {Path("out")}
    assert sorted(p for p in after if p.parts[0] != "out") == before
