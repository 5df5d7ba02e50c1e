"""The one registry of units of this process (pint)."""

from __future__ import annotations

import functools
from typing import Any

import pint


@functools.cache
def registry() -> Any:
    """Pint's registry, made when it is first needed."""
    return pint.UnitRegistry(autoconvert_offset_to_baseunit=True, cache_folder=None)
