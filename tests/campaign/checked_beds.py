"""Beds with one or two defects each, through the check of their channels: what is named, measured, and invented.

``python -m tests.campaign.checked_beds [--beds 30] [--seed 1] [--out out/checked_beds]`` makes virtual beds of the
reference rig (their own equations in C), runs the check of the channels on each and holds what it says against the
truth. Started again, it goes on where it was stopped. Every bed is off by up to 4 % in inertias and stiffnesses, 12 %
in damping, 2 % in torque gains and 0.4 ms in dead times: within the tolerances of its case (5 %, 30 %, 3 %, 0.5 ms).
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parents[1]))  # the truth plant is imported as `plant`

import numpy as np
from plant.hidden import Hidden
from virtual_bed.bed import Actuator, Reader, VirtualBed, drawn, drive_of
from virtual_bed.reference_circle import CASE

from matching.bed.channels import channel_recording, check_channels, plan_channels
from matching.bed.excite import bed_inputs
from matching.bed.simulated_bed import FmuBed, bed_system
from matching.match.case import Case
from matching.match.case_file import load_case
from matching.match.exported import exported_controller
from matching.studies import append, rows
from modelling.recordings.read import read_recording
from modelling.recordings.recording import Recording

DEFECTS = ("late", "scale", "gain", "zero", "sign", "exchange", "play", "friction", "quantity", "none")
ZEROS = {"speed": 2.0, "torque": 20.0}  # rad/s, N·m
COVERED = 3.0  # standard uncertainties


def healthy(case: Case, rng: np.random.Generator, seed: int) -> VirtualBed:
    """A bed within its tolerances."""
    loop, drive = case.loop, drawn(drive_of(CASE.parent / "rig.toml"), 0.04, rng)
    readers = {sensor.name: Reader(noise=sensor.uncertainty or 0.0) for sensor in case.rig.sensors}
    actuators = {}
    for one in loop.dynamometers:
        readers[one.torque_sensor].lag = loop["torque_sensor_lag"]
        late = loop.command_delay() + rng.uniform(-4e-4, 4e-4)
        actuators[one.torque_input] = Actuator(late, loop["inverter_lag"], rng.uniform(0.98, 1.02))
    return VirtualBed(drive, [], actuators, readers, seed=seed)


def spoil(case: Case, bed: VirtualBed, kind: str, rng: np.random.Generator) -> dict[str, Any]:
    """Put a defect into a bed: its kind, the names of which one has to be named, and the true value."""
    kinds = {sensor.name: sensor.measures for sensor in case.rig.sensors}
    names = list(kinds)
    driven = {one.torque_input: one.name for one in case.loop.dynamometers}
    if kind == "late":
        part = str(rng.choice(list(driven)))
        bed.actuators[part].delay += rng.uniform(1e-3, 4e-3)
        true = bed.actuators[part].delay + case.loop["dead_time"] - case.loop.command_delay()
        return {"kind": kind, "named": [f"dynamometers.{driven[part]}.dead_time"], "value": true}
    if kind in ("scale", "gain"):
        factor = float(np.exp(rng.uniform(np.log(0.5), np.log(2)))) if kind == "scale" else float(rng.uniform(0.9, 1.1))
        while kind == "scale" and 0.8 < factor < 1.25:
            factor = float(np.exp(rng.uniform(np.log(0.5), np.log(2))))
        while kind == "gain" and 0.95 < factor < 1.05:
            factor = float(rng.uniform(0.9, 1.1))
        name = str(rng.choice([*names, *driven]))
        if name in driven:
            bed.actuators[name].factor = factor
            return {"kind": kind, "named": [name, f"dynamometers.{driven[name]}.torque_gain"], "value": factor}
        bed.readers[name].gain *= factor
        return {"kind": kind, "named": [name, f"sensors.{name}.gain"], "value": factor}
    if kind == "quantity":
        place = str(rng.choice([name for name in bed.drive.values if name.endswith((".J", ".stiffness"))]))
        factor = float(np.exp(rng.choice([-1, 1]) * rng.uniform(np.log(1.3), np.log(10))))
        bed.drive.values[place] *= factor
        return {"kind": kind, "named": [f"rig.{place}"], "value": bed.drive.values[place]}
    if kind == "play":
        place = str(rng.choice(["gear_mesh", "gear_output", "side_left", "side_right"]))
        gap = float(rng.uniform(0.002, 0.015))
        bed.effects.append(Hidden("backlash", f"shafts.{place}", {"gap": gap}))
        return {"kind": kind, "named": [f"shafts.{place}"], "value": gap}
    if kind == "friction":
        torque = float(rng.uniform(0.5, 3.0))
        bed.effects.append(Hidden("coulomb_friction", "inertias.motor", {"torque": torque}))
        return {"kind": kind, "named": ["inertias.motor.friction"], "value": torque}
    if kind == "exchange":
        same = [[a, b] for a in names for b in names if a < b and kinds[a] == kinds[b]]
        pair = same[rng.integers(len(same))]
        bed.wired = dict(zip(pair, pair[::-1], strict=True))
        return {"kind": kind, "named": pair, "all": True}
    if kind == "none":
        return {"kind": kind, "named": []}
    name = str(rng.choice(names))
    if kind == "sign":
        bed.readers[name].gain *= -1.0
        return {"kind": kind, "named": [name]}
    bed.readers[name].offset = float(rng.choice([-1, 1])) * ZEROS[kinds[name]]
    return {"kind": kind, "named": [name], "value": bed.readers[name].offset}


def work(case: Case, seed: int, number: int, folder: Path) -> dict[str, Any]:
    """Row of a bed: its defects, what was named, and how far values are off in standard uncertainties."""
    rng = np.random.default_rng([seed, number])
    bed = healthy(case, rng, number + 1)
    chosen = rng.choice(DEFECTS, 2 if rng.random() < 0.5 else 1, replace=False)
    kinds = ["none"] if "none" in chosen else [str(kind) for kind in chosen]
    defects = [spoil(case, bed, kind, rng) for kind in kinds]
    folder.mkdir(parents=True, exist_ok=True)
    path = bed.write(folder / "bed.fmu", case.loop["sample_time"])
    plan, made = plan_channels(case), exported_controller(case)
    began = time.process_time()

    def record(known: Mapping[str, tuple[str, float]]) -> tuple[Recording, str]:
        with FmuBed(path, bed_inputs(case), [sensor.name for sensor in case.rig.sensors]) as running:
            text, tripped = channel_recording(running, case, made.law, made.running(), plan, known)
        (folder / "recording.csv").write_text(text, encoding="utf-8")
        return read_recording(folder / "recording.csv", bed_system(case)), tripped

    found = check_channels(case, record)
    seconds = time.process_time() - began
    named = {one.channel for one in (*found.wrong, *found.open)} | {one.name for one in found.off}
    named |= {one.at for one in found.free_plays}
    friction = next((one for one in found.measured if one.name == "inertias.motor.friction"), None)
    if friction is not None and found.explained and friction.value > 5 * friction.uncertainty and friction.value > 0.2:
        named.add(friction.name)
    hits = [bool(set(one["named"]) & named) if not one.get("all") else set(one["named"]) <= named for one in defects
            if one["kind"] != "none"]  # fmt: skip
    allowed = {name for one in defects for name in one["named"]}
    return {
        "number": number, "defects": defects, "hits": hits, "invented": sorted(named - allowed),
        "sentence": found.sentence(), "plays": [one.to_dict() for one in found.free_plays], "tripped": found.tripped,
        "explained": found.explained, "seconds": seconds, "values": values(case, bed, found) if found.explained else [],
    }  # fmt: skip


def values(case: Case, bed: VirtualBed, found: Any) -> list[list[Any]]:
    """Name, measured value, true value, error in standard uncertainties of every quantity that is told."""
    true = {f"rig.{name}": value for name, value in bed.drive.values.items()}
    hold = case.loop["dead_time"] - case.loop.command_delay()
    for one in case.loop.dynamometers:
        own = bed.actuators[one.torque_input]
        true[f"dynamometers.{one.name}.torque_gain"] = own.factor
        true[f"dynamometers.{one.name}.dead_time"] = own.delay + hold
    told = [one for one in found.measured if one.told and one.name in true and not one.name.endswith(".damping")]
    return [[one.name, one.value, true[one.name], (one.value - true[one.name]) / one.uncertainty] for one in told]


def summary(beds: list[dict[str, Any]]) -> dict[str, Any]:
    """Figures over all beds."""
    defective = [bed for bed in beds if bed["hits"]]
    errors = [abs(row[3]) for bed in beds for row in bed["values"]]
    return {
        "beds": len(beds), "all_named": [sum(all(bed["hits"]) for bed in defective), len(defective)],
        "first_named": sum(any(bed["hits"]) for bed in defective),
        "missed": [(bed["number"], [one["kind"] for one in bed["defects"]], bed["hits"]) for bed in defective
                   if not all(bed["hits"])],
        "invented": [(bed["number"], [one["kind"] for one in bed["defects"]], bed["invented"]) for bed in beds
                     if bed["invented"]],
        "covered": [sum(error < COVERED for error in errors), len(errors)],
        "median_seconds": float(np.median([bed["seconds"] for bed in beds])),
        "largest_seconds": max(bed["seconds"] for bed in beds),
    }  # fmt: skip


def main() -> None:
    """Run what is not on record, and print the figures."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--beds", type=int, default=30)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--only", type=int, nargs="*", help="numbers of beds")
    parser.add_argument("--out", type=Path, default=Path("out/checked_beds"))
    asked = parser.parse_args()
    record, case = asked.out / "beds.jsonl", load_case(CASE)
    asked.out.mkdir(parents=True, exist_ok=True)
    done = {row["number"] for row in rows(record, {"number": int})}
    for number in asked.only or range(asked.beds):
        if number not in done:
            append(record, work(case, asked.seed, number, asked.out / str(number)))
    print(json.dumps(summary(list(rows(record, {"number": int}))), indent=1))


if __name__ == "__main__":
    main()
