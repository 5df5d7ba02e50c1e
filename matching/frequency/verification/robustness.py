"""What must be known how well: the rig is other than the controller believes, one quantity at a time."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from matching.frequency.loop.exact_loop import ExactLoop, FeedForwardAction
from matching.frequency.loop.linear_body import Body, body
from matching.frequency.loop.parts import Parts, watched
from matching.frequency.loop.poles import closed_matrix, neutral_motions, resting_and_right
from matching.frequency.loop.response_error import POINTS, response_error
from modelling.bed.feed_forward import FeedForward
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


def robustness(parts: Parts, feed_forward: FeedForward | None) -> tuple[Deviation, ...]:
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
            found.append(
                _judged(true, feed_forward, target, frequencies, f"rig.{name}", change, case.loop["dead_time"])
            )
    for change in (LATER, -LATER):
        late = max(case.loop["dead_time"] + change, 0.0)
        if late == case.loop["dead_time"]:
            continue
        found.append(
            _judged(parts, feed_forward, vehicle, frequencies, "loop.dead_time", late - case.loop["dead_time"], late)
        )
    return tuple(sorted(found, key=lambda own: (own.stable, -own.response_error)))


def _judged(
    true: Parts,
    feed_forward: FeedForward | None,
    vehicle: Body,
    frequencies: np.ndarray,
    name: str,
    change: float,
    dead_time: float,
) -> Deviation:
    poles = np.linalg.eigvals(closed_matrix(true, ORDER, dead_time))
    _, right = resting_and_right(poles, neutral_motions(true))
    loop = ExactLoop(true, dead_time)
    grid = np.geomspace(1e-2, 1e3, 300)
    margin = np.linalg.svd(loop.return_difference(2j * np.pi * grid), compute_uv=False)[:, -1].min()
    error = response_error(*compared(loop, feed_forward, vehicle, frequencies))
    return Deviation(name, float(change), right == 0, float(poles.real.max()), float(margin), error)


def compared(
    loop: ExactLoop, feed_forward: FeedForward | None, vehicle: Body, frequencies: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Responses (f, h) of the compared functions, rig and vehicle, the feed-forward working with the model it has."""
    parts, s = loop.parts, 2j * np.pi * frequencies
    pairs = [(pair.input, pair.sensor) for pair in parts.case.compared]
    sensors = list(dict.fromkeys(sensor for _, sensor in pairs))
    H = vehicle.response(s)
    rows, columns = vehicle.space.outputs, vehicle.space.inputs
    wanted = np.stack([H[:, rows.index(sensor), columns.index(source)] for source, sensor in pairs], axis=1)
    got = np.empty_like(wanted)
    known = [
        name
        for name in dict.fromkeys(source for source, _ in pairs)
        if feed_forward is not None and name in parts.measured
    ]
    other = [name for name in dict.fromkeys(source for source, _ in pairs) if name not in known]
    for inputs, acting in ((known, feed_forward), (other, None)):
        if not inputs:
            continue
        action = None if acting is None else feed_forward_action(acting, parts, inputs, frequencies, loop.dead_time)
        values = loop.response(s, inputs, sensors, action)
        for h, (source, sensor) in enumerate(pairs):
            if source in inputs:
                got[:, h] = values[:, sensors.index(sensor), inputs.index(source)]
    return got, wanted


def feed_forward_action(
    feed_forward: FeedForward, parts: Parts, inputs: list[str], frequencies: np.ndarray, dead_time: float
) -> FeedForwardAction:
    """Commands and expected readings for measured torques, per N·m of a held torque; side bands left out."""
    columns = [feed_forward.measured.index(name) for name in inputs]
    names = [dyno.name for dyno in parts.dynamometers]
    rows = [feed_forward.outputs.index(f"{name} {what}") for what in ("torque", "speed") for name in names]
    sign = np.concatenate([parts.toward, np.ones(len(names))])
    # readings belong to samples, torques and commands are held after them: half a sample and more lies between
    hold = -np.expm1(-2j * np.pi * frequencies * feed_forward.sample_time) / (
        2j * np.pi * frequencies * feed_forward.sample_time
    )
    expected = sign[:, None] * feed_forward.response(frequencies)[:, rows][:, :, columns] / hold[:, None, None]
    step, late = feed_forward.sample_time, dead_time - feed_forward.delay * feed_forward.sample_time
    powers = [feed_forward.W[:, columns]]
    for _ in range(feed_forward.delay - 1):
        powers.append(feed_forward.A @ powers[-1])
    closed = feed_forward.A - feed_forward.B @ feed_forward.F
    commands = np.empty((len(frequencies), len(names), len(columns)), complex)
    for i, f in enumerate(frequencies):
        z = np.exp(2j * np.pi * f * step)
        # the prediction holds the torques of its moment: what it misses of those that came in since
        missed = sum(
            (power * (z**j - 1) for j, power in enumerate(reversed(powers[: feed_forward.delay]))),
            np.zeros_like(powers[0]),
        )
        lost = feed_forward.F @ missed * z**-feed_forward.delay
        state = np.linalg.solve(z * np.eye(len(closed)) - closed, feed_forward.W[:, columns] + feed_forward.B @ lost)
        commands[i] = (lost - feed_forward.F @ state) * np.exp(-2j * np.pi * f * late)
    return FeedForwardAction(commands, expected)
