"""Draws of a match whose hardware varies: margin, stability, modes and response errors, and what checks them.

All draws of a chunk are worked out together; some of them once more by the verification of a match, one by one.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from matching.frequency.beds.requirements import requirements
from matching.frequency.case.case import Case
from matching.frequency.loop.encirclements import encirclements
from matching.frequency.loop.linear_body import body
from matching.frequency.loop.loop_modes import feedback_modes
from matching.frequency.loop.parts import Parts, parts_of, watched
from matching.frequency.response.response_error import log_squares, nodes_of, pooled
from matching.frequency.response.responses import ComparedBed
from matching.frequency.studies.drawn_errors import DrawnErrors, covered
from matching.frequency.studies.drawn_loops import Loops
from modelling.bed.residual_vehicle import cut
from modelling.modal.modes import modes

CLOSE = 0.6  # relative distance within which a mode of the loop counts as the target's
CHECKED = 8  # draws of the first chunk that are worked out exactly as well


@dataclass(frozen=True)
class Varied:
    """A quantity that is drawn evenly from its range, SI."""

    name: str
    value: float
    lower: float
    upper: float
    unit: str


def draw(varied: tuple[Varied, ...], seed: int, number: int, count: int) -> np.ndarray:
    """Values (count, p) of chunk ``number``."""
    random = np.random.default_rng([seed, number])
    lower, upper = (np.array([getattr(quantity, key) for quantity in varied]) for key in ("lower", "upper"))
    return lower + (upper - lower) * random.random((count, len(varied)))


class Prepared(Loops):
    """What all chunks share, built once a worker."""

    def __init__(self, task: tuple[Case, tuple[Varied, ...], int]):
        self.case, self.varied, self.seed = task
        self.parts: Parts = parts_of(self.case)
        corners = [mode.frequency for mode in modes(self.case.rig) if 0 < mode.frequency < 1000]
        center = np.array([quantity.value for quantity in self.varied])
        names = [quantity.name for quantity in self.varied]
        self.margin_from = requirements(self.case).margin_from
        near = encirclements(self.parts, margin_from=self.margin_from).margin_frequency
        super().__init__(self.case, names, center, corners, near, self.margin_from)
        self.margin = float(self.margins(center[None])[0][0])
        goals = self._goals()
        self.targets, self.goals = list(goals), list(goals.values())
        loop = self.case.loop
        reference = cut(self.case.emulated_vehicle, self.case.rig)
        self.feed_forward = loop.structure.feed_forward(self.case.rig, reference, loop)
        self.vehicle = body(self.case.vehicle)
        bed = ComparedBed(self.case, self.parts, self.feed_forward, self.vehicle)
        self.nodes = nodes_of(bed)
        self.center_errors = self.errors(center)
        self.drawn_errors = DrawnErrors(bed, names, center, self.nodes) if covered(names) else None

    def stable(self, x: np.ndarray, determinants: np.ndarray) -> np.ndarray:
        """Whether each draw is stable, (b,)."""
        turning, unclear = self.turning(x, determinants)
        stable = ~turning
        for i in np.flatnonzero(unclear):
            winding = encirclements(self.true(x[i]), self.dead_time(x[i]))
            stable[i] = winding.unstable == 0 and winding.clear
        return stable

    def true(self, x: np.ndarray) -> Parts:
        """The bed of a draw (p,), with the controller as it is."""
        values = self._drawn(x, "rig.")
        system = self.case.rig.with_values(values)
        loop = self._drawn(x, "loop.")
        case = replace(self.case, loop=self.case.loop.with_values(loop)) if loop else self.case
        return replace(self.parts, case=case, rig=body(watched(system, self.parts.cuts, rig_side=True)))

    def _drawn(self, x: np.ndarray, prefix: str) -> dict[str, float]:
        """Values of a draw (p,) by name, of the quantities whose names begin so."""
        by_name = {quantity.name: value for quantity, value in zip(self.varied, x)}
        return {name.removeprefix(prefix): value for name, value in by_name.items() if name.startswith(prefix)}

    def dead_time(self, x: np.ndarray) -> float:
        """Dead time (s) of a draw (p,)."""
        names = [quantity.name for quantity in self.varied]
        return float(x[names.index("loop.dead_time")]) if "loop.dead_time" in names else self.case.loop["dead_time"]

    def errors(self, x: np.ndarray) -> list[float]:
        """Response error of a draw (p,) to all torques as the case measures them, and to unmeasured ones; exactly."""
        rig_values = {quantity.name.removeprefix("rig."): value for quantity, value in zip(self.varied, x)}
        shared = {name: v for name, v in rig_values.items() if name in self.case.vehicle.parameters}
        vehicle = body(self.case.vehicle.with_values(shared)) if shared else self.vehicle
        responses = ComparedBed(self.case, self.true(x), self.feed_forward, vehicle, self.dead_time(x)).at(
            self.nodes.frequencies
        )
        matched = [responses.matched, responses.unmeasured] if self.feed_forward is not None else [responses.unmeasured]
        return [pooled(self.nodes.root_mean(log_squares(response, responses.vehicle))) for response in matched]

    def _goals(self) -> dict[int, complex]:
        """Modes of the nominal feedback loop near the targets, as far as it has any, by the target's mode number."""
        goals = {}
        eigenvalues = [
            mode.eigenvalue for mode in feedback_modes(self.parts) if mode.frequency > 0 and mode.eigenvalue.imag > 0
        ]
        plain = modes(self.case.vehicle)
        for target in self.case.targets:
            wanted = 2j * np.pi * plain[target.mode - 1].frequency
            near = min(eigenvalues, key=lambda s: abs(s - wanted), default=0j)
            if abs(near - wanted) < CLOSE * abs(wanted):
                goals[target.mode] = complex(near)
        return goals


def work(prepared: Prepared, chunk: list[int]) -> dict[str, Any]:
    """One chunk: number, draws, and how many of them get response errors where those have to be worked out singly."""
    number, count, few = chunk
    x = draw(prepared.varied, prepared.seed, number, count)
    least, determinants = prepared.margins(x)
    values: dict[str, Any] = {
        "modulus_margin": least.tolist(), "stable": prepared.stable(x, determinants).astype(float).tolist(),
    }  # fmt: skip
    units, nominal = {"modulus_margin": ""}, {"modulus_margin": prepared.margin}
    for mode, goal, root in zip(prepared.targets, prepared.goals, prepared.roots(x, prepared.goals).T):
        for what, unit, of in (("frequency", "Hz", _frequency), ("damping_ratio", "", _damping)):
            name = f"target_mode_{mode}_{what}"
            values[name], units[name], nominal[name] = of(root).tolist(), unit, float(of(np.array([goal]))[0])
    here = prepared.center_errors
    names = ["response_error", "response_error_unmeasured"] if len(here) == 2 else ["response_error"]
    at_once = prepared.drawn_errors
    errors = np.array([prepared.errors(row) for row in x[:few]]) if at_once is None else at_once(x)
    for j, name in enumerate(names):
        values[name], units[name], nominal[name] = errors[:, j].tolist(), "", here[j]
    check = _differences(prepared, x[:CHECKED], values, names) if number == 0 else {}
    return {"values": values, "units": units, "nominal": nominal, "check": check}


def _differences(
    prepared: Prepared, x: np.ndarray, values: dict[str, Any], errors: list[str]
) -> dict[str, float]:  # fmt: skip
    """Largest relative differences from draws (b, p) worked out exactly; of stability the share that differs."""
    windings = [encirclements(prepared.true(row), prepared.dead_time(row), prepared.margin_from) for row in x]
    exact = {"modulus_margin": np.array([winding.modulus_margin for winding in windings])}
    if prepared.drawn_errors is not None:
        exact |= dict(zip(errors, np.array([prepared.errors(row) for row in x]).T, strict=True))
    differences = {
        name: float(np.max(np.abs(np.array(values[name][: len(x)]) / exact[name] - 1))) for name in exact
    }  # fmt: skip
    stable = np.array([winding.unstable == 0 and winding.clear for winding in windings])
    return differences | {"stable": float(np.mean(stable != (np.array(values["stable"][: len(x)]) > 0.5)))}


def _frequency(root: np.ndarray) -> np.ndarray:
    return np.abs(root) / (2 * np.pi)


def _damping(root: np.ndarray) -> np.ndarray:
    return -root.real / np.abs(root)
