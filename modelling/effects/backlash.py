"""Free play of a shaft."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from modelling.effects.first_guess import FittedMotion, Guess, if_positive
from modelling.effects.interface import EquationBuilder, ShaftLaw, Symbols
from modelling.effects.kind import Kind, Parameter


class Backlash(Kind):
    """Dead zone of width ``gap`` (rad, total) in the twist; no torque across it."""

    kind = "backlash"
    words = "has {gap} of free play"
    in_recording = (
        "after a reversal of torque the speeds move apart freely for some milliseconds, then the torque "
        "jumps; a plot of torque over twist has a flat step of width gap."
    )
    tables = ("shafts",)
    parameters = {"gap": Parameter("rad", lower=0.0)}
    abrupt = True
    state_dependent = True
    free_play = "gap"

    def shaft(self, law: ShaftLaw, p: Symbols, assembly: EquationBuilder) -> None:
        law.gap = p["gap"]

    def guesses(self, motion: FittedMotion, at: str) -> Iterator[Guess]:
        name = at.split(".")[1]
        stiffness, twist = motion.value[f"{at}.stiffness"], motion.twist[name]
        for share in (0.02, 0.1, 0.3, 1.0):  # of the largest twist
            # free play takes half a gap of twist from the spring; around zero torque the transition has some width
            width = share * float(np.abs(twist).max())
            yield Guess(({at: -stiffness * np.clip(twist / width, -1, 1)},), if_positive("gap", 2.0))
