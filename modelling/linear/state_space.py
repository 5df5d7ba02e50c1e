"""State-space models by name, without the angles that nothing depends on."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.linalg import expm

from modelling.display import Displayed, labelled, series_frame
from modelling.equations.casadi_code import compiled
from modelling.errors import InputError, unknown
from modelling.linear.elements import elements
from modelling.linear.linearise import Linear, deflated, deflated_states, linear_sets, linearise
from modelling.linear.steady_motion import reference_motions, without_ripple
from modelling.system import System
from modelling.units import of_input

# --- A linear system from sample to sample, exactly: inputs that are held, and inputs that grow evenly.


@dataclass(frozen=True)
class Discretised:
    """What one step does: x⁺ = transition·x + held·u + ramp·(u⁺ − u) for inputs that vary linearly over it.

    Attributes
    ----------
    transition : ndarray (x, x)
    held, ramp : ndarray (x, u)
        Of inputs at 1 all the time, and of inputs that grow evenly from 0 to 1.
    """

    transition: np.ndarray
    held: np.ndarray
    ramp: np.ndarray


def by_tustin(space: StateSpace, step: float) -> StateSpace:
    """A continuous system sampled by Tustin's rule (bilinear transformation), ``step`` in s."""
    half = step / 2 * space.A
    implicit = np.linalg.inv(np.eye(len(half)) - half)
    B, C = implicit @ space.B * step, space.C @ implicit
    return StateSpace(
        implicit @ (np.eye(len(half)) + half), B, C, space.D + space.C @ B / 2, space.inputs, space.outputs
    )  # fmt: skip


def discretise(A: np.ndarray, B: np.ndarray, step: float) -> Discretised:
    """Exact solution of ẋ = A (x, x)·x + B (x, u)·u over a step, s, by one matrix exponential (Van Loan, 1978)."""
    n, m = B.shape
    block = np.zeros((n + 2 * m, n + 2 * m))
    block[:n, :n], block[:n, n : n + m], block[n : n + m, n + m :] = A * step, B * step, np.eye(m)
    over = expm(block)[:n]
    return Discretised(over[:, :n], over[:, n : n + m], over[:, n + m :])


# --- A linear motion from sample to sample over a long time, without a step of Python for every sample.


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


# --- Frequency responses between any input and sensor, with exact delays.

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
    units : mapping of str to str
        SI unit of every sensor and input.
    """

    frequencies: np.ndarray
    sensors: tuple[str, ...]
    inputs: tuple[str, ...]
    values: np.ndarray
    units: Mapping[str, str]

    def __getitem__(self, pair: tuple[str, str]) -> np.ndarray:
        """Response (f,) of a sensor to an input, ``response[sensor, input]``.

        Raises
        ------
        InputError
            If a name is unknown.
        """
        sensor, source = pair
        return self.values[:, _index_of(sensor, self.sensors), _index_of(source, self.inputs)]

    def unit(self, sensor: str, source: str) -> str:
        """SI unit of a response, such as ``rad/s per N*m`` or ``rad/s per pedal``."""
        return f"{self.units[sensor]} per {of_input(self.units[source])}"

    def to_dict(self) -> dict[str, dict[str, np.ndarray]]:
        """``{sensor: {input: (f,)}}``."""
        return {sensor: {source: self[sensor, source] for source in self.inputs} for sensor in self.sensors}

    def to_dataframe(self, table: str | None = None) -> Any:  # there is one table
        """The complex responses over frequency (pandas DataFrame), a column ``sensor / input [unit]`` a pair."""
        columns = {f"{sensor} / {source}": self[sensor, source] for sensor in self.sensors for source in self.inputs}
        units = {f"{sensor} / {source}": self.unit(sensor, source) for sensor in self.sensors for source in self.inputs}
        return series_frame(self.frequencies, "frequency [Hz]", columns, units)

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
        :func:`modelling.linear.linearise` or :func:`modelling.linear.linearise.operating_point`.
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
    rows = [_index_of(name, model.sensors) for name in sensors]
    columns = [_index_of(name, model.inputs) for name in inputs]
    units = {part.name: part.unit for part in model.system.sensors} | model.system.input_units
    return Response(f, sensors, inputs, transfer_of(linear, rows, columns).at(2j * np.pi * f), units)


@dataclass(frozen=True)
class Transfer:
    """Transfer functions [C·(sI − A)⁻¹·B + D + of_angles·(sI − A)⁻¹·B/s]·exp(−s·delay); see :func:`transfer_of`.

    Attributes
    ----------
    A, B, C, D : ndarray (l, l), (l, u), (y, l), (y, u)
        Without the angles that nothing depends on.
    of_angles : ndarray (y, l)
        What a sensor reads of such an angle, whose rate is a state: exact down to the rigid-body poles.
    delay : ndarray (y, u)
        s.
    """

    A: np.ndarray
    B: np.ndarray
    C: np.ndarray
    D: np.ndarray
    of_angles: np.ndarray
    delay: np.ndarray

    def at(self, s: np.ndarray) -> np.ndarray:
        """Values (f, y, u) at complex s (f,), 1/s.

        Raises
        ------
        InputError
            If one is a pole (0 Hz of a free drivetrain).
        """
        integrates = np.abs(self.of_angles).any()
        if integrates and np.any(s == 0):
            raise InputError(
                "frequencies", "at 0 Hz the angle of a free drivetrain has no response", "start above 0 Hz"
            )
        out = np.empty((len(s), *self.D.shape), complex)
        size = self.A.shape[0]
        step = max(1, _CHUNK // max(size * size, 1))
        for start in range(0, len(s), step):
            part = s[start : start + step, None, None]
            try:
                states = np.linalg.solve(
                    part * np.eye(size) - self.A, np.broadcast_to(self.B, (len(part), *self.B.shape))
                )
            except np.linalg.LinAlgError:
                raise InputError(
                    "frequencies", "one is a pole of the undamped system", "leave it out, 0 Hz at first"
                ) from None
            out[start : start + step] = self.C @ states + self.D
            if integrates:
                out[start : start + step] += self.of_angles @ states / part
        if not np.isfinite(out).all():
            raise InputError("frequencies", "the response is not finite at one of them", "leave it out, 0 Hz at first")
        return out * np.exp(-s[:, None, None] * self.delay)

    def by_poles(self, s: complex, acting: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Poles (l,) and what each adds to the readings (y, l) at s under inputs (u,): partial fractions."""
        poles, vectors = np.linalg.eig(self.A)
        held = np.linalg.lstsq(vectors, self.B @ acting, rcond=None)[0]
        return poles, (self.C @ vectors) * (held / (s - poles))


def transfer_of(linear: Linear, rows: Sequence[int], columns: Sequence[int]) -> Transfer:
    """Transfer functions of a linear model from inputs to sensors, both by their numbers."""
    n = linear.model.n
    rest = deflated(linear, elements(linear.model, linear.p[None], linear.x0))
    A, lift, free = rest.A, rest.lift, rest.free_angles
    B = lift.T @ linear.B[:, columns]
    C, D = linear.C[rows], linear.D[np.ix_(rows, columns)]
    angles = C[:, :n] @ free  # free angles that a sensor sees are integrals of speeds
    angles[np.abs(angles) < 1e-12 * np.linalg.norm(C[:, :n], axis=1)[:, None]] = 0.0
    delay = linear.sensor_delays[rows][:, None] + linear.input_delays[columns]
    return Transfer(A, B, C @ lift, D, angles @ free.T @ lift[n : 2 * n], delay)


def _index_of(name: str, names: Sequence[str]) -> int:
    if name not in names:
        raise unknown(name, list(names), "response")
    return list(names).index(name)


# --- State space

ROUNDING = 1e-9  # of a sensor's largest coefficient: what it reads of a free angle by rounding alone


@dataclass(frozen=True)
class StateSpace:
    """ẋ = A·x + B·u, y = C·x + D·u with named inputs and outputs; A (x, x), B (x, u), C (y, x), D (y, u), SI.

    With a ``sample_time`` (s) above 0 the left side is x one sample later.
    """

    A: np.ndarray
    B: np.ndarray
    C: np.ndarray
    D: np.ndarray
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    sample_time: float = 0.0

    def __repr__(self) -> str:
        every = f" every {1e3 * self.sample_time:g} ms" if self.sample_time else ""
        return f"StateSpace({len(self.A)} states{every}; {', '.join(self.inputs)} → {', '.join(self.outputs)})"

    def input(self, name: str) -> np.ndarray:
        """Column of B, (x,)."""
        return self.B[:, _index(name, self.inputs)]

    def output(self, name: str) -> np.ndarray:
        """Row of C, (x,)."""
        return self.C[_index(name, self.outputs)]


def state_space(system: System, values: Mapping[str, float] | None = None) -> StateSpace:
    """Linearise a system about its operating point, or at rest, and leave out the rigid-body angles.

    Parameters
    ----------
    values : mapping, optional
        Parameters that differ from the system's, by name, SI.

    Raises
    ------
    InputError
        If a name is unknown, rigid gears lock the system, a sensor reads an angle that is left out, or an input or
        sensor is delayed.
    """
    return state_spaces(system, [values or {}])[0]


def state_spaces(system: System, values: Sequence[Mapping[str, float]]) -> list[StateSpace]:
    """:func:`state_space` of many sets of parameters, linearised together."""
    model = compiled(system)
    p = np.stack([model.vector(one) for one in values])
    if system.operating_point is not None:
        p = np.stack([without_ripple(model, row) for row in p])
    x, u = reference_motions(model, p)
    A, B, C, D, *delays = linear_sets(model, p, x, u)
    if any(delay.any() for delay in delays):
        raise InputError(
            "effects", "a dead time inside the model is not expected here", "state it in the loop of the case"
        )
    parts = elements(model, p, x)
    rest = deflated_states(A, parts.deflection_jacobian, model.n) if parts.spring_transformation.ndim == 2 else None
    if rest is None:  # ratios differ, or what is free to turn: one by one
        return [space for one in values for space in state_spaces(system, [one])]
    angles = C[:, :, : model.n]
    free_part = np.abs(angles @ rest.free_angles).max(axis=2, initial=0.0)
    blind = free_part > ROUNDING * np.abs(angles).max(axis=2, initial=0.0)  # relative: a stiff shaft has large entries
    if blind.any():
        name = model.sensors[int(np.argmax(blind.any(axis=0)))]
        raise InputError(f"sensors.{name}", "reads an angle that turns freely", "use a speed or a torque here")
    inputs, sensors = tuple(model.inputs), tuple(model.sensors)
    rows = zip(rest.A, rest.lift.T @ B, C @ rest.lift, D, strict=True)
    return [StateSpace(*matrices, inputs, sensors) for matrices in rows]


def _index(name: str, names: tuple[str, ...]) -> int:
    if name not in names:
        raise unknown(name, list(names), "")
    return names.index(name)
