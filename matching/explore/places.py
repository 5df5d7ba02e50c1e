"""Where the parts of a drawing stand that somebody moved, kept in a file beside the model."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from matching.report.drivetrain import Shift, layout
from modelling.errors import InputError
from modelling.system import System
from modelling.writing import write_all

ENDING = ".places.json"  # of the file, behind the name of the model's
FURTHEST = 40  # columns and lanes that a part can be moved: half of the inertias that are drawn at most
SAME_PLACE = 0.5  # lanes: two inertias of a column that are nearer lie over each other


class Places:
    """Shifts of inertias from where the drawing would have them, with all that hangs on them.

    Parameters
    ----------
    model : Path
        The model's file.

    Attributes
    ----------
    path : Path
    shifts : dict of str to Shift
        By the name of the inertia.
    """

    def __init__(self, model: Path):
        self.path = model.with_name(f"{model.stem}{ENDING}")
        self.shifts: dict[str, Shift] = _read(self.path) if self.path.is_file() else {}
        self._saved = dict(self.shifts)

    @property
    def changed(self) -> bool:
        """Whether something is not saved."""
        return self.shifts != self._saved

    def move(self, system: System, inertia: str, right: int, down: int) -> None:
        """Move an inertia by columns and lanes; raises ``InputError`` where it cannot stand there."""
        before = self.shifts.get(inertia, Shift(0, 0))
        moved = Shift(before.right + right, before.down + down)
        if moved.right < 0:
            raise InputError(inertia, "cannot stand left of what it hangs on", "move it up, down or right")
        if max(moved.right, abs(moved.down)) > FURTHEST:
            raise InputError(inertia, f"was moved {FURTHEST} places already", "move it back")
        shifts = {name: own for name, own in self.shifts.items() if name != inertia}
        shifts |= {inertia: moved} if moved != Shift(0, 0) else {}
        at = _at(system, shifts)
        if at == _at(system, self.shifts):
            raise InputError(inertia, "does not move this way", "it stands where its branches meet, or first")
        taken = [
            (one, other) for one in at for other in at
            if one < other and at[one][0] == at[other][0] and abs(at[one][1] - at[other][1]) < SAME_PLACE
        ]  # fmt: skip
        if taken:
            raise InputError(inertia, f"would lie over another part ({' and '.join(taken[0])})", "move that one first")
        self.shifts = shifts

    def save(self) -> None:
        """Write the file."""
        content: dict[str, Any] = {name: own._asdict() for name, own in sorted(self.shifts.items())}
        write_all(self.path.parent, {self.path.name: json.dumps(content, indent=2, ensure_ascii=False) + "\n"})
        self._saved = dict(self.shifts)


def _at(system: System, shifts: dict[str, Shift]) -> dict[str, tuple[int, float]]:
    """Column and lane of every inertia."""
    found = layout(system, shifts)
    return {name: (column, found.lane[name]) for name, column in found.column.items()}


def _read(path: Path) -> dict[str, Shift]:
    right = 'write {"NAME": {"right": 1, "down": 0}}, or delete the file'
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
        shifts = {name: Shift(**own) for name, own in content.items()}
    except (ValueError, TypeError, AttributeError) as fault:
        raise InputError(str(path), f"holds no places of a drawing ({fault})", right) from None
    for name, own in shifts.items():
        if not all(type(one) is int and abs(one) <= FURTHEST for one in own) or own.right < 0:
            raise InputError(f"{path}: {name}", f"{own._asdict()} is no place", right)
    return shifts
