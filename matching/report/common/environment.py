"""Pages are Jinja templates; a page needs no other file."""

from __future__ import annotations

import base64
import functools
import re
from urllib.parse import quote

from jinja2 import Environment, PackageLoader, StrictUndefined

from matching.report.common.wording import component, hertz, number, practical, unit

UPRIGHT_WIDTH, ACROSS_WIDTH, ACROSS_HEIGHT = 515.0, 760.0, 411.0  # points for a figure on A4, margins and caption off
SMALLEST_LETTERS = 4.5  # points on paper; a figure laid across takes a page of its own, so only where it has to
WORTH_TURNING = 1.25  # larger by this at least
READABLE = " ,;:/?@=+$()*!.-_~|"  # letters and signs that a data URI in quotation marks may hold as they are


@functools.cache
def environment() -> Environment:
    """Templates of this package with the filters for numbers, units and names."""
    templates = Environment(loader=PackageLoader("matching.report"), autoescape=True, undefined=StrictUndefined)
    templates.filters |= {
        "number": number,
        "unit": unit,
        "practical": practical,
        "hertz": hertz,
        "component": component,
        "in_style": in_style,
    }
    templates.tests["wide"] = is_wide
    return templates


def embedded(content: bytes) -> str:
    """A figure as a data URI, so that the page needs no other file."""
    kind = "png" if content.startswith(b"\x89PNG") else "svg+xml"
    return f"data:image/{kind};base64,{base64.b64encode(content).decode()}"


def in_address(text: str, kind: str) -> str:
    """A text of some kind as a data URI: a sixth shorter than with base64."""
    return f"data:{kind};charset=utf-8,{quote(text, safe=READABLE)}"


def in_style(text: str) -> str:
    """A text within quotation marks of a style sheet: all but letters, digits and spaces by their numbers."""
    return "".join(each if each.isalnum() or each == " " else f"\\{ord(each):x} " for each in text)


def is_wide(address: str) -> bool:
    """Whether a figure, a data URI of :func:`embedded`, is to be printed on paper laid across to be read."""
    content = address.removeprefix("data:image/svg+xml;base64,")
    if content == address:
        return False
    svg = base64.b64decode(content).decode(errors="replace")
    size = re.search(r'<svg[^>]*? width="([\d.]+)pt" height="([\d.]+)pt"', svg)
    letters = [float(points) for points in re.findall(r"font(?:-size)?: ?([\d.]+)px", svg)]
    if size is None or not letters:
        return False
    width, height = (float(text) for text in size.groups())
    upright, across = min(UPRIGHT_WIDTH / width, 1.0), min(ACROSS_WIDTH / width, ACROSS_HEIGHT / height, 1.0)
    return upright * min(letters) < SMALLEST_LETTERS and across >= WORTH_TURNING * upright
