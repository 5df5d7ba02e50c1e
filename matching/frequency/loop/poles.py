"""Poles of the closed loop, the dead time replaced by Padé approximations of several orders."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from matching.frequency.loop.motion import LinearMotion
from matching.frequency.loop.pade import good_up_to, parallel, phase_error
from matching.frequency.loop.parts import Parts

ORDERS = (3, 5, 8)
MORE = (12, 16, 20, 24)  # taken as well where the dead time is long for what the loop does
BELIEVED = np.radians(5.0)  # phase error up to which an approximation counts, as far as the loop has gain
TRUSTED = np.radians(1.0)  # phase error up to which an approximation is believed
RESTING_BELOW = 1e-6  # rad/s: a rigid motion without drag stands here, neither stable nor unstable


@dataclass(frozen=True)
class Approximation:
    """Poles of the feedback loop with one approximation of the dead time.

    Attributes
    ----------
    order : int
    poles : ndarray (x,)
        rad/s.
    phase_error : float
        rad, largest over the band of the case.
    good_up_to : float
        Hz, up to where the phase error stays under 1°.
    """

    order: int
    poles: np.ndarray
    phase_error: float
    good_up_to: float

    @property
    def abscissa(self) -> float:
        """Largest real part, 1/s."""
        return float(self.poles.real.max())

    def unstable(self, neutral: int) -> int:
        """Poles that are not stable, see :func:`resting_and_right`."""
        return resting_and_right(self.poles, neutral)[1]


def resting_and_right(poles: np.ndarray, neutral: int) -> tuple[int, int]:
    """How many poles (x,), 1/s, at 0 are rigid motions without drag, and how many poles are not stable.

    At most ``neutral`` poles at 0 are taken for such motions, which the vehicle has as well; more are not stable.
    """
    resting = int(np.sum(np.abs(poles) < RESTING_BELOW))
    right = int(np.sum((poles.real >= 0) & (np.abs(poles) >= RESTING_BELOW)))
    return min(resting, neutral), right + max(resting - neutral, 0)


def closed_matrix(parts: Parts, order: int, dead_time: float | None = None) -> np.ndarray:
    """State matrix (x, x) of the closed feedback loop: states [bed, controller, dead time].

    ``dead_time`` (s) replaces that of the case.
    """
    delay = parts.case.loop["dead_time"] if dead_time is None else dead_time
    bed, controller, k = parts.bed, parts.controller, len(parts.dynamometers)
    Ap, Bp, Cp, Dp = parallel(delay, order, k)
    y, v = bed.C[: 2 * k], bed.B[:, :k]
    Bc, Dc = controller.B[:, : 2 * k], controller.D[:, : 2 * k]
    u = [Dc @ y, controller.C]  # command from bed and controller states
    return np.block(
        [
            [bed.A + v @ Dp @ u[0], v @ Dp @ u[1], v @ Cp],
            [Bc @ y, controller.A, np.zeros((len(controller.A), len(Ap)))],
            [Bp @ u[0], Bp @ u[1], Ap],
        ]
    )


def approximations(
    parts: Parts, dead_time: float | None = None, orders: tuple[int, ...] = ORDERS
) -> tuple[Approximation, ...]:
    """Poles for every Padé order, lowest first, with the case's dead time (s) or another."""
    delay = parts.case.loop["dead_time"] if dead_time is None else dead_time
    band = np.linspace(0, parts.case.band[1], 50)
    return tuple(
        Approximation(
            order,
            np.linalg.eigvals(closed_matrix(parts, order, dead_time)),
            float(phase_error(delay, order, band).max()),
            good_up_to(delay, order, TRUSTED),
        )
        for order in orders
    )


def sampled_poles(parts: Parts) -> np.ndarray:
    """Poles z (x,) of the feedback loop as it runs: controller sampled (Tustin), held, a true delay line, rig exact.

    The delay line is half a sample shorter than the dead time, which counts the hold, as in the simulation.
    """
    step, k = parts.case.loop["sample_time"], len(parts.dynamometers)
    bed, law = parts.bed, parts.sampled_controller
    motion = LinearMotion(bed.A, bed.B, k, step, parts.case.loop.command_delay())
    A, B, C, D = law.A, law.B[:, : 2 * k], law.C, law.D[:, : 2 * k]
    n, c, oldest = len(bed.A), len(law.A), max(i for i, _ in motion.commands)
    y = bed.C[: 2 * k]
    closed = np.zeros((n + c + oldest * k,) * 2)
    issue = np.zeros((k, len(closed)))  # the command of this sample
    issue[:, :n], issue[:, n : n + c] = D @ y, C
    closed[:n, :n] = motion.whole
    closed[n : n + c, :n], closed[n : n + c, n : n + c] = B @ y, A
    for i, push in motion.commands:
        if i == 0:
            closed[:n] += push @ issue
        else:
            closed[:n, n + c + (i - 1) * k : n + c + i * k] += push
    if oldest:
        closed[n + c : n + c + k] = issue
        closed[n + c + k :, n + c : -k] = np.eye((oldest - 1) * k)
    return np.linalg.eigvals(closed)


def orders_for(delay: float, edge: float) -> tuple[int, ...]:
    """Orders to take: 3, 5, 8 and as many more as bring the phase error at ``edge`` (Hz) to 5°."""
    orders = list(ORDERS)
    for order in MORE:
        if phase_error(delay, orders[-1], np.array([edge]))[0] <= BELIEVED:
            break
        orders.append(order)
    return tuple(orders)


def neutral_motions(parts: Parts) -> int:
    """Rigid motions of the residual vehicle that nothing slows: poles at 0 that the vehicle has as well."""
    return sum(int(np.sum(np.abs(np.linalg.eigvals(part.space.A)) < RESTING_BELOW)) for part in parts.residual)
