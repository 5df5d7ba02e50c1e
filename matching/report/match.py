"""A match: figures and report."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from markupsafe import Markup, escape
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, MultipleLocator, NullLocator

from matching.match.beds import BedsCheck, quantile
from matching.match.case import Case, Compared
from matching.match.case_file import case_files
from matching.match.free_play import OpenLash
from matching.match.in_time import InTime
from matching.match.loop import bed_set, controller_of, frequency_response, return_difference
from matching.match.loop_modes import LoopMode
from matching.match.result import AdapterTrade, MatchResult, TargetResult
from matching.match.verify import DISAGREEMENT, Deviation, Verification
from matching.report import driving as driving_report
from matching.report import order_sheet
from matching.report.common import (
    BAND,
    INK,
    LEGEND,
    LIMIT,
    LINES,
    MATCHED,
    RIG,
    VEHICLE,
    amount,
    change,
    component,
    csv_table,
    decimated,
    equations,
    figure,
    hertz,
    legend_above,
    number,
    percent,
    practical,
    sentence,
    spaced,
    styled,
    unit,
)
from matching.report.drivetrain import MOST_INERTIAS, case_figure
from matching.report.modes import Column, energy_figure
from matching.report.page import (
    Block,
    Fold,
    Picture,
    Provenance,
    Report,
    Show,
    Step,
    Table,
    View,
    in_terminal,
    provenance,
    register,
)
from modelling.bed.bed import HARDWARE
from modelling.bed.controllers import STRUCTURES
from modelling.modal.result import Mode
from modelling.units import SENSOR_UNITS, of_input

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
        legend_above(fig, axes)
    return fig


# --- What is asked of a match with an observer beyond its targets, and what drawn beds, loop and sensors made of it.


def requirement_rows(robust: Verification) -> list[dict[str, str]]:
    """Requirements on beds, margin, roll-off and noise: what, its value, what is asked, and whether it holds."""
    beds, loop, required = robust.beds, robust.loop, robust.required
    assert beds is not None, "beds were drawn"
    rows: list[tuple[str, str, str, bool]] = []
    damping = f"at least {number(required.damping_ratio, 3)}"
    eased = beds.damped == beds.drawn and beds.smallest_damping_ratio < required.damping_ratio
    less = "; less is a mode that the vehicle damps so little, or one of the bed's own" if eased else ""
    if beds.drawn:
        least = number(beds.smallest_damping_ratio, 3)
        rows = [
            ("beds stable", f"{beds.stable} of {beds.drawn}", "all", beds.stable == beds.drawn),
            ("least damping ratio of any mode on any bed", least, damping + less, beds.damped == beds.drawn),
        ]
    if beds.drawn and beds.worst is not None:
        most = sentence([*map(component, beds.worst.named[:2])])
        what = f"least damping ratio of the worst bed of the box (most by {most})"
        ratio, mode = beds.worst.damping_ratio, beds.worst.mode
        needed = required.damping_ratio if mode is None else mode.asked
        rows.append((what, number(ratio, 3), f"at least {number(needed, 3)}", ratio >= needed))
    if (slowest := robust.slowest_own) is not None:
        what = f"slowest mode of the model that runs on known torques ({number(slowest.frequency, 3)} Hz): decay"
        rows.append(
            (
                what,
                f"{number(slowest.rate, 3)} 1/s",
                f"at least {number(required.decay_rate, 3)} 1/s",
                slowest.rate >= required.decay_rate,
            )
        )
    rows += [
        (f"modulus margin from {number(required.margin_from)} Hz", number(loop.modulus_margin, 3),
         f"at least {number(required.modulus_margin)}", loop.modulus_margin >= required.modulus_margin),
        (f"roll-off: |T| from {number(required.rolled_off_from)} Hz", number(loop.largest_rolled_off, 3),
         f"at most {number(required.rolled_off)}", loop.largest_rolled_off <= required.rolled_off),
    ]  # fmt: skip
    for (name, noise), allowed in zip(loop.command_noise.items(), required.command_noise, strict=True):
        asked = "no limit" if allowed == np.inf else f"at most {number(allowed)} N·m rms"
        what = f"command of dynamometer {name} from sensor noise"
        rows.append((what, f"{number(noise, 3)} N·m rms", asked, noise <= allowed))
    for (name, torque), allowed in zip(loop.unexpected_torque.items(), required.sensor_offset):
        asked = "no limit" if allowed == np.inf else f"at most {number(allowed)} N·m"
        what = f"flange torque of dynamometer {name} that offsets of all sensors make unexpected in a minute"
        rows.append((what, f"{number(torque, 3)} N·m", asked, torque <= allowed))
    return [
        {"requirement": what, "value": value, "asked": asked, "": HOLDS[holds]} for what, value, asked, holds in rows
    ]


def bed_errors(beds: BedsCheck) -> list[dict[str, str]]:
    """The response error over the stable beds, a row for each kind of torque."""
    return [
        {"response error over the beds": f"{kind} torques", "median": number(quantile(errors, 0.5), 3),
         "95 %": number(quantile(errors, 0.95), 3)}
        for kind, errors in (("measured", beds.measured), ("unmeasured", beds.unmeasured)) if errors
    ]  # fmt: skip


HOLDS = {True: "✓ holds", False: "✗ missed"}


# --- |S| and |T| of the feedback loop over frequency, with the limits that the case sets.

LOWEST_HZ, HIGHEST_HZ, POINTS = 1e-2, 500.0, 2000  # below, only the integrator acts; above, the loop gain is small


def sensitivity(case: Case, modes: Sequence[float]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Largest singular values (f,) of S = (I + L)⁻¹ and T = I − S of a tuned case, after their frequencies (f,), Hz.

    The grid is dense around lightly damped ``modes``, Hz.
    """
    around = [f * np.linspace(0.8, 1.25, 200) for f in modes if f > 0]
    f = np.unique(np.concatenate([np.geomspace(LOWEST_HZ, HIGHEST_HZ, POINTS), *around]))
    f = f[f < 0.499 / case.loop["sample_time"]]
    difference = return_difference(bed_set(case, [{}], f), frequency_response(controller_of(case), f))[0]
    S = np.linalg.inv(difference)
    of_S, of_T = (np.linalg.svd(matrix, compute_uv=False)[:, 0] for matrix in (S, np.eye(S.shape[-1]) - S))
    return f, of_S, of_T


def sensitivity_figure(
    f: np.ndarray, S: np.ndarray, T: np.ndarray, limits: Mapping[str, tuple[float, float]]
) -> Figure:
    """Both curves (f,), and the largest value allowed of each from a frequency (Hz) on."""
    colours = {"|S|": MATCHED, "|T|": RIG}
    with styled():
        fig = figure(8.0, 4.2)
        axes = fig.subplots()
        axes.plot(f, S, color=MATCHED, linewidth=1.6, label="|S|, what a disturbance is multiplied by")
        axes.plot(f, T, color=RIG, linewidth=1.4, linestyle=(0, (6, 2)), label="|T|, what noise is multiplied by")
        for name, (largest, begins) in limits.items():
            ends = [max(begins, f[0]), f[-1]]
            axes.plot(ends, [largest] * 2, color=LIMIT, linewidth=1.2, linestyle="--")
            axes.fill_between(ends, largest, [largest * 1.25] * 2, color=colours[name], alpha=0.2, linewidth=0)
            words = f"{name} ≤ {largest:g}" + (f" from {begins:.3g} Hz" if begins > LOWEST_HZ else "")
            axes.annotate(words, (f[-1], largest), (-2, 9), textcoords="offset points", fontsize=8, ha="right")
        axes.set(xscale="log", yscale="log", xlabel="Frequency in Hz", ylabel="Largest singular value")
        axes.set_xlim(f[0], f[-1])
        axes.set_ylim(max(1e-3, 0.5 * min(S.min(), T.min())), 3 * max(S.max(), T.max()))
        legend_above(fig, axes)
    return fig


# --- Figure of the response error when one value is wrong: how accurately each must be known.


def robustness_figure(rows: Sequence[Deviation], error: float, most: int = 14) -> Figure:
    """Bars from the error as matched to the error with one value wrong, the largest on top; unstable ones hatched."""
    names = list(dict.fromkeys(row.name for row in rows))
    worst = {name: max(_rank(row, error) for row in rows if row.name == name) for name in names}
    names = sorted(names, key=lambda name: -worst[name])[:most]
    with styled():
        fig = figure(12.4, 1.3 + 0.34 * max(len(names), 1))
        axes = fig.subplots()
        top = max([error, *(row.response_error for row in rows if row.stable)]) * 1.25
        for place, name in enumerate(names):
            pair = sorted((row for row in rows if row.name == name), key=lambda row: row.change)
            step = 0.8 / len(pair)
            for k, row in enumerate(pair):
                at = place + (k - (len(pair) - 1) / 2) * step
                reach = min(row.response_error, top) if row.stable else top
                colour, edge, hatch = (
                    (_TINTS[k % len(_TINTS)], "#333333", None) if row.stable else ("white", RIG, "////")
                )
                axes.barh(
                    at, reach - error, left=error, height=0.9 * step, linewidth=0.7, color=colour, edgecolor=edge,
                    hatch=hatch,
                )  # fmt: skip
                said = f"{off(row)}: {number(row.response_error, 2) if row.stable else 'unstable'}"
                axes.annotate(said, (reach, at), (4, 0), textcoords="offset points", va="center", fontsize=8)
        axes.axvline(error, color=LIMIT, linestyle="--", linewidth=1.2)
        axes.set_yticks(range(len(names)), [component(name) for name in names], fontsize=8)
        axes.set_ylim(len(names) - 0.4, -0.6)
        axes.set_xlim(0, top * 1.12)
        axes.grid(False, axis="y")
        axes.set_xlabel(f"Response error with one value wrong (dashed: as matched, {number(error, 2)})")
    return fig


_TINTS = (MATCHED, "#99D8C7")


def _rank(row: Deviation, error: float) -> float:
    return abs(row.response_error - error) if row.stable else math.inf


def off(wrong: Deviation) -> str:
    """A deviation in words: relative, of the dead time in ms."""
    text = practical(wrong.change, "s", 2) if wrong.name == "loop.dead_time" else f"{number(100 * wrong.change, 2)} %"
    return f"+{text}" if wrong.change > 0 else text


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
PEAK_UNITS = {"torque": "N*m", "speed": "rad/s", "power": "W", "twist": "rad", "torque_over_speed": "1",
              "shear_stress": "Pa", "shear_stress_amplitude": "Pa"}  # fmt: skip


def signals(result: MatchResult) -> list[Signal]:
    """The simulated manoeuvre: compared sensors, then the dynamometers; empty where the motion diverged."""
    traces = result.verification.traces
    if traces is None:
        return []
    drawn = _readings(result, dict.fromkeys(pair.sensor for pair in result.case.compared), traces.time,
                      {"vehicle": traces.vehicle, "rig": traces.rig, "matched": traces.matched})  # fmt: skip
    for dyno in result.case.loop.dynamometers:
        for what in ("torque", "speed"):
            limit = result.case.limits.get(f"dynamometer_{what}")
            curves = {"matched": traces.matched[f"dynamometers.{dyno.name}.{what}"]}
            label = f"{what.capitalize()} in {unit(PEAK_UNITS[what])}"
            name = "" if dyno.name == "dynamometer" else f" {dyno.name}"
            drawn.append(Signal(f"Dynamometer{name}, {what}", label, traces.time, curves, limit))
    return drawn


def in_time_signals(result: MatchResult) -> list[Signal]:
    """The compared sensors of the worst bed with everything wrong, next to its vehicle."""
    traces = result.in_time.traces
    if traces is None:
        return []
    sources = {"vehicle": traces.vehicle, "matched": traces.measured, "unmeasured": traces.unmeasured}
    return _readings(result, result.in_time.sensors, traces.time, sources)


def _readings(
    result: MatchResult, names: Iterable[str], time: np.ndarray, sources: Mapping[str, Mapping[str, np.ndarray]]
) -> list[Signal]:
    """Sensors over time (t,) with the readings of each system that has them."""
    by_name = {sensor.name: sensor for sensor in result.case.vehicle.sensors}
    return [
        Signal(spaced(name).capitalize(), f"{by_name[name].measures.capitalize()} in {unit(by_name[name].unit)}", time,
               {who: readings[name] for who, readings in sources.items() if name in readings})
        for name in names
    ]  # fmt: skip


def needs(result: MatchResult) -> list[dict[str, Any]]:
    """Peaks of the manoeuvre, SI, and their limits (None: the case sets none): dynamometers, shafts with a limit."""
    limits, peaks = result.case.limits, []
    for name, peak in result.verification.peaks.items():
        what = name.rsplit(".", 1)[1]
        is_dyno = name.startswith("dynamometers.")
        limit = limits.get(f"dynamometer_{what}" if is_dyno else name)
        if is_dyno or limit is not None:
            peaks.append({"what": name, "peak": peak, "limit": limit, "unit": PEAK_UNITS[what]})
    return peaks


def margin_counted_from(verification: Verification) -> str:
    """From where on the modulus margin counts, and what it is below; nothing where it counts everywhere."""
    if not verification.margin_from > 0:
        return ""
    return f" from {number(verification.margin_from, 3)} Hz on"


def checks(result: MatchResult) -> list[tuple[str, str, bool]]:
    """Every check of the result: what was checked, the outcome, and whether it holds; stability first."""
    verification = result.verification
    rows = [(*_in_words(name, verification), holds) for name, holds in verification.checks.items()]
    limits = result.case.limits
    margin, (least, at) = verification.modulus_margin, verification.least_damping
    rows += [
        ("Modulus margin of the feedback loop",
         f"{number(margin, 3)} at {number(verification.loop.margin_at, 3)} Hz, "
         f"at least {number(limits['modulus_margin'])} required{margin_counted_from(verification)}",
         margin >= limits["modulus_margin"] * (1 - ROUNDING)),
        ("Smallest damping ratio of any mode of the loop",
         f"{number(least, 3)} at {number(at, 3)} Hz, at least {number(limits['damping_ratio'])} required of "
         "a mode that is neither the vehicle's nor the bed's own",
         not any(row.limit == "damping_ratio" for row in verification.violations)),
    ]  # fmt: skip
    rows += [(f"Mode {target.vehicle_mode} identified from the simulated manoeuvre", *_identified(target))
             for target in result.targets]  # fmt: skip
    exceeded = [row for row in verification.violations if row.limit not in ("modulus_margin", "damping_ratio")]
    for violation in exceeded:
        si = PEAK_UNITS[violation.where.rsplit(".", 1)[1]]
        outcome = f"{practical(violation.value, si)}, {practical(violation.allowed, si)} allowed"
        rows.append((f"Limit of {violation.where}", outcome, False))
    return rows if exceeded else [*rows, ("Torque, twist, speed and power limits over the manoeuvre", "kept", True)]


def _identified(target: TargetResult) -> tuple[str, bool]:
    """Outcome of a mode's identification from the simulation, and whether it lies near enough to the vehicle's."""
    if target.identified is None:
        return "not identified", False
    deviation = round(100 * (target.identified / target.vehicle - 1), 2) + 0.0
    holds = abs(deviation) <= IDENTIFIED_WITHIN_PERCENT
    return f"{hertz(target.identified)} Hz, {deviation:+.2f} % from the vehicle", holds


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
    if name == "loop and simulation agree":
        return (
            "Motion foretold by the loop against the simulated one",
            f"apart by {DISAGREEMENT:.1%} of the range at most",
        )
    return name.capitalize(), ""


# --- Frequencies and energy shares of vehicle, rig without control and matched rig, as the paper's Fig. 3 shows them.

MODES_HIGHEST_HZ = 1000.0  # above are poles of lags and of the dead time, which are no modes of the drivetrain


def match_modes_figure(result: MatchResult) -> Figure:
    """Three columns, three rows: frequencies, kinetic and potential shares of the target modes."""
    return energy_figure(columns(result))


def columns(result: MatchResult) -> list[Column]:
    """Vehicle, rig without control and matched rig with the target modes; a system without modes is left out."""
    # modes of the feed-forward: what the matched rig shows for measured torques
    measured = [mode for mode in result.matched_modes if mode.belongs_to == "feed_forward"]
    matched = measured or result.matched_modes
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


def nearest(modes: Sequence[Mode | LoopMode], frequency: float, symmetry: str) -> Mode | LoopMode | None:
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
        axes.set_title(f"{spaced(pair.input)} → {spaced(pair.sensor)}", fontsize=9, pad=16)


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
    per = unit(of_input(_input_units(result)[pair.input]))
    return f"{sensor.measures.capitalize()} in {unit(SENSOR_UNITS[sensor.measures])} per {per}"


def _input_units(result: MatchResult) -> dict[str, str]:
    """SI unit of every input of rig and vehicle."""
    return {**result.case.rig.input_units, **result.case.vehicle.input_units}


def _error(result: MatchResult, index: int) -> str:
    errors = result.response_error.functions[index]
    parts = [f"error {number(errors.after, 2)}"]
    if errors.before is not None:
        parts.append(f"without control {number(errors.before, 2)}")
    if "unmeasured" in curves_of(result, index):
        parts.append(f"not measured {number(errors.unmeasured, 2)}")
    return ", ".join(parts)


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
    for count, (target, mark) in enumerate(zip(result.targets, "osD^v" * 9)):
        known = {name: value for name in places if (value := getattr(target, name)) is not None}
        axes.plot(list(known.values()), [places[name] for name in known], color="#999999", linewidth=0.9,
                  linestyle=":", zorder=1)  # fmt: skip
        for name, frequency in known.items():
            at = frequency, places[name]
            axes.plot(*at, mark, color=LINES[name]["color"], markersize=9, markeredgecolor=INK, zorder=3)
            axes.annotate(f"{hertz(frequency)} Hz", at, (0, -18 if count % 2 else 9), textcoords="offset points",
                          ha="center", fontsize=8)  # fmt: skip
        axes.plot([], [], mark, color="white", markeredgecolor=INK, label=_name(target))
    for name, place in places.items():
        if all(getattr(target, name) is None for target in result.targets):
            axes.annotate("not found", (0.5, place), xycoords=("axes fraction", "data"), ha="center", fontsize=8)
    shown = [value for target in result.targets for value in (target.vehicle, target.rig, target.matched) if value]
    axes.set_xscale("log")
    axes.set_xlim(min(shown) / 1.8, max(shown) * 1.8)
    axes.set_ylim(-0.9, 2.6)
    axes.set_yticks(list(places.values()), [LINES[name]["label"] for name in places])
    axes.grid(False, axis="y")
    axes.set_xlabel("Frequency of the target modes in Hz")
    axes.legend(loc="lower center", bbox_to_anchor=(0.4, 1.0), fontsize=7.5, ncols=2, borderaxespad=0.1)


# --- What adapters to order: the error over each quantity.

COLUMNS, PANEL_HEIGHT = 3, 2.9  # inches
LOGARITHMIC_FROM = 8.0  # largest over smallest value tried


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
            axes.axvspan(*trade.acceptable, color=BAND, label="no worse than 2 % and the scatter")
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
        panels[0].set_ylabel("Response error over fresh beds\n(mean, over its tolerance)")
        handles, labels = panels[0].get_legend_handles_labels()
        fig.legend(handles, labels, loc="outside upper center", ncols=5)
    return fig


# --- The figures of a match, by file name, and the overview.

CAPTIONS = {
    "drivetrain": "Vehicle and rig. Dashed: the cut; hatched: the residual vehicle, which the dynamometers emulate.",
    "overview": "Response, manoeuvre and target modes at a glance.",
    "modes": "Modes and their energy. In colour: the target modes, and on the rig without control those of the same "
    "symmetry. sym, anti: symmetric, antisymmetric left to right.",
    "responses": "Frequency responses. The line of the matched rig should run inside the broad line of the vehicle; "
    "the grey band is the matched band. Dotted: the matched rig when the controller does not measure the torque.",
    "manoeuvre": "The manoeuvre, simulated with a delay line and a sampled controller.",
    "in_time": "A bed with everything wrong at once, the worst of those drawn, next to the nonlinear vehicle with the "
    "same specimen. Dotted: the controller does not measure the torque.",
    "sensitivity": "Sensitivity S and complementary sensitivity T of the feedback loop on the bed as planned. Grey: "
    "the limits, each from the frequency on from which it counts.",
    "beds": "Drawn beds: share of them whose response error is at most so large; the points are median and 95 %.",
    "trade": "What to order: the response error for unmeasured torques over each adapter quantity, the rest tuned for "
    "each value, and the range that is no worse than 2 % and the scatter. Dotted: what the bed as planned reaches.",
    **driving_report.CAPTIONS,
    "robustness": "How accurately each quantity must be known: response error when one value is wrong.",
}


def pictures(result: MatchResult) -> dict[str, Picture]:
    """The figures of a match by name; those for which there is nothing to show are left out."""
    case, tuned = result.case, result.tuned
    draw: dict[str, Callable[[], Figure]] = {
        "overview": lambda: overview_figure(result, of_manoeuvre),
        "modes": lambda: match_modes_figure(result),
        "responses": lambda: response_figure(result),
    }
    begins = min((torque.at for torque in case.manoeuvre.values()), default=0.0)
    if of_manoeuvre := signals(result):
        draw["manoeuvre"] = lambda: trace_figure(of_manoeuvre, begins)
    if of_worst_bed := in_time_signals(result):
        draw["in_time"] = lambda: trace_figure(of_worst_bed, begins)
    dense = [target.vehicle for target in result.targets] + [mode.frequency for mode in result.rig_modes]
    required = result.verification.required
    limits = {"|S|": (1 / case.limits["modulus_margin"], required.margin_from),
              "|T|": (required.rolled_off, required.rolled_off_from)}  # fmt: skip
    draw["sensitivity"] = lambda: sensitivity_figure(*sensitivity(tuned, dense), limits)
    if max(len(system.inertias) for system in (case.vehicle, case.rig)) <= MOST_INERTIAS:
        draw["drivetrain"] = lambda: case_figure(tuned)
    beds = result.verification.beds
    if beds and beds.unmeasured:
        draw["beds"] = lambda: beds_figure(beds, case.unmeasured_tolerance)
    if result.adapters:
        draw["trade"] = lambda: trade_figure(result.adapters)
    if (over_range := result.driving) is not None:
        draw["over_speed"] = lambda: driving_report.over_speed_figure(over_range, case)
        if over_range.drives:
            draw["drives"] = lambda: driving_report.drives_figure(over_range, case)
    if wrong := result.verification.robustness:
        draw["robustness"] = lambda: robustness_figure(wrong, result.response_error.after)
    data = curve_data(result)
    return {name: Picture(make, CAPTIONS[name], data.get(name, "")) for name, make in draw.items()}


# --- A match in words, from the content of ``result.json``: a verdict and a table, the same for terminal and page.

MOST_TARGETS, MOST_MOVED, MOST_LIMITS = 4, 4, 3  # lines of the terminal's answer
SAME_RELATIVE = 1e-9  # values that differ by no more count as equal
HEADS = ("", "vehicle", "rig alone", "matched", "asked")


def content(result: MatchResult) -> dict[str, Any]:
    """The content of ``result.json``: the result, what was ``asked`` for, what the manoeuvre ``needs``."""
    entries, case = result.to_dict(), result.case
    if not math.isfinite(result.objective):  # no start ended within the limits
        entries["objective"] = None
    asked: dict[str, Any] = dict(case.limits)
    tolerances = {"tolerance": case.tolerance, "unmeasured_tolerance": case.unmeasured_tolerance}
    asked |= {name: value for name, value in tolerances.items() if math.isfinite(value)}
    return entries | {"asked": asked, "needs": needs(result)}


def answer(result: Mapping[str, Any]) -> str:
    """The verdict in one sentence."""
    error = result["response_error"]
    before, after = error["before"], number(error["after"], 2)
    fall = f"is {after}" if before is None else f"falls from {number(before, 2)} to {after}"
    if result["status"] == "matched":
        frequencies = sentence([f"{hertz(target['vehicle'])} Hz" for target in result["targets"]])
        mode = "mode" if len(result["targets"]) == 1 else "modes"
        band = f"{number(error['band'][0])}–{number(error['band'][1])} Hz"
        return (
            f"The rig reproduces the vehicle's response: it has the target {mode} at {frequencies} within tolerance, "
            f"and its response error over {band} {fall}. {_beyond_on_beds(result)}".rstrip()
        )
    first = result["limits"][0] if result["limits"] else "a check fails"
    first = first[:1].lower() + first[1:] if first[1:2].islower() else first
    return f"The rig cannot reproduce the vehicle's response within these bounds: {first.rstrip('.')}."


def _beyond_on_beds(result: Mapping[str, Any]) -> str:
    """That more than one drawn bed in twenty is beyond an error that the bed as planned keeps; empty where none is."""
    said = []
    for finding in result.get("findings", []):
        if finding["cause"] == "beds_error":
            beyond, drawn = finding["beds"]
            often = (
                f"one drawn bed in {drawn / beyond:.0f}" if beyond < drawn / 3 else f"{beyond} of {drawn} drawn beds"
            )
            is_ = "is" if beyond < drawn / 3 else "are"
            said.append(f"{often} {is_} beyond {number(finding['allowed'])} for {finding['where']}")
    return f"That holds as planned; {sentence(said)}." if said else ""


def key_figures(result: Mapping[str, Any]) -> list[tuple[str, ...]]:
    """Rows of the table below the verdict, with the columns of :data:`HEADS`."""
    asked, error = result.get("asked", {}), result["response_error"]
    rows: list[tuple[str, ...]] = [
        (_mode(target), f"{hertz(target['vehicle'])} Hz",
         "no such mode" if target["rig"] is None else f"{hertz(target['rig'])} Hz",
         f"{hertz(target['matched'])} Hz", "met" if target["met"] else "NOT MET")
        for target in result["targets"][:MOST_TARGETS]
    ]  # fmt: skip
    before = "" if error["before"] is None else number(error["before"], 2)

    def at_most(name: str) -> str:
        return f"≤ {number(asked[name], 2)}" if name in asked else ""

    beds = result.get("beds") if (result.get("beds") or {}).get("drawn") else None

    def error_rows(what: str, value: float, tolerance: str, on_beds: str) -> None:
        """The error of the bed as planned, and its median and 95 % over the drawn beds."""
        rows.append((what, "", before, number(value, 2), at_most(tolerance)))
        median, most = ((beds or {}).get(f"{on_beds}_{part}") for part in ("median", "95"))
        if beds and median is not None and most is not None:
            spread = f"{number(median, 2)}, {number(most, 2)}"
            rows.append((f"  on {beds['drawn']} drawn beds: median, 95 %", "", "", spread, ""))

    error_rows("response error", error["after"], "tolerance", "error")
    structure = STRUCTURES[result["structure"]]
    if structure.has_feed_forward or structure.is_observer:
        error_rows(
            "response error, unmeasured torques", error["unmeasured_after"], "unmeasured_tolerance", "unmeasured"
        )
    if known := error.get("specimen_known"):
        both = ", ".join(number(one, 2) for one in known)
        rows.append(("  with the specimen known: measured, unmeasured", "", "", both, ""))
    if beds:
        kept = f", {beds['kept']}" if "kept" in beds else ""  # a result of an older version has none
        what = "drawn beds stable, damped" + (", within all tolerances" if kept else "")
        rows.append((what, "", "", f"{beds['stable']}, {beds['damped']}{kept}", str(beds["drawn"])))
    rows += driving_report.key_rows(result)
    if limited := [need for need in result.get("needs", []) if need["limit"]]:
        most = max(limited, key=lambda need: need["peak"] / need["limit"])
        part, _, quantity = most["what"].rpartition(".")
        peak, limit = practical(most["peak"], most["unit"]), practical(most["limit"], most["unit"])
        rows.append((f"{component(part)}, {spaced(quantity)}", "", "", peak, f"≤ {limit}"))
    return rows


def _mode(target: Mapping[str, Any]) -> str:
    side = "" if target["symmetry"] == "none" else f" ({target['symmetry']})"
    return f"target mode {target['vehicle_mode']}, damped{side}"


def moved(parameters: Sequence[Mapping[str, Any]]) -> list[Mapping[str, Any]]:
    """Quantities that moved, those farthest within their bounds first."""
    rows = [row for row in parameters if abs(row["tuned"] - row["start"]) > SAME_RELATIVE * abs(row["start"])]
    return sorted(rows, key=lambda row: -abs(row["tuned"] - row["start"]) / (row["upper"] - row["lower"]))


def operating_point(result: Mapping[str, Any]) -> str:
    """The steady motion from which the manoeuvre begins, in one line."""
    speeds, torques = result.get("operating_point", {}), result.get("operating_torques", {})
    if not any(speeds.values()):
        return "none stated, standstill assumed; torques, speeds and powers count from there"
    turning = [f"{spaced(name)} {practical(speed, 'rad/s', 4)}" for name, speed in speeds.items()]
    driven = [f"{spaced(name)} {practical(torque, 'N*m')}" for name, torque in torques.items()]
    return f"{sentence(turning)}; {sentence(driven)}"


def _of_pairs(result: MatchResult) -> str:
    """That pairs have one value, where an adapter is one of a pair."""
    adapters = [move for move in result.case.moves if move.name.startswith("rig.")]
    return OF_PAIRS if any(len(move.together) > 1 for move in adapters) else ""


# --- The report of a match.

DEAD_TIME = (
    "A command acts one dead time after it is given, so a controller can only act on what it predicts for that time; a "
    "torque that steps at an unforeseeable moment is always answered late. The lower bound is the error of the best "
    "command that knows every state and every measured torque but nothing of the future. It is the best over all "
    "frequencies, for torques that step; within a band alone a controller can be below it."
)
HOW_ERROR = (
    "The response error is the root mean square of |log(H rig/H vehicle)| over the band and the compared functions: "
    "0.1 is about 10 % in amplitude or 6° in phase."
)
HOW_TRADES = (
    "Errors to measured and unmeasured torques as one, each over its tolerance: means over fresh beds, everything "
    "else tuned for the value."
)
OF_PAIRS = " A mirror image has the same value."
HOW_CONTRIBUTIONS = (
    "What each part contributes: response errors if only that has moved, each row tuned by the same search and judged "
    'on the same beds. "adapters as planned": controller and residual vehicle have moved.'
)
HOW_IN_TIME = (
    "Root mean square error over the range of the vehicle's signal, {seconds} s of the manoeuvre. The sampled "
    "controller runs with its limits on a nonlinear bed; the vehicle has the same specimen, with its lash and "
    "friction, and gets the same torques. “Unmeasured”: the controller is not told of the rig's torques. {lash}"
)
BY_EXPORT = "The export writes these values into the controller; nothing has to be entered by hand."
OF_BEDS = "Beds are drawn within [uncertainty]; each is compared with the vehicle that has the same specimen."
COMPARED = {
    "R_SD": "torque and speed at every cut, rig against vehicle",
    "R_RVM": "sensors of the residual vehicle, driven by the rig's torques, against those of the vehicle",
    "R_MU": "uncertainty of the dynamometers' sensors over the range of the manoeuvre",
    "R_XiL": "total (Eq. 16)",
}
TOLD_MODELS = (
    "Kinetic energy T, potential energy V, Rayleigh's dissipation function D, and Lagrange's equations of motion."
)


def summary(result: Mapping[str, Any]) -> str:
    """The result for a terminal: verdict, table, what limits it, what moved."""
    return in_terminal(report(result))


def report(
    content: Mapping[str, Any], folder: str = "OUT", made: Provenance | None = None, result: MatchResult | None = None
) -> Report:
    """What a match says; the evidence only where the result itself is given."""
    plant = [row for row in moved(content["parameters"]) if not row["name"].startswith("loop.")]
    tuned = [
        Step(f"{component(row['name'])}: {amount(row['start'], row['unit'])} → {amount(row['tuned'], row['unit'])}"
             + (", at its bound" if row["at_bound"] else ""))
        for row in plant[:MOST_MOVED]
    ]  # fmt: skip
    if len(plant) > MOST_MOVED:
        tuned.append(Step(f"{len(plant) - MOST_MOVED} more quantities moved: result.json"))
    more = [Step(limit) for limit in content["limits"][1:MOST_LIMITS]]
    remedies = {} if content["status"] == "matched" else {REMEDIES: _remedies(content)}
    lists: dict[str, list[Step]] = {**remedies, "What else limits the match": more, "Tuned": tuned}
    if result is not None:
        watch = [Step(line) for line in to_watch(result)]
        lists = {**remedies, "What to do now": to_do(result, folder), "What else limits the match": more,
                 "What may spoil it": watch}  # fmt: skip
    return Report(
        title=content.get("title") or "Match of a test bed to a vehicle",
        status=content["status"],
        answer=answer(content),
        good=content["status"] == "matched",
        lists=lists,
        table=Table([dict(zip(HEADS, row, strict=True)) for row in key_figures(content)]),
        folds=_evidence(result, content) if result else (),
        notes=content["notes"] if result else (),
    )


REMEDIES = "What would make it a match, each change solved by itself"


def _remedies(content: Mapping[str, Any]) -> list[Step]:
    """Single changes with which the case was matched, with the errors that each leaves."""
    return [
        Step(remedy["words"], f"response error {number(remedy['measured'], 2)}, to unmeasured torques "
             f"{number(remedy['unmeasured'], 2)}")
        for remedy in content.get("remedies", [])
    ]  # fmt: skip


def _evidence(result: MatchResult, content: Mapping[str, Any]) -> list[Fold]:
    error, loop, beds = result.response_error, result.tuned.loop, result.verification.beds
    return [
        Fold("Adapters and what else moved", [
            Table([_trade(trade) for trade in result.adapters], HOW_TRADES + _of_pairs(result)), Show("trade"),
            Table([_contribution(row) for row in result.contributions], HOW_CONTRIBUTIONS),
            Table([_moved(row) for row in content["parameters"]]) if result.parameters
            else "Nothing may move: [move] of the case is empty.",
        ]),
        Fold("What the manoeuvre needs, and the limits", [
            Table([_need(need) for need in needs(result)], "Absolute peaks of the simulated manoeuvre: "
                  + sentence([_manoeuvre(name, torque, _input_units(result)[name])
                              for name, torque in result.tuned.manoeuvre.items()])
                  + f". Operating point: {operating_point(content)}."),
            Show("manoeuvre"),
        ]),
        Fold("Response error, and what the dead time allows", [
            HOW_ERROR,
            Table([{"": what, "response error": number(value, 3)} for what, value in {
                "rig alone, functions that have a path on it": error.before,
                "matched, the same functions": error.after_same_functions,
                "matched, all compared functions, torques measured": error.after,
                "matched, torques not measured": error.unmeasured,
                "lower bound set by the dead time, at this sample time": error.bound,
                "lower bound set by the dead time, without sampling": error.bound_unsampled,
                "ideal estimator on these sensors, torques not measured": error.unmeasured_bound,
            }.items() if value is not None], DEAD_TIME),
            Show("responses"), *(_fidelity(result.fidelity.to_dict()) if result.fidelity else []),
        ]),
        Fold("Beds that may stand there", [
            Table(requirement_rows(result.verification)),
            Table(bed_errors(beds), OF_BEDS),
            Show("beds"),
        ] if beds else []),
        *driving_report.fold(content),
        Fold("In time, on beds that are not the model",
             [in_time_table(result.in_time, result.lash), Show("in_time")] if result.in_time.rows else []),
        Fold("What must be known accurately", [Show("robustness")]),
        Fold("Checks of stability and targets", [
            Table([{"check": what, "outcome": f"{'✓' if holds else '✗'} {outcome}"}
                   for what, outcome, holds in checks(result)]),
            Table([_target(target) for target in result.targets]), Show("sensitivity"),
        ]),
        Fold(f"Controller and residual vehicle, structure “{loop.structure.name}”", [
            BY_EXPORT,
            Table([
                {"quantity": f"loop.{name}", "value": amount(loop[name], known.unit, 5), "meaning": known.meaning}
                for name, known in ({**loop.structure.quantities, **HARDWARE}).items()
            ]),
            Table(_residual(result)),
        ]),
        Fold("Drivetrain and modes", [Show("drivetrain"), Show("modes")]),
        Fold("Equations", [f"{LEGEND} {TOLD_MODELS}", *_equations(result)]),
    ]  # fmt: skip


def _trade(trade: AdapterTrade) -> dict[str, str]:
    low, high = (number(value, 3) for value in trade.acceptable)
    return {
        "adapter quantity": component(trade.name), "planned": number(trade.planned),
        "to order": amount(trade.ordered, trade.unit), "error as planned": number(trade.error_as_planned, 2),
        "error as ordered": number(trade.error_as_ordered, 2), "as good within 2 %": f"{low} … {high}",
        "why": trade.reason,
    }  # fmt: skip


def _contribution(row: Any) -> dict[str, str]:
    def pair(kind: str) -> str:
        return ", ".join(number(getattr(row, f"{kind}_{part}"), 2) for part in ("median", "95"))

    return {
        "moved": row.moved, "measured torques, bed as planned": number(row.measured, 2),
        "unmeasured, bed as planned": number(row.unmeasured, 2), "measured, fresh beds: median, 95 %": pair("measured"),
        "unmeasured, fresh beds: median, 95 %": pair("unmeasured"), "stable": f"{row.stable} of {row.drawn}",
        "requirements": HOLDS[row.keeps_all],
    }  # fmt: skip


def _moved(row: Mapping[str, Any]) -> dict[str, str]:
    of_loop = row["name"].startswith("loop.")
    return {
        "quantity": component(row["name"]), "start": number(row["start"]), "tuned": amount(row["tuned"], row["unit"]),
        "change": change(row["start"], row["tuned"]) + (", at its bound" if row["at_bound"] else ""),
        "allowed": f"{number(row['lower'])} … {number(row['upper'])}",
        "share of a target mode's energy": "" if of_loop else percent(row["share"], 1),
        "weight on a change": "" if of_loop else number(row["weight"], 2),
        "its cost": "" if of_loop else number(row["change_cost"], 2),
    }  # fmt: skip


def _need(need: Mapping[str, Any]) -> dict[str, str]:
    peak, limit = need["peak"], need["limit"]
    used = f"{'✗ ' if peak > limit else ''}{number(100 * peak / limit, 3)} %" if limit else ""
    return {"": component(need["what"]), "needed": practical(peak, need["unit"]),
            "limit": practical(limit, need["unit"]) if limit else "none", "used": used}  # fmt: skip


def _target(target: TargetResult) -> dict[str, str]:
    return {
        "target mode": _name(target), "damping ratio, vehicle": number(target.vehicle_damping, 3),
        "matched": number(target.matched_damping, 3), "from simulation": number(target.identified_damping, 3),
        "frequency from simulation": f"{hertz(target.identified)} Hz",
    }  # fmt: skip


def _fidelity(fidelity: Mapping[str, Any]) -> list[Block]:
    """The XiL fidelity of a match (Eqs. 14 to 23)."""
    rows = []
    for name, what in COMPARED.items():
        cells = [percent(fidelity[side][name]) for side in ("before", "after")]
        if name == "R_XiL":
            cells = [f"{text} ± {percent(2 * fidelity[side]['standard_uncertainty'])}"
                     for text, side in zip(cells, ("before", "after"), strict=True)]  # fmt: skip
        weight = f"{fidelity['weights'].get(name, 1):.2g}"
        rows.append({"XiL fidelity of the manoeuvre": name, "rig alone": cells[0], "matched": cells[1],
                     "weight": weight, "what it compares": what})  # fmt: skip
    top = f"largest relevant frequency {number(fidelity['f_max'])} Hz."
    return [Table(rows, f"100 % is a rig that cannot be told from the vehicle; {top}"), list(fidelity["notes"])]


def to_do(result: MatchResult, folder: str) -> list[Step]:
    """What to order and which command comes next; where it is limited, how to see where it would not be."""
    points = []
    if result.status != "matched":
        points = [
            Step(f"Change what stands in the way: {one.sentence()}", f"evidence: {one.place}" if one.place else "")
            for one in [one for one in result.findings if one.limits][:MOST_LIMITS]
            if not result.remedies
        ]
        other = next((row.name for row in result.parameters if row.name.startswith("rig.")), "loop.inverter_lag")
        command = f"rigmatch map {result.case.path or 'CASE'} --x loop.dead_time --y {other} --out {folder}/map"
        return [*points, Step("See over two quantities where the match would hold", command=command)]
    orders = [trade for trade in result.adapters if trade.changes]
    for trade in orders:
        shown = practical if trade.unit == "m" else amount
        low, high = (shown(value, trade.unit, 3) for value in trade.acceptable)
        points.append(
            Step(f"Order {component(trade.name)} {shown(trade.ordered, trade.unit)} instead of "
                        f"{shown(trade.planned, trade.unit)}",
                 f"{trade.reason}; {low} to {high} serves as well{_twist(trade)}")
        )  # fmt: skip
    if result.adapters:
        points.append(Step("Give the order sheet to the workshop; a browser prints it to PDF", file=order_sheet.FILE))
    if not orders:
        reason = "no change of them gains 2 %" if result.adapters else "none of them may change under [move]"
        points.append(Step("Order the adapters as planned", reason))
    points.append(
        Step("Put the controller onto the bed: an FMU with its C sources and its supervision",
                    command=f"rigmatch export {folder} --controller controller.fmu")
    )  # fmt: skip
    return [
        *points,
        Step("Plan what to record on the bed, then judge it", command=f"rigmatch excite {folder} --out excite"),
    ]


def _twist(trade: AdapterTrade) -> str:
    """What a stiffness to be ordered twists by at its rated torque."""
    if trade.rated_torque is None or trade.twist is None:
        return ""
    return f"; it twists by {number(np.degrees(trade.twist), 2)}° at {number(trade.rated_torque)} N·m"


def to_watch(result: MatchResult) -> list[str]:
    """What may spoil the match, most important first."""
    points = [f"check failed: {what}, {outcome}" for what, outcome, holds in checks(result) if not holds]
    beds = result.verification.beds
    if beds and beds.worst and beds.worst.mode and 0 < beds.worst.damping_ratio < beds.worst.mode.asked:
        points.append(
            f"the worst bed within [uncertainty] damps its mode at {beds.worst.mode.words()} by "
            f"{number(beds.worst.damping_ratio, 2)}, {number(beds.worst.mode.asked, 2)} is required; most by "
            f"{sentence([*map(component, beds.worst.named)])}"
        )
    wrong = result.verification.robustness
    points += [f"the loop becomes unstable with {component(row.name)} {off(row)}" for row in wrong if not row.stable]
    worst = max((row for row in wrong if row.stable), key=lambda row: row.response_error, default=None)
    if worst is not None and worst.response_error > result.response_error.after:
        points.append(
            f"{component(worst.name)} must be known best: {off(worst)} makes the response error "
            f"{number(worst.response_error, 2)}"
        )
    return points[:MOST_LIMITS]


def in_time_table(truth: InTime, lash: OpenLash | None) -> Table:
    """Of every sensor the error with measured and with unmeasured torques."""
    rows = []
    for row in truth.rows:
        cells = {"what is wrong on the bed": row.words}
        for name in truth.sensors:
            for head, errors in ((spaced(name), row.measured), (f"{spaced(name)}, unmeasured", row.unmeasured)):
                cells[head] = "not stable" if errors is None else percent(errors[name]) if name in errors else "at rest"
        rows.append(cells)
    return Table(
        rows, HOW_IN_TIME.format(seconds=number(truth.seconds, 3), lash=f"{_lash(lash)} {_standstill(truth)}".strip())
    )


def _lash(lash: OpenLash | None) -> str:
    """What drawn lashes do, as a sentence; empty where none was tried."""
    if lash is None:
        return ""
    come = f"{lash.limit_cycles} of {lash.drawn} beds swing on" if lash.limit_cycles else "no bed swings on"
    return (
        f"After a short torque pulse with an open lash {come}; at the end the worst bed swings by "
        f"{number(lash.largest_swing, 2)} N·m rms, the vehicle by {number(lash.vehicle_swing, 2)} N·m."
    )


def _standstill(truth: InTime) -> str:
    """What encoders do at rest, as a sentence; empty where it was not tried."""
    still = truth.standstill
    if still is None:
        return ""
    return (
        f"At standstill the counts of the encoders keep the bed swinging: {number(still.command, 2)} N·m rms of "
        f"command, {number(still.flange, 2)} N·m rms at the flange."
    )


def _residual(result: MatchResult) -> list[dict[str, str]]:
    """Rows of the residual vehicle; one of the case's own next to what its file says, else next to the vehicle.

    Of a torque map, which has hundreds of values, those that differ.
    """
    simple = result.simple_vehicle
    rows = []
    for part in result.tuned.residual_vehicle.parts:
        maps = {effect.name for effect in part.effects if effect.law.pedal}
        for name, quantity in part.parameters.items():
            before = result.case.vehicle.parameters[name].value if simple is None else quantity.value
            if simple is not None:
                before, _ = simple.values.get(name, (before, before))
            same = abs(quantity.value - before) <= SAME_RELATIVE * abs(before)
            if same and name.rpartition(".")[0] in maps:
                continue
            if quantity.value or before:
                rows.append({"residual vehicle": component(name), "value": amount(quantity.value, part.units[name], 5),
                             "in the vehicle" if simple is None else "as written": "same" if same
                             else number(before, 5)})  # fmt: skip
    return rows


def _manoeuvre(name: str, torque: Any, si: str) -> str:
    return f"{torque.words} of {amount(torque.amplitude, si)} on {spaced(name)}"


def _equations(result: MatchResult) -> list[Markup]:
    blocks = []
    for title, system in (("Vehicle", result.case.vehicle), ("Rig", result.case.rig)):
        written = equations(system)
        lines = [f'<div class="equation">{line}</div>' for key in ("T", "V", "D", "motion") for line in written[key]]
        named = escape(f"{title}: {system.title}" if system.title else title)
        blocks.append(Markup(f"<h3>{named}</h3>{''.join(lines)}"))
    return blocks


def curve_data(result: MatchResult) -> dict[str, str]:
    """CSV texts by the name of the figure whose curves they hold."""
    head, columns = ["frequency [Hz]"], [result.curves.frequencies]
    units = {sensor.name: unit(SENSOR_UNITS[sensor.measures]) for sensor in result.case.vehicle.sensors}
    inputs = _input_units(result)
    for index, pair in enumerate(result.case.compared):
        for who, values in curves_of(result, index).items():
            name = f"{pair.sensor} / {pair.input}, {who}"
            per = unit(of_input(inputs[pair.input]))
            head += [f"{name}, modulus [{units[pair.sensor]} per {per}]", f"{name}, phase [deg]"]
            columns += [np.abs(values), np.degrees(np.angle(values))]
    tables = {"responses": csv_table(head, zip(*columns, strict=True))}
    if drawn := signals(result):
        named = {f"{signal.title}, {who} [{signal.label.rpartition(' in ')[2]}]": values
                 for signal in drawn for who, values in signal.curves.items()}  # fmt: skip
        tables["manoeuvre"] = csv_table(["time [s]", *named], zip(drawn[0].time, *named.values(), strict=True))
    return tables


def _other_files(result: MatchResult) -> dict[str, str | bytes]:
    sheet = order_sheet.page(result, provenance(result.case))
    return {**case_files(result.tuned), **({order_sheet.FILE: sheet} if sheet else {})}


register(
    MatchResult,
    View(
        "result.json", report, pictures, content, others=_other_files,
        origin=lambda result: provenance(result.case), tells_origin=True,
    ),
)  # fmt: skip
