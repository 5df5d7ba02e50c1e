"""Whether the recorded inputs follow the sensors' noise, as those of a controlled drive do.

A fit by output error takes the inputs as known and independent of the noise. Under feedback a part of them is noise
that has gone through the controller, and parameters are biased by about the share of that part (Ljung, System
Identification, 1999, section 13.4). White noise that nobody feeds back is uncorrelated with all later inputs. Where the
residual follows earlier inputs too, it is an error of the model, and nothing is said.
"""

from __future__ import annotations

import numpy as np
from scipy import fft, special

from matching.diagnosis.search.hypothesis import Hypothesis, at_noise

LAGS = 32  # samples after a reading in which a controller answers it
PASSED_BY_CHANCE = 1e-5  # probability that an input without feedback is taken to have it
MODEL_ERROR = 1e-3  # probability of the correlation with earlier inputs from which the residual is no noise
SMALLEST_SHARE = 1e-3  # of the power of an input's changes; less biases nothing beyond other uncertainties


def closed_loop_notes(final: Hypothesis) -> list[str]:
    """A note for each input that follows a sensor's noise; none where the residual is more than noise."""
    if not at_noise(final):
        return []
    model, segments = final.fit.problem.model, final.fit.problem.data.segments
    notes = []
    for i, name in enumerate(model.inputs):
        shares = {}
        for j, sensor in enumerate(model.sensors):
            share = share_fed_back(
                [(e[:, j], segment.inputs[:, i]) for e, segment in zip(final.fit.errors, segments, strict=True)]
            )
            if share > SMALLEST_SHARE:
                shares[sensor] = share
        if shares:
            strongest = max(shares, key=lambda sensor: shares[sensor])
            notes.append(
                f"{name} follows the noise of {strongest} (closed loop): {100 * shares[strongest]:.2g} % of the power "
                "of its changes; parameters may be off by about that share, which an open loop would not have"
            )
    return notes


def share_fed_back(pairs: list[tuple[np.ndarray, np.ndarray]]) -> float:
    """Share of the power of an input's changes that the sensor's noise before them explains; 0 where that is chance.

    Parameters
    ----------
    pairs : list of (ndarray (t,), ndarray (t,))
        White noise of a sensor and the input, of each segment.
    """
    after, before_it = np.zeros(LAGS), np.zeros(LAGS)  # products with the input's later and earlier changes
    count, power, noise = 0, 0.0, 0.0
    for errors, signal in pairs:
        change = np.diff(signal) - np.mean(np.diff(signal))
        before = errors[:-1] - np.mean(errors[:-1])  # the reading at the beginning of each change
        size = fft.next_fast_len(2 * len(change), real=True)
        correlation = fft.irfft(np.conj(fft.rfft(before, size)) * fft.rfft(change, size), size)
        after += correlation[:LAGS]
        before_it += correlation[-LAGS:]
        count, power, noise = count + len(change), power + float(change @ change), noise + float(before @ before)
    if not power * noise > 0:
        return 0.0
    share, earlier = (float(products @ products) / (power * noise) for products in (after, before_it))
    chance, chance_earlier = (special.chdtrc(LAGS, count * value) for value in (share, earlier))
    if chance > PASSED_BY_CHANCE or chance_earlier < MODEL_ERROR:
        return 0.0
    return max(share - LAGS / count, 0.0)
