"""Ticks and the room that their texts need, worked out once for a size of the axes: Matplotlib does it four times."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from matplotlib.figure import Figure

REPEATED = ("_update_ticks", "_get_ticklabel_bboxes")  # of an axis; without these names nothing is kept


@contextmanager
def ticks_kept(fig: Figure) -> Iterator[None]:
    """While a figure is laid out and drawn its ticks are those of before, unless limits, size or place change."""
    axes_of_figure = [axis for axes in fig.axes for axis in (axes.xaxis, axes.yaxis)]
    changed = [(axis, name) for axis in axes_of_figure for name in REPEATED if hasattr(axis, name)]
    for axis, name in changed:
        setattr(axis, name, _kept(axis, getattr(axis, name)))
    try:
        yield
    finally:
        for axis, name in changed:
            delattr(axis, name)


def _kept(axis: Any, method: Callable[..., Any]) -> Callable[..., Any]:
    last: list[Any] = [None, None]

    def ask(*arguments: Any, **options: Any) -> Any:
        state = (
            axis.axes.bbox.bounds, axis.get_figure(root=True).dpi, tuple(axis.get_view_interval()), axis.get_scale(),
            axis.major.locator, axis.major.formatter, [id(argument) for argument in arguments],
        )  # fmt: skip
        if state != last[0]:
            last[:] = state, method(*arguments, **options)
        return last[1]

    return ask
