"""First derivatives of margin, roll-off and noise on the bed as planned, exact; w weights to be tuned."""

from __future__ import annotations

import numpy as np

from matching.frequency.beds.figures import LoopCurves, Planned, command_noise, noise_weights
from matching.frequency.beds.slopes import ActionSlopes


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
