"""The page of a study: verdict, what to do and why, figures that act, their data, tables; one file without network."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from matching.report.common.environment import embedded, environment, in_address
from matching.report.common.provenance import Provenance
from matching.report.common.screen_point import ScreenPoint


@dataclass(frozen=True)
class PageTable:
    """A table below the figures: rows share their keys; the note says how to read it."""

    heading: str
    rows: Sequence[Mapping[str, str]]
    note: str = ""


@dataclass(frozen=True)
class StudyPage:
    """What a page says.

    Attributes
    ----------
    title, status, answer : str
        ``status`` is a word or a number in a frame before the answer, one sentence; ``good`` colours it.
    first_screen : mapping of str to sequence of ScreenPoint
        Lists by their heading, three of them side by side.
    captions : mapping of str to str
        By the figures' names.
    tables : sequence of PageTable
    notes : sequence of str
    """

    title: str
    status: str
    answer: str
    good: bool
    first_screen: Mapping[str, Sequence[ScreenPoint]]
    captions: Mapping[str, str]
    tables: Sequence[PageTable] = ()
    notes: Sequence[str] = ()


@dataclass(frozen=True)
class PageFigures:
    """Figures of a page by name: pictures (SVG), those that act in the browser, and their data (CSV)."""

    images: Mapping[str, bytes]
    moving: Mapping[str, str] = field(default_factory=dict)
    data: Mapping[str, str] = field(default_factory=dict)


def study_page(page: StudyPage, figures: PageFigures, made: Provenance | None = None) -> str:
    """The page as HTML; ``made`` says what it was made from."""
    values = {
        "title": page.title,
        "page": page,
        "figures": {name: embedded(content) for name, content in figures.images.items()},
        "captions": {name: page.captions.get(name, "") for name in figures.images},
        "moving": figures.moving,
        "data": {name: in_address(text, "text/csv") for name, text in figures.data.items()},
        "made": made,
    }
    return environment().get_template("study.html").render(values)
