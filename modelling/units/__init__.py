"""Units: what a text such as ``"300 N*m/rad"`` means in SI. Everything behind this room computes in SI."""

from modelling.units.general import Unit, printed, signal_quantity, signal_unit, unit_of
from modelling.units.quantities import INPUT_UNITS, QUANTITY_UNITS, SENSOR_UNITS, factor, in_unit, to_si
from modelling.units.registry import registry

__all__ = [
    "INPUT_UNITS",
    "QUANTITY_UNITS",
    "SENSOR_UNITS",
    "Unit",
    "factor",
    "in_unit",
    "printed",
    "registry",
    "signal_quantity",
    "signal_unit",
    "to_si",
    "unit_of",
]
