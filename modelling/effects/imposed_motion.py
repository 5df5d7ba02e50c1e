"""An inertia whose motion was recorded and is imposed, instead of a torque on it."""

from __future__ import annotations

from collections.abc import Iterator

from sympy import Expr, Float

from modelling.effects.first_guess import FittedMotion, Guess
from modelling.effects.interface import Drivetrain, EquationBuilder, InputPath, Motion, Symbols
from modelling.effects.kind import Kind

BANDWIDTH = 3000.0  # rad/s of the filter through which the recording drives the inertia; at 50 Hz it errs by 0.5 %
DELAYS = {"speed": 1 / BANDWIDTH, "angle": 2 / BANDWIDTH}  # s, by which the filter is late at low frequencies


class ImposedMotion(Kind):
    """The inertia follows the input on it, a recorded ``speed`` (rad/s) or ``angle`` (rad), whatever torque that takes.

    The recording is not differentiated: the inertia follows it through a filter of first order (speed) or of second
    order with critical damping (angle), far above the frequencies of drivetrains; its delay is taken off the recording.
    Without such an input the inertia is held.
    """

    kind = "imposed_motion"
    words = "moves as recorded"
    in_recording = "its motion is that of a drive of its own, whatever torque acts on it."
    tables = ("inertias",)
    linear = True
    imposes_motion = True

    def inertia(self, motion: Motion, p: Symbols, assembly: EquationBuilder, name: str) -> None:
        assembly.impose(name, motion, -BANDWIDTH * motion.speed)

    def imposed_input(self, path: InputPath, measures: str, motion: Motion, assembly: EquationBuilder) -> None:
        path.delay -= Float(DELAYS[measures])
        acceleration: Expr = BANDWIDTH * (path.value - motion.speed)
        if measures == "angle":
            acceleration = BANDWIDTH**2 * (path.value - motion.angle) - 2 * BANDWIDTH * motion.speed
        assembly.impose(path.place, motion, acceleration)

    def candidate_places(self, system: Drivetrain) -> list[str]:
        """None: what drives an inertia is known of a bed, not found in its recordings."""
        return []

    def guesses(self, motion: FittedMotion, at: str) -> Iterator[Guess]:
        yield from ()
