"""Every command and every block of Python in the README and the documentation runs."""

from __future__ import annotations

import hashlib
import json
import re
import shlex
import shutil
import subprocess
import sys
from dataclasses import replace
from functools import partial
from importlib.util import find_spec
from pathlib import Path

import cv2
import numpy as np
import pytest
import yaml
from helpers.bags import Maker
from helpers.clip import Clip, Short
from helpers.gyro import lines, of_clip
from helpers.posted import TAG, paint, walk_past
from helpers.sensed_person import write_sensor_bag
from helpers.waiting import LONGEST

import collabslam
from collabslam import Board
from collabslam import geometry as g
from collabslam.cli import COMMANDS
from collabslam.cli import main as cli
from collabslam.datasets import write_recording
from collabslam.datasets.calibration import sensor_mapping
from collabslam.simulation.recording import demo_recording
from collabslam.types import Frame
from collabslam_lab import evidence, worn_cameras
from collabslam_lab.benchmark import evaluate
from collabslam_lab.cli import main as lab
from collabslam_lab.learned import viewpoints

ROOT = Path(__file__).parents[2]
PAGES = sorted([ROOT / "README.md", ROOT / "CONTRIBUTING.md", *(ROOT / "docs").glob("*.md")])
TOOLS = {"evo_ape", "smfeval", "rerun"}
COMMAND_LINES = {"collabslam": cli.main, "collabslam-lab": lab.main}
BESIDE: list[subprocess.Popen[bytes]] = []
"""What a page started with an ``&`` and waits for with ``wait``."""
TELLING = {"info", "check-calib", "doctor"}
"""Commands that write nothing, without ``--write``: of the same files the same words tell the same again."""
TOLD: set[bytes] = set()
OVERVIEWS = {"evidence.md", "numbers.md"}
"""Pages of the list Evidence that are no claim."""
FRAMES = 9
START = 1_700_000_000_000_000_000


def blocks(page: Path, language: str) -> list[str]:
    return re.findall(
        rf"^```{language}\n(.*?)^```", page.read_text(encoding="utf-8"), re.MULTILINE | re.DOTALL
    )


def commands(page: Path) -> list[list[str]]:
    """The words of every line of shell, without comments and the environment's folder."""
    lines = [line for block in blocks(page, "sh") for line in block.splitlines()]
    words = [shlex.split(line.replace(".venv/bin/", ""), comments=True) for line in lines]
    return [w for w in words if w]


def make_bag(path: Path, short: Short) -> None:
    maker = Maker(path, "ros1")
    rows = [(START + round(1e9 * f.t), f) for f in _frames(short)]
    with maker.writer:
        for stamp, frame in rows:
            maker.image("/cs/image_raw", stamp, frame.image)
            info(maker, "/cs/camera_info", stamp, short.camera)
            info(maker, "/cf/camera_info", stamp, short.worn_camera)
            if frame.views:
                maker.image("/cf/image_raw", stamp, frame.views[0].image)
                fixed = g.tangent_to_fixed(frame.views[0].t_cf, frame.views[0].covariance)
                maker.pose_cov("/relpose", stamp, frame.views[0].t_cf, fixed)
                maker.link("/tf", stamp, "cs", "cf", frame.views[0].t_cf)
            vector = partial(maker.make, "geometry_msgs/msg/Vector3")
            twist = maker.make("geometry_msgs/msg/Twist", vector(1.5, 0.0, 0.0), vector(0.0, 0.0, 0.0))
            maker.write("/odom", "geometry_msgs/msg/TwistStamped", stamp, maker.header(stamp), twist)


def _frames(short: Short) -> list[Frame]:
    return [short.frame(k) for k in range(len(short))]


def make_camchain(path: Path, short: Short) -> None:
    """Both cameras as Kalibr writes them, bound as in the first frame."""
    lenses = [{"camera_model": "pinhole", "distortion_model": "radtan", "intrinsics": list(c.intrinsics),
               "distortion_coeffs": list(c.distortion), "resolution": [c.width, c.height]}
              for c in (short.camera, short.worn_camera)]  # fmt: skip
    frames = _frames(short)
    bound = np.linalg.inv(next(frame.views[0].t_cf for frame in frames if frame.views))
    path.write_text(yaml.safe_dump({"cam0": lenses[0], "cam1": {**lenses[1], "T_cn_cnm1": bound.tolist()}}))


def make_persons(folder: Path, short: Short) -> None:
    """The walk with two persons, who see the same."""
    lenses = dict.fromkeys(("anna", "ben"), short.worn_camera)
    with collabslam.RecordingWriter(folder, short.camera, lenses) as writer:
        for frame in _frames(short):
            views = [replace(view, who=name) for view in frame.views for name in lenses]
            writer.add(frame.t, frame.image, views, short.truth[frame.index])


def make_pair(folder: Path, short: Short) -> None:
    """The walk as two videos, as README has them."""
    folder.mkdir()
    frames, size = _frames(short), (short.camera.width, short.camera.height)
    rows, images = [], [[f.image for f in frames], [(f.views[0] if f.views else f).image for f in frames]]
    for k, (lens, pictures) in enumerate(zip((short.camera, short.worn_camera), images, strict=True)):
        (folder / f"cam{k}.yaml").write_text(yaml.safe_dump(sensor_mapping(lens)))
        video = cv2.VideoWriter(str(folder / f"cam{k}.mp4"), cv2.VideoWriter_fourcc(*"mp4v"), 10.0, size)
        for picture in pictures:
            video.write(cv2.cvtColor(picture, cv2.COLOR_GRAY2BGR))
        video.release()
    for k, frame in enumerate(frames):
        for view in frame.views:
            row = [0.1 * k, *view.t_cf[:3, 3], *g.quaternion_wxyz(view.t_cf[:3, :3]), 0.03, 1.0]
            rows.append(",".join(f"{v:.6f}" for v in row))
    (folder / "t_cf.csv").write_text("\n".join(rows))


def make_targets(folder: Path, clip: Clip) -> None:
    """A walk past a tag, and a film of a board."""
    write_recording(walk_past(clip, TAG, FRAMES, alone=False), folder / "tagged")
    lens, board = collabslam.Camera("pinhole", 480, 360, (400.0, 400.0, 239.5, 179.5), []), Board(7, 5, 0.03)
    film = cv2.VideoWriter(str(folder / "board.mp4"), cv2.VideoWriter_fourcc(*"mp4v"), 10.0, (480, 360))
    for k in range(10):
        turn = g.rotation_exp([0.5 * np.cos(2.3 * k), 0.5 * np.sin(2.3 * k), 0.1 * k])
        away = np.array([0.05 * np.cos(k), 0.04 * np.sin(k), 0.35]) - turn @ board.corners().mean(axis=0)
        image = paint(np.full((360, 480), 90, np.uint8), lens, np.eye(4), board, g.pose(turn, away))
        film.write(cv2.cvtColor(image, cv2.COLOR_GRAY2BGR))
    film.release()


def info(maker: Maker, topic: str, stamp: int, camera: collabslam.Camera) -> None:
    roi = maker.make("sensor_msgs/msg/RegionOfInterest", 0, 0, 0, 0, False)
    maker.write(topic, "sensor_msgs/msg/CameraInfo", stamp, maker.header(stamp), camera.height, camera.width,
                "plumb_bob", np.array([*camera.distortion, 0.0]), camera.matrix.ravel(), np.eye(3).ravel(),
                np.zeros(12), 0, 0, roi)  # fmt: skip


@pytest.fixture(scope="module")
def place(clip: Clip, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with everything that the documentation names: walk, walk.bag, walk.mp4, images, a run."""
    folder = tmp_path_factory.mktemp("docs")
    short = Short(clip, FRAMES)
    for name in ("walk", "other"):
        write_recording(short, folder / name)
    make_persons(folder / "persons", short)
    make_pair(folder / "pair", short)
    (folder / "camera.yaml").write_text(yaml.safe_dump({**sensor_mapping(short.camera), "rate": 10}))
    (folder / "images").mkdir()
    size = (short.camera.width, short.camera.height)
    video = cv2.VideoWriter(str(folder / "walk.mp4"), cv2.VideoWriter_fourcc(*"mp4v"), 10.0, size)
    for k, frame in enumerate(_frames(short)):
        cv2.imwrite(str(folder / "images" / f"{k}.png"), frame.image)
        video.write(cv2.cvtColor(frame.image, cv2.COLOR_GRAY2BGR))
    video.release()
    (folder / "times.txt").write_text("".join(f"{f.t}\n" for f in _frames(short)))
    make_targets(folder, clip)
    (folder / "DATA").mkdir()
    sds = np.diag(np.square([0.02, 0.02, 0.05, 0.08, 0.08, 0.02]))[np.tril_indices(6)]
    rows = [",".join(map(str, [f.t, 1.5, 0, 0, 0, 0, 0, *sds])) for f in _frames(short)]
    (folder / "wheels.csv").write_text("\n".join(rows))
    log = of_clip(clip)
    stamps = [f"{t:.6f}" for t in log.times.tolist()]
    (folder / "gyro.csv").write_text(lines(stamps, log.rates @ log.sensor.r_ci.T))
    (folder / "imu.yaml").write_text(
        blocks(ROOT / "docs" / "gyroscope.md", "yaml")[0].replace("0.003", "0.0")
    )
    make_bag(folder / "walk.bag", short)
    write_sensor_bag(folder / "lasers.bag")
    (folder / "sensors.yaml").write_text(blocks(ROOT / "docs" / "own-worn-camera.md", "yaml")[0])
    make_camchain(folder / "camchain.yaml", short)
    collabslam.run(folder / "walk", out=folder / "results" / "walk")
    return folder


@pytest.fixture
def there(place: Path, clip: Clip, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Work in that folder; the demo is a short one."""
    monkeypatch.chdir(place)
    for module in ("collabslam.demo", "collabslam.simulation.recording"):
        monkeypatch.setattr(f"{module}.demo_recording", lambda seed: Short(clip, FRAMES))
    monkeypatch.setattr(evaluate, "run_items", lambda items, **_: [])
    monkeypatch.setattr(evaluate.descriptors, "measure_all", lambda *_: ([], []))
    monkeypatch.setattr(evaluate.blackout, "measure_all", lambda *_: ([], []))
    monkeypatch.setattr(viewpoints, "reproduce", lambda *_, **__: "")
    monkeypatch.setattr(worn_cameras, "run_experiments", lambda *_, **__: {})
    monkeypatch.setattr(evidence, "gather", lambda *_: {"parts": {}})
    return place


def told_of(words: list[str], folder: Path) -> bytes:
    """Digest of a command and of all files that its words name, in a folder or after a sign."""
    digest = hashlib.blake2b(repr(words).encode())
    for part in (part for word in words for part in re.split("[:=,]", word) if part):
        for path in sorted([folder / part, *(folder / part).rglob("*")]):
            if path.is_file():
                digest.update(str(path).encode() + path.read_bytes())
    return digest.digest()


def play(words: list[str], folder: Path) -> None:
    name, *rest = words
    telling = words[:1] == ["collabslam"] and rest[0] in TELLING and "--write" not in rest
    of = told_of(rest, folder) if telling else b""
    if words[-1] == "&":
        command = [sys.executable, "-m", "collabslam", *rest[:-1]]
        BESIDE.append(subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE))
    elif name == "wait":
        while BESIDE:
            process = BESIDE.pop()
            _, said = process.communicate(timeout=LONGEST)
            assert process.returncode == 0, said
    elif of in TOLD:
        return
    elif name in COMMAND_LINES:
        for option in (
            "--out",
            "--record",
            "--recording",
            "--animation",
        ):  # runs of one page do not stand in another's way
            if option in rest and "results" not in rest[rest.index(option) + 1]:
                shutil.rmtree(folder / rest[rest.index(option) + 1], ignore_errors=True)
        try:
            status = COMMAND_LINES[name](rest)
        except SystemExit as done:  # --help
            status = int(done.code or 0)
        loose = "camchain.yaml" in rest  # the cameras of the demo are not a rig, and the run says so
        assert status == (1 if loose else 0), words
        if telling:
            TOLD.add(of)
    elif name in TOOLS:
        subprocess.run([str(Path(sys.executable).parent / name), *rest], check=True, capture_output=True)
    elif name == "make":
        assert f"\n{rest[0]}:" in (ROOT / "Makefile").read_text()
    elif words[:2] == ["pip", "install"]:
        assert rest[1] in (
            ".",
            ".[live]",
            ".[cluster]",
            "./research[learned]",
        )  # what is not published is not promised
    elif name == "cargo":
        assert rest[0] == "bench"
    else:
        raise AssertionError(f"nothing runs {words}")


@pytest.mark.slow
@pytest.mark.parametrize("page", PAGES, ids=lambda p: p.stem)
def test_commands_run(page: Path, there: Path) -> None:
    for words in commands(page):
        if words[:2] == ["collabslam", "live"] and find_spec("zenoh") is None:
            continue  # the extra live is not installed
        for new in ("copied", "new", "calibrated", "odometry", "odometry-mcap", "level.csv"):
            if new in words:
                shutil.rmtree(there / new, ignore_errors=True)
        play(words, there)


@pytest.mark.slow
@pytest.mark.parametrize("page", [p for p in PAGES if blocks(p, "python")], ids=lambda p: p.stem)
def test_python_runs(page: Path, there: Path) -> None:
    names: dict[str, object] = {}
    for block in blocks(page, "python"):
        exec(compile(block, str(page), "exec"), names)


def test_the_tutorial_tells_of_the_demo_as_it_is() -> None:
    recording = demo_recording(0)
    metres = np.linalg.norm(np.diff(recording.truth[:, :3, 3], axis=0), axis=1).sum()
    speed = metres / (recording.times[-1] - recording.times[0])
    words = " ".join((ROOT / "docs" / "tutorial.md").read_text(encoding="utf-8").split())
    assert f"go {metres:.0f} m down a corridor at {speed:.1f} m/s" in words
    assert f"every one of the {len(recording)} frames" in words


def test_every_command_is_documented_somewhere() -> None:
    used = {words[1] for page in PAGES for words in commands(page) if words[0] == "collabslam"}
    assert set(COMMANDS) - used <= {"settings", "reproduce"}


@pytest.mark.slow
def test_the_site_builds(tmp_path: Path) -> None:
    # Not --quiet: what is not shown does not count as a warning.
    command = [sys.executable, "-m", "mkdocs", "build", "--strict", "--site-dir", str(tmp_path)]
    done = subprocess.run(command, check=False, capture_output=True, text=True, cwd=ROOT)
    assert done.returncode == 0, done.stderr
    settings = (tmp_path / "settings" / "index.html").read_text(encoding="utf-8")
    assert "acceleration_density" in settings
    assert "predict_overlap" in (tmp_path / "api" / "index.html").read_text(encoding="utf-8")


def test_links_between_pages_lead_somewhere() -> None:
    for page in [*PAGES, ROOT / "research" / "NOTES.md"]:
        for target in re.findall(r"\]\(([^)#:]+)(?:#[^)]*)?\)", page.read_text(encoding="utf-8")):
            generated = page.parent.name == "docs" and (
                target in ("settings.md", "commands.md", "numbers.md") or target.startswith("rust/")
            )
            assert generated or (page.parent / target).exists(), (page.name, target)


@pytest.mark.skipif(shutil.which("node") is None, reason="KaTeX runs in a browser, or in node")
def test_every_formula_is_set() -> None:
    formulas = [
        formula
        for page in PAGES
        for pair in re.findall(
            r"\$\$(.+?)\$\$|(?<![\\$\w])\$(?!\s)([^$\n]+?)(?<!\s)\$(?![\w$])", outside_code(page), re.DOTALL
        )
        for formula in pair
        if formula
    ]
    assert formulas
    program = (
        "const katex = require(process.argv[1]);"
        "for (const tex of JSON.parse(require('fs').readFileSync(0, 'utf8')))"
        "  katex.renderToString(tex, { throwOnError: true });"
    )
    command = ["node", "-e", program, str(ROOT / "docs" / "katex" / "katex.min.js")]
    done = subprocess.run(command, check=False, input=json.dumps(formulas), capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


def evidence_pages() -> list[str]:
    """Pages of claims, of the list Evidence of the site."""
    listed = (ROOT / "mkdocs.yml").read_text(encoding="utf-8").split("\n  - Evidence:\n")[1]
    return [name for name in re.findall(r": (\S+\.md)$", listed, re.MULTILINE) if name not in OVERVIEWS]


@pytest.mark.parametrize("name", evidence_pages())
def test_a_page_of_evidence_says_what_it_shows_and_what_it_does_not(name: str) -> None:
    page = (ROOT / "docs" / name).read_text(encoding="utf-8")
    tables = [
        (ROOT / "docs" / table).read_text(encoding="utf-8")
        for table in re.findall(r'^--8<-- "(.+)"$', page, re.M)
    ]
    words = " ".join(page.split())
    assert "?" in page.split("\n```")[0], "a question"
    assert re.search(r"^```(sh|text)\n", page, re.MULTILINE), "its command"
    for said in ("It worked if", "**What it shows.**", "**What it does not show.**"):
        assert said in words, said
    assert re.search(r"^\|", "\n".join([page, *tables]), re.MULTILINE), "a table"
    assert re.search(r"commits?\s+[0-9a-f]{7,9}\b", "\n".join([page, *tables])), "the commit"


def test_lines_of_the_method_are_short() -> None:
    page = (ROOT / "docs" / "METHOD.md").read_text(encoding="utf-8")
    assert [line for line in page.splitlines() if len(line) > 110 and not line.startswith("|")] == []


def outside_code(page: Path) -> str:
    """A page without its blocks and spans of code."""
    text = re.sub(r"^ *```.*?^ *```", "", page.read_text(encoding="utf-8"), flags=re.MULTILINE | re.DOTALL)
    return re.sub(r"`[^`\n]+`", "", text)
