"""Six beds of the reference case that each differ in one way, as FMUs of an independent simulation.

``python -m tests.virtual_bed.six_beds [--names play rpm] [--out out/six_beds]`` takes them through the whole circle.
"""

import argparse
import json
import sys
import time
from dataclasses import replace
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))  # the truth plant is imported as `plant`

import numpy as np
from plant.hidden import Hidden

from matching.bed.commission import Circle, CommissionOrder
from matching.match.case import Case
from matching.match.case_file import load_case
from virtual_bed.bed import Actuator, Reader, VirtualBed, drawn, drive_of
from virtual_bed.drawn_beds import NOISE, REFERENCE, DrawnBed, judged

PLAY = Hidden("backlash", "shafts.gear_output", {"gap": 0.003})
FRICTION = 15.0  # N·m at the motor
RPM = 30 / np.pi


def bed_of(case: Case, name: str) -> DrawnBed:
    """``off``, ``friction``, ``play``, ``play_and_friction``, ``rpm`` or ``reversed``."""
    spread = {"off": 0.05, "play_and_friction": 0.03}.get(name, 0.0)
    drive = drawn(drive_of(REFERENCE.parent / "rig.toml"), spread, np.random.default_rng(11))
    loop, off = case.loop, name == "off"
    readers = {sensor.name: Reader(noise=sensor.uncertainty or NOISE[sensor.measures]) for sensor in case.rig.sensors}
    actuators = {}
    for one, gain in zip(loop.dynamometers, (0.98, 1.02), strict=True):
        readers[one.torque_sensor].lag = loop["torque_sensor_lag"]
        actuators[one.torque_input] = Actuator(
            loop.command_delay() + 3.5e-4 * off, loop["inverter_lag"] * (1 + 0.15 * off), gain if off else 1.0
        )
    effects = [PLAY] if name.startswith("play") else []
    if "friction" in name:
        effects.append(Hidden("coulomb_friction", "inertias.motor", {"torque": FRICTION}))
    wrong = {"rpm": ("motor_speed", RPM), "reversed": ("flange_left_torque", -1.0)}.get(name)
    if wrong:
        readers[wrong[0]] = replace(readers[wrong[0]], gain=wrong[1])
    expected = frozenset([wrong[0]] if wrong else [])
    bed = VirtualBed(drive, effects, actuators, readers, seed=11)
    return DrawnBed(
        bed, name if wrong else "", expected, 0.003 * name.startswith("play"), FRICTION * ("friction" in name)
    )


NAMES = ("off", "friction", "play", "play_and_friction", "rpm", "reversed")


def commissioned(case: Case, name: str, folder: Path, order: CommissionOrder | None = None) -> dict[str, object]:
    """What the circle said of a bed, next to the truth; ``seconds`` of processor time."""
    bed = bed_of(case, name)
    folder.mkdir(parents=True, exist_ok=True)
    fmu, began = bed.bed.write(folder / "bed.fmu", case.loop["sample_time"]), time.process_time()
    result = Circle(folder / "circle", fmu, order or CommissionOrder()).run(REFERENCE)
    found = {"name": name, "expected": sorted(bed.expected), "seconds": time.process_time() - began}
    return found | judged(case, bed, folder, result) | {"text": str(result)}


def main() -> None:
    """Commission, print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--names", nargs="*", default=NAMES)
    parser.add_argument("--out", type=Path, default=Path("out/six_beds"))
    given = parser.parse_args()
    case = load_case(REFERENCE)
    for name in given.names:
        found = commissioned(case, name, given.out / name)
        print(found.pop("text"))
        print(json.dumps(found), flush=True)


if __name__ == "__main__":
    main()
