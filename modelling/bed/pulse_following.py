"""What an engine's pulses ask of the dynamometers at every speed: from the closed loop and the vehicle in one piece."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from modelling.bed.bed import BedModel, DelayedBed, Loop, bed_model, delayed_bed
from modelling.bed.firing import FIRING, FiringSettings, PulseFollowing, no_following
from modelling.bed.stepped import SteppedLaw
from modelling.bed.vehicle import ResidualVehicle
from modelling.linear.state_space import StateSpace, state_space
from modelling.linear.steady_motion import speeds_of
from modelling.system import Input, Sensor, System


@dataclass(frozen=True)
class SampledRig:
    """Rig and lags from sample to sample, without the residual vehicle.

    Attributes
    ----------
    bed : DelayedBed
    readings, cuts : ndarray (y, n), (k, n)
        Readings, and torques into the vehicle at the cuts, by its states (n).
    """

    bed: DelayedBed
    readings: np.ndarray
    cuts: np.ndarray

    def states(self, z: np.ndarray) -> np.ndarray:
        """States (f, n, k) for commands at z (f,)."""
        bed, n = self.bed, len(self.bed.whole)
        late = z[:, None, None] ** (-bed.delay)
        return np.linalg.solve(z[:, None, None] * np.eye(n) - bed.whole, late * (bed.new + bed.old / z[:, None, None]))


def sampled_rig(model: BedModel, readings: np.ndarray, cuts: np.ndarray, loop: Loop) -> SampledRig:
    """Rig and lags of a model; readings (y, n) and torques at the cuts (k, n) by its first states."""
    n, k = readings.shape[1], len(loop.dynamometers)
    made = delayed_bed(
        model.space.A[:n, :n], model.space.B[:n, :k], np.zeros((n, 0)), loop.command_delays(), loop["sample_time"]
    )
    wide = ((0, 0), (0, len(made.whole) - n))
    return SampledRig(made, np.pad(readings, wide), np.pad(cuts, wide))


@dataclass(frozen=True)
class CutResponses:
    """What pulses held over a sample, and torques added to the commands do, about one speed; f frequencies.

    Attributes
    ----------
    torques : ndarray (f, k, m + k)
        Torques into the vehicle at the cuts.
    errors : ndarray (f, k, m + k)
        Speeds of the rotors less those of the vehicle at the cuts, rad/s.
    commands : ndarray (f, k, m + k)
    """

    torques: np.ndarray
    errors: np.ndarray
    commands: np.ndarray


def cut_responses(law: SteppedLaw, speed: float, rig: SampledRig, z: np.ndarray) -> CutResponses:
    """Responses of the closed loop to each of the vehicle's pulses and to torques added to the commands.

    Parameters
    ----------
    speed : float
        rad/s of the vehicle's bodies.
    z : ndarray (f,)
    """
    one = law.frozen(speed, driven=True)
    held = rig.states(z)  # (f, n, k)
    x, m, k = one.states, law.vehicle.pulses.count, len(law.dynamometers)
    inner = one.Bw.shape[1] - m - k
    Bw, Dw = one.Bw[:, inner:], one.Dw[:, inner:]
    # corrected = x + L·(y − E·x), y = C·states·u: unknown are x (x) and u (k)
    read = rig.readings @ held  # (f, y, k)
    of_state = np.eye(x) - one.L @ one.E
    A = one.A @ of_state
    of_command = (one.A @ one.L + one.By) @ read + one.Bs
    K = one.K @ of_state
    direct = (one.K @ one.L + one.Dy) @ read
    whole = np.zeros((len(z), x + k, x + k), complex)
    whole[:, :x, :x], whole[:, :x, x:] = z[:, None, None] * np.eye(x) - A, -of_command
    whole[:, x:, :x], whole[:, x:, x:] = -K, np.eye(k) - direct
    found = np.linalg.solve(whole, np.broadcast_to(np.vstack([Bw, Dw]), (len(z), x + k, m + k)))
    commands = found[:, x:]
    rotors = (read[:, list(law.speed_readings)] @ commands) / law.over[:, None]
    wheels = law.vehicle.wheel @ found[:, x - law.vehicle_states : x]
    return CutResponses(rig.cuts @ held @ commands, rotors - wheels, commands)


def pulsed(vehicle: System, cuts: Sequence[str], places: Sequence[str]) -> System:
    """The vehicle with a torque on each inertia of ``places`` and the torque of each shaft of ``cuts`` read."""
    return replace(
        vehicle,
        inputs=(*vehicle.inputs, *(Input(f"pulse_on_{name}", name) for name in places)),
        sensors=(*vehicle.sensors, *(Sensor(f"torque_at_cut_{name}", "torque", name) for name in cuts)),
    )


def vehicle_responses(
    space: StateSpace, residual: ResidualVehicle, cuts: Sequence[str], places: Sequence[str], f: np.ndarray
) -> np.ndarray:
    """Torques into the residual vehicle at the cuts (f, k, m) that pulses at inertias make of the vehicle in one piece.

    ``space`` is of :func:`pulsed`, linear about its operating point; frequencies f (f,) in Hz.
    """
    named, read = [f"pulse_on_{name}" for name in places], [f"torque_at_cut_{name}" for name in cuts]
    B = np.stack([space.input(name) for name in named], axis=1)
    C = np.stack([space.output(name) for name in read])
    D = space.D[[space.outputs.index(name) for name in read]][:, [space.inputs.index(name) for name in named]]
    s = 2j * np.pi * f[:, None, None]
    into = np.array([residual.cut_at(name).factor for name in cuts])
    found: np.ndarray = into[:, None] * (C @ np.linalg.solve(s * np.eye(len(space.A)) - space.A, B + 0j) + D)
    return found


def pulse_following(
    law: SteppedLaw, rigs: Sequence[System], residuals: Sequence[ResidualVehicle], loop: Loop,
    settings: FiringSettings = FIRING,
) -> PulseFollowing:  # fmt: skip
    """Torques to be added so that each cut has the torque of the vehicle in one piece.

    ``rigs`` and ``residuals`` (g) are at the speeds of the law, see :func:`modelling.bed.stepped.stepped_law`.
    """
    pulses, k, h = law.vehicle.pulses, len(law.dynamometers), loop["sample_time"]
    if not pulses.count:
        return no_following(k)
    cuts = [one.follows for one in loop.dynamometers]
    turning = [speeds_of(one.vehicle) for one in residuals]
    parts = [residuals[0].part_of(residuals[0].cut_at(name)) for name in cuts]
    machines = tuple(
        next(j for j, part in enumerate(parts) if any(one.name == place for one in part.inertias))
        for place in pulses.places
    )  # fmt: skip
    speeds, tables, answers = [], [], []
    for number, place in enumerate(pulses.places):
        there = np.abs([each[place] for each in turning])
        order = pulses.order[number]
        top = min(there[-1], 2 * np.pi * settings.highest / h / order)
        count = max(int(np.ceil(np.log(top / there[0]) / np.log1p(settings.finest))), 1) + 1 if top > there[0] else 2
        known = np.geomspace(min(there[0], top / 2), top, count)
        gains, answer = np.zeros((count, k), complex), np.zeros(count, complex)
        nearest = np.abs(np.log(known[:, None] / there)).argmin(axis=1)
        for at in np.unique(nearest):
            rows = np.flatnonzero(nearest == at)
            f = order * known[rows] / (2 * np.pi)
            z = np.exp(2j * np.pi * f * h)
            rig = rig_of(law, rigs[at], residuals[at], loop)
            space = state_space(pulsed(residuals[at].vehicle, cuts, [place]))
            wanted = vehicle_responses(space, residuals[at], cuts, [place], f)[..., 0]
            found, m = cut_responses(law, float(law.speeds[at]), rig, z), pulses.count
            # the law holds the pulse of the middle of a sample
            made = found.torques[..., number] * np.sqrt(z)[:, None]
            gains[rows] = np.linalg.solve(found.torques[..., m:], (wanted - made)[..., None])[..., 0]
            answer[rows] = found.errors[:, machines[number], m + machines[number]]
        if top < there[-1]:  # above, nothing is added
            known, gains = np.r_[known, known[-1] * (1 + settings.fades)], np.vstack([gains, np.zeros(k)])
            answer = np.r_[answer, answer[-1]]
        speeds.append(known)
        tables.append(gains)
        answers.append(answer)
    most = max(map(len, speeds))
    grids = [np.linspace(0, len(one) - 1, most) for one in speeds]
    at_all = [np.interp(grid, np.arange(len(one)), one) for grid, one in zip(grids, speeds, strict=True)]
    filled = [
        np.stack([np.interp(now, one, part) for part in table.T], axis=1)
        for now, one, table in zip(at_all, speeds, tables, strict=True)
    ]
    answering = [np.interp(now, one, part) for now, one, part in zip(at_all, speeds, answers, strict=True)]
    return PulseFollowing(
        np.stack(at_all), np.stack(filled), np.stack(answering), machines, settings.speed_time, settings.correcting
    )  # fmt: skip


def rig_of(law: SteppedLaw, rig: System, residual: ResidualVehicle, loop: Loop) -> SampledRig:
    """Rig and lags as the law counts them, which may be another bed than it was designed for."""
    model = bed_model(rig, residual, loop)
    n = model.rig_states + loop.lag_states
    wanted: Mapping[str, int] = {name: row for row, name in enumerate(model.space.outputs)}
    named = [f"{loop.dynamometers[j].name} torque" for j in loop.with_flange]
    named += [f"{one.name} speed" for one in loop.dynamometers] + list(loop.further_sensors)
    readings = np.stack([model.space.C[wanted[name]] for name in named])[:, :n]
    into = np.linalg.pinv(law.vehicle.by_cut) @ model.space.A[n:, :n]
    return sampled_rig(model, readings, into, loop)
