"""Frequency responses between any input and sensor, with exact delays."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from modelling.common.display import Displayed, labelled
from modelling.common.errors import InputError, unknown
from modelling.linear.elements import elements
from modelling.linear.linearise import Linear, deflated, linearise
from modelling.model.system import System

_CHUNK = 4_000_000  # complex numbers solved for at once: 64 MB


@dataclass(frozen=True)
class Response(Displayed):
    """Complex frequency responses.

    Attributes
    ----------
    frequencies : ndarray (f,)
        Hz.
    sensors, inputs : tuple of str (y,), (u,)
    values : ndarray (f, y, u), complex
        SI unit of the sensor per N·m.
    """

    frequencies: np.ndarray
    sensors: tuple[str, ...]
    inputs: tuple[str, ...]
    values: np.ndarray

    def __getitem__(self, pair: tuple[str, str]) -> np.ndarray:
        """Response (f,) of a sensor to an input, ``response[sensor, input]``.

        Raises
        ------
        InputError
            If a name is unknown.
        """
        sensor, source = pair
        return self.values[:, _index(sensor, self.sensors), _index(source, self.inputs)]

    def to_dict(self) -> dict[str, dict[str, np.ndarray]]:
        """``{sensor: {input: (f,)}}``."""
        return {sensor: {source: self[sensor, source] for source in self.inputs} for sensor in self.sensors}

    def to_xarray(self) -> Any:
        """The responses over frequency, sensor and input (xarray Dataset, complex).

        Raises
        ------
        InputError
            If xarray is not installed.
        """
        return labelled(
            {"response": (["frequency", "sensor", "input"], self.values, "")},
            {
                "frequency": (self.frequencies, "Hz"),
                "sensor": (list(self.sensors), ""),
                "input": (list(self.inputs), ""),
            },
        )


def response(
    system: System | Linear,
    frequencies: np.ndarray,
    sensors: Sequence[str] | None = None,
    inputs: Sequence[str] | None = None,
    values: Mapping[str, float] | None = None,
) -> Response:
    """Frequency responses H(f) = [C·(jωI − A)⁻¹·B + D]·exp(−jω(input delay + sensor delay)).

    Parameters
    ----------
    system : System or Linear
        A system is linearised at rest with lash closed; for another point give
        :func:`modelling.linear.linearise` or :func:`modelling.linear.operating_point.operating_point`.
    frequencies : array (f,)
        Hz.
    sensors, inputs : sequences of str, optional
        All if not given.
    values : mapping, optional
        Parameters that differ from the system's, by name, SI; only with a system.

    Raises
    ------
    InputError
        If a name is unknown, a frequency is not finite, or it is a pole (0 Hz of a free drivetrain).
    """
    linear = system if isinstance(system, Linear) else linearise(system, values)
    f = np.asarray(frequencies, float)
    if f.ndim != 1 or not np.isfinite(f).all():
        raise InputError("frequencies", "no list of finite numbers", "give them in Hz, shape (f,)")
    model = linear.model
    sensors, inputs = (
        tuple(model.sensors if sensors is None else sensors),
        tuple(model.inputs if inputs is None else inputs),
    )
    rows = [_index(name, model.sensors) for name in sensors]
    columns = [_index(name, model.inputs) for name in inputs]
    s = 2j * np.pi * f
    transfer = _transfer(linear, s, rows, columns)
    delay = linear.sensor_delays[rows][:, None] + linear.input_delays[columns]
    return Response(f, sensors, inputs, transfer * np.exp(-s[:, None, None] * delay))


def _transfer(linear: Linear, s: np.ndarray, rows: list[int], columns: list[int]) -> np.ndarray:
    """C·(sI − A)⁻¹·B + D (f, y, u), the free angles integrated on their own: exact down to the rigid-body poles."""
    n = linear.model.n
    rest = deflated(linear, elements(linear.model, linear.p[None], linear.x0))
    A, lift, free = rest.A, rest.lift, rest.free_angles
    B = lift.T @ linear.B[:, columns]
    C, D = linear.C[rows], linear.D[np.ix_(rows, columns)]
    angles = C[:, :n] @ free  # free angles that a sensor sees are integrals of speeds
    angles[np.abs(angles) < 1e-12 * np.linalg.norm(C[:, :n], axis=1)[:, None]] = 0.0
    of_states, of_angles = C @ lift, angles @ free.T @ lift[n : 2 * n]
    integrates = np.abs(of_angles).any()
    if integrates and np.any(s == 0):
        raise InputError("frequencies", "at 0 Hz the angle of a free drivetrain has no response", "start above 0 Hz")
    out = np.empty((len(s), len(rows), len(columns)), complex)
    size = A.shape[0]
    step = max(1, _CHUNK // max(size * size, 1))
    for start in range(0, len(s), step):
        part = s[start : start + step, None, None]
        try:
            states = np.linalg.solve(part * np.eye(size) - A, np.broadcast_to(B, (len(part), *B.shape)))
        except np.linalg.LinAlgError:
            raise InputError(
                "frequencies", "one is a pole of the undamped system", "leave it out, 0 Hz at first"
            ) from None
        out[start : start + step] = of_states @ states + D
        if integrates:
            out[start : start + step] += of_angles @ states / part
    if not np.isfinite(out).all():
        raise InputError("frequencies", "the response is not finite at one of them", "leave it out, 0 Hz at first")
    return out


def _index(name: str, names: Sequence[str]) -> int:
    if name not in names:
        raise unknown(name, list(names), "response")
    return list(names).index(name)
