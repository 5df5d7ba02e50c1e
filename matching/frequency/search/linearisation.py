"""Whether vehicle and rig may be linearised where they are: dry friction has to slide, a lash has to be loaded."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from matching.frequency.case.case import Case
from matching.frequency.case.load_limits import TORQUE_OVER_SPEED
from matching.frequency.verification.simulation import Traces
from modelling.common.errors import InputError
from modelling.equations.compiled import compiled
from modelling.linear.reference_motion import operating_motion, speeds_of
from modelling.model.components import Gear, Shaft
from modelling.model.system import System

SLIDING_FROM = 0.5  # rad/s: below it friction may stick within the motion of a mode
COUNTED_FROM_STANDSTILL = ("dynamometer_speed", "dynamometer_power", TORQUE_OVER_SPEED)  # without an operating point
LOADED_FROM = 1e-3  # N·m: a lash that carries less is open or on the edge
CURE = 'state an operating point in motion under load, e.g. [operating_point] vehicle_speed = "30 km/h"'


def check_sliding(case: Case) -> None:
    """Refuse dry friction that sticks at the operating point: its linear model would clamp the inertia to ground.

    Raises
    ------
    InputError
        Naming the inertia.
    """
    for system in (case.vehicle, case.rig):
        speeds = speeds_of(system)
        for effect in system.effects:
            name = _sliding_inertia(system, effect.at)
            if effect.law.sticks and abs(speeds.get(name, 0.0)) < SLIDING_FROM:
                at = "at standstill" if system.operating_point is None else f"at {speeds[name]:.2g} rad/s"
                raise InputError(
                    f"{case.path}: operating_point",
                    f"the dry friction of {effect.at} sticks {at}: no linear model holds",
                    CURE,
                )


def _sliding_inertia(system: System, at: str) -> str:
    """The inertia whose motion dry friction at a place opposes: of a shaft or gear, its second end."""
    table, name = at.split(".")[:2]
    parts: Sequence[Shaft | Gear] = system.shafts if table == "shafts" else system.gears if table == "gears" else ()
    return next((part.between[1] for part in parts if part.name == name), name)


def unloaded_lashes(case: Case) -> list[str]:
    """A sentence for every lash that nothing loads where the models are linearised, which takes it as closed."""
    where: dict[str, str] = {}
    for system in (case.vehicle, case.rig):
        torques = _shaft_torques(system)
        at = "standstill" if system.operating_point is None else "the operating point"
        where |= {place: at for place in system.free_plays if abs(torques[place]) < LOADED_FROM}
    return [
        f"the lash of {place} is open at {at}, and the linear models take it as closed: what is said of modes and "
        f"responses holds for a loaded shaft alone; {CURE}"
        for place, at in where.items()
    ]


def opened_lashes(case: Case, traces: Traces | None) -> list[str]:
    """A sentence for every loaded lash that the simulated manoeuvre opens."""
    if traces is None or case.rig.operating_point is None:
        return []
    opened = []
    for place in case.rig.free_plays:
        torque = traces.absolute(f"{place}.torque")
        closed = torque * np.sign(torque[0]) > 0
        if not closed.all():
            first = traces.time[int(np.argmin(closed))]
            opened.append(
                f"the manoeuvre opens the lash of {place} after {first:.3g} s: the controller's models have it closed, "
                "vehicle and rig are simulated with it"
            )
    return opened


def _shaft_torques(system: System) -> dict[str, float]:
    model, about = compiled(system), operating_motion(system)
    torques = model.shaft_torques(about.state, about.inputs, model.p0).full().ravel()
    return {f"shafts.{shaft.name}": float(torque) for shaft, torque in zip(system.shafts, torques, strict=True)}


def standstill(case: Case) -> list[str]:
    """That limits count from standstill, where the case has such limits and no operating point."""
    counted = [name for name in COUNTED_FROM_STANDSTILL if name in case.limits]
    if case.vehicle.operating_point is not None or not counted:
        return []
    return [
        "the case states no [operating_point], so standstill is assumed: the manoeuvre is held against "
        f"{', '.join(counted)} from there; at speed the dynamometers need more"
    ]
