"""Time simulation of vehicle, rig without control and matched rig: one time base, a true delay line, sampled control.

The controller runs at the loop's sample time. The dead time is counted from a sample to the middle of what its command
does: the hold lags half a sample, so the delay line is half a sample shorter than the dead time (not below 0).
Torques of the manoeuvre vary linearly between samples, for vehicle and rig alike.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from matching.frequency.loop.emulated import emulated
from matching.frequency.loop.linear_body import Body, body
from matching.frequency.loop.motion import LinearMotion, NonlinearMotion, body_motion
from matching.frequency.loop.parts import Parts, interface_speed, shaft_torque, watched
from matching.frequency.verification.running_controller import Running, running_controller, torque_columns
from modelling.equations.compiled import compiled
from modelling.linear.elements import elements
from modelling.linear.reference_motion import is_linear, operating_motion, torques_of
from modelling.model.system import System
from modelling.simulation.result import SimulationError

TOO_LARGE = 1e9  # a state beyond this has left every bed


@dataclass(frozen=True)
class Traces:
    """Vehicle, rig without control and matched rig over one manoeuvre, SI.

    Each of the three maps names to traces (t,), less their values at the operating point: sensors by name,
    ``interfaces.SHAFT.speed``, ``shafts.NAME.torque`` and ``.twist``; of both rigs ``residual_vehicle.SENSOR``, what
    the residual vehicle reads (:mod:`.emulated`). Of the matched rig also ``dynamometers.NAME.torque`` (air gap),
    ``.speed``, ``.power`` and ``.command``, which are absolute. ``operating`` holds the values of the matched rig's
    shafts at the operating point.
    """

    time: np.ndarray
    torques: dict[str, np.ndarray]
    vehicle: dict[str, np.ndarray] = field(repr=False)
    rig: dict[str, np.ndarray] = field(repr=False)
    matched: dict[str, np.ndarray] = field(repr=False)
    operating: dict[str, float] = field(repr=False, default_factory=dict)

    def absolute(self, name: str) -> np.ndarray:
        """A trace (t,) of the matched rig with its value at the operating point."""
        return self.matched[name] + self.operating.get(name, 0.0)


def simulate_case(parts: Parts, running: Running, torques: Mapping[str, np.ndarray], settle: int = 0) -> Traces:
    """Simulate all three on torques (t,) by input, one value a sample of the loop; inputs left out stay 0.

    Parameters
    ----------
    running : FeedForward, ObserverController or None
        The feed-forward of the structure, or its whole controller where it is an observer; None in ``pi``.
    settle : int
        Samples at the beginning that are left out of the traces.

    Raises
    ------
    SimulationError
        If the loop grows out of bounds.
    """
    step = parts.case.loop["sample_time"]
    vehicle = watched(parts.case.vehicle, parts.cuts, rig_side=False)
    count = len(next(iter(torques.values())))
    time = (np.arange(count) - settle) * step
    motions = (
        free_motion(vehicle, parts, torques, step),
        free_motion(parts.free.system, parts, torques, step, parts.free),
        matched_motion(parts, running, torques),
    )
    motions[1].update(emulated(parts, motions[1], torques, tuned=False))
    motions[2].update(emulated(parts, motions[2], torques, tuned=running is None))
    vehicle_traces, free, matched = ({name: trace[settle:] for name, trace in motion.items()} for motion in motions)
    applied = {name: np.asarray(torque)[settle:] for name, torque in torques.items()}
    operating = operating_readings(parts.rig.system)
    return Traces(time[settle:], applied, vehicle_traces, free, matched, operating)


def free_motion(
    system: System, parts: Parts, torques: Mapping[str, np.ndarray], step: float, linear_body: Body | None = None
) -> dict[str, np.ndarray]:
    """Traces (t,) of a system without control under torques (t,) in N·m, in steps of s.

    Raises
    ------
    SimulationError
        If a state is not finite.
    """
    inputs = [part.name for part in system.inputs]
    count = len(next(iter(torques.values())))
    drives = np.stack([torques.get(name, np.zeros(count)) for name in inputs], axis=1)
    if is_linear(system):
        linear_body = body(system) if linear_body is None else linear_body
        motion: LinearMotion | NonlinearMotion = body_motion(linear_body, step)
    else:
        motion = NonlinearMotion(None, system, step)
    states = motion.free(drives)
    _check(states, count * step)
    return _readings(system, parts, linear_body, motion, states, drives)


def matched_motion(parts: Parts, running: Running, torques: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Traces (t,) of the rig with its loop closed under torques (t,) in N·m.

    Raises
    ------
    SimulationError
        If a state is not finite.
    """
    loop, k_dynos = parts.case.loop, len(parts.dynamometers)
    step = loop["sample_time"]
    count = len(next(iter(torques.values())))
    delay = loop.command_delay()
    linear = is_linear(parts.case.rig)
    bed = parts.bed
    motion: LinearMotion | NonlinearMotion = (
        LinearMotion(bed.A, bed.B, k_dynos, step, delay)
        if linear
        else NonlinearMotion(parts, parts.rig.system, step, delay)
    )
    drives = torque_columns(torques, parts.drives, count)
    controller = running_controller(parts, running, torques, count)
    rows = np.vstack([bed.C[: 2 * k_dynos], parts.further_readings])
    issued = np.zeros((count, k_dynos))
    states = np.empty((count, len(motion.start)))
    x = motion.start
    for k in range(count):
        states[k] = x
        readings = rows @ x if linear else motion.deviation_readings(x).full().ravel()  # type: ignore[union-attr]
        issued[k] = controller.command(k, readings)
        x = motion.advance(x, drives[k : k + 2] if k + 1 < count else drives[[k, k]], issued, k)
        if k % 8 == 0:
            _check(x[None], k * step)
    _check(states, count * step)
    n = len(motion.start) - 2 * k_dynos
    added = states[:, n : n + k_dynos] - motion.start[n : n + k_dynos]  # to the torques of the operating point
    every = np.zeros((count, len(parts.rig.space.inputs)))
    for i, name in enumerate(parts.rig.space.inputs):
        every[:, i] = drives[:, parts.drives.index(name)] if name in parts.drives else 0.0
    for j, dyno in enumerate(parts.dynamometers):
        every[:, parts.rig.space.inputs.index(dyno.torque_input)] = added[:, j]
    free: LinearMotion | NonlinearMotion | None = None if linear else NonlinearMotion(None, parts.rig.system, step)
    traces = _readings(parts.rig.system, parts, parts.rig, free, states[:, :n], every)
    held = torques_of(parts.rig.system)
    turning = operating_readings(parts.rig.system)
    for j, dyno in enumerate(parts.dynamometers):
        place, torque = f"dynamometers.{dyno.name}", added[:, j] + held[dyno.torque_input]
        speed = traces[dyno.speed_sensor] + turning[dyno.speed_sensor]
        traces |= {f"{place}.torque": torque, f"{place}.speed": speed, f"{place}.power": torque * speed}
        traces[f"{place}.command"] = issued[:, j] + held[dyno.torque_input]
    return traces


def _readings(
    system: System,
    parts: Parts,
    linear_body: Body | None,
    motion: LinearMotion | NonlinearMotion | None,
    states: np.ndarray,
    inputs: np.ndarray,
) -> dict[str, np.ndarray]:
    """Traces by name from states (t, x) and inputs (t, u) of a system."""
    names = [sensor.name for sensor in system.sensors]
    if isinstance(motion, NonlinearMotion):
        time = parts.case.loop["sample_time"] * np.arange(len(states))
        steady = motion.start + np.outer(time, motion.drift)
        read = motion.readings.map(len(states))
        values = np.array(read(states.T, inputs.T)).T - np.array(read(steady.T, 0 * inputs.T)).T
        twists = (states - steady) @ motion.twists.T
        springs = elements(compiled(system), compiled(system).p0[None]).springs
    else:
        assert linear_body is not None
        values = states @ linear_body.space.C.T + inputs @ linear_body.space.D.T
        twists, springs = states @ linear_body.twists.T, linear_body.springs
    by_name = dict(zip(names, values.T, strict=True))
    traces = {sensor.name: by_name[sensor.name] for sensor in system.sensors if not sensor.name.startswith("verified_")}
    for shaft in system.shafts:
        traces[f"shafts.{shaft.name}.torque"] = by_name[shaft_torque(shaft.name)]
        if f"shafts.{shaft.name}" in springs:
            traces[f"shafts.{shaft.name}.twist"] = twists[:, springs.index(f"shafts.{shaft.name}")]
    for cut in parts.cuts:
        traces[f"interfaces.{cut.shaft}.speed"] = by_name[interface_speed(cut.shaft)]
    return traces


def operating_readings(system: System) -> dict[str, float]:
    """Readings (SI) of a watched system at its operating point by trace name, shaft twists too; 0 without one."""
    model, about = compiled(system), operating_motion(system)
    values = model.readings(about.state, about.inputs, model.p0, 0.0).full().ravel()
    readings = dict(zip(model.sensors, values.tolist(), strict=True))
    parts = elements(model, model.p0[None])
    twists = dict(zip(parts.springs, (parts.deflection_jacobian @ about.state).tolist(), strict=True))
    for shaft in system.shafts:
        readings[f"shafts.{shaft.name}.torque"] = readings[shaft_torque(shaft.name)]
        readings[f"shafts.{shaft.name}.twist"] = twists.get(f"shafts.{shaft.name}", 0.0)
    return readings


def _check(states: np.ndarray, at: float) -> None:
    if not np.abs(states).max(initial=0.0) < TOO_LARGE:
        raise SimulationError("simulation", f"the motion grows out of bounds at {at:g} s", "the loop is unstable")
