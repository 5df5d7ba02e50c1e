"""A linear motion from sample to sample over a long time, without a step of Python for every sample."""

from __future__ import annotations

import numpy as np

from modelling.linear.discretise import discretise


def propagated(transition: np.ndarray, added: np.ndarray, start: np.ndarray) -> np.ndarray:
    """States (t, n) of x⁺ = transition·x + added from ``start`` (n,), the first of them the start.

    About √t blocks are stepped side by side from 0; what the start of each block adds comes from powers of the
    transition, so that the result is that of stepping but for rounding. A motion that grows beyond what a float holds
    ends in values that are not finite.

    Parameters
    ----------
    transition : ndarray (n, n)
    added : ndarray (t, n)
        What acts between a sample and the next, in the unit of the states; the last row is not used.
    """
    count, n = added.shape
    length = int(np.ceil(np.sqrt(count)))
    blocks = -(-count // length)
    inside = np.zeros((length + 1, blocks, n))
    forcing = np.zeros((blocks * length, n))
    forcing[:count] = added
    powers = np.empty((length + 1, n, n))
    powers[0] = np.eye(n)
    starts = np.empty((blocks, n))
    with np.errstate(over="ignore", invalid="ignore"):
        for j, push in enumerate(forcing.reshape(blocks, length, n).swapaxes(0, 1)):
            inside[j + 1] = inside[j] @ transition.T + push
            powers[j + 1] = transition @ powers[j]
        x = start
        for i in range(blocks):
            starts[i] = x
            x = powers[length] @ x + inside[length, i]
        states = inside[:length] + starts @ powers[:length].swapaxes(1, 2)
    return states.swapaxes(0, 1).reshape(-1, n)[:count]


def linear_motion(A: np.ndarray, B: np.ndarray, inputs: np.ndarray, step: float) -> np.ndarray:
    """States (t, n) of ẋ = A (n, n)·x + B (n, m)·u from rest, u (t, m) linear between samples of ``step``, s."""
    discrete = discretise(A, B, step)
    following = np.concatenate([inputs[1:], inputs[-1:]])
    added = inputs @ (discrete.held - discrete.ramp).T + following @ discrete.ramp.T
    return propagated(discrete.transition, added, np.zeros(len(A)))
