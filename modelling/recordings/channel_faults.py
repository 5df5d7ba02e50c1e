"""What may be wrong with a channel: what it does to the signal, the words for it, and the line that mends it.

Every test of channels uses this one table: a file alone (:mod:`modelling.recordings.plausible`), a recording with a
model (:mod:`modelling.simulation.simulate`, :mod:`matching.bed.plausible`), the check on the bed
(:mod:`matching.bed.channels`) and a diagnosis (:mod:`matching.diagnosis.audit`). A new kind of fault is one entry of
:data:`KINDS`, a new factor one of :data:`CONVERSIONS`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from math import isfinite, log, pi

import numpy as np
from scipy import signal
from scipy.optimize import minimize_scalar

from modelling.errors import InputError

# --- Factors: any is possible; these have a name.


@dataclass(frozen=True)
class Conversion:
    """A usual factor of reading over truth: what is then wrong, and what a channel file says of it."""

    factor: float
    quantities: tuple[str, ...]
    words: str
    line: str


TURN, PER_MINUTE, DEGREES = 2 * pi, 60 / (2 * pi), 180 / pi
POUND_FOOT, POUND_INCH = 0.73756215, 8.8507458  # lbf·ft, lbf·in in a N·m
CONVERSIONS = (
    Conversion(PER_MINUTE, ("speed",), "is in 1/min, not in rad/s", 'unit = "1/min"'),
    Conversion(1 / PER_MINUTE, ("speed",), "is divided by 9.549, as if it had been in 1/min", "factor = 9.5493"),
    Conversion(DEGREES, ("speed",), "is in deg/s, not in rad/s", 'unit = "deg/s"'),
    Conversion(1 / DEGREES, ("speed",), "is divided by 57.3, as if it had been in deg/s", "factor = 57.29578"),
    Conversion(1 / TURN, ("speed",), "is in turns a second, not in rad/s", "factor = 6.283185"),
    Conversion(TURN, ("speed",), "is multiplied by 2π, as if it had been in turns a second", "factor = 0.1591549"),
    Conversion(DEGREES, ("angle",), "is in degrees, not in rad", 'unit = "deg"'),
    Conversion(1 / DEGREES, ("angle",), "is divided by 57.3, as if it had been in degrees", "factor = 57.29578"),
    Conversion(1 / TURN, ("angle",), "is in turns, not in rad", 'unit = "turn"'),
    Conversion(POUND_FOOT, ("torque",), "is in lbf·ft, not in N·m", 'unit = "lbf*ft"'),
    Conversion(1 / POUND_FOOT, ("torque",), "is multiplied by 1.356, as if it had been in lbf·ft", "factor = 0.737562"),
    Conversion(POUND_INCH, ("torque",), "is in lbf·in, not in N·m", 'unit = "lbf*in"'),
    Conversion(1 / POUND_INCH, ("torque",), "is divided by 8.851, as if it had been in lbf·in", "factor = 8.850746"),
    Conversion(1e-3, ("torque",), "is in kN·m, not in N·m", 'unit = "kN*m"'),
    Conversion(1e3, ("torque",), "is in mN·m, not in N·m", 'unit = "mN*m"'),
    Conversion(10.0, ("torque",), "is ten times too large", "factor = 0.1"),
    Conversion(0.1, ("torque",), "is ten times too small", "factor = 10"),
    Conversion(1e3, ("speed", "angle"), "is a thousand times too large", "factor = 0.001"),
    Conversion(1e-3, ("speed", "angle"), "is a thousand times too small", "factor = 1000"),
    Conversion(0.5, ("torque",), "reads half: is the range of its amplifier set twice too large", "factor = 2"),
    Conversion(2.0, ("torque",), "reads double: is the range of its amplifier set to half", "factor = 0.5"),
    Conversion(0.5, ("speed", "angle"), "reads half: is the number of lines a turn set twice too large", "factor = 2"),
    Conversion(2.0, ("speed", "angle"), "reads double: is the number of lines a turn set to half", "factor = 0.5"),
)  # fmt: skip


NEAR = 0.3  # of a conversion's natural logarithm, that a factor is from it at most


def conversion(factor: float, quantity: str, within: float) -> Conversion | None:
    """The usual conversion of a quantity that is nearest to a factor, ``within`` (natural logarithm); else None."""
    usual = [one for one in CONVERSIONS if quantity in one.quantities] if factor else []
    best = min(usual, key=lambda one: abs(log(abs(factor) / one.factor)), default=None)
    if best is None:
        return None
    # a small factor needs a better value than a large one: 1.2 is not roughly 1.36
    return best if abs(log(abs(factor) / best.factor)) <= min(within, NEAR * abs(log(best.factor))) else None


def units_of(quantity: str) -> Iterator[tuple[str, float]]:
    """Units other than the SI one that a channel of a quantity may be in, and their size in SI."""
    for one in CONVERSIONS:
        if one.quantities == (quantity,) and one.line.startswith("unit"):
            yield one.line.split('"')[1], 1 / one.factor


# --- Kinds of faults.


@dataclass(frozen=True)
class Kind:
    """What a fault of a size, and of an order, does to the signal (t,) of its place, at even steps in s; words of a
    sensor, of a torque; the line of a channel file, or of a model (``model``).

    ``{0}`` is the size in words, ``{1}`` the other channel or a second size, ``{2}`` who gives the torque.
    """

    act: Callable[[np.ndarray, float, float, int], np.ndarray]
    sensor: str
    torque: str = ""
    line: str = ""
    model: str = ""
    plain: bool = False


def _delayed(values: np.ndarray, delay: float, step: float, _: int) -> np.ndarray:
    at = np.arange(len(values)) * step
    return np.interp(at - delay, at, values)


def _filtered(values: np.ndarray, corner: float, step: float, order: int) -> np.ndarray:
    """By a Butterworth filter, settled at the first value; ``corner`` in Hz."""
    sections = signal.butter(order, corner, output="sos", fs=1 / step)
    return np.asarray(signal.sosfilt(sections, values, zi=signal.sosfilt_zi(sections) * values[0])[0])


def _held(values: np.ndarray, interval: float, step: float, _: int) -> np.ndarray:
    every = max(round(interval / step), 1)
    return values[np.arange(len(values)) // every * every]


def _dropped(values: np.ndarray, interval: float, step: float, _: int) -> np.ndarray:
    lost = np.arange(1, len(values) + 1) % max(round(interval / step), 1) == 0
    return np.where(lost, np.nan, values)


KINDS = {
    "sign": Kind(
        lambda values, *_: -values, "has the wrong sign", "acts with the wrong sign: mend the command of {2}",
        "sign = -1", plain=True,
    ),
    "factor": Kind(
        lambda values, size, *_: size * values, "reads {0}", "acts {0}: mend the command of {2}", "factor = {0}"
    ),
    "stuck": Kind(
        lambda values, *_: 0 * values, "does not move{0}: it is stuck or not connected",
        "is not followed: {2} gives no torque",
    ),
    "zero": Kind(lambda values, size, *_: values + size, "reads {0} at rest: set its zero"),
    "exchanged": Kind(
        lambda values, *_: values, "is exchanged with {1}",
        "drives the dynamometer of {1}: the commands are exchanged", '"{1}"', plain=True,
    ),
    "delay": Kind(
        _delayed, "is recorded {0} than {1}", "answers {0} than stated",
        model='[[effects]] kind = "sensor_delay", at = "sensors.{0}", delay = {1:.4g}',
    ),
    "filter": Kind(
        _filtered, "passes a filter of order {1} with its corner near {0}", "has a {1} of {0}",
        model='[[effects]] kind = "lag", at = "sensors.{0}", time_constant = {1:.4g}',
    ),
    "held": Kind(_held, "repeats every value over {0} rows"),
    "dropouts": Kind(_dropped, "lacks {0}, first {1}"),
    "rounded": Kind(
        lambda values, size, *_: size * np.round(values / size),
        "is rounded to steps of {0}, which is coarser than its stated uncertainty",
        model="[sensors.{0}] uncertainty = {1:.3g}",
    ),
    "clipped": Kind(
        lambda values, size, *_: np.clip(values, -size, size), "is at the end of its range{0}",
    ),
}  # fmt: skip


@dataclass(frozen=True)
class ChannelFault:
    """A channel that is not what it is called.

    Attributes
    ----------
    channel, kind : str
        Name in the model; one of :data:`KINDS`.
    words, line : str
        What is wrong, and what ``[channels]`` of a channel file needs; the controller reads the bed itself.
    certain : bool
        Whether nothing else explains it; what else may explain it keeps no emulation from beginning.
    plain : bool
        Whether it is a sign, a usual unit or an exchanged pair, which friction does not look like.
    size : float
        SI: factor, zero, delay, corner (Hz), time between values or between lost ones, step, or end of the range; NaN
        of kinds without one.
    order : int
        Of a filter.
    """

    channel: str
    kind: str
    words: str
    line: str = ""
    certain: bool = True
    plain: bool = False
    size: float = float("nan")
    order: int = 1

    @property
    def sentence(self) -> str:
        """For people."""
        return f"{self.channel} {self.words}"

    @property
    def advice(self) -> str:
        """For people, with the line that mends it."""
        return f"{self.sentence}{f': write {self.line}' if self.line else ''}"

    def acted(self, values: np.ndarray, step: float = 1.0) -> np.ndarray:
        """The signal (t,) of the channel at even steps (s), from the true one of the place it is connected to."""
        return KINDS[self.kind].act(values, self.size, step, self.order)


def fault(
    kind: str, channel: str, other: str = "", giver: str = "", *, size: str = "", certain: bool = True,
    value: float = float("nan"), mends: float = float("nan"), order: int = 1,
) -> ChannelFault:  # fmt: skip
    """A fault without a factor; of a torque with who gives it.

    ``size`` in words is ``value`` (SI); ``mends``: what the line of a model states, NaN where no line mends it.
    """
    of_kind = KINDS[kind]
    words = (of_kind.torque if giver else of_kind.sensor).format(size, other, giver)
    line = "" if giver or not of_kind.line else _line(channel, of_kind.line.format(size, other))
    if of_kind.model and not giver and isfinite(mends):
        line = of_kind.model.format(channel, mends)
    return ChannelFault(channel, kind, words, line, certain, of_kind.plain and not giver, value, order)


def factor_fault(
    channel: str, quantity: str, factor: float, within: float, uncertainty: float | None = None, giver: str = ""
) -> ChannelFault:
    """Any factor of a channel, by the usual conversion that is nearest, ``within`` (natural logarithm).

    ``uncertainty``: standard, of the factor; None where it is rough.
    """
    size = _times(factor, uncertainty)
    if giver:
        sign = "with the wrong sign and " if factor < 0 else ""
        return ChannelFault(channel, "factor", KINDS["factor"].torque.format(sign + size, "", giver), size=factor)
    usual, wrong_sign = conversion(factor, quantity, within), factor < 0
    words, line = (usual.words, usual.line) if usual else (KINDS["factor"].sensor.format(size),
                                                           f"factor = {1 / abs(factor):.4g}")  # fmt: skip
    if usual and uncertainty is not None:
        words = f"{words} (factor {with_uncertainty(abs(factor), uncertainty)})"
    if wrong_sign:
        words, line = f"{words}, and {KINDS['sign'].sensor}", f"{line}, {KINDS['sign'].line}"
    plain = usual is not None and abs(factor) > 1
    return ChannelFault(channel, "factor", words, _line(channel, line), plain=plain, size=factor)


ORDERS = (1, 2, 4)  # of filters: a sensor's own, an amplifier's usual one, and two of those in a row
TRIED = 40  # sizes that are tried, and refined from the best
SETTLED = 0.05  # of a part, in which a delay or a filter settles, is not compared
AT_NOISE = 1.3  # times the noise: what a fault that explains a channel leaves at most
CLEARLY = 1.1  # times what the best leaves: another kind that is worse than this is none


def likeliest_fault(
    channel: str, unit: str, parts: Sequence[tuple[np.ndarray, np.ndarray, float]], noise: float
) -> ChannelFault | None:
    """The one fault that makes what a channel should read into what it reads; None where none does, or several.

    Parameters
    ----------
    parts : sequence of (ndarray (t,), ndarray (t,), float)
        What it should read, what it reads (NaN: nothing), and the step in s.
    noise : float
        Standard deviation of a sample, SI.
    """
    step, size = min(part[2] for part in parts), max(float(np.abs(part[0]).max()) for part in parts)
    longest = max(len(part[0]) * part[2] for part in parts)
    ranges = {
        "delay": (step / 10, longest / 20), "filter": (10 / longest, 0.45 / step), "clipped": (0.2 * size, 0.99 * size),
        "factor": (1e-3, 1e3), "zero": (noise, 10 * size + noise),
    }  # fmt: skip

    def left(kind: str, value: float, order: int) -> float:
        errors = []
        for true, read, own_step in parts:
            error = read - KINDS[kind].act(true, value, own_step, order)
            errors.append(error[round(SETTLED * len(error)) :])
        return float(np.sqrt(np.nanmean(np.concatenate(errors) ** 2)))

    found = list[tuple[float, str, float, int]]()
    for kind, order, sign in [
        *(("filter", order, 1.0) for order in ORDERS),
        *((kind, 1, sign) for kind in ("factor", "zero") for sign in (1.0, -1.0)),
        *((kind, 1, 1.0) for kind in ("delay", "clipped")),
    ]:  # fmt: skip
        tried = np.geomspace(*ranges[kind], TRIED)
        best = int(np.argmin([left(kind, sign * one, order) for one in tried]))
        ends = log(tried[max(best - 1, 0)]), log(tried[min(best + 1, TRIED - 1)])
        finer = minimize_scalar(partial(_of_logarithm, left, kind, sign, order), bounds=ends, method="bounded")
        found.append((float(finer.fun), kind, sign * float(np.exp(finer.x)), order))
    found.sort()
    if found[0][0] > AT_NOISE * noise or found[1][0] < CLEARLY * found[0][0]:
        return None
    _, kind, value, order = found[0]
    said = {"delay": f"{1e3 * value:.3g} ms later", "filter": f"{value:.3g} Hz", "clipped": f", {value:.4g} {unit}"}
    if kind == "factor":
        return factor_fault(channel, "", value, 0.0)
    mends = {"delay": value}
    if kind == "filter" and order == 1:
        mends[kind] = 1 / (2 * pi * value)  # its time constant
    other = str(order) if kind == "filter" else "what the other channels say"
    return fault(kind, channel, other, size=said.get(kind, f"{value:.4g} {unit}"), value=value,
                 mends=mends.get(kind, float("nan")), order=order)  # fmt: skip


def _of_logarithm(
    left: Callable[[str, float, int], float], kind: str, sign: float, order: int, logarithm: float
) -> float:
    return left(kind, sign * float(np.exp(logarithm)), order)


def hold_each_other(source: str, first: str, second: str, only: str) -> InputError:
    """The error of two columns that are exchanged; ``only``: what they fit only so."""
    return InputError(
        f"{source}: columns {first!r} and {second!r}", f"hold each other's values: only exchanged they {only}",
        "exchange their names, or map them in a channel file (--channels)",
    )  # fmt: skip


def _times(factor: float, uncertainty: float | None) -> str:
    size = abs(factor)
    if uncertainty is None or not isfinite(uncertainty):
        return f"about {size:.3g} times as large" if size >= 1 else f"only {size:.2g} times as large"
    return f"{with_uncertainty(size, uncertainty)} times as large"


def with_uncertainty(value: float, uncertainty: float) -> str:
    """A value with its expanded uncertainty (k = 2), to two digits of that."""
    expanded = 2 * uncertainty
    digits = max(0, 1 - int(np.floor(np.log10(expanded)))) if expanded > 0 else 4
    return f"{value:.{digits}f} ± {expanded:.{digits}f}"


def _line(channel: str, what: str) -> str:
    return f"{channel} = {what}" if what.startswith('"') else f'{channel} = {{ channel = "{channel}", {what} }}'
