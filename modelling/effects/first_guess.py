"""What an effect guesses its first values from: the motion of a fitted model without it, and the misfit's gradient."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np
import scipy


@dataclass(frozen=True)
class FittedMotion:
    """The motion of a fitted model over the recorded inputs; segments of recordings one after another.

    Attributes
    ----------
    time : ndarray (t,)
        s, from the start of each recording.
    segments : tuple of slice
        The uninterrupted segments.
    angle, speed, acceleration : dict of str to ndarray (t,)
        By inertia.
    twist, twist_rate, torque : dict of str to ndarray (t,)
        By shaft; twist and its rate as the shaft's law takes them, torque on the second end's side.
    input : dict of str to ndarray (t,)
        As recorded, by input.
    reading : dict of str to ndarray (t,)
        As simulated, by sensor.
    noise : dict of str to float
        Standard uncertainty by sensor.
    value : dict of str to float
        Every quantity by its full name.
    ends : dict of str to (str, str)
        The inertias that a shaft joins.
    torque_gradient : dict of str to ndarray (t,)
        By inertia: −∂χ²/∂torque, how much a torque at that time would lower the misfit.
    gear_torque : dict of str to ndarray (t,)
        By rigid gear, on the second end's side, as far as it follows from both sides.
    gear_ends : dict of str to (str, str)
        The inertias that a rigid gear joins.
    recording : ndarray (t,)
        Number of the recording that a sample is of, from 1.
    """

    time: np.ndarray
    segments: tuple[slice, ...]
    angle: Mapping[str, np.ndarray]
    speed: Mapping[str, np.ndarray]
    acceleration: Mapping[str, np.ndarray]
    twist: Mapping[str, np.ndarray]
    twist_rate: Mapping[str, np.ndarray]
    torque: Mapping[str, np.ndarray]
    input: Mapping[str, np.ndarray]
    reading: Mapping[str, np.ndarray]
    noise: Mapping[str, float]
    value: Mapping[str, float]
    ends: Mapping[str, tuple[str, str]]
    torque_gradient: Mapping[str, np.ndarray] = field(default_factory=dict)
    gear_torque: Mapping[str, np.ndarray] = field(default_factory=dict)
    gear_ends: Mapping[str, tuple[str, str]] = field(default_factory=dict)
    recording: np.ndarray = field(default_factory=lambda: np.zeros(0, dtype=int))

    @property
    def step(self) -> float:
        """Sampling interval, s."""
        return float(np.median(np.diff(self.time[self.segments[0]])))

    def signal(self, place: str) -> np.ndarray:
        """What the input or sensor at a place carries, (t,): as recorded, or as simulated."""
        table, name = place.split(".")
        return (self.input if table == "inputs" else self.reading)[name]

    def per_segment(self, work: Callable[[np.ndarray, np.ndarray], np.ndarray], signal: np.ndarray) -> np.ndarray:
        """``work(time, signal)`` on every segment by itself."""
        return np.concatenate([work(self.time[part], signal[part]) for part in self.segments])

    def delayed(self, signal: np.ndarray, delay: float) -> np.ndarray:
        """A signal (t,) that comes ``delay`` s later."""
        return self.per_segment(lambda t, s: np.interp(t - delay, t, s), signal)

    def lagged(self, signal: np.ndarray, time_constant: float) -> np.ndarray:
        """A signal (t,) through a first-order lag."""
        a = float(np.exp(-self.step / time_constant))
        last = time_constant / self.step * (1 - a) - a
        return self.filtered([1 - a - last, last], [1, -a], signal)

    def filtered(self, b: list[float], a: list[float], signal: np.ndarray) -> np.ndarray:
        """A signal (t,) through a discrete filter that has settled at the first sample."""
        return self.per_segment(lambda _, s: scipy.signal.lfilter(b, a, s - s[0]) + s[0] * sum(b) / sum(a), signal)


@dataclass(frozen=True)
class Guess:
    """A first guess of an effect: what it would add to the model's equations along the motion without it.

    Attributes
    ----------
    additions : tuple of dict
        Each by place: ``inertias.…`` torque on it (t,), ``shafts.…`` further torque of it (t,), ``inputs.…`` further
        input (t,), ``sensors.…`` further reading (t,), or a quantity's full name with the change of its value.
        Their amplitudes a follow from least squares.
    parameters : callable
        Amplitudes a, one for each addition → parameters of the effect, or None if no such effect exists.
    chosen_from : float
        From how many independent guesses it was chosen by looking at the residual: the best of many lowers the misfit
        by more, also where there is only noise.
    """

    additions: tuple[Mapping[str, np.ndarray | float], ...]
    parameters: Callable[[np.ndarray], dict[str, float] | None]
    chosen_from: float = 1.0


def if_positive(name: str, factor: float = 1.0, **others: float) -> Callable[[np.ndarray], dict[str, float] | None]:
    """Parameters where ``name`` is ``factor`` times the amplitude, which must be positive."""
    return lambda a: {name: factor * float(a[0]), **others} if a[0] > 0 else None


def smooth_sign(speed: np.ndarray) -> np.ndarray:
    """Sign of a speed (t,), smoothed over a thousandth of its largest value."""
    return np.tanh(speed / (1e-3 * float(np.abs(speed).max()) + 1e-9))
