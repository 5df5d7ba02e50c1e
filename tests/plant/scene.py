"""A system with its manoeuvres, noise and written values, and how large an effect in it must be."""

from __future__ import annotations

import zlib
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from plant.bench import Take, record
from plant.calibrate import Freedom, OutOfReach, find_size, freedom, heard, remainder, stacked, worst
from plant.excitation import Excitation, excite
from plant.hidden import KINDS, Hidden, Scales, known, places, scales
from plant.systems import SYSTEMS, Drive

COARSE = 1e-4  # s, inner step while sizes are sought
NOISE = {"low": 0.0003, "normal": 0.001, "high": 0.003}  # of each sensor's range


@dataclass
class Scene:
    """Everything drawn before an effect is sized; `written` are the model file's values, noise is in SI."""

    drive: Drive
    written: dict[str, float]
    noise: dict[str, float]
    scale: Scales
    dt: float
    excitation: Excitation
    holdout: Excitation


def set_scene(
    system: str, noise: str, seed: int, duration: float, rate: float, closed_loop: bool, moving: bool
) -> Scene:
    """Draw system, written values and both manoeuvres; the noise follows from each sensor's range without effects."""
    rng = np.random.default_rng([zlib.crc32(system.encode()), seed])
    drive, dt = SYSTEMS[system](rng), 1 / rate
    written = {
        name: value / (1 + rng.uniform(-0.7, 0.7) * drive.tolerance[name]) if name in drive.tolerance else value
        for name, value in drive.values.items()
    }
    manoeuvre, holdout = (
        excite(drive, rng, duration, dt, holdout=held, closed_loop=closed_loop, moving=moving, speed_noise=1e-3)
        for held in (False, True)
    )
    base = record(drive, [], manoeuvre, dt)
    level = {name: NOISE[noise] * float(np.ptp(value)) for name, value in base.readings.items()}
    return Scene(drive, written, level, scales(drive, base.motion, base.readings, level), dt, manoeuvre, holdout)


def scaled(scene: Scene, kind: str, at: str, draw: int) -> Callable[[float], dict[str, float]]:
    """The parameters of a kind at a place as a function of its size."""
    name = at if KINDS[kind].group == "values" else Hidden(kind, at).name
    return KINDS[kind].parameters(np.random.default_rng(draw), scene.drive, scene.scale, name)


def _left(scene: Scene, take: Take, free: Freedom) -> tuple[np.ndarray, np.ndarray]:
    """What one regression leaves (y, t) of the take beside the base model at the point of `free`, and its steps."""
    without = heard(scene.drive, take, free.point, scene.noise, scene.dt)
    return remainder(stacked(take.stepped, scene.noise) - without, free)


def _refit(scene: Scene, take: Take, free: Freedom, kept: set[str]) -> Freedom:
    """One Gauss-Newton step: the freedom round the point to which the regression leads."""
    point = free.moved(_left(scene, take, free)[1])
    return freedom(scene.drive, take, scene.noise, scene.dt, scene.written, kept, point)


def measured_worth(scene: Scene, effects: list[Hidden]) -> float:
    """What effects are worth in times the noise, worst sensor, after the best the base model can do."""
    take, kept = record(scene.drive, effects, scene.excitation, scene.dt), known(effects)
    free = freedom(scene.drive, take, scene.noise, scene.dt, scene.written, kept)
    for _ in range(3):
        free = _refit(scene, take, free, kept)
    return worst(_left(scene, take, free)[0])


def sized(scene: Scene, kind: str, at: str, target: float, rng: np.random.Generator) -> Hidden:
    """The effect at a place, so large that it is worth the target. Raises OutOfReach."""
    draw, largest = int(rng.integers(2**31)), KINDS[kind].largest
    parameters, kept = scaled(scene, kind, at, draw), known([Hidden(kind, at)])

    def take_at(s: float) -> Take:
        effects = [Hidden(kind, at, parameters(s))] if s else []
        return record(scene.drive, effects, scene.excitation, scene.dt, COARSE)

    free = freedom(scene.drive, take_at(0.0), scene.noise, scene.dt, scene.written, kept)

    def value_of(s: float) -> float:
        try:
            return worst(_left(scene, take_at(s), free)[0])
        except FloatingPointError:
            return np.inf

    s = find_size(value_of, target, largest)
    for _ in range(5):  # a large effect moves the fit, and under control the inputs: linearise again where they are
        free = _refit(scene, take_at(s), free, kept)
        if abs(value_of(s) / target - 1) < 0.04:
            break
        s = find_size(value_of, target, largest, s)
    return Hidden(kind, at, parameters(s), draw)


def first_that_fits(
    scene: Scene, kind: str, place: str, target: float, rng: np.random.Generator, taken: list[Hidden]
) -> Hidden:
    """The effect at the place asked for, or at one drawn among those that can carry this size. Raises OutOfReach."""
    why: list[str] = []
    for at in [place] if place else [str(one) for one in rng.permutation(places(scene.drive, kind))]:
        if any(at == other.at for other in taken):
            continue
        try:
            return sized(scene, kind, at, target, rng)
        except OutOfReach as reason:
            why.append(f"{at}: {reason}")
    raise OutOfReach(f"{kind} in {scene.drive.system}: {'; '.join(why) or 'no place'}")
