"""A report: what it says, and how that is shown on a page without network, in a terminal and in a notebook.

Every result has one report. Its first screen is the verdict, the figure that shows it, and what to do now with the
commands; the evidence stands below in folds.
"""

from __future__ import annotations

import base64
import functools
import hashlib
import os
import re
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, NamedTuple
from urllib.parse import quote

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup, escape
from matplotlib.figure import Figure

from matching.match.case import Case
from matching.report.acting import acting
from modelling import display
from modelling.errors import VERSION, InputError
from modelling.toml import read_toml

# --- What a report says.


class Step(NamedTuple):
    """A line of a list: what to do or to know, why, the command that does it, and a file next to the page."""

    text: str
    reason: str = ""
    command: str = ""
    file: str = ""


@dataclass(frozen=True)
class Table:
    """Rows that share their keys; a column without any cell is left out; the note says how to read it."""

    rows: Sequence[Mapping[str, Any]]
    note: str = ""

    def __post_init__(self) -> None:
        heads = [head for head in self.rows[0] if any(str(row[head]) for row in self.rows)] if self.rows else []
        object.__setattr__(self, "rows", [{head: row[head] for head in heads} for row in self.rows])

    @property
    def heads(self) -> list[str]:
        """Names of the columns."""
        return [*self.rows[0]] if self.rows else []

    @property
    def numeric(self) -> list[bool]:
        """Whether a column holds numbers, which stand below each other."""
        columns = zip(*(row.values() for row in self.rows), strict=True)
        return [all(map(_NUMBER.match, map(str, column))) for column in columns]


_NUMBER = re.compile(r"$|[-+−×≤≥–…±]|\d|not |does ")


class Show(NamedTuple):
    """The place of a figure."""

    figure: str


# A paragraph, a table, a list of sentences, HTML, or a figure
Block = str | Table | list[str] | Markup | Show


@dataclass(frozen=True)
class Fold:
    """Evidence below its heading; ``told`` says that a terminal shows it too."""

    heading: str
    blocks: Sequence[Block]
    told: bool = False


@dataclass(frozen=True)
class Report:
    """What a report says.

    Attributes
    ----------
    title, status, answer : str
        ``status`` is a word or a number in a frame before the answer, one sentence; ``good`` colours it.
    lists : mapping of str to sequence of Step
        By their headings, what to do now first.
    table : Table
        The most important figures.
    folds : sequence of Fold
    notes : sequence of str
    """

    title: str
    status: str
    answer: str
    good: bool = False
    lists: Mapping[str, Sequence[Step]] = field(default_factory=dict)
    table: Table = Table(())
    folds: Sequence[Fold] = ()
    notes: Sequence[str] = ()


class Picture(NamedTuple):
    """A figure: what draws it, its caption, and its curves (CSV) where a reader can save them."""

    draw: Callable[[], Figure]
    caption: str
    data: str = ""


# --- Where a result comes from: date, version, seed, input files with checksums.


@dataclass(frozen=True)
class Provenance:
    """What a result was made from.

    Attributes
    ----------
    date : str
        Day of the run (UTC), or that of ``SOURCE_DATE_EPOCH`` where that is set.
    version : str
    seed : int or None
        None where nothing was drawn.
    files : tuple of (str, str)
        Path and SHA-256 of every input file, the case file first; empty where the case came from no file.
    """

    date: str
    version: str
    seed: int | None
    files: tuple[tuple[str, str], ...]

    @property
    def case(self) -> str:
        """The file that the others are named in."""
        return self.files[0][0] if self.files else "CASE"

    def to_dict(self) -> dict[str, Any]:
        """``made_by`` of ``result.json``."""
        case, checksum = self.files[0] if self.files else ("", "")
        files = [{"file": file, "sha256": sum_} for file, sum_ in self.files]
        return {
            "version": self.version, "date": self.date, "case": case, "sha256": checksum, "seed": self.seed,
            "files": files,
        }  # fmt: skip


def provenance(case: Case, seed: int | None = None) -> Provenance:
    """Of a case that was read from a file, and the seed of its match."""
    return made_from(case.path, seed, ("vehicle", "rig"))


def with_recordings(made: Provenance, recordings: Iterable[tuple[str, str | Path]]) -> Provenance:
    """The same with recordings, each by its name and by the file that was read."""
    return replace(made, files=(*made.files, *((name, _checksum(Path(file))) for name, file in recordings)))


def made_from(file: str | Path, seed: int | None, names: Sequence[str] = ()) -> Provenance:
    """Of an input file (TOML; empty for none), of the files that it names under the keys ``names``, and a seed."""
    now = float(os.environ.get("SOURCE_DATE_EPOCH") or time.time())
    date, path = time.strftime("%Y-%m-%d", time.gmtime(now)), Path(file)
    if not file or not path.is_file():
        return Provenance(date, VERSION, seed, ())
    content = read_toml(path) if names else {}
    files = [path, *(path.parent / content[key] for key in names if isinstance(content.get(key), str))]
    return Provenance(date, VERSION, seed, tuple((str(each), _checksum(each)) for each in files if each.is_file()))


def _checksum(file: Path) -> str:
    with file.open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()


# --- The page: a Jinja template; a page needs no other file.

UPRIGHT_WIDTH, ACROSS_WIDTH, ACROSS_HEIGHT = 515.0, 760.0, 411.0  # points for a figure on A4, margins and caption off
SMALLEST_LETTERS = 4.5  # points on paper; a figure laid across takes a page of its own, so only where it has to
WORTH_TURNING = 1.25  # larger by this at least
READABLE = " ,;:/?@=+$()*!.-_~|"  # letters and signs that a data URI in quotation marks may hold as they are


@functools.cache
def environment() -> Environment:
    """Templates of this package."""
    templates = Environment(loader=PackageLoader("matching.report"), autoescape=True, undefined=StrictUndefined)
    templates.filters |= {"in_style": in_style, "explained": explained, "minus": minus_signs}
    templates.tests["wide"] = is_wide
    return templates


TERMS = {  # of the field of control, for readers from the field of test beds; the longest of two that begin alike first
    "modulus margin": "least distance of the open loop from −1: 1 is as far as a loop without control, 0 is unstable",
    "damping ratio": "share of the critical damping: 0.02 rings for some ten periods",
    "drawn beds": "beds whose values are drawn within what [uncertainty] says is not known exactly",
    "response error": "root mean square of |log(H_rig/H_vehicle)| over band and compared functions; 0.1 is 10 % or 6°",
    "unmeasured torques": "torques that no sensor tells the controller, such as a brake on the shaft",
    "target mode": "mode of the vehicle that the rig has to have",
    "roll-off": "from this frequency on the loop hardly acts, so that what no model holds cannot make it unstable",
    "worst bed": "the least damped bed that a search found within [uncertainty]",
    "dead time": "time from a measured torque to the torque at the dynamometer's air gap",
    "sampled loop": "controller, delay line and bed, exactly as the sampled controller sees them",
    "R_XiL": "XiL fidelity (Eq. 16): 100 % is a test that cannot be told from the road",
    "coverage": "share of cases in which the interval holds the true value",
}
_BY_LOWER = {term.lower(): words for term, words in TERMS.items()}
_TERM = re.compile("|".join(rf"\b{re.escape(term)}\b" for term in TERMS), re.IGNORECASE)


def explained(text: str) -> Markup:
    """A text as HTML whose terms say what they mean where they are pointed at; HTML stays as it is."""
    if isinstance(text, Markup):
        return text
    return Markup(
        _TERM.sub(
            lambda term: f'<abbr title="{escape(_BY_LOWER[term[0].lower()])}">{term[0]}</abbr>',
            str(escape(minus_signs(text))),
        )
    )


_HYPHEN_AS_MINUS = re.compile(r"(?<![\w.,:/=-])-(?=\d)")


def minus_signs(text: str) -> str:
    """A text as a page prints it: a minus before a number, where a terminal and files have a hyphen."""
    return text if isinstance(text, Markup) else _HYPHEN_AS_MINUS.sub("−", str(text))


def embedded(content: bytes) -> str:
    """A figure as a data URI, so that the page needs no other file."""
    kind = "png" if content.startswith(b"\x89PNG") else "svg+xml"
    return f"data:image/{kind};base64,{base64.b64encode(content).decode()}"


def in_style(text: str) -> str:
    """A text within quotation marks of a style sheet: all but letters, digits and spaces by their numbers."""
    return "".join(each if each.isalnum() or each == " " else f"\\{ord(each):x} " for each in text)


def is_wide(svg: str) -> bool:
    """Whether a figure is to be printed on paper laid across to be read."""
    size = re.search(r'<svg[^>]*? width="([\d.]+)pt" height="([\d.]+)pt"', svg)
    letters = [float(points) for points in re.findall(r"font(?:-size)?: ?([\d.]+)px", svg)]
    if size is None or not letters:
        return False
    width, height = (float(text) for text in size.groups())
    upright, across = min(UPRIGHT_WIDTH / width, 1.0), min(ACROSS_WIDTH / width, ACROSS_HEIGHT / height, 1.0)
    return upright * min(letters) < SMALLEST_LETTERS and across >= WORTH_TURNING * upright


def page(
    report: Report, figures: Mapping[str, Picture], drawn: Mapping[str, Markup], made: Provenance | None = None
) -> str:
    """The page as HTML.

    Parameters
    ----------
    report : Report
    figures : mapping of str to Picture
        By the names that the report shows them under; the first that no fold shows stands on the first screen.
    drawn : mapping of str to Markup
        The same as elements of the page (:func:`matching.report.acting.acting`).
    made : Provenance, optional
        What the result was made from; without it the page does not say.
    """
    kinds = {Markup: "html", str: "text", Table: "table", list: "list", Show: "figure"}
    return environment().get_template("report.html").render(
        title=report.title, report=report, made=made, kind_of=lambda block: kinds[type(block)],
        figures=drawn,
        captions={name: figures[name].caption for name in drawn},
        in_folds=[block.figure for fold in report.folds for block in fold.blocks if isinstance(block, Show)],
        data={
            name: f"data:text/csv;charset=utf-8,{quote(figures[name].data, safe=READABLE)}"
            for name in drawn if figures[name].data
        },
    )  # fmt: skip


# --- The same for a terminal and for a notebook.


def aligned(rows: Sequence[Mapping[str, Any]], title: str = "") -> str:
    """Rows that share their keys, in columns of text."""
    cells = [[*rows[0]], *([str(cell) for cell in row.values()] for row in rows)] if rows else []
    widths = [max(map(len, column)) for column in zip(*cells, strict=True)]
    text = ["  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip() for row in cells]
    return "\n".join([title, *text] if title else text)


def table(rows: Sequence[Mapping[str, Any]], title: str = "") -> str:
    """HTML of rows that share their keys."""
    return environment().from_string(
        "{% from 'parts.html' import rows_of %}{{ rows_of(table, title) }}"
    ).render(table=Table(rows), title=title)  # fmt: skip


def preformatted(text: str) -> str:
    """HTML of text that is set in columns."""
    return f"<pre>{escape(text)}</pre>"


def in_terminal(report: Report) -> str:
    """Verdict, table, lists, and the folds that are told."""
    lines = [f"{report.status.upper()}  {report.title}", report.answer, *_told(report.table)]
    for heading, steps in report.lists.items():
        if steps:
            lines += ["", f"{heading}:"]
        for step in steps:
            reason = f" ({step.reason})" if step.reason else ""
            lines += [f"  {step.text}{reason}", *(f"    {more}" for more in (step.command, step.file) if more)]
    for fold in report.folds:
        if fold.told and fold.blocks:
            lines += ["", f"{fold.heading}:", *(line for block in fold.blocks for line in _told(block))]
    return "\n".join([*lines, *(f"note: {note}" for note in report.notes)])


def _told(block: Block) -> list[str]:
    if isinstance(block, Table):
        return ["", aligned(block.rows), *([block.note] if block.note else [])] if block.rows else []
    if isinstance(block, list):
        return [f"  {line}" for line in block]
    return [] if isinstance(block, Show | Markup) else [block]


def in_notebook(report: Report) -> str:
    """Verdict, table and lists."""
    return environment().from_string(
        "{% from 'parts.html' import rows_of, points %}<p><b>{{ report.status }}</b>: {{ report.answer }}</p>"
        "{{ rows_of(report.table) }}{% for heading, steps in report.lists.items() if steps %}"
        "<p><b>{{ heading }}</b></p>{{ points(steps, 'ul') }}{% endfor %}"
    ).render(report=report)  # fmt: skip


# --- The views of a result, all of them from its report.


@dataclass(frozen=True)
class View:
    """How the results of a class are shown.

    Attributes
    ----------
    file, page : str
        Names of the result's file (JSON) and of its page; without a name there is none.
    report : callable
        From the content of the file: it is all that a saved result has. Further arguments, which it has to do without:
        the folder that the page's commands name, what the result was made from, and the result.
    figures : callable
        Pictures of a result by name; the first is what ``plot()`` gives.
    content : callable
        Of the file.
    others : callable
        Further files.
    origin : callable
        What a result was made from, where nobody says; its file holds it, too, with ``tells_origin``.
    folder : str
        Where the figures' files lie.
    """

    file: str
    report: Callable[..., Report]
    figures: Callable[[Any], Mapping[str, Picture]] = lambda _: {}
    content: Callable[[Any], dict[str, Any]] = lambda result: result.to_dict()
    others: Callable[[Any], dict[str, str | bytes]] = lambda _: {}
    origin: Callable[[Any], Provenance | None] = lambda _: None
    tells_origin: bool = False
    page: str = "report.html"
    folder: str = "figures/"


VIEWS_OF_FILES: dict[str, View] = {}


def register(result_class: type, view: View) -> None:
    """Show the results of a class by a view."""
    VIEWS_OF_FILES[view.file] = view
    display.text.register(result_class)(lambda result: in_terminal(view.report(view.content(result))))
    display.html.register(result_class)(lambda result: in_notebook(view.report(view.content(result))))
    display.plot.register(result_class)(functools.partial(_plot, view))
    display.files.register(result_class)(functools.partial(files, view))


def _plot(view: View, result: Any) -> Figure:
    for picture in view.figures(result).values():
        return picture.draw()
    raise InputError(type(result).__name__, "has no figure yet", "str() says what it holds")


def files(
    view: View, result: Any, folder: str, made: Provenance | None = None, more: Mapping[str, Any] | None = None
) -> display.ResultFiles:
    """The result's file, with ``more`` entries in it, its page, figures and further files."""
    made = made or view.origin(result)
    entries, figures = {**view.content(result), **(more or {})}, view.figures(result)
    if made and view.tells_origin:
        entries["made_by"] = made.to_dict()
    drawn = {name: acting(picture.draw()) for name, picture in figures.items()}
    others: dict[str, str | bytes] = {f"{view.folder}{name}.svg": svg for name, (svg, _) in drawn.items()}
    if view.page:
        report = view.report(entries, folder, made, result)
        others[view.page] = page(report, figures, {name: element for name, (_, element) in drawn.items()}, made)
    return view.file, entries, others | view.others(result)


def register_table(
    result_class: type, rows: Callable[[Any], Sequence[Mapping[str, Any]]], title: Callable[[Any], str] = lambda _: ""
) -> None:
    """Show the results of a class as a table in terminal and notebook."""
    display.text.register(result_class)(lambda result: aligned(rows(result), title(result)))
    display.html.register(result_class)(lambda result: table(rows(result), title(result)))
