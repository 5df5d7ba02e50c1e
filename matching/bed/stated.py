"""A measured quantity of the bed next to its stated value: its words, and the line that a file needs."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from modelling.errors import listed
from modelling.recordings.channel_faults import fault, with_uncertainty


@dataclass(frozen=True)
class Deviation:
    """A quantity as the check measures it.

    Attributes
    ----------
    name : str
        As under ``[uncertainty]``, and ``dynamometers.NAME.dead_time`` and its lags, ``inputs.NAME.gain`` and its
        ``delay``, ``sensors.NAME.gain``, ``inertias.NAME.friction``.
    stated, value, uncertainty, tolerance : float
        SI; the uncertainty is a standard one, the tolerance a half-width. The dead time is that of the loop, with the
        hold of half a sample.
    beyond : bool
        Whether it lies beyond its tolerance, whatever its uncertainty.
    told : bool
        Whether the recording tells it at all.
    or_else : tuple of str
        Quantities that may be off in its place: the recording does not tell them apart.
    """

    name: str
    stated: float
    value: float
    uncertainty: float
    tolerance: float
    beyond: bool = False
    told: bool = True
    or_else: tuple[str, ...] = ()

    def to_dict(self) -> dict[str, Any]:
        """As ``channels.json`` holds it."""
        return {**vars(self), "or_else": list(self.or_else)}


UNITS = {"J": "kg·m²", "stiffness": "N·m/rad"}


def off_words(one: Deviation) -> str:
    """What of a bed is off, in words: measured value, unit, and how it stands to the stated one."""
    table, *name, key = one.name.split(".")
    what = f"dynamometer {name[0]}" if table == "dynamometers" else ".".join(name)
    other = f" (or {listed(list(one.or_else))}: the recording does not tell them apart)" if one.or_else else ""
    if key in ("dead_time", "delay"):
        late = 1e3 * (one.value - one.stated)
        size = with_uncertainty(abs(late), 1e3 * one.uncertainty)
        text = fault("delay", what, giver=what, size=f"{size} ms {'later' if late > 0 else 'earlier'}").sentence
    elif key in ("torque_gain", "gain"):
        done, of_what = ("reads", "the truth") if table == "sensors" else ("gives", "what it is asked for")
        text = f"{what} {done} {with_uncertainty(one.value, one.uncertainty)} times {of_what}"
    elif key in UNITS:
        size = f"{with_uncertainty(one.value, one.uncertainty)} {UNITS[key]}"
        text = f"{name[-1]} has {size}, {one.value / one.stated:.2g} times what is stated"
    else:
        size = with_uncertainty(1e3 * one.value, 1e3 * one.uncertainty)
        text = fault("filter", what, key.replace("_", " "), giver=what, size=f"{size} ms").sentence
    return text + other


def case_line(one: Deviation) -> str | None:
    """The line that a case or its rig's model file needs; None of what no file states."""
    table, *name, key = one.name.split(".")
    if table == "rig":
        return f"[{'.'.join(name)}] {key} = {one.value:.4g}"
    return f"[dynamometers.{name[0]}] {key} = {one.value:.4g}" if table == "dynamometers" else None
