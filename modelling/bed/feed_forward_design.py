"""Design of the model-based feed-forward: H2-optimal commands across a dead time.

The residual vehicle is driven by the torque of the cut shaft; the dynamometers have to make the rig's end of that
shaft turn as the residual vehicle does. Minimising the squared speed difference over all frequencies, with a weight
on the commands, is an H2 problem; for torques that step at unforeseeable moments its optimum across a dead time is
feedback on the state predicted with the measured torques held, and on these torques (Kwakernaak and Sivan, Linear
Optimal Control Systems, 1972; Mirkin and Raskin, Automatica 39 (2003) 1747, for the dead time). It is solved in
discrete time at the sample time of the controller, with dead times that are no multiple of it taken exactly.

Up to the newest sample, measured torques are taken as linear between samples; to hold them would be to answer half a
sample late.
"""

from __future__ import annotations

import numpy as np

from modelling.bed.bed_model import bed_model
from modelling.bed.delayed_bed import of_model
from modelling.bed.feed_forward import FeedForward
from modelling.bed.loop import Loop
from modelling.bed.residual_vehicle import ResidualVehicle
from modelling.bed.riccati import riccati
from modelling.linear.discretise import discretise
from modelling.model.system import System

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
    InputError
        If the H2 problem has no stabilising solution.
    """
    step = loop["sample_time"]
    model, k = bed_model(rig, residual, loop), len(loop.dynamometers)
    plant, size = model.space, len(model.space.A)
    bed = of_model(model, loop.command_delay(), step)
    torques = discretise(plant.A, plant.B[:, k:], step)
    A = np.vstack([np.hstack([bed.whole, bed.old]), np.zeros((k, size + k))])
    B = np.vstack([bed.new, np.eye(k)])
    W, ramp = (np.vstack([part, np.zeros((k, len(model.measured)))]) for part in (torques.held, torques.ramp))
    E = np.hstack([model.speed_error, np.zeros((k, k))])
    R = command_weight * np.eye(k)
    Q = E.T @ E + STATE_WEIGHT * np.eye(len(A))
    X = riccati(A, B, Q, R, what="feed-forward for this rig and vehicle")
    F = np.linalg.solve(B.T @ X @ B + R, B.T @ X @ A)
    closed, stay = A - B @ F, 1 - LEAK_PER_SAMPLE
    to_come = np.linalg.solve(np.eye(len(A)) - stay * closed.T, closed.T @ X @ W)
    of_torques = np.linalg.solve(B.T @ X @ B + R, B.T @ (X @ W + stay * to_come))
    C = np.hstack([plant.C, np.zeros((len(plant.C), k))])
    # the state is kept without what the newest torques did since the sample before: ξ = x − ramp·w
    return FeedForward(
        A, B, A @ ramp + W - ramp, C, plant.D[:, k:] + C @ ramp, F, of_torques + F @ ramp, bed.delay, step,
        model.measured, plant.outputs,
    )  # fmt: skip
