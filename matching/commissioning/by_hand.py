"""Recordings that a person puts into a folder, whole or while they are being written."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

from matching.bed_test.growing import appeared, snapshots
from matching.bed_test.result import COVERAGE_FACTOR, BedVerification
from modelling.common.errors import InputError
from modelling.measurement.readers.comma_separated import LARGEST_FILE, WINDOWS
from modelling.writing.output import write_all

Tell = Callable[[str], None]


class Waiting(Exception):
    """A recording is not there yet: ``what`` says which, and where to put it."""

    def __init__(self, what: str):
        super().__init__(what)
        self.what = what


def so_far(verification: BedVerification) -> str:
    """What a verification of a part of a recording shows, in words."""
    errors = [
        f"{error.name} torques {error.value:.3g} ± {COVERAGE_FACTOR * error.uncertainty:.2g}"
        for error in verification.errors
    ]
    return f"so far {verification.status}: response error to {', '.join(errors)}"


@dataclass(frozen=True)
class ByHand:
    """A folder for recordings; ``follow`` (s) says how long one that grows has to stand still, None: it is whole."""

    folder: Path
    follow: float | None
    tell: Tell

    def recording(self, name: str, files: Mapping[str, str], what: str, estimate: Callable[[Path], str]) -> str:
        """Text of ``NAME.csv`` in the folder; until it is there, the files that it needs lie beside its place.

        Parameters
        ----------
        files : mapping of str to str
            By the end of their name.
        what : str
            What to record.
        estimate : callable
            What a recording shows so far, in words; it may raise an InputError.

        Raises
        ------
        Waiting
            If it is not there, and nobody follows it.
        """
        place = self.folder / f"{name}.csv"
        if not place.is_file():
            write_all(self.folder, {f"{name}_{file}": text for file, text in files.items()})
            if self.follow is None:
                raise Waiting(f"{place}: {what}; then run the same command again")
            self.tell(f"waiting for {place}: {what}")
            appeared(place)
        if self.follow is None:
            return _text(place, place)
        text = ""
        with TemporaryDirectory(prefix="rigmatch-") as folder:
            for (copy,) in snapshots([place], self.follow, Path(folder)):
                text = _text(copy, place)
                try:
                    self.tell(f"{place.name}: {estimate(copy)}")
                except InputError as fault:
                    self.tell(f"{place.name}: not yet: {str(fault).replace(str(copy), str(place))}")
        return text


def _text(path: Path, place: Path) -> str:
    """Text of a recording, in an encoding that recordings are read in.

    Raises
    ------
    InputError
        If it is too large, or no text.
    """
    if path.stat().st_size > LARGEST_FILE:
        raise InputError(str(place), "is too large", "cut the recording: at most 2 GB are read")
    for encoding in ("utf-8-sig", WINDOWS):
        try:
            return path.read_text(encoding=encoding)
        except UnicodeDecodeError:
            continue
    raise InputError(str(place), "is no text", "save it as UTF-8 CSV")
