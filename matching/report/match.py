"""Views of a match: figures, page, text."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import scipy
from markupsafe import Markup
from matplotlib.figure import Figure
from matplotlib.patches import Circle
from matplotlib.ticker import LogLocator, MultipleLocator, NullLocator

from matching.export import exported_controller
from matching.match.beds import BedsCheck, quantile
from matching.match.case import LARGEST_ROLLED_OFF, Case, Compared, Requirements
from matching.match.in_time import EVERYTHING_STATED, TruthInTime
from matching.match.loop import bed_set, controller_of, frequency_response
from matching.match.loop import return_difference as sampled_difference
from matching.match.loop_modes import LoopMode
from matching.match.result import AdapterTrade, MatchResult, ParameterResult, TargetResult
from matching.match.verify import Verification
from matching.report.common import (
    BAND,
    LEGEND,
    LIMIT,
    LINES,
    MATCHED,
    RIG,
    VEHICLE,
    Provenance,
    ScreenPoint,
    amount,
    change,
    component,
    decimated,
    embedded,
    environment,
    equations,
    figure,
    hertz,
    image,
    in_address,
    legend_above,
    number,
    percent,
    plain_ticks,
    practical,
    sentence,
    spaced,
    styled,
    unit,
)
from matching.report.drivetrain import MOST_INERTIAS, case_figure
from matching.report.modes import Column, ModeAnimation, energy_figure
from modelling import display
from modelling.bed.bed import HARDWARE, OF_BED, ControllerBlock, Loop
from modelling.bed.controllers import STRUCTURES
from modelling.controller.law import OpenedShaft
from modelling.errors import InputError
from modelling.modal.result import Mode
from modelling.system import System
from modelling.units import SENSOR_UNITS

# --- Response errors over the drawn beds that judged an observer, as a distribution.


def beds_figure(beds: BedsCheck, tolerance: float) -> Figure:
    """Share of the stable beds whose response error is at most so large; ``tolerance`` is that of the case."""
    with styled():
        fig = figure(7.4, 3.2)
        axes = fig.subplots()
        for name, errors, colour, stroke, width in (
            ("measured torques", beds.measured, VEHICLE, "-", 3.0),  # broad: the other one may lie on it
            ("unmeasured torques", beds.unmeasured, MATCHED, "--", 1.5),
        ):
            share = (np.arange(len(errors)) + 0.5) / max(len(errors), 1)
            opacity = 0.5 if width > 2 else 1.0
            axes.plot(errors, 100 * share, stroke, label=name, color=colour, linewidth=width, alpha=opacity)
            parts = np.array([0.5, 0.95])
            if errors:
                axes.plot(np.quantile(errors, parts), 100 * parts, "o", color=colour)
        axes.axvline(tolerance, color=LIMIT, linestyle=":", label="allowed as planned, unmeasured")
        axes.set(xlabel="Response error", ylabel="Share of stable beds, %", ylim=(0, 100))
        axes.set_xlim(left=0)
        axes.legend(loc="lower right")
    return fig


# --- What is asked of a match with an observer beyond its targets, and what drawn beds, loop and sensors made of it.


@dataclass(frozen=True)
class RequirementRow:
    """One requirement: what, its value, what is asked, and whether it holds."""

    what: str
    value: str
    asked: str
    holds: bool


def requirement_rows(robust: Verification) -> list[RequirementRow]:
    """Requirements on beds, margin, roll-off and noise."""
    beds, loop, required = robust.beds, robust.loop, robust.required
    assert beds is not None, "beds were drawn"
    rows = []
    eased = beds.damped == beds.drawn and beds.smallest_damping_ratio < required.damping_ratio
    less = "; less is a mode of the bed's own beyond the roll-off" if eased else ""
    if beds.drawn:
        rows = [
            RequirementRow("beds stable", f"{beds.stable} of {beds.drawn}", "all", beds.stable == beds.drawn),
            RequirementRow(
                "least damping ratio of any mode on any bed", number(beds.smallest_damping_ratio, 3),
                f"at least {number(required.damping_ratio, 3)}{less}", beds.damped == beds.drawn,
            ),
        ]  # fmt: skip
    if beds.drawn and beds.worst is not None:
        least = beds.worst.damping_ratio
        rows.append(
            RequirementRow(
                f"least damping ratio of the worst bed of the box (most by {', '.join(beds.worst.named[:2])})",
                number(least, 3), f"at least {number(required.damping_ratio, 3)}", least >= required.damping_ratio,
            )
        )  # fmt: skip
    rows += [
        RequirementRow(
            f"modulus margin from {number(required.margin_from)} Hz", number(loop.modulus_margin, 3),
            f"at least {number(required.modulus_margin)}", loop.modulus_margin >= required.modulus_margin,
        ),
        RequirementRow(
            f"roll-off: |T| from {number(required.rolled_off_from)} Hz", number(loop.largest_rolled_off, 3),
            f"at most {number(LARGEST_ROLLED_OFF)}", loop.largest_rolled_off <= LARGEST_ROLLED_OFF,
        ),
    ]  # fmt: skip
    for name, noise in loop.command_noise.items():
        allowed = required.command_noise
        rows.append(
            RequirementRow(
                f"command of dynamometer {name} from sensor noise", f"{number(noise, 3)} N·m rms",
                "no limit" if allowed is None else f"at most {number(allowed)} N·m rms",
                allowed is None or noise <= allowed,
            )
        )  # fmt: skip
    return rows


class ErrorRow(NamedTuple):
    """Kind of torque, median and 95 % quantile of the response error over the stable beds; None without any."""

    torques: str
    median: float | None
    upper: float | None


def error_rows(robust: Verification) -> list[ErrorRow]:
    """The response error over the stable beds, a row for each kind of torque."""
    beds = robust.beds
    assert beds is not None, "beds were drawn"
    return [
        ErrorRow(kind, quantile(errors, 0.5), quantile(errors, 0.95))
        for kind, errors in (("measured", beds.measured), ("unmeasured", beds.unmeasured))
        if errors
    ]


# --- A controller's block diagram as SVG, from the blocks of its structure: one column, readable on a narrow screen.

WIDTH, LEFT, RIGHT, TOP = 440, 124, 416, 10  # pixels: of the drawing, and where its boxes begin and end
LINE, PAD, GAP = 17, 9, 34  # pixels: a line of text, above and below texts in a box, between boxes
NAME_PX, VALUE_PX = 6.6, 7.6  # of a letter, with room for wide fonts; values are bold
LETTERS_IN_BOX, LETTERS_BESIDE, LETTERS_BETWEEN = 40, 15, 48  # that fit on one line


@dataclass(frozen=True)
class EnteredNumber:
    """A number that somebody enters: name, and value with unit."""

    name: str
    value: str

    @property
    def lines(self) -> int:
        """1, or 2 where name and value need a line each."""
        return 1 if NAME_PX * len(self.name) + VALUE_PX * len(self.value) < RIGHT - LEFT - 30 else 2


@dataclass(frozen=True)
class DrawnBox:
    """One box as drawn; y in pixels."""

    title: tuple[str, ...]
    entries: tuple[EnteredNumber, ...]
    gives: tuple[str, ...]
    takes: tuple[tuple[str, ...], ...]
    on_bed: bool
    y: float
    height: float


def block_diagram(loop: Loop, of_residual_vehicle: Sequence[EnteredNumber]) -> Markup:
    """The controller of one dynamometer and its bed as an SVG element, with every number that is entered.

    Parameters
    ----------
    loop : Loop
        With the tuned values.
    of_residual_vehicle : sequence of EnteredNumber
        The values of the residual vehicle.
    """
    boxes: list[DrawnBox] = []
    y = float(TOP)
    for block in (*loop.structure.blocks, *OF_BED):
        box = _box(block, _block_entries(block, loop, of_residual_vehicle), block in OF_BED, y)
        boxes.append(box)
        y += box.height + GAP + LINE * (len(box.gives) - 1)
    title = f"ControllerBlock diagram of the controller of each dynamometer, structure {loop.structure.name}"
    values = {
        "boxes": boxes, "title": title, "width": WIDTH, "height": y + 4, "left": LEFT, "right": RIGHT, "line": LINE,
        "pad": PAD, "gap": GAP,
    }  # fmt: skip
    return Markup(environment().get_template("block_diagram.svg").render(values))


def _block_entries(
    block: ControllerBlock, loop: Loop, of_residual_vehicle: Sequence[EnteredNumber]
) -> list[EnteredNumber]:
    entries = []
    for name in block.quantities:
        if name in HARDWARE:
            entries.append(EnteredNumber(spaced(name), practical(loop[name], HARDWARE[name].unit)))
        else:
            entries.append(
                EnteredNumber(
                    spaced(name), f"{number(loop[name], 5)} {unit(loop.structure.quantities[name].unit)}".rstrip()
                )
            )
    return entries + (list(of_residual_vehicle) if block.holds_residual_vehicle else [])


def _box(block: ControllerBlock, entries: Sequence[EnteredNumber], on_bed: bool, y: float) -> DrawnBox:
    title = tuple(textwrap.wrap(block.title, LETTERS_IN_BOX - 4))
    takes = tuple(tuple(textwrap.wrap(signal, LETTERS_BESIDE)) for signal in block.takes)
    lines = len(title) + sum(entry.lines for entry in entries)
    beside = sum(len(signal) for signal in takes) + 0.5 * len(takes)
    height = 2 * PAD + LINE * max(lines, beside)
    return DrawnBox(title, tuple(entries), tuple(textwrap.wrap(block.gives, LETTERS_BETWEEN)), takes, on_bed, y, height)


# --- Figure of the loop's distance from instability: smallest singular value of I + L, and the loci of L.

MARGIN_LOWEST_HZ, MARGIN_HIGHEST_HZ = 1e-2, 500.0  # below, only the integrator acts; above, the loop gain is negligible
POINTS = 2000


def return_difference(case: Case, frequencies: np.ndarray) -> np.ndarray:
    """I + L (f, u, u) of a case's feedback loop at frequencies (f,), Hz."""
    bed = bed_set(case, [{}], frequencies)
    return sampled_difference(bed, frequency_response(controller_of(case), frequencies))[0]


def frequencies_around(modes: list[float]) -> np.ndarray:
    """A grid (f,) in Hz, dense around the modes, where the response of a lightly damped loop changes fast."""
    near = [np.linspace(0.92, 1.08, 201) * mode for mode in modes if MARGIN_LOWEST_HZ < mode < MARGIN_HIGHEST_HZ]
    return np.unique(np.concatenate([np.geomspace(MARGIN_LOWEST_HZ, MARGIN_HIGHEST_HZ, POINTS), *near]))


def margin_figure(case: Case, modes: list[float], margin_from: float = 0.0) -> Figure:
    """Distance from instability over frequency, and the loop's loci about −1.

    Parameters
    ----------
    case : Case
        With the tuned values.
    modes : list of float
        Hz; the grid is dense around them.
    margin_from : float
        Hz; the margin is required from there on, below there the loop has to follow the emulated modes.
    """
    f = frequencies_around(modes)
    f = f[f < 0.499 / case.loop["sample_time"]]  # a sampled loop has no more
    difference = return_difference(case, f)
    distance = np.linalg.svd(difference, compute_uv=False)[:, -1]
    required = case.limits["modulus_margin"]
    with styled():
        fig = figure(12.4, 4.6)
        left, right = fig.subplots(1, 2, width_ratios=[1.5, 1])
        begins = min(max(margin_from, f[0]), f[-1])
        least = int(np.argmin(np.where(f >= begins, distance, np.inf)))
        left.plot(f, distance, color=MATCHED, linewidth=1.6)
        left.fill_between([begins, f[-1]], 0, required, color="#EEEEEE", zorder=0, linewidth=0)
        left.plot([begins, f[-1]], [required, required], color=LIMIT, linestyle="--", linewidth=1.2)
        where = {"textcoords": "offset points", "fontsize": 8}
        from_there = margin_from > f[0]
        words = f"required: {required:g}" + (f"\nfrom {number(begins, 3)} Hz" if from_there else "")
        left.annotate(
            words, (begins, 0 if from_there else required), (4, 4 if from_there else -11), color=LIMIT, **where
        )
        left.plot(f[least], distance[least], "o", color="#222222", markersize=5)
        said = f"least: {number(distance[least], 3)} at {number(f[least], 3)} Hz"
        beside = (0, -13 if distance[least] > 0.2 else 9)
        left.annotate(said, (f[least], distance[least]), beside, ha="center", **where)
        left.set_xscale("log")
        left.set_xlim(f[0], f[-1])
        left.set_ylim(0, min(max(2.0, 4 * distance[least]), 3.0))
        left.set_xlabel("Frequency in Hz")
        left.set_ylabel("Smallest singular value of I + L")
        left.set_title("Distance from instability")
        _loci(right, np.linalg.eigvals(difference) - 1, required, f >= begins)
    return fig


def _loci(axes: Any, loci: np.ndarray, required: float, counts: np.ndarray) -> None:
    """Loci (f, u); pale where the margin does not count (f,)."""
    loci = _continuous(loci)
    below = ~counts | np.append(~counts[1:], False)
    for k, line in enumerate(("-", (0, (4, 2)), ":")[: loci.shape[1]]):
        counted, rest = (np.where(part, loci[:, k], np.nan) for part in (counts, below))
        look = {"color": MATCHED, "linestyle": line}
        axes.plot(counted.real, counted.imag, linewidth=1.6, label=f"locus {k + 1}", **look)
        if not counts.all():
            axes.plot(rest.real, rest.imag, linewidth=0.8, alpha=0.5, **look)
    axes.add_patch(Circle((-1, 0), required, facecolor="#EEEEEE", edgecolor=LIMIT, linestyle="--", linewidth=1.2))
    axes.plot(-1, 0, "+", color="#222222", markersize=10, markeredgewidth=1.6)
    axes.annotate("−1", (-1, 0), (4, 5), textcoords="offset points", fontsize=8)
    axes.set_aspect("equal")
    axes.set_xlim(-2.6, 1.6)
    axes.set_ylim(-1.9, 1.9)
    axes.set_xlabel("Real part")
    axes.set_ylabel("Imaginary part")
    axes.set_title("Loci of the open loop L, positive frequencies")
    if loci.shape[1] > 1:
        axes.legend(fontsize=8, loc="lower right")


def _continuous(loci: np.ndarray) -> np.ndarray:
    """Loci (f, u) sorted so that each column is continuous over frequency."""
    out = loci.copy()
    for k in range(1, len(out)):
        _, order = scipy.optimize.linear_sum_assignment(np.abs(out[k - 1][:, None] - loci[k][None, :]))
        out[k] = loci[k][order]
    return out


# --- |S| and |T| of the feedback loop over frequency, with the limits that the case sets.


@dataclass(frozen=True)
class CurveLimit:
    """The largest value that a curve may have, from a frequency (Hz) on."""

    curve: str
    largest: float
    begins: float

    @property
    def words(self) -> str:
        """For a figure."""
        from_there = f" from {self.begins:.3g} Hz" if self.begins > MARGIN_LOWEST_HZ else ""
        return f"{self.curve} ≤ {self.largest:g}{from_there}"


@dataclass(frozen=True)
class SensitivityCurves:
    """Largest singular values (f,) of S = (I + L)⁻¹ and T = I − S over frequency, Hz, and what the case allows."""

    frequencies: np.ndarray
    S: np.ndarray
    T: np.ndarray
    limits: tuple[CurveLimit, ...]


def sensitivity(case: Case, modes: list[float], required: Requirements) -> SensitivityCurves:
    """Of a tuned case; the grid is dense around ``modes``, Hz."""
    f = frequencies_around(modes)
    f = f[f < 0.499 / case.loop["sample_time"]]
    S = np.linalg.inv(return_difference(case, f))
    T = np.eye(S.shape[-1]) - S
    limits = [
        CurveLimit("|S|", 1 / case.limits["modulus_margin"], required.margin_from),
        CurveLimit("|T|", LARGEST_ROLLED_OFF, required.rolled_off_from),
    ]
    of_S, of_T = (np.linalg.svd(matrix, compute_uv=False)[:, 0] for matrix in (S, T))
    return SensitivityCurves(f, of_S, of_T, tuple(limits))


def sensitivity_figure(loop: SensitivityCurves) -> Figure:
    """Both curves, each limit from where it counts on."""
    f, colours = loop.frequencies, {"|S|": MATCHED, "|T|": RIG}
    with styled():
        fig = figure(8.0, 4.2)
        axes = fig.subplots()
        axes.plot(f, loop.S, color=MATCHED, linewidth=1.6, label="|S|, what a disturbance is multiplied by")
        axes.plot(f, loop.T, color=RIG, linewidth=1.4, linestyle=(0, (6, 2)), label="|T|, what noise is multiplied by")
        for limit in loop.limits:
            ends = [limit.begins, f[-1]]
            axes.plot(ends, [limit.largest] * 2, color=LIMIT, linewidth=1.2, linestyle="--")
            axes.fill_between(
                ends, limit.largest, [limit.largest * 1.25] * 2, color=colours[limit.curve], alpha=0.2, linewidth=0
            )
            axes.annotate(
                limit.words, (f[-1], limit.largest), (-2, 9), textcoords="offset points", fontsize=8, ha="right"
            )
        axes.set_xscale("log")
        axes.set_yscale("log")
        axes.set_xlim(f[0], f[-1])
        axes.set_ylim(max(1e-3, 0.5 * min(loop.S.min(), loop.T.min())), 3 * max(loop.S.max(), loop.T.max()))
        axes.set_xlabel("Frequency in Hz")
        axes.set_ylabel("Largest singular value")
        axes.legend(fontsize=8, loc="lower left")
    return fig


# --- The tuned controller in time, on beds that are not the model: lines for a terminal, rows of a table.


def in_time_lines(result: Mapping[str, Any]) -> list[str]:
    """Error of the bed as modelled and of those with everything wrong, and what an open lash does."""
    in_time = result.get("in_time")
    if not in_time or not in_time["rows"]:
        return []
    first, *others, last = in_time["rows"]
    wrong = [row for row in others if row["what_is_wrong"] == EVERYTHING_STATED]
    errors = "; ".join(f"{row['what_is_wrong']}: {_pair(row)}" for row in (*wrong, last))
    lash = in_time["open_lash"]
    swinging = f"; open lash: {_lash(lash)}" if lash else ""
    return [
        f"in time, {number(in_time['duration'], 2)} s on beds that are not the model, largest error over range: as "
        f"modelled {_pair(first)}; {errors}{swinging}"
    ]


def _pair(row: Mapping[str, Any]) -> str:
    measured, unmeasured = _largest_error(row["measured"]), _largest_error(row["unmeasured"])
    return measured if measured == unmeasured else f"{measured} (measured torques), {unmeasured} (unmeasured)"


def _largest_error(errors: Mapping[str, float] | None) -> str:
    return "not stable" if errors is None else percent(max(errors.values()))


def _lash(lash: Mapping[str, Any]) -> str:
    if not lash["limit_cycles"]:
        return f"{lash['drawn']} of {lash['drawn']} drawn ones come to rest"
    return f"{lash['limit_cycles']} of {lash['drawn']} drawn ones swing on where the vehicle comes to rest"


def lash_sentence(truth: TruthInTime) -> str:
    """What drawn lashes do, as a sentence; empty where none was tried."""
    lash = truth.lash
    if lash is None:
        return ""
    return (
        f"After a short torque pulse with an open lash, {_lash(lash.to_dict())}; at the end the worst bed swings by "
        f"{number(lash.largest_swing, 2)} N·m rms, the vehicle by {number(lash.vehicle_swing, 2)} N·m."
    )


def in_time_table(truth: TruthInTime) -> dict[str, Any]:
    """Heads and rows for the page: of every sensor the error with measured and with unmeasured torques."""
    rows = []
    for row in truth.rows:
        cells = []
        for name in truth.sensors:
            for errors in (row.measured, row.unmeasured):
                cells.append("not stable" if errors is None else percent(errors[name]))
        rows.append({"words": row.words, "cells": cells})
    heads = [name.replace("_", " ") for name in truth.sensors]
    return {"heads": heads, "rows": rows, "seconds": truth.seconds, "lash": lash_sentence(truth)}


# --- Figure of the response error when one value is wrong: how accurately each must be known.


@dataclass(frozen=True)
class Wrong:
    """A wrong value: its name, its deviation, the response error it causes (None: unknown), stability, margin."""

    name: str
    off: str
    error: float | None
    stable: bool
    margin: float | None = None


def robustness_figure(rows: Sequence[Wrong], error: float, most: int = 14) -> Figure:
    """Bars from the error as matched to the error with one value wrong, the largest on top; unstable ones hatched."""
    names = list(dict.fromkeys(row.name for row in rows))
    worst = {name: max(_rank(row, error) for row in rows if row.name == name) for name in names}
    names = sorted(names, key=lambda name: -worst[name])[:most]
    with styled():
        fig = figure(12.4, 1.3 + 0.34 * max(len(names), 1))
        axes = fig.subplots()
        top = max([error, *(row.error for row in rows if row.error is not None and row.stable)]) * 1.25
        for place, name in enumerate(names):
            pair = sorted((row for row in rows if row.name == name), key=lambda row: row.off.startswith("+"))
            step = 0.8 / len(pair)
            for k, row in enumerate(pair):
                at = place + (k - (len(pair) - 1) / 2) * step
                unusable = not row.stable or row.error is None
                reach = top if unusable or row.error is None else min(row.error, top)
                axes.barh(
                    at, reach - error, left=error, height=0.9 * step,
                    color="white" if unusable else _TINTS[k % len(_TINTS)],
                    edgecolor=RIG if unusable else "#333333", linewidth=0.7, hatch="////" if unusable else None,
                )  # fmt: skip
                said = f"{row.off}: {'unstable' if not row.stable else number(row.error, 2)}"
                axes.annotate(said, (reach, at), (4, 0), textcoords="offset points", va="center", fontsize=8)
        axes.axvline(error, color=LIMIT, linestyle="--", linewidth=1.2)
        axes.set_yticks(range(len(names)), names, fontsize=8)
        axes.set_ylim(len(names) - 0.4, -0.6)
        axes.set_xlim(0, top * 1.12)
        axes.grid(False, axis="y")
        axes.set_xlabel(f"Response error with one value wrong (dashed: as matched, {number(error, 2)})")
    return fig


_TINTS = (MATCHED, "#99D8C7")


def _rank(row: Wrong, error: float) -> float:
    return float("inf") if not row.stable or row.error is None else abs(row.error - error)


# --- The simulated manoeuvre over time: vehicle, rig without control and matched rig.

CLOSE_UP_S = 1.2  # after the beginning: some periods of a shuffle
NEAR_LIMIT = 0.6  # share of a limit from which it is drawn


@dataclass(frozen=True)
class Signal:
    """One quantity over time.

    Attributes
    ----------
    title, label : str
        What it is; quantity and unit for the axis.
    time : ndarray (t,)
        s.
    curves : mapping of str to ndarray (t,)
        By system: ``vehicle``, ``rig``, ``matched``, ``unmeasured``.
    limit : float, optional
        Largest amount allowed.
    """

    title: str
    label: str
    time: np.ndarray
    curves: Mapping[str, np.ndarray]
    limit: float | None = None


def trace_figure(signals: Sequence[Signal], begins: float) -> Figure:
    """Every signal over time: the whole manoeuvre on the left, a close-up of its beginning (s) on the right."""
    with styled():
        fig = figure(12.4, 0.7 + 1.75 * len(signals))
        rows = fig.subplots(len(signals), 2, squeeze=False, sharex="col", width_ratios=[1.5, 1])
        for (whole, close), signal in zip(rows, signals):
            trace(whole, signal)
            trace(close, signal, (begins - 0.1, begins + CLOSE_UP_S))
            close.set_ylabel("")
        for axes in rows[-1]:
            axes.set_xlabel("Time in s")
        first = max(range(len(signals)), key=lambda i: len(signals[i].curves))
        legend_above(fig, rows[first, 0])
    return fig


def trace(axes: Any, signal: Signal, window: tuple[float, float] | None = None) -> None:
    """One signal, within a window (s) if there is one, and its peak as a share of its limit."""
    inside = np.ones(len(signal.time), bool)
    if window is not None:
        inside = (signal.time >= window[0]) & (signal.time <= window[1])
    time = signal.time[inside]
    for name, values in signal.curves.items():
        axes.plot(*decimated(time, values[inside]), **LINES[name])
    axes.set_xlim(time[0], time[-1])
    axes.set_ylabel(signal.label)
    axes.set_title(signal.title, fontsize=9)
    relevant = [values for name, values in signal.curves.items() if name != "rig"] or list(signal.curves.values())
    low, high = min(values[inside].min() for values in relevant), max(values[inside].max() for values in relevant)
    room = 0.08 * (high - low) or 1.0
    axes.set_ylim(low - room, high + room)  # a rig without control may leave the picture
    if signal.limit is None or window is not None:
        return
    share = max(float(np.abs(values).max()) for values in relevant) / signal.limit
    axes.annotate(
        f"peak {100 * share:.0f} % of the limit", (0.98, 0.04), xycoords="axes fraction", fontsize=8, ha="right"
    )
    if share > NEAR_LIMIT:
        for side in (-signal.limit, signal.limit):
            axes.axhline(side, color=LIMIT, linestyle="--", linewidth=1.2)
        axes.set_ylim(*_reaching(low - room, high + room, signal.limit))


def _reaching(low: float, high: float, limit: float) -> tuple[float, float]:
    """The range, widened to the limits that the signal comes near."""
    return (-1.08 * limit if low < -NEAR_LIMIT * limit else low, 1.08 * limit if high > NEAR_LIMIT * limit else high)


# --- Results of the verification of a match, in the form that figures, page and text use.

IDENTIFIED_WITHIN_PERCENT = 2  # of the vehicle's frequency; the identification itself is good to about 0.1 %
ROUNDING = 1e-6  # relative, by which a solution at a limit may miss it
PEAK_UNITS = {"torque": "N*m", "speed": "rad/s", "power": "W", "twist": "rad", "torque_over_speed": "1"}


@dataclass(frozen=True)
class Need:
    """Peak of a quantity in the manoeuvre, SI; ``limit`` is None where the case sets none."""

    what: str
    peak: float
    limit: float | None
    unit: str


@dataclass(frozen=True)
class ResultCheck:
    """One check of the result: what was checked, the outcome, whether it passed."""

    what: str
    outcome: str
    holds: bool


def signals(result: MatchResult) -> list[Signal]:
    """The simulated manoeuvre: compared sensors, then the dynamometers; empty where the motion diverged."""
    traces = result.verification.traces
    if traces is None:
        return []
    by_name = {sensor.name: sensor for sensor in result.case.vehicle.sensors}
    drawn = []
    for name in dict.fromkeys(pair.sensor for pair in result.case.compared):
        sources: Mapping[str, Any] = {"vehicle": traces.vehicle, "rig": traces.rig, "matched": traces.matched}
        curves = {who: readings[name] for who, readings in sources.items() if name in readings}
        sensor = by_name[name]
        label = f"{sensor.measures.capitalize()} in {unit(sensor.unit)}"
        drawn.append(Signal(name.replace("_", " ").capitalize(), label, traces.time, curves))
    for dyno in result.case.loop.dynamometers:
        for what in ("torque", "speed"):
            limit = result.case.limits.get(f"dynamometer_{what}")
            curves = {"matched": traces.matched[f"dynamometers.{dyno.name}.{what}"]}
            label = f"{what.capitalize()} in {unit(PEAK_UNITS[what])}"
            drawn.append(Signal(f"Dynamometer {dyno.name}, {what}", label, traces.time, curves, limit))
    return drawn


def in_time_signals(result: MatchResult) -> list[Signal]:
    """The compared sensors of the worst bed with everything wrong, beside its vehicle."""
    traces = result.in_time.traces
    if traces is None:
        return []
    by_name = {sensor.name: sensor for sensor in result.case.vehicle.sensors}
    drawn = []
    for name in result.in_time.sensors:
        sensor = by_name[name]
        curves = {"vehicle": traces.vehicle[name], "matched": traces.measured[name]}
        curves["unmeasured"] = traces.unmeasured[name]
        label = f"{sensor.measures.capitalize()} in {unit(sensor.unit)}"
        drawn.append(Signal(name.replace("_", " ").capitalize(), label, traces.time, curves))
    return drawn


def wrong_values(result: MatchResult) -> list[Wrong]:
    """The effect of single wrong values."""
    return [
        Wrong(wrong.name, _deviation(wrong), wrong.response_error, wrong.stable, wrong.modulus_margin)
        for wrong in result.verification.robustness
    ]


def needs(result: MatchResult) -> list[Need]:
    """Peaks of the manoeuvre: dynamometers, and shafts with a limit."""
    limits, peaks = result.case.limits, []
    for name, peak in result.verification.peaks.items():
        what = name.rsplit(".", 1)[1]
        is_dyno = name.startswith("dynamometers.")
        limit = limits.get(f"dynamometer_{what}" if is_dyno else name)
        if is_dyno or limit is not None:
            peaks.append(Need(name, peak, limit, PEAK_UNITS[what]))
    return peaks


def margin_counted_from(verification: Verification) -> str:
    """From where on the modulus margin counts, and what it is below; nothing where it counts everywhere."""
    if not verification.margin_from > 0:
        return ""
    return f" from {number(verification.margin_from, 3)} Hz on"


def checks(result: MatchResult) -> list[ResultCheck]:
    """Every check with its outcome, stability first."""
    verification = result.verification
    rows = [ResultCheck(*_in_words(name, verification), holds) for name, holds in verification.checks.items()]
    limits = result.case.limits
    margin, (least, at) = verification.modulus_margin, verification.least_damping
    rows.append(
        ResultCheck(
            "Modulus margin of the feedback loop",
            f"{number(margin, 3)} at {number(verification.loop.margin_at, 3)} Hz, "
            f"at least {number(limits['modulus_margin'])} required{margin_counted_from(verification)}",
            margin >= limits["modulus_margin"] * (1 - ROUNDING),
        )
    )
    rows.append(
        ResultCheck(
            "Smallest damping ratio of any mode of the loop",
            f"{number(least, 3)} at {number(at, 3)} Hz, at least {number(limits['damping_ratio'])} required",
            least >= limits["damping_ratio"] * (1 - ROUNDING),
        )
    )
    for target in result.targets:
        rows.append(
            ResultCheck(f"Mode {target.vehicle_mode} identified from the simulated manoeuvre", *_identified(target))
        )
    exceeded = [row for row in verification.violations if row.limit not in ("modulus_margin", "damping_ratio")]
    for violation in exceeded:
        si = PEAK_UNITS[violation.where.rsplit(".", 1)[1]]
        outcome = f"{practical(violation.value, si)}, {practical(violation.allowed, si)} allowed"
        rows.append(ResultCheck(f"Limit of {violation.where}", outcome, False))
    if not exceeded:
        rows.append(ResultCheck("Torque, twist, speed and power limits over the manoeuvre", "kept", True))
    return rows


def _identified(target: TargetResult) -> tuple[str, bool]:
    """Outcome of a mode's identification from the simulation, and whether it lies near enough to the vehicle's."""
    if target.identified is None:
        return "not identified", False
    deviation = round(100 * (target.identified / target.vehicle - 1), 2) + 0.0
    return f"{hertz(target.identified)} Hz, {deviation:+.2f} % from the vehicle", abs(
        deviation
    ) <= IDENTIFIED_WITHIN_PERCENT


def _in_words(name: str, verification: Verification) -> tuple[str, str]:
    """A check of the verification in words, and its outcome."""
    if name == "sampled loop":
        return (
            "Poles of the sampled loop",
            f"largest magnitude {number(max(abs(verification.poles)), 5)}, below 1 is stable",
        )
    if name == "feed-forward poles":
        return "Poles of the model that runs on known torques", (
            f"largest magnitude {number(max(abs(verification.own_poles)), 5)}, below 1 is stable"
        )
    if name == "simulation":
        outcome = "diverges" if verification.traces is None else "stays bounded"
        return "Simulated manoeuvre with delay line and sampled controller", outcome
    return name.capitalize(), ""


def _deviation(wrong: Any) -> str:
    """The wrong value's deviation: relative, of the dead time in ms."""
    is_time = wrong.name == "loop.dead_time"
    text = practical(wrong.change, "s", 2) if is_time else f"{number(100 * wrong.change, 2)} %"
    return f"+{text}" if wrong.change > 0 else text


# --- The XiL fidelity of a match (Eqs. 14 to 23), for page and text.

COMPARED = {
    "R_SD": "torque and speed at every cut, rig against vehicle",
    "R_RVM": "sensors of the residual vehicle, driven by the rig's torques, against those of the vehicle",
    "R_MU": "uncertainty of the dynamometers' sensors over the range of the manoeuvre",
}


def fidelity_rows(fidelity: Mapping[str, Any]) -> dict[str, Any]:
    """Rows of the table: name, before, after, weight, what is compared."""
    before, after = fidelity["before"], fidelity["after"]
    rows = [
        {"name": f"R<sub>{name[2:]}</sub>", "before": percent(before[name]), "after": percent(after[name]),
         "weight": f"{fidelity['weights'][name]:.2g}", "what": what}
        for name, what in COMPARED.items()
    ]  # fmt: skip
    total = {"name": "<b>R<sub>XiL</sub></b>", "weight": "1", "what": "total (Eq. 16)"}
    total |= {key: f"{percent(values['R_XiL'])} ± {percent(2 * values['standard_uncertainty'])}"
              for key, values in (("before", before), ("after", after))}  # fmt: skip
    return {"rows": [*rows, total], "f_max": fidelity["f_max"], "notes": fidelity["notes"]}


def fidelity_line(fidelity: Mapping[str, Any]) -> str:
    """One line for a terminal."""
    before, after = fidelity["before"], fidelity["after"]
    parts = ", ".join(f"{name} {percent(after[name])}" for name in COMPARED if after[name] is not None)
    return f"fidelity R_XiL {percent(before['R_XiL'])} without control, {percent(after['R_XiL'])} matched ({parts})"


# --- Frequencies and energy shares of vehicle, rig without control and matched rig, as the paper's Fig. 3 shows them.

MODES_HIGHEST_HZ = 1000.0  # above are poles of lags and of the dead time, which are no modes of the drivetrain


def match_modes_figure(result: MatchResult) -> Figure:
    """Three columns, three rows: frequencies, kinetic and potential shares of the target modes."""
    return energy_figure(columns(result))


def columns(result: MatchResult) -> list[Column]:
    """Vehicle, rig without control and matched rig with the target modes; a system without modes is left out."""
    # modes of the feed-forward: what the matched rig shows for measured torques
    measured = [mode for mode in result.matched_modes if mode.belongs_to == "feed_forward"]
    matched = [mode_of(mode) for mode in measured or result.matched_modes]
    drawn = []
    for title, colour, modes, aims in (
        ("Vehicle", VEHICLE, result.vehicle_modes, [target.vehicle for target in result.targets]),
        ("Rig without control", RIG, result.rig_modes, [target.rig for target in result.targets]),
        ("Matched rig", MATCHED, matched, [target.matched for target in result.targets]),
    ):
        shown = [
            nearest(modes, aim, target.symmetry)
            for aim, target in zip(aims, result.targets, strict=True)
            if aim is not None
        ]
        numbers = tuple(dict.fromkeys(mode.number for mode in shown if mode is not None))
        low = [mode for mode in modes if mode.frequency <= MODES_HIGHEST_HZ]
        if not numbers:
            title += ", no target mode found: its first modes"
        if low:
            drawn.append(Column(title, colour, low, numbers))
    return drawn


def mode_of(mode: LoopMode) -> Mode:
    """A mode of the closed loop as one of a drivetrain, to be drawn beside those of vehicle and rig."""
    keys = ("number", "frequency", "damping_ratio", "symmetry", "kinetic", "potential")
    return Mode(**{key: getattr(mode, key) for key in keys})


def nearest(modes: Sequence[Mode], frequency: float, symmetry: str) -> Mode | None:
    """The mode of a symmetry whose frequency lies nearest to a frequency in Hz."""
    alike = [
        mode for mode in modes if mode.symmetry == symmetry and mode.kinetic and 0 < mode.frequency <= MODES_HIGHEST_HZ
    ]
    return min(alike, key=lambda mode: abs(mode.frequency - frequency), default=None)


# --- Frequency responses of the compared functions: vehicle, rig without control and matched rig, with band and error.

_ACROSS = 3


def response_figure(result: MatchResult) -> Figure:
    """Magnitude over phase for every compared function, three functions side by side."""
    compared = result.case.compared
    across = min(len(compared), _ACROSS)
    down = -(-len(compared) // across)
    with styled():
        fig = figure(0.8 + 3.9 * across, 0.6 + 3.9 * down)
        cells = fig.subplots(2 * down, across, squeeze=False, sharex=True, height_ratios=[2, 1] * down)
        for number_, pair in enumerate(compared):
            row, column = divmod(number_, across)
            upper, lower = cells[2 * row, column], cells[2 * row + 1, column]
            magnitude(upper, result, number_)
            phase(lower, result, number_)
            upper.set_ylabel(magnitude_label(result, pair), fontsize=8)
            if column == 0:
                lower.set_ylabel("Phase in °", fontsize=8)
            lower.set_xlabel("Frequency in Hz" if number_ + across >= len(compared) else "")
        for spare in range(len(compared), down * across):
            row, column = divmod(spare, across)
            cells[2 * row, column].set_visible(False)
            cells[2 * row + 1, column].set_visible(False)
        legend_above(fig, cells[0, 0])
    return fig


def curves_of(result: MatchResult, index: int) -> dict[str, np.ndarray]:
    """Responses (f,) of a compared function by system; without those that have no path."""
    named = {name: getattr(result.curves, name)[:, index] for name in LINES}
    if np.array_equal(named["unmeasured"], named["matched"]):
        del named["unmeasured"]  # without feed-forward the rig reacts to all torques alike
    return {name: values for name, values in named.items() if np.isfinite(values).all()}


def magnitude(axes: Any, result: MatchResult, index: int, title: bool = True) -> None:
    """Magnitude of one compared function, with the band shaded and the error above."""
    f = result.curves.frequencies
    curves = curves_of(result, index)
    shade(axes, result.response_error.band)
    for name, values in curves.items():
        axes.plot(f, np.abs(values), **LINES[name])
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.set_xlim(f[0], f[-1])
    plain_ticks(axes.xaxis)
    axes.yaxis.set_minor_locator(NullLocator())
    axes.yaxis.set_major_locator(LogLocator(numticks=7))
    largest = max(np.abs(values).max() for values in curves.values())
    smallest = min(np.abs(values).min() for name, values in curves.items() if name in ("vehicle", "matched"))
    axes.set_ylim(smallest / 3, largest * 2)
    axes.annotate(
        _error(result, index), (0.5, 1), (0, 4), "axes fraction", textcoords="offset points", ha="center", fontsize=8
    )
    if title:
        pair = result.case.compared[index]
        axes.set_title(f"{_said(pair.input)} → {_said(pair.sensor)}", fontsize=9, pad=16)


def phase(axes: Any, result: MatchResult, index: int) -> None:
    """Phase of one compared function, shifted by multiples of 360° to lie near the vehicle's."""
    f = result.curves.frequencies
    band = result.response_error.band
    inside = (f >= band[0]) & (f <= band[1])
    shade(axes, band)
    phases = {name: np.degrees(np.unwrap(np.angle(values))) for name, values in curves_of(result, index).items()}
    for name, values in phases.items():
        turns = np.round(np.mean((values - phases["vehicle"])[inside]) / 360)
        axes.plot(f, values - 360 * turns, **LINES[name])
    axes.set_xlim(f[0], f[-1])
    axes.yaxis.set_major_locator(MultipleLocator(90 * max(1, round(np.ptp(axes.get_ylim()) / 360))))


def shade(axes: Any, band: tuple[float, float]) -> None:
    """Shade the matched band."""
    axes.axvspan(*band, color=BAND, zorder=0, linewidth=0)


def magnitude_label(result: MatchResult, pair: Compared) -> str:
    """Quantity and unit of a compared function."""
    sensor = next(part for part in result.case.vehicle.sensors if part.name == pair.sensor)
    return f"{sensor.measures.capitalize()} in {unit(SENSOR_UNITS[sensor.measures])} per N·m"


def _error(result: MatchResult, index: int) -> str:
    errors = result.response_error.functions[index]
    parts = [f"error {number(errors.after, 2)}"]
    if errors.before is not None:
        parts.append(f"without control {number(errors.before, 2)}")
    if "unmeasured" in curves_of(result, index):
        parts.append(f"not measured {number(errors.unmeasured, 2)}")
    return ", ".join(parts)


def _said(name: str) -> str:
    return name.replace("_", " ")


# --- The match at a glance: response, manoeuvre and target modes in one figure, 1200 pixels wide at 150 dpi.


def overview_figure(result: MatchResult, signals: Sequence[Signal]) -> Figure:
    """Two responses on top, one signal and the target modes below."""
    with styled():
        fig = figure(8.0, 6.6)
        cells = fig.subplots(2, 2)
        for axes, index in zip(cells[0], _telling(result)):
            magnitude(axes, result, index)
            axes.set_ylabel(magnitude_label(result, result.case.compared[index]))
            axes.set_xlabel("Frequency in Hz")
        if len(result.case.compared) == 1:
            cells[0, 1].set_visible(False)
        if signals:
            trace(cells[1, 0], _telling_signal(signals))
            begins = min(manoeuvre.at for manoeuvre in result.case.manoeuvre.values())
            cells[1, 0].set_xlim(0, min(begins + 3, cells[1, 0].get_xlim()[1]))
            cells[1, 0].set_xlabel("Time in s")
        else:
            cells[1, 0].set_visible(False)
        _targets(cells[1, 1], result)
        legend_above(fig, cells[0, 0], 4, fontsize=8)
    return fig


def _telling(result: MatchResult) -> list[int]:
    """The function whose rig is farthest off, and one without a path on the rig without control, or the next."""
    rows = result.response_error.functions
    far = max(range(len(rows)), key=lambda i: rows[i].before or 0.0)
    others = [i for i in range(len(rows)) if i != far]
    blind = [i for i in others if "rig" not in curves_of(result, i)]
    ranked = sorted(blind or others, key=lambda i: -rows[i].after)
    return [far, *ranked[:1]]


def _telling_signal(signals: Sequence[Signal]) -> Signal:
    """The first torque that vehicle and matched rig both have, else the first signal."""
    both = [signal for signal in signals if {"vehicle", "matched"} <= set(signal.curves)]
    torques = [signal for signal in both if "N·m" in signal.label]
    return (torques or both or list(signals))[0]


def _name(target: TargetResult) -> str:
    side = f", {target.symmetry}" if target.symmetry != "none" else ""
    return f"mode {target.vehicle_mode}{side}"


def _targets(axes: Any, result: MatchResult) -> None:
    places = {"vehicle": 2, "rig": 1, "matched": 0}
    colours = {"vehicle": VEHICLE, "rig": RIG, "matched": MATCHED}
    marks = "osD^v"
    for count, (target, mark) in enumerate(zip(result.targets, marks * 9)):
        frequencies = {name: getattr(target, name) for name in places}
        known = [name for name in places if frequencies[name] is not None]
        path = [frequencies[name] for name in known]
        axes.plot(path, [places[name] for name in known], color="#999999", linewidth=0.9, linestyle=":", zorder=1)
        for name in known:
            axes.plot(
                frequencies[name],
                places[name],
                mark,
                color=colours[name],
                markersize=9,
                markeredgecolor="#222222",
                zorder=3,
            )
            axes.annotate(
                f"{hertz(frequencies[name])} Hz",
                (frequencies[name], places[name]),
                (0, -18 if count % 2 else 9),
                textcoords="offset points",
                ha="center",
                fontsize=8,
            )
        axes.plot(
            [],
            [],
            mark,
            color="white",
            markeredgecolor="#222222",
            label=_name(target),
        )
    for name, place in places.items():
        if all(getattr(target, name) is None for target in result.targets):
            axes.annotate("not found", (0.5, place), xycoords=("axes fraction", "data"), ha="center", fontsize=8)
    everything = np.array(
        [value for target in result.targets for value in (target.vehicle, target.rig, target.matched) if value]
    )
    axes.set_xscale("log")
    axes.set_xlim(everything.min() / 1.8, everything.max() * 1.8)
    plain_ticks(axes.xaxis)
    axes.set_ylim(-0.9, 2.6)
    axes.set_yticks(list(places.values()), [LINES[name]["label"] for name in places])
    axes.grid(False, axis="y")
    axes.set_xlabel("Frequency of the target modes in Hz")
    axes.legend(loc="lower center", bbox_to_anchor=(0.4, 1.0), fontsize=7.5, ncols=2, borderaxespad=0.1)


# --- Figures of the tuned quantities: between their bounds with the weight on a change, and what adapters to order.

COLUMNS, PANEL_HEIGHT = 3, 2.9  # inches
LOGARITHMIC_FROM = 8.0  # largest over smallest value tried
DECADES_FROM = 1e4  # upper over lower bound: such a bar is logarithmic, or every value would stand at its lower end


def quantity_figure(result: MatchResult) -> Figure:
    """A bar from bound to bound for every quantity that was allowed to move, with start, tuned value and weight."""
    rows = result.parameters
    with styled():
        fig = figure(12.4, 1.2 + 0.36 * max(len(rows), 1))
        weighted = any(row.weight for row in rows)
        bars, *weights = fig.subplots(
            1, 1 + weighted, sharey=True, squeeze=False, width_ratios=[3.2, 1][: 1 + weighted]
        )[0]
        for place, row in enumerate(rows):
            _bar(bars, place, row)
        for axes in weights:
            _weights(axes, rows)
        bars.set_yticks(range(len(rows)), [_label(row) for row in rows], fontsize=8)
        bars.set_ylim(len(rows) - 0.4, -0.6)
        bars.set_xlim(-0.22, 1.22)
        bars.set_xticks([0, 0.5, 1], ["lower bound", "middle", "upper bound"])
        bars.grid(False, axis="y")
        handles, labels = bars.get_legend_handles_labels()
        unique = dict(zip(labels, handles))
        fig.legend(list(unique.values()), list(unique), loc="outside upper center", ncols=4)
    return fig


def _weights(axes: Any, rows: Sequence[ParameterResult]) -> None:
    for place, row in enumerate(rows):
        axes.barh(place, row.weight, height=0.5, color="#BBBBBB", edgecolor="#333333", linewidth=0.6)
        axes.annotate(
            number(row.weight, 2), (row.weight, place), (3, 0), textcoords="offset points", va="center", fontsize=8
        )
    axes.grid(False, axis="y")
    axes.set_xlabel("Weight on a change")
    axes.tick_params(left=False)
    axes.margins(x=0.2)


def _bar(axes: Any, place: int, row: ParameterResult) -> None:
    decades = row.lower > 0 and row.upper >= DECADES_FROM * row.lower

    def at(value: float) -> float:
        if decades:
            return math.log(max(value, row.lower) / row.lower) / math.log(row.upper / row.lower)
        return (value - row.lower) / (row.upper - row.lower)

    axes.barh(place, 1, height=0.34, color="#ECECEC", edgecolor="#AAAAAA", linewidth=0.6)
    axes.plot([at(row.start), at(row.tuned)], [place, place], color=MATCHED, linewidth=2.2, zorder=3)
    axes.plot(
        at(row.start),
        place,
        "|",
        color="#222222",
        markersize=12,
        markeredgewidth=1.6,
        zorder=4,
        label="start",
        linestyle="none",
    )
    marker = (
        {"label": "at a bound", "markerfacecolor": LIMIT, "marker": "s"}
        if row.at_bound
        else {"label": "tuned", "markerfacecolor": MATCHED, "marker": "D"}
    )
    if row.fixed:
        marker = {"label": "not moved, need not be identified accurately", "markerfacecolor": "white", "marker": "D"}
    axes.plot(at(row.tuned), place, markersize=6.5, markeredgecolor="#222222", zorder=5, linestyle="none", **marker)
    axes.annotate(number(row.lower, 3), (-0.025, place), va="center", ha="right", fontsize=8)
    axes.annotate(number(row.upper, 3), (1.025, place), va="center", ha="left", fontsize=8)


def _label(row: ParameterResult) -> str:
    moved = number(row.tuned) if row.fixed or row.start == row.tuned else f"{number(row.start)} → {number(row.tuned)}"
    return f"{row.name}\n{moved} {unit(row.unit)}"


def trade_figure(trades: Sequence[AdapterTrade]) -> Figure:
    """A panel a quantity: error at the values tried, value planned and ordered, the range within 2 % shaded."""
    rows = -(-len(trades) // COLUMNS)
    with styled():
        fig = figure(12.4, 0.7 + PANEL_HEIGHT * rows)
        panels = fig.subplots(rows, min(COLUMNS, len(trades)), squeeze=False).ravel()
        for axes in panels[len(trades) :]:
            axes.set_visible(False)
        for axes, trade in zip(panels, trades):
            values, errors = np.array(trade.curve).T
            axes.axvspan(*trade.acceptable, color=BAND, label="as good within 2 %")
            axes.plot(
                values,
                errors,
                "o-",
                color=MATCHED,
                markersize=3.5,
                label="response error, the rest tuned for each value",
            )
            axes.axvline(trade.planned, color=RIG, linestyle="--", label="as planned")
            axes.plot(trade.ordered, trade.error_as_ordered, "D", color=MATCHED, markersize=8, label="ordered")
            if trade.error_all_as_planned is not None:
                axes.axhline(
                    trade.error_all_as_planned,
                    color=LIMIT,
                    linestyle=":",
                    label="all adapters as planned, tuned for it",
                )
            if values.min() > 0 and values.max() > LOGARITHMIC_FROM * values.min():
                axes.set_xscale("log")
            axes.set_xlabel(f"{component(trade.name)} [{unit(trade.unit)}]")
            axes.set_title(f"ordered {number(trade.ordered)}, planned {number(trade.planned)}", fontsize=9)
        panels[0].set_ylabel("Response error, unmeasured torques")
        handles, labels = panels[0].get_legend_handles_labels()
        fig.legend(handles, labels, loc="outside upper center", ncols=5)
    return fig


# --- The response error of every compared function: rig without control, matched rig, and torque not measured.

SMALLEST_DRAWN = 1e-4  # smaller errors are drawn as this
KINDS = {"rig": ("before", "o"), "unmeasured": ("unmeasured", "D"), "matched": ("after", "s")}


def error_figure(result: MatchResult) -> Figure:
    """One row a function, on a logarithmic axis, with the errors that the case allows."""
    rows, case = result.response_error.functions, result.case
    with styled():
        fig = figure(8.0, 1.3 + 0.42 * len(rows))
        axes = fig.subplots()
        places, written = np.arange(len(rows))[::-1], set[tuple[str, int]]()
        for who, (key, mark) in KINDS.items():
            values = [getattr(row, key) for row in rows]
            known = [(value, place) for value, place in zip(values, places, strict=True) if value is not None]
            if not known or (who == "unmeasured" and values == [row.after for row in rows]):
                continue
            drawn, at = [max(value, SMALLEST_DRAWN) for value, _ in known], [place for _, place in known]
            axes.plot(drawn, at, mark, color=LINES[who]["color"], label=LINES[who]["label"], markersize=8,
                      markeredgecolor="#222222", fillstyle="none" if who == "unmeasured" else "full")  # fmt: skip
            for value, place in known:
                if (said := (number(value, 2), int(place))) in written:
                    continue
                written.add(said)
                axes.annotate(number(value, 2), (max(value, SMALLEST_DRAWN), place), (0, 6),
                              textcoords="offset points", ha="center", fontsize=7)  # fmt: skip
        for allowed, words in ((case.tolerance, "measured"), (case.unmeasured_tolerance, "unmeasured")):
            if np.isfinite(allowed):
                axes.axvline(allowed, color=LIMIT, linestyle="--", linewidth=1.2)
                axes.annotate(f"allowed, {words}", (allowed, -0.7), (2, 0), textcoords="offset points", fontsize=7,
                              rotation=90, va="bottom", color=LIMIT)  # fmt: skip
        axes.set_xscale("log")
        axes.set_ylim(-0.8, len(rows) - 0.2)
        names = [f"{spaced(pair.input)} → {spaced(pair.sensor)}" for pair in case.compared]
        axes.set_yticks(places, names)
        axes.grid(False, axis="y")
        axes.set_xlabel(f"Response error, {result.response_error.band[0]:g} to {result.response_error.band[1]:g} Hz")
        fig.legend(loc="outside upper center", ncols=3, fontsize=8)
    return fig


# --- The figures of a match, by file name, and the overview.

CAPTIONS = {
    "drivetrain": "Vehicle and rig. Dashed: the cut; hatched: the residual vehicle, which the dynamometers emulate.",
    "overview": "Response, manoeuvre and target modes at a glance.",
    "modes": "Modes and their energy. In colour: the target modes, and on the rig without control those of the same "
    "symmetry. s symmetric, a antisymmetric left to right.",
    "responses": "Frequency responses. The line of the matched rig should run inside the broad line of the vehicle; "
    "the grey band is the matched band. Dotted: the matched rig when the controller does not measure the torque.",
    "manoeuvre": "The manoeuvre, simulated with a delay line and a sampled controller.",
    "in_time": "A bed with everything wrong at once, the worst of those drawn, beside the nonlinear vehicle with the "
    "same specimen. Dotted: the controller does not measure the torque.",
    "errors": "Response error of every compared function. Dashed: what the case allows.",
    "sensitivity": "Sensitivity S and complementary sensitivity T of the feedback loop on the bed as planned. Grey: "
    "the limits, each from the frequency on from which it counts.",
    "margin": "Distance of the feedback loop from instability, with the exact dead time; grey: too near.",
    "beds": "Drawn beds: share of them whose response error is at most so large; the points are median and 95 %.",
    "quantities": "Tuned quantities between their bounds, on a logarithmic scale where these are four decades apart or "
    "more, and the weight on a change of each where one was set.",
    "trade": "What to order: the response error for unmeasured torques over each adapter quantity, the rest tuned for "
    "each value, and the range that is as good within 2 %. Dotted: what the bed as planned reaches.",
    "robustness": "How accurately each quantity must be known: response error when one value is wrong.",
}


def overview(result: MatchResult) -> Figure:
    """The match in one figure, 1200 pixels wide as PNG."""
    return overview_figure(result, signals(result))


def drawn_modes(result: MatchResult) -> list[float]:
    """Frequencies in Hz around which curves of the loop need a dense grid."""
    return [target.vehicle for target in result.targets] + [mode.frequency for mode in result.rig_modes]


def drawers(result: MatchResult) -> dict[str, Callable[[], Figure]]:
    """What draws each figure of a match, by name; those for which there is nothing to show are left out."""
    case, tuned = result.case, result.tuned
    made: dict[str, Callable[[], Figure]] = {
        "overview": lambda: overview(result),
        "modes": lambda: match_modes_figure(result),
        "responses": lambda: response_figure(result),
        "errors": lambda: error_figure(result),
    }
    begins = min((torque.at for torque in case.manoeuvre.values()), default=0.0)
    if of_manoeuvre := signals(result):
        made["manoeuvre"] = lambda: trace_figure(of_manoeuvre, begins)
    if of_worst_bed := in_time_signals(result):
        made["in_time"] = lambda: trace_figure(of_worst_bed, begins)
    frequencies = drawn_modes(result)
    required = result.verification.required
    margin_from = required.margin_from
    made["sensitivity"] = lambda: sensitivity_figure(sensitivity(tuned, frequencies, required))
    made["margin"] = lambda: margin_figure(tuned, frequencies, margin_from)
    if max(len(system.inertias) for system in (case.vehicle, case.rig)) <= MOST_INERTIAS:
        made["drivetrain"] = lambda: case_figure(tuned)
    beds = result.verification.beds
    if beds and beds.unmeasured:
        made["beds"] = lambda: beds_figure(beds, case.unmeasured_tolerance)
    if result.parameters:
        made["quantities"] = lambda: quantity_figure(result)
    if result.adapters:
        made["trade"] = lambda: trade_figure(result.adapters)
    if wrong := wrong_values(result):
        made["robustness"] = lambda: robustness_figure(wrong, result.response_error.after)
    return made


def figures(result: MatchResult) -> dict[str, Figure]:
    """All figures of a match by name."""
    return {name: draw() for name, draw in drawers(result).items()}


def drawn_figures(result: MatchResult) -> dict[str, bytes]:
    """The figures of a match as SVG, by name."""
    return {name: image(draw()) for name, draw in drawers(result).items()}


# --- What a report begins with: what to order, to enter and to watch, each with its reason.

SAME_RELATIVE = 1e-9  # values that differ by no more count as equal
MOST_POINTS = 4  # of a list on the first screen


def adapters_of(result: MatchResult) -> list[ParameterResult]:
    """Quantities of the rig that were allowed to move."""
    return [row for row in result.parameters if row.name.startswith("rig.")]


def traded_before_beds(result: MatchResult) -> bool:
    """Whether the gains were tuned over drawn beds after the adapters: errors of the trade are then not the match's."""
    after = result.response_error.unmeasured
    return any(abs(trade.error_as_ordered - after) > SAME_RELATIVE * after for trade in result.adapters)


def to_order(result: MatchResult) -> list[ScreenPoint]:
    """Adapters, and whether the dynamometers suffice."""
    adapters = adapters_of(result)
    changed = [row for row in adapters if abs(row.tuned - row.start) > SAME_RELATIVE * abs(row.start)]
    points = [
        ScreenPoint(
            f"{component(row.name)}: {amount(row.tuned, row.unit)} instead of {amount(row.start, row.unit)}",
            "at the bound that the case sets" if row.at_bound else "",
        )
        for row in changed[:MOST_POINTS]
    ]
    gain = next((trade for trade in result.adapters if trade.error_all_as_planned is not None), None)
    if changed and gain is not None and gain.error_all_as_planned is not None:
        before = ", before the gains were tuned over drawn beds" if traded_before_beds(result) else ""
        reason = (
            f"for unmeasured torques the response error is then {number(gain.error_as_ordered, 2)} instead of "
            f"{number(gain.error_all_as_planned, 2)} with the bed as planned{before}"
        )
        points[-1] = ScreenPoint(points[-1].text, "; ".join(filter(None, (points[-1].reason, reason))))
    if not points:
        helps = "no change of them helps" if adapters else "none was allowed to change"
        points = [ScreenPoint("adapters as planned", helps)]
    return [*points, *_dynamometers(result)]


def _dynamometers(result: MatchResult) -> list[ScreenPoint]:
    """Whether the dynamometers, where the case limits them, do what the manoeuvre needs."""
    shares = {
        need.what: need.peak / need.limit
        for need in needs(result)
        if need.limit and need.what.startswith("dynamometers.")
    }
    if not shares:
        return []
    most = max(shares, key=lambda what: shares[what])
    enough = "dynamometers as planned" if shares[most] <= 1 else "larger dynamometers"
    what = spaced(most.rpartition(".")[2])
    return [
        ScreenPoint(
            enough, f"the manoeuvre takes {percent(shares[most], 0)} of their {what}, the limit that it comes nearest"
        )
    ]


def to_enter(result: MatchResult) -> list[ScreenPoint]:
    """The controller's values, each with what it is."""
    loop = result.tuned.loop
    return [
        ScreenPoint(f"{spaced(name)} {amount(loop[name], known.unit, 5)}", known.meaning)
        for name, known in loop.structure.quantities.items()
    ]


def why_these_values(result: MatchResult) -> str:
    """What the values to enter are the best of."""
    limits, band = result.case.limits, result.response_error.band
    margin = f"the modulus margin stays above {number(limits['modulus_margin'], 3)}"
    if result.verification.beds and result.case.loop.structure.is_observer:
        drawn = result.verification.beds.drawn
        return (
            f"Tuned for the least response error to unmeasured torques, {number(band[0])} to {number(band[1])} Hz, "
            f"over beds drawn within [uncertainty]; {margin} above the emulated band, the loop rolls off, and sensor "
            f"noise stays within its limit. Judged on {drawn} fresh beds."
        )
    counted_from = result.verification.margin_from
    counted = f" from {number(counted_from, 3)} Hz on" if counted_from > 0 else ""
    return f"Tuned for the least response error, {number(band[0])} to {number(band[1])} Hz, while {margin}{counted}."


def measured_inputs(result: MatchResult) -> list[str]:
    """Compared inputs whose torque the controller takes as measured."""
    loop = result.tuned.loop
    simulated = [source.name for part in result.tuned.residual_vehicle.parts for source in part.inputs]
    measured = loop.structure.measured_inputs(loop.measured, simulated)
    return [name for name in dict.fromkeys(pair.input for pair in result.case.compared) if name in measured]


def to_watch(result: MatchResult) -> list[ScreenPoint]:
    """What limits the match or may spoil it, most important first."""
    points = [ScreenPoint(limit) for limit in result.limits[1:]]
    points += [ScreenPoint(f"check failed: {check.what}", check.outcome) for check in checks(result) if not check.holds]
    points += _of_beds(result)
    error = result.response_error
    if measured_inputs(result):
        points.append(
            ScreenPoint(
                f"response error {number(error.after, 2)} for measured torques, {number(error.unmeasured, 2)} for "
                "unmeasured ones",
                "an unmeasured torque is known only by what it does"
                + (", as the observer estimates it" * result.case.loop.structure.is_observer),
            )
        )
    wrong = wrong_values(result)
    unstable = [f"{row.name} {row.off}" for row in wrong if not row.stable]
    if unstable:
        points.append(
            ScreenPoint(f"the loop becomes unstable with {sentence(unstable[:MOST_POINTS])}", "the rest as planned")
        )
    known = [row for row in wrong if row.stable and row.error is not None]
    worst = max(known, key=lambda row: row.error or 0.0, default=None)
    if worst is not None and (worst.error or 0.0) > error.after:
        reason = f"{worst.off} makes the response error {number(worst.error, 2)}, more than any other quantity does"
        points.append(ScreenPoint(f"{component(worst.name)} must be known best", reason))
    return points[:MOST_POINTS] or [ScreenPoint("nothing", "every check passed")]


def _of_beds(result: MatchResult) -> list[ScreenPoint]:
    """The worst bed of the box, where it is damped by less than is required."""
    beds = result.verification.beds
    if beds is None or beds.worst is None or not 0 < beds.worst.damping_ratio < beds.required_damping:
        return []
    return [
        ScreenPoint(
            f"the worst bed within [uncertainty] is stable with a least damping ratio of "
            f"{number(beds.worst.damping_ratio, 2)}, {number(beds.required_damping, 2)} is required",
            f"it depends most on {sentence([component(name) for name in beds.worst.named])}",
        )
    ]


# --- A match in words, from the content of ``result.json``: one sentence, and at most twenty lines for a terminal.

MOST_LINES, MOST_TARGETS, MOST_NEEDS, MOST_NAMES = 19, 4, 4, 3  # of the summary for a terminal

BELOW = 0.99  # of the lower bound: an error below it by more than rounding


def content(result: MatchResult) -> dict[str, Any]:
    """The content of ``result.json``: the result, what was ``asked`` for, what the manoeuvre ``needs``."""
    entries = result.to_dict()
    if not math.isfinite(result.objective):  # no start ended within the limits
        entries["objective"] = None
    return entries | {"asked": dict(result.case.limits), "needs": [vars(need) for need in needs(result)]}


def answer(result: Mapping[str, Any]) -> str:
    """The answer in one sentence."""
    error = result["response_error"]
    before, after = error["before"], number(error["after"], 2)
    fall = f"is {after}" if before is None else f"falls from {number(before, 2)} to {after}"
    if result["status"] == "matched":
        frequencies = sentence([f"{hertz(target['vehicle'])} Hz" for target in result["targets"]])
        mode = "mode" if len(result["targets"]) == 1 else "modes"
        return (
            f"The rig reproduces the vehicle's response: it has the target {mode} at {frequencies} within tolerance, "
            f"and its response error over {_band(error)} {fall}."
        )
    first = result["limits"][0] if result["limits"] else "a check fails"
    first = first[:1].lower() + first[1:] if first[1:2].islower() else first
    return f"The rig cannot reproduce the vehicle's response within these bounds: {first.rstrip('.')}."


def summary(result: Mapping[str, Any]) -> str:
    """The result for a terminal, at most nineteen lines: the answer, what limits it, targets and errors, what moved."""
    head = [f"{result['status'].upper()}  {result.get('title', '')}".rstrip(), answer(result)]
    head += [f"also: {limit}" for limit in result["limits"][1:3]]
    body = [_target(target) for target in result["targets"][:MOST_TARGETS]]
    body += [_errors(result), *_fidelity(result), _loop(result), *_beds(result), *in_time_lines(result)]
    body += [operating_point(result), *_needed(result.get("needs", []))[:MOST_NEEDS]]
    tail = _not_moved(result["parameters"])
    moved = [row for row in result["parameters"] if not row["fixed"] and row["tuned"] != row["start"]]
    moved.sort(key=lambda row: -abs(row["tuned"] - row["start"]) / (row["upper"] - row["lower"]))
    room = max(1, MOST_LINES - len(head) - len(body) - len(tail))
    of_checks = result.get("verification", {}).get("notes", [])
    notes = [f"note: {note}" for note in result.get("notes", []) if note not in of_checks]  # where there is room
    return "\n".join([*head, *body, *_all_moved(moved, room), *tail, *notes][:MOST_LINES])


def _band(error: Mapping[str, Any]) -> str:
    return f"{number(error['band'][0])}–{number(error['band'][1])} Hz"


def _errors(result: Mapping[str, Any]) -> str:
    error = result["response_error"]
    before = "" if error["before"] is None else f", rig without control {number(error['before'], 3)}"
    unmeasured = f"; {number(error['unmeasured_after'], 3)} for an unmeasured torque"
    if error.get("unmeasured_bound") is not None:
        unmeasured += f" ({number(error['unmeasured_bound'], 2)} with an ideal estimator on these sensors)"
    structure = STRUCTURES[result["structure"]]
    if not structure.has_feed_forward and not structure.is_observer:  # the same for all torques
        unmeasured = ""
    below = ""
    if error["after"] < BELOW * error["bound"]:
        below = " (of torques that step; the match is below it within its band)"
    return (
        f"response error {_band(error)}: {number(error['after'], 3)} matched{before}{unmeasured}; lower bound set by "
        f"the dead time{below} {number(error['bound'], 2)} as sampled, {number(error['bound_unsampled'], 2)} without "
        "sampling"
    )


def _fidelity(result: Mapping[str, Any]) -> list[str]:
    fidelity = result.get("fidelity")
    return [fidelity_line(fidelity)] if fidelity else []


def _loop(result: Mapping[str, Any]) -> str:
    limits = result.get("asked", {})
    required = f" (required {number(limits['modulus_margin'], 3)})" if "modulus_margin" in limits else ""
    counted_from = result.get("modulus_margin_from", 0.0)
    counted = f" from {number(counted_from, 3)} Hz on" if counted_from > 0 else ""
    return (
        f"loop {'stable' if result['stable'] else 'NOT STABLE'}, modulus margin {number(result['modulus_margin'], 3)}"
        f"{counted}{required}, slowest pole {number(result['spectral_abscissa'], 3)} 1/s"
    )


def operating_point(result: Mapping[str, Any]) -> str:
    """The steady motion from which the manoeuvre begins, in one line."""
    speeds, torques = result.get("operating_point", {}), result.get("operating_torques", {})
    if not any(speeds.values()):
        return "operating point: none stated, standstill assumed; torques, speeds and powers count from there"
    turning = [f"{spaced(name)} {practical(speed, 'rad/s', 4)}" for name, speed in speeds.items()]
    driven = [f"{spaced(name)} {practical(torque, 'N*m')}" for name, torque in torques.items()]
    return f"operating point: {sentence(_ends(turning))}; {sentence(_ends(driven))}"


def _ends(parts: list[str]) -> list[str]:
    """The first, and as many of the last as the rest of a line takes: drive first, dynamometers last."""
    return parts if len(parts) <= MOST_NAMES else [parts[0], *parts[1 - MOST_NAMES :]]


def _beds(result: Mapping[str, Any]) -> list[str]:
    """What drawn beds and sensor noise do under an observer; nothing for feedback laws."""
    beds, margin = result.get("beds"), result.get("margin")
    if not beds or not margin or not beds["drawn"]:
        return []
    noise = max(result["command_noise"].values())
    return [
        f"{beds['stable']} of {beds['drawn']} beds drawn within [uncertainty] stable, least damping ratio "
        f"{number(beds['smallest_damping_ratio'], 3)} (required {number(beds['required_damping_ratio'], 3)}"
        f"{_of_its_own(beds)}{_worst(beds.get('worst'))}); their "
        f"response error: measured torques {_spread(beds, 'error')}, unmeasured {_spread(beds, 'unmeasured')}"
        f"{_largest(beds.get('largest_error'))}{_simulated(result)}",
        f"modulus margin {number(margin['modulus'], 3)} from {number(margin['from'], 3)} Hz on, |T| at most "
        f"{number(margin['largest_rolled_off'], 3)} from {number(margin['rolled_off_from'], 3)} Hz on, sensor noise "
        f"makes {number(noise, 3)} N·m rms of command",
    ]


def _of_its_own(beds: Mapping[str, Any]) -> str:
    """Why beds count as damped with a mode that has less than is required."""
    if beds["damped"] < beds["drawn"] or beds["smallest_damping_ratio"] >= beds["required_damping_ratio"]:
        return ""
    return "; less is a mode of the bed's own beyond the roll-off"


def _simulated(result: Mapping[str, Any]) -> str:
    """What the beds' errors count otherwise than that of the bed as planned; nothing without a feed-forward."""
    functions = result["response_error"].get("functions", ())
    with_two_errors = any(row["before"] is None and row["unmeasured"] != row["after"] for row in functions)
    if not STRUCTURES[result["structure"]].has_feed_forward or not with_two_errors:
        return ""
    return " (torques inside the residual vehicle count as measured on the beds, as unmeasured in the error above)"


def _worst(worst: Mapping[str, Any] | None) -> str:
    return "" if worst is None else f"; of the worst bed of the box {number(worst['damping_ratio'], 3)}"


def _largest(largest: Mapping[str, Any] | None) -> str:
    return "" if largest is None else f", largest found in the box {number(largest['unmeasured'], 3)}"


def _spread(beds: Mapping[str, Any], name: str) -> str:
    return f"{number(beds[f'{name}_median'], 3)} (median) and {number(beds[f'{name}_95'], 3)} (95 %)"


def _needed(rows: list[Mapping[str, Any]]) -> list[str]:
    """One line for each dynamometer and shaft."""
    by_component: dict[str, list[str]] = {}
    for need in rows:
        limit = f" of {practical(need['limit'], need['unit'])}" if need["limit"] else ""
        name = component(need["what"].rsplit(".", 1)[0])
        share = need["what"].endswith(".torque_over_speed")
        peak = (
            f"{percent(need['peak'], 0)} of its torque at its speed" if share else practical(need["peak"], need["unit"])
        )
        by_component.setdefault(name, []).append(peak if share else peak + limit)
    return [f"{name} needs {sentence(parts)}" for name, parts in by_component.items()]


def _not_moved(parameters: list[Mapping[str, Any]]) -> list[str]:
    names = [component(row["name"]) for row in parameters if row["fixed"]]
    more = f" and {len(names) - MOST_NAMES} more" if len(names) > MOST_NAMES else ""
    return [f"need not be identified accurately: {'; '.join(names[:MOST_NAMES])}{more}"] if names else []


def _target(target: Mapping[str, Any]) -> str:
    side = target["symmetry"].replace("none", "")
    return (
        f"mode {target['vehicle_mode']:<3}{side:13} vehicle {hertz(target['vehicle'])} Hz, "
        f"rig {hertz(target['rig'])}, matched {hertz(target['matched'])}, "
        f"from simulation {hertz(target['seen_in_simulation'])}: {'met' if target['met'] else 'NOT MET'}"
    )


def _all_moved(rows: list[Mapping[str, Any]], room: int) -> list[str]:
    """A line for each quantity that moved; those for which there is no room in one line."""
    if len(rows) <= room:
        return [_moved(row) for row in rows]
    rest = [f"{row['name']} {number(row['tuned'])} {unit(row['unit'])}".rstrip() for row in rows[room - 1 :]]
    return [*(_moved(row) for row in rows[: room - 1]), f"also moved: {', '.join(rest)}"]


def _moved(row: Mapping[str, Any]) -> str:
    remarks = [change(row["start"], row["tuned"]), "at its bound" if row["at_bound"] else ""]
    moved = f"{row['name']}: {number(row['start'])} → {number(row['tuned'])} {unit(row['unit'])}".rstrip()
    return f"{moved} ({', '.join(filter(None, remarks))})" if any(remarks) else moved


# --- The report of a match: one HTML page that opens anywhere, without network.

DEAD_TIME = (
    "A command acts one dead time after it is given, so a controller can only act on what it predicts for that time; a "
    "torque that steps at an unforeseeable moment is always answered late. The lower bound is the error of the best "
    "command that knows every state and every measured torque but nothing of the future. It is the best over all "
    "frequencies, for torques that step; within a band alone a controller can be below it."
)
NEAR_BEST = 0.01  # relative: starts that end this near to the best objective count as agreeing


def page(
    result: MatchResult,
    images: Mapping[str, bytes],
    made: Provenance | None = None,
    moving: Mapping[str, str] | None = None,
    data: Mapping[str, str] | None = None,
) -> str:
    """The page as HTML.

    Parameters
    ----------
    result : MatchResult
    images : mapping of str to bytes
        Figures by the names of :func:`matching.report.match.figures`, as SVG or PNG.
    made : Provenance, optional
        What the result was made from; without it the page does not say.
    moving : mapping of str to str, optional
        Figures that act, as :func:`matching.report.curves.moving_figures` has them.
    data : mapping of str to str, optional
        CSV of the curves by the name of their figure.
    """
    values = context(result, images) | {"made": made, "moving": moving or {}, "data": _addresses(data or {})}
    return environment().get_template("match.html").render(values)


def _addresses(data: Mapping[str, str]) -> dict[str, str]:
    """Tables as addresses from which a browser saves them."""
    return {name: in_address(text, "text/csv") for name, text in data.items()}


def summary_html(result: MatchResult) -> str:
    """Answer and targets for a notebook."""
    template = (
        "<p><b>{{ status }}</b>: {{ answer }}</p>"
        "<table><tr><th>mode</th><th>vehicle</th><th>rig</th><th>matched</th></tr>"
        "{% for row in targets %}<tr><td>{{ row.vehicle_mode }}</td><td>{{ row.vehicle|hertz }} Hz</td>"
        "<td>{{ row.rig|hertz }} Hz</td><td>{{ row.matched|hertz }} Hz</td></tr>{% endfor %}</table>"
    )
    values = {"status": result.status, "answer": answer(content(result)), "targets": result.targets}
    return environment().from_string(template).render(values)


def context(result: MatchResult, images: Mapping[str, bytes]) -> dict[str, Any]:
    """Values of the template."""
    tuned, error, residual = result.tuned, result.response_error, _residual(result)
    return {
        "title": result.case.title or "Match of a test bed to a vehicle",
        "status": result.status,
        "answer": answer(content(result)),
        "limits": result.limits,
        "notes": result.notes,
        "targets": result.targets,
        "error": error,
        "band": f"{number(error.band[0])}–{number(error.band[1])} Hz",
        "measured_note": _measured_note(result),
        "fidelity": fidelity_rows(result.fidelity.to_dict()) if result.fidelity else None,
        "in_time": in_time_table(result.in_time) if result.in_time.rows else None,
        "explanations": [*_explanations(result), DEAD_TIME],
        "adapters": [row.to_dict() | {"change": change(row.start, row.tuned)} for row in adapters_of(result)],
        "trades": {trade.name: trade for trade in result.adapters},
        "trades_before_beds": traded_before_beds(result),
        "to_order": to_order(result),
        "to_enter": to_enter(result),
        "why_these_values": why_these_values(result),
        "to_watch": to_watch(result),
        "needs": needs(result),
        "operating_point": operating_point(content(result)),
        "manoeuvre": sentence([_manoeuvre(name, torque) for name, torque in tuned.manoeuvre.items()]),
        "structure": tuned.loop.structure.name,
        "requirements": requirement_rows(result.robust) if result.robust else [],
        "bed_errors": error_rows(result.robust) if result.robust else [],
        "unmeasured_note": "estimated by the observer" if tuned.loop.structure.is_observer else "feedback alone",
        "has_feed_forward": tuned.loop.structure.has_feed_forward,
        **_loop_rows(result),
        "residual": residual,
        "own_residual": result.simple_vehicle is not None,
        "opened_shafts": _opened_shafts(result),
        "diagram": block_diagram(tuned.loop, _entries(residual)),
        "fixed": [row for row in result.parameters if row.fixed],
        "checks": checks(result),
        "search": _search(result),
        "animations": _animations(result),
        "figures": {name: embedded(image) for name, image in images.items()},
        "captions": CAPTIONS,
        **_equations(result),
    }


def _animations(result: MatchResult) -> list[str]:
    """Target modes of the vehicle, and the nearest modes of the rig without control, as moving drawings."""
    drawings = []
    for target in result.targets:
        of_vehicle = next(mode for mode in result.vehicle_modes if mode.number == target.vehicle_mode)
        of_rig = None if target.rig is None else nearest(result.rig_modes, target.rig, of_vehicle.symmetry)
        pairs = [("Vehicle", of_vehicle, VEHICLE), ("Rig", of_rig, RIG)]
        drawings += [ModeAnimation(mode, colour, title).svg for title, mode, colour in pairs if mode and mode.shape]
    return drawings


def _measured_note(result: MatchResult) -> str:
    names = measured_inputs(result)
    return f"{sentence([name.replace('_', ' ') for name in names])} measured" if names else "feedback alone"


def _explanations(result: MatchResult) -> list[str]:
    names = measured_inputs(result)
    error = result.response_error
    if not names:
        return ["No torque is measured for a feed-forward: these errors are those of feedback alone."]
    reaction = "by what its observer estimates" if result.tuned.loop.structure.is_observer else "by feedback alone"
    return [
        f"Measured torques ({sentence([name.replace('_', ' ') for name in names])}) reach the feed-forward, "
        f"a model of rig and vehicle that predicts across the dead time: error {number(error.after, 3)}. "
        "To an unmeasured torque, such as a brake on the shaft or a torque the model lacks, the rig reacts "
        f"{reaction}: error {number(error.unmeasured, 3)}. Both errors are true of this rig; which one counts "
        "depends on where the torque comes from."
    ]


def _loop_rows(result: MatchResult) -> dict[str, Any]:
    loop = result.tuned.loop

    def rows(table: Mapping[str, Any]) -> list[dict[str, Any]]:
        return [
            {"name": f"loop.{name}", "value": loop[name], "unit": knob.unit, "meaning": knob.meaning}
            for name, knob in table.items()
        ]

    return {"knobs": rows(loop.structure.quantities), "hardware": rows(HARDWARE)}


def _residual(result: MatchResult) -> list[dict[str, Any]]:
    """Rows of the residual vehicle; one of the case's own beside what its file says, else beside the vehicle."""
    simple = result.simple_vehicle
    rows = []
    for part in result.tuned.residual_vehicle.parts:
        for name, quantity in part.parameters.items():
            if simple is None:
                before = result.case.vehicle.parameters[name].value
            else:
                before, _ = simple.values.get(name, (quantity.value, quantity.value))
            if quantity.value == 0 and before == 0:
                continue
            moved = abs(quantity.value - before) > SAME_RELATIVE * abs(before)
            row = {"name": name, "value": quantity.value, "unit": part.units[name], "before": before}
            rows.append(row | {"moved": moved})
    return rows


def _entries(residual: list[dict[str, Any]]) -> list[EnteredNumber]:
    """Values of the residual vehicle for the diagram."""
    return [EnteredNumber(component(row["name"]), amount(row["value"], row["unit"], 5)) for row in residual]


def _opened_shafts(result: MatchResult) -> list[OpenedShaft]:
    """How the exported controller notices the opening of every shaft; nothing where it cannot be exported."""
    try:
        return list(exported_controller(result.tuned).shafts)
    except InputError:
        return []


def _manoeuvre(name: str, torque: Any) -> str:
    return f"{torque.words} of {number(torque.amplitude)} N·m on {name.replace('_', ' ')}"


def _search(result: MatchResult) -> str:
    if result.verification.beds and result.tuned.loop.structure.is_observer:
        return (
            "The weights of the observer were tuned over beds that fill the box of what is not known exactly; "
            f"{result.verification.beds.drawn} fresh beds judged the result."
        )
    stable = [value for value in result.starts if value is not None]
    if not stable:
        return f"None of {len(result.starts)} starts ended in a stable loop."
    best = min(stable)
    agreeing = sum(value <= best * (1 + NEAR_BEST) + 1e-12 for value in stable)
    return f"Of {len(result.starts)} starts {len(stable)} ended in a stable loop and {agreeing} within 1 % of the best."


def _equations(result: MatchResult) -> dict[str, Any]:
    systems: list[tuple[str, System]] = [("Vehicle", result.case.vehicle), ("Rig", result.case.rig)]
    repeated = () if result.simple_vehicle is not None else result.case.residual_vehicle.parts
    parts = result.case.residual_vehicle.parts
    for place, part in enumerate(parts, 1):
        systems.append(("Residual vehicle" + (f", part {place}" if len(parts) > 1 else ""), part))
    blocks = []
    for title, system in systems:
        written = equations(system)
        lines = [line for key in ("T", "V", "D", "motion") for line in written[key]]
        name = f"{title}: {system.title}" if system.title else title
        blocks.append({"title": name, "lines": lines, "repeated": any(system is part for part in repeated)})
    return {"equations": blocks, "legend": LEGEND}


# --- A match: the overview figure, the answer in words, the summary for a notebook.


@display.plot.register
def plot(result: MatchResult) -> Figure:
    """The overview figure of the report."""
    return overview(result)


@display.text.register
def said(result: MatchResult) -> str:
    """One sentence, then the most important figures."""
    return summary(content(result))


@display.html.register
def html(result: MatchResult) -> str:
    """The result as HTML for a notebook."""
    return summary_html(result)
