"""|S| and |T| of the feedback loop over frequency, with the limits that the case sets."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from matplotlib.figure import Figure

from matching.frequency.beds.requirements import LARGEST_ROLLED_OFF, Requirements
from matching.frequency.case.case import Case
from matching.report.common.style import LIMIT, MATCHED, RIG, figure, styled
from matching.report.controller.margin_figure import LOWEST_HZ, frequencies_around, return_difference


@dataclass(frozen=True)
class CurveLimit:
    """The largest value that a curve may have, from a frequency (Hz) on."""

    curve: str
    largest: float
    begins: float

    @property
    def words(self) -> str:
        """For a figure."""
        from_there = f" from {self.begins:.3g} Hz" if self.begins > LOWEST_HZ else ""
        return f"{self.curve} ≤ {self.largest:g}{from_there}"


@dataclass(frozen=True)
class SensitivityCurves:
    """Largest singular values (f,) of S = (I + L)⁻¹ and T = I − S over frequency, Hz, and what the case allows."""

    frequencies: np.ndarray
    S: np.ndarray
    T: np.ndarray
    limits: tuple[CurveLimit, ...]


def sensitivity(case: Case, modes: list[float], required: Requirements | None) -> SensitivityCurves:
    """Of a tuned case; the grid is dense around ``modes``, Hz.

    Without requirements on drawn beds the margin counts at every frequency, and the roll-off nowhere.

    Raises
    ------
    InputError
        If a model cannot be made linear.
    """
    f = frequencies_around(modes)
    f = f[f < 0.499 / case.loop["sample_time"]]
    S = np.linalg.inv(return_difference(case, f))
    T = np.eye(S.shape[-1]) - S
    largest_S, begins = 1 / case.limits["modulus_margin"], float(f[0])
    limits = [CurveLimit("|S|", largest_S, begins)]
    if required is not None:
        limits = [
            CurveLimit("|S|", largest_S, required.margin_from),
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
