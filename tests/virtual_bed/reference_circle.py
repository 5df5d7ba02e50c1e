"""The circle on a virtual bed of the reference case, everything of it off, and what it gained as a figure.

``python -m tests.virtual_bed.reference_circle [--out out/reference_circle]``: started again, it goes on where it was
stopped. The bed: every inertia and stiffness off by up to 5 %, damping by up to 15 %, dead time 0.2 ms longer, torque
gains 1.020 and 0.985, sensors with the noise of the reference's Tab. 1.
"""

import argparse
import json
import sys
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

sys.path.insert(0, str(Path(__file__).parents[1]))  # the truth plant is imported as `plant`

import numpy as np
from matplotlib.figure import Figure

from matching.bed.channels import channel_recording, plan_channels
from matching.bed.commission import Circle, CommissionOrder, plan_speed
from matching.bed.excite import bed_inputs
from matching.bed.proof import plan_proof
from matching.bed.simulated_bed import FmuBed, FmuController, bed_system, proof_recording
from matching.bed.verify import judge, read_recordings
from matching.export import tuned_case
from matching.match.case import Case
from matching.match.case_file import load_case
from matching.match.exported import exported_controller
from matching.report import common as style
from modelling.controller.law import SPEED_HOLD, Answer
from modelling.recordings.read import read_recording
from modelling.simulation.simulate import simulate
from virtual_bed.bed import Actuator, Reader, VirtualBed, drawn, drive_of

CASE = Path(__file__).parents[2] / "examples" / "road_to_rig" / "observer.toml"
SPREAD, LATER, GAINS = 0.05, 2e-4, (1.020, 0.985)  # relative; s; of the two dynamometers
ROUNDS = CommissionOrder(rounds=2)
LEAST = 0.01  # lower end of the axis of the response error


class HeldSpeed:
    """The controller, which is asked for speed hold in place of emulation."""

    def __init__(self, controller: FmuController):
        self._controller = controller

    def step(
        self, readings: np.ndarray, known: np.ndarray, mode: int, hold: np.ndarray, life: int, trigger: bool = False
    ) -> Answer:
        """As :meth:`FmuController.step`."""
        return self._controller.step(readings, known, SPEED_HOLD, hold, life)


def reference_bed(case: Case) -> VirtualBed:
    """The bed, the same every time."""
    loop = case.loop
    drive = drawn(drive_of(CASE.parent / "rig.toml"), SPREAD, np.random.default_rng(1))
    readers = {sensor.name: Reader(noise=sensor.uncertainty or 0.0) for sensor in case.rig.sensors}
    actuators = {}
    for dynamometer, gain in zip(loop.dynamometers, GAINS, strict=True):
        readers[dynamometer.torque_sensor].lag = loop["torque_sensor_lag"]
        delay = loop.command_delay() + LATER
        actuators[dynamometer.torque_input] = Actuator(delay, loop["inverter_lag"], gain)
    return VirtualBed(drive, [], actuators, readers)


def measure(out: Path) -> list[dict[str, Any]]:
    """Response error and R_XiL of the bed under speed hold, and with the controllers of the first and second match."""
    case = load_case(CASE)
    out.mkdir(parents=True, exist_ok=True)
    bed = reference_bed(case).write(out / "bed.fmu", case.loop["sample_time"])
    result = Circle(out / "circle", bed, ROUNDS, lambda step: print(step, flush=True)).run(CASE)
    last = tuned_case(out / "circle" / f"{len(result.rounds)}_match").tuned
    rows = [{"what": "without emulation", **_figures(_without_emulation(out, bed, last))}]
    for entry in result.rounds:
        judged = entry.against_last_vehicle or entry.verification
        rows.append({"what": f"match {entry.number}", **_figures(judged)})
    (out / "rows.json").write_text(json.dumps(rows, indent=1), encoding="utf-8")
    return rows


def _without_emulation(out: Path, path: Path, case: Case) -> dict[str, Any]:
    """The bed under a slow speed hold, judged like the others."""
    first, speed = tuned_case(out / "circle" / "1_match").tuned, plan_speed(case, ROUNDS)
    law, fmu = exported_controller(first).law, out / "circle" / "1_export" / "controller.fmu"
    driven = [dynamometer.torque_input for dynamometer in case.loop.dynamometers]
    others = [part.name for part in case.rig.inputs if part.name not in driven]
    recording = out / "without_emulation.csv"
    with (
        FmuBed(path, [*driven, *others], [sensor.name for sensor in case.rig.sensors]) as bed,
        FmuController(fmu, law) as controller,
    ):
        text = proof_recording(bed, first, law, HeldSpeed(controller), plan_proof(first, speed), speed)  # type: ignore[arg-type]
    recording.write_text(text, encoding="utf-8")
    return judge(case, read_recordings([recording], case), of_this_controller=False).to_dict()


def _figures(judged: dict[str, Any]) -> dict[str, Any]:
    (fidelity,), functions = judged["fidelity"], judged["functions"]
    kinds = {error["name"]: error for error in judged["errors"]}
    measured = kinds.get("measured", judged["errors"][0])
    return {
        "R_XiL": fidelity["R_XiL"], "R_XiL_uncertainty": fidelity["standard_uncertainty"],
        "error": measured["error"], "error_uncertainty": measured["standard_uncertainty"],
        "functions": {one["name"]: [one["error"], one["standard_uncertainty"]] for one in functions if "error" in one},
    }  # fmt: skip


def picture(rows: list[dict[str, Any]]) -> Figure:
    """R_XiL and response error as measured on the bed, k = 2."""
    names = [row["what"] for row in rows]
    with style.styled():
        drawn_figure = style.figure(7.2, 2.7)
        left, right = drawn_figure.subplots(1, 2)
        colours = [style.RIG, style.MATCHED, style.MATCHED]
        for place, row in enumerate(rows):
            look = {"color": colours[min(place, 2)], "marker": "o", "markersize": 6, "capsize": 4}
            left.errorbar(place, 100 * row["R_XiL"], yerr=200 * row["R_XiL_uncertainty"], **look)
            left.annotate(f"{100 * row['R_XiL']:.2f}", (place, 100 * row["R_XiL"]), (0, 9), textcoords="offset points",
                          ha="center", fontsize=8)  # fmt: skip
            if row["error"] is None:
                continue
            above = row["error"] + 2 * row["error_uncertainty"]
            shown = row["error"] > 2 * row["error_uncertainty"]
            if shown:
                right.errorbar(place, row["error"], yerr=2 * row["error_uncertainty"], **look)
            else:
                right.plot([place, place], [LEAST, above], color=look["color"], linewidth=6, alpha=0.4)
            text = f"{row['error']:.3f}" if shown else f"below {above:.3f}"
            right.annotate(text, (place, above), (0, 6), textcoords="offset points",
                           ha="center", fontsize=8)  # fmt: skip
        left.set_ylabel("measured R_XiL in %")
        right.set_ylabel("measured response error")
        right.set_yscale("log")
        for axes in (left, right):
            axes.set_xticks(range(len(names)), names)
            axes.set_xlim(-0.5, len(names) - 0.5)
            axes.margins(y=0.15)
        right.set_ylim(LEAST, 6)
        right.set_yticks([0.01, 0.1, 1], ["0.01", "0.1", "1"])
    return drawn_figure


def channels_picture() -> Figure:
    """The check of the channels on the bed with one flange reversed: torques, and three readings next to the model."""
    case, bed = load_case(CASE), reference_bed(load_case(CASE))
    bed.readers["flange_left_torque"].gain = -1.0
    plan, made = plan_channels(case), exported_controller(case)
    with TemporaryDirectory() as folder:
        path, recorded = bed.write(Path(folder) / "bed.fmu", case.loop["sample_time"]), Path(folder) / "recording.csv"
        with FmuBed(path, bed_inputs(case), [sensor.name for sensor in case.rig.sensors]) as running:
            recorded.write_text(channel_recording(running, case, made.law, made.running(), plan)[0], encoding="utf-8")
        recording = read_recording(recorded, bed_system(case))
    shown = ("rotor_left_speed", "motor_speed", "flange_left_torque")
    sent = {name: recording[name] for name in plan.inputs}
    model = simulate(bed_system(case), recording.time, sent, sensors=shown)
    with style.styled():
        drawn_figure = style.figure(7.2, 6.0)
        panels = drawn_figure.subplots(1 + len(shown), 1, sharex=True)
        for j, name in enumerate(plan.inputs):
            panels[0].plot(recording.time, sent[name], linewidth=1.0, label=style.spaced(name), color=f"C{j}")
        panels[0].set_ylabel("torque in N·m")
        panels[0].legend(loc="upper right", ncols=3)
        for axes, name in zip(panels[1:], shown, strict=True):
            axes.plot(recording.time, recording[name], color=style.RIG, linewidth=0.8, label="read")
            axes.plot(recording.time, model[name], "--", color=style.MATCHED, linewidth=0.8, label="model")
            unit = "rad/s" if name.endswith("speed") else "N·m"
            axes.set_ylabel(f"{style.spaced(name)}\nin {unit}")
        panels[1].legend(loc="upper right", ncols=2)
        panels[-1].set_xlabel("time in s")
    return drawn_figure


def main() -> None:
    """Run, print and draw."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=Path("out/reference_circle"))
    out = parser.parse_args().out
    rows = measure(out)
    print(json.dumps(rows, indent=1))
    picture(rows).savefig(out / "on_the_bed.png", dpi=110)


if __name__ == "__main__":
    main()
