"""Fits the plant's own equations to a recording, nonlinear, all at once: a check on plant and sizes."""

import tomllib
from pathlib import Path
from typing import Any

import numpy as np
from scipy.optimize import least_squares

from plant.bench import replay
from plant.hidden import Hidden
from plant.systems import Drive


def read_drive(path: Path) -> tuple[Drive, dict[str, float]]:
    model = tomllib.loads(path.read_text())
    values, tolerance = {}, {}
    for table, quantities in (("inertias", ("J", "drag")), ("shafts", ("stiffness", "damping"))):
        for part, entry in model[table].items():
            for quantity in quantities:
                given, name = entry[quantity], f"{table}.{part}.{quantity}"
                values[name] = given["value"] if isinstance(given, dict) else given
                if isinstance(given, dict):
                    tolerance[name] = given["tolerance"]
    values |= {f"shafts.{name}.ratio": one["ratio"] for name, one in model["shafts"].items() if "ratio" in one}
    drive = Drive(
        "practice",
        model["title"],
        list(model["inertias"]),
        {name: tuple(one["between"]) for name, one in model["shafts"].items()},
        {name: one["on"] for name, one in model["inputs"].items()},
        {name: (one["measures"], one["of"]) for name, one in model["sensors"].items()},
        values,
        {},
    )
    drive.tolerance = tolerance
    return drive, {name: one["uncertainty"] for name, one in model["sensors"].items()}


def remaining(
    folder: Path, answer: dict[str, Any], free: tuple[str, ...] = (), length: int = 16000
) -> tuple[dict[str, float], dict[str, float]]:
    """Fit base values, start state and the effect's own parameters; root mean square left by sensor, in noise."""
    drive, noise = read_drive(folder / "model.toml")
    data = np.loadtxt(folder / "recording.csv", delimiter=",", skiprows=1)[:length]
    count = 1 + len(drive.inputs)
    measured = {
        name: data[:, count + i] * (np.pi / 30 if what == "speed" else 1.0)
        for i, (name, (what, _)) in enumerate(drive.sensors.items())
    }
    n, uncertain = len(drive.inertias), list(drive.tolerance)
    told = {"phase": 0.0} | answer["parameters"]
    guess = np.concatenate([np.ones(len(uncertain)), np.zeros(2 * n - 1), np.ones(len(free))])

    def residuals(x: np.ndarray, stretch: int) -> np.ndarray:
        values = drive.values | {name: drive.values[name] * f for name, f in zip(uncertain, x, strict=False)}
        parameters = told | {
            name: told.get(name, 1.0) * f for name, f in zip(free, x[len(guess) - len(free) :], strict=True)
        }
        effects = [] if answer["kind"] == "none" else [Hidden(answer["kind"], answer["at"], parameters)]
        if answer["kind"] == "wrong_parameter":
            values, effects = values | {answer["at"]: parameters["value"]}, []
        start = np.concatenate([[0.0], x[len(uncertain) : len(uncertain) + 2 * n - 1] * 0.01])
        model = replay(drive, data[:stretch, 1:count], start, 1e-3, values, effects)
        return np.concatenate([(model[name] - measured[name][:stretch]) / noise[name] for name in noise])

    width = np.array([drive.tolerance[name] for name in uncertain])
    lower = np.concatenate([1 - width, np.full(2 * n - 1, -np.inf), np.full(len(free), 0.5)])
    upper = np.concatenate([1 + width, np.full(2 * n - 1, np.inf), np.full(len(free), 2.0)])
    settings = {"diff_step": 1e-4, "x_scale": "jac", "bounds": (lower, upper), "ftol": 1e-7}
    x = guess
    for share in (0.2, 0.5, 1.0):  # a longer stretch each time: hard effects make one long fit stop short
        solved = least_squares(residuals, x, args=(round(share * len(data)),), max_nfev=12, **settings)
        x = solved.x
    parts = np.split(solved.fun, len(noise))
    found = dict(zip((*uncertain, *range(2 * n - 1), *free), x, strict=True))
    return {name: float(np.sqrt(np.mean(part**2))) for name, part in zip(noise, parts, strict=True)}, found
