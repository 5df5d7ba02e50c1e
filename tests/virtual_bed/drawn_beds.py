"""Beds drawn at random for commissioning: deviations, free play, friction, and in some of them one wrong channel.

``python -m tests.virtual_bed.drawn_beds [--beds 20] [--seed 1] [--out out/drawn_beds]`` takes each through the whole
circle and holds what it says against the truth; started again, it goes on where it was stopped.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parents[1]))  # the truth plant is imported as `plant`

import numpy as np
from independent.dynamic_stiffness import Chain, Judge
from plant.hidden import Hidden
from plant.systems import Drive

from matching.bed.commission import Circle, Commissioning, CommissionOrder
from matching.export import tuned_case
from matching.match.case import Case
from matching.match.case_file import load_case
from matching.match.exported import exported_controller
from matching.studies import append, rows
from modelling.controller.law import CHECK_SPEED_SHARE
from modelling.errors import InputError
from modelling.recordings.read import read_signals
from virtual_bed.bed import Actuator, Reader, VirtualBed, drawn, drive_of
from virtual_bed.drawn_rigs import LinearBed

REFERENCE = Path(__file__).parents[2] / "examples" / "road_to_rig" / "observer.toml"
WRONG = ("sign", "rpm", "degrees", "exchanged", "offset")
SPREAD, LARGEST_PLAY, LARGEST_FRICTION = 0.10, 0.02, 0.03  # relative; rad; of the rated torque
NOISE = {"speed": 0.08, "torque": 0.3}  # rad/s, N·m of sensors that state none
LARGEST_SHARE = 0.3  # of the largest torque of a manoeuvre: friction where that torque acts
OFFSETS = {"speed": 2.0, "torque": 20.0}  # rad/s, N·m


@dataclass
class DrawnBed:
    """A bed, what is wrong of its channels, and its free play (rad) and friction (N·m at the rotors)."""

    bed: VirtualBed | LinearBed
    wrong: str
    expected: frozenset[str]  # channels that are to be named
    play: float
    friction: float


def draw_bed(path: Path, rng: np.random.Generator, wrong: str = "", seed: int = 1) -> DrawnBed:
    """A bed of a case file, half of them with play in a shaft that has no flange, half of them with friction.

    Rigs with rigid gears or differentials have neither: they are stepped as linear ones.
    """
    case = load_case(path)
    rig_file = path.parent / tomllib.loads(path.read_text(encoding="utf-8"))["rig"]
    rig, drive = tomllib.loads(rig_file.read_text(encoding="utf-8")), drawn(drive_of(rig_file), SPREAD, rng)
    linear = "gears" in rig or "differentials" in rig
    rated, kinds = case.limits["dynamometer_torque"], {sensor.name: sensor.measures for sensor in case.rig.sensors}
    names, loop = list(kinds), case.loop
    others = [one.on for one in case.rig.inputs if one.name not in {d.torque_input for d in loop.dynamometers}]
    flanges = {drive.sensors[one.torque_sensor][1] for one in loop.dynamometers}
    inner = [name for name in drive.shafts if name not in flanges]
    geared = [name for name in inner if drive.values.get(f"shafts.{name}.ratio", 1.0) != 1.0]
    effects, play, friction = [], 0.0, 0.0
    if rng.random() < 0.5 and not linear:
        play = rng.uniform(0.0005, LARGEST_PLAY)
        effects.append(Hidden("backlash", f"shafts.{rng.choice(geared or inner)}", {"gap": play}))
    if rng.random() < 0.5 and not linear:
        turned = abs(drive.speed_ratio(others[0]))
        own = max(abs(one.amplitude) for one in case.manoeuvre.values())  # no drive has more friction than torque
        friction = min(rng.uniform(0, LARGEST_FRICTION) * rated, LARGEST_SHARE * own * turned)
        parameters = {"torque": friction / turned}
        effects.append(Hidden("coulomb_friction", f"inertias.{others[0]}", parameters))
    readers = {sensor.name: Reader(noise=sensor.uncertainty or NOISE[sensor.measures]) for sensor in case.rig.sensors}
    actuators = {}
    for one in loop.dynamometers:
        readers[one.torque_sensor].lag = loop["torque_sensor_lag"]
        late = loop.command_delay() + rng.uniform(-3e-4, 5e-4)
        actuators[one.torque_input] = Actuator(max(late, 0.0), loop["inverter_lag"], rng.uniform(0.95, 1.05))
    bed = VirtualBed(drive, effects, actuators, readers, seed=seed)
    fast = [name for name in names if kinds[name] == "speed"]
    name = str(rng.choice(fast if wrong in ("rpm", "degrees") else names))
    expected = frozenset([name] if wrong else [])
    if wrong == "exchanged":
        pair: tuple[str, ...] = ()
        while not pair or in_series(drive, pair):
            pair = tuple(map(str, rng.choice(names, 2, replace=False)))
        bed.wired, expected = dict(zip(pair, pair[::-1], strict=True)), frozenset(pair)
    elif wrong == "offset":
        readers[name].offset = float(rng.choice([-1, 1])) * OFFSETS[kinds[name]]
    elif wrong:
        readers[name].gain = {"sign": -1.0, "rpm": 60 / (2 * np.pi), "degrees": 180 / np.pi}[wrong]
    running = LinearBed(bed, rig, loop["sample_time"], rng) if linear else bed
    return DrawnBed(running, wrong, expected, play, friction)


def in_series(drive: Drive, pair: Sequence[str]) -> bool:
    """Whether two sensors measure torques of shafts in series, which answer alike."""
    ends = [drive.shafts[of] for what, of in (drive.sensors[name] for name in pair) if what == "torque"]
    if len(ends) < 2:
        return False
    return any(sum(middle in other for other in drive.shafts.values()) == 2 for middle in set(ends[0]) & set(ends[1]))


def largest_speed(case: Case, bed: VirtualBed | LinearBed, recording: Path) -> float:
    """Largest true speed of a dynamometer's rotor in a recording, rad/s, by what its channel reads."""
    largest = 0.0
    channel = {sensor: name for name, sensor in bed.wired.items()}
    for one in case.loop.dynamometers:
        own, name = bed.readers[one.speed_sensor], channel.get(one.speed_sensor, one.speed_sensor)
        read = read_signals(recording, {name}, None)[name]
        largest = max(largest, float(np.abs((read - own.offset) / (own.gain or np.inf)).max()))
    return largest


# --- The whole circle on each, held against the truth.

ROW = {"number": int}  # of the record


def true_values(case: Case, bed: VirtualBed) -> dict[str, float]:
    """Quantities of the bed as it is, named as those of ``[uncertainty]``."""
    values = {f"rig.{name}": value for name, value in bed.drive.values.items() if name in case.rig.parameters}
    for one in case.loop.dynamometers:
        values[f"dynamometers.{one.name}.torque_gain"] = bed.actuators[one.torque_input].factor
    return values


def true_error(case: Case, matched: Path, drawn_bed: DrawnBed) -> float:
    """Response error to measured torques of a controller on the bed as it is, by dynamic stiffness; play closed.

    Against the vehicle of the match, as the verification has it: that is what its interval is about. Every dynamometer
    has the dead time and the lags of its own, and the commands are divided by the calibration.
    """
    tuned = tuned_case(matched).tuned
    law, bed = exported_controller(tuned).law, drawn_bed.bed
    own = tuple(
        replace(
            one,
            dead_time=bed.actuators[one.torque_input].delay + case.loop["sample_time"] / 2,
            inverter_lag=bed.actuators[one.torque_input].lag,
            torque_sensor_lag=bed.readers[one.torque_sensor].lag,
        )
        for one in case.loop.dynamometers
    )
    values = true_values(case, bed)
    for before, after in zip(case.loop.dynamometers, tuned.loop.dynamometers, strict=True):
        values[f"dynamometers.{before.name}.torque_gain"] /= after.torque_gain
    judge = Judge(replace(case, loop=replace(case.loop, dynamometers=own)), law)
    return judge.against(values, Chain(tuned.vehicle))[0]


def work(path: Path, seed: int, number: int, folder: Path, order: CommissionOrder) -> dict[str, Any]:
    """Row of a bed: what was hidden, what the circle said, and whether its intervals hold."""
    rng, case = np.random.default_rng([seed, number]), load_case(path)
    bed = draw_bed(path, rng, WRONG[number // 4 % len(WRONG)] if number % 4 == 3 else "", number + 1)
    folder.mkdir(parents=True, exist_ok=True)
    fmu = bed.bed.write(folder / "bed.fmu", case.loop["sample_time"])
    row: dict[str, Any] = {
        "number": number, "wrong": bed.wrong, "expected": sorted(bed.expected), "play": bed.play,
        "friction": bed.friction,
    }  # fmt: skip
    began = time.process_time()
    try:
        result = Circle(folder / "circle", fmu, order, lambda step: print(number, step, flush=True)).run(path)
    except InputError as fault:
        return row | {"failed": str(fault), "seconds": time.process_time() - began}
    return row | {"seconds": time.process_time() - began} | judged(case, bed, folder, result)


def judged(case: Case, bed: DrawnBed, folder: Path, result: Commissioning) -> dict[str, Any]:
    """What the circle said of a bed, next to the truth."""
    channels = result.channels or {}
    named = sorted(one["channel"] for one in channels.get("wrong", []))
    recording, limit = folder / "circle" / "1_channels" / "recording.csv", case.limits["dynamometer_speed"]
    fast = largest_speed(case, bed.bed, recording) / (CHECK_SPEED_SHARE * limit) if recording.exists() else None
    rounds = []
    for one in result.rounds:
        verified = one.verification or {}
        found: dict[str, Any] = {"status": verified.get("status"), "sentence": verified.get("sentence")}
        causes = (one.identification or {}).get("causes", [])
        found["notes"] = list((one.identification or {}).get("notes", []))
        found["match"] = (one.match or {}).get("status")
        found["causes"] = [f"{cause['kind']} at {cause['at']}" for cause in causes]
        for error in verified.get("errors", []):
            if error["name"] == "measured" and error["error"] is not None:
                found |= {"error": error["error"], "interval": error["interval"]}
                found["true"] = true_error(case, folder / "circle" / f"{one.number}_match", bed)
                found["covered"] = error["interval"][0] <= found["true"] <= error["interval"][1]
        rounds.append(found)
    return {
        "status": result.status, "end": result.end, "named": named, "tripped": channels.get("tripped"),
        "channels": channels.get("right"), "share_of_speed": fast, "rounds": rounds,
        "play_named": any(cause == f"backlash at {at}" for one in rounds for cause in one["causes"]
                          for at in played(bed.bed)),
        "play_elsewhere": any("backlash" in cause and cause.split(" at ")[1] not in played(bed.bed)
                              for one in rounds for cause in one["causes"]),
    }  # fmt: skip


def played(bed: VirtualBed | LinearBed) -> set[str]:
    """Shafts with free play."""
    effects = bed.effects if isinstance(bed, VirtualBed) else []
    return {effect.at for effect in effects if effect.kind == "backlash"}


def summary(beds: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Figures over all beds."""
    wrong = [bed for bed in beds if bed["wrong"]]
    right = [bed for bed in beds if not bed["wrong"]]
    playing = [bed for bed in right if bed["play"]]
    covered = [one["covered"] for bed in right for one in bed.get("rounds", []) if "covered" in one]
    seconds = [bed["seconds"] for bed in right]
    return {
        "beds": len(beds), "failed": [(bed["number"], bed["failed"]) for bed in beds if "failed" in bed],
        "wrong_named": [sum(bed.get("named") == bed["expected"] for bed in wrong), len(wrong)],
        "right_named": [bed["number"] for bed in beds if set(bed.get("named", [])) - set(bed["expected"])],
        "largest_share_of_speed": max(bed.get("share_of_speed") or 0.0 for bed in beds),
        "play_named": [sum(bed.get("play_named", False) for bed in playing), len(playing)],
        "play_elsewhere": [bed["number"] for bed in right if bed.get("play_elsewhere")],
        "play_named_without": [bed["number"] for bed in right if not bed["play"] and bed.get("play_elsewhere")],
        "statuses": {name: sum(bed.get("status") == name for bed in right) for name in
                     ("as_predicted", "short", "undetermined", "unlike_model", "wrong_channel")},
        "covered": [sum(covered), len(covered)],
        "median_seconds": float(np.median(seconds)) if seconds else None,
        "largest_seconds": max(seconds, default=None),
    }  # fmt: skip


def main() -> None:
    """Draw, commission, print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--beds", type=int, default=20)
    parser.add_argument("--numbers", type=int, nargs="*", help="only these of them")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--case", type=Path, default=REFERENCE)
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--out", type=Path, default=Path("out/drawn_beds"))
    given = parser.parse_args()
    given.out.mkdir(parents=True, exist_ok=True)
    record = given.out / f"beds_{given.seed}.jsonl"
    for number in given.numbers or range(given.beds):
        if number not in {row["number"] for row in rows(record, ROW)}:
            folder, order = given.out / f"{given.seed}_{number}", CommissionOrder(rounds=given.rounds)
            append(record, work(given.case, given.seed, number, folder, order))
    print(json.dumps(summary(list(rows(record, ROW))), indent=1))


if __name__ == "__main__":
    main()
