"""A case at other values of what may move."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping

from matching.frequency.case.case import Case


def apply(case: Case, values: Mapping[str, float]) -> Case:
    """The case with quantities ``rig.…``, ``residual_vehicle.…`` and ``loop.…`` changed, SI.

    What is uncertain goes with them: beds are drawn about the changed values.

    Raises
    ------
    InputError
        If a name is unknown or a value impossible.
    """
    rig = {name.removeprefix("rig."): value for name, value in values.items() if name.startswith("rig.")}
    emulated = {
        name.removeprefix("residual_vehicle."): value
        for name, value in values.items()
        if name.startswith("residual_vehicle.")
    }
    loop = {name.removeprefix("loop."): value for name, value in values.items() if name.startswith("loop.")}
    parts = tuple(
        part.with_values({name: value for name, value in emulated.items() if name in part.parameters})
        for part in case.residual_vehicle.parts
    )
    return dataclasses.replace(
        case,
        rig=case.rig.with_values(rig, designed=True),
        residual_vehicle=dataclasses.replace(case.residual_vehicle, parts=parts),
        loop=case.loop.with_values(loop),
        uncertainty=case.uncertainty.about(values),
    )
