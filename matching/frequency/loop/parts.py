"""The pieces of a tuned case as matrices: rig with its lags, residual vehicle, feedback controller.

Built from the linear models alone; nothing here is shared with the loop that the optimiser works on.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.linalg import block_diag

from matching.frequency.case.case import Case
from matching.frequency.loop.linear_body import Body, body
from modelling.bed.loop import Dynamometer
from modelling.bed.residual_vehicle import Interface
from modelling.linear.state_space import StateSpace
from modelling.model.components import Sensor
from modelling.model.system import System


@dataclass(frozen=True)
class Parts:
    """Rig and residual vehicle of a case as bodies, with who measures and drives what.

    Attributes
    ----------
    case : Case
    rig : Body
        With further sensors: every shaft's torque and the interfaces' speeds, see :func:`shaft_torque` and
        :func:`interface_speed`.
    residual : tuple of Body
        The tuned residual vehicle, part by part.
    cuts : tuple of Interface
        The cut each dynamometer follows.
    toward : ndarray (k,)
        Torque that drives the rotor for a flange reading of 1 N·m.
    simulated : tuple of str
        Inputs that act inside the residual vehicle.
    free : Body
        The rig before anything was tuned, sensors as ``rig``: what the matched one is compared with.
    """

    case: Case
    rig: Body
    residual: tuple[Body, ...]
    cuts: tuple[Interface, ...]
    toward: np.ndarray
    simulated: tuple[str, ...]
    free: Body

    @property
    def dynamometers(self) -> tuple[Dynamometer, ...]:
        """The dynamometers of the case, k of them."""
        return self.case.loop.dynamometers

    @property
    def drives(self) -> tuple[str, ...]:
        """Inputs of the rig that are no dynamometer's."""
        driven = {dyno.torque_input for dyno in self.dynamometers}
        return tuple(name for name in self.rig.space.inputs if name not in driven)

    @property
    def measured(self) -> tuple[str, ...]:
        """Inputs whose torque the feed-forward takes as measured: none in the structure ``pi``."""
        loop = self.case.loop
        on_rig = [name for name in self.drives if name in loop.measured]
        return loop.structure.measured_inputs(on_rig, self.simulated)

    @cached_property
    def bed(self) -> StateSpace:
        """Rig with inverter and torque-sensor lags.

        States [rig, air-gap torques (k), lagged flange torques (k)], inputs [torque commands after the dead time (k),
        :attr:`drives`], outputs [signed flange torques (k), rotor speeds (k), air-gap torques (k)].
        """
        rig, loop, k = self.rig.space, self.case.loop, len(self.dynamometers)
        n = len(rig.A)
        A = block_diag(rig.A, -np.eye(k) / loop["inverter_lag"], -np.eye(k) / loop["torque_sensor_lag"])
        B = np.zeros((n + 2 * k, k + len(self.drives)))
        C = np.zeros((3 * k, n + 2 * k))
        for j, dyno in enumerate(self.dynamometers):
            A[:n, n + j] = rig.input(dyno.torque_input)
            A[n + k + j, :n] = self.toward[j] * rig.output(dyno.torque_sensor) / loop["torque_sensor_lag"]
            B[n + j, j] = 1 / loop["inverter_lag"]
            C[j, n + k + j] = C[2 * k + j, n + j] = 1
            C[k + j, :n] = rig.output(dyno.speed_sensor)
        for i, name in enumerate(self.drives, k):
            B[:n, i] = rig.input(name)
        names = [dyno.name for dyno in self.dynamometers]
        outputs = tuple(f"{name} {what}" for what in ("torque", "speed", "air gap") for name in names)
        return StateSpace(A, B, C, np.zeros((3 * k, B.shape[1])), (*names, *self.drives), outputs)

    @property
    def further_readings(self) -> np.ndarray:
        """Readings (y, x) of :attr:`Loop.further_sensors` by state of :attr:`bed`."""
        further, n = self.case.loop.further_sensors, len(self.bed.A)
        rows = [self.rig.space.output(name) for name in further]
        return np.array([np.pad(row, (0, n - len(row))) for row in rows]).reshape(len(further), n)

    @cached_property
    def residual_space(self) -> StateSpace:
        """All of the residual vehicle: inputs [interface torques (k), :attr:`simulated`], outputs reference speeds."""
        A = block_diag(*(part.space.A for part in self.residual))
        sources = [*(cut.torque for cut in self.cuts), *self.simulated]
        B, C = np.zeros((len(A), len(sources))), np.zeros((len(self.cuts), len(A)))
        starts = np.cumsum([0, *(len(part.space.A) for part in self.residual)])
        for part, a, b in zip(self.residual, starts[:-1], starts[1:], strict=True):
            for i, name in enumerate(sources):
                if name in part.space.inputs:
                    B[a:b, i] = part.space.input(name)
            for j, cut in enumerate(self.cuts):
                if cut.speed in part.space.outputs:
                    C[j, a:b] = part.space.output(cut.speed)
        speeds = tuple(cut.speed for cut in self.cuts)
        return StateSpace(A, B, C, np.zeros((len(C), len(sources))), tuple(sources), speeds)

    @cached_property
    def controller(self) -> StateSpace:
        """The control structure's feedback law in continuous time, see :meth:`ControlStructure.controller`."""
        return self.case.loop.structure.controller(self.case.loop, self.residual_space, self.case.rig)

    @cached_property
    def sampled_controller(self) -> StateSpace:
        """The feedback law as it runs, from sample to sample, see :meth:`ControlStructure.sampled`."""
        return self.case.loop.structure.sampled(self.case.loop, self.residual_space, self.case.rig)


def parts_of(case: Case, rig: System | None = None, untuned: System | None = None) -> Parts:
    """Take a case apart.

    ``rig`` stands in for the case's where the true rig is another; ``untuned`` is the rig before it was tuned, ``rig``
    unless given.

    Raises
    ------
    InputError
        If rig or residual vehicle cannot be made linear.
    """
    residual = case.residual_vehicle
    cuts = tuple(
        next(cut for cut in residual.interfaces if cut.shaft == dyno.follows) for dyno in case.loop.dynamometers
    )
    rig = case.rig if rig is None else rig
    bodies = tuple(body(part) for part in residual.parts)
    taken = {cut.torque for cut in residual.interfaces}
    simulated = tuple(name for part in bodies for name in part.space.inputs if name not in taken)
    toward = np.array([_toward(rig, dyno) for dyno in case.loop.dynamometers])
    rig_body = body(watched(rig, cuts, rig_side=True))
    free = rig_body if untuned is None else body(watched(untuned, cuts, rig_side=True))
    return Parts(case, rig_body, bodies, cuts, toward, simulated, free)


def watched(system: System, cuts: tuple[Interface, ...], *, rig_side: bool) -> System:
    """The system with sensors of every shaft's torque and of the speeds at the cuts, on the rig's side or beyond."""
    more = [Sensor(shaft_torque(shaft.name), "torque", shaft.name) for shaft in system.shafts]
    more += [Sensor(interface_speed(cut.shaft), "speed", cut.rig_end if rig_side else cut.vehicle_end) for cut in cuts]
    return replace(system, sensors=(*system.sensors, *more))


def shaft_torque(shaft: str) -> str:
    """Name of the added sensor of a shaft's torque."""
    return f"verified_torque_{shaft}"


def interface_speed(shaft: str) -> str:
    """Name of the added sensor of the speed at a cut."""
    return f"verified_speed_{shaft}"


def _toward(rig: System, dyno: Dynamometer) -> float:
    """+1 where the rotor hangs on the second end of the measured flange, −1/ratio where on the first."""
    flange = next(
        shaft
        for shaft in rig.shafts
        for sensor in rig.sensors
        if sensor.name == dyno.torque_sensor and sensor.of == shaft.name
    )
    rotor = next(torque.on for torque in rig.inputs if torque.name == dyno.torque_input)
    joints = [set(part.between) for part in rig.shafts if part.name != flange.name]
    joints += [set(part.between) for part in rig.gears]
    joints += [{part.cage, part.left, part.right} for part in rig.differentials]
    beyond = {flange.between[1]}
    while grown := {end for joint in joints if joint & beyond for end in joint} - beyond:
        beyond |= grown
    if rotor in beyond:
        return 1.0
    return -1.0 if flange.ratio is None else -1 / flange.ratio.value
