"""The wheel in an empty environment: from ``pip install`` to the demo's picture."""

from __future__ import annotations

import json
import subprocess
import sys
import venv
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
HARD = {"collabslam", "numpy", "opencv-python-headless", "pip", "pyyaml", "setuptools", "tqdm"}

pytestmark = pytest.mark.wheel


def run(*command: object, cwd: Path) -> str:
    done = subprocess.run([str(c) for c in command], capture_output=True, text=True, check=False, cwd=cwd)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout + done.stderr


def test_from_pip_install_to_the_picture(tmp_path: Path) -> None:
    wheels = sorted((ROOT / "dist").glob("collabslam-*.whl"), key=lambda p: p.stat().st_mtime)
    assert wheels, "make wheel builds it"
    assert "abi3-manylinux" in wheels[-1].name or sys.platform != "linux"
    venv.create(tmp_path / "env", with_pip=True)
    scripts = tmp_path / "env" / ("Scripts" if sys.platform == "win32" else "bin")
    python = scripts / "python"
    run(python, "-m", "pip", "install", "--quiet", wheels[-1], cwd=tmp_path)
    installed = json.loads(run(python, "-m", "pip", "list", "--format", "json", cwd=tmp_path).splitlines()[0])
    assert {p["name"].lower() for p in installed} <= HARD
    assert "COMMAND" in run(scripts / "collabslam", "--help", cwd=tmp_path)
    run(python, "-m", "pip", "install", "--quiet", f"{wheels[-1]}[plot]", cwd=tmp_path)
    run(scripts / "collabslam", "demo", cwd=tmp_path)
    picture = tmp_path / "results" / "demo" / "comparison.png"
    assert picture.read_bytes().startswith(b"\x89PNG")
