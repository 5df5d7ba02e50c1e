"""How results are displayed: as a figure, as text, as HTML in a notebook; and their arrays with labels.

Results do not know how they are drawn. ``matching.report`` registers a function a class with :func:`plot`,
:func:`text` and :func:`html`. It is imported the first time a result is displayed, by the provider that the package
``matching`` registers here.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import singledispatch
from typing import Any

from modelling.errors import InputError

_providers: list[Callable[[type], None]] = []


def register_provider(provider: Callable[[type], None]) -> None:
    """Let ``provider(class)`` import the module with the views of a class, the first time one is displayed."""
    _providers.append(provider)


class Displayed:
    """A result with a figure and a table."""

    def __init_subclass__(cls, **keywords: Any) -> None:
        super().__init_subclass__(**keywords)
        cls._repr_pretty_ = Displayed._repr_pretty_  # type: ignore[method-assign]  # IPython looks in the class first

    def plot(self) -> Any:
        """This result as a Matplotlib figure, without any global state."""
        return plot(self)

    def __str__(self) -> str:
        return text(self)

    def _repr_html_(self) -> str:
        return html(self)

    def _repr_pretty_(self, printer: Any, cycle: bool) -> None:
        """What IPython shows and a notebook keeps beside the HTML: the few lines, not every field of every array."""
        printer.text(text(self))


@singledispatch
def plot(result: Any) -> Any:
    """A result as a Matplotlib figure.

    Raises
    ------
    InputError
        If no view is registered for its class.
    """
    return _registered(plot, result)(result)


@singledispatch
def text(result: Any) -> str:
    """A result in a few lines for a terminal; raises as :func:`plot` does."""
    return _registered(text, result)(result)


@singledispatch
def html(result: Any) -> str:
    """A result as HTML for a notebook; raises as :func:`plot` does."""
    return _registered(html, result)(result)


@singledispatch
def animation(result: Any) -> Any:
    """A result as a moving drawing with ``save(path)``; raises as :func:`plot` does."""
    return _registered(animation, result)(result)


def _registered(function: Any, result: Any) -> Callable[[Any], Any]:
    """The view registered for the class of a result, after the providers were asked to import it."""
    for provider in _providers:
        for base in type(result).__mro__:
            provider(base)
    view: Callable[[Any], Any] = function.dispatch(type(result))
    if view is function.dispatch(object):
        name = type(result).__name__
        raise InputError(name, "has no view yet", "import matching, which brings the figures and tables")
    return view


def labelled(
    variables: Mapping[str, tuple[Sequence[str], Any, str]], coordinates: Mapping[str, tuple[Any, str]]
) -> Any:
    """An xarray Dataset.

    Parameters
    ----------
    variables : mapping of str to (dimensions, values, unit)
    coordinates : mapping of str to (values, unit)
        By dimension; the unit may be empty.

    Raises
    ------
    InputError
        If xarray is not installed.
    """
    try:
        import xarray
    except ImportError:
        raise InputError(
            "to_xarray",
            "xarray is not installed",
            'in rigmatch\'s folder: pip install -e ".[notebooks]", or use to_dict()',
        ) from None
    return xarray.Dataset(
        {name: (tuple(dimensions), values, {"units": unit}) for name, (dimensions, values, unit) in variables.items()},
        {name: (name, values, {"units": unit} if unit else {}) for name, (values, unit) in coordinates.items()},
    )
