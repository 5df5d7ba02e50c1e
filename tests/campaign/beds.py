"""The campaign of beds: small beds drawn, from the first model to the verified match, held against the truth.

``python -m tests.campaign.beds [--beds 60] [--first 6] [--seed 1] [--out out/campaign_beds]``; started again, it
goes on where it was stopped, within a bed as well.
"""

import argparse
import sys
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parents[1]))  # the truth plant is imported as `plant`

import numpy as np

from matching.bed.commission import Circle, CommissionOrder, plan_speed
from matching.bed.excite import ExcitationOrder
from matching.bed.proof import plan_proof
from matching.bed.simulated_bed import FmuBed, FmuController, proof_recording, with_faults
from matching.bed.verify import judge, read_recordings
from matching.export import tuned_case
from matching.match.box import Box
from matching.match.case import Case
from matching.match.case_file import case_files, load_case
from matching.match.exported import exported_controller
from matching.studies import append, rows
from modelling.bed.vehicle import cut
from modelling.errors import InputError
from modelling.recordings.read import read_signals
from modelling.system import Effect, Quantity
from tests.campaign.beds_score import report
from tests.campaign.drawn_bed import DrawnBed, draw_bed, write_case

ROW = {"number": int}  # of the record
ORDER = CommissionOrder(rounds=3, excitation=ExcitationOrder(duration=8.0, beds=4))
STILL_UNKNOWN = 0.002  # of the box of the first model: what a match with the true values counts with
GAVE_UP = 10.0  # change that stands for a run that the controller ended
OF_SENSORS = {"sensor_delay": "delay", "sensor_gain": "factor"}  # what a linear model holds of the hidden effects
MATTERS = 0.05  # relative rms change of a compared sensor's signal: an effect that changes more has to be named


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--beds", type=int, default=60)
    parser.add_argument("--first", type=int, help="only so many of them")
    parser.add_argument("--numbers", type=int, nargs="*", help="only these of them")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--out", type=Path, default=Path("out/campaign_beds"))
    given = parser.parse_args()
    record = given.out / f"beds_{given.seed}.jsonl"
    given.out.mkdir(parents=True, exist_ok=True)
    for number in given.numbers or range(min(given.beds, given.first or given.beds)):
        if number not in {row["number"] for row in rows(record, ROW)}:
            append(record, work(given.seed, number, given.out / f"{given.seed}_{number}"))
    report(list(rows(record, ROW)), given.out)


def work(seed: int, number: int, folder: Path) -> dict[str, Any]:
    """A bed's row: errors of every round against its true vehicle, what was hidden and named."""
    began = time.process_time()
    path = write_case(folder / "model")
    drawn = draw_bed(seed, number, folder / "model")
    bed = drawn.bed.write(folder / "bed.fmu")
    hidden = [dict(vars(one)) for one in drawn.hidden]
    row: dict[str, Any] = {"number": number, "hidden": hidden}
    try:
        result = Circle(folder / "circle", bed, ORDER).run(path)
        truth = truth_case(load_case(path), drawn)
        (folder / "true_model").mkdir(exist_ok=True)
        for name, text in case_files(truth).items():
            (folder / "true_model" / name).write_text(text, encoding="utf-8")
        Circle(folder / "true", bed, replace(ORDER, rounds=1)).run(folder / "true_model" / "case.toml")
    except InputError as fault:
        return row | {"failed": str(fault)}
    known = tuned_case(folder / "true" / "1_match").tuned
    recordings = [folder / "circle" / f"{one.number}_verify" / "recording.csv" for one in result.rounds]
    errors = [measured(known, one) for one in (*recordings, folder / "true" / "1_verify" / "recording.csv")]
    known_of_bed = [one.identification for one in result.rounds if one.identification is not None]
    causes = [cause for one in known_of_bed for cause in one["causes"]]
    first = tuned_case(folder / "circle" / "1_match").tuned
    for one, stated in zip(drawn.hidden, hidden, strict=True):
        stated["named"] = any(cause["kind"] == one.kind and one.at in cause["at"] for cause in causes)
        stated["change"] = change(first, drawn, one, folder, recordings[0])
        stated["matters"] = stated["change"] > MATTERS
    return row | {
        "status": result.status, "end": result.end, "best_round": result.best_round,
        "rounds": errors[:-1], "true": errors[-1], "causes": [f"{one['kind']} at {one['at']}" for one in causes],
        "torque_gain": drawn.gain, "limits_used": max(limits_used(first, one) for one in recordings),
        "gains_found": [one["torque_gains"] for one in known_of_bed],
        "processor_time": time.process_time() - began,
    }  # fmt: skip


def truth_case(case: Case, drawn: DrawnBed) -> Case:
    """The first model with the bed's true values and sensors, what is hidden aside; next to nothing is uncertain."""
    values = {name: value for name, value in drawn.bed.drive.values.items() if name in case.rig.parameters}
    shared = {name: value for name, value in values.items() if name in case.vehicle.parameters}
    faults = [
        Effect(one.kind, one.at, ((key, Quantity(one.size)),))
        for one in drawn.hidden
        for key in (OF_SENSORS.get(one.kind),)
        if key is not None
    ]
    rig, vehicle = (
        with_faults(case.rig.with_values(values), faults),
        with_faults(case.vehicle.with_values(shared), faults),
    )
    dynamometers = tuple(replace(one, torque_gain=drawn.gain) for one in case.loop.dynamometers)
    loop = replace(case.loop.with_values(drawn.loop), dynamometers=dynamometers)
    true = {f"rig.{name}": value for name, value in values.items()}
    true |= {f"loop.{name}": value for name, value in drawn.loop.items()}
    box = Box(tuple(
        replace(one, value=true.get(one.name, one.value), half_width=STILL_UNKNOWN / 0.1 * one.half_width)
        for one in case.uncertainty.uncertain
    ))  # fmt: skip
    return replace(case, rig=rig, vehicle=vehicle, residual_vehicle=cut(vehicle, rig), loop=loop, uncertainty=box)


def measured(known: Case, recording: Path) -> dict[str, float | None]:
    """Response error of a recording against the true vehicle, its standard uncertainty, and R_XiL."""
    found = judge(known, read_recordings([recording], known), of_this_controller=False)
    error = found.errors[0].to_dict()
    return {"error": error["error"], "standard_uncertainty": error["standard_uncertainty"],
            "R_XiL": found.fidelity[0].total}  # fmt: skip


def change(case: Case, drawn: DrawnBed, one: Any, folder: Path, recording: Path) -> float:
    """Largest relative rms change of a compared sensor where the first controller runs on the bed without an effect."""
    speed, names = plan_speed(case, ORDER), list(dict.fromkeys(pair.sensor for pair in case.compared))
    law, fmu = exported_controller(case).law, folder / "circle" / "1_export" / "controller.fmu"
    path, told = drawn.without(one).write(folder / f"without_{one.kind}.fmu"), [s.name for s in case.rig.sensors]
    with FmuBed(path, ["dyno", "motor_torque"], told) as bed, FmuController(fmu, law) as controller:
        try:
            text = proof_recording(bed, case, law, controller, plan_proof(case, speed), speed)
        except InputError:
            return GAVE_UP
    other = folder / f"without_{one.kind}.csv"
    other.write_text(text, encoding="utf-8")
    pair = [read_signals(place, set(names), None) for place in (recording, other)]
    return max(
        float(np.std(pair[0][name] - pair[1][name]) / np.std(pair[1][name] - np.mean(pair[1][name]))) for name in names
    )


def limits_used(case: Case, recording: Path) -> float:
    """Largest speed of a rotor over its limit; commands are cut at theirs by the controller."""
    rotor = case.loop.dynamometers[0].speed_sensor
    return float(np.abs(read_signals(recording, {rotor}, None)[rotor]).max() / case.limits["dynamometer_speed"])


if __name__ == "__main__":
    main()
