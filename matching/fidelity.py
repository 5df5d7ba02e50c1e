"""XiL fidelity of a test bed from a case file, with its uncertainty, its spectrum and the attribution of its loss."""

from __future__ import annotations

import itertools
import math
from collections.abc import Collection, Mapping
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import scipy

from matching.uncertainty.budget import read_budget, read_coverage_factor
from matching.uncertainty.evaluate import evaluate
from modelling.display import Displayed
from modelling.errors import InputError, listed
from modelling.escape import single_line
from modelling.fidelity.delay import Delay
from modelling.fidelity.measures import (
    ARITHMETICS,
    DYNAMIC_DOMAINS,
    MEASUREMENT_DOMAIN,
    NRMSE_FORMS,
    PUBLISHED_DIVISOR,
    STEP_DEVIATION,
    DrawnValue,
    Fidelity,
    FidelityMethod,
    SensorUncertainty,
    SignalFidelity,
    SignalPair,
    assemble,
    assess_signal,
    check_time,
    delay_fidelity,
    fidelity_distribution,
    noise_of,
    nrmse_fidelity_of,
    signal_range,
)
from modelling.recordings.read import Channel, read_channels, read_signals
from modelling.recordings.readers import read_table
from modelling.recordings.recording import GAP_STEPS, Recording
from modelling.toml import check_file, check_keys, no_pipe, number, one_of, read_toml, text, title
from modelling.units import Unit, signal_quantity, signal_unit, to_si

# --- Which causes reduce the fidelity, ranked: dynamics, model, measurement; by signal its ordinate, delay and noise.
#
# R_XiL² is a sum, so 1 − R_XiL² splits without remainder: over the domains by their weights, within a dynamic domain
# over each signal's 1 − R_NRMSE² and 1 − R_τ², within the measurement domain in proportion to (U/range)². The part of a
# signal's ordinate loss that noise alone explains is attributed to measurement: better dynamics would not regain it.

ORIGINS = {
    "system_dynamics": "dynamics",
    "residual_vehicle_model": "model",
    MEASUREMENT_DOMAIN: "measurement",
}  # by domain


@dataclass(frozen=True)
class Loss:
    """One cause.

    Attributes
    ----------
    origin, signal, cause : str
        E.g. ``"dynamics"``, the signal's name, ``"delay"``.
    loss : float
        Its part of 1 − R_XiL².
    gain : float
        How much R_XiL would rise if this cause alone were removed.
    """

    origin: str
    signal: str
    cause: str
    loss: float
    gain: float


@dataclass(frozen=True)
class Attribution:
    """Losses, largest gain first; their sum is 1 − R_XiL² as long as no part is cut at 0 or 1."""

    losses: tuple[Loss, ...]

    @property
    def by_origin(self) -> dict[str, float]:
        """Part of the whole loss by origin, largest first; sums to one, unless nothing is lost."""
        total = math.fsum(loss.loss for loss in self.losses)
        parts = {
            origin: math.fsum(loss.loss for loss in self.losses if loss.origin == origin) / total if total > 0 else 0.0
            for origin in ORIGINS.values()
        }
        return dict(sorted(parts.items(), key=lambda item: -item[1]))

    def to_dict(self) -> dict[str, Any]:
        """As ``fidelity.json`` holds it."""
        return {"by_origin": self.by_origin, "ranked": [asdict(loss) for loss in self.losses]}


def attribute(fidelity: Fidelity) -> Attribution:
    """Attribute 1 − R_XiL² to its causes."""
    if fidelity.method.arithmetic != "definition":
        raise ValueError("attribution needs the arithmetic of the definition")
    losses: list[Loss] = []

    def add(origin: str, signal: str, cause: str, loss: float) -> None:
        if loss > 0:
            gain = math.sqrt(min(1.0, fidelity.total**2 + loss)) - fidelity.total
            losses.append(Loss(origin, signal, cause, loss, gain))

    for domain, members in fidelity.signals.items():
        weight, origin = fidelity.weights[domain] / (2 * len(members)), ORIGINS[domain]
        for signal in members:
            noise = _loss_by_noise(signal, fidelity)
            add(origin, signal.name, "ordinate", weight * (1 - signal.nrmse**2 - noise))
            add("measurement", signal.name, "noise", weight * noise)
            add(origin, signal.name, "delay", weight * (1 - signal.delay_fidelity**2))
    if fidelity.sensors:
        lost = fidelity.weights[MEASUREMENT_DOMAIN] * (1 - fidelity.domains[MEASUREMENT_DOMAIN] ** 2)
        squares = math.fsum(sensor.ratio**2 for sensor in fidelity.sensors)
        for sensor in fidelity.sensors:
            add("measurement", sensor.name, "uncertainty", lost * sensor.ratio**2 / squares if squares > 0 else 0.0)
    return Attribution(tuple(sorted(losses, key=lambda loss: -loss.gain)))


def _loss_by_noise(signal: SignalFidelity, fidelity: Fidelity) -> float:
    """How much R_NRMSE² would rise without the noise of the samples."""
    if signal.pair is None or fidelity.step is None:
        return 0.0
    reference, test = noise_of(signal.pair, fidelity.step, fidelity.f_max)
    noiseless = max(0.0, signal.mean_square - reference**2 - test**2)
    return nrmse_fidelity_of(noiseless, signal.width, fidelity.method.nrmse_form) ** 2 - signal.nrmse**2


# --- The two recordings of a fidelity case, reference and test, of the same manoeuvre.

RECORDING_KEYS = ("reference", "test", "reference_channels", "test_channels")
STEP_DIFFERENCE = 1e-4  # of the step: between reference and test; over 10 000 samples it adds up to one
NO_UNIT = Unit("SI", 1.0, 0.0, None)  # of a column without unit: SI, of whatever dimension


@dataclass(frozen=True)
class MeasuredPair:
    """A signal (t,) of reference and test in SI, and the reference's unit."""

    reference: np.ndarray
    test: np.ndarray
    unit: Unit


@dataclass(frozen=True)
class RecordingPair:
    """Reference and test at the same step (s); both begin at the same event of the manoeuvre."""

    reference: Recording
    test: Recording
    step: float

    @property
    def notes(self) -> tuple[str, ...]:
        """What was corrected in both, with the file's name."""
        return tuple(
            f"{Path(recording.source).name}: {note}"
            for recording in (self.reference, self.test)
            for note in recording.notes
        )

    def signal(self, reference: str, test: str, where: str) -> MeasuredPair:
        """The signals of two columns."""
        units = []
        for name, recording in ((reference, self.reference), (test, self.test)):
            if name not in recording.channels:
                raise unknown_column(recording, name, where)
            unit = recording.units[name]
            units.append(signal_unit(unit, f"{recording.source}: column {name!r}") if unit else NO_UNIT)
        dimensions = [unit.dimension for unit in units]
        if None not in dimensions and dimensions[0] != dimensions[1]:
            raise InputError(
                where, f"reference is in {units[0].text}, test in {units[1].text}", "give both the same dimension"
            )
        return MeasuredPair(self.reference[reference], self.test[test], units[0])


def unknown_column(recording: Recording, name: str, where: str) -> InputError:
    """The error for a column that a recording lacks: with the columns that its file has."""
    columns = [*recording.channels] or read_table(Path(recording.source)).names[1:]
    return InputError(where, f"{recording.source} has no column {name!r}", f"it has {listed(columns)}")


def read_recordings(
    table: Any, path: Path, names: Collection[str], channels: Mapping[str, Channel] | None = None
) -> RecordingPair:
    """The two recordings that a case names, relative to the case file.

    Parameters
    ----------
    table : table ``[recordings]`` of the case
    path : Path
        The case file.
    names : collection of str
        Columns that the case compares.
    channels : mapping of str to Channel, optional
        What channels are called in both files; channel files that the case names for either are preferred.
    """
    where = f"{path}: recordings"
    check_keys(table, RECORDING_KEYS, where)
    recordings = []
    for role in ("reference", "test"):
        key = f"{role}_channels"
        mapping = read_channels(no_pipe(path.parent / text(table, key, where), where)) if key in table else channels
        file = no_pipe(path.parent / text(table, role, where), where)
        recordings.append(evenly_spaced(read_signals(file, names, mapping)))
    reference, test = recordings
    steps = [check_time(recording.time, f"{recording.source}: time") for recording in recordings]
    if len(reference.time) != len(test.time):
        raise InputError(
            where,
            f"reference has {len(reference.time)} samples, test {len(test.time)}",
            "cut or resample both to the same length",
        )
    if abs(steps[0] - steps[1]) > STEP_DIFFERENCE * steps[0]:
        raise InputError(where, f"reference has a step of {steps[0]:g} s, test of {steps[1]:g} s", "resample one")
    return RecordingPair(reference, test, steps[0])


def evenly_spaced(recording: Recording) -> Recording:
    """A recording whose time stamps jitter, on as many equal steps through them (least squares); others as they are."""
    time = recording.time
    steps = np.diff(time)
    step = (time[-1] - time[0]) / (len(time) - 1)
    jitter, gap = np.abs(steps - step).max(), steps.max() >= GAP_STEPS * np.median(steps)
    if jitter <= STEP_DEVIATION * step or gap:
        return recording
    number = np.arange(len(time))
    even = np.polyval(np.polyfit(number, time, 1), number)
    channels = {name: np.interp(even, time, values) for name, values in recording.channels.items()}
    note = "time stamps are uneven: brought to equal steps, linear between samples"
    return replace(recording, time=even, channels=channels, notes=(*recording.notes, note))


# --- Fidelity cases (TOML): partial fidelities as stated values, or calculated from recordings of road and test bed.

KEYS = (
    "title", "f_max", "arithmetic", "nrmse", "longest_delay", "recordings", "weights", *DYNAMIC_DOMAINS,
    MEASUREMENT_DOMAIN,
)  # fmt: skip
LONGEST_DELAY = 1000.0  # s, of a stated one
STATED_KEYS = ("nrmse_fidelity", "nrmse_uncertainty", "delay", "delay_uncertainty")
MEASURED_KEYS = ("reference", "test", "reference_noise", "test_noise")
SENSOR_KEYS = (
    "fidelity", "expanded_uncertainty", "range", "signal", "budget", "measurand", "coverage_factor",
    "degrees_of_freedom",
)  # fmt: skip
LARGEST_F_MAX = 1e6  # Hz
F_MAX = 30.0  # Hz: the largest relevant frequency of drivability, as in the paper


@dataclass(frozen=True)
class _StatedUncertainty:
    """U in SI with its dimension (None: a number without unit), k and degrees of freedom."""

    expanded: float
    dimension: Any
    coverage_factor: float
    degrees_of_freedom: float


@dataclass(frozen=True)
class _Context:
    """What the tables of signals need besides themselves."""

    method: FidelityMethod
    recordings: RecordingPair | None
    uncertainties: Mapping[str, _StatedUncertainty]  # by signal


def read_case(
    path: Path | str,
    arithmetic: str | None = None,
    nrmse: str | None = None,
    channels: Mapping[str, Channel] | None = None,
) -> tuple[str, Fidelity]:
    """Title and fidelity of a case file.

    Parameters
    ----------
    arithmetic, nrmse : str, optional
        Instead of what the file says; see :mod:`modelling.fidelity.measures`.
    channels : mapping of str to Channel, optional
        What the recordings call the signals (:func:`modelling.recordings.read.read_channels`).
    """
    path = Path(path)
    return fidelity_from_tables(read_toml(path), path, arithmetic, nrmse, channels)


def fidelity_from_tables(
    tables: dict[str, Any],
    path: Path,
    arithmetic: str | None = None,
    nrmse: str | None = None,
    channels: Mapping[str, Channel] | None = None,
) -> tuple[str, Fidelity]:
    """As :func:`read_case` for tables as ``tomllib`` reads them; other files are looked for beside ``path``."""
    where = str(path)
    check_file(tables, KEYS, where, "fidelity case")
    method = _method(tables, where, arithmetic, nrmse)
    recordings = None
    if "recordings" in tables:
        recordings = read_recordings(tables["recordings"], path, _compared_columns(tables), channels)
    elif channels:
        raise InputError(where, "has no recordings whose channels could be named", "leave out --channels")
    sensor_tables = _subtables(tables, MEASUREMENT_DOMAIN, where)
    uncertainties = {
        table["signal"]: _uncertainty(table, f"{where}: {MEASUREMENT_DOMAIN}.{name}", path)
        for name, table in sensor_tables.items()
        if isinstance(table, dict) and isinstance(table.get("signal"), str)
    }
    context = _Context(method, recordings, uncertainties)
    signals = {}
    for domain in DYNAMIC_DOMAINS:
        members = tuple(
            _signal(name, table, f"{where}: {domain}.{name}", context)
            for name, table in _subtables(tables, domain, where).items()
        )
        if members:
            signals[domain] = members
    sensors = tuple(
        _sensor(name, table, f"{where}: {MEASUREMENT_DOMAIN}.{name}", path, signals)
        for name, table in sensor_tables.items()
    )
    weights = None
    if "weights" in tables:
        weights_table = check_keys(tables["weights"], (*DYNAMIC_DOMAINS, MEASUREMENT_DOMAIN), f"{where}: weights")
        weights = {name: number(weights_table, name, f"{where}: weights") for name in weights_table}
    fidelity = assemble(signals, sensors, weights, method, recordings.step if recordings else None, where)
    if recordings:
        fidelity = replace(fidelity, notes=recordings.notes)
    return title(tables, where, single_line(path.stem)), fidelity


def _method(tables: dict[str, Any], where: str, arithmetic: str | None, nrmse: str | None) -> FidelityMethod:
    f_max = to_si(tables.get("f_max", F_MAX), "Hz", f"{where}: f_max")
    if not 0 < f_max <= LARGEST_F_MAX:
        wrong = f"{f_max:g} is not positive" if f_max <= 0 else f"{f_max:g} Hz is no frequency of a drivetrain"
        raise InputError(f"{where}: f_max", wrong, "give the largest relevant frequency in Hz")
    form = one_of(nrmse or text(tables, "nrmse", where, "definition"), NRMSE_FORMS, f"{where}: nrmse")
    arithmetic = arithmetic or text(tables, "arithmetic", where, "definition")
    longest = to_si(tables["longest_delay"], "s", f"{where}: longest_delay") if "longest_delay" in tables else None
    return FidelityMethod(f_max, one_of(arithmetic, ARITHMETICS, f"{where}: arithmetic"), form, longest)


def _subtables(tables: dict[str, Any], key: str, where: str) -> dict[str, Any]:
    """The table under a key, which may have any keys."""
    table = tables.get(key, {})
    return check_keys(table, table if isinstance(table, dict) else (), f"{where}: {key}")


def _compared_columns(tables: dict[str, Any]) -> set[str]:
    """Columns of the recordings that a case compares; what is wrong with its tables is reported later."""
    return {
        str(table.get(role, name))
        for domain in DYNAMIC_DOMAINS
        if isinstance(tables.get(domain), dict)
        for name, table in tables[domain].items()
        if isinstance(table, dict)
        for role in ("reference", "test")
    }


def _signal(name: str, table: Any, where: str, context: _Context) -> SignalFidelity:
    """One signal of a dynamic domain, from stated values or from the recordings."""
    check_keys(table, (*STATED_KEYS, *MEASURED_KEYS), where)
    if any(key in table for key in STATED_KEYS):
        if any(key in table for key in MEASURED_KEYS):
            raise InputError(
                where,
                "states values and names signals at once",
                f"keep {', '.join(STATED_KEYS)} or {', '.join(MEASURED_KEYS)}",
            )
        return _stated_signal(name, table, where, context.method.f_max)
    if context.recordings is None:
        raise InputError(
            where,
            "has neither values nor recordings",
            "give nrmse_fidelity and delay, or [recordings] with reference and test",
        )
    columns = text(table, "reference", where, name), text(table, "test", where, name)
    measured = context.recordings.signal(*columns, where)
    noise = None
    if "reference_noise" in table or "test_noise" in table:
        noise = tuple(_standard_deviation(table, key, measured.unit, where) for key in MEASURED_KEYS[2:])
    pair = SignalPair(measured.reference, measured.test, noise=noise)  # type: ignore[arg-type]
    stated = context.uncertainties.get(name)
    if stated is not None:
        if None not in (stated.dimension, measured.unit.dimension) and stated.dimension != measured.unit.dimension:
            raise InputError(
                where, f"its sensor's uncertainty has another dimension than {measured.unit.text}", "correct a unit"
            )
        pair = replace(
            pair,
            expanded_uncertainty=stated.expanded,
            coverage_factor=stated.coverage_factor,
            degrees_of_freedom=stated.degrees_of_freedom,
        )
    return assess_signal(name, pair, context.recordings.step, context.method, where.rpartition(".")[0])


def _stated_signal(name: str, table: dict[str, Any], where: str, f_max: float) -> SignalFidelity:
    nrmse = _fraction(table, "nrmse_fidelity", where)
    delay = to_si(table.get("delay", 0.0), "s", f"{where}.delay")
    delay_u = to_si(table.get("delay_uncertainty", 0.0), "s", f"{where}.delay_uncertainty")
    for key, seconds in (("delay", delay), ("delay_uncertainty", delay_u)):
        if abs(seconds) > LONGEST_DELAY:
            wrong = f"{seconds:g} s is no delay of a test bed"
            raise InputError(f"{where}.{key}", wrong, f"at most {LONGEST_DELAY:g} s are possible")
    nrmse_u = _fraction(table, "nrmse_uncertainty", where) if "nrmse_uncertainty" in table else 0.0
    estimate = Delay(delay, abs(delay_u), "", delay)
    return SignalFidelity(name, nrmse, estimate, float(delay_fidelity(delay, f_max)), nrmse_u)


def _standard_deviation(table: dict[str, Any], key: str, unit: Unit, where: str) -> float:
    """A standard deviation in the unit of a signal, SI; 0 where there is none."""
    value, dimension = signal_quantity(table.get(key, 0.0), f"{where}.{key}")
    if None not in (dimension, unit.dimension) and dimension != unit.dimension:
        raise InputError(f"{where}.{key}", "has another dimension than the signal", f"give it in {unit.text}")
    if value < 0:
        raise InputError(f"{where}.{key}", f"{value:g} is negative", "give a standard deviation")
    return value


def _fraction(table: dict[str, Any], key: str, where: str) -> float:
    if key not in table:
        raise InputError(where, f"'{key}' is missing", f'give {key} = 0.95 or "95 %"')
    value = to_si(table[key], "1", f"{where}.{key}")
    if not 0 <= value <= 1:
        raise InputError(f"{where}.{key}", f"{value:g} is not in 0 ... 1", 'give a fraction such as 0.95 or "95 %"')
    return value


def _degrees_of_freedom(table: dict[str, Any], where: str) -> float:
    return number(table, "degrees_of_freedom", where, positive=True) if "degrees_of_freedom" in table else math.inf


def _uncertainty(table: dict[str, Any], where: str, path: Path) -> _StatedUncertainty:
    """The uncertainty of a sensor, from the case itself or from a budget file."""
    if "budget" in table:
        return _uncertainty_of_budget(table, where, path)
    factor = read_coverage_factor(table, where) if "coverage_factor" in table else 2.0
    if "expanded_uncertainty" not in table:
        raise InputError(where, "has no uncertainty", "give expanded_uncertainty, budget or fidelity")
    value, dimension = signal_quantity(table["expanded_uncertainty"], f"{where}.expanded_uncertainty")
    if value < 0:
        raise InputError(f"{where}.expanded_uncertainty", f"{value:g} is negative", "give a number of at least 0")
    return _StatedUncertainty(value, dimension, factor, _degrees_of_freedom(table, where))


def _uncertainty_of_budget(table: dict[str, Any], where: str, path: Path) -> _StatedUncertainty:
    budget = read_budget(no_pipe(path.parent / text(table, "budget", where), where))
    results = evaluate(budget, with_monte_carlo=False).measurands
    wanted = text(table, "measurand", where, results[0].measurand.name)
    for result in results:
        if result.measurand.name == wanted:
            unit = result.measurand.unit
            freedom = result.propagation.degrees_of_freedom or math.inf
            return _StatedUncertainty(result.expanded, unit.dimension, result.coverage_factor, freedom)
    raise InputError(
        f"{where}.measurand",
        f"the budget has no '{wanted}'",
        f"choose {', '.join(result.measurand.name for result in results)}",
    )


def _sensor(
    name: str, table: Any, where: str, path: Path, signals: dict[str, tuple[SignalFidelity, ...]]
) -> SensorUncertainty:
    check_keys(table, SENSOR_KEYS, where)
    if "fidelity" in table:
        return SensorUncertainty(name, 1 - _fraction(table, "fidelity", where), _degrees_of_freedom(table, where))
    stated = _uncertainty(table, where, path)
    if "signal" in table:
        wanted = text(table, "signal", where)
        for members in signals.values():
            for signal in members:
                if signal.name == wanted and signal.pair is not None:
                    return SensorUncertainty(name, stated.expanded / signal.width, stated.degrees_of_freedom)
        raise InputError(
            f"{where}.signal", f"there is no measured signal '{wanted}'", "name one taken from the recordings"
        )
    if "range" not in table:
        raise InputError(where, "has no range", "give range, or signal = the name of a measured signal")
    width, dimension = signal_quantity(table["range"], f"{where}.range")
    if width <= 0:
        raise InputError(f"{where}.range", f"{width:g} is not positive", "give the range of the signal")
    if dimension != stated.dimension:
        raise InputError(f"{where}.range", "and the uncertainty have unlike dimensions", "give both in the same unit")
    return SensorUncertainty(name, stated.expanded / width, stated.degrees_of_freedom)


# --- At which frequencies the fidelity is lost: the deviation of each band, split into amplitude, phase and delay.

EDGES = (0.0, 0.5, 1.0, 2.0, 4.0, 7.0, 10.0, 15.0, 20.0, 25.0, 30.0)  # Hz
LEAST_COHERENCE = 0.7  # below it a band's lines share no delay
TRIAL_DELAYS = 41  # over ± half a period of the band's mean frequency: 40 steps find the highest of its few peaks


@dataclass(frozen=True)
class Band:
    """One band of a signal's deviation. The bands' ``mean_square`` sum to that of the whole deviation exactly.

    Attributes
    ----------
    low, high : float
        Hz.
    mean_square, share : float
        Mean square deviation, SI, and its part of the whole.
    nrmse : float
        R_NRMSE if there were only this band's deviation.
    amplitude_share, phase_share : float
        Parts of the band's mean square, by |X − Y|² = (|X| − |Y|)² + 2|X||Y|(1 − cos φ).
    coherence : float
        Of the band's lines with one common delay, 0 … 1.
    delay, delay_fidelity : float, optional
        That delay in s and its R_τ; None where the band has too few lines or too little coherence.
    """

    low: float
    high: float
    mean_square: float
    share: float
    nrmse: float
    amplitude_share: float
    phase_share: float
    coherence: float
    delay: float | None
    delay_fidelity: float | None

    def to_dict(self) -> dict[str, Any]:
        """As ``fidelity.json`` holds it; the upper edge of the last band is null."""
        return asdict(self) | {"high": self.high if math.isfinite(self.high) else None}


def bands(pair: SignalPair, step: float, f_max: float, edges: tuple[float, ...] = EDGES) -> tuple[Band, ...]:
    """Bands from 0 to f_max and one above (``edges`` Hz, ``step`` s); the mean square splits by Parseval's theorem.

    The discrete spectrum takes the recording as one period. A recording that ends at another value than it began with
    has a step there, which contributes to all bands, but to reference and test alike, so that their difference hardly
    shows it.
    """
    reference, test = np.asarray(pair.reference, dtype=float), np.asarray(pair.test, dtype=float)
    count, width = len(reference), signal_range(reference)
    edges = (*(edge for edge in edges if edge < f_max), f_max, math.inf)
    x, y = np.fft.rfft(reference), np.fft.rfft(test)
    frequency = np.fft.rfftfreq(count, step)
    lines = np.full(len(x), 2.0)  # a line stands for a conjugate pair, but for 0 and half the sampling frequency
    lines[0] = 1.0
    if count % 2 == 0:
        lines[-1] = 1.0
    deviation = lines / count**2 * np.abs(x - y) ** 2
    amplitude = lines / count**2 * (np.abs(x) - np.abs(y)) ** 2
    total = float(deviation.sum())
    split = []
    for low, high in itertools.pairwise(edges):
        inside = (frequency >= low) & (frequency < high)
        mean_square, by_amplitude = float(deviation[inside].sum()), float(amplitude[inside].sum())
        delay, coherence = _common_delay(x[inside], y[inside], frequency[inside])
        split.append(
            Band(
                low,
                high,
                mean_square,
                mean_square / total if total > 0 else 0.0,
                nrmse_fidelity_of(mean_square, width),
                by_amplitude / mean_square if mean_square > 0 else 0.0,
                1 - by_amplitude / mean_square if mean_square > 0 else 0.0,
                coherence,
                delay,
                None if delay is None else float(delay_fidelity(delay, f_max)),
            )
        )
    return tuple(split)


def _common_delay(x: np.ndarray, y: np.ndarray, frequency: np.ndarray) -> tuple[float | None, float]:
    """The delay (s) that makes the cross-spectrum of a band (f,) most nearly real, and the coherence, 0 … 1."""
    usable = frequency > 0
    cross, frequency = np.conj(x[usable]) * y[usable], frequency[usable]
    power = math.sqrt(float(np.sum(np.abs(x[usable]) ** 2) * np.sum(np.abs(y[usable]) ** 2)))
    if len(cross) < 2 or power <= 0:
        return None, 0.0

    def coherence_at(delay: float) -> float:
        return float(np.real(np.sum(cross * np.exp(2j * np.pi * frequency * delay)))) / power

    half_period = 0.5 / float(np.mean(frequency))
    trials = np.linspace(-half_period, half_period, TRIAL_DELAYS)
    start = trials[int(np.argmax([coherence_at(delay) for delay in trials]))]
    reach = trials[1] - trials[0]
    best = scipy.optimize.minimize_scalar(
        lambda delay: -coherence_at(delay),
        bounds=(start - reach, start + reach),
        method="bounded",
        options={"xatol": 1e-9},
    )
    coherence = min(1.0, max(0.0, -float(best.fun)))
    return (float(best.x) if coherence > LEAST_COHERENCE else None), coherence


# --- The result of ``rigmatch fidelity``: the fidelity, its uncertainty, its spectrum and the attribution of its loss.


@dataclass(frozen=True)
class XilFidelity(Displayed):
    """The XiL fidelity of a case.

    Attributes
    ----------
    title : str
    fidelity : Fidelity
    uncertainty : dict of str to DrawnValue
        Of ``"total"`` and of each domain, by Monte Carlo with ``draws`` and ``seed``.
    draws, seed : int
    attribution : Attribution, optional
        None for the published arithmetic.
    bands : dict of str to dict of str to tuple of Band
        By domain and signal; empty where values were stated.
    """

    title: str
    fidelity: Fidelity
    uncertainty: dict[str, DrawnValue]
    draws: int
    seed: int
    attribution: Attribution | None
    bands: dict[str, dict[str, tuple[Band, ...]]]

    @property
    def R_XiL(self) -> float:
        """The total, 0 … 1."""
        return self.fidelity.total

    @property
    def domains(self) -> dict[str, float]:
        """Fidelity of every domain, 0 … 1."""
        return dict(self.fidelity.domains)

    @property
    def notes(self) -> tuple[str, ...]:
        """What a reader of the figures has to know."""
        fidelity = self.fidelity
        notes = list(fidelity.notes)
        if fidelity.method.arithmetic == "published":
            notes.append(_published_note(fidelity))
        if fidelity.method.nrmse_form == "literal":
            notes.append(
                "literal Eq. 18: the range stands inside the root, so the result depends on the unit of the signals "
                "(SI here)"
            )
        signals = {
            f"{domain}.{signal.name}": signal for domain, members in fidelity.signals.items() for signal in members
        }
        if fidelity.step is None and not any(
            signal.nrmse_uncertainty or signal.delay.standard_uncertainty for signal in signals.values()
        ):
            notes.append(
                "the values are stated without uncertainty, so R_XiL has none: it cannot be compared between test beds"
            )
        for name, signal in signals.items():
            if signal.delay.value is None:
                nearest = signal.delay.nearest
                counts = "as 0" if nearest is None else f"the smallest that fits, {nearest:.4g} s"
                notes.append(f"{name}: delay undetermined, {signal.delay.reason}; R_tau counts {counts}")
        return tuple(notes)

    def to_dict(self) -> dict[str, Any]:
        """The content of ``fidelity.json``."""
        fidelity = self.fidelity
        content: dict[str, Any] = {
            "title": self.title,
            "R_XiL": fidelity.total,
            "domains": fidelity.domains,
            "weights": fidelity.weights,
            "f_max": fidelity.f_max,
            "arithmetic": fidelity.method.arithmetic,
            "nrmse": fidelity.method.nrmse_form,
            "signals": {
                domain: [_signal_to_dict(signal) for signal in members] for domain, members in fidelity.signals.items()
            },
            "sensors": [
                {"name": sensor.name, "uncertainty_over_range": sensor.ratio, "fidelity": 1 - sensor.ratio}
                for sensor in fidelity.sensors
            ],
            "uncertainty": {name: value.to_dict() for name, value in self.uncertainty.items()}
            | {"draws": self.draws, "seed": self.seed},
            "notes": list(self.notes),
        }
        if self.attribution is not None:
            content["attribution"] = self.attribution.to_dict()
        if self.bands:
            content["bands"] = {
                domain: {name: [band.to_dict() for band in spectrum] for name, spectrum in signals.items()}
                for domain, signals in self.bands.items()
            }
        return content


def xil_fidelity(title: str, fidelity: Fidelity, draws: int = 20_000, seed: int = 1) -> XilFidelity:
    """A fidelity with its uncertainty, spectrum and attribution."""
    spectra = {}
    if fidelity.step is not None:
        spectra = {
            domain: {
                signal.name: bands(signal.pair, fidelity.step, fidelity.f_max)
                for signal in members
                if signal.pair is not None
            }
            for domain, members in fidelity.signals.items()
        }
    attribution = attribute(fidelity) if fidelity.method.arithmetic == "definition" else None
    uncertainty = fidelity_distribution(fidelity, draws, seed).summary()
    return XilFidelity(title, fidelity, uncertainty, draws, seed, attribution, spectra)


def _signal_to_dict(signal: SignalFidelity) -> dict[str, Any]:
    return {
        "name": signal.name,
        "R_NRMSE": signal.nrmse,
        "R_tau": signal.delay_fidelity,
        "delay": signal.delay.value,
        "delay_standard_uncertainty": signal.delay.standard_uncertainty,
        "delay_undetermined": signal.delay.reason or None,
        "nearest_delay": signal.delay.nearest,
    }


def _published_note(fidelity: Fidelity) -> str:
    dynamic = 4 / PUBLISHED_DIVISOR  # square of what an ideal test bed scores in a dynamic domain of two signals
    weights = fidelity.weights
    total = sum(weights.get(name, 0) for name in fidelity.signals) * dynamic + weights.get(MEASUREMENT_DOMAIN, 0)
    return (
        "published arithmetic: every sum is divided by 6 instead of 2m or m, which alone gives the paper's Tab. 3; an "
        f"ideal test bed would score {dynamic**0.5:.3f} in a dynamic domain and {total**0.5:.3f} in all, not 1"
    )
