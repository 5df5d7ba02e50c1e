"""The feedback loop closed round rig and residual vehicle, as expressions at one complex frequency."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import casadi as ca

from matching.frequency.case.case import Compared
from matching.frequency.programme.dead_time import actuator
from matching.frequency.programme.linear_response import LinearResponse
from modelling.bed.loop import ControlStructure, Dynamometer
from modelling.bed.residual_vehicle import Interface
from modelling.equations.complex_sx import Complex, joined, solve
from modelling.model.components import Gear, Shaft
from modelling.model.system import System


@dataclass(frozen=True)
class LoopShape:
    """What the expressions of a loop are made from; ``known`` are the values that are 0 or 1, None for the others."""

    rig: System
    parts: tuple[System, ...]
    interfaces: tuple[Interface, ...]
    dynamometers: tuple[Dynamometer, ...]
    compared: tuple[Compared, ...]
    names: tuple[str, ...]
    known: tuple[float | None, ...]
    control: ControlStructure
    moving: tuple[tuple[str, ...], ...]

    @property
    def still(self) -> list[int]:
        """Entries of ``names`` that neither move nor are known."""
        moved = {name for group in self.moving for name in group}
        entries = enumerate(zip(self.names, self.known, strict=True))
        return [i for i, (name, value) in entries if name not in moved and value is None]

    def cut(self, dyno: Dynamometer) -> Interface:
        """The interface that a dynamometer follows."""
        return next(interface for interface in self.interfaces if interface.shaft == dyno.follows)


class FeedbackLoop:
    """The loop closed round rig and residual vehicle at s.

    Parameters
    ----------
    shape : LoopShape
    rig, parts : LinearResponse
        The rig and the parts of the residual vehicle.
    loop : dict of str to SX
        Values of the loop.
    s : Complex
        rad/s.
    """

    def __init__(
        self, shape: LoopShape, rig: LinearResponse, parts: list[LinearResponse], loop: dict[str, ca.SX], s: Complex
    ):
        self._shape, self._rig, self._parts, self._loop, self._s = shape, rig, parts, loop, s
        self._dynamometers, self._size = shape.dynamometers, len(shape.dynamometers)
        self._sensor_lag = 1 / (1 + s * loop["torque_sensor_lag"])
        self._sign = [sensor_sign(shape.rig, dynamometer) for dynamometer in shape.dynamometers]
        self._zeros = [Complex(0.0)] * self._size
        torques = [rig.responses(d.torque_sensor) * self._sign[k] for k, d in enumerate(shape.dynamometers)]
        speeds = [rig.responses(d.speed_sensor) for d in shape.dynamometers]
        self._reactions = self._air_gap_torques(torques, speeds, self._zeros)

    def difference(self) -> list[list[Complex]]:
        """Return difference I + L at the dynamometers' commands, (u, u)."""
        columns = [self._rig.inputs.index(dynamometer.torque_input) for dynamometer in self._dynamometers]
        return [
            [(1 if row == i else 0) - reaction[column] for i, column in enumerate(columns)]
            for row, reaction in enumerate(self._reactions)
        ]

    def responses(self) -> list[Complex]:
        """The compared transfer functions (h), to sensors of the rig or of the residual vehicle."""
        sources = list(dict.fromkeys(pair.input for pair in self._shape.compared))
        right = [joined([self._driven(j, source) for source in sources]) for j in range(self._size)]
        torques = solve([dict(enumerate(row)) for row in self.difference()], right)
        rows: dict[str, Complex] = {}

        def on_rig(sensor: str) -> Complex:
            """To all sources, a row."""
            if sensor not in rows:
                rows[sensor] = self._on_rig(sensor, sources, torques)
            return rows[sensor]

        return [self._compared(pair, sources.index(pair.input), on_rig) for pair in self._shape.compared]

    def _compared(self, pair: Compared, column: int, on_rig: Callable[[str], Complex]) -> Complex:
        if pair.sensor in self._rig.sensors:
            return on_rig(pair.sensor)[column]
        return self._in_residual(pair.sensor, pair.input, lambda sensor: on_rig(sensor)[column])

    def _air_gap_torques(self, torques: list[Complex], speeds: list[Complex], roads: list[Complex]) -> list[Complex]:
        """For flange torques, rotor speeds and what the roads do to the reference speeds."""
        measured = [torque * self._sensor_lag for torque in torques]
        reference = [
            sum((self._emulated(d, other) * measured[k] for k, other in enumerate(self._dynamometers)), roads[j])
            for j, d in enumerate(self._dynamometers)
        ]
        act = actuator(self._loop, self._s)
        commands = self._shape.control.commands(self._loop, self._s, reference, speeds, measured)
        return [act * command for command in commands]

    def _driven(self, j: int, source: str) -> Complex:
        """Air-gap torque of dynamometer j for a unit of a source, the loop open."""
        if source in self._rig.inputs:
            return self._reactions[j][self._rig.inputs.index(source)]
        roads = [self._road(dynamometer, source) for dynamometer in self._dynamometers]
        return self._air_gap_torques(self._zeros, self._zeros, roads)[j]

    def _on_rig(self, sensor: str, sources: list[str], torques: list[Complex]) -> Complex:
        rig = self._rig
        direct = [rig.response(sensor, source) if source in rig.inputs else Complex(0.0) for source in sources]
        caused = (rig.response(sensor, d.torque_input) * torques[j] for j, d in enumerate(self._dynamometers))
        return sum(caused, joined(direct))

    def _in_residual(self, sensor: str, source: str, on_rig: Callable[[str], Complex]) -> Complex:
        part = next(part for part in self._parts if sensor in part.sensors)
        total = part.response(sensor, source) if source in part.inputs else Complex(0.0)
        for k, dynamometer in enumerate(self._dynamometers):
            if (driven := self._shape.cut(dynamometer).torque) in part.inputs:
                measured = on_rig(dynamometer.torque_sensor) * self._sensor_lag * self._sign[k]
                total = total + part.response(sensor, driven) * measured
        return total

    def _emulated(self, of: Dynamometer, by: Dynamometer) -> Complex:
        """Reference speed of one dynamometer for a torque at another one's interface."""
        return self._road(of, self._shape.cut(by).torque)

    def _road(self, of: Dynamometer, source: str) -> Complex:
        """Reference speed of a dynamometer for an input of the residual vehicle."""
        wanted = self._shape.cut(of)
        for part in self._parts:
            if wanted.speed in part.sensors and source in part.inputs:
                return part.response(wanted.speed, source)
        return Complex(0.0)


def sensor_sign(rig: System, dyno: Dynamometer) -> float:
    """Torque that drives the rotor for a reading of 1 N·m: +1 for a rotor at the flange's second end, else −1/ratio."""
    sensor = next(part for part in rig.sensors if part.name == dyno.torque_sensor)
    flange: Shaft = next(part for part in rig.shafts if part.name == sensor.of)
    rotor = next(part.on for part in rig.inputs if part.name == dyno.torque_input)
    reached, todo = {rotor}, [rotor]
    links: list[Shaft | Gear] = [*rig.shafts, *rig.gears]
    joints = [part.between for part in links if part.name != flange.name]
    while todo:
        here = todo.pop()
        for ends in joints:
            if here in ends:
                for end in set(ends) - reached:
                    reached.add(end)
                    todo.append(end)
    if flange.between[1] in reached:
        return 1.0
    return -1.0 if flange.ratio is None else -1 / flange.ratio.value
