"""What packages of other systems say of collabslam is what pyproject.toml says."""

from __future__ import annotations

import re
import sys
import xml.etree.ElementTree as ET
from pathlib import Path

import pytest
import yaml

import collabslam

if sys.version_info < (3, 11):
    pytest.skip("reads TOML, which Python has from 3.11 on", allow_module_level=True)

import tomllib

ROOT = Path(__file__).parents[2]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
NAMES = {"opencv-python-headless": "py-opencv"}
"""What conda-forge calls otherwise."""


def least(requirement: str) -> tuple[str, str]:
    """Name and least version."""
    name, version = re.fullmatch(r"([\w-]+) ?(?:>=([\d.]+))?.*", requirement).groups()  # type: ignore[union-attr]
    return NAMES.get(name, name), version


WANTED = dict(map(least, PROJECT["dependencies"])) | {"python": PROJECT["requires-python"].removeprefix(">=")}
RUST = tomllib.loads((ROOT / "Cargo.toml").read_text())["workspace"]["package"]["rust-version"]


def test_conda_asks_for_the_same() -> None:
    text = (ROOT / "packaging" / "conda" / "recipe.yaml").read_text()
    recipe = yaml.safe_load(re.sub(r"\$\{\{.*?\}\}", "made", text))
    assert dict(map(least, recipe["requirements"]["run"])) == WANTED
    assert recipe["context"]["version"] == collabslam.__version__
    assert recipe["about"]["license"] == PROJECT["license"]
    pixi = tomllib.loads((ROOT / "pixi.toml").read_text())["dependencies"]
    given = {name: least(name + version)[1] for name, version in pixi.items()}
    assert WANTED.items() <= given.items()
    assert given["rust"] == RUST


def test_the_container_and_the_package_of_ros_are_of_this_version() -> None:
    assert f"FROM rust:{RUST}-" in (ROOT / "Dockerfile").read_text()
    package = ET.parse(ROOT / "ros" / "collabslam_ros" / "package.xml").getroot()
    assert package.findtext("version") == collabslam.__version__
    assert " OR ".join(e.text or "" for e in package.findall("license")) == "MIT OR Apache-2.0"
    setup = (ROOT / "ros" / "collabslam_ros" / "setup.py").read_text()
    assert f'version="{collabslam.__version__}"' in setup


WORKFLOWS = sorted((ROOT / ".github" / "workflows").glob("*.yml"))


@pytest.mark.parametrize("path", WORKFLOWS, ids=lambda path: path.stem)
def test_workflows_call_what_is_there(path: Path) -> None:
    jobs = yaml.safe_load(path.read_text())["jobs"]
    targets = set(re.findall(r"^([\w-]+):", (ROOT / "Makefile").read_text(), re.MULTILINE))
    calls = 0
    for job in jobs.values():
        assert {*job.get("needs", ())} <= jobs.keys()
        for command in [step["run"] for step in job["steps"] if "run" in step]:
            made = re.findall(r"\bmake ([\w-]+)", command)
            files = re.findall(r"[\w/.-]+\.(?:py|txt|toml)\b", command)
            assert {*made} <= targets
            assert all((ROOT / name).is_file() for name in files)
            calls += len(made) + len(files)
        pythons = [k for k, step in enumerate(job["steps"]) if "setup-python" in step.get("uses", "")]
        pips = [k for k, step in enumerate(job["steps"]) if "pip install" in step.get("run", "")]
        assert not pips or pythons, "the machine's own Python lets nothing be installed"
        assert not pips or pythons[0] < pips[0]
    assert calls
