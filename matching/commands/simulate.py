"""`rigmatch simulate`: run a model on recorded inputs."""

import argparse
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import numpy as np

HELP = """Simulates a model on the inputs of a recording, all its effects included. Writes simulated.csv (time and every
sensor of the model, SI) and simulated.svg. Where the recording has sensors, the root mean square of the difference is
given for each, in the sensor's SI unit and as a share of its range. The steps of the integration are chosen so that no
reading is wrong by more than --tolerance of its range."""

SMALLEST_TOLERANCE = 1e-9  # below, rounding decides
STARTS = ("recorded", "rest", "steady")
EXAMPLES = (
    "rigmatch simulate examples/from_recordings/rig.toml examples/from_recordings/bed.csv --out out/simulated",
    "rigmatch simulate examples/from_recordings/rig.toml examples/from_recordings/bed.csv --start steady "
    "--out out/from_steady_motion",
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Model, recording, start, place to write to."""
    parser.add_argument("model", metavar="MODEL", help="model file (TOML)")
    parser.add_argument("recording", metavar="RECORDING", help="recording (CSV, MDF, .mat or Parquet)")
    parser.add_argument("--channels", metavar="FILE", help="what the channels are called in the recording (TOML)")
    parser.add_argument("--out", metavar="DIR", required=True, help="directory to write to")
    parser.add_argument(
        "--start",
        choices=STARTS,
        default="recorded",
        help="start state: estimated from the first quarter second of the recorded sensors (default; at rest if there "
        "are none), at rest, or in steady motion under the first inputs",
    )
    parser.add_argument(
        "--tolerance",
        type=float,
        metavar="SHARE",
        help="largest error of the integration, as a share of each reading's range (default: 1e-4)",
    )


def run(arguments: argparse.Namespace) -> dict[str, Any]:
    """Simulate and write files; the result object holds what was run, and the misfit by sensor.

    Raises
    ------
    InputError
        One line that names option, file or key.
    """
    from matching.report.common.style import image
    from matching.report.simulation.view import simulation_figure
    from modelling.common.errors import InputError
    from modelling.equations.compiled import compiled
    from modelling.measurement.channels import read_channels
    from modelling.measurement.read import read_recording
    from modelling.measurement.write import csv_text
    from modelling.model.files import load
    from modelling.simulation.recorded_start import recorded_start
    from modelling.simulation.simulate import simulate, with_stick_speed
    from modelling.simulation.speed_units import check_speed_units
    from modelling.simulation.step_control import TOLERANCE
    from modelling.writing.output import write_all

    tolerance = TOLERANCE if arguments.tolerance is None else arguments.tolerance
    if not SMALLEST_TOLERANCE <= tolerance < 1:
        raise InputError(
            "--tolerance", f"{tolerance:g} is not possible", f"give a share of the range, {SMALLEST_TOLERANCE:g} to 1"
        )
    system = load(arguments.model)
    channels = read_channels(arguments.channels) if arguments.channels else None
    recording = read_recording(arguments.recording, system, channels)
    recording.check_continuous()
    model = compiled(system)
    check_speed_units(model, recording)
    inputs, start = recording.inputs(system), arguments.start
    if start == "recorded":
        p = with_stick_speed(model, recording.time, inputs, model.p0)
        start = recorded_start(model, recording, p)
    done = simulate(model, recording.time, inputs, start=start, tolerance=tolerance)
    misfit = {name: _misfit(done[name], recording[name], done.units[name]) for name in recording.sensors(system)}
    files: dict[str, str | bytes] = {"simulated.csv": csv_text(done.time, done.readings, done.units)}
    if done.readings:
        measured = {name: recording[name] for name in done.readings if name in recording.channels}
        files["simulated.svg"] = image(simulation_figure(done, measured))
    write_all(arguments.out, files)
    return {
        "model": arguments.model,
        "recording": arguments.recording,
        "samples": len(done.time),
        "duration": float(done.time[-1] - done.time[0]),
        "start": {"from": arguments.start, "states": dict(zip(done.state_names, done.states[0].tolist(), strict=True))},
        "steps_per_second": done.steps_per_second,
        "tolerance": tolerance,
        "integration_error": done.integration_error,
        "misfit": misfit,
        "notes": [*recording.notes, *_inaccurate(done.integration_error, tolerance)],
        "files": sorted(files),
    }


def _inaccurate(errors: dict[str, float], tolerance: float) -> list[str]:
    """A note on every reading whose estimated error is beyond the tolerance."""
    return [
        f"{name}: the steps leave an estimated error of {error:.2g} of its range; the motion may be chaotic"
        for name, error in errors.items()
        if error > tolerance
    ]


def _misfit(simulated: "np.ndarray", recorded: "np.ndarray", unit: str) -> dict[str, Any]:
    """Root mean square of a sensor's difference (t,), and its share of the recorded range; None where that is 0."""
    import numpy as np

    there = np.isfinite(recorded)
    rms, spread = float(np.sqrt(np.mean((simulated - recorded)[there] ** 2))), float(np.ptp(recorded[there]))
    return {"rms": rms, "unit": unit, "of_range": rms / spread if spread else None}


def summary(result: dict[str, Any]) -> str:
    """The misfit by sensor."""
    lines = [
        f"{result['samples']} samples over {result['duration']:g} s simulated from {result['start']['from']} start"
    ]
    for name, error in result["misfit"].items():
        share = f" ({error['of_range']:.2%} of its range)" if error["of_range"] is not None else ""
        lines.append(f"  {name}: root mean square of the difference {error['rms']:.4g} {error['unit']}{share}")
    lines += [f"note: {note}" for note in result["notes"]]
    return "\n".join([*lines, f"written: {', '.join(result['files'])}"])
