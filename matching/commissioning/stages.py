"""Steps of a commissioning that are not repeated once they are done: a folder each, and a record with checksums."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from matching.records import append, rows
from modelling.common.errors import InputError
from modelling.common.tables import no_pipe
from modelling.writing.output import write_all

Files = Mapping[str, str | bytes]
RECORD = "commission.jsonl"
KINDS = {"step": str, "inputs": str, "files": dict, "figures": dict}  # of a row on record, by key


@dataclass(frozen=True)
class Stages:
    """The folder of a commissioning."""

    folder: Path

    def done(self, name: str, inputs: str) -> dict[str, Any] | None:
        """Figures of a step that was done on the same inputs (a checksum) and whose files are all as they were."""
        figures = None
        for row in rows(self.folder / RECORD, KINDS):
            if row["step"] == name and row["inputs"] == inputs and self._unchanged(name, row["files"]):
                figures = row["figures"]
        return figures

    def run(
        self,
        name: str,
        inputs: str,
        work: Callable[[], tuple[Files, dict[str, Any]]],
        enough: Callable[[Mapping[str, Any]], bool] = lambda _: True,
    ) -> dict[str, Any]:
        """Figures of a step: as recorded, where they are ``enough``, or of the ``work`` that gives files and figures.

        Raises
        ------
        InputError
            If the folder cannot be written to, or the work's own.
        """
        figures = self.done(name, inputs)
        if figures is not None and enough(figures):
            return figures
        if (self.folder / name).is_symlink():
            raise InputError(str(self.folder / name), "is a link", "remove it: steps are written to this folder only")
        files, figures = work()
        write_all(self.folder / name, files)
        sums = {path: checksum(content) for path, content in files.items()}
        append(self.folder / RECORD, {"step": name, "inputs": inputs, "files": sums, "figures": figures})
        return figures

    def _unchanged(self, name: str, files: Mapping[str, str]) -> bool:
        for path, wanted in files.items():
            place = self.folder / name / path
            if not place.is_file() or checksum(place.read_bytes()) != wanted:
                return False
        return True

    def of_files(self, *paths: Path) -> str:
        """Checksum of the contents of files.

        Raises
        ------
        InputError
            If one is a pipe or a device, which may never end.
        """
        total = hashlib.sha256()
        for path in paths:
            no_pipe(path, str(path))
            total.update(hashlib.sha256(path.read_bytes()).digest())
        return total.hexdigest()[:32]


def checksum(content: str | bytes) -> str:
    """Of a file's content."""
    return hashlib.sha256(content.encode() if isinstance(content, str) else content).hexdigest()[:32]
