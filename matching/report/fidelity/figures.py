"""Figures of a fidelity case: fidelity over delay (Fig. 6), what is lost to which cause, and at which frequencies."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from matching.report.common import style
from matching.report.common.wording import spaced
from matching.validity.fidelity.result import XilFidelity
from modelling.fidelity.measures import delay_fidelity

LARGEST = 15  # causes in the bar chart
COLOURS = {"dynamics": style.RIG, "model": style.VEHICLE, "measurement": style.NOISE}
HATCHES = {"dynamics": "", "model": "///", "measurement": "..."}
MARKS = {"system_dynamics": ("o", style.RIG), "residual_vehicle_model": ("s", style.VEHICLE)}


@dataclass(frozen=True)
class _Point:
    """A signal on the curve: its delay in s, never negative, and R_τ."""

    domain: str
    signal: str
    delay: float
    fidelity: float


def delay_curve(xil: XilFidelity) -> Figure:
    """R_τ over the delay for f_max (Fig. 6) with the case's signals on it."""
    f_max = xil.fidelity.f_max
    points = [
        _Point(domain, signal.name, abs(signal.delay.nearest), signal.delay_fidelity)
        for domain, members in xil.fidelity.signals.items()
        for signal in members
        if signal.delay.nearest is not None
    ]
    half_delay = 1 / (6 * f_max)  # s, where R_τ is ½ (Eq. 20)
    longest = max([4 * half_delay, *(1.15 * point.delay for point in points)])
    delays = np.linspace(0, longest, 400)
    with style.styled():
        fig = style.figure(6.0, 3.6)
        axes = fig.add_subplot()
        axes.plot(1000 * delays, delay_fidelity(delays, f_max), color="black")
        axes.plot(
            [1000 * half_delay, 1000 * half_delay, 0],
            [0, 0.5, 0.5],
            color=style.LIMIT,
            linestyle="--",
            lw=1,
            label=f"½ at 1/(6·f_max) = {1000 * half_delay:.2f} ms",
        )
        for domain, (mark, colour) in MARKS.items():
            members = [point for point in points if point.domain == domain]
            if members:
                axes.plot(
                    [1000 * point.delay for point in members],
                    [point.fidelity for point in members],
                    mark,
                    color=colour,
                    clip_on=False,
                    zorder=3,
                    label=spaced(domain),
                )
            for place, point in enumerate(sorted(members, key=lambda member: member.delay)):
                axes.annotate(
                    point.signal,
                    (1000 * point.delay, point.fidelity),
                    (6, 5 if place % 2 else -12),  # points; above and below in turn, so that names do not overlap
                    textcoords="offset points",
                    fontsize=8,
                )
        axes.set_xlabel("delay τ in ms")
        axes.set_ylabel("R_τ")
        axes.set_ylim(0, 1.08)
        axes.set_xlim(left=0)
        axes.set_title(f"Fidelity of a delay, f_max = {f_max:g} Hz (Eqs. 19, 20)", fontsize=9)
        axes.legend(loc="upper right")
    return fig


def attribution_figure(xil: XilFidelity) -> Figure:
    """Gain in R_XiL if a single cause were removed, largest first.

    Raises
    ------
    ValueError
        For the published arithmetic, which has no attribution.
    """
    if xil.attribution is None:
        raise ValueError("attribution needs the arithmetic of the definition")
    losses = xil.attribution.losses[:LARGEST]
    with style.styled():
        fig = style.figure(8.2, 1.2 + 0.3 * max(len(losses), 2))
        axes = fig.add_subplot()
        axes.grid(visible=False, axis="y")
        for place, loss in enumerate(losses):
            bar = axes.barh(place, 100 * loss.gain, label=loss.origin, **_look(loss.origin))
            axes.bar_label(bar, [f"{100 * loss.gain:.2g}"], padding=3, fontsize=8)
        axes.set_yticks(range(len(losses)), [f"{loss.signal}: {loss.cause}" for loss in losses])
        axes.invert_yaxis()
        axes.margins(x=0.1)
        now = f"now {100 * xil.R_XiL:.2f} %"
        axes.set_xlabel(f"gain in R_XiL in percentage points if this cause alone were removed ({now})")
        present = {loss.origin for loss in losses}
        shares = xil.attribution.by_origin
        handles: Any = [axes.barh(0, 0, **_look(origin)) for origin in COLOURS if origin in present]
        fig.legend(
            handles,
            [f"{origin}: {100 * shares[origin]:.3g} % of the loss" for origin in COLOURS if origin in present],
            loc="outside right center",
        )
    return fig


def _look(origin: str) -> dict[str, Any]:
    return {"color": COLOURS[origin], "hatch": HATCHES[origin], "edgecolor": "white", "linewidth": 0}


def bands_figure(xil: XilFidelity) -> Figure:
    """Deviation of each signal over frequency: height is the root mean square in the band over the signal's range."""
    panels = [(domain, name, rows) for domain, signals in xil.bands.items() for name, rows in signals.items()]
    with style.styled():
        fig = style.figure(6.4, 0.6 + 1.8 * len(panels))
        for place, (domain, name, rows) in enumerate(panels):
            axes = fig.add_subplot(len(panels), 1, place + 1)
            last = rows[-1].low
            for number, band in enumerate(rows):
                high = band.high if math.isfinite(band.high) else 1.15 * last
                height = 100 * (1 - band.nrmse)
                for share, floor, hatch in (
                    (band.amplitude_share, 0.0, ""),
                    (band.phase_share, band.amplitude_share, "///"),
                ):
                    axes.bar(
                        (band.low + high) / 2,
                        height * share,
                        0.94 * (high - band.low),
                        bottom=height * floor,
                        hatch=hatch,
                        edgecolor="white",
                        color=MARKS[domain][1],
                        label=("phase" if hatch else "amplitude") if number == 0 and place == 0 else None,
                    )
            axes.axvspan(last, 1.18 * last, color=style.BAND, zorder=0)
            axes.set_xlim(0, 1.18 * last)
            axes.set_ylabel("deviation in % of range")
            axes.set_title(f"{spaced(domain)}: {name}", fontsize=9)
        axes.set_xlabel("frequency in Hz (grey: everything above f_max)")
        if panels:
            fig.legend(loc="outside upper right", ncols=2)
    return fig
