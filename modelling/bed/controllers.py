"""The control structures ``pi`` and ``model_based``, and all structures by name."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from modelling.bed.bed import ControlStructure, Loop, LoopQuantity, bed_model, of_model
from modelling.bed.observer import Observer, riccati
from modelling.bed.vehicle import FeedForward, ResidualVehicle
from modelling.linear.state_space import StateSpace, discretise
from modelling.system import System

# --- Design of the model-based feed-forward: H2-optimal commands across a dead time.
#
# The residual vehicle is driven by the torque of the cut shaft; the dynamometers have to make the rig's end of that
# shaft turn as the residual vehicle does. Minimising the squared speed difference over all frequencies, with a weight
# on the commands, is an H2 problem; for torques that step at unforeseeable moments its optimum across a dead time is
# feedback on the state predicted with the measured torques held, and on these torques (Kwakernaak and Sivan, Linear
# Optimal Control Systems, 1972; Mirkin and Raskin, Automatica 39 (2003) 1747, for the dead time). It is solved in
# discrete time at the sample time of the controller, with dead times that are no multiple of it taken exactly.
#
# Up to the newest sample, measured torques are taken as linear between samples; to hold them would be to answer half a
# sample late.

COMMAND_WEIGHT = 1e-12  # (rad/s per N·m)²: with this weight the commands are practically free
STATE_WEIGHT = 1e-14  # on every state, so that the Riccati equation sees also what the speed error does not show
LEAK_PER_SAMPLE = 1e-9  # of the torques to come: as good as held for ever, and the sum over all samples is finite


def design_feed_forward(
    rig: System,
    residual: ResidualVehicle,
    loop: Loop,
    command_weight: float = COMMAND_WEIGHT,
) -> FeedForward:
    """Solve the H2 problem of a rig, a residual vehicle and a loop.

    Parameters
    ----------
    rig : System
    residual : ResidualVehicle
        As cut out of the vehicle: the reference, not what was tuned for the feedback.
    loop : Loop
        Dead time, inverter lag, torque-sensor lag and sample time are used.
    command_weight : float
        (rad/s per N·m)².

    Raises
    ------
    NoDesign
        If the H2 problem has no stabilising solution.
    """
    step = loop["sample_time"]
    model, k = bed_model(rig, residual, loop), len(loop.dynamometers)
    plant, bed = model.space, of_model(model, loop.command_delays(), step)
    size, more = len(bed.whole), len(bed.whole) - len(plant.A)  # states, and of these registers of longer dead times
    torques = discretise(plant.A, plant.B[:, k:], step)
    A = np.vstack([np.hstack([bed.whole, bed.old]), np.zeros((k, size + k))])
    B = np.vstack([bed.new, np.eye(k)])
    W, ramp = (np.vstack([part, np.zeros((more + k, len(model.measured)))]) for part in (torques.held, torques.ramp))
    E = np.hstack([model.speed_error, np.zeros((k, more + k))])
    R = command_weight * np.eye(k)
    Q = E.T @ E + STATE_WEIGHT * np.eye(len(A))
    X = riccati(A, B, Q, R, what="feed-forward for this rig and vehicle")
    F = np.linalg.solve(B.T @ X @ B + R, B.T @ X @ A)
    closed, stay = A - B @ F, 1 - LEAK_PER_SAMPLE
    to_come = np.linalg.solve(np.eye(len(A)) - stay * closed.T, closed.T @ X @ W)
    of_torques = np.linalg.solve(B.T @ X @ B + R, B.T @ (X @ W + stay * to_come))
    C = np.hstack([plant.C, np.zeros((len(plant.C), more + k))])
    # the state is kept without what the newest torques did since the sample before: ξ = x − ramp·w
    return FeedForward(
        A, B, A @ ramp + W - ramp, C, plant.D[:, k:] + C @ ramp, F, of_torques + F @ ramp, bed.delay, step,
        model.measured, plant.outputs,
    )  # fmt: skip


# --- Speed control with torque and acceleration feed-forward and a lead: what most beds have.
#
# command = lead·[(kp + ki/s)·(reference − speed) + ka·s·reference − kt·torque], lead = (1 + s·T)/(1 + s·T/5).

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


@dataclass(frozen=True)
class PI(ControlStructure):
    """Feedback alone."""

    name = "pi"
    quantities = QUANTITIES

    def gives_torque(self, values: Mapping[str, float]) -> bool:
        """Unless every gain is 0."""
        return any(values[name] for name in GAINS)

    def measured_inputs(self, measured: Sequence[str], simulated: Sequence[str]) -> tuple[str, ...]:
        """None: feedback reacts to what a torque does, not to the torque."""
        return ()

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


# --- Model-based feed-forward of measured torques, and the feedback of ``pi`` for everything else.
#
# A model of rig and vehicle runs in the controller on the measured torques, is predicted across the dead time, and
# commands what makes its interface follow the vehicle (:mod:`modelling.bed.controllers`). The feedback acts on what the
# measurements deviate from that model by, so its poles, margins and its response to unmeasured torques are those of
# ``pi``.


@dataclass(frozen=True)
class ModelBased(PI):
    """Feed-forward through a model of rig and vehicle, with the feedback of :class:`PI`."""

    name = "model_based"
    has_feed_forward = True

    def gives_torque(self, values: Mapping[str, float]) -> bool:
        """Always: the feed-forward needs no gain."""
        return True

    def measured_inputs(self, measured: Sequence[str], simulated: Sequence[str]) -> tuple[str, ...]:
        """All that are measured; what acts inside the residual vehicle is computed by the controller itself."""
        return (*measured, *simulated)

    def feed_forward(self, rig: System, residual: ResidualVehicle, loop: Loop) -> FeedForward | None:
        """See :meth:`ControlStructure.feed_forward`."""
        return design_feed_forward(rig, residual, loop)


# --- Structures

STRUCTURES: dict[str, ControlStructure] = {structure.name: structure for structure in (PI(), ModelBased(), Observer())}
DEFAULT = ModelBased.name  # of a case that names none
