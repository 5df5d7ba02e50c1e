"""The one registry of units of this process (pint), and how rigmatch's spelling differs from pint's."""

from __future__ import annotations

import functools
import re
from typing import Any

import pint

_NEWTON_METRE = re.compile(r"(?<![A-Za-z]{2})Nm(?![A-Za-z])")  # as test beds write it; to pint something else


@functools.cache
def registry() -> Any:
    """Pint's registry, made when it is first needed."""
    return pint.UnitRegistry(autoconvert_offset_to_baseunit=True, cache_folder=None)


def pint_spelling(text: str) -> str:
    """A unit's text as pint reads it."""
    text = _NEWTON_METRE.sub("N*m", text).replace("·", "*").replace("°C", "degC").replace("″", "arcsecond")
    return text.strip()
