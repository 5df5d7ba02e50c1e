"""Panel of a map that shows the share of drawn beds that are stable."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib import colormaps
from matplotlib.colors import LinearSegmentedColormap

from matching.frequency.studies.map import Map
from matching.report.common.wording import number

TITLE = "Share of drawn beds that are stable"
MOST_WRITTEN = 6  # values per axis up to which every field has its share in numbers
RING_CLEARANCE = 17  # points from the middle of the ring to that of a number below it
SHADES = (0.04, 0.66)  # part of the colour map: light enough for black numbers everywhere


def stable_shares(result: Map) -> np.ndarray | None:
    """Shares (y, x) in percent, NaN where no beds judge the match; None where they judge none."""
    shares = 100 * result.errors("stable_beds")
    return shares if np.isfinite(shares).any() else None


def draw_stable_beds(axes: Any, result: Map, columns: np.ndarray, rows: np.ndarray) -> None:
    """Fields with the share of stable beds; borders (x + 1,), (y + 1,) of the fields."""
    shares = 100 * result.errors("stable_beds")
    colours = LinearSegmentedColormap.from_list(
        "shares", colormaps["viridis"](np.linspace(1 - SHADES[1], 1 - SHADES[0], 64))
    )
    fields = axes.pcolormesh(columns, rows, np.ma.masked_invalid(shares), cmap=colours, vmin=0, vmax=100)
    axes.figure.colorbar(fields, ax=axes, format="%g", label="stable beds in %")
    axes.set(title=TITLE, xlim=columns[[0, -1]], ylim=rows[[0, -1]])
    if max(shares.shape) > MOST_WRITTEN:
        return
    for y, line in zip(result.y.values, shares, strict=True):
        for x, share in zip(result.x.values, line, strict=True):
            if np.isfinite(share):
                look: Any = {"ha": "center", "va": "center", "fontsize": 8, **beside_ring(result, x, y)}
                axes.annotate(f"{number(float(share), 4)} %", (x, y), **look)


def beside_ring(result: Map, x: float, y: float) -> dict[str, Any]:
    """Where the number of a field stands: below the ring where the case is, in the middle elsewhere."""
    ring = (x, y) == (result.x.here, result.y.here)
    return {"xytext": (0, -RING_CLEARANCE if ring else 0), "textcoords": "offset points"}
