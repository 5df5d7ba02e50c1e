"""The one registry of units of this process (pint)."""

from __future__ import annotations

import functools
from typing import Any


@functools.cache
def registry() -> Any:
    """Pint's registry, imported and made when it is first needed: both take time at the start of every command."""
    import pint

    return pint.UnitRegistry(autoconvert_offset_to_baseunit=True, cache_folder=None)
