"""The archive of what was found, and the tables that the documentation shows."""

from __future__ import annotations

import gzip
import io
import re
import tarfile
from pathlib import Path

from collabslam.formats.files import read_text, write_bytes

_KEPT = {".json", ".md", ".csv", ".png"}


def table_of(path: Path, how: str) -> str:
    """A study's page as a table of the docs: how it was made, and all but title, command and pictures."""
    lines = re.sub(r"^```sh\n.*?^```\n", "", read_text(path), flags=re.MULTILINE | re.DOTALL).splitlines()
    shown = "\n".join(line for line in lines if not line.startswith(("# ", "!["))).strip()
    return f"*{how}*\n\n{shown}\n"


def pack(folder: Path, parts: list[str]) -> Path:
    """``evidence.tar.gz`` in `folder`: summary, tables, and what each part says and draws, not its runs.

    The same files give the same bytes.
    """
    files = [folder / "evidence.json", *sorted((folder / "tables").glob("*.md"))]
    for part in parts:
        files += sorted(p for p in (folder / part).glob("*") if p.suffix in _KEPT and p.is_file())
    packed = io.BytesIO()
    with (
        gzip.GzipFile(fileobj=packed, mode="wb", mtime=0) as squeezed,
        tarfile.open(fileobj=squeezed, mode="w", format=tarfile.PAX_FORMAT) as tar,
    ):
        for path in files:
            data = path.read_bytes()
            entry = tarfile.TarInfo(f"evidence/{path.relative_to(folder).as_posix()}")
            entry.size = len(data)
            tar.addfile(entry, io.BytesIO(data))
    out = folder / "evidence.tar.gz"
    write_bytes(out, packed.getvalue())
    return out
