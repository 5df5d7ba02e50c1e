"""What seeds of the fuzzer are made of: a model, one with every effect, a short recording."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import tomli_w

from modelling.effects import EFFECTS
from modelling.effects.effect import place_in_file
from modelling.model_file import from_dict

ROOT = Path(__file__).resolve().parents[2]
FOUND = Path(__file__).parent / "found"
RECORDINGS = Path(__file__).parent / "recordings"  # the drive below as asammdf, SciPy, h5py and pyarrow write it
MODEL = """title = "two discs"
[inertias.motor]
J = {value = 0.05, lower = 0.01, upper = 0.1}
[inertias.load]
J = "0.2 kg*m^2"
drag = 0.01
[shafts.link]
between = ["motor", "load"]
stiffness = 500
damping = 0.3
[inputs.torque]
on = "motor"
[sensors.speed]
measures = "speed"
of = "motor"
uncertainty = 0.1
[sensors.link_torque]
measures = "torque"
of = "link"
"""


@dataclass(frozen=True)
class Seed:
    """An input that the program answers, and the files that it names."""

    target: str
    name: str
    content: bytes
    beside: dict[str, bytes] = field(default_factory=dict)


def recording(names: tuple[str, ...] = ("time [s]", "torque [N*m]", "speed [rad/s]", "link_torque [N*m]")) -> bytes:
    """A few dozen samples of a drive, CSV."""
    t = np.arange(60) / 100
    columns = (t, 5 * np.sin(9 * t), 3 * np.cos(7 * t), 4 * np.sin(8 * t))
    rows = [",".join(f"{value:.6g}" for value in row) for row in np.stack(columns, axis=1)]
    return "\n".join([",".join(names), *rows, ""]).encode()


def every_effect() -> bytes:
    """A chain with one shaft, input, sensor or inertia for each kind of effect."""
    data: dict = {"title": "all effects", "inertias": {"i0": {"J": 1.0}}, "shafts": {}, "inputs": {}, "sensors": {}}
    for n in range(len(EFFECTS)):
        data["inertias"][f"i{n + 1}"] = {"J": 1.0}
        data["shafts"][f"s{n}"] = {"between": [f"i{n}", f"i{n + 1}"], "stiffness": 100.0, "damping": 1.0}
        data["inputs"][f"u{n}"] = {"on": f"i{n}"}
        data["sensors"][f"y{n}"] = {"measures": "angle" if n % 2 else "speed", "of": f"i{n}"}
    base = from_dict(data)
    data["effects"] = []
    for n, (kind, law) in enumerate(EFFECTS.items()):
        places = law.places(base) or law.shared_places(base)
        values = {
            key: min(max(0.5, parameter.lower), parameter.upper)
            for key, parameter in law.parameters.items()
            if not parameter.optional
        }
        at = place_in_file(places[n % len(places)])
        if law.follows:  # acted on, followed
            at = [f"inertias.i{n}", f"inertias.i{n + 1}"]
        if "twist" in law.arrays:
            at, values = f"shafts.s{n}", {"twist": [-0.1, 0.0, 0.1], "torque": [-1.0, 0.0, 2.0]}
        elif law.pedal:
            values = {"speed": [0.0, 100.0], "pedal": [0.0, 1.0], "torque": [[10.0, 60.0], [-10.0, 50.0]]}
        elif law.arrays:
            values = {key: [0.5, 0.25] for key in law.arrays}
        data["effects"].append({"kind": kind, "at": at} | values)
    return tomli_w.dumps(data).encode()
