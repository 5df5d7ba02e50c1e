"""Target modes read off simulated motion, for vehicle and matched rig alike."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from matching.frequency.case.targets import target_modes
from matching.frequency.loop.linear_body import Body, body
from matching.frequency.loop.loop_modes import LoopMode, eigenvalue_of
from matching.frequency.loop.parts import Parts, interface_speed, watched
from matching.frequency.verification.ringing import Ringing, read_modes
from matching.frequency.verification.running_controller import Running
from matching.frequency.verification.simulation import Traces, simulate_case
from modelling.bed.manoeuvres import Kick
from modelling.modal.result import Mode

PERIODS = 8.0  # that an excitation of its own is watched for
NEIGHBOUR_WITHIN = 0.25  # relative in frequency: a mode so near might be taken for the target's
SAME_EIGENVALUE = 0.05  # |ln s/s₀| between what is read off a simulation and the eigenvalue of the linear model
NEIGHBOUR_DAMPING = 3.0  # times the target's: what is damped more dies away before it could be taken for it


@dataclass(frozen=True)
class IdentifiedMode:
    """A target mode as the simulation shows it; None where it is not found.

    ``excited_by`` is ``manoeuvre`` or the input that an excitation of its own acted on, because the manoeuvre left the
    mode at rest or too little free motion after it.
    """

    vehicle_mode: int
    vehicle: Ringing | None
    matched: Ringing | None
    excited_by: str

    def to_dict(self) -> dict[str, Any]:
        """Plain values."""
        entry = {"vehicle_mode": self.vehicle_mode, "excited_by": self.excited_by}
        return entry | {
            key: None if reading is None else dict(vars(reading))
            for key, reading in (("vehicle", self.vehicle), ("matched", self.matched))
        }


def manoeuvre_torques(parts: Parts) -> tuple[dict[str, np.ndarray], int]:
    """Torques (t,) in N·m of the case's manoeuvre at the samples of the loop, and how many samples only lead in.

    Where torques do not begin at 0 they rise smoothly over 2 s before.
    """
    step, manoeuvres = parts.case.loop["sample_time"], parts.case.manoeuvre
    time = np.arange(round(max(manoeuvre.duration for manoeuvre in manoeuvres.values()) / step) + 1) * step
    torques = {name: manoeuvre.torque(time) for name, manoeuvre in manoeuvres.items()}
    if not any(torque[0] for torque in torques.values()):
        return torques, 0
    rise = np.linspace(0, 1, round(2 / step), endpoint=False)
    rise = rise * rise * (3 - 2 * rise)
    return {name: np.concatenate([torque[0] * rise, torque]) for name, torque in torques.items()}, len(rise)


def identified_modes(parts: Parts, running: Running, traces: Traces) -> tuple[IdentifiedMode, ...]:
    """Read every target mode off the traces of the manoeuvre, or off a kick where they do not show it in the vehicle.

    Raises
    ------
    SimulationError
        If the loop grows out of bounds.
    """
    vehicle = body(watched(parts.case.vehicle, parts.cuts, rig_side=False))
    pairs = target_modes(parts.case)
    targets = [plain for plain, _ in pairs]
    swinging = swinging_modes(vehicle)
    chosen = [int(np.argmin(np.abs(swinging.values - eigenvalue_of(damped)))) for _, damped in pairs]
    top = max(parts.case.band[1], *(1.5 * mode.frequency for mode in targets))
    read = _read(parts, vehicle, traces, swinging, chosen, top)
    identified = []
    for mode, index, (of_vehicle, rig) in zip(targets, chosen, read, strict=True):
        by = "manoeuvre"
        if of_vehicle is None and mode.frequency > 0:
            kicked = _kick(parts, vehicle, mode)
            if kicked is not None:
                by, torques = kicked
                traces = simulate_case(parts, running, torques)
                of_vehicle, rig = _read(parts, vehicle, traces, swinging, [index], top)[0]
        identified.append(IdentifiedMode(mode.number, of_vehicle, rig, by))
    return tuple(identified)


@dataclass(frozen=True)
class SwingingModes:
    """Modes of the damped vehicle that swing: eigenvalues (m,), rad/s, and eigenvectors (x, m)."""

    values: np.ndarray
    vectors: np.ndarray


def swinging_modes(vehicle: Body) -> SwingingModes:
    """None of them overdamped."""
    values, vectors = np.linalg.eig(vehicle.space.A)
    upper = values.imag > 0
    return SwingingModes(values[upper], vectors[:, upper])


def neighbours(swinging: SwingingModes, chosen: list[int]) -> list[int]:
    """Indices of modes that might be taken for one of the chosen: near in frequency, and not damped much more."""
    sizes = np.abs(swinging.values)
    damping = -swinging.values.real / np.maximum(sizes, 1e-300)
    close = set[int]()
    for index in chosen:
        if index is not None:
            near = np.abs(sizes / sizes[index] - 1) < NEIGHBOUR_WITHIN
            close |= set(np.flatnonzero(near & (damping < NEIGHBOUR_DAMPING * damping[index])).tolist())
    return sorted(close - set(chosen))


def _read(
    parts: Parts, vehicle: Body, traces: Traces, swinging: SwingingModes, chosen: list[int], top: float
) -> list[tuple[Ringing | None, Ringing | None]]:
    """(vehicle, matched) for every chosen mode, off what follows the last change of a torque."""
    changes = [np.flatnonzero(np.diff(torque)) for torque in traces.torques.values()]
    first = max((int(change[-1]) + 2 for change in changes if len(change)), default=0)
    step = float(traces.time[1] - traces.time[0])
    names = list(dict.fromkeys(pair.sensor for pair in parts.case.compared))
    rows = [vehicle.space.output(name) for name in names]
    rows += [vehicle.space.output(interface_speed(cut.shaft)) for cut in parts.cuts]
    names += [f"interfaces.{cut.shaft}.speed" for cut in parts.cuts]
    amplitudes = np.array(rows) @ swinging.vectors  # (c, m)
    shapes = amplitudes[:, chosen].T
    around = neighbours(swinging, chosen)
    others, known = amplitudes[:, around].T, swinging.values[[*chosen, *around]]
    pair = []
    for trace in (traces.vehicle, traces.matched):
        signals = np.stack([trace[name][first:] for name in names], axis=1)
        nothing: list[Ringing | None] = [None] * len(shapes)
        pair.append(read_modes(signals, step, shapes, top, others, known) if len(signals) >= 40 else nothing)
    read = zip(*pair, known, strict=False)
    return [(vehicle, rig) if is_mode(vehicle, value) else (None, None) for vehicle, rig, value in read]


def is_mode(reading: Ringing | None, eigenvalue: complex) -> bool:
    """Whether what was read off a motion is the mode with that eigenvalue, rad/s."""
    if reading is None:
        return False
    return abs(np.log(eigenvalue_of(reading) / eigenvalue)) <= SAME_EIGENVALUE


def of_the_targets_modes(
    identified: Iterable[IdentifiedMode], targets: Iterable[LoopMode | None], modes: Sequence[LoopMode]
) -> tuple[IdentifiedMode, ...]:
    """Readings of the matched rig, without those that are another mode of the loop than the one the target became.

    A few sensors move alike in modes that every inertia and cut together tell apart. What is no mode of the loop stays:
    there simulation and loop disagree.

    Parameters
    ----------
    targets : iterable of LoopMode or None
        What each target became, in the order of ``identified``.
    modes : sequence of LoopMode
        Every mode of the loop.
    """
    kept = []
    for reading, target in zip(identified, targets, strict=True):
        others = [mode for mode in modes if mode is not target and mode.frequency > 0]
        of_target = target is not None and is_mode(reading.matched, eigenvalue_of(target))
        if not of_target and any(is_mode(reading.matched, eigenvalue_of(mode)) for mode in others):
            reading = replace(reading, matched=None)
        kept.append(reading)
    return tuple(kept)


def _kick(parts: Parts, vehicle: Body, mode: Mode) -> tuple[str, Mapping[str, np.ndarray]] | None:
    """A one-sided pulse, half a period long, on the input that moves the mode most."""
    known = parts.measured or (*parts.drives, *parts.simulated)  # an unmeasured torque shows the feedback's modes
    inputs = [name for name in known if name in vehicle.space.inputs]
    on = {torque.name: f"inertias.{torque.on}" for torque in vehicle.system.inputs}
    push = {name: abs(mode.shape[on[name]]) for name in dict.fromkeys(inputs)}
    if not push or max(push.values()) < 1e-6:
        return None
    best = max(push, key=lambda name: push[name])
    rise = 0.25 / mode.frequency
    kick = Kick(amplitude=500.0, at=0.05, rise_time=rise, duration=0.05 + 2 * rise + PERIODS / mode.frequency)
    time = kick.time(1 / parts.case.loop["sample_time"])
    return best, {best: kick.torque(time)}
