"""How results are displayed: as a figure, as text, as HTML in a notebook; as tables, labelled arrays and files.

Results do not know how they are drawn. ``matching.report`` registers a function a class with :func:`plot`,
:func:`text`, :func:`html` and :func:`files`. It is imported the first time a result is displayed, by the provider that
the package ``matching`` registers here.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterator, Mapping, Sequence, Sized
from functools import singledispatch
from pathlib import Path
from typing import Any

from modelling.errors import InputError, unknown
from modelling.writing import write_all, write_results

# Name and content of a result's file (no name: there is none), and its other files: page, figures, models.
ResultFiles = tuple[str, dict[str, Any], dict[str, str | bytes]]
LONGEST_REPR = 120  # characters: a line of a terminal

_providers: list[Callable[[type], None]] = []


def counted(count: int, singular: str, plural: str = "") -> str:
    """A number with its noun: ``1 point``, ``2 points``; ``plural`` where it is not the singular with an s."""
    return f"{count} {singular}" if count == 1 else f"{count} {plural or singular + 's'}"


def register_provider(provider: Callable[[type], None]) -> None:
    """Let ``provider(class)`` import the module with the views of a class, the first time one is displayed."""
    _providers.append(provider)


class Displayed:
    """A result with a figure and a table."""

    def __init_subclass__(cls, **keywords: Any) -> None:
        super().__init_subclass__(**keywords)
        cls._repr_pretty_ = Displayed._repr_pretty_  # type: ignore[method-assign]  # IPython looks in the class first
        cls.__repr__ = Displayed.__repr__  # type: ignore[method-assign]  # a dataclass would print every array

    def plot(self) -> Any:
        """This result as a Matplotlib figure, without any global state."""
        return plot(self)

    def to_dict(self) -> dict[str, Any]:
        """What the result's file holds, SI."""
        raise NotImplementedError

    def to_dataframe(self, table: str | None = None) -> Any:
        """A table of the result.

        Parameters
        ----------
        table : str, optional
            Which one: the place of a list of tables in :meth:`to_dict`, e.g. ``"vehicle.modes"``; by default the first.

        Returns
        -------
        pandas.DataFrame
            A row an entry, SI; the names of nested entries are joined by points, and name their unit where it is the
            same in all rows.

        Raises
        ------
        InputError
            If there is no such table (the line names those there are), or pandas is not installed.
        """
        return data_frame(self.to_dict(), table)

    def save(self, folder: str | Path) -> Path:
        """Write what the command writes: the result's file, its report and figures.

        Parameters
        ----------
        folder : path
            Made where it does not exist; :func:`rigmatch.load_result` reads it again.

        Returns
        -------
        Path
            The folder.

        Raises
        ------
        InputError
            If it cannot be written to.
        """
        name, content, others = files(self, str(folder))
        if name:
            write_results(folder, name, content, others)
        else:
            write_all(folder, others)
        return Path(folder)

    def __repr__(self) -> str:
        """One line: texts and numbers as they are, of everything else how many entries it has."""
        said = []
        for field in dataclasses.fields(self) if dataclasses.is_dataclass(self) else ():  # type: ignore[var-annotated]
            value: Any = getattr(self, field.name) if field.repr else None
            if isinstance(value, str | int | float):
                said.append(f"{field.name}={value!r}")
            elif isinstance(value, Sized) and len(value):
                said.append(f"{field.name}[{len(value)}]")
        line = f"{type(self).__name__}({', '.join(said)})"
        return line if len(line) <= LONGEST_REPR else f"{line[: LONGEST_REPR - 2]}…)"

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


@singledispatch
def files(result: Any, folder: str, made: Any = None, more: Mapping[str, Any] | None = None) -> ResultFiles:
    """What :meth:`Displayed.save` writes to a folder, whose name a page shows in its commands.

    ``made`` says on the page what the result was made from; ``more`` are further entries of the result's file. Raises
    as :func:`plot` does.
    """
    view: Any = _registered(files, result)
    answer: ResultFiles = view(result, folder, made, **({"more": more} if more else {}))
    return answer


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


def tables(content: Mapping[str, Any], place: str = "") -> Iterator[tuple[str, list[dict[str, Any]]]]:
    """Every list of tables of a result's content with its place, those of the top first."""
    for key, value in content.items():
        if isinstance(value, list) and value and all(isinstance(row, Mapping) for row in value):
            yield f"{place}{key}", value
    for key, value in content.items():
        if isinstance(value, Mapping):
            yield from tables(value, f"{place}{key}.")


def data_frame(content: Mapping[str, Any], table: str | None) -> Any:
    """A table of a result's content as a pandas DataFrame; raises as :meth:`Displayed.to_dataframe`."""
    found = dict(tables(content))
    if not found or table not in (None, *found):
        raise unknown(table or "a table", list(found), "to_dataframe")
    rows = found[table or next(iter(found))]
    frame = _optional_package("pandas", "to_dataframe").json_normalize(rows)
    numbers = frame.select_dtypes("number").columns
    return frame.rename(columns={name: with_unit(name, UNITS.get(name.rpartition(".")[2], "")) for name in numbers})


def series_frame(over: Any, name: str, columns: Mapping[str, Any], units: Mapping[str, str] | None = None) -> Any:
    """Columns (t,) over a named index (t,) as a pandas DataFrame; raises as :meth:`Displayed.to_dataframe`.

    ``units`` by column name stand behind it, and by the whole name in ``attrs["units"]``.
    """
    pandas, units = _optional_package("pandas", "to_dataframe"), units or {}
    whole = {name: with_unit(name, units.get(name, "")) for name in columns}
    frame = pandas.DataFrame({whole[name]: values for name, values in columns.items()})
    frame.index = pandas.Index(over, name=name)
    frame.attrs["units"] = {whole[name]: units.get(name, "") for name in columns}
    return frame


# Of the numbers under these names in tables of results; all others state their unit in a column, or have none.
UNITS = dict.fromkeys(("frequency", "vehicle", "rig", "matched", "seen_in_simulation"), "Hz")


def with_unit(name: str, unit: str) -> str:
    """A column's name as recordings have it: ``name [unit]``; a name alone where there is no unit."""
    return f"{name} [{unit}]" if unit not in ("", "1") else name


def _optional_package(name: str, method: str) -> Any:
    from importlib import import_module

    try:
        return import_module(name)
    except ImportError:
        right = 'in rigmatch\'s folder: pip install -e ".[notebooks]", or use to_dict()'
        raise InputError(method, f"{name} is not installed", right) from None


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
    xarray = _optional_package("xarray", "to_xarray")
    return xarray.Dataset(
        {name: (tuple(dimensions), values, {"units": unit}) for name, (dimensions, values, unit) in variables.items()},
        {name: (name, values, {"units": unit} if unit else {}) for name, (values, unit) in coordinates.items()},
    )
