"""What a bed that differs from the planned one has to keep: one meaning for match, map, order and tolerance study.

A drawn bed is kept where it is stable, every mode is damped by what is asked of it, both response errors are within
what the case allows, and every target mode is within the case's tolerances of the mode of the vehicle that has the same
specimen.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from matching.match.box import of_system
from matching.match.case import Case
from matching.match.damping import rates
from matching.match.loop_modes import ClosedLoop, LoopMode, eigenvalue_of, vehicle_modes_in_loop
from matching.match.targets import target_modes
from modelling.linear.state_space import state_spaces
from modelling.modal.modes import damped_modes
from modelling.modal.pairing import followed

# --- Target modes of the bed as planned


class ReachedTarget(NamedTuple):
    """Number of a target mode of the vehicle, the mode that it became, None without one, and their MAC."""

    vehicle_mode: int
    mode: LoopMode | None
    mac: float


def candidates_of(case: Case, modes: Sequence[LoopMode]) -> tuple[LoopMode, ...]:
    """The modes among which a target is looked for: of a model-based feed-forward those that known torques excite."""
    kind = "feed_forward" if case.loop.structure.has_feed_forward else "feedback"
    return tuple(mode for mode in modes if mode.belongs_to == kind) or tuple(modes)


def target_modes_of(case: Case, candidates: tuple[LoopMode, ...]) -> tuple[ReachedTarget, ...]:
    """For every target the mode that it became; all modes of the vehicle are paired at once."""
    inertia = {f"inertias.{inertia.name}": inertia.J.value for inertia in case.vehicle.inertias}
    became = vehicle_modes_in_loop(list(damped_modes(case.vehicle)), candidates, inertia)
    return tuple(
        ReachedTarget(target.mode, *became.get(wanted.number, (None, 0.0)))
        for target, (_, wanted) in zip(case.targets, target_modes(case), strict=True)
    )


# --- The same modes on drawn beds

FARTHEST = 4.0  # factor of the frequency of a target beyond which no mode of a drawn bed is looked at (speed only)


@dataclass(frozen=True)
class FollowedModes:
    """Modes of the planned bed's loop, followed to drawn beds, one to one.

    A mode that is a target's is looked for where the planned one goes if it moves as the vehicle's mode does, which the
    drawn specimen moves; every other mode where the planned bed has it.

    Attributes
    ----------
    vehicle : ndarray (v,)
        Eigenvalues of the vehicle as planned, 1/s, upper half plane.
    of_vehicle : mapping of int to int
        By number of a target mode its place in ``vehicle``.
    loop : ndarray (x,)
        Eigenvalues of the planned bed's loop, 1/s, upper half plane.
    of_loop : mapping of str to (int, int)
        By name of a result its place in ``loop``, and the number of its target mode.
    """

    vehicle: np.ndarray
    of_vehicle: Mapping[int, int]
    loop: np.ndarray
    of_loop: Mapping[str, tuple[int, int]]

    @classmethod
    def of(cls, case: Case, poles: np.ndarray, modes: Mapping[str, LoopMode]) -> FollowedModes:
        """Prepare to follow.

        Parameters
        ----------
        poles : ndarray (x,)
            Of the planned bed's loop in continuous time, 1/s.
        modes : mapping of str to LoopMode
            Its modes by the name of a result, which ends with ``_`` and the number of the target mode.
        """
        wanted = {
            target.mode: eigenvalue_of(mode) for target, (_, mode) in zip(case.targets, target_modes(case), strict=True)
        }
        ends = [abs(value) for value in (*wanted.values(), *(mode.eigenvalue for mode in modes.values()))]
        vehicle, loop = (
            _within(values, min(ends) / FARTHEST, max(ends) * FARTHEST)
            for values in (np.linalg.eigvals(state_spaces(case.vehicle, [{}])[0].A), poles)
        )
        return cls(
            vehicle, {number: int(np.abs(vehicle - value).argmin()) for number, value in wanted.items()}, loop,
            {
                name: (int(np.abs(loop - mode.eigenvalue).argmin()), int(name.rpartition("_")[2]))
                for name, mode in modes.items() if mode.belongs_to == "feedback"
            },
        )  # fmt: skip

    @classmethod
    def of_targets(cls, case: Case, loop: ClosedLoop) -> FollowedModes | None:
        """Prepare to follow the target modes of a planned bed's loop; None where the loop has none of them."""
        reached = target_modes_of(case, candidates_of(case, loop.modes()))
        modes = {f"target_mode_{row.vehicle_mode}": row.mode for row in reached if row.mode is not None}
        step = loop.controller.sample_time
        return cls.of(case, rates(loop.poles, step), modes) if modes else None

    def errors(
        self, case: Case, values: Sequence[Mapping[str, float]], poles: np.ndarray
    ) -> dict[str, np.ndarray]:  # fmt: skip
        """Errors (b,) of the target modes by name (:func:`errors_of_mode`); arguments as in :meth:`on`."""
        of_vehicles, of_beds = self.on(case, values, poles)
        errors = [errors_of_mode(name, s, of_vehicles[self.of_loop[name][1]]) for name, s in of_beds.items()]
        return {name: error for one in errors for name, error in one.items()}

    def on(
        self, case: Case, values: Sequence[Mapping[str, float]], poles: np.ndarray
    ) -> tuple[dict[int, np.ndarray], dict[str, np.ndarray]]:
        """Eigenvalues (b,), 1/s, of the vehicles' target modes by number, and of the beds' modes by name.

        NaN where a bed has no such mode that swings.

        Parameters
        ----------
        values : sequence of mapping
            Of each bed, by name, SI.
        poles : ndarray (b, x)
            Of each bed's loop in continuous time, 1/s.
        """
        spaces = state_spaces(case.vehicle, [of_system(one, case.vehicle) for one in values])
        vehicles = np.linalg.eigvals(np.stack([space.A for space in spaces]))
        of_vehicles = {number: np.empty(len(values), complex) for number in self.of_vehicle}
        of_beds = {name: np.empty(len(values), complex) for name in self.of_loop}
        sizes = np.abs(self.loop) if len(self.loop) else np.zeros(1)
        low, high = sizes.min() / 2, sizes.max() * 2
        for b, (own, found) in enumerate(zip(vehicles, poles, strict=True)):
            there = followed(self.vehicle, own)
            expected = self.loop.copy()
            for at, number in self.of_loop.values():
                place = self.of_vehicle[number]
                moved = there[place] / self.vehicle[place]
                expected[at] *= moved if np.isfinite(moved) else 1.0
            became = followed(expected, _within(found, low, high))
            for number, place in self.of_vehicle.items():
                of_vehicles[number][b] = there[place]
            for name, (at, _) in self.of_loop.items():
                of_beds[name][b] = became[at]
        return of_vehicles, of_beds


def _within(eigenvalues: np.ndarray, low: float, high: float) -> np.ndarray:
    """Eigenvalues, 1/s, of the upper half plane between two sizes, rad/s."""
    return eigenvalues[(eigenvalues.imag > 0) & (np.abs(eigenvalues) >= low) & (np.abs(eigenvalues) <= high)]


def errors_of_mode(name: str, found: np.ndarray, wanted: np.ndarray) -> dict[str, np.ndarray]:
    """Errors (b,) of a mode with eigenvalues (b,) against the wanted ones, 1/s: of the frequency, relative, and of the
    damping ratio; infinite where a bed has no such mode."""
    frequency, damping = (
        np.abs(found) / np.abs(wanted) - 1, wanted.real / np.abs(wanted) - found.real / np.abs(found)
    )  # fmt: skip
    return {
        f"{name}_{what}_error": np.where(np.isfinite(error), error, np.inf)
        for what, error in (("frequency", frequency), ("damping", damping))
    }


# --- What is kept


def allowed_of(case: Case, names: Iterable[str]) -> dict[str, float]:
    """How large the results of a drawn bed may be either way, by name, for the bed to count as kept.

    The modulus margin is asked of the bed as planned alone, so of drawn beds it is shown and does not count.
    """
    allowed = {"response_error": case.tolerance, "response_error_unmeasured": case.unmeasured_tolerance}
    for target in case.targets:
        allowed[f"target_mode_{target.mode}_frequency_error"] = target.frequency_tolerance
        allowed[f"target_mode_{target.mode}_damping_error"] = target.damping_tolerance
    if case.loop.structure.has_feed_forward:  # its targets are the model's own modes, the same on every bed
        allowed = {name: value for name, value in allowed.items() if not name.startswith("target")}
    return {name: value for name, value in allowed.items() if name in names}


def kept(values: Mapping[str, np.ndarray], allowed: Mapping[str, float]) -> dict[str, np.ndarray]:
    """Which beds (b,) keep each demand, as bool, and ``all`` of them.

    Parameters
    ----------
    values : mapping of str to ndarray (b,)
        ``stable`` and ``damped`` (1 or 0), and results by name.
    allowed : mapping of str to float
        How large each may be either way.
    """
    keeping = {name: np.asarray(values[name]) > 0.5 for name in ("stable", "damped")}
    keeping |= {name: keeping["stable"] & (np.abs(values[name]) <= limit) for name, limit in allowed.items()}
    keeping["all"] = np.logical_and.reduce(list(keeping.values()))
    return keeping
