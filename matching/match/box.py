"""What is not known exactly of a bed: the box that beds are drawn from, and reading it."""

from __future__ import annotations

import fnmatch
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy

from modelling.bed.bed import Loop
from modelling.errors import InputError, unknown
from modelling.system import System
from modelling.units import to_si

# Relative half-widths unless a case says otherwise; of the dead time in s.
DEFAULT = {
    "rig.inertias.*.J": 0.05,
    "rig.shafts.*.stiffness": 0.05,
    "rig.shafts.*.damping": 0.3,
    "loop.dead_time": 5e-4,
    "loop.inverter_lag": 0.2,
    "loop.torque_sensor_lag": 0.2,
    "loop.torque_gain": 0.03,
}
LARGEST_SHARE = 0.99  # of a value, as its half-width
TORQUE_SENSOR_GAIN = 0.005  # relative half-width, of the dynamometers' torque sensors


@dataclass(frozen=True)
class Uncertain:
    """One quantity: its value, and how far it may be off either way, both SI.

    Names are ``rig.…``, ``vehicle.…`` for what the rig lacks, ``loop.dead_time``, ``loop.inverter_lag``,
    ``loop.torque_sensor_lag``, ``dynamometers.NAME.torque_gain`` and ``sensors.NAME.gain``.
    """

    name: str
    value: float
    half_width: float

    def at(self, x: float) -> float:
        """Value, SI, at a coordinate from −1 to 1; it does not change its sign."""
        value = self.value + self.half_width * x
        return min(value, 0.0) if self.value < 0 else max(value, 0.0)


@dataclass(frozen=True)
class Box:
    """Everything uncertain; p quantities."""

    uncertain: tuple[Uncertain, ...] = ()

    def at(self, position: np.ndarray) -> dict[str, float]:
        """Values by name at a position (p,) in the box, each coordinate from −1 to 1."""
        return {quantity.name: quantity.at(float(x)) for quantity, x in zip(self.uncertain, position, strict=True)}

    def draw(self, count: int, seed: int) -> np.ndarray:
        """Positions (count, p), each coordinate even over −1 … 1."""
        return np.random.default_rng(seed).uniform(-1, 1, (count, len(self.uncertain)))

    def spread(self, count: int) -> np.ndarray:
        """Positions (count, p) that fill the box evenly, the first of them as well (Sobol 1967); always the same."""
        if not self.uncertain:
            return np.zeros((count, 0))
        sequence = scipy.stats.qmc.Sobol(len(self.uncertain), seed=0)
        return 2 * sequence.random_base2(int(np.ceil(np.log2(count))))[:count] - 1

    def of_kind(self, kind: str) -> Box:
        """What begins with ``kind`` alone."""
        return Box(tuple(quantity for quantity in self.uncertain if quantity.name.startswith(kind)))

    def without(self, *kinds: str) -> Box:
        """The same box with what begins with one of ``kinds`` known exactly."""
        return Box(tuple(quantity for quantity in self.uncertain if not quantity.name.startswith(kinds)))

    def about(self, values: Mapping[str, float]) -> Box:
        """The same box about other values by name: half-widths keep their share of it, the dead time's is kept."""
        return Box(tuple(_about(quantity, values) for quantity in self.uncertain))


def _about(quantity: Uncertain, values: Mapping[str, float]) -> Uncertain:
    value = values.get(quantity.name, quantity.value)
    kept = quantity.name == "loop.dead_time" or not quantity.value
    width = quantity.half_width if kept else quantity.half_width * abs(value / quantity.value)
    return Uncertain(quantity.name, value, width)


def of_system(values: Mapping[str, float], system: System) -> dict[str, float]:
    """Quantities of a rig or a vehicle among values by their names in a box; what both have is there under ``rig.``."""
    known = system.parameters
    plain = {name.split(".", 1)[1]: value for name, value in values.items() if name.startswith(("rig.", "vehicle."))}
    return {name: value for name, value in plain.items() if name in known}


def read_uncertainty(data: Mapping[str, Any], vehicle: System, rig: System, loop: Loop, where: str) -> Box:
    """The box of a case: the defaults, and over them what ``[uncertainty]`` says."""
    table = data.get("uncertainty", {})
    if not isinstance(table, dict):
        raise InputError(f"{where}: uncertainty", "is no table", 'write "rig.inertias.*.J" = 0.05 under [uncertainty]')
    known = _known(vehicle, rig, loop)
    by_name: dict[str, Uncertain] = {}
    for key, value in {**DEFAULT, **table}.items():
        names = _fitting(key, known)
        if not names:
            if key in DEFAULT and key not in table:
                continue
            raise unknown(key, [*known, *DEFAULT, "sensors.*.gain"], f"{where}: uncertainty")
        share = to_si(value, "s" if key == "loop.dead_time" else "1", f"{where}: uncertainty.{key!r}")
        if not 0 <= share < 1:
            raise InputError(f"{where}: uncertainty.{key!r}", f"{share:g} is not possible", "0 ≤ value < 1 is needed")
        for name in names:
            half_width = share if name == "loop.dead_time" else share * abs(known[name])
            by_name[name] = Uncertain(name, known[name], half_width)
    for name in (f"sensors.{flange}.gain" for flange in loop.flanges):
        by_name.setdefault(name, Uncertain(name, 1.0, TORQUE_SENSOR_GAIN))
    return Box(tuple(quantity for quantity in by_name.values() if quantity.half_width > 0))


def uncertainty_table(box: Box, vehicle: System, rig: System, loop: Loop) -> dict[str, float]:
    """``[uncertainty]`` of a case file with every quantity by its own name: what is not in the box is 0 there."""
    widths = {quantity.name: quantity for quantity in box.uncertain}
    table = {}
    for name, value in _known(vehicle, rig, loop).items():
        width = widths.get(name)
        if width is None:
            defaults = any(name in _fitting(key, {name: value}) for key in DEFAULT)
            if defaults or name in {f"sensors.{flange}.gain" for flange in loop.flanges}:
                table[name] = 0.0
        elif name == "loop.dead_time":
            table[name] = width.half_width
        elif width.value:
            share = float(f"{width.half_width / abs(width.value):.12g}")  # 0.05, not 0.05000000000000001
            table[name] = min(share, LARGEST_SHARE)
    return table


def _known(vehicle: System, rig: System, loop: Loop) -> dict[str, float]:
    of_rig = rig.parameters
    known = {f"rig.{name}": quantity.value for name, quantity in of_rig.items()}
    known |= {f"vehicle.{name}": quantity.value for name, quantity in vehicle.parameters.items() if name not in of_rig}
    known |= {f"loop.{name}": loop[name] for name in ("dead_time", "inverter_lag", "torque_sensor_lag")}
    known |= {f"dynamometers.{dynamometer.name}.torque_gain": 1.0 for dynamometer in loop.dynamometers}
    return known | {f"sensors.{name}.gain": 1.0 for name in loop.controller_sensors}


def _fitting(key: str, known: Mapping[str, float]) -> list[str]:
    """Names that a key of the case file stands for."""
    return fnmatch.filter(known, "dynamometers.*.torque_gain" if key == "loop.torque_gain" else key)
