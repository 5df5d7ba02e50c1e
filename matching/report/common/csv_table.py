"""Tables that a page lets its reader save (CSV)."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable, Sequence
from typing import Any

DIGITS = 7  # of every number


def csv_table(head: Sequence[str], rows: Iterable[Sequence[Any]]) -> str:
    """Rows below a head; numbers with seven digits, nothing where there is no value.

    The head is without commas: not every reader (``numpy.genfromtxt``) knows quotation marks.
    """
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow([name.replace(",", "") for name in head])
    writer.writerows([_cell(value) for value in row] for row in rows)
    return text.getvalue()


def _cell(value: Any) -> str:
    if value is None or isinstance(value, str):
        return value or ""
    return f"{value:.{DIGITS}g}"
