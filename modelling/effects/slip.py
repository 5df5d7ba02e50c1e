"""Tyre slip or another damper in series with a shaft."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial

import numpy as np

from modelling.effects.first_guess import FittedMotion, Guess
from modelling.effects.interface import EquationBuilder, ShaftLaw, Symbols
from modelling.effects.kind import Kind, Parameter, State


class Slip(Kind):
    """A damper of ``coefficient`` (N·m·s/rad) in series: the spring relaxes (tyre slip, relaxation length)."""

    kind = "slip"
    words = "slips by a damper of {coefficient} in series"
    in_recording = (
        "under a constant torque the two ends turn at different speeds; oscillations through the shaft are damped."
    )
    tables = ("shafts",)
    parameters = {"coefficient": Parameter("N*m*s/rad", lower=1e-9)}
    state = State("rad", "deflection of the spring of {place}")
    linear = True

    def shaft(self, law: ShaftLaw, p: Symbols, assembly: EquationBuilder) -> None:
        law.put_in_series(p["coefficient"], f"{law.place}.{self.kind}")

    def guesses(self, motion: FittedMotion, at: str) -> Iterator[Guess]:
        stiffness, twist = motion.value[f"{at}.stiffness"], motion.twist[at.split(".")[1]]
        for relaxation in (0.02, 0.1, 0.5, 2.5, 12.5):  # s, coefficient over stiffness
            lost = motion.lagged(twist - twist[0], relaxation)
            yield Guess(({at: -stiffness * lost},), partial(_damper, stiffness * relaxation))


def _damper(coefficient: float, a: np.ndarray) -> dict[str, float] | None:
    """Parameters for the amplitude a (1,) of the lost twist: the more is lost, the weaker the damper."""
    return {"coefficient": coefficient / float(a[0])} if a[0] > 0.02 else None
