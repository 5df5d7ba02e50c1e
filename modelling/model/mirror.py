"""Mirror images by name: which inertia, shaft or quantity left/right symmetry swaps with which."""

from __future__ import annotations

from collections.abc import Sequence

from modelling.model.components import Gear, Shaft
from modelling.model.system import System


def mirror_image(name: str, system: System) -> str:
    """The name of the mirror image; the name itself where it has none.

    Parameters
    ----------
    name : str
        ``table.name`` or ``table.name.quantity``.
    system : System
        Its ``mirror`` pairs inertias; shafts and gears follow from their ends.
    """
    return mirror_images([name], system)[0]


def mirror_images(names: Sequence[str], system: System) -> list[str]:
    """The mirror image of each name, see :func:`mirror_image`."""
    swap = {a: b for pair in system.mirror for a, b in (pair, pair[::-1])}
    joints = {table: _joints(getattr(system, table)) for table in ("shafts", "gears")}
    images = []
    for name in names:
        table, _, rest = name.partition(".")
        part, _, quantity = rest.partition(".")
        image = swap.get(part, part) if table == "inertias" else part
        ends, by_ends = joints.get(table, ({}, {}))
        if part in ends:
            first, second = ends[part]
            image = by_ends.get((swap.get(first, first), swap.get(second, second)), part)
        images.append(f"{table}.{image}" + (f".{quantity}" if quantity else ""))
    return images


def _joints(parts: Sequence[Shaft | Gear]) -> tuple[dict[str, tuple[str, str]], dict[tuple[str, str], str]]:
    """Ends by name, and the first name by ends."""
    return {part.name: part.between for part in parts}, {part.between: part.name for part in reversed(parts)}
