"""When channels were recorded and with which sign and gain, from pairs of them: one drives the model where it was
measured, the other is compared.

A motion that is imposed as it was measured cuts the model there: nothing behind the sensor matters, neither its torques
nor its friction. What a neighbour reads then follows from the part between the two alone, and how late it is shows in
its phase (transmissibility; Devriendt and Guillaume, Mechanical Systems and Signal Processing 22, 2008). A pair counts
where the phase of that part hardly depends on its parameters, for the gain where its amplitude does not either. The
times and gains of all channels follow from those of the pairs.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy import fft

from matching.diagnosis.causes import LinearModel, acting_torques, inertia_shares, linear_model
from matching.diagnosis.descent import Fit
from matching.diagnosis.screening import without_effects
from modelling.system import System

# --- Which part of a pair's phase is known: the model with other stiffness and damping has to agree.

STIFFER, DAMPED, DRAGGED = 1.5, 3.0, 2.0  # times the values of the model: it may be a third off, dampings more
UNKNOWN_TORQUE = 0.3  # on every inertia, of what accelerates it and in phase with its speed: friction, loads, losses
KNOWN_PHASE, MOST_PHASE = (
    0.05,
    0.5,
)  # rad: no model is better, and beyond that, by model and noise, a line tells nothing
LONGEST_SHARE = 0.25  # of a segment: the largest difference of times that is looked for
BLOCKS, FEWEST_OF_BLOCK = 6, 128  # of all segments, whose scatter is the uncertainty; and samples of one
PERIODS = 6.0  # of the middle frequency in a block at least
SMOOTHED = 9  # lines of a spectrum over which its power is averaged
BY_INPUTS = 0.1  # share of what a channel is expected to be that may come from the inputs, whose time may be another
CLEAR = 0.5  # share of a channel that comes from the neighbour with the same phase, from which a time is told
SECOND_PEAK = 0.9  # of the first, from which a time is open: a periodic signal is alike a period later
APART = 5.0  # standard uncertainties between the times of low and high frequencies, from which it is no delay
LEAST = 0.02  # of a sample: uncertainty of a time at least
OF_TIME = 4  # other models by which a phase is known: unknown torques, stiffnesses, dampings, drags
CHUNK = 512  # frequencies at which responses are worked out at once
ABOVE_NOISE = 4.0  # times the power of its noise that a channel has up to the highest frequency that is looked at
ROUNDS = 3  # of the time within a block
LATE_SAMPLES, LATE_SIGMA = 1.0, 4.0  # from which channels have different times: samples, and standard uncertainties
KNOWN_GAIN = 0.01  # relative: no model is better; lines at which it is that good tell a gain
MOST_TURNED = 1.0  # rad, by which a wrong part may turn a channel: beyond, more is left of it than is explained
LEAST_GAIN = 1e-3  # relative standard uncertainty of a gain at least: no block tells it better
OTHER_GAIN = 0.02  # relative, from which channels have different gains, beside the standard uncertainties
SIGN = 1.2  # times the agreement with the other sign, from which a channel has the other one
RESISTANT, REWEIGHTED = 3.0, 20  # standard uncertainties from which a pair counts less, and rounds of that


@dataclass(frozen=True)
class PairTime:
    """How late one channel is against another, and how large.

    Attributes
    ----------
    first, second : int
        Sensors by index; −1 for the recorded inputs.
    delay, uncertainty : float
        s, of the second against the first.
    gain, gain_uncertainty : float
        Of the second over that of the first, negative where their signs differ; NaN where it depends on the model.
    sign : float
        −1 where the signs differ.
    lag : float
        Time constant of a first-order filter in the second that explains the phase better, s; 0 where none does.
    part_phase : float
        By how much a part between both that the model has wrong may turn the second, rad, and as a share change its
        size: the amplitude of what neither time nor gain explains of it, beyond noise, over what they explain.
    part_delay : float
        s, the delay of that phase.
    """

    first: int
    second: int
    delay: float
    uncertainty: float
    gain: float = np.nan
    gain_uncertainty: float = np.nan
    sign: float = 1.0
    lag: float = 0.0
    part_phase: float = 0.0
    part_delay: float = 0.0


@dataclass(frozen=True)
class Offsets:
    """By how much the channels differ in one respect, as far as it is told.

    Attributes
    ----------
    value : ndarray (1 + y,)
        Against the middle channel: of the recorded inputs, then of every sensor; NaN where it is open.
    uncertainty : ndarray (1 + y, 1 + y)
        Standard uncertainty of each difference.
    least : float
        Difference that matters.
    """

    value: np.ndarray
    uncertainty: np.ndarray
    least: float

    def apart(self, i: int, j: int) -> bool:
        """Whether two channels, by index in ``value``, differ beyond doubt."""
        least = max(self.least, LATE_SIGMA * self.uncertainty[i, j])
        return bool(abs(self.value[i] - self.value[j]) > least)

    def groups(self) -> list[list[int]]:
        """Sensors that do not differ, by index, the largest group first; with −1 for the inputs where these belong to
        one group alone."""
        known = sorted((np.flatnonzero(np.isfinite(self.value[1:])) + 1).tolist(), key=lambda j: self.value[j])
        parts: list[list[int]] = []
        for j in known:
            if parts and not any(self.apart(i, j) for i in parts[-1]):
                parts[-1].append(j)
            else:
                parts.append([j])
        if np.isfinite(self.value[0]):
            near = [part for part in parts if not any(self.apart(0, j) for j in part)]
            if not near:
                parts.append([0])
            elif len(near) == 1:
                near[0].insert(0, 0)
        return [sorted(j - 1 for j in part) for part in sorted(parts, key=lambda part: (-len(part), part))]

    def between(self, group: Sequence[int], than: Sequence[int]) -> tuple[float, float]:
        """By how much a group differs from another, and the standard uncertainty."""
        i, j = min(((a + 1, b + 1) for a in group for b in than), key=lambda pair: float(self.uncertainty[pair]))
        return float(self.value[i] - self.value[j]), float(self.uncertainty[i, j])

    def of_channel(self, j: int) -> tuple[float, float]:
        """By how much a sensor differs from the largest group, and the uncertainty; NaN where it is open."""
        others = [other for other in next(iter(self.groups()), []) if other != j]
        return self.between([j], others) if others and np.isfinite(self.value[j + 1]) else (np.nan, np.nan)


@dataclass(frozen=True)
class Times:
    """When the channels were recorded, and how large and with which sign, as far as it is told.

    Attributes
    ----------
    late : Offsets
        s.
    logarithm : Offsets
        Of the amount of the gain.
    sign : ndarray (1 + y,)
        −1 where it is another than that of most channels; NaN where it is open.
    pairs : list of PairTime
        What they follow from.
    stated_late, stated_logarithm : Offsets
        The same with uncertainties that hold where a part between two channels is wrong. What is said of channels goes
        by these; what is tried goes by the others.
    """

    late: Offsets
    logarithm: Offsets
    sign: np.ndarray
    pairs: list[PairTime]
    stated_late: Offsets
    stated_logarithm: Offsets

    def gain(self, j: int) -> tuple[float, float]:
        """Gain of a sensor over that of most channels, and the standard uncertainty; NaN where it is open."""
        return self._gain(j, self.logarithm)

    def stated_gain(self, j: int) -> tuple[float, float]:
        """The same with the uncertainty that holds where a part between two channels is wrong."""
        return self._gain(j, self.stated_logarithm)

    def _gain(self, j: int, logarithms: Offsets) -> tuple[float, float]:
        logarithm, uncertainty = logarithms.of_channel(j)
        gain = float(self.sign[j + 1] * np.exp(logarithm))
        return gain, abs(gain) * uncertainty


def channel_times(system: System, fit: Fit) -> Times:
    """How late, how large and with which sign the channels are against each other, from every pair that tells it."""
    pairs = list(_pairs(system, fit))
    count, step = len(system.sensors), fit.problem.data.sampling_interval
    filtered = {pair.second for pair in pairs if pair.lag}  # late as their filter is, at each frequency otherwise
    told = [pair for pair in pairs if not {pair.first, pair.second} & filtered]
    large = [pair for pair in told if np.isfinite(pair.gain)]

    def late(stated: bool) -> Offsets:
        told_by = [(p, float(np.hypot(p.uncertainty, p.part_delay if stated else 0.0))) for p in told]
        told_by = [(p, own) for p, own in told_by if p.part_phase < MOST_TURNED or not stated]
        return _from_pairs(
            count, [(p.first, p.second, p.delay, own) for p, own in told_by], LEAST * step, LATE_SAMPLES * step
        )

    def logarithm(stated: bool) -> Offsets:
        told_by = [
            (p, float(np.hypot(p.gain_uncertainty / abs(p.gain), p.part_phase if stated else 0.0)))
            for p in large
            if p.part_phase < MOST_TURNED or not stated
        ]
        parts = [(p.first, p.second, float(np.log(abs(p.gain))), own) for p, own in told_by]
        return _from_pairs(count, parts, LEAST_GAIN, OTHER_GAIN)

    return Times(late(False), logarithm(False), _signs(count, pairs), pairs, late(True), logarithm(True))


def _from_pairs(count: int, pairs: Sequence[tuple[int, int, float, float]], floor: float, least: float) -> Offsets:
    """What channels differ by, from what pairs (first, second, difference, uncertainty) do; ``floor`` is the standard
    uncertainty of the channel that the others are told against."""
    members = _largest_group(count, pairs)
    kept = [pair for pair in pairs if pair[0] in members]
    out, apart = np.full(count + 1, np.nan), np.full((count + 1, count + 1), np.nan)
    if not kept:
        return Offsets(out, apart, least)
    nodes = sorted(members)
    rows = np.zeros((len(kept) + 1, len(nodes)))
    for row, (first, second, _, _) in zip(rows, kept, strict=False):
        row[nodes.index(second)], row[nodes.index(first)] = 1.0, -1.0
    rows[-1, 0] = 1.0
    differences = np.array([*(difference for _, _, difference, _ in kept), 0.0])
    sigma = np.array([*(uncertainty for *_, uncertainty in kept), floor])
    weight = np.ones(len(rows))
    for _ in range(REWEIGHTED):  # least squares that few wrong pairs do not move (Huber)
        scale = np.sqrt(weight) / sigma
        values = np.linalg.lstsq(rows * scale[:, None], differences * scale, rcond=None)[0]
        weight = 1 / np.maximum(np.abs(rows @ values - differences) / sigma / RESISTANT, 1.0)
    scale = np.sqrt(weight) / sigma
    misfit = (rows @ values - differences) * scale
    inflation = max(1.0, float(misfit @ misfit) / max(len(rows) - len(nodes), 1))
    covariance = inflation * np.linalg.inv((rows * scale[:, None]).T @ (rows * scale[:, None]))
    variance = np.diag(covariance)[:, None] + np.diag(covariance) - 2 * covariance
    index = np.array(nodes) + 1
    out[index] = values - np.median(values)
    apart[np.ix_(index, index)] = np.sqrt(np.maximum(variance, 0.0))
    return Offsets(out, apart, least)


def _signs(count: int, pairs: Sequence[PairTime]) -> np.ndarray:
    """Signs (1 + y,) of the channels, that of most is 1: the leading eigenvector of what the pairs say of each two."""
    said = np.zeros((count + 1, count + 1))
    for pair in pairs:
        said[pair.first + 1, pair.second + 1] += pair.sign
        said[pair.second + 1, pair.first + 1] += pair.sign
    members = np.array(sorted(_largest_group(count, [(pair.first, pair.second) for pair in pairs]))) + 1
    out = np.full(count + 1, np.nan)
    if len(members) > 1:
        leading = np.linalg.eigh(said[np.ix_(members, members)] + count * np.eye(len(members)))[1][:, -1]
        signs = np.where(leading < 0, -1.0, 1.0)
        most = signs.sum() or signs[0]  # of two that differ, the first one is taken as right
        out[members] = signs * np.sign(most)
    return out


def _largest_group(count: int, pairs: Sequence[tuple]) -> set[int]:
    """Channels that pairs (first, second, …) join, as many as possible."""
    groups = [{j} for j in range(-1, count)]
    for first, second, *_ in pairs:
        joined = set().union(*(group for group in groups if first in group or second in group))
        groups = [group for group in groups if not group & joined] + [joined]
    return max(groups, key=len)


# --- Pairs

Response = tuple[np.ndarray, np.ndarray]  # (f, y) readings by the driving channel, (f, y, u) by the recorded inputs


def _pairs(system: System, fit: Fit) -> Iterator[PairTime]:
    """Every pair of channels whose difference of times is told."""
    plain = without_effects(system)
    # as stated: a fit takes what it can of a wrong time
    value = {name: float(quantity.value) for name, quantity in plain.parameters.items()}
    models = [linear_model(plain, changed) for changed in _variants(plain, value)]
    segments = [
        _even(segment.time, acting, segment.readings)
        for segment, acting in zip(fit.problem.data.segments, _acting(system, fit), strict=True)
    ]
    torques = [j for j, part in enumerate(system.inputs) if part.name not in system.imposed_by]
    on = [[part.name for part in system.inertias].index(system.inputs[j].on) for j in torques]
    segments = [(u[:, torques], y) for u, y in segments if len(y) >= FEWEST_OF_BLOCK]
    step = fit.problem.data.sampling_interval
    highest = max((_highest(y, step, fit.problem.data.noise) for _, y in segments), default=0.0)
    for source in range(-1, len(system.sensors)):
        of_source = _Source(plain, source, on, value, models, highest)
        if not of_source.possible or not segments:
            continue
        for target in range(len(system.sensors)):
            if target != source:
                pair = _pair(of_source, target, segments, step, fit.problem.data.noise)
                if pair is not None:
                    yield pair


def _acting(system: System, fit: Fit) -> list[np.ndarray]:
    """Inputs (t, u) of every segment, the torque of each pedal in its place as the fit has it."""
    segments = fit.problem.data.segments
    if not system.pedals:
        return [segment.inputs for segment in segments]
    model = fit.problem.model
    values = dict(zip(model.parameters, (float(value) for value in fit.problem.unpack(fit.v)[0]), strict=True))
    shares = inertia_shares(system, model.coordinates, values)
    speeds = (x[:, model.n : 2 * model.n] @ shares.T for x in fit.problem.states(fit.v))
    return [acting_torques(system, each, part.inputs) for each, part in zip(speeds, segments, strict=True)]


def _variants(system: System, value: dict[str, float]) -> list[dict[str, float]]:
    """Quantities as they are, with other stiffnesses, other dampings, and other drags; last with other inertias, where
    these are uncertain, which change amplitudes."""
    ends = (("", 1.0), (".stiffness", STIFFER), (".damping", DAMPED), (".drag", DRAGGED))
    out = [{n: factor * v if end and n.endswith(end) else v for n, v in value.items()} for end, factor in ends]
    heavier = {
        n: STIFFER * value[n] if q.upper is None else min(STIFFER * value[n], q.upper)
        for n, q in system.parameters.items()
        if n.endswith(".J") and q.uncertain
    }
    return [*out, value | heavier] if heavier else out


def _even(time: np.ndarray, inputs: np.ndarray, readings: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Inputs and readings at even steps; what was not measured is bridged, a channel without readings is 0."""
    even = np.linspace(time[0], time[-1], len(time))

    def at(values: np.ndarray) -> np.ndarray:
        known = np.isfinite(values)
        return np.interp(even, time[known], values[known]) if known.any() else np.zeros(len(even))

    return tuple(np.stack([at(column) for column in part.T], axis=1) if part.shape[1] else part
                 for part in (inputs, readings))  # type: ignore[return-value] # fmt: skip


def _highest(readings: np.ndarray, step: float, noise: np.ndarray) -> float:
    """The highest angular frequency at which a channel is more than noise."""
    window = np.hanning(len(readings))
    power = np.abs(fft.rfft((readings - readings.mean(axis=0)) * window[:, None], axis=0)) ** 2
    above = [
        np.flatnonzero(_smoothed(p) > ABOVE_NOISE * n**2 * (window @ window))
        for p, n in zip(power.T, noise, strict=True)
    ]
    return 2 * np.pi * max((int(lines[-1]) for lines in above if len(lines)), default=0) / (len(readings) * step)


class _Source:
    """The linear model driven by one channel: responses of all sensors at angular frequencies (f,)."""

    def __init__(
        self, system: System, source: int, on: Sequence[int], value: dict[str, float], models: Sequence[LinearModel],
        highest: float,
    ):  # fmt: skip
        self.system, self.source, self.on, self.highest = system, source, list(on), highest
        self._kept: dict[int, tuple[np.ndarray, list[Response]]] = {}
        self.models, self.shares = list(models), inertia_shares(system, models[0].model.coordinates, value)
        self.possible, names = True, [part.name for part in system.inertias]
        self.J = np.array([value[f"inertias.{name}.J"] for name in names])
        self.inertia = self.shaft = -1
        if source >= 0:
            sensor = system.sensors[source]
            if sensor.measures == "torque":
                shafts = [shaft.name for shaft in system.shafts]
                self.possible = sensor.of in shafts
                if self.possible:
                    self.shaft = shafts.index(sensor.of)
                    cut = {f"shafts.{sensor.of}.{key}": 0.0 for key in ("stiffness", "damping")}
                    self.models = [linear_model(system, changed | cut) for changed in _variants(system, value)]
            else:
                self.inertia = names.index(sensor.of)
        elif not on:
            self.possible = False

    def responses(self, count: int, step: float) -> tuple[np.ndarray, list[Response]]:
        """Angular frequencies (f,) of so many samples, and the responses there: of the model, with unknown torques, and
        of those with other quantities."""
        if count not in self._kept:
            omega = 2 * np.pi * fft.rfftfreq(count, step)[2:]
            omega = omega[omega <= self.highest]
            first, *others = [self._response(linear, omega) for linear in self.models]
            self._kept[count] = omega, [first, self._response(self.models[0], omega, UNKNOWN_TORQUE), *others]
        return self._kept[count]

    def _response(self, linear: LinearModel, omega: np.ndarray, unknown: float = 0.0) -> Response:
        n, inertias = linear.model.n, len(self.system.inertias)
        A, B, C, D = linear.A, linear.B[:, self.on], linear.C, linear.D[:, self.on]
        drive, direct = np.zeros(len(A)), np.zeros(len(C))
        raised = np.ones(len(omega), dtype=complex)  # the driving quantity from the channel
        if self.shaft >= 0:
            drive, direct = linear.B[:, inertias + self.shaft], linear.D[:, inertias + self.shaft]
        elif self.inertia >= 0:
            # the torque that gives the inertia the acceleration it was measured to have
            torque, of_torque = linear.B[:, self.inertia], linear.D[:, self.inertia]
            row = np.concatenate([np.zeros(n), self.shares[self.inertia], np.zeros(len(A) - 2 * n)])
            effect = float(row @ torque)
            along = row @ A / effect
            known = row @ B / effect
            A, C = A - np.outer(torque, along), C - np.outer(of_torque, along)
            B, D = B - np.outer(torque, known), D - np.outer(of_torque, known)
            drive, direct = torque / effect, of_torque / effect
            raised = {"angle": (1j * omega) ** 2, "speed": 1j * omega}.get(
                self.system.sensors[self.source].measures, raised
            )
        both = np.column_stack([drive[:, None], B])
        resisting = np.zeros_like(A)  # over the frequency
        if unknown:
            speeds = np.hstack([np.zeros((inertias, n)), self.shares, np.zeros((inertias, len(A) - 2 * n))])
            resisting = linear.B[:, :inertias] @ (unknown * self.J[:, None] * speeds)
            if self.inertia >= 0:
                resisting = resisting - np.outer(drive, row @ resisting)
        slope, states = 1j * np.eye(len(A)) + resisting, []
        for part in np.split(omega, range(CHUNK, len(omega), CHUNK)):
            lhs = part[:, None, None] * slope - A
            states.append(np.linalg.solve(lhs, np.broadcast_to(both, (len(part), *both.shape))))
        readings = C @ np.concatenate(states) + np.column_stack([direct[:, None], D])
        return readings[:, :, 0] * raised[:, None], readings[:, :, 1:]


@dataclass(frozen=True)
class _Compared:
    """Spectra of a channel as measured and as its neighbour has it, and the weight of every line, for the time and for
    the gain."""

    count: int
    omega: np.ndarray
    measured: np.ndarray
    expected: np.ndarray
    weight: np.ndarray
    shifts: list[np.ndarray]  # phases of models with other quantities, rad
    weight_of_gain: np.ndarray
    of_noise: np.ndarray  # of the power that is expected
    others: list[np.ndarray]  # amplitudes of models with other quantities, over that of the model
    noise: np.ndarray  # power of the noise of both channels in what is measured less what is expected


def _pair(
    source: _Source, target: int, segments: Sequence[tuple[np.ndarray, np.ndarray]], step: float, noise: np.ndarray
) -> PairTime | None:
    """How late a channel is against the one that drives the model; None where that is not told."""
    whole = [one for u, y in segments if (one := _compared(source, target, u, y, y, step, noise)) is not None]
    found = _coarse(whole, step)
    if found is None:
        return None
    coarse, sign = found
    periods = 2 * np.pi * PERIODS / (_middle(whole) * step)
    size = int(min(max(sum(len(y) for _, y in segments) / BLOCKS, FEWEST_OF_BLOCK, periods),
                   max(len(y) for _, y in segments) / 2))  # fmt: skip
    whole = [replace(part, measured=sign * part.measured) for part in whole]
    blocks = []
    shift = round(coarse / step)
    coarse = shift * step
    for u, y in segments:
        for first in range(max(-shift, 0), len(y) - max(shift, 0) - size + 1, size):
            part = slice(first, first + size)
            compared = _compared(
                source, target, u[part], y[part], y[part.start + shift : part.stop + shift], step, noise
            )
            if compared is not None:
                blocks.append(replace(compared, measured=sign * compared.measured))
    if len(blocks) < 2:
        return None
    middle = _middle(blocks)
    every, low, high = (
        np.array([_fine(block, band) for block in blocks]) for band in ((0.0, np.inf), (0.0, middle), (middle, np.inf))
    )
    known = np.isfinite(every) & np.isfinite(low) & np.isfinite(high)
    if known.sum() < max(2, len(every) / 2):
        return None
    every, low, high = every[known], low[known], high[known]
    own, below, above = (_scatter(values, step) for values in (every, low, high))
    by_model = _by_model(blocks)
    delay, uncertainty = coarse + float(np.median(every)), float(np.hypot(own, by_model))
    lag = 0.0
    apart = abs(float(np.median(low) - np.median(high)))
    if apart > APART * np.hypot(np.hypot(below, above), by_model):
        lag = _lag(blocks, coarse)
        if not lag:
            uncertainty = float(np.hypot(uncertainty, apart))
    gain, gain_uncertainty = _gain(whole, delay)
    phase, part_delay = _by_wrong_part(whole, delay)
    return PairTime(
        source.source, target, delay, uncertainty, sign * gain, gain_uncertainty, sign, lag, phase, part_delay
    )


def _scatter(values: np.ndarray, step: float) -> float:
    """Standard uncertainty of the median of times."""
    return max(_spread(values), LEAST * step)


def _spread(values: np.ndarray) -> float:
    """Standard uncertainty of a median."""
    return 1.25 * 1.4826 * float(np.median(np.abs(values - np.median(values)))) / float(np.sqrt(len(values)))


def _compared(
    source: _Source, target: int, inputs: np.ndarray, readings: np.ndarray, later: np.ndarray, step: float,
    noise: np.ndarray,
) -> _Compared | None:  # fmt: skip
    """Spectra of a part of a segment; the target is taken from ``later`` readings."""
    count = len(readings)
    window = np.hanning(count)
    omega, models = source.responses(count, step)
    if not len(omega):  # every channel is slower than a part is long, as where a shaft stands after a step
        return None

    def spectrum(values: np.ndarray) -> np.ndarray:
        trend = np.polynomial.Polynomial.fit(np.arange(count), values, 1)(np.arange(count))
        return fft.rfft((values - trend) * window)[2 : 2 + len(omega)]

    measured = spectrum(later[:, target])
    driven = spectrum(readings[:, source.source]) if source.source >= 0 else np.zeros(len(omega))
    known = (
        np.stack([spectrum(column) for column in inputs.T], axis=1) if inputs.shape[1] else np.zeros((len(omega), 0))
    )
    if not np.abs(driven).any() and source.source >= 0:
        return None
    by_inputs = [(response[:, target] * known).sum(axis=1) for _, response in models]
    every = [response[:, target] * driven + other for (response, _), other in zip(models, by_inputs, strict=True)]
    expected = every[0]
    power = _smoothed(np.abs(expected) ** 2)
    if not power.all():
        return None
    shifts = [np.angle(other * np.conj(expected)) for other in every[1 : 1 + OF_TIME]]
    others = [np.sqrt(_smoothed(np.abs(other) ** 2) / power) for other in every[1:]]
    gain = np.abs(models[0][0][:, target]) ** 2 * (noise[source.source] ** 2 if source.source >= 0 else 0.0)
    of_noise = (noise[target] ** 2 + gain) * float(window @ window) / power
    unknown = of_noise + _smoothed(np.max(np.square(shifts), axis=0))
    weight = np.where(unknown < MOST_PHASE**2, 1 / (KNOWN_PHASE**2 + unknown) / power, 0.0)
    of_model = np.max([np.square(other - 1) for other in others], axis=0)
    of_gain = np.where(of_model < MOST_PHASE**2, weight * power, 0.0) * (KNOWN_PHASE**2 + unknown)
    of_gain /= (KNOWN_GAIN**2 + unknown + of_model) * power
    told = omega**2 * weight
    if source.source >= 0 and np.sum(told * np.abs(by_inputs[0]) ** 2) > BY_INPUTS * np.sum(told * power):
        return None
    taken = gain * float(window @ window)
    if not weight.any():
        return None
    both = of_noise * power
    return _Compared(count, omega, measured, expected, weight, shifts, of_gain, taken, others, both)


def _smoothed(power: np.ndarray) -> np.ndarray:
    return np.convolve(np.pad(power, SMOOTHED // 2, mode="edge"), np.full(SMOOTHED, 1 / SMOOTHED), mode="valid")


def _coarse(parts: Sequence[_Compared], step: float) -> tuple[float, float] | None:
    """The delay (s) at which phases agree best in whole segments, and the sign; None where that is open or nothing
    agrees."""
    if not parts:
        return None
    length = fft.next_fast_len(4 * max(part.count for part in parts))
    total, norm, longest = np.zeros(length), 0.0, np.inf
    for part in parts:
        longest = min(longest, LONGEST_SHARE * part.count * step)
        cross = part.weight * part.measured * np.conj(part.expected)
        grid = 2 * np.pi * fft.rfftfreq(length, step / 4)
        padded = np.interp(grid, part.omega, cross.real, 0.0, 0.0) + 1j * np.interp(
            grid, part.omega, cross.imag, 0.0, 0.0
        )
        scale = np.sum(np.abs(np.interp(grid, part.omega, np.abs(cross), 0.0, 0.0)))
        if not scale:
            continue
        total += fft.irfft(padded, length) * length / (2 * scale) * np.sum(np.abs(cross))
        norm += float(np.sum(part.weight * np.abs(part.measured) * np.abs(part.expected)))
    if not norm:
        return None
    agreement = total / norm
    lags = np.arange(length, dtype=float)
    lags[lags > length // 2] -= length
    lags *= step / 4
    order = np.argsort(lags)
    order = order[np.abs(lags[order]) <= longest]
    lags, agreement = lags[order], agreement[order]
    sign = -1.0 if -agreement.min() > SIGN * agreement.max() else 1.0
    agreement = sign * agreement
    best = int(np.argmax(agreement))
    if agreement[best] < CLEAR or best in (0, len(lags) - 1):
        return None
    below = np.flatnonzero(agreement < SECOND_PEAK * agreement[best])
    first, last = below[below < best].max(initial=-1), below[below > best].min(initial=len(lags))
    if np.delete(agreement, slice(first + 1, last)).max(initial=0.0) > SECOND_PEAK * agreement[best]:
        return None
    return float(lags[best]), sign


def _middle(blocks: Sequence[_Compared]) -> float:
    """The angular frequency below and above which lines tell as much of a time."""
    omega = np.concatenate([block.omega for block in blocks])
    told = np.concatenate([block.omega**2 * block.weight * np.abs(block.expected) ** 2 for block in blocks])
    order = np.argsort(omega)
    total = np.cumsum(told[order])
    return float(omega[order][np.searchsorted(total, total[-1] / 2)])


def _fine(block: _Compared, band: tuple[float, float]) -> float:
    """How late the measured channel of a block is, s, from the phases of a band."""
    inside = (block.omega >= band[0]) & (block.omega <= band[1])
    omega, cross = block.omega[inside], (block.weight * block.measured * np.conj(block.expected))[inside]
    delay = 0.0
    for _ in range(ROUNDS):
        turned = cross * np.exp(1j * omega * delay)
        curvature = float(np.sum(omega**2 * turned.real))
        if not curvature > 0:
            return np.nan
        delay -= float(np.sum(omega * turned.imag)) / curvature
    return delay


def _by_model(blocks: Sequence[_Compared]) -> float:
    """By how much the time depends on the quantities of the model, s."""
    moved = []
    for number in range(len(blocks[0].shifts)):
        along = norm = 0.0
        for block in blocks:
            told = block.weight * np.abs(block.expected) ** 2
            along += float(np.sum(told * block.omega * block.shifts[number]))
            norm += float(np.sum(told * block.omega**2))
        moved.append(abs(along) / norm if norm else 0.0)
    return max(moved, default=0.0)


def _by_wrong_part(parts: Sequence[_Compared], delay: float) -> tuple[float, float]:
    """By how much a part between both channels that the model has wrong may turn the measured one, rad, and delay it.

    What it changes is partly in phase, where it looks like a gain, or a quarter of a period off, where it looks like a
    time. Neither explains the rest, which is taken to be as large.
    """
    along = of_expected = of_measured = noise = turning = 0.0
    for part in parts:
        expected = part.expected * np.exp(-1j * part.omega * delay)
        along += float(np.sum(part.weight * (part.measured * np.conj(expected)).real))
        powers = [part.weight * np.abs(values) ** 2 for values in (expected, part.measured)]
        of_expected, of_measured = of_expected + float(powers[0].sum()), of_measured + float(powers[1].sum())
        noise += float(np.sum(part.weight * part.noise))
        turning += float(np.sum(powers[0] * part.omega**2))
    explained = max(along**2 / of_expected, 1e-12 * of_measured)
    phase = float(np.sqrt(max(of_measured - explained - noise, 0.0) / explained))
    return phase, float(np.arctan(phase)) / float(np.sqrt(turning / of_expected))


def _gain(parts: Sequence[_Compared], delay: float) -> tuple[float, float]:
    """The measured amplitude of whole segments over that expected, in phase, and its standard uncertainty: by the
    scatter of bands of frequency that tell as much each, and by other quantities of the model; NaN where it is open.

    The expected power is taken without what the noise of the driving channel adds.
    """
    weight = np.concatenate([part.weight_of_gain for part in parts])
    measured, expected, omega, of_noise = (
        np.concatenate([getattr(part, name) for part in parts])
        for name in ("measured", "expected", "omega", "of_noise")
    )
    expected = expected * np.exp(-1j * omega * delay)
    along = weight * (measured * np.conj(expected)).real
    power = weight * (np.abs(expected) ** 2 - of_noise)
    order = np.argsort(omega)
    total = np.cumsum(power[order])
    if not total[-1] > 0:
        return np.nan, np.nan
    ends = np.searchsorted(total, total[-1] * np.arange(1, BLOCKS) / BLOCKS)
    bands = [band for band in np.split(order, ends) if power[band].sum() > 0]
    gains = np.array([along[band].sum() / power[band].sum() for band in bands])
    gain = float(np.median(gains))
    if len(bands) < BLOCKS / 2 or gain <= 0:
        return np.nan, np.nan
    told, moved = weight * np.abs(expected) ** 2, []
    for number in range(len(parts[0].others)):
        other = np.concatenate([part.others[number] for part in parts])
        moved.append(float(np.sqrt(np.sum(told * (other - 1) ** 2) / told.sum())))
    return gain, float(np.hypot(max(_spread(gains), LEAST_GAIN * gain), gain * max(moved)))


TRIED = np.geomspace(0.05, 20.0, 60)  # time constants that are tried, times the inverse of the middle frequency
BETTER = 0.5  # of the misfit of the phase that a delay leaves, up to which a filter explains it


def _lag(blocks: Sequence[_Compared], coarse: float) -> float:
    """Time constant (s) of a first-order filter that explains phase and gain clearly better than a delay; else 0."""
    middle = _middle(blocks)

    def left(response: np.ndarray | None, constant: float) -> float:
        total = 0.0
        for block in blocks:
            measured = block.measured * np.exp(-1j * block.omega * coarse)
            shape = np.exp(-1j * block.omega * constant) if response is None else 1 / (1 + 1j * block.omega * constant)
            expected = block.expected * shape
            along = np.sum(block.weight * (measured * np.conj(expected)).real)
            square = np.sum(block.weight * np.abs(expected) ** 2)
            total += float(np.sum(block.weight * np.abs(measured) ** 2) - along**2 / square)
        return total

    delays = [left(None, constant / middle) for constant in (0.0, *TRIED)]
    lags = [left(np.ones(1), constant / middle) for constant in TRIED]
    best = int(np.argmin(lags))
    return float(TRIED[best] / middle) if lags[best] < BETTER * min(delays) else 0.0
