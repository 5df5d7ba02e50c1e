"""Figure of the loop's distance from instability: smallest singular value of I + L, and the loci of L."""

from __future__ import annotations

from typing import Any

import numpy as np
import scipy
from matplotlib.figure import Figure
from matplotlib.patches import Circle

from matching.frequency.beds.closed_loop import action, bed_set
from matching.frequency.beds.closed_loop import return_difference as sampled_difference
from matching.frequency.case.case import Case
from matching.frequency.loop.exact_loop import ExactLoop
from matching.frequency.loop.parts import parts_of
from matching.frequency.verification.observed import controller_of
from matching.report.common.style import LIMIT, MATCHED, figure, styled
from matching.report.common.wording import number

LOWEST_HZ, HIGHEST_HZ = 1e-2, 500.0  # below, only the integrator acts; above, the loop gain is negligible
POINTS = 2000


def return_difference(case: Case, frequencies: np.ndarray) -> np.ndarray:
    """I + L (f, u, u) of a case's feedback loop at frequencies (f,), Hz, dead time exact."""
    if case.loop.structure.is_observer:
        bed = bed_set(case, [{}], frequencies)
        return sampled_difference(bed, action(controller_of(case), frequencies))[0]
    return ExactLoop(parts_of(case)).return_difference(2j * np.pi * frequencies)


def frequencies_around(modes: list[float]) -> np.ndarray:
    """A grid (f,) in Hz, dense around the modes, where the response of a lightly damped loop changes fast."""
    near = [np.linspace(0.92, 1.08, 201) * mode for mode in modes if LOWEST_HZ < mode < HIGHEST_HZ]
    return np.unique(np.concatenate([np.geomspace(LOWEST_HZ, HIGHEST_HZ, POINTS), *near]))


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
