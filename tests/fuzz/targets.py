"""What is done with each kind of input, and what counts as a failure.

Every input must be answered or refused by one :class:`InputError` of one line; anything else is a failure.
"""

from __future__ import annotations

import contextlib
import io
import os
import signal
import tomllib
import traceback
import warnings
import zlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

from matching.cli import main
from matching.export import read_export_source, tuned_case
from matching.fidelity import read_case, xil_fidelity
from matching.match.case_file import load_case
from matching.match.responses import ComparedBed as compared_bed
from matching.match.responses import figures_of
from matching.uncertainty.budget import read_budget
from matching.uncertainty.evaluate import evaluate
from modelling.errors import BAD_INPUT, FAULT, InputError
from modelling.modal.modes import damped_modes, modes
from modelling.model_file import dumps, from_dict, load
from modelling.recordings.read import read_channels, read_recording
from modelling.writing import strict_json
from tests.fuzz.seed import ROOT, Seed

LONGEST_LINE = 1500  # characters of a message: place, what is wrong and what is right are cut at 400 each
SECONDS = 20.0  # of processor time; most inputs take a hundredth of one
LARGEST_SWEPT = 40  # inertias and shafts of a model whose modes are found
DEEP_SHARE = 4  # one model in so many is taken through to its modes, one case to its response errors
DRAWS = 1000


class TooLong(BaseException):
    """More processor time than any small input needs."""


@dataclass(frozen=True)
class Target:
    """How one kind of input is read, and what is calculated from it where ``deep``."""

    suffix: str
    run: Callable[[Path, bool], None]
    share: float


def _model(path: Path, deep: bool) -> None:
    system = load(path)
    again = from_dict(tomllib.loads(dumps(system)))
    if dumps(again) != dumps(system):
        raise AssertionError("a model that is written and read again is another one")
    small = len(system.inertias) + len(system.shafts) <= LARGEST_SWEPT
    if deep and small and zlib.crc32(path.read_bytes()) % DEEP_SHARE == 0:
        strict_json(modes(system).to_dict())
        strict_json(damped_modes(system).to_dict())


def _case(path: Path, deep: bool) -> None:
    case = load_case(path)
    if deep and zlib.crc32(path.read_bytes()) % DEEP_SHARE == 0:
        figures = figures_of(compared_bed(case))
        strict_json([figures.after, figures.unmeasured])


def _drive(path: Path, _: bool) -> None:
    """A vehicle or a rig as its case reads it."""
    path.replace(path.parent / f"{(path.parent / 'role.txt').read_text()}.toml")
    load_case(path.parent / "case.toml")


def _budget(path: Path, deep: bool) -> None:
    budget = read_budget(path)
    if deep:
        strict_json(evaluate(budget, draws=DRAWS).to_dict())


def _fidelity(path: Path, deep: bool) -> None:
    case = read_case(str(path), None, None, None)
    if deep:
        strict_json(xil_fidelity(*case, 100, 1).to_dict())


def _recording(path: Path, _: bool) -> None:
    system = load(path.parent / "model.toml")
    read_recording(path, system).inputs(system)


def _channels(path: Path, _: bool) -> None:
    system = load(path.parent / "model.toml")
    read_recording(path.parent / "drive.csv", system, read_channels(path))


def _binary(path: Path, _: bool) -> None:
    """A file for a library in C, which goes by its suffix."""
    system = load(path.parent / "model.toml")
    suffix = (path.parent / "suffix.txt").read_text()
    read_recording(path.rename(path.with_suffix(suffix)), system).inputs(system)


def _result(path: Path, _: bool) -> None:
    """What an earlier match left, as `export`, `verify` and `excite` read it."""
    _at_tuned_values = tuned_case(path).tuned
    read_export_source(path)


def _words(path: Path, _: bool) -> None:
    """The words of a command line, one a line; none that leaves the folder or asks for hours."""
    words = path.read_text(errors="replace").split("\n")
    if any(word.startswith(("/", "~")) or ".." in word or "=/" in word for word in words):
        return
    if any(len(word) > 4 and word.strip("-+_ ").isdecimal() for word in words) or "\x00" in "".join(words):
        return
    here = os.getcwd()
    os.chdir(path.parent)
    said = io.StringIO()
    try:
        with contextlib.redirect_stderr(said), contextlib.redirect_stdout(io.StringIO()):
            code = main(words)
    finally:
        os.chdir(here)
    if code == FAULT:
        raise AssertionError(f"exit 1: {said.getvalue()}")
    if code == BAD_INPUT and said.getvalue().count("\n") != 1:
        raise AssertionError(f"not one line: {said.getvalue()}")


TARGETS = {
    "model": Target(".toml", _model, 4),
    "case": Target(".toml", _case, 2),
    "budget": Target(".toml", _budget, 3),
    "fidelity": Target(".toml", _fidelity, 2),
    "recording": Target(".csv", _recording, 2),
    "channels": Target(".toml", _channels, 1),
    "result": Target(".json", _result, 0.5),
    "words": Target(".txt", _words, 0.5),
    "drive": Target(".toml", _drive, 1.5),
    "binary": Target("", _binary, 0.03),
}


def failure(seed: Seed, content: bytes, folder: Path, *, deep: bool) -> str:
    """What went wrong, as exception and place in the program; empty if the input is answered or refused rightly.

    Parameters
    ----------
    folder : Path
        An empty one, or one that an input of the same seed was tried in.
    deep : bool
        Whether to calculate, or read and check only.
    """
    target = TARGETS[seed.target]
    for name, beside in seed.beside.items():
        if not (folder / name).exists():
            (folder / name).write_bytes(beside)
    path = folder / f"input{target.suffix}"
    path.write_bytes(content)
    try:
        with _deadline(), warnings.catch_warnings():
            warnings.simplefilter("ignore")
            target.run(path, deep)
    except InputError as error:
        line = str(error)
        if not line.isprintable() or not 0 < len(line) <= LONGEST_LINE:
            return f"message of {len(line)} characters that is not one printable line"
    except (Exception, TooLong) as error:
        return f"{type(error).__name__} at {_place(error)}"
    return ""


def _place(error: BaseException) -> str:
    """The last line of the program's own that the exception came through."""
    steps = [step for step in traceback.extract_tb(error.__traceback__) if step.filename.startswith(str(ROOT))]
    own = [step for step in steps if "site-packages" not in step.filename and "/tests/" not in step.filename]
    last = (own or steps)[-1]
    text = str(error).splitlines()[0][:100] if isinstance(error, AssertionError) and str(error) else ""
    return f"{Path(last.filename).name}:{last.name} {text}".strip()


@contextlib.contextmanager
def _deadline() -> Iterator[None]:
    def stop(*_: object) -> None:
        raise TooLong

    before = signal.signal(signal.SIGVTALRM, stop)
    signal.setitimer(signal.ITIMER_VIRTUAL, SECONDS)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_VIRTUAL, 0)
        signal.signal(signal.SIGVTALRM, before)
