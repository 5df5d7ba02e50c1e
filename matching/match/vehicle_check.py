"""The vehicle of others driven alone: can it be coupled, and how far is the design vehicle from it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from matching.match.case import Case
from matching.match.coupled import run_in_of
from matching.match.operating_range import design_vehicle
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
    shares : tuple of float
        Of the highest speed of the range: further steady speeds at which the resistance is read.
    alike : float
        Relative difference up to which the design vehicle counts as alike. The law holds its errors with a design
        vehicle that is off by a factor of two, so this is a remark, no limit.
    """

    pulse: float = 100.0
    torque: float = 100.0
    seconds: float = 2.0
    last: float = 0.5
    least_left: float = 0.05
    shares: tuple[float, ...] = (0.5, 0.95)
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
    """The vehicle of others and the design vehicle, both driven alone.

    ``speed`` is that of the wheels, rad/s, at which the inertias are read; ``resistances`` are N·m of both at further
    steady speeds of the range, rad/s.
    """

    speed: float
    vehicle: DrivenAlone
    design: DrivenAlone
    resistances: tuple[tuple[float, float, float], ...]
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
        steady = [(self.speed, self.vehicle.resistance.sum(), self.design.resistance.sum()), *self.resistances]
        resistance = ", ".join(f"{found:.3g} against {design:.3g} at {at:.3g} rad/s" for at, found, design in steady)
        said.append(
            f"{self.file} against the design vehicle, both driven alone at {self.speed:.3g} rad/s of the wheels: "
            f"inertia {whole:.3g} against {own:.3g} kg*m^2, at the cuts {_listed(self.vehicle.at_cut)} against "
            f"{_listed(self.design.at_cut)} kg*m^2, resistance in N*m {resistance}"
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
    run_in, sample = run_in_of(case), case.loop["sample_time"]
    cuts = [case.residual_vehicle.cut_at(one.follows) for one in case.loop.dynamometers]
    turning = speeds_of(case.vehicle)
    speed = np.array([[turning[cut.vehicle_end]] for cut in cuts])
    step = loop.timing(sample).steps * sample
    file = Path(loop.fmu).name
    with loop.started(run_in, 1) as fmu:
        pulses = _pulses(fmu, speed, step, settings)
        _check_coupled(pulses, step, [name for _, name in loop.torques], loop.fmu, settings)
        found = driven_alone(fmu, speed, step, pulses[0], settings)
        model = ModelVehicle(design_vehicle(case), [one.name for one in case.loop.dynamometers])
        design = driven_alone(model, speed, step, _pulses(model, speed, step, settings)[0], settings)
        resistances = []
        for share in settings.shares:
            there = speed * (share * case.operating_range.highest / case.operating_range.rolling_radius / speed.mean())
            of_fmu, of_model = (
                float(coasted(one, there, step, each.whole, settings).sum())
                for one, each in ((fmu, found), (model, design))
            )
            resistances.append((float(there.mean()), of_fmu, of_model))
    inertia = {part.name: part.J.value for part in case.vehicle.inertias}
    ends, bodies = tuple(cut.vehicle_end for cut in cuts), tuple(case.operating_range.bodies)
    return VehicleCheck(
        float(speed.mean()), found, design, tuple(resistances), ends, bodies, tuple(inertia[name] for name in ends),
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


def _pulses(
    vehicle: Vehicle, speed: np.ndarray, step: float, settings: VehicleCheckSettings
) -> tuple[np.ndarray, np.ndarray]:  # fmt: skip
    """rad/s (k,) that a pulse at each cut adds to the speed there, one and two steps after it began."""
    coasting = _after_pulse(vehicle, speed, step, None, 0.0)
    pulsed = [_after_pulse(vehicle, speed, step, j, settings.pulse) for j in range(len(speed))]
    first, second = (np.array([after[n][j] - coasting[n][j] for j, after in enumerate(pulsed)]) for n in range(2))
    return first, second


def _check_coupled(
    pulses: tuple[np.ndarray, np.ndarray], step: float, names: list[str], file: str, settings: VehicleCheckSettings
) -> None:
    for name, first, second in zip(names, *(each.tolist() for each in pulses), strict=True):
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
    vehicle: Vehicle, speed: np.ndarray, step: float, pulsed: np.ndarray,
    settings: VehicleCheckSettings = VEHICLE_CHECK,
) -> DrivenAlone:  # fmt: skip
    """What a vehicle shows by pulses (k,), rad/s, driven and coasting from speeds (k, 1), rad/s; ``step`` in s."""
    at_cut = settings.pulse * step / pulsed
    rates = [_rate(vehicle, speed, step, torque, settings) for torque in (0.0, settings.torque)]
    whole = settings.torque / (rates[1] - rates[0])
    return DrivenAlone(at_cut, whole, -whole * rates[0])


def coasted(
    vehicle: Vehicle, speed: np.ndarray, step: float, whole: np.ndarray, settings: VehicleCheckSettings
) -> np.ndarray:  # fmt: skip
    """N·m at each cut (k,) that would hold speeds (k, 1), rad/s, from coasting with inertias ``whole`` (k,), kg·m²."""
    resistance: np.ndarray = -whole * _rate(vehicle, speed, step, 0.0, settings)
    return resistance


def _rate(
    vehicle: Vehicle, speed: np.ndarray, step: float, torque: float, settings: VehicleCheckSettings
) -> np.ndarray:  # fmt: skip
    """Acceleration (k,) of the wheels, rad/s², at the end of a drive under a torque at all cuts."""
    own = np.zeros((len(vehicle.own), 1))
    count, late = round(settings.seconds / step), round((settings.seconds - settings.last) / step)
    vehicle.begin(speed, np.zeros_like(speed))
    wheel = np.array([vehicle.step(np.full_like(speed, torque), own, step)[:, 0] for _ in range(count)])
    rate: np.ndarray = (wheel[-1] - wheel[late]) / ((count - 1 - late) * step)
    return rate
