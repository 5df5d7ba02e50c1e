"""Where a result comes from: date, version, seed, input files with checksums, the case as it was run."""

from __future__ import annotations

import hashlib
import os
import time
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from matching.frequency.case.case import Case
from modelling.common.tables import read_toml
from modelling.common.version import VERSION


@dataclass(frozen=True)
class Provenance:
    """What a match was made from.

    Attributes
    ----------
    date : str
        Day of the run (UTC), or that of ``SOURCE_DATE_EPOCH`` where that is set.
    version : str
    seed : int or None
        None where nothing was drawn.
    files : tuple of (str, str)
        Path and SHA-256 of every input file, the case file first; empty where the case came from no file.
    case_text : str
        The case file as it was read.
    """

    date: str
    version: str
    seed: int | None
    files: tuple[tuple[str, str], ...]
    case_text: str

    def to_dict(self) -> dict[str, Any]:
        """``made_by`` of ``result.json``."""
        case, checksum = self.files[0] if self.files else ("", "")
        files = [{"file": file, "sha256": sum_} for file, sum_ in self.files]
        return {
            "version": self.version, "date": self.date, "case": case, "sha256": checksum, "seed": self.seed,
            "files": files,
        }  # fmt: skip


def provenance(case: Case, seed: int) -> Provenance:
    """Of a case that was read from a file, and the seed of its match."""
    return made_from(case.path, seed, ("vehicle", "rig"))


def with_recordings(made: Provenance, recordings: Iterable[tuple[str, str | Path]]) -> Provenance:
    """The same with recordings, each by its name and by the file that was read."""
    return replace(made, files=(*made.files, *((name, _checksum(Path(file))) for name, file in recordings)))


def _checksum(file: Path) -> str:
    with file.open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()


def made_from(file: str | Path, seed: int | None, names: Sequence[str] = ()) -> Provenance:
    """Of an input file (TOML; empty for none), of the files that it names under the keys ``names``, and a seed."""
    now = float(os.environ.get("SOURCE_DATE_EPOCH") or time.time())
    date = time.strftime("%Y-%m-%d", time.gmtime(now))
    path = Path(file)
    if not file or not path.is_file():
        return Provenance(date, VERSION, seed, (), "")
    content = read_toml(path) if names else {}
    files = [path, *(path.parent / content[key] for key in names if isinstance(content.get(key), str))]
    checked = tuple((str(each), _checksum(each)) for each in files if each.is_file())
    return Provenance(date, VERSION, seed, checked, path.read_text(encoding="utf-8"))
