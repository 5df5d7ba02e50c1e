"""Clutches of the emulated vehicle: they slip, stick and open in its simulation, and are locked in linear models."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Generic, Protocol, TypeVar

import numpy as np
from scipy.linalg import block_diag

from modelling.bed.vehicle import ResidualVehicle
from modelling.equations.casadi_code import compiled
from modelling.errors import InputError
from modelling.linear.elements import elements
from modelling.system import Input, System
from modelling.topology import connected_parts, joints, side

# --- Dry friction that sticks.
#
# A clutch is a torque between its two ends. In each step it is the one with which the slip is zero at the end of the
# step, or, where that is more than the clutch can carry, what it can carry (time stepping after Moreau, in: Nonsmooth
# Mechanics and Applications, Springer 1988). No step is too long for it: nothing stiff stands for a clutch that sticks.

SWEEPS = 100  # over clutches that slip against each other; a single one is solved by one


def carried_torques(slip: np.ndarray, gain: np.ndarray, before: np.ndarray, capacity: np.ndarray) -> np.ndarray:
    """Torques (c,) of clutches over a step, N·m at their first ends.

    Parameters
    ----------
    slip : ndarray (c,)
        rad/s at the end of the step with the torques ``before`` (c,).
    gain : ndarray (c, c)
        Slip for 1 N·m of each, rad/s per N·m: negative on its diagonal.
    capacity : ndarray (c,)
        N·m that each can carry; below 0 as 0.
    """
    torque, most = before.copy(), np.maximum(capacity, 0.0)
    for _ in range(1 if len(torque) == 1 else SWEEPS):
        for i in range(len(torque)):
            off = slip[i] + gain[i] @ (torque - before)
            torque[i] = min(max(torque[i] - off / gain[i, i], -most[i]), most[i])
    return torque


def opened(part: System) -> System:
    """A part of a vehicle whose clutches are open: what each carries acts through its input at its first end, and
    through one named by :func:`reaction` at its second."""
    ends = {box.capacities[0]: box.between for box in part.gearboxes}
    inputs = [Input(one.name, ends[one.name][0]) if one.name in ends else one for one in part.inputs]
    reactions = [Input(reaction(name), second) for name, (_, second) in ends.items()]
    return replace(part, gearboxes=(), inputs=(*inputs, *reactions))


def reaction(capacity: str) -> str:
    """Name of the input for a clutch's torque at its second end."""
    return f"{capacity}_reaction"


# --- The two vehicles.
#
# The vehicle that is stepped has live clutches. A linear observer holds the vehicle with the clutches locked, or, while
# one slips, the inertias between cut and clutch, driven by the torque that the clutch carries. Both have the same
# states: where a locked clutch ties inertias together, the speed of the ones nearest to the cut.

SLIPS = 0.05  # rad/s: more is no rounding of a clutch that sticks
CLOSED = 1e6  # N·m: more than any clutch has to carry
ROUNDING = 1e-12  # of a speed over another


class Stepped(Protocol):
    """What a stepped vehicle has: see :class:`modelling.bed.stepped.SteppedVehicle`."""

    @property
    def slip(self) -> np.ndarray:
        """rad/s of each live clutch by state (c, v)."""

    @property
    def by_cut(self) -> np.ndarray:
        """Rates (v, k) for 1 N·m at each cut."""

    def slope_at(self, x: np.ndarray, own: np.ndarray) -> np.ndarray:
        """Derivatives (v, v) of the rates at a state and own inputs (r,)."""

    def rates_by_own(self, x: np.ndarray, own: np.ndarray) -> np.ndarray:
        """Rates (v, r) at a state and own inputs (r,) for one more of each."""


V = TypeVar("V", bound=Stepped)


@dataclass(frozen=True)
class LiveClutches(Generic[V]):
    """A vehicle with live clutches beside the same one with them locked; v and l states, c clutches.

    Attributes
    ----------
    vehicle : modelling.bed.stepped.SteppedVehicle
        With live clutches. Its last inputs are what they can carry, N·m.
    seen : ndarray (l, v)
        States of the locked vehicle by those of this one.
    locked : ndarray (v, l)
        States of this one while its clutches are locked.
    """

    vehicle: V
    seen: np.ndarray
    locked: np.ndarray

    def slipping(self, x: np.ndarray, own: np.ndarray) -> bool:
        """Whether a clutch slips or is open at a state (v,) under inputs (r,)."""
        slip = self.vehicle.slip @ x
        return bool(((own[len(own) - len(slip) :] <= 0) | (np.abs(slip) > SLIPS)).any())

    def acting(self, x: np.ndarray, own: np.ndarray, carried: np.ndarray) -> np.ndarray:
        """Inputs (r,) with what the clutches carry in place of what they can; ``carried`` (c,) in the last step."""
        slip = self.vehicle.slip @ x
        most = np.maximum(own[len(own) - len(slip) :], 0.0)
        now = np.where(np.abs(slip) > SLIPS, np.sign(slip) * most, np.clip(carried, -most, most))
        return np.r_[own[: len(own) - len(slip)], now]

    @property
    def by_cut(self) -> np.ndarray:
        """Rates (l, k) of the locked vehicle's states for 1 N·m at each cut while a clutch slips."""
        made: np.ndarray = self.seen @ self.vehicle.by_cut
        return made

    def free_likeness(self, steady: np.ndarray, own: np.ndarray) -> np.ndarray:
        """Derivatives (l, l) of the locked vehicle's rates about a state of it and own inputs (r,), no clutch carrying
        anything."""
        made: np.ndarray = self.seen @ self.vehicle.slope_at(self.locked @ steady, own) @ self.locked
        return made

    def free_by_own(self, steady: np.ndarray, own: np.ndarray) -> np.ndarray:
        """Rates (l, r) for one more of each own input there."""
        made: np.ndarray = self.seen @ self.vehicle.rates_by_own(self.locked @ steady, own)
        return made


@dataclass(frozen=True)
class _Signals:
    """Speeds of inertias by name, twists of springs, and states of effects by name: rows by state of a part."""

    speeds: dict[str, np.ndarray]
    twists: np.ndarray
    effects: dict[str, np.ndarray]

    def rows(self, speeds: Mapping[str, np.ndarray], effects: Sequence[np.ndarray]) -> np.ndarray:
        """All of them one below the other, with these speeds and states of effects."""
        return np.vstack([*speeds.values(), self.twists, *effects])


def _signals(system: System, lift: np.ndarray) -> _Signals:
    model = compiled(system)
    parts, n = elements(model, model.p0[None]), model.n
    names = (name.removeprefix("inertias.") for name in parts.masses)
    speeds = dict(zip(names, parts.mass_transformation.reshape(-1, n) @ lift[n : 2 * n], strict=True))
    twists = parts.deflection_jacobian.reshape(len(parts.springs), len(model.states))[:, :n] @ lift[:n]
    return _Signals(speeds, twists, dict(zip(model.states[2 * n :], lift[2 * n :], strict=True)))


def live_clutches(
    live: ResidualVehicle, locked: ResidualVehicle, vehicle: V, lifts: Sequence[tuple[np.ndarray, np.ndarray]]
) -> LiveClutches[V]:  # fmt: skip
    """Put both vehicles side by side.

    Parameters
    ----------
    live, locked : ResidualVehicle
        The same parts in the same order.
    vehicle : modelling.bed.stepped.SteppedVehicle
        Of ``live``.
    lifts : sequence of (ndarray, ndarray)
        By part: all states of the model by those of the live vehicle, and of the locked one.
    """
    seen, tied = [], []
    for ours, theirs, (of_live, of_locked) in zip(live.parts, locked.parts, lifts, strict=True):
        here, there = _signals(opened(ours), of_live), _signals(theirs, of_locked)
        nearest = _nearest(ours, theirs, [cut.vehicle_end for cut in live.interfaces])
        ratio = {name: _ratio(row, there.speeds[nearest[name]]) for name, row in there.speeds.items()}
        near = {name: ratio[name] * here.speeds[nearest[name]] for name in there.speeds}
        own = {name: here.speeds[name] for name in there.speeds}
        effects = list(there.effects)  # the same in both
        of_live_effects = [here.effects[name] for name in effects]
        by_locked = there.rows(there.speeds, list(there.effects.values()))
        seen.append(_solved(by_locked, here.rows(near, of_live_effects)))
        tied.append(_solved(here.rows(own, of_live_effects), by_locked))
    return LiveClutches(vehicle, block_diag(*seen), block_diag(*tied))


def _solved(rows: np.ndarray, wanted: np.ndarray) -> np.ndarray:
    """States for which rows have the values wanted.

    Raises
    ------
    InputError
        If the rows do not determine them.
    """
    made: np.ndarray = np.linalg.pinv(rows) @ wanted
    if np.linalg.matrix_rank(rows) < rows.shape[1]:
        raise InputError(
            "vehicle", "has a clutch beside a torque over an absolute angle beyond the cut", "leave one of both out"
        )
    made[np.abs(made) < ROUNDING] = 0.0
    return made


def _nearest(live: System, locked: System, ends: Collection[str]) -> dict[str, str]:
    """By inertia the one that stands for its speed: of those tied to it by locked clutches, one before the clutches."""
    inside = {part.name for part in live.inertias}
    near = set[str]().union(*(side(end, joints(live)) for end in ends if end in inside))
    found: dict[str, str] = {}
    for group in connected_parts([part.name for part in locked.inertias], joints(locked, "gears")):
        crossing = any(set(box.between) <= set(group) for box in live.gearboxes)
        for name in group:
            stands = [other for other in group if other in near]
            found[name] = name if name in near or not crossing or not stands else stands[0]
    return found


def _ratio(row: np.ndarray, by: np.ndarray) -> float:
    return float(row @ by / (by @ by))
