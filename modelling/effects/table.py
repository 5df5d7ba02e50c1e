"""A torque given point by point over a speed, an angle or a twist: what a diagnosis found and no law describes."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from itertools import pairwise

from sympy import Abs, Expr, Symbol

from modelling.effects.first_guess import FittedMotion, Guess
from modelling.effects.interface import Drivetrain, EquationBuilder, Motion, ShaftLaw, Symbols
from modelling.effects.kind import Kind, Parameter

MOST_POINTS = 33
AXES = {"speed": "rad/s", "angle": "rad", "twist": "rad"}


class TorqueTable(Kind):
    """``torque`` over one of ``speed``, ``angle`` (inertia) or ``twist`` (shaft), linear between the points.

    It is constant beyond them. On an inertia it acts in positive direction; a shaft transmits it besides its spring.
    """

    kind = "table"
    words = "bears a torque that follows a table"
    in_recording = "the torque that is missing repeats over the same speed, angle or twist."
    tables = ("inertias", "shafts")
    arrays = (*AXES, "torque")
    parameters = {
        f"{key}_{i}": Parameter(unit, optional=True)
        for key, unit in {**AXES, "torque": "N*m"}.items()
        for i in range(1, MOST_POINTS + 1)
    }
    state_dependent = True

    def inertia(self, motion: Motion, p: Symbols, assembly: EquationBuilder, name: str) -> None:
        axis, points, torques = _points(p)
        assembly.add_torque(name, _between(motion.speed if axis == "speed" else motion.angle, points, torques), motion)

    def shaft(self, law: ShaftLaw, p: Symbols, assembly: EquationBuilder) -> None:
        _, points, torques = _points(p)
        law.potentials.append(lambda twist: _integral(twist, points, torques))

    def fault(self, at: str, values: Mapping[str, float]) -> str:
        axes = {key.rsplit("_", 1)[0] for key in values} - {"torque"}
        wanted = {"twist"} if at.startswith("shafts.") else {"speed", "angle"}
        if len(axes) != 1 or not axes <= wanted:
            return f"needs one list of {' or '.join(sorted(wanted))} beside torque"
        axis = axes.pop()
        points = [values[f"{axis}_{i}"] for i in range(1, MOST_POINTS + 1) if f"{axis}_{i}" in values]
        if len(points) < 2 or len(points) != sum(key.startswith("torque_") for key in values):
            return f"{axis} and torque need the same number of points, two at least"
        if not all(low < high for low, high in pairwise(points)):
            return f"the values of {axis} do not increase"
        return ""

    def candidate_places(self, system: Drivetrain) -> list[str]:
        """None: it is what is kept where no cause explains."""
        return []

    def guesses(self, motion: FittedMotion, at: str) -> Iterator[Guess]:
        yield from ()


def table_parameters(axis: str, points: Sequence[float], torques: Sequence[float]) -> dict[str, float]:
    """Parameters of a table over ``speed``, ``angle`` or ``twist``, SI by key.

    Points that are as good as equal are left out, and further ones beyond ``MOST_POINTS``.
    """
    kept: list[tuple[float, float]] = []
    for point, torque in zip(points, torques, strict=True):
        if not kept or point > kept[-1][0]:
            kept.append((point, torque))
    kept = kept[:MOST_POINTS]
    values = {f"{axis}_{i}": point for i, (point, _) in enumerate(kept, 1)}
    return values | {f"torque_{i}": torque for i, (_, torque) in enumerate(kept, 1)}


def _points(p: Symbols) -> tuple[str, list[Symbol], list[Symbol]]:
    """Name of the axis, its points and the torques there."""
    axis = next(key for key in AXES if f"{key}_1" in p)
    count = sum(key.startswith("torque_") for key in p)
    points, torques = ([p[f"{key}_{i}"] for i in range(1, count + 1)] for key in (axis, "torque"))
    return axis, points, torques


def _between(x: Expr, points: list[Symbol], torques: list[Symbol]) -> Expr:
    """The torque at x: linear between points, constant beyond them."""
    total: Expr = torques[0]
    for (low, high), (first, last) in zip(pairwise(points), pairwise(torques), strict=True):
        total += (last - first) / (high - low) * (Abs(x - low) - Abs(x - high) + high - low) / 2
    return total


def _integral(x: Expr, points: list[Symbol], torques: list[Symbol]) -> Expr:
    """The integral of :func:`_between` over x, but for a constant."""
    total: Expr = torques[0] * x
    for (low, high), (first, last) in zip(pairwise(points), pairwise(torques), strict=True):
        bent = ((x - low) * Abs(x - low) - (x - high) * Abs(x - high)) / 2
        total += (last - first) / (high - low) * (bent + (high - low) * x) / 2
    return total
