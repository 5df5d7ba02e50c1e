"""First derivatives of what a controller does on beds with respect to its gains, exact; w weights to be tuned.

A change of the correction by dL adds dL·e to the corrected state, e being what a reading is off; a change of the
feedback by dF adds −dF·ξ̂ to the command. What either makes of the commands follows from the controller as it is.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from matching.frequency.beds.closed_loop import (
    Action,
    BedSet,
    SampledBeds,
    closed_matrices,
    compared_columns,
    drive,
    return_difference,
)
from matching.frequency.beds.figures import LoopCurves, Planned, command_noise, noise_weights
from matching.frequency.beds.resolvent import resolvent
from modelling.bed.observer_controller import ObserverController

OFF_THE_POLE = 1e-9  # of |z|: an inverse iteration beside the eigenvalue finds its vectors in one step


@dataclass(frozen=True)
class GainSlopes:
    """What a unit of each weight changes of a controller's gains: feedback (w, k, o) and correction (w, o, y)."""

    feedback: np.ndarray
    correction: np.ndarray


@dataclass(frozen=True)
class ActionSlopes:
    """What a unit of each weight changes of an :class:`Action`: (w, f, k, y) and (w, f, k, known)."""

    of_readings: np.ndarray
    of_known: np.ndarray

    def at(self, part: slice) -> ActionSlopes:
        """The same at some of the frequencies."""
        return ActionSlopes(self.of_readings[:, part], self.of_known[:, part])


def action_slopes(
    controller: ObserverController, gains: GainSlopes, frequencies: np.ndarray, ahead: np.ndarray
) -> ActionSlopes:
    """Derivatives of :func:`~matching.frequency.beds.closed_loop.action` at (f,) Hz; ``ahead`` (f, m, w)."""
    o, y = controller.observed, len(controller.sensors)
    A, B, C, L = controller.A[:o, :o], controller.B[:o], controller.C[:, :o], controller.L[:o]
    F, feedback, space = controller.F[:, :o], controller.feedback, controller.space
    z = np.exp(2j * np.pi * frequencies * controller.sample_time)
    form = resolvent(feedback.A)
    left = form.rows(z, feedback.C)
    reaches = space.A[:o, o:] @ ahead + space.B[:o, y:]
    inputs = np.concatenate([np.broadcast_to(feedback.B, (len(z), *feedback.B.shape)), reaches], axis=2)
    predicted = form.columns(z, inputs)
    missed = -C @ predicted
    missed[:, :, :y] += np.eye(y)
    corrected = predicted + L @ missed
    m = ahead.shape[1] - ahead.shape[2]
    corrected[:, :m, y:] -= ahead[:, :m]  # the feedback acts on the difference to the model that runs ahead
    of_command = np.eye(len(F)) + left @ B
    of_state = left @ (A - B @ F) - F
    change = np.stack(
        [
            of_state @ correction @ missed - of_command @ feedback_change @ corrected
            for correction, feedback_change in zip(gains.correction, gains.feedback, strict=True)
        ]
    )
    return ActionSlopes(change[..., :y], change[..., y:])


def error_slopes(beds: BedSet, acting: Action, slopes: ActionSlopes, share: np.ndarray) -> np.ndarray:
    """Derivatives (w,) of Σ share·(response error to unmeasured torques)² over the beds, ``share`` (b,).

    With H the compared function, d|log(H/V)|² = 2·Re(conj(log(H/V))·dH/H).
    """
    driven = drive(beds, acting, ())
    difference = return_difference(beds, acting)
    commands = np.linalg.solve(difference, driven.commands)
    back = np.swapaxes(beds.commanded @ np.linalg.inv(difference), 2, 3)  # (b, f, k, c)
    sensors, inputs = compared_columns(beds.case)
    answers = (beds.commanded @ commands + driven.answered)[:, :, sensors, inputs]
    ratio = answers / beds.vehicle
    pull = np.zeros((*commands.shape[:2], back.shape[3], commands.shape[3]), complex)
    weight = 2 * share[:, None, None] / (ratio.shape[1] * ratio.shape[2])
    with np.errstate(divide="ignore", invalid="ignore"):
        part = np.nan_to_num(weight * np.log(ratio).conj() / answers)
    for h, (sensor, column) in enumerate(zip(sensors, inputs, strict=True)):
        pull[:, :, sensor, column] += part[:, :, h]
    at_command = back @ pull  # (b, f, k, i)
    readings = beds.held @ commands + driven.read  # (b, f, y, i)
    of_readings = (at_command @ np.swapaxes(readings, 2, 3)).sum(axis=0)
    slope = np.einsum("wfky,fky->w", slopes.of_readings, of_readings)
    at_known = at_command.sum(axis=0)
    for column, known in driven.known.items():
        slope = slope + np.einsum("wfk,fk->w", slopes.of_known[..., known], at_known[..., column])
    return slope.real


def pole_slopes(beds: SampledBeds, controller: ObserverController, gains: GainSlopes, poles: np.ndarray) -> np.ndarray:
    """Derivatives (weights, b) of one pole z (b,) of every bed's closed loop: dz = wᴴ·dA·v / wᴴ·v.

    v and w are its right and left eigenvector (Lancaster, Numerische Mathematik 6 (1964) 377).
    """
    closed = closed_matrices(beds, controller).astype(complex)
    size, x, o = closed.shape[1], beds.A.shape[1], controller.observed
    shifted = closed - (poles * (1 + OFF_THE_POLE))[:, None, None] * np.eye(size)
    start = np.broadcast_to(np.cos(np.arange(size))[:, None], (len(poles), size, 1))
    v = np.linalg.solve(shifted, start)
    w = np.linalg.solve(np.swapaxes(shifted, 1, 2), start)
    v, w = (part / np.linalg.norm(part, axis=1, keepdims=True) for part in (v, w))
    B, C, L, F = controller.B[:o], controller.C[:, :o], controller.L[:o], controller.F[:, :o]
    missed = beds.C @ v[:, :x] - C @ v[:, x:]
    corrected = v[:, x:] + L @ missed
    at_command = np.swapaxes(w[:, :x], 1, 2) @ beds.B + np.swapaxes(w[:, x:], 1, 2) @ B
    at_state = np.swapaxes(w[:, x:], 1, 2) @ controller.A[:o, :o] - at_command @ F
    both = np.swapaxes(w, 1, 2) @ v
    return np.stack(
        [
            ((at_state @ correction @ missed - at_command @ feedback @ corrected) / both)[:, 0, 0]
            for correction, feedback in zip(gains.correction, gains.feedback, strict=True)
        ]
    )


def loop_slopes(
    bed: Planned, curves: LoopCurves, slopes: ActionSlopes
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:  # fmt: skip
    """Derivatives of :class:`LoopCurves`: margin (w, f), closed (w, f), and of the command noise (w, k).

    A singular value changes by uᴴ·dM·v.
    """
    inverse = np.linalg.inv(curves.difference)
    change = -slopes.of_readings @ bed.every.held[0]
    left, _, right = np.linalg.svd(curves.difference)
    margin = np.einsum("fk,wfkl,fl->wf", left[:, :, -1].conj(), change, right[:, -1].conj()).real
    left, _, right = np.linalg.svd(inverse - np.eye(inverse.shape[-1]))
    closed = -np.einsum(
        "fk,wfkl,fl->wf", np.einsum("fk,fkl->fl", left[:, :, 0].conj(), inverse), change,
        np.einsum("fkl,fl->fk", inverse, right[:, 0].conj()),
    ).real  # fmt: skip
    noisy = inverse @ (slopes.of_readings * bed.uncertainty - change @ curves.noise)
    f = bed.every.frequencies
    power = 2 * (curves.noise.conj() * noisy).sum(axis=3).real  # (w, f, k)
    noise = np.einsum("f,wfk->wk", noise_weights(f), power) / (2 * command_noise(curves, f))
    return margin, closed, noise
