"""PySINDy (Kaptanoglu et al. 2022) on one recording, with what a careful user would give it.

States are the measured speeds and, integrated from them, twists and angles; a twist's slow part comes from the shaft's
torque sensor where there is one. The library holds states and inputs, dry friction, drag, twist cubed, dead zones of
several widths, torque ripple of several orders and constants: the right law is in it for six of the nine faults hidden
there or none. Inputs that come late were tried in it and left out: they are so like the inputs that every recording
was then called late. Each equation's threshold is chosen by BIC. Kind and place are those terms beyond the linear ones
without which the fit is worse by most.
"""

from __future__ import annotations

import warnings
from dataclasses import dataclass

import numpy as np
from scipy.signal import butter, savgol_filter, sosfiltfilt

from modelling.recordings.recording import Recording
from modelling.system import System

WINDOW = 31  # samples of the smoothing, order 3
GAPS = (0.1, 0.3, 0.6)  # of the twist's range
ORDERS = (1, 2, 3, 4, 6)
SHARES = np.logspace(-4, -0.5, 15)  # thresholds, of the norm of what is to be explained


@dataclass
class Peer:
    """Errors on held-out speeds in times the noise, one step ahead and in free simulation; what it would name."""

    one_step: float
    free: float
    kind: str
    at: str
    terms: int


class Library:
    """Terms by name, computed from states (t, x) and inputs (t, u), with the kind and place each stands for."""

    def __init__(self, system: System, recording: Recording):
        speeds = {own.of: own.name for own in system.sensors if own.measures == "speed"}
        self.inertias = [name for name in speeds if speeds[name] in recording.channels]
        self.sensors = [speeds[name] for name in self.inertias]
        self.pairs = _pairs(system, self.inertias)
        self.inputs = [own.name for own in system.inputs]
        self.widths: dict[str, float] = {}

    def states(self, system: System, recording: Recording, step: float) -> np.ndarray:
        """Speeds, twists, angles, smoothed (t, x)."""
        speed = savgol_filter(np.column_stack([recording[name] for name in self.sensors]), WINDOW, 3, axis=0)
        angle = np.cumsum(speed, axis=0) * step
        columns = list(speed.T)
        for shaft, (a, b) in self.pairs.items():
            twist = angle[:, a] - angle[:, b]
            torque = [own.name for own in system.sensors if own.measures == "torque" and own.of == shaft]
            if torque and torque[0] in recording.channels:
                slow = butter(2, 0.5, fs=1 / step, output="sos")
                stiffness = system.parameters[f"shafts.{shaft}.stiffness"].value
                twist = twist + sosfiltfilt(slow, recording[torque[0]] / stiffness - twist)
            self.widths[shaft] = float(np.ptp(twist))
            columns.append(twist)
        return np.column_stack([*columns, angle])

    def terms(self, x: np.ndarray, u: np.ndarray) -> dict[tuple[str, str, str], np.ndarray]:
        """(name, kind, place) → values (t,); kind is empty for the linear terms."""
        n, m = len(self.inertias), len(self.pairs)
        out: dict[tuple[str, str, str], np.ndarray] = {}
        for i, name in enumerate(self.inertias):
            at, speed, angle = f"inertias.{name}", x[:, i], x[:, n + m + i]
            out[name, "", ""] = speed
            out[f"sign {name}", "coulomb_friction", at] = np.tanh(speed / 0.1)
            out[f"square {name}", "quadratic_drag", at] = speed * abs(speed)
            for order in ORDERS:
                out[f"sin {order} {name}", "torque_ripple", at] = np.sin(order * angle)
                out[f"cos {order} {name}", "torque_ripple", at] = np.cos(order * angle)
        for k, shaft in enumerate(self.pairs):
            at, twist = f"shafts.{shaft}", x[:, n + k]
            out[shaft, "", ""] = twist
            out[f"cube {shaft}", "hardening", at] = twist**3
            for share in GAPS:
                gap = share * self.widths[shaft]
                zone = np.sign(twist) * np.maximum(abs(twist) - gap / 2, 0)
                out[f"zone {share} {shaft}", "backlash", at] = zone
        for j, name in enumerate(self.inputs):
            out[name, "", ""] = u[:, j]
        out["one", "constant_torque", ""] = np.ones(len(x))
        return out


def _pairs(system: System, inertias: list[str]) -> dict[str, tuple[int, int]]:
    """Shafts between inertias with a speed sensor; a shaft with one such end leads through to the motor's."""
    out = {}
    for shaft in system.shafts:
        a, b = shaft.between
        if b not in inertias:
            continue
        if a not in inertias:
            a = inertias[0]
        out[shaft.name] = (inertias.index(a), inertias.index(b))
    return out


def run(system: System, recording: Recording, train: float = 0.7) -> Peer:
    """Fit the first part, judge on the rest."""
    import pysindy

    step = float(np.median(np.diff(recording.time)))
    library = Library(system, recording)
    x, u = library.states(system, recording, step), recording.inputs(system)
    n = len(library.inertias)
    measured = np.column_stack([recording[name] for name in library.sensors])
    rate = savgol_filter(measured, WINDOW, 3, deriv=1, delta=step, axis=0)
    terms = library.terms(x, u)
    theta, names = np.column_stack(list(terms.values())), list(terms)
    cut = slice(WINDOW, int(train * len(x)))
    coefficients = np.zeros((n, len(names)))
    for i in range(n):
        best = np.inf
        for share in SHARES:
            threshold = share * float(np.linalg.norm(rate[cut, i]))
            optimizer = pysindy.STLSQ(threshold=threshold, alpha=1e-8, normalize_columns=True, max_iter=30)
            model = pysindy.SINDy(optimizer=optimizer, feature_library=pysindy.IdentityLibrary())
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")  # thresholds that leave no term are tried and lose
                model.fit(theta[cut, :1], t=step, x_dot=rate[cut, i : i + 1], u=theta[cut, 1:])
            own = np.asarray(model.coefficients())[0]
            left = float(np.mean((rate[cut, i] - theta[cut] @ own) ** 2))
            count = (cut.stop - cut.start) / WINDOW  # smoothing leaves so many independent samples
            score = count * np.log(left) + np.count_nonzero(own) * np.log(count)
            if score < best:
                best, coefficients[i] = score, own
    kind, at = _named(library, coefficients, theta[cut], rate[cut], names)
    noise = np.array([next(s.uncertainty for s in system.sensors if s.name == name) for name in library.sensors])
    first = cut.stop
    ahead = x[first:-1, :n] + step * (theta @ coefficients.T)[first:-1]
    one = (ahead - measured[first + 1 :]) / noise
    free = (_simulated(library, coefficients, x[first], u[first:], step) - measured[first:]) / noise
    return Peer(_rms(one), _rms(free), kind, at, int(np.count_nonzero(coefficients)))


def _rms(error: np.ndarray) -> float:
    return float(np.sqrt(np.mean(error**2, axis=0)).max()) if np.isfinite(error).all() else float("inf")


def _named(
    library: Library, coefficients: np.ndarray, theta: np.ndarray, rate: np.ndarray, names: list[tuple[str, str, str]]
) -> tuple[str, str]:
    """Kind and place of the terms beyond the linear ones whose loss costs most of the fit of their equation."""
    best, found = 0.0, ("none", "")
    for i, name in enumerate(library.inertias):
        used = coefficients[i] != 0
        whole = _left(theta[:, used], rate[:, i])
        for group in {(kind, at) for (_, kind, at), own in zip(names, used, strict=True) if own and kind}:
            kept = used & np.array([(kind, at) != group for _, kind, at in names])
            lost = np.log(_left(theta[:, kept], rate[:, i]) / whole)
            if lost > best:
                best, found = lost, (group[0], group[1] or f"inertias.{name}")
    return found


def _left(columns: np.ndarray, target: np.ndarray) -> float:
    """Mean square of what least squares leaves."""
    scale = np.linalg.norm(columns, axis=0)
    scaled = columns / np.where(scale > 0, scale, 1)
    fitted = scaled @ np.linalg.lstsq(scaled, target, rcond=None)[0] if columns.shape[1] else 0.0
    return float(np.mean((target - fitted) ** 2))


def _simulated(library: Library, coefficients: np.ndarray, start: np.ndarray, u: np.ndarray, step: float) -> np.ndarray:
    """Speeds (t, n) in free simulation, Heun's method."""
    n, m = len(library.inertias), len(library.pairs)
    ends = np.array(list(library.pairs.values())).reshape(m, 2)

    def rates(x: np.ndarray, k: int) -> np.ndarray:
        theta = np.array([float(v[0]) for v in library.terms(x[None], u[k : k + 1]).values()])
        return np.concatenate([coefficients @ theta, x[ends[:, 0]] - x[ends[:, 1]], x[:n]])

    out, x = np.full((len(u), n), np.nan), start
    for k in range(len(u)):
        out[k] = x[:n]
        if k + 1 == len(u) or not np.all(np.abs(x[:n]) < 1e6):
            break
        a = rates(x, k)
        x = x + step / 2 * (a + rates(x + step * a, k + 1))
    return out
