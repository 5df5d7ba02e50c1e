"""Speed control with torque and acceleration feed-forward and a lead: what most beds have.

command = lead·[(kp + ki/s)·(reference − speed) + ka·s·reference − kt·torque], lead = (1 + s·T)/(1 + s·T/5).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from modelling.bed.blocks import ControllerBlock
from modelling.bed.loop import ControlStructure, Loop, LoopQuantity
from modelling.linear.state_space import StateSpace
from modelling.model.system import System

LEAD_POLE_OVER_ZERO = 5.0  # the lead's pole lies this many times above its zero: 42° of phase at most
SHORTEST_LEAD = 1e-6  # s: a lead this short does nothing below 100 kHz
GAINS = ("proportional_gain", "integral_gain", "torque_feed_forward", "acceleration_feed_forward")
QUANTITIES = {
    "proportional_gain": LoopQuantity("N*m*s/rad", 100.0, 0.0, 1e5, "torque for a speed error"),
    "integral_gain": LoopQuantity("N*m/rad", 50.0, 0.0, 1e7, "torque for an angle error"),
    "torque_feed_forward": LoopQuantity("1", 0.0, -1.0, 3.0, "share of the measured torque that is compensated"),
    "acceleration_feed_forward": LoopQuantity(
        "kg*m^2", 0.0, -10.0, 1e3, "inertia whose torque for the reference's acceleration is fed forward"
    ),
    "lead_time": LoopQuantity("s", 0.003, 0.0, 0.1, "time constant of the lead that makes up for lags"),
}
BLOCKS: tuple[ControllerBlock, ...] = (
    ControllerBlock("Residual vehicle", "reference speed", takes=("flange torque",), holds_residual_vehicle=True),
    ControllerBlock(
        "Speed control", "torque for the speed error", takes=("rotor speed",),
        quantities=("proportional_gain", "integral_gain"),
    ),
    ControllerBlock(
        "Feed-forward", "torque wanted", takes=("flange torque", "reference's acceleration"),
        quantities=("torque_feed_forward", "acceleration_feed_forward"),
    ),
    ControllerBlock("Lead", "command", quantities=("lead_time",)),
)  # fmt: skip


@dataclass(frozen=True)
class PI(ControlStructure):
    """Feedback alone."""

    name = "pi"
    quantities = QUANTITIES
    blocks: tuple[ControllerBlock, ...] = BLOCKS

    def gives_torque(self, values: Mapping[str, float]) -> bool:
        """Unless every gain is 0."""
        return any(values[name] for name in GAINS)

    def integrators(self, values: Mapping[str, float]) -> int:
        """The integral of the speed error."""
        return int(values["integral_gain"] != 0)

    def measured_inputs(self, measured: Sequence[str], simulated: Sequence[str]) -> tuple[str, ...]:
        """None: feedback reacts to what a torque does, not to the torque."""
        return ()

    def commands(
        self, values: Mapping[str, Any], s: Any, reference: Sequence[Any], speeds: Sequence[Any], torques: Sequence[Any]
    ) -> list[Any]:
        """See :meth:`ControlStructure.commands`."""
        lead = (1 + s * values["lead_time"]) / (1 + s * (values["lead_time"] / LEAD_POLE_OVER_ZERO))
        error_gain = 1 / s * values["integral_gain"] + values["proportional_gain"]
        reference_gain = error_gain + s * values["acceleration_feed_forward"]
        return [
            lead * (reference_gain * wanted - error_gain * speed - torque * values["torque_feed_forward"])
            for wanted, speed, torque in zip(reference, speeds, torques, strict=True)
        ]

    def controller(self, loop: Loop, residual: StateSpace, rig: System) -> StateSpace:
        """See :meth:`ControlStructure.controller`.

        States [residual vehicle, integrals of the speed errors (k), leads (k)]; integrals or leads that do nothing
        have none.
        """
        k, size = len(loop.dynamometers), len(residual.A)
        count = residual.B.shape[1] - k
        drive = np.hstack([residual.B[:, :k], np.zeros((size, k)), residual.B[:, k:]])
        torque = np.eye(k, 2 * k + count)
        error_of_states, error_of_inputs = residual.C, -np.eye(k, 2 * k + count, k)
        ahead = loop["acceleration_feed_forward"]
        A, B = residual.A, drive
        C = loop["proportional_gain"] * error_of_states + ahead * residual.C @ residual.A
        D = loop["proportional_gain"] * error_of_inputs + ahead * residual.C @ drive
        D = D - loop["torque_feed_forward"] * torque
        if loop["integral_gain"]:
            A = np.block([[A, np.zeros((size, k))], [error_of_states, np.zeros((k, k))]])
            B = np.vstack([B, error_of_inputs])
            C = np.hstack([C, loop["integral_gain"] * np.eye(k)])
        if loop["lead_time"] > SHORTEST_LEAD:
            rate = LEAD_POLE_OVER_ZERO / loop["lead_time"]
            A = np.block([[A, np.zeros((len(A), k))], [rate * C, -rate * np.eye(k)]])
            B = np.vstack([B, rate * D])
            C = np.hstack([LEAD_POLE_OVER_ZERO * C, (1 - LEAD_POLE_OVER_ZERO) * np.eye(k)])
            D = LEAD_POLE_OVER_ZERO * D
        names = [dynamometer.name for dynamometer in loop.dynamometers]
        signals = (*(f"{name} torque" for name in names), *(f"{name} speed" for name in names))
        return StateSpace(A, B, C, D, (*signals, *residual.inputs[k:]), tuple(names))
