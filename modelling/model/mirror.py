"""Mirror images by name: which inertia, shaft or quantity left/right symmetry swaps with which."""

from __future__ import annotations

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
    swap = {a: b for pair in system.mirror for a, b in (pair, pair[::-1])}
    table, _, rest = name.partition(".")
    part, _, quantity = rest.partition(".")
    image = swap.get(part, part) if table == "inertias" else _joint_image(table, part, system, swap)
    return f"{table}.{image}" + (f".{quantity}" if quantity else "")


def _joint_image(table: str, name: str, system: System, swap: dict[str, str]) -> str:
    joints = [part for part in getattr(system, table, ()) if hasattr(part, "between")]
    joint = next((part for part in joints if part.name == name), None)
    if joint is None:
        return name
    ends = tuple(swap.get(end, end) for end in joint.between)
    return next((part.name for part in joints if part.between == ends), name)
