"""Runs a wheel for arm64 on another machine, and compares: the poses must be those of this machine's.

``python packaging/try_arm64.py dist/arm64``: a short walk is rendered and run twice, by this Python and by an
arm64 one under ``qemu-aarch64-static`` (Debian's qemu-user-static) with the newest wheel of that folder.
The arm64 Python of this machine's own Debian and PyPI's arm64 wheels are unpacked into a temporary folder;
nothing is installed. Some minutes.
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
DEBIAN = ("python3-minimal", "libpython3-stdlib", "libstdc++6")
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
    """A root folder with the Python of this machine's Debian for arm64; its own packages stay as they are."""
    root = work / "root"
    for folder in (root, work / "lists" / "partial", work / "cache" / "archives" / "partial"):
        folder.mkdir(parents=True)
    status, conf = work / "status", work / "apt.conf"
    status.touch()
    conf.write_text(
        'APT { Architecture "arm64"; Architectures { "arm64"; }; Sandbox::User "root"; };\n'
        f'Dir::State {{ status "{status}"; lists "{work / "lists"}"; }};\nDir::Cache "{work / "cache"}";\n'
    )
    env = {**os.environ, "APT_CONFIG": str(conf)}
    run("apt-get", "update", env=env)
    run("apt-get", "install", "--download-only", "--yes", "--no-install-recommends", *DEBIAN, env=env)
    for deb in sorted((work / "cache" / "archives").glob("*.deb")):
        run("dpkg", "-x", deb, root)
    if not (root / "lib").exists():  # from Debian 13 on no package has files there
        (root / "lib").symlink_to("usr/lib")
    return root


def unpack_wheels(work: Path, wheel: Path, version: str) -> Path:
    """A folder for PYTHONPATH with the wheel and what it needs, for that version of Python (``3.11``)."""
    site, wheels = work / "site", work / "wheels"
    platforms = [w for tag in ("manylinux2014", "manylinux_2_28") for w in ("--platform", f"{tag}_aarch64")]
    given = ["--only-binary", ":all:", "--python-version", version, "--implementation", "cp", *platforms]
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
        root = unpack_debian(work)
        native, emulated = [sys.executable], [QEMU, "-L", root, root / "usr" / "bin" / "python3"]
        version = run(*emulated, "-c", "import sys; print('%d.%d' % sys.version_info[:2])").strip()
        site = unpack_wheels(work, wheel, version)
        env = {**os.environ, "PYTHONPATH": str(site), "PYTHONNOUSERSITE": "1"}
        machine = run(*emulated, "-c", "import platform; print(platform.machine())", env=env).strip()
        run(*native, "-m", "collabslam", "run", walk, "--out", work / "here")
        said = run(*emulated, "-m", "collabslam", "run", walk, "--out", work / "there", env=env)
        here, there = (np.loadtxt(work / name / "trajectory.tum") for name in ("here", "there"))
    least = 20
    if here.shape != there.shape or len(here) < least or not np.allclose(here, there, rtol=0.0, atol=1e-6):
        sys.exit(f"{wheel.name} gives other poses: {here.shape} and {there.shape}\n{said}")
    worst = float(np.abs(here - there).max())
    poses = f"{len(there)} poses, at most {worst:.1g} from this machine's"
    print(f"{wheel.name} on {machine}, Python {version}: {poses}")


if __name__ == "__main__":
    main()
