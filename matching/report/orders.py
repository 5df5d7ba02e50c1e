"""Views of Campbell diagrams and of forced responses to orders."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from matching.report.common import (
    LIMIT,
    RIG,
    VEHICLE,
    amount,
    csv_table,
    curve,
    figure,
    hertz,
    number,
    practical,
    spaced,
    styled,
)
from matching.report.page import Fold, Picture, Report, Step, Table, View, register
from modelling.display import counted
from modelling.modal.forced import OrderResponse
from modelling.modal.orders import Campbell

TURNS = 30 / np.pi  # 1/min per rad/s
MOST_CRITICAL = 12  # speeds in the first table; the file has all

# --- Campbell diagram.


def campbell_figure(found: Campbell) -> Figure:
    """Modes over speed, orders as lines from the origin, and a ring where they meet."""
    speed = TURNS * found.speeds
    with styled():
        fig = figure(7.2, 4.6)
        axes = fig.subplots()
        swinging = [column for column in found.frequencies.T if np.nanmax(column) > 0]
        for place, mode in enumerate(swinging):
            axes.plot(speed, mode, color=VEHICLE, linewidth=1.6, label="mode" if place == 0 else "_")
        met = [one.frequency for one in found.crossings]
        top = 1.15 * max([max(found.orders) * found.speeds[-1] / (2 * np.pi) * 0.5, *met])
        for place, order in enumerate(found.orders):
            line = order * found.speeds / (2 * np.pi)
            axes.plot(speed, line, color=LIMIT, linewidth=0.9, linestyle="--", label="order" if place == 0 else "_")
            end = min(speed[-1], TURNS * top * 2 * np.pi / order)
            axes.annotate(
                number(order, 3), (end, order * end / 60), xytext=(3, 2), textcoords="offset points", fontsize=8,
                color=LIMIT, annotation_clip=False,
            )  # fmt: skip
        if found.crossings:
            at = np.array([(TURNS * one.speed, one.frequency) for one in found.crossings])
            axes.plot(*at.T, "o", color=RIG, markerfacecolor="none", markersize=7, label="they meet")
        axes.set(xlim=(speed[0], speed[-1]), ylim=(0, top), ylabel="frequency at which it rings, in Hz")
        axes.set_xlabel(f"speed of {spaced(found.of)} in 1/min")
        fig.legend(loc="outside upper center", ncols=3)
    return fig


def _crossing(one: Mapping[str, Any]) -> dict[str, str]:
    return {
        "speed": practical(one["speed"], "rad/s", 4), "order": number(one["order"], 3), "mode": str(one["mode"]),
        "rings at [Hz]": hertz(one["frequency"]), "natural frequency [Hz]": hertz(one["natural_frequency"]),
        "damping ratio": number(one["damping_ratio"], 3),
    }  # fmt: skip


def _range(content: Mapping[str, Any]) -> str:
    low, high = (f"{TURNS * content['speeds'][at]:.4g}" for at in (0, -1))
    return f"between {low} and {high} 1/min of {spaced(content['of'])}"


def _file(made: Any) -> str:
    """The model file that a command names."""
    return made.case if made is not None and made.files else "MODEL"


def campbell_report(content: Mapping[str, Any], folder: str = "", made: Any = None, result: Any = None) -> Report:
    """Where orders meet modes."""
    met = content["crossings"]
    low, high = (f"{TURNS * content['speeds'][at]:.6g}" for at in (0, -1))
    orders = " ".join(f"--torques INPUT:{number(order, 3)}=TORQUE" for order in sorted({one["order"] for one in met}))
    words = f'{_file(made)} --speed "{low}:{high} 1/min" --of {content["of"]} {orders} --out response'
    steps = [
        Step(
            "Calculate the torque at these speeds", "a crossing matters only if its order excites the mode",
            f"rigmatch response {words}",
        ),
        Step("See which parts swing in the mode", command=f"rigmatch modes {_file(made)} --damped"),
    ]  # fmt: skip
    return Report(
        title="Campbell diagram",
        status=counted(len(met), "crossing"),
        answer=f"{counted(len(met), 'time')} an order meets a mode {_range(content)}.",
        good=not met,
        lists={"What to do now": steps} if met else {},
        table=Table([_crossing(one) for one in met]),
    )


def campbell_data(found: Campbell) -> str:
    """Modes over speed (CSV)."""
    count = range(found.frequencies.shape[1])
    head = [f"speed of {found.of} [1/min]", *(f"mode {i + 1} rings at [Hz]" for i in count)]
    head += [*(f"mode {i + 1} natural frequency [Hz]" for i in count), *(f"mode {i + 1} damping ratio" for i in count)]
    columns = [TURNS * found.speeds, found.frequencies, found.natural_frequencies, found.damping_ratios]
    return csv_table(head, np.column_stack(columns).tolist())


CAMPBELL_CAPTION = (
    "Frequencies at which modes ring, over speed. A dashed line is an order: so many cycles a turn. A ring marks where "
    "they meet."
)
register(
    Campbell,
    View(
        "campbell.json", campbell_report,
        lambda found: {"campbell": Picture(lambda: campbell_figure(found), CAMPBELL_CAPTION, campbell_data(found))},
        folder="",
    ),
)  # fmt: skip


# --- Forced response.

SHAFTS_DRAWN = 6  # those with the largest torques
LEAST_DRAWN = 1e-4  # of the largest value
SPEEDS_MARKED = 8  # critical speeds with a line, the largest torques first
CLOSE = 0.06  # of the range: two critical speeds whose names would stand on each other


def order_figure(found: OrderResponse) -> Figure:
    """Largest torque of the shafts and largest angle of the inertias over speed, and the critical speeds."""
    speed = TURNS * found.speeds
    with styled():
        fig = figure(7.2, 5.4)
        above, below = fig.subplots(2, 1, sharex=True)
        for axes, names, values in (
            (above, found.shafts, found.peak_torques),
            (below, found.inertias, np.degrees(found.peak_angles)),
        ):
            if not len(names):  # no shaft: nothing carries a torque
                axes.set_axis_off()
                continue
            largest = np.argsort(-values.max(axis=0), kind="stable")[:SHAFTS_DRAWN]
            for place, column in enumerate(sorted(largest)):
                axes.semilogy(speed, values[:, column], label=spaced(names[column]), **curve(place))
            axes.legend(loc="center left", bbox_to_anchor=(1.0, 0.5), fontsize=8)
            axes.margins(x=0)
            axes.set_ylim(bottom=max(axes.get_ylim()[0], LEAST_DRAWN * values.max()))
        named: list[float] = []
        for one in worst_of_modes([each._asdict() for each in found.critical])[:SPEEDS_MARKED]:
            above.axvline(TURNS * one["speed"], color=LIMIT, linewidth=0.8, linestyle=":", zorder=0)
            if any(abs(one["speed"] - other) < CLOSE * np.ptp(found.speeds) for other in named):
                continue
            named.append(one["speed"])
            above.annotate(
                f"order {number(one['order'], 3)}, mode {one['mode']}", (TURNS * one["speed"], 1.0), xytext=(0, 3),
                xycoords=("data", "axes fraction"), textcoords="offset points", rotation=35, fontsize=7, color=LIMIT,
            )  # fmt: skip
        above.set_ylabel("largest torque\nin N·m")
        below.set_ylabel("largest angle\nin °")
        below.set_xlabel(f"speed of {spaced(found.of)} in 1/min")
    return fig


def worst_of_modes(critical: Sequence[Mapping[str, Any]]) -> list[Mapping[str, Any]]:
    """Of every order and mode that meet the shaft with the largest torque, the largest first; None is without bound."""
    found: dict[tuple[float, int], Mapping[str, Any]] = {}
    for one in sorted(critical, key=_size, reverse=True):
        found.setdefault((one["order"], one["mode"]), one)
    return list(found.values())


def _size(one: Mapping[str, Any]) -> float:
    return float("inf") if one["torque"] is None else float(one["torque"])


def _bounded(torque: float | None) -> str:
    return "without bound" if torque is None or torque == float("inf") else amount(torque, "N*m", 4)


def _critical(one: Mapping[str, Any], shaft: str = "shaft with the largest torque") -> dict[str, str]:
    amplitude, static = one["amplitude"], one["static"]
    return {
        "critical speed": practical(one["speed"], "rad/s", 4), "order": number(one["order"], 3),
        "mode": str(one["mode"]), "frequency": amount(one["frequency"], "Hz", 4), shaft: spaced(one["shaft"]),
        "torque": _bounded(one["torque"]), "of this order alone": _bounded(amplitude),
        "times the quasi-static torque": number(amplitude / static, 3) if amplitude and static else "",
    }  # fmt: skip


def _largest(one: Mapping[str, Any]) -> dict[str, str]:
    return {
        "shaft": spaced(one["shaft"]), "largest torque": _bounded(one["torque"]),
        "at": practical(one["speed"], "rad/s", 4) + (", end of the range" if one["at_end"] else ""),
        "mostly of order": number(one["order"], 3), "peak to peak": _bounded(one["peak_to_peak"]),
        "fatigue torque": _bounded(one["fatigue"]),
    }  # fmt: skip


HOW_LARGEST = (
    "Beside the mean torque. The fatigue torque is half of the largest peak-to-peak value; DIN 740-2 compares it with "
    "the alternating torque T_KW that a coupling bears for ever."
)


def _order_steps(content: Mapping[str, Any], worst: Mapping[str, Any] | None, made: Any) -> list[Step]:
    steps = []
    if worst is not None:
        order, mode = number(worst["order"], 3), worst["mode"]
        steps.append(
            Step(
                f"Avoid {practical(worst['speed'], 'rad/s', 4)} in steady motion, move mode {mode} or damp it",
                f"order {order} excites it there; a shaft or inertia that holds much of its energy moves it",
                f"rigmatch modes {_file(made)} --damped",
            )
        )
    bare = [one for one in content["critical"] if one["torque"] is None]
    if bare:
        shafts = ", ".join(dict.fromkeys(spaced(one["shaft"]) for one in bare))
        steps.append(Step(f"Give the shafts a damping: nothing damps {shafts}", "the torque has no bound"))
    steps.append(Step("Compare the fatigue torque of every shaft with what its drawing or catalogue allows"))
    ends = [one for one in content["largest"] if one["at_end"]]
    if ends:
        shafts = ", ".join(spaced(one["shaft"]) for one in ends)
        steps.append(Step(f"If the machine turns beyond this range, ask for more: {shafts} has its largest torque at "
                          "an end"))  # fmt: skip
    return steps


def order_report(content: Mapping[str, Any], folder: str = "", made: Any = None, result: Any = None) -> Report:
    """The largest torque of every shaft, and the critical speeds."""
    groups = worst_of_modes(content["critical"])
    largest = sorted(content["largest"], key=_size, reverse=True)
    answer = f"{counted(len(groups), 'critical speed')} {_range(content)}"
    if largest:
        top = largest[0]
        end = ", an end of the range" if top["at_end"] else ""
        answer = (
            f"{spaced(top['shaft'])} carries the largest torque, {_bounded(top['torque'])} beside the mean torque, "
            f"at {practical(top['speed'], 'rad/s', 4)}{end}; {answer}"
        )
    acting = {f"the {what} of {spaced(name)}" for name, what in content["excited_by"].items() if what != "torque"}
    return Report(
        title="Forced response to orders",
        status=counted(len(groups), "critical speed"),
        answer=f"{answer[:1].upper()}{answer[1:]}.",
        good=not groups,
        lists={"What to do now": _order_steps(content, groups[0] if groups else None, made)},
        table=Table([_largest(one) for one in largest], HOW_LARGEST),
        folds=[
            Fold(
                "Critical speeds",
                [Table([_critical(one) for one in groups[:MOST_CRITICAL]], HOW_CRITICAL)] if groups else [],
                told=True,
            ),
            Fold(
                "Critical speeds of every shaft",
                [Table([_critical(one, "shaft") for one in content["critical"]])] if groups else [],
            ),
        ],
        notes=[f"{' and '.join(sorted(acting))} {'is' if len(acting) == 1 else 'are'} imposed: no torque is known of "
               "what imposes it"] if acting else [],
    )  # fmt: skip


HOW_CRITICAL = (
    "At a critical speed the torque of one order has a maximum close to the pole of a mode. It is at least 1.41 times "
    "(3 dB) the quasi-static torque, the one if no shaft swung, and 10 % above what lies between it and a larger one."
)


def order_data(found: OrderResponse) -> str:
    """Largest torques, peak-to-peak torques and angles over speed (CSV)."""
    head = [f"speed of {found.of} [1/min]", *(f"{name} [N*m]" for name in found.shafts)]
    head += [f"{name} peak to peak [N*m]" for name in found.shafts]
    head += [f"{name} [deg]" for name in found.inertias]
    columns = [TURNS * found.speeds, found.peak_torques, found.peak_to_peak, np.degrees(found.peak_angles)]
    return csv_table(head, np.column_stack(columns).tolist())


ORDER_CAPTION = (
    "Amplitudes about the mean, all orders together: the largest value over a period, at every speed in steady motion. "
    "Dotted lines are critical speeds."
)
register(
    OrderResponse,
    View(
        "response.json", order_report,
        lambda found: {"response": Picture(lambda: order_figure(found), ORDER_CAPTION, order_data(found))},
        folder="", others=lambda found: {"response.csv": order_data(found)},
    ),
)  # fmt: skip
