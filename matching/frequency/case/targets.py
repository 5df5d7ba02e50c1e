"""Target modes as the optimiser needs them: eigenvalue and pattern over the dynamometers."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import scipy

from matching.frequency.case.case import Case
from modelling.common.errors import InputError
from modelling.modal.damped_modes import damped_modes
from modelling.modal.modes import modes
from modelling.modal.result import Mode, Modes

FARTHEST_DAMPED = float(np.log(1.5))  # between a mode's damped and undamped frequency, logarithm
LEAST_SCORE = 1e-3  # of any pair that may be one mode, so that as many as possible are paired


@dataclass(frozen=True)
class Goal:
    """A target for the optimiser: eigenvalue wanted, rad/s, and pattern of speeds over the dynamometers (u,)."""

    eigenvalue: complex
    pattern: np.ndarray

    @property
    def numbers(self) -> np.ndarray:
        """What :func:`eigenpair` takes of it: |s|, damping ratio, pattern of length 1, (2 + u,)."""
        size = abs(self.eigenvalue)
        return np.array([size, -self.eigenvalue.real / size, *self.pattern / np.linalg.norm(self.pattern)])


def target_modes(case: Case) -> list[tuple[Mode, Mode]]:
    """For every target the undamped vehicle mode it numbers and the damped mode it is.

    Each damped mode is one undamped mode: both are paired as a whole, by shape and frequency, since neighbours that lie
    1 % apart may come in another order, or mix, once they are damped.

    Raises
    ------
    InputError
        If the vehicle has no such mode, or it is rigid or overdamped.
    """
    plain, damped = modes(case.vehicle), damped_modes(case.vehicle)
    counterpart = _paired(plain, damped, {f"inertias.{part.name}": part.J.value for part in case.vehicle.inertias})
    pairs = []
    for number, target in enumerate(case.targets, 1):
        where = f"{case.path}: targets[{number}].mode"
        if target.mode > len(plain):
            raise InputError(where, f"the vehicle has {len(plain)} modes", "see 'rigmatch modes' of the vehicle file")
        wanted = plain[target.mode - 1]
        if wanted.frequency == 0:
            raise InputError(where, f"mode {target.mode} is a rigid motion", "name an elastic mode")
        best = counterpart.get(wanted.number)
        if best is None:
            raise InputError(
                where,
                f"mode {target.mode} ({wanted.frequency:.3g} Hz) is overdamped in the vehicle",
                "name a mode that swings",
            )
        pairs.append((wanted, best))
    return pairs


def _paired(plain: Modes, damped: Modes, inertia: Mapping[str, float]) -> dict[int, Mode]:
    """The damped mode of every undamped one that has one, by the number of the latter."""
    elastic = [mode for mode in plain if mode.frequency > 0]
    swinging = [mode for mode in damped if mode.frequency > 0 and mode.damping_ratio < 1]
    score = np.zeros((len(elastic), len(swinging)))
    for row, first in enumerate(elastic):
        for column, second in enumerate(swinging):
            far = abs(np.log(second.frequency / first.frequency))
            if first.symmetry == second.symmetry and far <= FARTHEST_DAMPED:
                score[row, column] = LEAST_SCORE + _mac(first, second, inertia) * np.exp(-far)
    places = zip(*scipy.optimize.linear_sum_assignment(score, maximize=True), strict=True)
    return {elastic[row].number: swinging[column] for row, column in places if score[row, column] > 0}


def _mac(first: Mode, second: Mode, inertia: Mapping[str, float]) -> float:
    """Modal assurance criterion over the inertias, each weighted by its inertia."""
    weight = np.sqrt(list(inertia.values()))
    a, b = (weight * np.array([mode.shape[name] for name in inertia]) for mode in (first, second))
    return float(abs(np.vdot(a, b)) ** 2 / max(np.vdot(a, a).real * np.vdot(b, b).real, 1e-300))


def goals(case: Case, pairs: list[tuple[Mode, Mode]]) -> tuple[Goal, ...]:
    """Eigenvalue wanted and pattern of the interface speeds for every target; one whose interfaces rest has none.

    Dynamometers without torque have no loop and so no eigenpair of one: then the responses alone lead the way.
    """
    if case.loop.torqueless and not any(move.name.startswith("loop.") for move in case.moves):
        return ()
    cuts = {interface.shaft: interface for interface in case.residual_vehicle.interfaces}
    made = []
    for plain, damped in pairs:
        pattern = np.array(
            [
                np.real(plain.shape.get(f"inertias.{cuts[dyno.follows].vehicle_end}", 0.0))
                for dyno in case.loop.dynamometers
            ]
        )
        if np.abs(pattern).max() < 1e-6:
            continue
        omega = 2 * np.pi * damped.frequency
        eigenvalue = omega * complex(-damped.damping_ratio, np.sqrt(1 - damped.damping_ratio**2))
        made.append(Goal(eigenvalue, pattern / np.abs(pattern).max()))
    return tuple(made)
