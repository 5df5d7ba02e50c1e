"""Parts of a model file by what is on their drawing: shafts by dimensions and material, gears by their efficiency.

They become the stiffness, inertias and effects that everything else works with, when the file is read.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from modelling.errors import InputError
from modelling.system import Quantity
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


def without_dimensions(data: Mapping[str, Any], where: str, quantity: Any) -> dict[str, Any]:
    """The content of a model file without these keys: with the quantities and effects that they stand for.

    Parameters
    ----------
    data : mapping
        Tables by name, as :func:`tomllib.load` gives them.
    where : str
        How errors call the file.
    quantity : callable
        Reads one as files write it, see :func:`modelling.model_file.quantity`.

    Raises
    ------
    InputError
        If a dimension is missing or impossible, or contradicts a stated stiffness.
    """
    shafts, gears = data.get("shafts"), data.get("gears")
    made = dict(data)
    if isinstance(shafts, dict):
        for name, table in shafts.items():
            if isinstance(table, dict) and not OF_A_SHAFT.keys().isdisjoint(table):
                made = _with_shaft(made, name, table, f"{where}: shafts.{name}", quantity)
    if isinstance(gears, dict):
        for name, table in gears.items():
            if isinstance(table, dict) and any(key in table for key in OF_A_GEAR):
                made = _with_efficiency(made, name, table, f"{where}: gears.{name}")
    return made


def _with_shaft(data: dict[str, Any], name: str, table: Mapping[str, Any], place: str, quantity: Any) -> dict[str, Any]:
    if "stiffness" in table or "ratio" in table:
        key = "stiffness" if "stiffness" in table else "ratio"
        raise InputError(f"{place}.{key}", "contradicts the shaft's dimensions", f"write {key} or the dimensions")
    sizes = {}
    for key, (unit, start) in OF_A_SHAFT.items():
        if key not in table and start is None:
            raise InputError(place, f"{key!r} is missing", f"give a number in {unit}, or stiffness")
        sizes[key] = quantity(table.get(key, start), unit, f"{place}.{key}")
        least = sizes[key].ends[0]
        if least < 0 or (least == 0 and key not in ("inner_diameter", "density")):
            raise InputError(f"{place}.{key}", f"{least:g} is not possible", "greater than 0 is needed")
    inner, outer = sizes["inner_diameter"], sizes["diameter"]
    if inner.ends[1] >= outer.ends[0]:
        raise InputError(f"{place}.inner_diameter", "is not smaller than the diameter", "exchange them")
    rest = {key: value for key, value in table.items() if key not in OF_A_SHAFT}
    stiffness = _over_range(_stiffness, sizes, rising=("diameter", "shear_modulus"))
    inertia = _over_range(_inertia, sizes, rising=("diameter", "density", "length"))
    made = {**data, "shafts": {**data["shafts"], name: {**rest, "stiffness": stiffness.written()}}}
    ends, inertias = table.get("between"), data.get("inertias")
    if isinstance(ends, list) and isinstance(inertias, dict) and inertia.value > 0:
        for end in ends:  # half of it at each end
            own = inertias.get(end) if isinstance(end, str) else None
            if isinstance(own, dict) and "J" in own:
                where = f"{place.partition(': ')[0]}: inertias.{end}.J"
                with_half = _sum(quantity(made["inertias"][end]["J"], QUANTITY_UNITS["J"], where), inertia)
                made["inertias"] = {**made["inertias"], end: {**made["inertias"][end], "J": with_half.written()}}
    return made


def _stiffness(length: float, diameter: float, inner_diameter: float, shear_modulus: float, density: float) -> float:
    """N·m/rad of a round bar or tube: shear modulus times polar moment of area over length."""
    return shear_modulus * math.pi / 32 * (diameter**4 - inner_diameter**4) / length


def _inertia(length: float, diameter: float, inner_diameter: float, shear_modulus: float, density: float) -> float:
    """kg·m² of the same about its axis."""
    return density * length * math.pi / 32 * (diameter**4 - inner_diameter**4)


def _over_range(law: Any, sizes: Mapping[str, Quantity], rising: tuple[str, ...]) -> Quantity:
    """What a law gives, and over which range: it rises with the sizes named, and falls with the others."""
    value = law(**{key: size.value for key, size in sizes.items()})
    if not any(size.uncertain for size in sizes.values()):
        return Quantity(value)
    low, high = (
        law(**{key: size.ends[end if key in rising else 1 - end] for key, size in sizes.items()}) for end in (0, 1)
    )
    return Quantity(value, low, high)


def _sum(own: Quantity, of_shaft: Quantity) -> Quantity:
    value = own.value + of_shaft.value / 2
    if not (own.uncertain or of_shaft.uncertain):
        return Quantity(value)
    low, high = (own.ends[end] + of_shaft.ends[end] / 2 for end in (0, 1))
    return Quantity(value, low, high)


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
