"""Closed loops: inputs that follow the noise of readings, and what that does to the parameters of a fit."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy import fft, signal, special, stats

from matching.diagnosis.descent import Fit
from matching.diagnosis.hypotheses import Hypothesis, at_noise
from matching.diagnosis.problem import jacobian
from modelling.recordings.recording import Recording

# --- Whether the recorded inputs follow the sensors' noise, as those of a controlled drive do.
#
# A fit by output error takes the inputs as known and independent of the noise. Under feedback a part of them is noise
# that has gone through the controller, and parameters are biased by about the share of that part (Ljung, System
# Identification, 1999, section 13.4). White noise that nobody feeds back is uncorrelated with all later inputs. Where
# the residual follows earlier inputs too, it is an error of the model, and nothing is said.
#
# How much a parameter is off is decided where the controller's reference was recorded: it is an instrument, see below.

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


# --- What a fit becomes with instruments: signals that move a controlled input and that no noise of a reading reaches.
#
# Under feedback an input follows the errors of readings, and an output-error fit is biased where these have a memory.
# The controller's reference moves the input too, and follows no error. A regression on it gives the input as it would
# be without noise; the derivatives of the simulated readings under that input are the instruments (two-stage method;
# Van den Hof and Schrama, Automatica 29, 1993). Whether both estimates differ by more than chance is tested after
# Hausman (Econometrica 46, 1978), with the noise's own correlation.

KERNELS = 24  # hat functions that an impulse response is made of, their lags growing geometrically
LONGEST_RESPONSE_S, RESPONSE_SHARE = 2.0, 0.1  # lag of the last; and of the shortest segment at most
CORRELATION_SHARE = 0.05  # of a segment: longest lag of the noise's correlation that is counted
LEAST_MOVED = 0.05  # share of the controlled input's power: an instrument that moves less says nothing
CHANCE = 1e-4  # probability that an unbiased fit is called biased, or a rest without pattern one that has it


@dataclass(frozen=True)
class InstrumentedFit:
    """A fit beside what it becomes with instruments.

    Attributes
    ----------
    moved : float
        Share of the controlled inputs' power that instruments explain, of the worst.
    values, uncertainties : dict of str to float
        Of the fitted parameters with instruments, SI.
    biased : tuple of str
        Parameters that differ by more than chance.
    rest_follows : bool
        The residual is correlated with the instruments: the model is wrong, and a bias cannot be told from that.
    """

    moved: float
    values: dict[str, float]
    uncertainties: dict[str, float]
    biased: tuple[str, ...]
    rest_follows: bool


def instrumented_fit(fit: Fit, references: Mapping[int, Sequence[np.ndarray]]) -> InstrumentedFit:
    """The fit with instruments.

    Parameters
    ----------
    references : mapping of int to sequence of ndarray (t,)
        By controlled input (index): its reference on every segment.
    """
    segments = fit.problem.data.segments
    designs = _designs(fit, references)
    inputs, moved = _free_of_noise(fit, designs, list(references))
    data = replace(
        fit.problem.data, segments=tuple(replace(s, inputs=u) for s, u in zip(segments, inputs, strict=True))
    )
    problem = replace(fit.problem, data=data)
    instruments = jacobian(problem, fit.v, problem.residuals(fit.v[None])[0])
    by_instruments, by_errors = _estimators(fit, instruments), _estimators(fit, fit.jacobian)
    count = len(fit.problem.free)
    step = -by_instruments @ fit.residual
    difference = -(by_instruments - by_errors)[:count] @ fit.residual
    spread = np.sqrt(_variance(fit, (by_instruments - by_errors)[:count], fit.residual))
    uncertainty = np.sqrt(_variance(fit, by_instruments[:count], fit.residual))
    rest = fit.residual + fit.jacobian @ step
    limit = float(stats.norm.isf(CHANCE / 2 / max(count, 1)))
    names = fit.problem.free
    return InstrumentedFit(
        moved,
        dict(zip(names, (float(x) for x in fit.v[:count] + difference), strict=True)),
        dict(zip(names, (float(x) for x in uncertainty), strict=True)),
        tuple(name for name, d, s in zip(names, difference, spread, strict=True) if abs(d) > limit * s > 0),
        _follows(fit, rest, designs),
    )


def _designs(fit: Fit, references: Mapping[int, Sequence[np.ndarray]]) -> list[np.ndarray]:
    """Regressors (t, k) of every segment: references and inputs that no controller moves, through the hat kernels."""
    segments, step = fit.problem.data.segments, fit.problem.data.sampling_interval
    shortest = min(len(segment.time) for segment in segments)
    longest = max(int(min(LONGEST_RESPONSE_S / step, RESPONSE_SHARE * shortest)), KERNELS)
    knots = np.unique(np.concatenate([[0.0], np.geomspace(1, longest, KERNELS - 1)]))
    hats = [np.interp(np.arange(longest + 1), knots, unit) for unit in np.eye(len(knots))]
    open_inputs = [j for j in range(len(fit.problem.model.inputs)) if j not in references]
    out = []
    for i, segment in enumerate(segments):
        sources = [reference[i] for reference in references.values()]
        sources += [segment.inputs[:, j] for j in open_inputs]
        columns = [np.ones(len(segment.time))]
        for source in sources:
            columns += [
                signal.fftconvolve(source - source[0], hat)[: len(source)] for hat in hats if np.ptp(source) > 0
            ]
        out.append(np.stack(columns, axis=1))
    return out


def _free_of_noise(fit: Fit, designs: list[np.ndarray], controlled: list[int]) -> tuple[list[np.ndarray], float]:
    """Inputs (t, u) of every segment with controlled ones as instruments move them, and the least share explained."""
    segments = fit.problem.data.segments
    inputs, least = [segment.inputs.copy() for segment in segments], 1.0
    design = np.concatenate(designs)
    for j in controlled:
        recorded = np.concatenate([segment.inputs[:, j] for segment in segments])
        weights = np.linalg.lstsq(design, recorded, rcond=1e-8)[0]
        for part, values in zip(designs, inputs, strict=True):
            values[:, j] = part @ weights
        power = float(np.var(recorded))
        least = min(least, 1 - float(np.var(recorded - design @ weights)) / power if power > 0 else 0.0)
    return inputs, least


def _estimators(fit: Fit, instruments: np.ndarray) -> np.ndarray:
    """(v, r): how the variables follow the residual, (ZᵀJ + P)⁻¹·Zᵀ with the information P of the ranges."""
    size = np.maximum(np.linalg.norm(fit.jacobian, axis=0), 1e-300)
    width = (fit.problem.upper - fit.problem.lower) * size
    known = np.where(np.isfinite(width), 12 / np.maximum(width, 1e-300) ** 2, 0.0)
    scaled = instruments / size
    inner = scaled.T @ (fit.jacobian / size) + np.diag(known)
    return np.linalg.pinv(inner, rcond=1e-10) @ scaled.T / size[:, None]


def _variance(fit: Fit, weights: np.ndarray, errors: np.ndarray) -> np.ndarray:
    """Variance (w,) of weighted sums of errors (r,), weights (w, r)."""
    segments, total = fit.problem.data.segments, np.zeros(len(weights))
    ends = np.cumsum([segment.readings.size for segment in segments])[:-1]
    for part, error in zip(np.split(weights, ends, axis=1), fit.problem.by_sensor(errors), strict=True):
        by_sensor = part.reshape(len(weights), *error.shape)
        total += sum(_variance_of_sums(by_sensor[:, :, j], error[:, j]) for j in range(error.shape[1]))
    return total


def _variance_of_sums(weights: np.ndarray, errors: np.ndarray) -> np.ndarray:
    """Variance (w,) of weighted sums, weights (w, t), of errors (t,) with their own correlation over time."""
    count = len(errors)
    longest = max(int(CORRELATION_SHARE * count), 1)
    size = fft.next_fast_len(count + longest, real=True)
    power = np.abs(fft.rfft(errors - errors.mean(), size)) ** 2
    correlation = np.zeros(size)
    taper = 1 - np.arange(longest + 1) / (longest + 1)
    correlation[: longest + 1] = fft.irfft(power, size)[: longest + 1] / count * taper
    correlation[-longest:] = correlation[longest:0:-1]
    density = np.maximum(fft.rfft(correlation).real, 0.0)
    density[1 : (size + 1) // 2] *= 2  # negative frequencies
    return np.abs(fft.rfft(weights, size, axis=1)) ** 2 @ density / size


def _follows(fit: Fit, rest: np.ndarray, designs: list[np.ndarray]) -> bool:
    """Whether a rest (r,) is correlated with the instruments at any of their lags."""
    parts = fit.problem.by_sensor(rest)
    count = designs[0].shape[1] - 1
    sums, variances = np.zeros((count, parts[0].shape[1])), np.zeros((count, parts[0].shape[1]))
    for design, part in zip(designs, parts, strict=True):
        columns = (design[:, 1:] - design[:, 1:].mean(axis=0)).T
        sums += columns @ part
        variances += np.stack([_variance_of_sums(columns, error) for error in part.T], axis=1)
    measured = variances > 0
    largest = float(np.max(np.abs(sums[measured]) / np.sqrt(variances[measured]), initial=0.0))
    return largest > float(stats.norm.isf(CHANCE / 2 / max(int(measured.sum()), 1)))
