"""What a match answered, on the page: in words, what to order, the figures that show it, its report."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from matching.explore.page.elements import table
from matching.explore.page.running import address_of
from matching.report.common.wording import amount, component, number, unit
from matching.report.match.first_screen import SAME_RELATIVE
from matching.report.match.text import summary
from modelling.common.escape import html

FIGURES = {
    "trade": "The trade: response error for unmeasured torques over each adapter quantity, the rest tuned for it",
    "overview": "Responses, manoeuvre and target modes of vehicle, rig and matched rig",
}
HEAD = ("adapter quantity", "as planned", "to order", "as good within 2 % between", "error as planned", "as ordered")


def result_html(result: Mapping[str, Any], folder: Path, out: Path) -> str:
    """The result of ``rigmatch match`` in ``folder``, which is served below ``out``."""
    report = address_of(folder / "report.html", out)
    rows = [_row(trade) for trade in result["adapters"]]
    caption = "What to order (errors for unmeasured torques, the rest tuned for each"
    unmeasured = result["response_error"]["unmeasured_after"]
    ordered = [trade["error_as_ordered"] for trade in result["adapters"]]
    if any(abs(error - unmeasured) > SAME_RELATIVE * unmeasured for error in ordered):
        caption += f"; gains tuned over drawn beds after that make it {number(unmeasured, 2)}"
    caption += ")"
    order = table(HEAD, rows, caption) if rows else "<p>No quantity of an adapter was allowed to move.</p>"
    figures = "".join(
        f'<figure class="picture" tabindex="0">'
        f'<img src="{html(address_of(folder / "figures" / f"{name}.svg", out))}" alt="{html(words)}">'
        f"<figcaption>{html(words)}</figcaption></figure>"
        for name, words in FIGURES.items()
        if name != "trade" or rows
    )
    return (
        f'<pre class="words" tabindex="0" aria-label="Result">{html(summary(result))}</pre>{order}'
        f'<p><a href="{html(report)}" target="_blank">Open the report</a></p>{figures}'
    )


def _row(trade: Mapping[str, Any]) -> tuple[str, ...]:
    si = trade["unit"]
    low, high = (number(value) for value in trade["acceptable"])
    return (
        component(trade["name"]), amount(trade["planned"], si), amount(trade["ordered"], si),
        f"{low} and {high} {unit(si)}", number(trade["error_as_planned"], 2), number(trade["error_as_ordered"], 2),
    )  # fmt: skip
