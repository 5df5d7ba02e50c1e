"""A small table, for a notebook and in print."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from matching.report.common.environment import environment

_TABLE = (
    "{% if title %}<p><b>{{ title }}</b></p>{% endif %}{% if rows %}<table><tr>{% for name in rows[0] %}"
    "<th>{{ name }}</th>{% endfor %}</tr>{% for row in rows %}<tr>{% for cell in row.values() %}<td>{{ cell }}</td>"
    "{% endfor %}</tr>{% endfor %}</table>{% endif %}"
)


def table(rows: Sequence[Mapping[str, Any]], title: str = "") -> str:
    """HTML of rows that share their keys."""
    return environment().from_string(_TABLE).render(rows=rows, title=title)


def aligned(rows: Sequence[Mapping[str, Any]], title: str = "") -> str:
    """Rows that share their keys, in columns of text."""
    cells = [[*rows[0]], *([str(cell) for cell in row.values()] for row in rows)] if rows else []
    widths = [max(map(len, column)) for column in zip(*cells)]
    text = ["  ".join(cell.ljust(width) for cell, width in zip(row, widths)).rstrip() for row in cells]
    return "\n".join([title, *text] if title else text)


def preformatted(text: str) -> str:
    """HTML of text that is set in columns."""
    return environment().from_string("<pre>{{ text }}</pre>").render(text=text)
