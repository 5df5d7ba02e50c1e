"""What a figure says besides its numbers: labels, legends, how many curves, bars and areas; kept in a list.

The list is ``tests/kept/figures.json``; ``make kept`` renews it.

Digits are left out (``#``), so a figure of another size fails only where words or counts change. The numbers drawn are
compared with the result by the test of each figure.
"""

import re
from typing import Any

from kept_lists import kept
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection, PathCollection, PolyCollection, QuadMesh
from matplotlib.figure import Figure
from matplotlib.ticker import FixedFormatter, FuncFormatter, NullLocator

NUMBER = re.compile(r"[-−]?\d[\d.,]*(e[-+−]?\d+)?")
COLLECTIONS = {"points": PathCollection, "areas": PolyCollection, "fields": QuadMesh, "strokes": LineCollection}


def _words(text: str) -> str:
    return NUMBER.sub("#", text)


def _legend(owner: Axes | Figure) -> list[str]:
    legends = owner.legends if isinstance(owner, Figure) else [owner.get_legend()]
    return [_words(text.get_text()) for legend in legends if legend for text in legend.get_texts()]


def _names(axis: Any) -> list[str]:
    """Names at the ticks where somebody set them; sorted, for alike quantities rank by rounding."""
    if not isinstance(axis.get_major_formatter(), FixedFormatter | FuncFormatter):
        return []
    return sorted(_words(label.get_text()) for label in axis.get_ticklabels())


def _axes_facts(axes: Axes) -> dict[str, Any]:
    facts = {
        "title": _words(axes.get_title()),
        "x": _words(axes.get_xlabel()),
        "y": _words(axes.get_ylabel()),
        "scales": [axes.get_xscale(), axes.get_yscale()],
        "without minor ticks": [isinstance(axis.get_minor_locator(), NullLocator) for axis in (axes.xaxis, axes.yaxis)],
        "limits set": [not axes.get_autoscalex_on(), not axes.get_autoscaley_on()],
        "left out": not (axes.axison and axes.get_visible()),
        "lines": len(axes.get_lines()),
        "patches": len(axes.patches),
        "x names": _names(axes.xaxis),
        "y names": _names(axes.yaxis),
        "legend": _legend(axes),
        "texts": sorted(_words(text.get_text()) for text in axes.texts),
    }
    for name, kind in COLLECTIONS.items():
        facts[name] = sum(isinstance(own, kind) for own in axes.collections)
    return {name: fact for name, fact in facts.items() if fact}


def figure_facts(figure: Figure) -> list[dict[str, Any]]:
    """Every axes in order, then the legend of the whole figure."""
    whole = {"legend of the figure": _legend(figure), "title": figure.get_suptitle()}
    return [_axes_facts(axes) for axes in figure.axes] + [{name: fact for name, fact in whole.items() if fact}]


def same_figure(name: str, figure: Figure) -> None:
    """Compare a figure with what is kept under the name."""
    present = figure_facts(figure)
    assert present == kept("figures.json", name, present)
