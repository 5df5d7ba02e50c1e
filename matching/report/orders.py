"""Views of Campbell diagrams and of forced responses to orders."""

from __future__ import annotations

from collections.abc import Mapping
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
from matching.report.page import Fold, Picture, Report, Table, View, register
from modelling.display import counted
from modelling.modal.orders import Campbell, OrderResponse

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
        axes.set(xlim=(speed[0], speed[-1]), ylim=(0, top), ylabel="frequency in Hz")
        axes.set_xlabel(f"speed of {spaced(found.of)} in 1/min")
        fig.legend(loc="outside upper center", ncols=3)
    return fig


def _crossing(one: Mapping[str, Any]) -> dict[str, str]:
    return {
        "speed": practical(one["speed"], "rad/s", 4), "order": number(one["order"], 3), "mode": str(one["mode"]),
        "frequency [Hz]": hertz(one["frequency"]),
    }  # fmt: skip


def _range(content: Mapping[str, Any]) -> str:
    low, high = (f"{TURNS * content['speeds'][at]:.4g}" for at in (0, -1))
    return f"between {low} and {high} 1/min of {spaced(content['of'])}"


def campbell_report(content: Mapping[str, Any], folder: str = "", made: Any = None, result: Any = None) -> Report:
    """Where orders meet modes."""
    met = content["crossings"]
    return Report(
        title="Campbell diagram",
        status=counted(len(met), "crossing"),
        answer=f"{counted(len(met), 'time')} an order meets a mode {_range(content)}.",
        good=not met,
        table=Table([_crossing(one) for one in met]),
    )


def campbell_data(found: Campbell) -> str:
    """Modes over speed (CSV)."""
    head = [f"speed of {found.of} [1/min]", *(f"mode {i + 1} [Hz]" for i in range(found.frequencies.shape[1]))]
    return csv_table(head, np.column_stack([TURNS * found.speeds, found.frequencies]).tolist())


CAMPBELL_CAPTION = "Modes over speed. A dashed line is an order: so many cycles a turn. A ring marks where they meet."
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


def order_figure(found: OrderResponse) -> Figure:
    """Largest torque of the shafts and largest angle of the inertias over speed."""
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
        above.set_ylabel("largest torque\nin N·m")
        below.set_ylabel("largest angle\nin °")
        below.set_xlabel(f"speed of {spaced(found.of)} in 1/min")
    return fig


def _critical(one: Mapping[str, Any]) -> dict[str, str]:
    return {
        "shaft": spaced(one["shaft"]), "critical speed": practical(one["speed"], "rad/s", 4),
        "torque": amount(one["torque"], "N*m", 3), "mostly of order": number(one["order"], 3),
    }  # fmt: skip


def order_report(content: Mapping[str, Any], folder: str = "", made: Any = None, result: Any = None) -> Report:
    """Critical speeds, and the largest torque of every shaft."""
    critical = sorted(content["critical"], key=lambda one: -one["torque"])
    speeds = np.array(content["speeds"])
    rows = []
    for shaft, torque in content["torques"].items():
        at = int(np.argmax(torque))
        rows.append(
            {"shaft": spaced(shaft), "largest torque": amount(torque[at], "N*m", 3),
             "at": practical(speeds[at], "rad/s", 4)}
        )  # fmt: skip
    worst = critical[0] if critical else None
    answer = f"{counted(len(critical), 'critical speed')} of single shafts {_range(content)}"
    if worst is not None:
        speed, torque = practical(worst["speed"], "rad/s", 4), amount(worst["torque"], "N*m", 3)
        answer += f"; the worst is {speed}, where {spaced(worst['shaft'])} carries {torque} beside the mean torque"
    return Report(
        title="Forced response to orders",
        status=counted(len(critical), "critical speed"),
        answer=f"{answer}.",
        good=not critical,
        table=Table([_critical(one) for one in critical[:MOST_CRITICAL]]),
        folds=[Fold("Largest torque of every shaft", [Table(rows)], told=True)],
    )


def order_data(found: OrderResponse) -> str:
    """Largest torques and angles over speed (CSV)."""
    head = [f"speed of {found.of} [1/min]", *(f"{name} [N*m]" for name in found.shafts)]
    head += [f"{name} [deg]" for name in found.inertias]
    columns = [TURNS * found.speeds, found.peak_torques, np.degrees(found.peak_angles)]
    return csv_table(head, np.column_stack(columns).tolist())


ORDER_CAPTION = (
    "Amplitudes about the mean, all orders together: the largest value over a period, at every speed in steady motion."
)
register(
    OrderResponse,
    View(
        "response.json", order_report,
        lambda found: {"response": Picture(lambda: order_figure(found), ORDER_CAPTION, order_data(found))},
        folder="", others=lambda found: {"response.csv": order_data(found)},
    ),
)  # fmt: skip
