"""One case: a system with something hidden in it, its model file, its recordings and the answer."""

from __future__ import annotations

import zlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from plant.bench import record
from plant.calibrate import OutOfReach
from plant.hidden import KINDS, SPOKEN, Hidden
from plant.rivals import alike, separations
from plant.scene import Scene, first_that_fits, set_scene
from plant.sensing import add_noise
from plant.systems import SYSTEMS, Drive
from plant.writing import model_text, recording_text

SIZES = {"plain": 30.0, "subtle": 3.0}
BACKGROUND_WORTH = 3.0  # times the noise


@dataclass
class Case:
    """Texts of the files, and the answer.

    The answer has `kind`, `at`, `parameters` of the first cause (kind `none` when nothing is hidden), all `causes`,
    `verdict`, whether the cause is `outside` the vocabulary, whether it `differs` between the recordings (then both are
    to be fitted), `base` (the value the plant had for every base quantity) and how the case was made.
    """

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
    background: Sequence[str] = (),
    stated_noise: float = 1.0,
) -> Case:
    """Make a case with kinds (or (kind, place) pairs) hidden in it; a kind without place gets one by seed.

    `size` is plain (30), subtle (3) or a number: what each effect is worth in times the noise in the worst sensor.
    `missing` leaves so many sensors out of the recording, though they stand in the model file. With `rivals` every
    cause of the answer tells which others the recording cannot part from it (`equivalent` places of the same kind,
    `equivalent_causes` of all kinds). Kinds of the `background` are in the recording too, each worth
    `BACKGROUND_WORTH` times the noise, and not in the answer: a model error that nobody asks for. The model file states
    `stated_noise` times the noise.
    Raises ValueError for an unknown name, OutOfReach when no place can carry an effect of that size.
    """
    wanted = [effects] if isinstance(effects, str) else list(effects)
    target = SIZES[size] if isinstance(size, str) else float(size)
    scene = set_scene(system, noise, seed, duration, rate, closed_loop, moving)
    rng = np.random.default_rng([7, zlib.crc32(repr((system, wanted, size, noise)).encode()), seed])
    hidden: list[Hidden] = []
    for one in wanted:
        kind, place = (one, "") if isinstance(one, str) else one
        if kind not in KINDS:
            raise ValueError(f"unknown kind {kind!r}")
        hidden.append(first_that_fits(scene, kind, place, target, rng, hidden))
    behind: list[Hidden] = []
    for kind in background:
        behind.append(first_that_fits(scene, kind, "", BACKGROUND_WORTH, rng, [*hidden, *behind]))
    watched = {name for e in hidden if e.at.startswith("sensors.") for name in e.members}
    spare = [name for name in scene.drive.sensors if name not in watched]
    left_out = [str(name) for name in rng.permutation(spare)[:missing]]
    told = {"system": system, "size": size, "noise": noise, "seed": seed, "closed_loop": closed_loop}
    answer = _answer(scene, hidden, left_out, rivals) | told | {"moving": moving, "missing": left_out}
    answer |= {"background": [(one.kind, one.at) for one in behind], "stated_noise": stated_noise}
    return Case(*_texts(scene, [*hidden, *behind], left_out, rng, stated_noise), answer)


def _texts(
    scene: Scene, hidden: list[Hidden], left_out: list[str], rng: np.random.Generator, stated_noise: float
) -> tuple[str, str, str]:
    known = {e.at for e in hidden if e.kind == "wrong_parameter"}
    written = scene.written | {name: scene.drive.values[name] for name in known}
    recordings = []
    for number, excitation in enumerate((scene.excitation, scene.holdout), 1):
        take = record(scene.drive, [e.in_recording(number) for e in hidden], excitation, scene.dt)
        noisy = add_noise(take.readings, scene.noise, hidden, rng)
        kept = {name: value for name, value in noisy.items() if name not in left_out}
        recordings.append(recording_text(scene.drive, take, kept))
    stated = {name: stated_noise * value for name, value in scene.noise.items()}
    return model_text(scene.drive, written, stated, known), recordings[0], recordings[1]


def in_reach(system: str, make: Callable[[str], Case]) -> Case:
    """The case of a system; where it is out of reach, that of the first other one where it is not."""
    why = ""
    for name in (system, *(other for other in SYSTEMS if other != system)):
        try:
            return make(name)
        except OutOfReach as reason:
            why = str(reason)
    raise OutOfReach(why)


def _spoken(drive: Drive, effect: Hidden, angle: np.ndarray) -> dict[str, Any]:
    """Kind, place and parameters as the specification names them; a ripple's phase is told for angle 0 at the start."""
    parameters = dict(effect.parameters)
    if effect.kind in ("torque_ripple", "geared_ripple"):
        turned = parameters["phase"] + parameters["order"] * angle[drive.inertias.index(effect.members[-1])]
        parameters["phase"] = float(np.angle(np.exp(1j * turned)))
    return {"kind": SPOKEN.get(effect.kind, effect.kind), "at": effect.at, "parameters": parameters}


def _answer(scene: Scene, hidden: list[Hidden], left_out: list[str], rivals: bool) -> dict[str, Any]:
    drive = scene.drive
    outside = any(not KINDS[e.kind].inside for e in hidden)
    verdict = "unexplained" if outside else "explained" if hidden else "adequate"
    causes = []
    if hidden:
        take = record(drive, hidden, scene.excitation, scene.dt)
        heard = replace(scene, noise={name: u for name, u in scene.noise.items() if name not in left_out})
        for e in hidden:
            cause = _spoken(drive, e, take.start[: len(drive.inertias)])
            if rivals and KINDS[e.kind].inside:
                found = separations(heard, e, [other for other in hidden if other is not e], take)
                same = alike(e, found)
                cause |= {"separations": found, "equivalent_causes": same}
                cause["equivalent"] = [one["at"] for one in same if one["kind"] == cause["kind"]]
            causes.append(cause)
    first = causes[0] if causes else {"kind": "none", "at": "", "parameters": {}}
    base = drive.values | {e.at: e.parameters["value"] for e in hidden if e.kind == "wrong_parameter"}
    differs = any(e.kind == "recording_friction" for e in hidden)
    return {**first, "differs": differs, "causes": causes, "outside": outside, "verdict": verdict, "base": base}
