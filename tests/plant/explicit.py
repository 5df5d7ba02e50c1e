"""A recording with effects of stated sizes, where a test is about these and not about what they are worth."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from plant.bench import record
from plant.hidden import Hidden
from plant.scene import Scene, set_scene
from plant.sensing import add_noise
from plant.writing import model_text, recording_text


def write_recording(
    folder: Path, scene: Scene, hidden: Sequence[Hidden], sensors: Sequence[str] = (), seed: int = 0
) -> None:
    """Write model.toml and recording.csv of a scene with hidden effects; all sensors of it if none are named."""
    drive = scene.drive
    if sensors:
        drive.sensors = {name: drive.sensors[name] for name in sensors}
    take = record(drive, list(hidden), scene.excitation, scene.dt)
    noise = {name: scene.noise[name] for name in drive.sensors}
    noisy = add_noise(take.readings, noise, list(hidden), np.random.default_rng(seed))
    (folder / "model.toml").write_text(model_text(drive, scene.written, noise, set()))
    (folder / "recording.csv").write_text(recording_text(drive, take, noisy))


def scene_of(
    system: str, seed: int, duration: float, rate: float, change: Callable[[Scene], None] | None = None
) -> Scene:
    """A scene of a system in open loop, from rest, with normal noise."""
    scene = set_scene(system, "normal", seed, duration, rate, False, False)
    if change is not None:
        change(scene)
    return scene
