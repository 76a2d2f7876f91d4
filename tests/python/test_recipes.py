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
