"""Pieces that every tab uses: headings, messages, tables, the box with command and Python."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import panel as pn

from matching.explore.equivalents import Equivalent
from modelling.common.escape import html

WIDE = "stretch_width"
# Panes have a shadow tree of their own, which the style sheet of the page does not reach.
PANE_STYLE = """
:host { font: 15px/1.45 system-ui, "Segoe UI", Arial, sans-serif; color: #1a1a1a; }
p { max-width: 80ch; margin: .3em 0; } .wrong { color: #a00000; font-weight: 600; }
pre { margin: .3em 0; padding: .4em .6em; background: #f4f4f4; overflow-x: auto; white-space: pre; }
pre.words { white-space: pre-wrap; }
.scrolls { overflow-x: auto; } table { border-collapse: collapse; font-size: .92rem; }
caption { text-align: left; font-weight: 600; padding: .2em 0; }
th, td { text-align: left; padding: 3px 14px 3px 0; border-bottom: 1px solid #ddd; vertical-align: top; }
td.n { text-align: right; font-variant-numeric: tabular-nums; white-space: nowrap; }
h1 { font-size: 1.3rem; margin: .3em 0; } h2 { font-size: 1.1rem; margin: .9em 0 .2em; }
summary { cursor: pointer; } img { max-width: 100%; }
@media (max-width: 700px) { .scrolls td:last-child { min-width: 11em; } }
@media (max-width: 700px) { .picture { overflow-x: auto; } .picture img { max-width: none; min-width: 620px; } }
"""


def heading(text: str, level: int = 2) -> pn.pane.HTML:
    """A heading."""
    return pn.pane.HTML(f"<h{level}>{html(text)}</h{level}>", sizing_mode=WIDE, margin=(0, 5), stylesheets=[PANE_STYLE])


def paragraph(text: str) -> pn.pane.HTML:
    """A paragraph."""
    return pn.pane.HTML(f"<p>{html(text)}</p>", sizing_mode=WIDE, margin=(0, 5), stylesheets=[PANE_STYLE])


class Message(pn.pane.HTML):
    """What just happened, read out by screen readers; an error where ``wrong``."""

    def __init__(self) -> None:
        super().__init__('<p role="status"></p>', sizing_mode=WIDE, margin=(0, 5), stylesheets=[PANE_STYLE])

    def say(self, text: str, *, wrong: bool = False) -> None:
        """Show a line."""
        kind = ' class="wrong"' if wrong else ""
        self.object = f'<p role="status"{kind}>{html(text)}</p>'


def table(head: Sequence[str], rows: Iterable[Sequence[str]], caption: str) -> str:
    """A table as HTML; every text is escaped; cells that begin with a digit or a sign are set to the right."""
    cells = "".join(f'<th scope="col">{html(each)}</th>' for each in head)
    body = "".join("<tr>" + "".join(map(_cell, row)) + "</tr>" for row in rows)
    label = html(caption)
    return (
        f'<div class="scrolls" tabindex="0" role="region" aria-label="{label}"><table><caption>{label}</caption>'
        f"<thead><tr>{cells}</tr></thead><tbody>{body}</tbody></table></div>"
    )


def _cell(text: str) -> str:
    number = text[:1].isdigit() or (text[:1] in "+-−×" and text[1:2] != "")
    return f'<td class="n">{html(text)}</td>' if number else f"<td>{html(text)}</td>"


def offer(chooser: Any, options: dict[str, Any], wanted: Any = None) -> None:
    """Other options for a chooser; the choice stays where it is one of them, and nothing is wanted."""
    values = list(options.values())
    first = values[0] if values else None
    chosen = wanted if wanted is not None else chooser.value if chooser.value in values else first
    if options != chooser.options or chosen != chooser.value:
        chooser.param.update(options=options, value=chosen)


class EquivalentBox(pn.pane.HTML):
    """The command and the lines of Python, to copy."""

    def __init__(self, equivalent: Equivalent) -> None:
        super().__init__(sizing_mode=WIDE, margin=(10, 5), stylesheets=[PANE_STYLE])
        self.set(equivalent)

    def set(self, equivalent: Equivalent) -> None:
        """Show another one."""
        self.object = (
            '<details open class="same"><summary>The same without this page</summary>'
            f'<pre tabindex="0" aria-label="Command">{html(equivalent.command)}</pre>'
            f'<pre tabindex="0" aria-label="Python">{html(equivalent.python)}</pre></details>'
        )
