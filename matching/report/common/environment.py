"""Pages are Jinja templates; a page needs no other file."""

from __future__ import annotations

import base64
import functools
from urllib.parse import quote

from jinja2 import Environment, PackageLoader, StrictUndefined

from matching.report.common.wording import component, hertz, number, practical, unit

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
