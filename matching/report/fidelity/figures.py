"""Figures of a fidelity case: the delay's curve (Fig. 6), what is lost to what, and where in frequency."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.figure import Figure

from matching.report.common import style
from modelling.fidelity.measures import delay_fidelity

COLOURS = {"dynamics": style.RIG, "model": style.VEHICLE, "measurement": style.NOISE}
HATCHES = {"dynamics": "", "model": "///", "measurement": "..."}
MARKS = {"system_dynamics": ("o", style.RIG), "residual_vehicle_model": ("s", style.VEHICLE)}


def delay_curve(answer: dict[str, Any]) -> Figure:
    """R_τ over the delay for f_max (Fig. 6), with the case's signals on it. ``answer`` is ``fidelity.json``."""
    f_max = answer["f_max"]
    points = [
        (domain, one)
        for domain, members in answer["signals"].items()
        for one in members
        if one["nearest_delay"] is not None
    ]
    longest = max([4 / (6 * f_max), *(1.15 * abs(one["nearest_delay"]) for _, one in points)])
    delays = np.linspace(0, longest, 400)
    with style.styled():
        drawn = style.figure(6.0, 3.6)
        axes = drawn.add_subplot()
        axes.plot(1000 * delays, delay_fidelity(delays, f_max), color="black")
        half = 1000 / (6 * f_max)
        axes.plot(
            [half, half, 0],
            [0, 0.5, 0.5],
            color=style.LIMIT,
            linestyle="--",
            lw=1,
            label=f"½ at 1/(6·f_max) = {half:.2f} ms",
        )
        for domain, (mark, colour) in MARKS.items():
            own = [one for name, one in points if name == domain]
            if own:
                axes.plot(
                    [1000 * abs(one["nearest_delay"]) for one in own],
                    [one["R_tau"] for one in own],
                    mark,
                    color=colour,
                    clip_on=False,
                    zorder=3,
                    label=domain.replace("_", " "),
                )
            for number, one in enumerate(sorted(own, key=lambda one: abs(one["nearest_delay"]))):
                axes.annotate(
                    one["name"],
                    (1000 * abs(one["nearest_delay"]), one["R_tau"]),
                    (6, 5 if number % 2 else -12),  # neighbours' names stay apart
                    textcoords="offset points",
                    fontsize=8,
                )
        axes.set_xlabel("delay τ in ms")
        axes.set_ylabel("R_τ")
        axes.set_ylim(0, 1.08)
        axes.set_xlim(left=0)
        axes.set_title(f"Fidelity of a delay, f_max = {f_max:g} Hz (Eqs. 19, 20)", fontsize=9)
        axes.legend(loc="upper right")
    return drawn


def attribution(answer: dict[str, Any]) -> Figure:
    """What R_XiL would rise by if one cause alone were put right, largest first."""
    losses = answer["attribution"]["ranked"][:15]
    with style.styled():
        drawn = style.figure(8.2, 1.2 + 0.3 * max(len(losses), 2))
        axes = drawn.add_subplot()
        axes.grid(visible=False, axis="y")
        for place, loss in enumerate(losses):
            bar = axes.barh(place, 100 * loss["gain"], **_look(loss["origin"]))
            axes.bar_label(bar, [f" {100 * loss['gain']:.2g}"], fontsize=8)
        axes.set_yticks(range(len(losses)), [f"{loss['signal']}: {loss['cause']}" for loss in losses])
        axes.invert_yaxis()
        axes.margins(x=0.1)
        axes.set_xlabel(f"gain in R_XiL in percentage points if put right alone (now {100 * answer['R_XiL']:.2f} %)")
        present = {loss["origin"] for loss in losses}
        shares = answer["attribution"]["by_origin"]
        handles: Any = [axes.barh(0, 0, **_look(origin)) for origin in COLOURS if origin in present]
        drawn.legend(
            handles,
            [f"{origin}: {100 * shares[origin]:.3g} % of the loss" for origin in COLOURS if origin in present],
            loc="outside right center",
        )
    return drawn


def _look(origin: str) -> dict[str, Any]:
    return {"color": COLOURS[origin], "hatch": HATCHES[origin], "edgecolor": "white", "linewidth": 0}


def bands(answer: dict[str, Any]) -> Figure:
    """For each signal, its deviation over frequency: height is the band's root mean square over the range."""
    panels = [(domain, name, found) for domain, signals in answer["bands"].items() for name, found in signals.items()]
    with style.styled():
        drawn = style.figure(6.4, 0.6 + 1.8 * len(panels))
        for place, (domain, name, found) in enumerate(panels):
            axes = drawn.add_subplot(len(panels), 1, place + 1)
            last = found[-1]["low"]
            for number, band in enumerate(found):
                high = band["high"] if band["high"] is not None else 1.15 * last
                height = 100 * (1 - band["nrmse"])
                for share, floor, hatch in (
                    (band["amplitude_share"], 0.0, ""),
                    (band["phase_share"], band["amplitude_share"], "///"),
                ):
                    axes.bar(
                        (band["low"] + high) / 2,
                        height * share,
                        0.94 * (high - band["low"]),
                        bottom=height * floor,
                        hatch=hatch,
                        edgecolor="white",
                        color=MARKS[domain][1],
                        label=("phase" if hatch else "amplitude") if number == 0 and place == 0 else None,
                    )
            axes.axvspan(last, 1.18 * last, color=style.BAND, zorder=0)
            axes.set_xlim(0, 1.18 * last)
            axes.set_ylabel("deviation in % of range")
            axes.set_title(f"{domain.replace('_', ' ')}: {name}", fontsize=9)
        axes.set_xlabel("frequency in Hz (grey: all above f_max)")
        if panels:
            drawn.legend(loc="outside upper right", ncols=2)
    return drawn
