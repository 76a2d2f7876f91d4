"""All evidence by one command: what is kept, skipped, named and packed."""

from __future__ import annotations

import json
import re
import tarfile
from pathlib import Path

import pytest

import collabslam
from collabslam.errors import SettingsError
from collabslam_lab.cli import COMMANDS
from collabslam_lab.evidence import Asked, gather, made_of
from collabslam_lab.evidence.archive import table_of
from collabslam_lab.evidence.parts import BENCHES, DATA, PARTS, Part

DOCS = Path(collabslam.__file__).parents[2] / "docs"
RANK = ("reproduce", "observability", "--out", "OUT", "--jobs", "--runs", "2")
FEW = (
    Part("rank", "What can be told?", [RANK], [RANK], {"observability": "observability.md"}),
    Part("broken", "Does a fault end the others?", [["reproduce", "nothing"]], [["reproduce", "nothing"]]),
    Part("recorded", "And without recordings?", [["peers", DATA]], [["peers", DATA]], {"peers": "peers.md"}),
    Part("empty", "And without its table?", [["worlds"]], [["worlds"]], {"worlds": "worlds.md"}),
)


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("evidence")
    gather(out, Asked(quick=True, jobs=1), FEW)
    return out


def test_a_fault_or_missing_data_ends_no_other_part_and_is_named(made: Path) -> None:
    parts = json.loads((made / "evidence.json").read_text())["parts"]
    assert {name: part["status"] for name, part in parts.items()} == {
        "rank": "done", "broken": "failed", "recorded": "skipped", "empty": "failed"
    }  # fmt: skip
    assert "reproduce nothing" in parts["broken"]["why"]
    assert "--data" in parts["recorded"]["why"]
    assert "worlds.md" in parts["empty"]["why"]


def test_the_archive_says_what_it_was_made_of_and_is_the_same_again(made: Path) -> None:
    about = json.loads((made / "evidence.json").read_text())
    assert about["packages"]["numpy"]
    assert about["machine"]["cores"] >= 1
    assert about["commit"] == made_of.commit() != ""
    with tarfile.open(made / "evidence.tar.gz") as tar:
        names = tar.getnames()
    rank = {f"evidence/rank/observability.{kind}" for kind in ("json", "md", "csv", "png")}
    assert {"evidence/evidence.json", "evidence/tables/observability.md", *rank} == set(names)
    first = (made / "evidence.tar.gz").read_bytes()
    gather(made, Asked(quick=True, jobs=1, only=["rank"]), FEW)
    assert (made / "evidence.tar.gz").read_bytes() == first


def test_a_table_says_its_commit_and_command_and_has_no_title(made: Path) -> None:
    lines = (made / "tables" / "observability.md").read_text().splitlines()
    assert f"at commit {made_of.commit()}" in lines[0]
    assert "`collabslam-lab reproduce observability --out OUT --runs 2`" in lines[0]
    assert "small piece" in lines[0]
    assert not [line for line in lines if line.startswith(("# ", "!["))]
    assert [line for line in lines if line.startswith("|")]


def test_what_is_done_is_not_done_again_unless_something_changed(
    made: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    before = (made / "rank" / "observability.json").stat().st_mtime_ns
    gather(made, Asked(quick=True, jobs=1, only=["rank"]), FEW)
    assert "rank: there already" in capsys.readouterr().out
    assert (made / "rank" / "observability.json").stat().st_mtime_ns == before
    path = made / "evidence.json"
    path.write_text(path.read_text().replace(json.loads(path.read_text())["program"], "another"))
    gather(made, Asked(quick=True, jobs=1, only=["rank"]), FEW)
    assert (made / "rank" / "observability.json").stat().st_mtime_ns > before


def test_tables_of_a_quick_run_are_not_for_the_documentation(tmp_path: Path) -> None:
    with pytest.raises(SettingsError, match="--quick"):
        gather(tmp_path, Asked(quick=True, tables=tmp_path / "tables"), FEW)
    with pytest.raises(SettingsError, match="no part 'rnak'"):
        gather(tmp_path, Asked(only=["rnak"]), FEW)
    with pytest.raises(SettingsError, match="--jobs"):
        gather(tmp_path, Asked(jobs=0), FEW)


def test_parts_call_commands_that_there_are_and_each_table_has_one_owner() -> None:
    for part in PARTS:
        for command in (*part.full, *part.quick):
            assert command[0] in (*COMMANDS, BENCHES), part.name
    tables = [name for part in PARTS for name in part.tables]
    assert len(tables) == len(set(tables))


@pytest.mark.skipif(not DOCS.is_dir(), reason="needs the source tree")
def test_every_table_of_the_documentation_has_an_owner_and_says_its_commit() -> None:
    owned = {name for part in PARTS for name in part.tables}
    kept = sorted((DOCS / "tables").glob("*.md"))
    assert kept
    for path in kept:
        assert path.stem in owned, path.name
        assert re.search(r"commit [0-9a-f]{7,}", path.read_text(encoding="utf-8")), path.name
        shown = [p for p in DOCS.glob("*.md") if f'"tables/{path.name}"' in p.read_text(encoding="utf-8")]
        assert len(shown) == 1, path.name


def test_a_table_leaves_out_title_command_and_picture(tmp_path: Path) -> None:
    page = "# Title\n\n```sh\ncollabslam-lab evaluate\n```\n\nWhat.\n\n![a](a.png)\n\n| a |\n|---|\n| 1 |\n"
    (tmp_path / "page.md").write_text(page)
    text = table_of(tmp_path / "page.md", "Made so.")
    assert [line for line in text.splitlines() if line] == ["*Made so.*", "What.", "| a |", "|---|", "| 1 |"]
