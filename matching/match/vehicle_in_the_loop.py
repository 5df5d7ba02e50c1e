"""A case whose vehicle others simulate: the table of its file."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from modelling.bed.bed import Loop
from modelling.bed.foreign_vehicle import RunIn, VehicleTiming
from modelling.errors import InputError, unknown
from modelling.fmu.vehicle import FmuVehicle
from modelling.system import System
from modelling.units import to_si

KEYS = ("fmu", "torques", "speeds", "inputs", "step", "late")
EXAMPLE = 'write fmu = "car.fmu", torques = { left = "T_left" } and speeds = { left = "w_left" }, by dynamometer'
EVEN = 1e-6  # of a sample, by which a step may be no whole number of samples


@dataclass(frozen=True)
class VehicleInTheLoop:
    """The vehicle that stands behind the cuts, as an FMU.

    Attributes
    ----------
    fmu : str
        File.
    torques, speeds : tuple of (str, str)
        Dynamometer, and the FMU's input (N·m, into the vehicle at this cut) or output (rad/s, of its wheel there).
    inputs : tuple of (str, str)
        Input of the design vehicle behind the cuts, and the FMU's for the same.
    step : float
        s, of the FMU.
    late : int
        Samples between the moment to which a speed belongs and the one in which the controller reads it.
    """

    fmu: str
    torques: tuple[tuple[str, str], ...]
    speeds: tuple[tuple[str, str], ...]
    inputs: tuple[tuple[str, str], ...]
    step: float
    late: int

    def timing(self, sample_time: float) -> VehicleTiming:
        """In samples."""
        return VehicleTiming(max(round(self.step / sample_time), 1), self.late)

    def started(self, run_in: RunIn, count: int) -> FmuVehicle:
        """So many instances of it."""
        named = dict(self.torques), dict(self.speeds), dict(self.inputs)
        return FmuVehicle(Path(self.fmu), *named, run_in, self.step, count)

    def table(self) -> dict[str, Any]:
        """``[vehicle_in_the_loop]`` of a case file, SI."""
        named = {key: dict(getattr(self, key)) for key in ("torques", "speeds", "inputs") if getattr(self, key)}
        return {"fmu": str(Path(self.fmu).resolve()), **named, "step": self.step, "late": self.late}


def read_vehicle_in_the_loop(
    data: Mapping[str, Any], vehicle: System, rig: System, loop: Loop, where: str
) -> VehicleInTheLoop | None:
    """The table of a case, None without one; the FMU is not loaded.

    Raises
    ------
    InputError
        Naming the key that is wrong.
    """
    if "vehicle_in_the_loop" not in data:
        return None
    place, table = f"{where}: vehicle_in_the_loop", data["vehicle_in_the_loop"]
    if not isinstance(table, Mapping):
        raise InputError(place, "is no table", EXAMPLE)
    for key in table:
        if key not in KEYS:
            raise unknown(str(key), list(KEYS), place)
    if "operating_range" not in data:
        raise InputError(
            place, "stands without [operating_range]",
            'a vehicle that drives has a range: write [operating_range] with vehicle_speed = ["0 km/h", "100 km/h"]',
        )  # fmt: skip
    fmu = table.get("fmu")
    if not isinstance(fmu, str) or not fmu:
        raise InputError(f"{place}.fmu", "is missing" if fmu is None else "is no name of a file", EXAMPLE)
    path = Path(where).parent / fmu  # not looked at before it is needed
    dynamometers = [one.name for one in loop.dynamometers]
    on_rig = {part.name for part in rig.inputs}
    own = [part.name for part in vehicle.inputs if part.name not in on_rig]
    pairs = {
        key: _pairs(table, key, dynamometers if key != "inputs" else own, key != "inputs", place)
        for key in ("torques", "speeds", "inputs")
    }
    sample = loop["sample_time"]
    step = to_si(table.get("step", sample), "s", f"{place}.step")
    if step < sample * (1 - EVEN) or abs(step / sample - round(step / sample)) > EVEN * step / sample:
        raise InputError(
            f"{place}.step", f"{step:g} s is no whole number of samples of {sample:g} s",
            "choose it so, or change loop.sample_time",
        )  # fmt: skip
    late = table.get("late", 0)
    if not isinstance(late, int) or isinstance(late, bool) or not 0 <= late <= 100:
        raise InputError(f"{place}.late", f"{late!r} is no number of samples", "0 … 100 is possible")
    return VehicleInTheLoop(str(path), pairs["torques"], pairs["speeds"], pairs["inputs"], step, late)


def _pairs(
    table: Mapping[str, Any], key: str, known: Sequence[str], all_of_them: bool, place: str
) -> tuple[tuple[str, str], ...]:
    given = table.get(key, {})
    if not isinstance(given, Mapping) or not all(isinstance(value, str) and value for value in given.values()):
        raise InputError(f"{place}.{key}", "is no table of names", EXAMPLE)
    for name in given:
        if name not in known:
            raise unknown(str(name), list(known), f"{place}.{key}")
    for name in known if all_of_them else ():
        if name not in given:
            raise InputError(f"{place}.{key}", f"does not name {name}", EXAMPLE)
    return tuple((name, given[name]) for name in known if name in given)
