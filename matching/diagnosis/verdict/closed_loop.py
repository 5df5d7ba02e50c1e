"""Whether the recorded inputs follow the sensors' noise, as those of a controlled drive do.

A fit by output error takes the inputs as known and independent of the noise. Under feedback a part of them is noise
that has gone through the controller, and parameters are biased by about the share of that part (Ljung, System
Identification, 1999, section 13.4). White noise that nobody feeds back is uncorrelated with all later inputs. Where the
residual follows earlier inputs too, it is an error of the model, and nothing is said.

How much a parameter is off is decided where the controller's reference was recorded: it is an instrument
(:mod:`matching.diagnosis.search.instruments`).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy import fft, special

from matching.diagnosis.search.hypothesis import Hypothesis, at_noise
from matching.diagnosis.search.instruments import LEAST_MOVED, instrumented_fit
from modelling.measurement.recording import Recording

LAGS = 32  # samples after a reading in which a controller answers it
PASSED_BY_CHANCE = 1e-5  # probability that an input without feedback is taken to have it
MODEL_ERROR = 1e-3  # probability of the correlation with earlier inputs from which the residual is no noise
LARGEST_REST = 1.5  # mean square of a residual in times the noise: more is an error of the model
SMALLEST_SHARE = 1e-3  # of the power of an input's changes; less biases nothing beyond other uncertainties


def closed_loop_notes(final: Hypothesis, recordings: Sequence[Recording]) -> list[str]:
    """What feedback does to the parameters: by the references of controlled inputs where they were recorded, and a note
    for each other input that follows a sensor's noise.

    Parameters
    ----------
    recordings : sequence of Recording
        That were fitted; they hold the references.
    """
    references = _recorded_references(final, recordings)
    notes = [_decided(final, references)] if references else []
    return notes + _undecided(final, references)


def _recorded_references(final: Hypothesis, recordings: Sequence[Recording]) -> dict[int, list[np.ndarray]]:
    """References (t,) on every segment, by controlled input (index)."""
    out = {}
    for i, part in enumerate(final.model.base.inputs):
        name = part.reference
        if recordings and name is not None and all(name in recording.channels for recording in recordings):
            values = [
                np.interp(segment.time, recording.time, recording[name])
                for segment in final.fit.problem.data.segments
                for recording in [recordings[segment.recording - 1]]
            ]
            if all(np.isfinite(value).all() for value in values):
                out[i] = values
    return out


def _decided(final: Hypothesis, references: dict[int, list[np.ndarray]]) -> str:
    """What instruments say of the parameters."""
    inputs, units = final.model.base.inputs, final.fit.problem.system.units
    controlled = ", ".join(f"{inputs[i].name} (reference {inputs[i].reference})" for i in references)
    instrumented = instrumented_fit(final.fit, references)
    if np.nanmax(final.mean_squares, initial=0.0) > LARGEST_REST:
        why = "more than the sensors' noise is left, so it is an error of the model"
    elif instrumented.moved < LEAST_MOVED:
        why = f"the reference moves {100 * max(instrumented.moved, 0.0):.2g} % of its power"
    elif instrumented.rest_follows:
        why = "what is left follows the reference too, so it is an error of the model"
    elif instrumented.biased:
        values = "; ".join(
            f"{name} {instrumented.values[name]:.4g} ± {instrumented.uncertainties[name]:.2g} {units[name]} "
            f"instead of {final.fit.values[name]:.4g}"
            for name in instrumented.biased
        )
        return f"closed loop of {controlled}: noise that is fed back biases parameters; with the reference: {values}"
    else:
        return f"closed loop of {controlled}: checked with the reference, no parameter is off by more than chance"
    return f"closed loop of {controlled}: whether it biases parameters cannot be decided: {why}"


def _undecided(final: Hypothesis, references: dict[int, list[np.ndarray]]) -> list[str]:
    """A note for each input without a reference that follows a sensor's noise; none where more than noise is left."""
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
        if shares and i not in references:
            strongest = max(shares, key=lambda sensor: shares[sensor])
            notes.append(
                f"{name} follows the noise of {strongest} (closed loop): {100 * shares[strongest]:.2g} % of the power "
                "of its changes; parameters may be off by about that share, which an open loop would not have; whether "
                "they are cannot be decided without the controller's reference as a channel"
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
