"""Parts of a model file by what is on their drawing: shafts by dimensions and material, gears by their efficiency.

They become the stiffness, inertias and effects that everything else works with, when the file is read.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from modelling.errors import InputError
from modelling.system import Drawing, Quantity, System
from modelling.units import QUANTITY_UNITS

# Of a shaft: SI unit, and what is taken where it is not stated (None: it has to be). The material is steel: shear
# modulus and density after Dubbel, Taschenbuch für den Maschinenbau.
OF_A_SHAFT: dict[str, tuple[str, float | None]] = {
    "length": ("m", None),
    "diameter": ("m", None),
    "inner_diameter": ("m", 0.0),
    "shear_modulus": ("Pa", 79.3e9),
    "density": ("kg/m^3", 7850.0),
}
OF_A_GEAR = ("efficiency", "efficiency_reverse")  # of the effect gear_loss


def without_dimensions(
    data: Mapping[str, Any], where: str, quantity: Any
) -> tuple[dict[str, Any], dict[str, Drawing]]:  # fmt: skip
    """The content of a model file without these keys: with the quantities and effects that they stand for.

    Parameters
    ----------
    data : mapping
        Tables by name, as :func:`tomllib.load` gives them.
    where : str
        How errors call the file.
    quantity : callable
        Reads one as files write it, see :func:`modelling.model_file.quantity`.

    Returns
    -------
    data : dict
    drawings : dict
        By shaft.

    Raises
    ------
    InputError
        If a dimension is missing or impossible, or contradicts a stated stiffness.
    """
    shafts, gears = data.get("shafts"), data.get("gears")
    made, drawings = dict(data), dict[str, Drawing]()
    if isinstance(shafts, dict):
        for name, table in shafts.items():
            if isinstance(table, dict) and not OF_A_SHAFT.keys().isdisjoint(table):
                place = f"{where}: shafts.{name}"
                drawings[name] = _drawing(table, place, quantity)
                made = _with_shaft(made, name, table, drawings[name], place, quantity)
    if isinstance(gears, dict):
        for name, table in gears.items():
            if isinstance(table, dict) and any(key in table for key in OF_A_GEAR):
                made = _with_efficiency(made, name, table, f"{where}: gears.{name}")
    return made, drawings


def _drawing(table: Mapping[str, Any], place: str, quantity: Any) -> Drawing:
    if "stiffness" in table or "ratio" in table:
        key = "stiffness" if "stiffness" in table else "ratio"
        raise InputError(f"{place}.{key}", "contradicts the shaft's dimensions", f"write {key} or the dimensions")
    sizes = {}
    for key, (unit, start) in OF_A_SHAFT.items():
        if key not in table and start is None:
            raise InputError(place, f"{key!r} is missing", f"give a number in {unit}, or stiffness")
        sizes[key] = quantity(table.get(key, start), unit, f"{place}.{key}")
    drawing = Drawing(**sizes)
    drawing.check(place)
    return drawing


def _with_shaft(
    data: dict[str, Any], name: str, table: Mapping[str, Any], drawing: Drawing, place: str, quantity: Any
) -> dict[str, Any]:
    rest = {key: value for key, value in table.items() if key not in OF_A_SHAFT}
    made = {**data, "shafts": {**data["shafts"], name: {**rest, "stiffness": drawing.stiffness.written()}}}
    ends, inertias, inertia = table.get("between"), data.get("inertias"), drawing.inertia
    if isinstance(ends, list) and isinstance(inertias, dict) and inertia.value > 0:
        for end in ends:  # half of it at each end
            own = inertias.get(end) if isinstance(end, str) else None
            if isinstance(own, dict) and "J" in own:
                where = f"{place.partition(': ')[0]}: inertias.{end}.J"
                with_half = _sum(quantity(made["inertias"][end]["J"], QUANTITY_UNITS["J"], where), inertia)
                made["inertias"] = {**made["inertias"], end: {**made["inertias"][end], "J": with_half.written()}}
    return made


def _sum(own: Quantity, of_shaft: Quantity) -> Quantity:
    value = own.value + of_shaft.value / 2
    if not (own.uncertain or of_shaft.uncertain):
        return Quantity(value)
    low, high = (own.ends[end] + of_shaft.ends[end] / 2 for end in (0, 1))
    return Quantity(value, low, high)


# --- Writing: shafts by their drawing again.

SAME = 1e-9  # relative difference of stiffnesses up to which a drawing states the stiffness of its shaft


def with_dimensions(data: dict[str, Any], system: System) -> dict[str, Any]:
    """The content of a model file with the drawings of its shafts in place of their stiffness and inertia.

    A drawing that does not state what its shaft is, since the stiffness was changed by itself, is left out.
    """
    inertias, shafts = dict(data["inertias"]), dict(data.get("shafts", {}))
    J = {part.name: part.J for part in system.inertias}
    for shaft in system.shafts:
        drawing = shaft.drawing
        if drawing is None or abs(drawing.stiffness.value - shaft.stiffness.value) > SAME * shaft.stiffness.value:
            continue
        ends = {end: _less(J[end], drawing.inertia) for end in shaft.between}
        if any(own is None for own in ends.values()):
            continue
        if drawing.inertia.value > 0:
            J |= {end: own for end, own in ends.items() if own is not None}
            inertias |= {end: {**inertias[end], "J": J[end].written()} for end in ends}
        stated = {
            key: size.written()
            for key, size in drawing.sizes.items()
            if size.uncertain or size.value != OF_A_SHAFT[key][1]
        }
        rest = {key: value for key, value in shafts[shaft.name].items() if key != "stiffness"}
        shafts[shaft.name] = {"between": rest.pop("between"), **stated, **rest}
    return {**data, "inertias": inertias, **({"shafts": shafts} if shafts else {})}


def _less(whole: Quantity, of_shaft: Quantity) -> Quantity | None:
    """What a file states of the inertia at an end, so that half the shaft's makes it whole; None if that is none."""
    value = _before(whole.value, of_shaft.value / 2)
    if not whole.uncertain:
        return Quantity(value) if value > 0 else None
    low, high = (_before(whole.ends[end], of_shaft.ends[end] / 2) for end in (0, 1))
    if not 0 < low <= high:
        return None
    return Quantity(value, min(low, value), max(high, value)) if (low, high) != (value, value) else Quantity(value)


def _before(whole: float, half: float) -> float:
    """The number that with a half is the whole to the last digit, where there is one."""
    near = whole - half
    others = (math.nextafter(near, side) for side in (-math.inf, math.inf))
    return next((number for number in (near, *others) if number + half == whole), near)


def _with_efficiency(data: dict[str, Any], name: str, table: Mapping[str, Any], place: str) -> dict[str, Any]:
    effects = data.get("effects", [])
    at = f"gears.{name}"
    if isinstance(effects, list) and any(
        isinstance(one, dict) and one.get("kind") == "gear_loss" and one.get("at") == at for one in effects
    ):
        raise InputError(f"{place}.{OF_A_GEAR[0]}", "is stated by an effect gear_loss as well", "keep one of them")
    if OF_A_GEAR[0] not in table:
        raise InputError(f"{place}.{OF_A_GEAR[1]}", "needs efficiency as well", "state both")
    loss = {"kind": "gear_loss", "at": at, **{key: table[key] for key in OF_A_GEAR if key in table}}
    rest = {key: value for key, value in table.items() if key not in OF_A_GEAR}
    return {
        **data, "gears": {**data["gears"], name: rest},
        "effects": [*effects, loss] if isinstance(effects, list) else effects,
    }  # fmt: skip
