"""Recordings that a person puts into a folder, whole or while they are being written."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

from matching.bed_test.growing import TEXT, appeared, snapshots
from matching.bed_test.result import COVERAGE_FACTOR, BedVerification
from modelling.common.errors import InputError
from modelling.measurement.readers import READERS
from modelling.measurement.readers.comma_separated import LARGEST_FILE, WINDOWS
from modelling.writing.output import write_all

Tell = Callable[[str], None]
KEPT = "recording"  # name of a step's recording, less the end that says its format


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
class HandedRecording:
    """A recording as a step keeps it: the name of its file, and its content; text is kept as text."""

    name: str
    content: str | bytes


def kept_recording(folder: Path) -> Path:
    """Where a step keeps its recording, of whatever format it is."""
    kept = [path for path in _places(folder, KEPT) if path.is_file()]
    return kept[0] if kept else folder / f"{KEPT}.csv"


def keep_recording(folder: Path, recording: HandedRecording) -> None:
    """Write the recording of a step; one of another format, of an earlier run, goes away."""
    write_all(folder, {recording.name: recording.content})
    for path in _places(folder, KEPT):
        if path.name != recording.name:
            path.unlink(missing_ok=True)


@dataclass(frozen=True)
class ByHand:
    """A folder for recordings; ``follow`` (s) says how long one that grows has to stand still, None: it is whole."""

    folder: Path
    follow: float | None
    tell: Tell

    def recording(
        self, name: str, files: Mapping[str, str], what: str, estimate: Callable[[Path], str]
    ) -> HandedRecording:
        """``NAME.csv`` of the folder, or in another format; until it is there, what it needs lies beside its place.

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
        InputError
            If it is there in two formats, or no recording can be read from it.
        """
        places = _places(self.folder, name)
        if not any(place.is_file() for place in places):
            write_all(self.folder, {f"{name}_{file}": text for file, text in files.items()})
            if self.follow is None:
                raise Waiting(f"{places[0]}: {what}; then run the same command again")
            self.tell(f"waiting for {places[0]}: {what}")
            appeared(places)
        present = [place for place in places if place.is_file()]
        if len(present) > 1:
            raise InputError(str(present[0]), f"is there as {present[1].name} too", "leave one of them")
        return self._taken(present[0], estimate)

    def _taken(self, place: Path, estimate: Callable[[Path], str]) -> HandedRecording:
        """The recording as it is, or as it is when it has stood still; what it shows until then is said."""
        name = f"{KEPT}{place.suffix}"
        if self.follow is None:
            return HandedRecording(name, _content(place, place))
        content: str | bytes = ""
        with TemporaryDirectory(prefix="rigmatch-") as folder:
            for (copy,) in snapshots([place], self.follow, Path(folder)):
                content = _content(copy, place)
                try:
                    self.tell(f"{place.name}: {estimate(copy)}")
                except InputError as fault:
                    self.tell(f"{place.name}: not yet: {str(fault).replace(str(copy), str(place))}")
        return HandedRecording(name, content)


def _places(folder: Path, name: str) -> list[Path]:
    """Where a recording of a name may lie, as CSV first."""
    return [folder / f"{name}{suffix}" for suffix in READERS]


def _content(path: Path, place: Path) -> str | bytes:
    """Content of a recording, text in an encoding that recordings are read in.

    Raises
    ------
    InputError
        If it is too large, or to be text and none.
    """
    if path.stat().st_size > LARGEST_FILE:
        raise InputError(str(place), "is too large", "cut the recording: at most 2 GB are read")
    if path.suffix not in TEXT:
        return path.read_bytes()
    return _text(path, place)


def _text(path: Path, place: Path) -> str:
    """Text of a recording in either encoding."""
    for encoding in ("utf-8-sig", WINDOWS):
        try:
            return path.read_text(encoding=encoding)
        except UnicodeDecodeError:
            continue
    raise InputError(str(place), "is no text", "save it as UTF-8 CSV")
