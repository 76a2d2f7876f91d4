"""The wheel: in an empty environment from ``pip install`` to the picture; and what is in it, to the byte."""

from __future__ import annotations

import json
import subprocess
import sys
import venv
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
HARD = {"collabslam", "numpy", "opencv-python-headless", "pip", "pyyaml", "setuptools", "tqdm"}

pytestmark = pytest.mark.wheel


def run(*command: object, cwd: Path) -> str:
    done = subprocess.run([str(c) for c in command], capture_output=True, text=True, check=False, cwd=cwd)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout + done.stderr


@pytest.fixture
def wheel() -> Path:
    wheels = sorted((ROOT / "dist").glob("collabslam-*.whl"), key=lambda p: p.stat().st_mtime)
    assert wheels, "make wheel builds it"
    return wheels[-1]


def test_from_pip_install_to_the_picture(wheel: Path, tmp_path: Path) -> None:
    assert "abi3-manylinux" in wheel.name or sys.platform != "linux"
    venv.create(tmp_path / "env", with_pip=True)
    scripts = tmp_path / "env" / ("Scripts" if sys.platform == "win32" else "bin")
    python = scripts / "python"
    run(python, "-m", "pip", "install", "--quiet", wheel, cwd=tmp_path)
    installed = json.loads(run(python, "-m", "pip", "list", "--format", "json", cwd=tmp_path).splitlines()[0])
    assert {p["name"].lower() for p in installed} <= HARD
    assert "COMMAND" in run(scripts / "collabslam", "--help", cwd=tmp_path)
    run(python, "-m", "pip", "install", "--quiet", f"{wheel}[plot]", cwd=tmp_path)
    run(scripts / "collabslam", "demo", cwd=tmp_path)
    picture = tmp_path / "results" / "demo" / "comparison.png"
    assert picture.read_bytes().startswith(b"\x89PNG")


def test_it_holds_the_licences_of_all_that_is_linked(wheel: Path) -> None:
    with zipfile.ZipFile(wheel) as files:
        held = {Path(name).name: files.read(name) for name in files.namelist() if "/licenses/" in name}
    assert set(held) == {"LICENSE-APACHE", "LICENSE-MIT", "LICENSES-LINKED.txt"}
    linked = held["LICENSES-LINKED.txt"].decode()
    for name in (
        "faer",
        "inventory",
        "nalgebra",
        "numpy",
        "pulp",
        "pyo3",
        "serde",
        "Rust's standard library",
    ):
        assert f"\n{name}" in linked
    for words in (
        "Permission is hereby granted",
        "Redistribution and use",
        "Apache License",
        "Mozilla Public License",
    ):
        assert words in linked
    run(sys.executable, ROOT / "packaging" / "licences.py", "--check", cwd=ROOT)  # those of these very crates


def test_nothing_in_it_tells_where_or_when_it_was_built(wheel: Path) -> None:
    with zipfile.ZipFile(wheel) as files:
        assert len({entry.date_time for entry in files.infolist()}) == 1
        module = [name for name in files.namelist() if Path(name).name.startswith("_core.")]
        assert any(name.endswith((".so", ".pyd")) for name in module)
        for name in files.namelist():
            content = files.read(name)
            here = (f"{ROOT}/", f"{Path.home()}/")  # with a slash: a name of ours may begin like a folder
            for trace in (*here, ".cargo", "registry/src", "index.crates", "/rustup/"):
                assert trace.encode() not in content, f"{name} holds {trace}"
