"""The compared transfer functions of vehicle, free rig and matched rig, and how far apart they are."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.signal import cont2discrete

from matching.frequency.case.case import Case
from matching.frequency.loop.exact_loop import ExactLoop
from matching.frequency.loop.linear_body import Body, body, transfer
from matching.frequency.loop.parts import Parts, parts_of
from modelling.bed.model_based import Twin, twin
from modelling.bed.residual_vehicle import cut

POINTS = 80  # log-spaced frequencies of the response error


@dataclass(frozen=True)
class Responses:
    """Responses (f, h) of the compared functions at frequencies (f,), Hz; SI unit of the sensor per N·m.

    Attributes
    ----------
    vehicle : ndarray (f, h)
    reference : ndarray (f, h)
        What ``matched`` is to equal: the vehicle; where the twin answers, the vehicle sampled and held as the twin is.
    rig : ndarray (f, h)
        The free rig before tuning, dynamometers torqueless; NaN where a torque has no path, as one on a road has none.
    matched : ndarray (f, h)
        The tuned rig: the twin where the torque is announced, else the feedback loop.
    unannounced : ndarray (f, h)
        The feedback loop alone.
    """

    frequencies: np.ndarray
    pairs: tuple[tuple[str, str], ...]
    vehicle: np.ndarray
    reference: np.ndarray
    rig: np.ndarray
    matched: np.ndarray
    unannounced: np.ndarray


@dataclass(frozen=True)
class ErrorFigures:
    """Root mean squares over band and functions of |log(H_rig/H_vehicle)|, principal value; None without a function.

    ``before`` free rig; ``after`` matched; ``after_like_before`` matched over the functions of ``before``;
    ``unannounced`` feedback alone. ``unwrapped`` is the same with the phase followed along the frequency, as a check.
    """

    band: tuple[float, float]
    before: float | None
    after: float
    after_like_before: float | None
    unannounced: float
    functions: tuple[dict[str, Any], ...]
    unwrapped: dict[str, float | None]


def responses(case: Case, frequencies: np.ndarray, parts: Parts | None = None, told: Twin | None = None) -> Responses:
    """Responses of the compared functions.

    Parameters
    ----------
    case : Case
        Tuned.
    frequencies : ndarray (f,)
        Hz, above 0 and below half the loop's sampling frequency.
    parts : Parts, optional
        The case's own, with the untuned rig for comparison; else the tuned one is that.
    told : Twin, optional
        The case's own if given already.

    Raises
    ------
    InputError
        If a model cannot be made linear or the twin has no solution.
    """
    parts = parts_of(case) if parts is None else parts
    f = np.asarray(frequencies, float)
    s = 2j * np.pi * f
    pairs = tuple((pair.input, pair.sensor) for pair in case.compared)
    inputs = list(dict.fromkeys(source for source, _ in pairs))
    sensors = list(dict.fromkeys(sensor for _, sensor in pairs))
    vehicle, rig = body(case.vehicle), parts.free

    def picked(
        values: np.ndarray, outputs: tuple[str, ...] | list[str], columns: tuple[str, ...] | list[str]
    ) -> np.ndarray:
        found = np.full((len(f), len(pairs)), np.nan, complex)
        for h, (source, sensor) in enumerate(pairs):
            if source in columns:
                found[:, h] = values[:, outputs.index(sensor), columns.index(source)]
        return found

    own = picked(vehicle.response(s), vehicle.space.outputs, vehicle.space.inputs)
    free = picked(rig.response(s), rig.space.outputs, rig.space.inputs)
    alone = picked(ExactLoop(parts).response(s, inputs, sensors), sensors, inputs)
    matched, reference = alone.copy(), own.copy()
    if parts.announced:
        told = twin(case.rig, cut(case.vehicle, case.rig), case.loop) if told is None else told
        known = [source in parts.announced for source, _ in pairs]
        matched[:, known] = picked(told.response(f), told.outputs, told.announced)[:, known]
        held = picked(sampled(vehicle, told.sample_time, f), vehicle.space.outputs, vehicle.space.inputs)
        reference[:, known] = held[:, known]
    return Responses(f, pairs, own, reference, free, matched, alone)


def sampled(own: Body, step: float, frequencies: np.ndarray) -> np.ndarray:
    """Response (f, y, u) of a body whose inputs are held over a step (s) and whose outputs are sampled."""
    space = own.space
    A, B, C, D, _ = cont2discrete((space.A, space.B, space.C, space.D), step)
    return transfer(A, B, C, D, np.exp(2j * np.pi * frequencies * step))


def response_error(rig: np.ndarray, vehicle: np.ndarray) -> float:
    """Root mean square of |log(H_rig/H_vehicle)|, complex logarithm, principal value; arrays of one shape."""
    return float(np.sqrt(np.mean(_squares(rig, vehicle))))


def error_figures(case: Case, parts: Parts | None = None, told: Twin | None = None) -> ErrorFigures:
    """Response errors over the band of a case, at 80 log-spaced frequencies."""
    parts = parts_of(case) if parts is None else parts
    points = np.geomspace(*case.band, POINTS)
    fine, where = _fine(points, case, parts)
    found = responses(case, fine, parts, told)
    both = [
        {
            "before": followed(found.rig, found.vehicle)[where],
            "after": followed(found.matched, found.reference)[where],
            "unannounced": followed(found.unannounced, found.vehicle)[where],
        }
        for followed in (_squares, _unwrapped_squares)
    ]
    functions = []
    for h, (source, sensor) in enumerate(found.pairs):
        functions.append(
            {"input": source, "sensor": sensor} | {key: _root(value[:, h]) for key, value in both[0].items()}
        )
    path = ~np.isnan(found.rig[0])
    pooled = []
    for squares in both:
        one = {key: _root(value if key != "before" else value[:, path]) for key, value in squares.items()}
        pooled.append(one | {"after_like_before": _root(squares["after"][:, path])})
    main = pooled[0]
    return ErrorFigures(
        case.band,
        main["before"],
        float(main["after"] or 0.0),
        main["after_like_before"],
        float(main["unannounced"] or 0.0),
        tuple(functions),
        pooled[1],
    )


def _fine(points: np.ndarray, case: Case, parts: Parts) -> tuple[np.ndarray, np.ndarray]:
    """The points with more about every resonance, where the phase turns fast; and where the points stand among them."""
    rates = np.concatenate([np.linalg.eigvals(parts.rig.space.A), np.linalg.eigvals(body(case.vehicle).space.A)])
    centres = np.abs(rates[rates.imag > 0]) / (2 * np.pi)
    near = np.concatenate([centre * (1 + np.linspace(-0.15, 0.15, 31)) for centre in centres])
    near = near[(near > points[0]) & (near < points[-1])]
    fine = np.unique(np.concatenate([points, near]))
    return fine, np.searchsorted(fine, points)


def _squares(rig: np.ndarray, vehicle: np.ndarray) -> np.ndarray:
    return np.abs(np.log(rig / vehicle)) ** 2


def _unwrapped_squares(rig: np.ndarray, vehicle: np.ndarray) -> np.ndarray:
    """As :func:`_squares`, the phase followed along the first axis from its principal value at the start."""
    ratio = rig / vehicle
    return np.log(np.abs(ratio)) ** 2 + np.unwrap(np.angle(ratio), axis=0) ** 2


def _root(squares: np.ndarray) -> float | None:
    return None if not squares.size or np.isnan(squares).any() else float(np.sqrt(squares.mean()))
