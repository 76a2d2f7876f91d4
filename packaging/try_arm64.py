"""Runs a wheel for arm64 on another machine, and compares: the poses must be those of this machine's.

``python packaging/try_arm64.py dist/arm64``: a short walk is rendered and run twice, by this Python and by an
arm64 one under ``qemu-aarch64-static`` (Debian's qemu-user-static) with the newest wheel of that folder.
Debian's arm64 Python and PyPI's arm64 wheels are unpacked into a temporary folder; nothing is installed.
Some minutes.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import zipfile
from pathlib import Path

import numpy as np

from collabslam.datasets import write_recording
from collabslam.simulation import corridor_recording

QEMU = "qemu-aarch64-static"
PYTHON = "3.11"
"""What Debian 12 has."""
LIBRARIES = (
    "libbz2-1.0",
    "libc6",
    "libcrypt1",
    "libexpat1",
    "libffi8",
    "libgcc-s1",
    "liblzma5",
    "libsqlite3-0",
    "libssl3",
    "libstdc++6",
    "libuuid1",
    "zlib1g",
)
NEEDS = ("numpy", "opencv-python-headless", "pyyaml", "tqdm")
LENGTH = 4.5
"""Metres of the walk."""


def run(*command: object, **options: object) -> str:
    """Its output; the program ends with what it said if it failed."""
    done = subprocess.run([str(c) for c in command], capture_output=True, text=True, check=False, **options)  # type: ignore[call-overload]
    if done.returncode != 0:
        sys.exit(f"{' '.join(map(str, command))}\n{done.stdout}{done.stderr}")
    return str(done.stdout)


def unpack_debian(work: Path) -> Path:
    """A root folder with Debian's arm64 Python; the machine's own package lists stay as they are."""
    root, debs = work / "root", work / "debs"
    for folder in (root, debs, work / "lists" / "partial", work / "cache" / "archives" / "partial"):
        folder.mkdir(parents=True)
    conf = work / "apt.conf"
    conf.write_text(
        'APT::Architectures { "amd64"; "arm64"; };\nAPT::Sandbox::User "root";\n'
        f'Dir::State::lists "{work / "lists"}";\nDir::Cache "{work / "cache"}";\n'
    )
    env = {**os.environ, "APT_CONFIG": str(conf)}
    python = (f"python{PYTHON}-minimal", f"libpython{PYTHON}-minimal", f"libpython{PYTHON}-stdlib")
    run("apt-get", "update", env=env)
    run("apt-get", "download", *(f"{name}:arm64" for name in (*python, *LIBRARIES)), env=env, cwd=debs)
    for deb in sorted(debs.glob("*.deb")):
        run("dpkg", "-x", deb, root)
    return root


def unpack_wheels(work: Path, wheel: Path) -> Path:
    """A folder for PYTHONPATH with the wheel and what it needs."""
    site, wheels = work / "site", work / "wheels"
    platforms = [w for tag in ("manylinux2014", "manylinux_2_28") for w in ("--platform", f"{tag}_aarch64")]
    given = ["--only-binary", ":all:", "--python-version", PYTHON, "--implementation", "cp", *platforms]
    run(sys.executable, "-m", "pip", "download", "--quiet", "--dest", wheels, *given, *NEEDS)
    for path in (*sorted(wheels.glob("*.whl")), wheel):
        with zipfile.ZipFile(path) as files:
            files.extractall(site)
    return site


def main() -> None:
    """Says which wheel gave the same poses, or ends with the difference."""
    wheel = max(Path(sys.argv[1]).glob("*aarch64.whl"), key=lambda path: path.stat().st_mtime).resolve()
    with tempfile.TemporaryDirectory() as folder:
        work = Path(folder)
        walk = write_recording(corridor_recording(length_m=LENGTH), work / "walk")
        root, site = unpack_debian(work), unpack_wheels(work, wheel)
        native = [sys.executable]
        emulated = [QEMU, "-L", root, root / "usr" / "bin" / f"python{PYTHON}"]
        env = {**os.environ, "PYTHONPATH": str(site), "PYTHONNOUSERSITE": "1"}
        print(run(*emulated, "-c", "import platform; print(platform.machine())", env=env).strip())
        run(*native, "-m", "collabslam", "run", walk, "--out", work / "here")
        said = run(*emulated, "-m", "collabslam", "run", walk, "--out", work / "there", env=env)
        here, there = (np.loadtxt(work / name / "trajectory.tum") for name in ("here", "there"))
    least = 20
    if here.shape != there.shape or len(here) < least or not np.allclose(here, there, rtol=0.0, atol=1e-6):
        sys.exit(f"{wheel.name} gives other poses: {here.shape} and {there.shape}\n{said}")
    worst = float(np.abs(here - there).max())
    print(f"{wheel.name}: {len(there)} poses, at most {worst:.1g} from this machine's")


if __name__ == "__main__":
    main()
