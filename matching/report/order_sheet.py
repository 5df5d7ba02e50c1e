"""The order sheet of a match: a page for the workshop, one section a part, which a browser prints to PDF."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import partial
from typing import Any

from markupsafe import Markup

from matching.match.order_sheet import SAME, Load, OrderedPart, OrderedValue, ordered_parts
from matching.match.result import MatchResult
from matching.report.common import component, number, practical, sentence, spaced
from matching.report.page import Provenance, Table, environment
from modelling.system import Drawing

FILE = "order_sheet.html"
TOLD = (
    "“Serves” is the range in which the response error is at most 2 % worse than as ordered, everything else tuned for "
    "the value. Loads are those of the simulated manoeuvre on the matched rig. The amplitude is half of the range that "
    "a torque or stress passes through: with it the part is judged for fatigue. A J has in it half of each shaft that "
    "is stated by its drawing."
)
DIGITS = 4


def page(result: MatchResult, made: Provenance | None) -> str:
    """The order sheet as HTML; empty where no part of the rig may change."""
    parts = ordered_parts(result)
    if not parts:
        return ""
    changed = [part for part in parts if part.changes]
    answer = (
        "Order: " + sentence([f"{_name(part)} ({_changes(part)})" for part in changed]) + "."
        if changed
        else "Order every part as planned."
    )
    if result.status != "matched":
        answer = "Nothing to order yet: the match is limited, see report.html."
    title = f"Order sheet: {result.case.title}" if result.case.title else "Order sheet"
    return environment().get_template("order_sheet.html").render(
        title=title, answer=answer, told=TOLD, made=made, parts=[_section(part) for part in parts],
    )  # fmt: skip


def _name(part: OrderedPart) -> str:
    return component(part.place)


def _changes(part: OrderedPart) -> str:
    moved = [value for value in part.values if value.bounds is not None and value.changes]
    return sentence([f"{spaced(value.key)} {_amount(value)}" for value in moved])


def _section(part: OrderedPart) -> dict[str, Any]:
    """What the template shows of a part."""
    pieces = 1 + len(part.also)
    also = f"{pieces} pieces: {sentence([_name(part), *map(component, part.also)])}. " if part.also else ""
    order = f"Order {_changes(part)}." if part.changes else "As planned."
    if part.drawing is not None:
        of = part.drawing
        order += (
            f" Material: shear modulus {number(of.shear_modulus.value / 1e9)} GPa, density {number(of.density.value)} "
            "kg/m³."
        )
    return {
        "id": part.place.replace(".", "-"), "heading": _name(part), "order": f"{also}{order}",
        "rows": Table([_row(value) for value in part.values]), "loads": Table([_load(load) for load in part.loads]),
        "notes": [note for value in part.values for note in _notes(value)],
        "sketch": None if part.drawing is None else sketch(part.drawing),
    }  # fmt: skip


def _amount(value: OrderedValue, size: float | None = None) -> str:
    return practical(value.ordered if size is None else size, value.unit, DIGITS)


def _row(value: OrderedValue) -> dict[str, str]:
    ends = "" if value.serves is None else [*map(partial(_amount, value), value.serves)]
    serves = f"{ends[0].partition(' ')[0]} … {ends[1]}" if ends else ""
    return {
        "value": spaced(value.key), "planned": _amount(value, value.planned), "to order": _amount(value),
        "serves": serves,
    }  # fmt: skip


def _notes(value: OrderedValue) -> Iterator[str]:
    """Whether it is a part of a catalogue, and that it ends at what [move] allows."""
    if value.bounds is None:
        return
    what = spaced(value.key)
    others = [_amount(value, one) for one in value.catalogue if abs(one - value.ordered) > SAME * abs(one)]
    if len(others) < len(value.catalogue):
        yield f"The {what} is one of the catalogue" + (f"; the others: {sentence(others)}." if others else ".")
    elif value.catalogue:
        yield f"The {what} is as planned and none of the catalogue: {sentence(others)}."
    if value.at_bound:
        low, high = value.bounds
        which, end = ("lower", low) if value.ordered - low < high - value.ordered else ("upper", high)
        yield f"The {what} is at its {which} bound, {_amount(value, end)}. A wider bound may serve better."


def _load(load: Load) -> dict[str, str]:
    limit = "" if load.limit is None else practical(load.limit, load.unit)
    used = "" if load.limit is None else f"{number(100 * load.value / load.limit, 3)} %"
    return {"load": spaced(load.what), "manoeuvre": practical(load.value, load.unit), "limit": limit, "used": used}


def sketch(drawing: Drawing) -> Markup:
    """A shaft with its dimensions, not to scale: from the side, half of it cut where it is a tube."""
    length, outside, inside = (practical(size.value, "m", DIGITS) for size in _sizes(drawing))
    share = drawing.inner_diameter.value / drawing.diameter.value
    half = 36.0
    bore = half * share
    lines = [
        f'<rect x="60" y="{70 - half}" width="180" height="{2 * half}" fill="#f2f2f2" stroke="#1a1a1a" '
        'stroke-width="1.5"/>'
    ]
    if share:
        lines += [
            f'<line x1="60" x2="240" y1="{70 + side * bore:.1f}" y2="{70 + side * bore:.1f}" stroke="#1a1a1a" '
            'stroke-dasharray="6 4"/>'
            for side in (-1, 1)
        ]
        lines.append(f'<text x="234" y="{74:.0f}" text-anchor="end">inside ⌀ {inside}</text>')
    lines += [
        '<line x1="46" x2="254" y1="70" y2="70" stroke="#888" stroke-dasharray="14 4 3 4"/>' if not share else "",
        '<g stroke="#1a1a1a"><line x1="60" x2="240" y1="126" y2="126"/><line x1="60" x2="60" y1="112" y2="131"/>'
        '<line x1="240" x2="240" y1="112" y2="131"/>',
        f'<line x1="40" x2="40" y1="{70 - half}" y2="{70 + half}"/><line x1="35" x2="54" y1="{70 - half}" '
        f'y2="{70 - half}"/><line x1="35" x2="54" y1="{70 + half}" y2="{70 + half}"/></g>',
        f'<text x="150" y="145" text-anchor="middle">length {length}</text>',
        f'<text x="28" y="70" text-anchor="middle" transform="rotate(-90 28 70)">⌀ {outside}</text>',
    ]
    words = f"length {length}, diameter {outside}" + (f", inner diameter {inside}" if share else "")
    return Markup(
        f'<svg viewBox="0 0 300 155" role="img" aria-label="Shaft, not to scale: {words}">{"".join(lines)}</svg>'
    )


def _sizes(drawing: Drawing) -> Sequence[Any]:
    return drawing.length, drawing.diameter, drawing.inner_diameter
