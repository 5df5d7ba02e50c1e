"""Units of an FMU as powers of SI base units."""

from __future__ import annotations

from modelling.common.errors import InputError
from modelling.units import registry

BASE = {
    "kilogram": "kg", "meter": "m", "second": "s", "ampere": "A",
    "kelvin": "K", "mole": "mol", "candela": "cd", "radian": "rad",
}  # fmt: skip


def exponents(unit: str) -> dict[str, int]:
    """Powers of the base units in a coherent SI unit, as FMI names them: ``N*m/rad`` → kg 1, m 2, s −2, rad −1.

    Raises
    ------
    InputError
        If it is no coherent SI unit.
    """
    units = registry()
    factor, base = units.get_base_units(units.parse_units("dimensionless" if unit == "1" else unit))
    powers = dict(base._units)
    if abs(factor - 1) > 1e-12 or not set(powers) <= set(BASE) or any(power % 1 for power in powers.values()):
        raise InputError("", f"{unit!r} is no coherent SI unit", "the unit of a variable of an FMU is needed")
    return {BASE[name]: int(powers[name]) for name in BASE if name in powers}
