"""``--check``: a command runs until its files are read, says what they hold, and ends before it computes."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from contextvars import ContextVar
from typing import TYPE_CHECKING, Any

from modelling.display import counted

if TYPE_CHECKING:
    from matching.match.case import Case
    from modelling.system import System

_contents: ContextVar[dict[str, str] | None] = ContextVar("contents", default=None)


class _AllRead(Exception):
    """Ends a dry run."""


@contextmanager
def dry_run() -> Iterator[dict[str, str]]:
    """Within, a function ends where it would begin to compute; yields what was read, in words by file."""
    found: dict[str, str] = {}
    token = _contents.set(found)
    try:
        with suppress(_AllRead):
            yield found
    finally:
        _contents.reset(token)


def was_read(file: Any, words: Callable[[], str]) -> None:
    """Tell a dry run what a file holds."""
    if (contents := _contents.get()) is not None:
        contents[str(file)] = words()


def computing(further: Callable[[], Mapping[str, str]] = dict) -> None:
    """Where a function begins to compute: a dry run reads ``further`` files, and ends."""
    if (contents := _contents.get()) is not None:
        contents |= further()
        raise _AllRead


def is_dry() -> bool:
    """Whether nothing will be computed."""
    return _contents.get() is not None


def model_words(system: System) -> str:
    """What a model holds."""
    parts = [
        counted(len(getattr(system, table)), word)
        for table, word in (
            ("inertias", "inertia"), ("shafts", "shaft"), ("gears", "gear"), ("gearboxes", "gearbox"),
            ("differentials", "differential"),
            ("planetary_gears", "planetary gear"), ("inputs", "input"), ("sensors", "sensor"), ("effects", "effect"),
        )
        if getattr(system, table)
    ]  # fmt: skip
    return f"a model: {', '.join(parts)}"


def case_words(case: Case) -> str:
    """What a case holds, its target modes checked; which limits the manoeuvre exceeds on the bed as planned."""
    from matching.match.demands import demands, rig_values
    from matching.match.findings import asks
    from matching.match.targets import target_modes

    broken = {one.limit: one for one in reversed(demands(case).broken(rig_values(case)))}
    planned = [f"as planned, {asks(*one)}" for one in broken.values()]
    notes = "".join(f"\n  note: {note}" for note in (*case.notes, *planned))
    return (
        f"a case: {counted(len(case.loop.dynamometers), 'dynamometer')}, "
        f"{counted(len(target_modes(case)), 'target mode')}, "
        f"{counted(len(case.moves), 'quantity', 'quantities')} that may move; vehicle {model_words(case.vehicle)}; "
        f"rig {model_words(case.rig)}{notes}"
    )
