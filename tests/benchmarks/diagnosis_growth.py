"""A diagnosis: time over the length of the recording, and the exponent of a power law fitted to it.

Times are processor times of one diagnosis, all threads and the compiler of
the models included, and what a clock on the wall says beside them. The recordings are made by the truth plant of the
tests, which shares no code with the models: a chain of inertias driven at both ends, with dry friction on an inertia in
its middle or free play in a shaft there. Long recordings begin as short ones; the
longest is ten inertias, twelve sensors, 60 s at 1 kHz.
"""

import resource
import sys
import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from matching.diagnosis.diagnose import diagnose
from matching.diagnosis.result import Diagnosis
from modelling.effects import EFFECTS
from modelling.model_file import from_dict
from modelling.recordings.recording import Recording
from modelling.system import System

sys.path.insert(0, str(Path(__file__).parents[1]))  # the truth plant is imported as `plant`

from plant.bench import record
from plant.excitation import excite
from plant.hidden import Hidden
from plant.systems import Drive

STEP = 1e-3  # s
PIECE = 7.5  # s of a manoeuvre, one after another
NOISE = 1e-3  # of a sensor's range
LENGTHS = (7.5, 15.0, 30.0, 60.0)


def chain(count: int, sensors: int) -> Drive:
    """``count`` inertias in a row, driven at both ends; speeds are measured first, then torques of some shafts."""
    rng = np.random.default_rng(count)
    parts = [f"part{i}" for i in range(count)]
    shafts = {f"shaft{i}": (parts[i], parts[i + 1]) for i in range(count - 1)}
    values = {}
    for name in parts:
        values |= {f"inertias.{name}.J": rng.uniform(0.3, 1.2), f"inertias.{name}.drag": rng.uniform(0.05, 0.3)}
    for name in shafts:
        stiffness, damping = rng.uniform(4e3, 1.2e4), rng.uniform(3, 10)
        values |= {f"shafts.{name}.stiffness": stiffness, f"shafts.{name}.damping": damping}
    measured = {f"speed_{name}": ("speed", name) for name in parts[:sensors]}
    twisted = np.linspace(0, count - 2, max(sensors - count, 0)).round().astype(int)
    measured |= {f"torque_shaft{i}": ("torque", f"shaft{i}") for i in twisted}
    inputs, torque = {"drive": parts[0], "brake": parts[-1]}, {"drive": 200.0, "brake": 120.0}
    return Drive("chain", f"Chain of {count} inertias", parts, shafts, inputs, measured, values, torque)


def hidden_in(drive: Drive, kind: str) -> Hidden:
    """What is hidden in the middle of a chain."""
    middle = len(drive.inertias) // 2
    if kind == "backlash":
        return Hidden(kind, f"shafts.shaft{middle - 1}", {"gap": 0.01})
    return Hidden("coulomb_friction", f"inertias.part{middle}", {"torque": 6.0})


def made(drive: Drive, hidden: Hidden, seconds: float) -> tuple[System, Recording]:
    """Model, its uncertain values a little off, and a recording of the plant."""
    rng = np.random.default_rng(1)
    written = {
        name: {"value": value * (1 + 0.5 * own * rng.uniform(-1, 1)), "tolerance": own}
        if (own := drive.tolerance.get(name))
        else value
        for name, value in drive.values.items()
    }
    pieces = [
        excite(drive, np.random.default_rng([2, i]), PIECE, STEP, holdout=False, closed_loop=False, moving=False,
               speed_noise=0.0)
        for i in range(int(np.ceil(seconds / PIECE)))
    ]  # fmt: skip
    whole = pieces[0]
    samples = round(seconds / STEP)
    for name in ("inputs", "reference", "feedback_noise"):
        setattr(whole, name, np.concatenate([getattr(piece, name) for piece in pieces])[:samples])
    take = record(drive, [hidden], whole, STEP, 1e-4)
    noise = {name: NOISE * float(np.ptp(own[: round(PIECE / STEP)])) for name, own in take.readings.items()}
    tables: dict[str, dict] = {"inertias": {}, "shafts": {}, "inputs": {}, "sensors": {}}
    for name, value in written.items():
        table, part, quantity = name.split(".")
        tables[table].setdefault(part, {})[quantity] = value
    for name, ends in drive.shafts.items():
        tables["shafts"][name]["between"] = list(ends)
    tables["inputs"] = {name: {"on": on} for name, on in drive.inputs.items()}
    tables["sensors"] = {
        name: {"measures": what, "of": of, "uncertainty": noise[name]} for name, (what, of) in drive.sensors.items()
    }
    channels = {name: take.inputs[:, j] for j, name in enumerate(drive.inputs)}
    for j, (name, own) in enumerate(take.readings.items()):
        channels[name] = own + noise[name] * np.random.default_rng([3, j]).standard_normal(len(own))
    return from_dict(tables), Recording(take.time, channels, (), "made by the plant")


def processor() -> float:
    """Processor time so far, children included, s."""
    every = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    return sum(own.ru_utime + own.ru_stime for own in every)


def timed(count: int, sensors: int, seconds: float, kind: str) -> float:
    """Prints a line; processor time of one diagnosis."""
    drive = chain(count, sensors)
    hidden = hidden_in(drive, kind)
    system, recording = made(drive, hidden, seconds)
    candidates = sum(len(own.places(system)) for own in EFFECTS.values())
    clock, began = time.perf_counter(), processor()
    found = diagnose(system, [recording])
    took, wall = processor() - began, time.perf_counter() - clock
    memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20
    print(
        f"{count:8d} {sensors:7d} {seconds:6g} s {candidates:10d} {took:8.1f} s {wall:8.1f} s {memory:5.1f} GB"
        f"  {judged(found, hidden)}",
        flush=True,
    )
    return took


def judged(found: Diagnosis, hidden: Hidden) -> str:
    """What was said, and whether kind, place and value are right."""
    words = [f"{own.kind} at {own.at} ({own.confidence:.2f})" for own in found.causes]
    first = found.causes[0] if found.causes else None
    if len(words) == 1 and first and (first.kind, first.at) == (hidden.kind, hidden.at):
        off = []
        for key, value in hidden.parameters.items():
            own = first.parameters[key]
            off.append(f"{key} {own.value:.5g} ± {own.standard_uncertainty:.2g} of {value:g}")
        return f"{found.verdict}, right: {words[0]}, {', '.join(off)}"
    return f"{found.verdict}, WRONG: {', '.join(words) or 'nothing'}; hidden is {hidden.kind} at {hidden.at}"


def exponent(over: Sequence[float], took: Sequence[float]) -> float:
    """Slope of log(time) over log(size), least squares."""
    return float(np.polyfit(np.log(over), np.log(took), 1)[0])


def main() -> None:
    print(
        f"{'inertias':>8} {'sensors':>7} {'length':>8} {'candidates':>10} {'processor':>10} {'wall':>10} memory  answer"
    )
    timed(3, 4, 2.0, "coulomb_friction")  # what is compiled once for all
    for kind in ("coulomb_friction", "backlash"):
        took = [timed(10, 12, seconds, kind) for seconds in LENGTHS]
        print(f"{kind}: time ~ length ^ {exponent(LENGTHS, took):.2f}", flush=True)


if __name__ == "__main__":
    main()
