"""Torque that varies with the angle (cogging, torque ripple, universal joint)."""

from __future__ import annotations

from typing import TYPE_CHECKING

from modelling.effects.kind import Kind, Parameter
from modelling.effects.seen import Guess

if TYPE_CHECKING:
    from modelling.assembly import Assembly, Motion, Symbols


class TorqueRipple(Kind):
    """amplitude·sin(order·angle + phase), driving."""

    kind = "torque_ripple"
    tables = ("inertias",)
    parameters = {"order": Parameter("1", lower=0.0), "amplitude": Parameter("N*m"), "phase": Parameter("rad")}

    def inertia(self, motion: Motion, p: Symbols, assembly: Assembly, name: str) -> None:
        from sympy import sin

        assembly.act(name, p["amplitude"] * sin(p["order"] * motion.angle + p["phase"]), motion)

    def guesses(self, seen, at):
        import numpy as np

        angle, pull = seen.angle[at.split(".")[1]], seen.pull[at.split(".")[1]]
        for order in _orders(angle, pull):
            wave = {at: np.sin(order * angle)}, {at: np.cos(order * angle)}
            yield Guess(wave, lambda a, order=order: {"order": order, "amplitude": float(np.hypot(*a)), "phase": float(np.arctan2(a[1], a[0]))})

    def fit_bounds(self, key, guess, step):
        return (max(guess - 0.3, 0.01), guess + 0.3) if key == "order" else super().fit_bounds(key, guess, step)


def _orders(angle, pull, most=4):
    """Orders at which the torque that would help stands out of its surroundings."""
    import numpy as np
    from scipy.signal import medfilt

    span = float(np.ptp(angle))
    if span < 2 * np.pi:
        return
    fine = float(np.clip(np.pi / span, 0.02, 0.25))
    orders = np.arange(0.5, 24.5, fine)
    strength = np.abs(np.array([np.sum(pull * np.exp(-1j * order * angle)) for order in orders]))
    floor = medfilt(strength, 2 * int(0.75 / fine) + 1) + 1e-12 * strength.max()
    outstanding = strength / floor
    for _ in range(most):
        best = int(np.argmax(outstanding))
        yield float(orders[best])
        outstanding[abs(orders - orders[best]) < 3 * fine + 0.1] = 0.0
