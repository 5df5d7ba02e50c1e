"""The same case at other values of what may move."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping

from matching.frequency.case import Case, movable
from modelling.errors import InputError
from modelling.system import System, unknown


def quantities(case: Case) -> dict[str, tuple[float, str, tuple[str, ...]]]:
    """Every quantity of a case that can be set: value, SI unit, and it with its mirror image."""
    return movable(case.rig, case.residual_vehicle, case.loop)


def with_values(case: Case, values: Mapping[str, float]) -> Case:
    """The case with some quantities set, mirror images alike.

    Parameters
    ----------
    values : mapping
        ``rig.…``, ``residual_vehicle.…`` or ``loop.…`` to values in SI.

    Raises
    ------
    InputError
        If a name is unknown or a value impossible.
    """
    known = quantities(case)
    every: dict[str, float] = {}
    for name, value in values.items():
        if name not in known:
            raise unknown(name, list(known), "")
        every |= dict.fromkeys(known[name][2], float(value))
    own = {whose: _of(every, whose) for whose in ("rig", "residual_vehicle", "loop")}
    residual = case.residual_vehicle
    parts = tuple(_with(part, own["residual_vehicle"]) for part in residual.parts)
    return dataclasses.replace(
        case,
        rig=_with(case.rig, own["rig"]),
        residual_vehicle=dataclasses.replace(residual, parts=parts),
        loop=case.loop.with_values(own["loop"]),
    )


def held_at(case: Case, name: str, value: float) -> Case:
    """The case with a quantity at a value where it stays, whether it might move before or not.

    Raises
    ------
    InputError
        As :func:`with_values`, or if nothing would be left to move.
    """
    moved = with_values(case, {name: value})
    left = tuple(move for move in case.moves if name not in move.together)
    if not left:
        raise InputError(name, "is all that may move", "let the case move something else as well")
    return dataclasses.replace(moved, moves=left)


def _of(values: Mapping[str, float], whose: str) -> dict[str, float]:
    return {name.removeprefix(f"{whose}."): value for name, value in values.items() if name.startswith(f"{whose}.")}


def _with(system: System, values: Mapping[str, float]) -> System:
    mine = {name: value for name, value in values.items() if name in system.parameters}
    return system.with_values(mine) if mine else system
