"""One case: a system with something hidden in it, its model file, its recordings and the answer."""

from __future__ import annotations

import zlib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from plant.bench import Take, record, replay
from plant.calibrate import OutOfReach, find_size, freedom, stacked, worth
from plant.excitation import excite
from plant.hidden import KINDS, SPOKEN, Hidden, Scales, places, scales
from plant.rivals import INSEPARABLE, SAME_PLACE, separations
from plant.sensing import add_noise
from plant.systems import SYSTEMS, Drive
from plant.writing import model_text, recording_text

SIZES = {"plain": 30.0, "subtle": 3.0}
COARSE = 1e-4  # s, inner step while sizes are sought
NOISE = {"low": 0.0003, "normal": 0.001, "high": 0.003}  # of each sensor's range


@dataclass
class Case:
    """Texts of the files and what was hidden. `truth` maps every base quantity to the value the plant had."""

    model: str
    recording: str
    holdout: str
    answer: dict[str, Any]

    def write(self, folder: Path | str) -> Path:
        """Write model.toml, recording.csv, holdout.csv; returns the folder."""
        folder = Path(folder)
        folder.mkdir(parents=True, exist_ok=True)
        (folder / "model.toml").write_text(self.model)
        (folder / "recording.csv").write_text(self.recording)
        (folder / "holdout.csv").write_text(self.holdout)
        return folder


@dataclass
class _Scene:
    """Everything drawn before an effect is sized."""

    drive: Drive
    written: dict[str, float]
    noise: dict[str, float]
    scale: Scales
    dt: float
    excitation: Any
    holdout: Any


def _scene(system: str, noise: str, seed: int, duration: float, rate: float, closed_loop: bool, moving: bool) -> _Scene:
    rng = np.random.default_rng([zlib.crc32(system.encode()), seed])
    drive, dt = SYSTEMS[system](rng), 1 / rate
    written = {
        name: value / (1 + rng.uniform(-0.7, 0.7) * drive.tolerance[name]) if name in drive.tolerance else value
        for name, value in drive.values.items()
    }
    speed_noise = 1e-3
    made = [
        excite(drive, rng, duration, dt, holdout=h, closed_loop=closed_loop, moving=moving, speed_noise=speed_noise)
        for h in (False, True)
    ]
    base = record(drive, [], made[0], dt)
    level = {name: NOISE[noise] * float(np.ptp(value)) for name, value in base.readings.items()}
    cut = base.motion
    return _Scene(drive, written, level, scales(drive, cut, base.readings, level), dt, *made)


def _difference(scene: _Scene, take: Take) -> np.ndarray:
    without = replay(scene.drive, take.inputs, take.start, scene.dt)
    return stacked(take.stepped, scene.noise) - stacked(without, scene.noise)


def measured_worth(scene: _Scene, effects: list[Hidden]) -> float:
    """What effects are worth in times the noise, worst sensor, after the best the base model can do."""
    take = record(scene.drive, effects, scene.excitation, scene.dt)
    fixed = next((e.at for e in effects if e.kind == "wrong_parameter"), "")
    free = freedom(scene.drive, take, scene.noise, scene.dt, scene.written, fixed)
    return worth(_difference(scene, take), free)


def _sized(scene: _Scene, kind: str, at: str, target: float, rng: np.random.Generator) -> Hidden:
    """The effect at a place, so large that it is worth the target. Raises OutOfReach."""
    entry = KINDS[kind]
    name = at if entry.group == "values" else at.split(".")[1]
    draw = int(rng.integers(2**31))
    parameters = entry.parameters(np.random.default_rng(draw), scene.drive, scene.scale, name)
    take = record(scene.drive, [], scene.excitation, scene.dt, COARSE)
    fixed = at if kind == "wrong_parameter" else ""
    free = freedom(scene.drive, take, scene.noise, scene.dt, scene.written, fixed)

    def value_of(s: float) -> float:
        try:
            heard = record(scene.drive, [Hidden(kind, at, parameters(s))], scene.excitation, scene.dt, COARSE)
        except FloatingPointError:
            return np.inf
        return worth(_difference(scene, heard), free)

    s = find_size(value_of, target, entry.largest)
    for _ in range(4 if scene.excitation.controllers else 0):  # the recorded input, hence the freedom, changes with s
        heard = record(scene.drive, [Hidden(kind, at, parameters(s))], scene.excitation, scene.dt, COARSE)
        free = freedom(scene.drive, heard, scene.noise, scene.dt, scene.written, fixed)
        if abs(worth(_difference(scene, heard), free) / target - 1) < 0.04:
            break
        s = find_size(value_of, target, entry.largest, s)
    return Hidden(kind, at, parameters(s), draw)


def make_case(
    system: str,
    effects: Sequence[str | tuple[str, str]] | str = (),
    size: str | float = "plain",
    noise: str = "normal",
    seed: int = 0,
    duration: float = 16.0,
    rate: float = 1000.0,
    *,
    closed_loop: bool = False,
    moving: bool = False,
    missing: int = 0,
    rivals: bool = False,
) -> Case:
    """Make a case with kinds (or (kind, place) pairs) hidden in it; a kind without place gets one by seed.

    `size` is plain (30), subtle (3) or a number: what each effect is worth in times the noise in the worst sensor.
    `missing` leaves so many sensors out of the recording, though they stand in the model file. With `rivals` the answer
    to a single effect tells which other causes the recording cannot part from it (`equivalent` places of the same
    kind, `equivalent_causes` of all kinds).
    Raises ValueError for an unknown name, OutOfReach when no place can carry an effect of that size.
    """
    wanted = [effects] if isinstance(effects, str) else list(effects)
    target = SIZES[size] if isinstance(size, str) else float(size)
    scene = _scene(system, noise, seed, duration, rate, closed_loop, moving)
    rng = np.random.default_rng([7, zlib.crc32(repr((system, wanted, size, noise)).encode()), seed])
    hidden: list[Hidden] = []
    for one in wanted:
        kind, place = (one, "") if isinstance(one, str) else one
        if kind not in KINDS:
            raise ValueError(f"unknown kind {kind!r}")
        hidden.append(_first_that_fits(scene, kind, place, target, rng, hidden))
    return _finish(scene, hidden, {"system": system, "size": size, "noise": noise, "seed": seed}, missing, rivals, rng)


def _first_that_fits(
    scene: _Scene, kind: str, place: str, target: float, rng: np.random.Generator, taken: list[Hidden]
) -> Hidden:
    options = [place] if place else list(rng.permutation(places(scene.drive, kind)))
    why: list[str] = []
    for at in options:
        if any(at == other.at for other in taken):
            continue
        try:
            return _sized(scene, kind, str(at), target, rng)
        except OutOfReach as reason:
            why.append(f"{at}: {reason}")
    raise OutOfReach(f"{kind} in {scene.drive.system}: {'; '.join(why) or 'no place'}")


def _finish(
    scene: _Scene, hidden: list[Hidden], told: dict[str, Any], missing: int, rivals: bool, rng: np.random.Generator
) -> Case:
    drive = scene.drive
    known = {e.at for e in hidden if e.kind == "wrong_parameter"}
    written = scene.written | {name: drive.values[name] for name in known}
    watched = {e.name for e in hidden if e.at.startswith("sensors.")}
    spare = [name for name in drive.sensors if name not in watched]
    left_out = [str(name) for name in rng.permutation(spare)[:missing]]
    model = model_text(drive, written, scene.noise, known)
    texts, angle = [], np.zeros(len(drive.inertias))
    for k, excitation in enumerate((scene.excitation, scene.holdout)):
        take = record(drive, hidden, excitation, scene.dt)
        noisy = add_noise(take.readings, scene.noise, hidden, rng)
        texts.append(recording_text(drive, take, {n: v for n, v in noisy.items() if n not in left_out}))
        if k == 0:
            angle = take.start[: len(drive.inertias)]
    answer = (
        _answer(drive, hidden, angle)
        | told
        | {
            "closed_loop": bool(scene.excitation.controllers),
            "missing": left_out,
            "base": drive.values | {e.at: e.parameters["value"] for e in hidden if e.at in known},
        }
    )
    if rivals and len(hidden) == 1 and KINDS[hidden[0].kind].inside:
        heard = {name: value for name, value in scene.noise.items() if name not in left_out}
        scene.noise = heard
        answer["separations"] = separations(scene, hidden[0], record(drive, hidden, scene.excitation, scene.dt))
        alike = [
            one
            for one in answer["separations"]
            if one["chi_square"] < INSEPARABLE or (one["kind"] == answer["kind"] and one["mean_square"] < SAME_PLACE)
        ]
        answer["equivalent_causes"] = [{"kind": one["kind"], "at": one["at"]} for one in alike]
        answer["equivalent"] = [one["at"] for one in alike if one["kind"] == answer["kind"]]
    return Case(model, texts[0], texts[1], answer)


def _spoken(drive: Drive, effect: Hidden, angle: np.ndarray) -> dict[str, Any]:
    """Kind, place and parameters as the specification names them; a ripple's phase is told for angle 0 at the start."""
    parameters = dict(effect.parameters)
    if effect.kind == "torque_ripple":
        turned = parameters["phase"] + parameters["order"] * angle[drive.inertias.index(effect.name)]
        parameters["phase"] = float(np.angle(np.exp(1j * turned)))
    return {"kind": SPOKEN.get(effect.kind, effect.kind), "at": effect.at, "parameters": parameters}


def _answer(drive: Drive, hidden: list[Hidden], angle: np.ndarray) -> dict[str, Any]:
    causes = [_spoken(drive, e, angle) for e in hidden]
    first = causes[0] if causes else {"kind": "none", "at": "", "parameters": {}}
    outside = any(not KINDS[e.kind].inside for e in hidden)
    verdict = "unexplained" if outside else "explained" if hidden else "adequate"
    return {**first, "causes": causes, "outside": outside, "verdict": verdict}
