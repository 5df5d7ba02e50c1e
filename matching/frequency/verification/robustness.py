"""What must be known how well: the rig is other than the controller believes, one quantity at a time."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from matching.frequency.loop.exact_loop import ExactLoop, Told
from matching.frequency.loop.linear_body import Body, body
from matching.frequency.loop.parts import Parts, watched
from matching.frequency.loop.poles import closed_matrix, neutral_motions, resting_and_right
from matching.frequency.loop.responses import POINTS, response_error
from modelling.bed.model_based import Twin
from modelling.model.mirror import mirror_image

CHANGE, LATER = 0.05, 5e-4  # relative, s
ORDER = 8


@dataclass(frozen=True)
class Deviation:
    """What one wrong quantity does.

    Attributes
    ----------
    name : str
        ``rig.…`` (a mirror image is wrong alike) or ``loop.dead_time``.
    change : float
        Relative; in s for the dead time.
    stable : bool
    spectral_abscissa, modulus_margin : float
        Of the feedback loop.
    response_error : float
        Against the vehicle, which has the wrong value too where it shares the component.
    """

    name: str
    change: float
    stable: bool
    spectral_abscissa: float
    modulus_margin: float
    response_error: float

    def to_dict(self) -> dict[str, Any]:
        """Plain values."""
        return dict(vars(self))


def robustness(parts: Parts, told: Twin | None) -> tuple[Deviation, ...]:
    """Every stiffness and inertia of the rig 5 % off either way, the dead time 0.5 ms; worst first."""
    case = parts.case
    frequencies = np.geomspace(*case.band, POINTS)
    found, done = [], set()
    vehicle = body(case.vehicle)
    for name in case.rig.parameters:
        if name in done or name.rsplit(".", 1)[1] not in ("J", "stiffness") or name.count(".") != 2:
            continue
        together = {name, mirror_image(name, case.rig)}
        done |= together
        for change in (CHANGE, -CHANGE):
            values = {own: case.rig.parameters[own].value * (1 + change) for own in together}
            true = replace(parts, rig=body(watched(case.rig.with_values(values), parts.cuts, rig_side=True)))
            shared = {own: value for own, value in values.items() if own in case.vehicle.parameters}
            target = body(case.vehicle.with_values(shared)) if shared else vehicle
            found.append(_judged(true, told, target, frequencies, f"rig.{name}", change, case.loop["dead_time"]))
    for change in (LATER, -LATER):
        late = max(case.loop["dead_time"] + change, 0.0)
        if late == case.loop["dead_time"]:
            continue
        found.append(_judged(parts, told, vehicle, frequencies, "loop.dead_time", late - case.loop["dead_time"], late))
    return tuple(sorted(found, key=lambda own: (own.stable, -own.response_error)))


def _judged(
    true: Parts, told: Twin | None, vehicle: Body, frequencies: np.ndarray, name: str, change: float, dead_time: float
) -> Deviation:
    poles = np.linalg.eigvals(closed_matrix(true, ORDER, dead_time))
    _, right = resting_and_right(poles, neutral_motions(true))
    loop = ExactLoop(true, dead_time)
    grid = np.geomspace(1e-2, 1e3, 300)
    margin = np.linalg.svd(loop.return_difference(2j * np.pi * grid), compute_uv=False)[:, -1].min()
    error = response_error(*compared(loop, told, vehicle, frequencies))
    return Deviation(name, float(change), right == 0, float(poles.real.max()), float(margin), error)


def compared(
    loop: ExactLoop, told: Twin | None, vehicle: Body, frequencies: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Responses (f, h) of the compared functions, rig and vehicle, the twin working with what it believes."""
    parts, s = loop.parts, 2j * np.pi * frequencies
    pairs = [(pair.input, pair.sensor) for pair in parts.case.compared]
    sensors = list(dict.fromkeys(sensor for _, sensor in pairs))
    H = vehicle.response(s)
    rows, columns = vehicle.space.outputs, vehicle.space.inputs
    wanted = np.stack([H[:, rows.index(sensor), columns.index(source)] for source, sensor in pairs], axis=1)
    got = np.empty_like(wanted)
    known = [
        name for name in dict.fromkeys(source for source, _ in pairs) if told is not None and name in parts.announced
    ]
    other = [name for name in dict.fromkeys(source for source, _ in pairs) if name not in known]
    for inputs, twin in ((known, told), (other, None)):
        if not inputs:
            continue
        what = None if twin is None else told_by(twin, parts, inputs, frequencies, loop.dead_time)
        values = loop.response(s, inputs, sensors, what)
        for h, (source, sensor) in enumerate(pairs):
            if source in inputs:
                got[:, h] = values[:, sensors.index(sensor), inputs.index(source)]
    return got, wanted


def told_by(twin: Twin, parts: Parts, inputs: list[str], frequencies: np.ndarray, dead_time: float) -> Told:
    """What the twin commands and expects for announced inputs, per N·m of a held torque; side bands left out."""
    columns = [twin.announced.index(name) for name in inputs]
    names = [dyno.name for dyno in parts.dynamometers]
    rows = [twin.outputs.index(f"{name} {what}") for what in ("torque", "speed") for name in names]
    sign = np.concatenate([parts.toward, np.ones(len(names))])
    # readings belong to samples, torques and commands are held after them: half a sample and more lies between
    hold = -np.expm1(-2j * np.pi * frequencies * twin.sample_time) / (2j * np.pi * frequencies * twin.sample_time)
    expected = sign[:, None] * twin.response(frequencies)[:, rows][:, :, columns] / hold[:, None, None]
    step, late = twin.sample_time, dead_time - twin.delay * twin.sample_time
    powers = [twin.W[:, columns]]
    for _ in range(twin.delay - 1):
        powers.append(twin.A @ powers[-1])
    closed = twin.A - twin.B @ twin.F
    commands = np.empty((len(frequencies), len(names), len(columns)), complex)
    for i, f in enumerate(frequencies):
        z = np.exp(2j * np.pi * f * step)
        # the prediction holds the torques of its moment: what it misses of those that came in since
        missed = sum(
            (power * (z**j - 1) for j, power in enumerate(reversed(powers[: twin.delay]))), np.zeros_like(powers[0])
        )
        lost = twin.F @ missed * z**-twin.delay
        state = np.linalg.solve(z * np.eye(len(closed)) - closed, twin.W[:, columns] + twin.B @ lost)
        commands[i] = (lost - twin.F @ state) * np.exp(-2j * np.pi * f * late)
    return Told(commands, expected)
