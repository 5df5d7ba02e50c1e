"""Rows of JSON in a file, one a line: a run that was killed in the middle of one goes on."""

import json
from pathlib import Path


def append(path: Path, row: dict) -> None:
    """Write a row at the end, on a line of its own even where the last one was left half written."""
    before = path.read_bytes()[-1:] if path.exists() else b""
    with path.open("a", encoding="utf-8") as file:
        file.write(("" if before in (b"", b"\n") else "\n") + json.dumps(row, ensure_ascii=False) + "\n")


def rows(path: Path) -> list[dict]:
    """All whole rows of a file; what is left half written is not counted and will be done again."""
    whole = []
    for line in path.read_text(encoding="utf-8", errors="replace").split("\n"):
        try:
            whole.append(json.loads(line))
        except json.JSONDecodeError:
            continue
    return whole
