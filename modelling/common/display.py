"""What every result can do: draw itself, show itself in print and notebook, hand its arrays on with labels."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from importlib import import_module
from typing import Any, ClassVar

from modelling.common.errors import InputError


class Shown:
    """A result with a picture and a table.

    The views live above this package, so a result knows its view by name only and finds it when it is asked.
    """

    _view: ClassVar[str]

    def plot(self) -> Any:
        """The picture of this result, a Matplotlib figure without any global state."""
        return import_module(self._view).plot(self)

    def __str__(self) -> str:
        said: str = import_module(self._view).said(self)
        return said

    def _repr_html_(self) -> str:
        html: str = import_module(self._view).html(self)
        return html


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
            "in rigmatch's folder: pip install -e '.[notebooks]', or use to_dict()",
        ) from None
    return xarray.Dataset(
        {name: (tuple(dimensions), values, {"units": unit}) for name, (dimensions, values, unit) in variables.items()},
        {name: (name, values, {"units": unit} if unit else {}) for name, (values, unit) in coordinates.items()},
    )
