"""Learning over repetitions: its figure and what it says."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from matplotlib.figure import Figure

from matching.bed.learn import CONTROLLER, TABLE, Learned
from matching.report.common import MATCHED, RIG, decimated, figure, legend_above, number, percent, spaced, styled, unit
from matching.report.page import Picture, Report, Step, Table, View, register

HOW = "Errors: root mean square over the range of the vehicle's signal, mean of the compared sensors."
CAPTION = (
    "Above: what the controlled bed is off from the vehicle, the mean of the repetitions, and what is expected the "
    "next time. Below: the torques to be added."
)


def learned_figure(learned: Learned) -> Figure:
    """A panel a sensor: error and expectation; below them the torques."""
    error, predicted = learned.traces
    panels = len(learned.sensors) + 1
    with styled():
        fig = figure(8.0, 0.6 + 1.7 * panels)
        rows = fig.subplots(panels, 1, sharex=True)
        for axes, name, si, was, next_one in zip(rows, learned.sensors, learned.units, error.T, predicted.T):
            axes.plot(*decimated(learned.time, was), color=RIG, linestyle="--", label="error")
            axes.plot(*decimated(learned.time, next_one), color=MATCHED, label="expected")
            axes.set_ylabel(f"{spaced(name)}\nin {unit(si)}", fontsize=8)
        for name, torque in zip(learned.dynamometers, learned.torques.T, strict=True):
            rows[-1].plot(*decimated(learned.time, torque), label=spaced(name))
        rows[-1].set(xlabel="Time from the trigger in s", ylabel="added torque\nin N·m")
        rows[-1].legend(fontsize=8)
        legend_above(fig, rows[0])
    return fig


def learned_report(content: Mapping[str, Any], folder: str = "OUT", *_: Any) -> Report:
    """What repeats, what does not, and whether another repetition is worth it."""
    errors = [*content["history"], content["error"]]
    rows = [{"repetition": str(n), "error": percent(error)} for n, error in enumerate(errors, 1)]
    rows.append({"repetition": f"{len(errors) + 1}, expected", "error": percent(content["predicted"])})
    steps = [
        Step(
            "Repeat the manoeuvre twice or more with the torques played from its trigger on",
            command=f"{folder}/{CONTROLLER}",
        ),
        Step("Then learn again", command=f"rigmatch learn CASE RECORDING RECORDING --played {folder} --out NEXT"),
    ]
    return Report(
        title="Learned over repetitions",
        status="learned" if content["worth"] else "nothing more to learn",
        answer=f"{content['sentence'][0].upper()}{content['sentence'][1:]}.",
        good=True,
        lists={"What to do now": steps} if content["worth"] else {},
        table=Table(rows, HOW),
        notes=[f"the largest torque that is added is {number(content['largest_torque'], 3)} N·m"],
    )  # fmt: skip


register(
    Learned,
    View(
        "learned.json", learned_report, lambda learned: {"learned": Picture(lambda: learned_figure(learned), CAPTION)},
        others=lambda learned: {TABLE: learned.table(), CONTROLLER: learned.fmu()},
    ),
)  # fmt: skip
