"""Licence texts of what is linked into the compiled module, for the wheel: writes LICENSES-LINKED.txt.

    python packaging/licences.py [--check]

Reads the crates that cargo resolves for `pycollab` on any platform, where cargo keeps their sources, and the
notices of Rust's standard library, which the toolchain brings. Needs no network once the crates are fetched.
"""

from __future__ import annotations

import argparse
import json
import re
import subprocess
import sys
from dataclasses import dataclass
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[1]
OUT = ROOT / "LICENSES-LINKED.txt"
CRATE = "pycollab"
NAMES = re.compile(r"(un)?licen[cs]es?|copying|notice|copyright", re.IGNORECASE)
RULE = "=" * 100
STANDARD = "Rust's standard library"
HEAD = f"""\
Licences of what is linked into collabslam's compiled module
{RULE}

The module holds the Rust crates below, on some platforms not all of them, and parts of {STANDARD}.
Each stands under its own licence; the numbers name the texts that follow. Where two licences stand with OR,
either may be chosen. The source of each crate is published under its name and version in Rust's package
registry; that of the standard library comes with the toolchain.
"""
INSIDE = f"""
{STANDARD}
{RULE}

It stands under MIT or Apache-2.0, but for what is said here of single files; the crates in it follow.
"""


@dataclass(frozen=True)
class Part:
    """Something that is linked.

    Attributes
    ----------
    name : str
        With the version.
    licence : str
        As it states it, SPDX.
    texts : tuple of str
        Its licence files.
    """

    name: str
    licence: str
    texts: tuple[str, ...]


def linked_crates() -> list[Part]:
    """The crates of others that the module links, on any platform; procedural macros are not linked."""
    tree = _cargo("tree", "--package", CRATE, "--edges", "normal,no-proc-macro", "--target", "all")
    wanted = {tuple(line.split()[:2]) for line in tree.splitlines() if line}
    packages: list[dict[str, Any]] = json.loads(_cargo("metadata", "--format-version", "1"))["packages"]
    return [
        _crate(package)
        for package in sorted(packages, key=lambda p: (p["name"], p["version"]))
        if package["source"] and (package["name"], f"v{package['version']}") in wanted
    ]


def _cargo(command: str, *options: str) -> str:
    words = ["cargo", command, "--locked", *options]
    if command == "tree":
        words += ["--prefix", "none", "--no-dedupe"]
    return subprocess.run(words, cwd=ROOT, stdout=subprocess.PIPE, text=True, check=True).stdout


def _crate(package: dict[str, Any]) -> Part:
    folder = Path(package["manifest_path"]).parent
    files = sorted(path for path in folder.iterdir() if path.is_file() and NAMES.match(path.name))
    texts = [_tidy(path.read_text(encoding="utf-8", errors="replace")) for path in files]
    if not any("licen" in path.name.lower() for path in files):
        texts.insert(0, _standard_text(package))
    return Part(f"{package['name']} {package['version']}", package["license"], tuple(texts))


def _standard_text(package: dict[str, Any]) -> str:
    """The text of the licence that a crate states without bringing it along."""
    if package["license"] != "MIT":
        sys.exit(
            f"{package['name']} brings no text of its licence, {package['license']}; add one to {__file__}."
        )
    authors = ", ".join(package["authors"]) or f"the authors of {package['name']}, {package['repository']}"
    ours = (ROOT / "LICENSE-MIT").read_text(encoding="utf-8")
    return _tidy(re.sub(r"(?m)^Copyright .*$", f"Copyright (c) {authors}", ours, count=1))


def _tidy(text: str) -> str:
    lines = [line.rstrip() for line in text.replace("\r\n", "\n").replace("\f", "\n").splitlines()]
    return "\n".join(lines).strip("\n")


class _Notices(HTMLParser):
    """The toolchain's notices: words, then a heading, words and texts for each crate in the library."""

    def __init__(self) -> None:
        super().__init__()
        self.words: list[str] = []
        self.parts: list[tuple[str, list[str], list[str]]] = []
        self._in = ""

    def handle_starttag(self, tag: str, attrs: object) -> None:
        if tag in {"h3", "pre", "title", "style"}:
            self._in = tag
        if tag == "h3":
            self.parts.append(("", [], []))
        if tag == "pre":
            self.parts[-1][2].append("")

    def handle_endtag(self, tag: str) -> None:
        if tag == self._in:
            self._in = ""

    def handle_data(self, data: str) -> None:
        if self._in == "pre":
            self.parts[-1][2][-1] += data
        elif self._in == "h3":
            self.parts[-1] = (data.strip("📦 \n"), *self.parts[-1][1:])
        elif not self._in and data.strip():
            (self.parts[-1][1] if self.parts else self.words).append(" ".join(data.split()))


def standard_library() -> tuple[str, list[Part]]:
    """What the toolchain says of the files of its standard library, and the crates in that."""
    sysroot = subprocess.run(["rustc", "--print", "sysroot"], stdout=subprocess.PIPE, text=True, check=True)
    folder = Path(sysroot.stdout.strip()) / "share" / "doc" / "rust"
    notices = _Notices()
    notices.feed((folder / "COPYRIGHT-library.html").read_text(encoding="utf-8"))
    words = "\n".join(notices.words)
    words = words[words.index("File/Directory:") : words.rindex("Out-of-tree dependencies")]
    words = re.sub(r"(File/Directory:|License:|Copyright:)\n", r"\1 ", words)
    licences = sorted(
        {name for line in re.findall(r"License: (.*)", words) for name in re.findall(r"[\w.-]+", line)}
    )
    own = [folder / "licenses" / f"{name}.txt" for name in licences if name not in {"AND", "OR"}]
    texts = tuple(_tidy(path.read_text(encoding="utf-8")) for path in own)
    return words, [
        Part("the library itself", "as said above", texts),
        *(
            Part(name, said[said.index("License:") + 1], tuple(_tidy(text) for text in texts))
            for name, said, texts in notices.parts
        ),
    ]


class Texts:
    """Texts with a number each; the same words twice are one text."""

    def __init__(self) -> None:
        self._known: dict[str, int] = {}

    def told(self, parts: list[Part]) -> str:
        """Rows of the parts with the numbers of their texts, and the texts that are new."""
        width = max(len(part.name) for part in parts), max(len(part.licence) for part in parts)
        rows, new = [], []
        for part in parts:
            numbers = []
            for text in part.texts:
                words = " ".join(text.split())
                if words not in self._known:
                    self._known[words] = len(self._known) + 1
                    new.append(f"\n[{self._known[words]}]\n{RULE}\n\n{text}\n")
                numbers.append(f"[{self._known[words]}]")
            rows.append(f"{part.name:{width[0]}}  {part.licence:{width[1]}}  {' '.join(numbers)}\n")
        return "".join([*rows, *new])


def main() -> None:
    """Write the file, or compare it with what it should be."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--check", action="store_true", help="write nothing; fail if the file is out of date")
    texts = Texts()
    crates = f"{HEAD}\n{texts.told(linked_crates())}"
    if parser.parse_args().check:
        if not OUT.read_text(encoding="utf-8").startswith(crates):  # the rest is that of any toolchain
            sys.exit(
                f"{OUT.name} is not that of these crates; write it anew with python {Path(__file__).name}."
            )
        return
    words, inside = standard_library()
    OUT.write_text(f"{crates}{INSIDE}\n{words}\n{texts.told(inside)}", encoding="utf-8")


if __name__ == "__main__":
    main()
