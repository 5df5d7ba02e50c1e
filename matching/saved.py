"""A result read from the folder that a command or ``save`` wrote it to."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import TYPE_CHECKING, Any

from matching.report import RESULTS
from modelling import display
from modelling.display import Displayed, series_frame, with_unit
from modelling.errors import InputError, unknown

if TYPE_CHECKING:
    import numpy as np


class Entries(dict[str, Any]):
    """A table of a result's file, whose entries are attributes, too."""

    def __getattr__(self, name: str) -> Any:
        try:
            return self[name]
        except KeyError:
            raise AttributeError(f"there is no entry {name!r}, but {', '.join(self)}") from None


@dataclass(frozen=True)
class SavedResult(Displayed):
    """What a result's file holds, entry by entry as attributes: ``saved.status``, ``saved.response_error.after``.

    Attributes
    ----------
    path : Path
        The file.
    command : str
        The command whose result it is.
    content : Entries
    """

    path: Path
    command: str
    content: Entries

    def __getattr__(self, name: str) -> Any:
        return getattr(self.__dict__.get("content", Entries()), name)

    def to_dict(self) -> dict[str, Any]:
        """The content of the file."""
        return self.content

    def plot(self, name: str = "") -> SavedFigure:
        """A figure as it was drawn when the result was saved; shows itself in a notebook.

        Parameters
        ----------
        name : str
            Of the file, with or without folder and ending; the result's first figure unless given.

        Raises
        ------
        InputError
            If there is no such figure; the line names those there are.
        """
        return figure_beside(self.path, self.content.get("files", ()), name)


@dataclass(frozen=True)
class SavedCurves(Displayed):
    """Curves that a simulation or a frequency response has saved as CSV: ``saved["motor_speed"]`` is one, (t,).

    Attributes
    ----------
    path : Path
    over : str
        Name of the axis with its unit, ``time [s]`` or ``frequency [Hz]``.
    axis : ndarray (t,)
    curves : dict of str to ndarray (t,)
    units : dict of str to str
    """

    path: Path
    over: str
    axis: np.ndarray
    curves: dict[str, np.ndarray]
    units: dict[str, str]

    def __getitem__(self, name: str) -> np.ndarray:
        if name not in self.curves:
            raise unknown(name, list(self.curves), str(self.path))
        return self.curves[name]

    def to_dict(self) -> dict[str, Any]:
        """The axis and every curve as lists, by name."""
        curves = {name: values.tolist() for name, values in self.curves.items()}
        return {self.over.partition(" [")[0]: self.axis.tolist(), **curves}

    def to_dataframe(self, table: str | None = None) -> Any:  # there is one table
        """Every curve over the axis (pandas DataFrame), a column ``name [unit]`` each."""
        return series_frame(self.axis, self.over, self.curves, self.units)

    def plot(self, name: str = "") -> SavedFigure:
        """As :meth:`SavedResult.plot`."""
        return figure_beside(self.path, (f"{self.path.stem}.svg",), name)


@dataclass(frozen=True)
class SavedFigure:
    """A figure on disk: ``svg`` is its text, ``path`` its file; a notebook shows it."""

    path: Path

    @property
    def svg(self) -> str:
        """The drawing."""
        return self.path.read_text(encoding="utf-8")

    def _repr_svg_(self) -> str:
        return self.svg

    def savefig(self, path: str | Path) -> None:
        """Copy it to a file that ends in ``.svg``.

        Raises
        ------
        InputError
            If the file is to be of another kind.
        """
        if Path(path).suffix.lower() != ".svg":
            raise InputError(str(path), "is no name of an SVG file", "end it in .svg; run the command again for others")
        Path(path).write_text(self.svg, encoding="utf-8")


def figure_beside(path: Path, files: Sequence[str], name: str) -> SavedFigure:
    """A figure among the files beside a result's; raises as :meth:`SavedResult.plot`."""
    drawn = {PurePosixPath(file).stem: path.parent / file for file in files if file.endswith(".svg")}
    chosen = PurePosixPath(name).stem if name else next(iter(drawn), "")
    if not drawn:
        raise InputError(str(path), "has no figure beside it", "run the command again, with --out")
    if chosen not in drawn:
        raise unknown(name, list(drawn), "plot")
    if not drawn[chosen].is_file():
        raise InputError(str(drawn[chosen]), "is not there any more", "run the command again")
    return SavedFigure(drawn[chosen])


CURVES = ("simulated.csv", "response.csv")  # what results without a result file are saved as


def load_result(path: Path) -> SavedResult | SavedCurves:
    """See :func:`matching.api.load_result`."""
    known = (*RESULTS, *CURVES)
    found = [path] if path.is_file() else [path / name for name in known if (path / name).is_file()]
    if len(found) > 1:  # curves beside a result file are of that result
        found = [each for each in found if each.name not in CURVES] or found
    if len(found) > 1:
        raise InputError(str(path), f"holds {len(found)} results", f"name one of {', '.join(map(str, found))}")
    if not found or found[0].name not in known:
        raise InputError(str(path), "is no result of rigmatch", "give a folder with result.json, map.json or the like")
    if found[0].name in CURVES:
        return _curves(found[0])
    try:
        content = json.loads(found[0].read_text(encoding="utf-8"), object_hook=Entries)
    except ValueError as fault:
        raise InputError(str(found[0]), f"is not JSON: {fault}", "save the result again") from None
    if not isinstance(content, Entries):
        raise InputError(str(found[0]), "is no table", "save the result again")
    return SavedResult(found[0], RESULTS[found[0].name][0], content)


def _curves(path: Path) -> SavedCurves:
    from modelling.recordings.readers import read_table

    axis, *curves = read_table(path).columns
    if not curves:
        raise InputError(str(path), "has no curves", "save the result again")
    values, units = ({own.name: getattr(own, what) for own in curves} for what in ("values", "unit"))
    return SavedCurves(path, with_unit(axis.name, axis.unit), axis.values, values, units)


@display.html.register
def _(saved: SavedResult) -> str:
    from matching.report.page import preformatted

    return preformatted(str(saved))


@display.files.register
def _(saved: SavedResult, folder: str, made: Any = None) -> display.ResultFiles:
    """The same files again, those that lie beside the result's."""
    here = saved.path.parent.resolve()
    beside = {name: (here / name).resolve() for name in saved.content.get("files", ()) if name != saved.path.name}
    kept = {name: at.read_bytes() for name, at in beside.items() if at.is_relative_to(here) and at.is_file()}
    return saved.path.name, saved.content, kept


@display.text.register
def _(saved: SavedCurves) -> str:
    from matching.report.page import aligned

    rows = [{"curve": name, "from": f"{values.min():.4g}", "to": f"{values.max():.4g}", "unit": saved.units[name]}
            for name, values in saved.curves.items()]  # fmt: skip
    return aligned(rows, f"{len(saved.axis)} rows over {saved.over}")


@display.html.register
def _(saved: SavedCurves) -> str:
    from matching.report.page import preformatted

    return preformatted(str(saved))


@display.files.register
def _(saved: SavedCurves, folder: str, made: Any = None) -> display.ResultFiles:
    """The same files again."""
    kept: dict[str, str | bytes] = {
        at.name: at.read_bytes() for at in (saved.path, saved.path.with_suffix(".svg")) if at.is_file()
    }
    return "", {}, kept
