"""What may be wrong with a channel: what it does to the signal, the words for it, and the line that mends it.

Every test of channels uses this one table: a file alone (:mod:`modelling.recordings.plausible`), a recording with a
model (:mod:`modelling.simulation.simulate`, :mod:`matching.bed.plausible`), the check on the bed
(:mod:`matching.bed.channels`) and a diagnosis (:mod:`matching.diagnosis.audit`). A new kind of fault is one entry of
:data:`KINDS`, a new factor one of :data:`CONVERSIONS`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from math import isfinite, log, pi

import numpy as np

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
    """What a fault of a size does to the signal (t,) of its place; words of a sensor, of a torque; the line.

    ``{0}`` is the size in words, ``{1}`` the other channel, ``{2}`` who gives the torque.
    """

    act: Callable[[np.ndarray, float], np.ndarray]
    sensor: str
    torque: str = ""
    line: str = ""
    plain: bool = False


KINDS = {
    "sign": Kind(
        lambda values, _: -values, "has the wrong sign", "acts with the wrong sign: mend the command of {2}",
        "sign = -1", plain=True,
    ),
    "factor": Kind(
        lambda values, size: size * values, "reads {0}", "acts {0}: mend the command of {2}", "factor = {0}"
    ),
    "stuck": Kind(
        lambda values, _: 0 * values, "does not move: it is stuck or not connected",
        "is not followed: {2} gives no torque",
    ),
    "zero": Kind(lambda values, size: values + size, "reads {0} at rest: set its zero"),
    "exchanged": Kind(
        lambda values, _: values, "is exchanged with {1}",
        "drives the dynamometer of {1}: the commands are exchanged", '"{1}"', plain=True,
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
        Factor or zero (SI); NaN of kinds without one.
    """

    channel: str
    kind: str
    words: str
    line: str = ""
    certain: bool = True
    plain: bool = False
    size: float = float("nan")

    @property
    def sentence(self) -> str:
        """For people."""
        return f"{self.channel} {self.words}"

    def acted(self, values: np.ndarray) -> np.ndarray:
        """The signal (t,) of the channel, from the true one of the place that it is connected to."""
        return KINDS[self.kind].act(values, self.size)


def fault(
    kind: str, channel: str, other: str = "", giver: str = "", *, size: str = "", certain: bool = True
) -> ChannelFault:
    """A fault without a factor; of a torque with who gives it."""
    of_kind = KINDS[kind]
    words = (of_kind.torque if giver else of_kind.sensor).format(size, other, giver)
    line = "" if giver or not of_kind.line else _line(channel, of_kind.line.format(size, other))
    return ChannelFault(channel, kind, words, line, certain, of_kind.plain and not giver)


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
