"""The vehicle of others driven alone: can it be coupled, and how far is the design vehicle from it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from matching.match.case import Case
from matching.match.coupled import run_in_of
from matching.match.operating_range import law_over_speed
from modelling.errors import InputError
from modelling.linear.steady_motion import speeds_of
from modelling.running.plant import Vehicle
from modelling.running.vehicles import ModelVehicle


@dataclass(frozen=True)
class VehicleCheckSettings:
    """How a vehicle is driven alone.

    Attributes
    ----------
    pulse : float
        N·m at one cut for one step.
    torque : float
        N·m at all cuts, of the drive that shows its whole inertia.
    seconds, last : float
        s of this drive and of the coasting, and of their end over which the wheels' acceleration is read: tyres have
        come to their slip by then.
    least_left : float
        Share of a pulse's speed that has to be left one step later. A wheel without inertia keeps none: its speed
        follows the torque at once, which is an algebraic loop.
    alike : float
        Relative difference up to which the design vehicle counts as alike. The law holds its errors with a design
        vehicle that is off by a factor of two, so this is a remark, no limit.
    """

    pulse: float = 100.0
    torque: float = 100.0
    seconds: float = 2.0
    last: float = 0.5
    least_left: float = 0.05
    alike: float = 0.1


VEHICLE_CHECK = VehicleCheckSettings()


@dataclass(frozen=True)
class DrivenAlone:
    """What a vehicle shows at one speed; k cuts.

    Attributes
    ----------
    at_cut, whole : ndarray (k,)
        kg·m²: what a pulse meets at each cut, and what turns with it as the vehicle speeds up.
    resistance : ndarray (k,)
        N·m at each cut that would hold the speed.
    """

    at_cut: np.ndarray
    whole: np.ndarray
    resistance: np.ndarray


@dataclass(frozen=True)
class VehicleCheck:
    """The vehicle of others and the design vehicle, both driven alone at one speed (rad/s of the wheels)."""

    speed: float
    vehicle: DrivenAlone
    design: DrivenAlone
    ends: tuple[str, ...]
    bodies: tuple[str, ...]
    wheel_inertias: tuple[float, ...]
    body_inertias: tuple[float, ...]
    file: str
    settings: VehicleCheckSettings = VEHICLE_CHECK

    def remarks(self) -> list[str]:
        """How coarse the design vehicle is, with the lines that bring it nearer."""
        said, lines = [], []
        whole, own = self.vehicle.whole.sum(), self.design.whole.sum()
        if abs(whole / own - 1) > self.settings.alike:
            more = (whole - own) / len(self.bodies)
            lines += [
                f"inertias.{name}.J = {J + more:.4g}" for name, J in zip(self.bodies, self.body_inertias, strict=True)
            ]
        ratios = self.vehicle.at_cut / self.design.at_cut
        lines += [
            f"inertias.{name}.J = {J * ratio:.3g}"
            for name, J, ratio in zip(self.ends, self.wheel_inertias, ratios, strict=True)
            if abs(ratio - 1) > self.settings.alike
        ]
        said.append(
            f"{self.file} against the design vehicle, both driven alone at {self.speed:.3g} rad/s of the wheels: "
            f"inertia {whole:.3g} against {own:.3g} kg*m^2, at the cuts {_listed(self.vehicle.at_cut)} against "
            f"{_listed(self.design.at_cut)} kg*m^2, resistance {self.vehicle.resistance.sum():.3g} against "
            f"{self.design.resistance.sum():.3g} N*m"
        )
        if lines:
            said.append(
                f"the design vehicle may be coarse: {self.file} is what is judged; nearer to it are {', '.join(lines)}"
            )
        return said


def _listed(values: np.ndarray) -> str:
    return " and ".join(f"{value:.3g}" for value in values)


def check_vehicle(case: Case, settings: VehicleCheckSettings = VEHICLE_CHECK) -> VehicleCheck:
    """Drive the FMU of a case alone, and its design vehicle in the same way.

    Raises
    ------
    InputError
        If a torque turns a wheel the other way or not at all; if a wheel has no inertia; if the FMU fails.
    """
    loop = case.vehicle_in_the_loop
    assert loop is not None
    assert case.operating_range is not None
    law, run_in = law_over_speed(case), run_in_of(case)
    cuts = [next(cut for cut in case.residual_vehicle.interfaces if cut.shaft == one.follows)
            for one in case.loop.dynamometers]  # fmt: skip
    turning = speeds_of(case.vehicle)
    speed = np.array([[turning[cut.vehicle_end]] for cut in cuts])
    step = loop.timing(law.sample_time).steps * law.sample_time
    file = Path(loop.fmu).name
    with loop.started(run_in, 1) as fmu:
        _can_be_coupled(fmu, speed, step, [name for _, name in loop.torques], loop.fmu, settings)
        found = driven_alone(fmu, speed, step, settings)
    design = driven_alone(ModelVehicle(law.vehicle, law.dynamometers), speed, step, settings)
    inertia = {part.name: part.J.value for part in case.vehicle.inertias}
    ends, bodies = tuple(cut.vehicle_end for cut in cuts), tuple(case.operating_range.bodies)
    return VehicleCheck(
        float(speed.mean()), found, design, ends, bodies, tuple(inertia[name] for name in ends),
        tuple(inertia[name] for name in bodies), file, settings,
    )  # fmt: skip


def _after_pulse(
    vehicle: Vehicle, speed: np.ndarray, step: float, at: int | None, size: float
) -> tuple[np.ndarray, np.ndarray]:  # fmt: skip
    """Speeds (k,) one and two steps after a torque of one step at a cut; none for coasting."""
    own, torque = np.zeros((len(vehicle.own), 1)), np.zeros_like(speed)
    vehicle.begin(speed, torque)
    if at is not None:
        torque[at] = size
    one = vehicle.step(torque, own, step)[:, 0].copy()
    return one, vehicle.step(np.zeros_like(speed), own, step)[:, 0].copy()


def _can_be_coupled(
    vehicle: Vehicle, speed: np.ndarray, step: float, names: list[str], file: str, settings: VehicleCheckSettings
) -> None:
    coasting = _after_pulse(vehicle, speed, step, None, 0.0)
    for j, name in enumerate(names):
        pulsed = _after_pulse(vehicle, speed, step, j, settings.pulse)
        first, second = (float(after[j] - before[j]) for after, before in zip(pulsed, coasting, strict=True))
        if first <= 0:
            does = "does not turn its wheel" if first == 0 else "turns its wheel backwards"
            raise InputError(
                f"{file}: {name}", f"{settings.pulse:g} N*m for {1e3 * step:g} ms {does}",
                "name the torque into the vehicle at this cut, positive where it drives, and its speed",
            )  # fmt: skip
        if second < settings.least_left * first:
            raise InputError(
                f"{file}: {name}",
                f"its speed follows the torque at once ({first:.3g} rad/s, {second:.2g} a step later): there is no "
                "inertia at the cut, so torque and speed are an algebraic loop",
                "give the vehicle the inertia of its wheel at the cut, and let it integrate that itself",
            )  # fmt: skip


def driven_alone(
    vehicle: Vehicle, speed: np.ndarray, step: float, settings: VehicleCheckSettings = VEHICLE_CHECK
) -> DrivenAlone:
    """What a vehicle shows by pulses, driven and coasting, from speeds (k, 1), rad/s, on; ``step`` in s."""
    own, k = np.zeros((len(vehicle.own), 1)), len(speed)
    coasting, at_cut = _after_pulse(vehicle, speed, step, None, 0.0)[0], np.empty(k)
    for j in range(k):
        after = _after_pulse(vehicle, speed, step, j, settings.pulse)[0]
        at_cut[j] = settings.pulse * step / (after[j] - coasting[j])
    count, late = round(settings.seconds / step), round((settings.seconds - settings.last) / step)
    rates = []
    for torque in (0.0, settings.torque):
        vehicle.begin(speed, np.zeros_like(speed))
        wheel = np.array([vehicle.step(np.full_like(speed, torque), own, step)[:, 0] for _ in range(count)])
        rates.append((wheel[-1] - wheel[late]) / ((count - 1 - late) * step))
    whole = settings.torque / (rates[1] - rates[0])
    return DrivenAlone(at_cut, whole, -whole * rates[0])
