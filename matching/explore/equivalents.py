"""What does the same without the page: a command for the terminal, and lines of Python."""

from __future__ import annotations

import json
import shlex
from collections.abc import Sequence
from dataclasses import dataclass


@dataclass(frozen=True)
class Equivalent:
    """A command and the lines of Python that do the same."""

    command: str
    python: str


def show(file: str, out: str) -> Equivalent:
    """The drawing."""
    return _made(("show", file, "--out", out), f"rm.show({_text(file)})")


def modes(file: str, out: str) -> Equivalent:
    """Modes of a model."""
    return _made(("modes", file, "--out", out), f"modes = rm.modes({_text(file)})\nmodes.plot()")


def match(case: str, out: str, starts: str, seed: str) -> Equivalent:
    """A match."""
    words = ("match", case, "--starts", starts, "--seed", seed, "--out", out)
    return _made(words, f"result = rm.match({_text(case)}, seed={seed}, starts={starts})\nresult.plot()")


def map_of(case: str, x: str, y: str, out: str) -> Equivalent:
    """A map."""
    python = f"map = rm.map({_text(case)}, x={_text(x)}, y={_text(y)})\nmap.plot()"
    return _made(("map", case, "--x", x, "--y", y, "--out", out), python)


def diagnose(model: str, recordings: Sequence[str], channels: str, out: str) -> Equivalent:
    """A diagnosis."""
    named = ("--channels", channels) if channels else ()
    words = ("diagnose", model, *recordings, *named, "--out", out)
    also = f", channels={_text(channels)}" if channels else ""
    files = ", ".join(map(_text, recordings))
    return _made(words, f"diagnosis = rm.diagnose({_text(model)}, [{files}]{also})\nprint(diagnosis)")


def uncertainty(budget: str, out: str, draws: int) -> Equivalent:
    """A budget."""
    python = f"result = rm.uncertainty({_text(budget)}, draws={draws})\nprint(result)"
    return _made(("uncertainty", budget, "--draws", str(draws), "--out", out), python)


def fidelity(case: str, out: str) -> Equivalent:
    """A fidelity case."""
    return _made(("fidelity", case, "--out", out), f"result = rm.fidelity({_text(case)})\nprint(result)")


def _made(words: Sequence[str], python: str) -> Equivalent:
    return Equivalent(shlex.join(("rigmatch", *words)), f"import rigmatch as rm\n{python}")


def _text(text: str) -> str:
    return json.dumps(text, ensure_ascii=False)
