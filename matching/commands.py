"""What each command does beyond its function in :mod:`matching.api`: files, progress, a few lines for the terminal.

``COMMANDS`` lists them in the order of work. Names, defaults and help of arguments come from the function.
"""

from __future__ import annotations

import argparse
import inspect
import shlex
import sys
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from matching import api
from matching.arguments import called, completed
from matching.dry_run import computing, is_dry
from matching.saved import SavedResult
from modelling import display
from modelling.errors import InputError
from modelling.toml import read_toml

if TYPE_CHECKING:
    import numpy as np

    from matching.match.case import Case
    from modelling.modal.result import Modes
    from modelling.system import System

Arguments = argparse.Namespace


# --- What commands share: the function is called, its result written.


def run_function(arguments: Arguments) -> dict[str, Any]:
    """Call the command's function, on as many processes as are asked for; write its result."""
    return written(called_with_pool(arguments), arguments)


def run_in_gears(arguments: Arguments) -> dict[str, Any]:
    """:func:`run_function` in every gear of the model's gearboxes: the first gear in the folder, others in its own."""
    system = api.load(arguments.model)
    if not system.gearboxes:
        return run_function(arguments)

    def in_gear(gear: dict[str, int], folder: str, more: dict[str, Any]) -> dict[str, Any]:
        own = argparse.Namespace(**vars(arguments) | {"out": str(Path(arguments.out, folder))})
        return written(called_with_pool(own, model=system.in_gear(gear)), own, {"gear": _gear_words(gear), **more})

    first, *others = system.gears_of_gearboxes
    gears = [in_gear(gear, _gear_folder(gear), {}) for gear in others]
    return in_gear(first, "", {"gears": gears})


def _gear_words(gear: Mapping[str, int]) -> str:
    return ", ".join(
        f"{name} in gear {number}" if number else f"{name} on its converter" for name, number in gear.items()
    )


def _gear_folder(gear: Mapping[str, int]) -> str:
    return "gear_" + "_".join(str(number) for number in gear.values())


def called_with_pool(arguments: Arguments, **more: Any) -> Any:
    """The result of a command's function; ``more`` are given as they are."""
    from matching.worker_pool import executor_of

    function, command = COMMANDS[arguments.command].function, arguments.command
    takes = inspect.signature(function).parameters
    if "executor" in takes and arguments.workers and arguments.scheduler:
        raise InputError("--workers", "does not go with --scheduler", "name one of them")
    if is_dry():
        return called(function, arguments, **more)
    with ExitStack() as stack:
        if "executor" in takes:
            more["executor"] = stack.enter_context(executor_of(arguments.workers, arguments.scheduler))
            more["record"] = Path(arguments.out) / f"{command}.partial.jsonl"
        return called(function, arguments, **more)


def written(
    result: Any, arguments: Arguments, more: Mapping[str, Any] | None = None, copies: Mapping[str, Any] | None = None
) -> dict[str, Any]:
    """The content of a result's file, with more entries, after it and its other files were written where asked."""
    from modelling.display import files
    from modelling.writing import write_results

    if arguments.out is None:
        return {**result.to_dict(), **(more or {}), "files": []}
    content = write_results(arguments.out, *files(result, str(arguments.out), made_of(arguments, copies), more))
    (Path(arguments.out) / f"{arguments.command}.partial.jsonl").unlink(missing_ok=True)
    return content


def made_of(arguments: Arguments, copies: Mapping[str, Any] | None = None) -> Any:
    """What a command reads: its first file with those that it names, channel file and recordings (or their copies)."""
    from matching.channel_names import SEVERAL
    from matching.report.page import made_from, with_recordings

    named = vars(arguments)
    file = Path(next(named[key] for key in ("case", "model", "budget") if named.get(key)))
    made = made_from(file / "case.toml" if file.is_dir() else file, named.get("seed"), ("vehicle", "rig"))
    several = [name for key in ("recordings", "holdout") for name in named.get(key) or ()]
    paths = [path for each in several for path in ([each] if Path(each).exists() else each.split(SEVERAL))]
    if named.get("channels"):
        paths.insert(0, arguments.channels)
    return with_recordings(made, ((path, (copies or {}).get(path, path)) for path in paths))


def told(content: dict[str, Any], file: str = "", arguments: Arguments | None = None) -> str:
    """What a terminal is told of a result, by the view of its file: the one that was written, or its name.

    With the command's ``arguments`` the next commands are told as its page has them: with its files and its folder.
    """
    from matching.report import RESULTS, view_of
    from matching.report.page import in_terminal

    file = next((name for name in content.get("files", ()) if name in RESULTS), file)
    if not file:
        return ""
    made = () if arguments is None or arguments.out is None else (str(arguments.out), made_of(arguments))
    return in_terminal(view_of(file).report(content, *made))


# --- Begin, and look


def run_new(arguments: Arguments) -> dict[str, Any]:
    """Write the starter case."""
    written = called(api.new, arguments)
    names = [path.relative_to(arguments.directory).as_posix() for path in written]
    return {"directory": arguments.directory, "files": sorted(names)}


def new_summary(result: dict[str, Any]) -> str:
    """What to do next."""
    here, files = result["directory"], [name for name in result["files"] if "/" not in name]
    next_one = f"rigmatch match {here}/case.toml --out {here}/out"
    return f"{here}: {', '.join(files)}, and schemas/ for your editor\nnext: {next_one}"


def show_arguments(parser: argparse.ArgumentParser) -> None:
    """The model that a channel file is written for."""
    parser.add_argument("--model", metavar="MODEL", help="of a recording: write a channel file for this model")


def run_show(arguments: Arguments) -> dict[str, Any]:
    """Draw and write, or list the channels of a recording."""
    from modelling.recordings.readers import READERS

    if Path(arguments.file).suffix.lower() in READERS:
        return _listed(arguments)
    if arguments.model:
        raise InputError("--model", f"{arguments.file} is no recording", f"one ends in {', '.join(READERS)}")
    return _drawn(arguments)


def _listed(arguments: Arguments) -> dict[str, Any]:
    from matching.channel_names import channel_list
    from modelling.escape import file_name
    from modelling.writing import write_all

    listed = channel_list(arguments.file, api.load(arguments.model) if arguments.model else None)
    channels = listed["channels"]
    most = max(row["samples"] for row in channels)
    computing(lambda: {arguments.file: f"a recording: {len(channels)} channels of up to {most} samples"})
    files = []
    if arguments.model:
        name = f"{file_name(Path(arguments.file).stem)}_channels.toml"
        files = write_all(arguments.out, {name: listed["channel_file"]})
    following = ""
    if files:
        words = ["diagnose", arguments.model, arguments.file, "--channels", str(Path(arguments.out, *files))]
        following = f"rigmatch {shlex.join(words)} --out out/diagnosis"
    return {"file": arguments.file, **listed, "files": files, "next": following}


def _drawn(arguments: Arguments) -> dict[str, Any]:
    from matching.match.case_file import is_case
    from matching.report.common import image
    from modelling.writing import write_all

    shown: Any = (api.load_case if is_case(read_toml(arguments.file)) else api.load)(arguments.file)
    systems = {"vehicle": shown.vehicle, "rig": shown.rig} if hasattr(shown, "rig") else {"model": shown}
    drawn = api.show(shown)
    files = write_all(arguments.out, {f"drivetrain.{kind}": image(drawn, kind) for kind in ("svg", "png")})
    counts = {
        role: {"title": system.title, "inertias": len(system.inertias), "shafts": len(system.shafts)}
        for role, system in systems.items()
    }
    return {"file": arguments.file, "drawn": counts, "files": files}


def show_summary(result: dict[str, Any]) -> str:
    """What was drawn or listed, and what was written."""
    from matching.report.page import aligned
    from modelling.display import counted

    written = [f"written: {', '.join(result['files'])}"] if result["files"] else []
    if "channels" in result:
        rows = [{head: _cell(value) for head, value in row.items()} for row in result["channels"]]
        notes = [f"note: {note}" for note in result["notes"]]
        parts = [aligned(rows), *notes, *([result["channel_file"].rstrip()] if result["channel_file"] else [])]
        if result["next"]:
            written.append(f"next, after you have read and corrected it: {result['next']}")
        return "\n".join([*parts, *written])

    lines = [
        f"{role}: {counted(counts['inertias'], 'inertia')}, {counted(counts['shafts'], 'shaft')}"
        + (f" ({counts['title']})" if counts["title"] else "")
        for role, counts in result["drawn"].items()
    ]
    return "\n".join([*lines, *written])


def _cell(value: str | float | None) -> str:
    return "-" if value is None or value == "" else f"{value:.6g}" if isinstance(value, float) else str(value)


def explore_arguments(parser: argparse.ArgumentParser) -> None:
    """Whether a browser is opened."""
    parser.add_argument("--no-browser", action="store_true", help="print the address and open no browser")


def run_explore(arguments: Arguments) -> dict[str, Any]:
    """Serve the page until it is interrupted; the result object says where it was."""
    say("preparing the page …")
    explorer = api.explore(
        *arguments.files, out=arguments.out, port=arguments.port, browser=not arguments.no_browser
    )  # fmt: skip
    say(f"{explorer.address}\nCtrl-C ends it")
    explorer.wait()
    return {"address": explorer.address}


# --- Understand a model


def modes_arguments(parser: argparse.ArgumentParser) -> None:
    """Reduced values, what changes would do, the folder."""
    parser.add_argument(
        "--reduced", action="store_true", help="also give values reduced to the model's reference shaft"
    )
    parser.add_argument(
        "--change", metavar="NAME=VALUE", action="append", default=[],
        help="what a new value does to the frequencies: first-order prediction (Eq. 8) next to the exact solution; "
        'e.g. --change "inertias.rotor_left.J=1.8 kg*m^2"; repeatable',
    )  # fmt: skip
    completed(parser, "change", lambda given: [f"{name}=" for name in parameters_of_model(given.model)])


def run_modes(arguments: Arguments) -> dict[str, Any]:
    """Find the modes, with a gearbox gear by gear, and write files; the result is the content of ``modes.json``."""
    from modelling.writing import write_results

    system = api.load(arguments.model)
    gears = system.gears_of_gearboxes
    results, files = [], dict[str, str | bytes]()
    for gear in gears or [{}]:
        result, drawn = _modes_in_gear(arguments, system, gear)
        results.append({"gear": _gear_words(gear), **result} if gear else result)
        folder = f"{_gear_folder(gear)}/" if len(results) > 1 else ""
        files |= {f"{folder}{name}": content for name, content in drawn.items()}
    first, *others = results
    return write_results(arguments.out, "modes.json", first | ({"gears": others} if others else {}), files)


def _modes_in_gear(
    arguments: Arguments, system: System, gear: Mapping[str, int]
) -> tuple[dict[str, Any], dict[str, str | bytes]]:
    """Result and figures of the modes in one gear."""
    try:
        changes = _changes(arguments.change, system)
        if gear:  # by their names in the gear
            changed, system = system.with_values(changes).in_gear(gear), system.in_gear(gear)
            values = ((name, quantity.value) for name, quantity in changed.parameters.items())
            changes = {name: value for name, value in values if value != system.parameters[name].value}
        analysed = api.modes(system, damped=arguments.damped)
        result = analysed.to_dict()
        if apart := _apart(system):
            result["notes"] = [apart]
        if len(analysed) < len(analysed.coordinates) and not arguments.damped:
            result["degrees_of_freedom"] = len(analysed.coordinates)
        if arguments.reduced:
            _add_reduced(result, system, analysed)
        if changes:
            from modelling.modal.sensitivity import what_if

            rows = [change.to_dict() for change in what_if(system, changes)]
            result["what_if"] = {"changes": changes, "modes": rows}
    except InputError as error:
        raise InputError(f"{arguments.model}: {error.where}".rstrip(": "), error.wrong, error.right) from None
    if arguments.out is None:
        return result, {}
    from matching.report.modes import modes_files

    *_, files = modes_files(analysed, title=system.title or str(arguments.model))
    return result, dict(files)


def _apart(system: System) -> str:
    """A note on a model that falls into parts which no joint connects; empty if it does not."""
    from modelling.topology import Joint, connected_parts, joints

    converters = [Joint(f"gearboxes.{box.name}", box.between) for box in system.gearboxes]
    parts = connected_parts([part.name for part in system.inertias], [*joints(system), *converters])
    if len(parts) == 1:
        return ""
    smallest: list[str] = min(parts, key=len)
    joined = "no shaft and no gear joins this to the rest"
    return f"{', '.join(smallest)}: {joined}; if it is no model of its own, correct a `between`"


def _add_reduced(result: dict[str, Any], system: System, analysed: Modes) -> None:
    from modelling.modal.modes import reduced, reduced_values, speed_ratios

    result["reference"] = system.reference
    result["reduced"] = reduced_values(system)
    at_reference = reduced(analysed, speed_ratios(system))
    for entry, mass, stiffness in zip(result["modes"], at_reference.modal_mass, at_reference.modal_stiffness):
        entry |= {"modal_mass": float(mass), "modal_stiffness": float(stiffness)}


def _changes(assignments: list[str], system: System) -> dict[str, float]:
    """``NAME=VALUE`` with or without unit, as values in SI by name."""
    from modelling.errors import InputError, unknown
    from modelling.units import to_si

    changes = {}
    for text in assignments:
        name, equals, value = text.partition("=")
        if not equals:
            raise InputError("--change", f"{text!r} has no '='", "write NAME=VALUE, e.g. inertias.motor.J=0.06")
        if name.strip() not in system.parameters:
            raise unknown(name.strip(), list(system.parameters), "--change")
        changes[name.strip()] = to_si(value, system.units[name.strip()], f"--change {name.strip()}")
    system.with_values(changes)  # says what is impossible
    return changes


def modes_summary(result: dict[str, Any]) -> str:
    """The mode table, and reduced values where asked for."""
    from matching.report.modes import mode_table
    from matching.report.page import aligned

    lines = [aligned(mode_table(result["modes"]))]
    lines += [f"note: {note}" for note in result.get("notes", ())]
    if "degrees_of_freedom" in result:
        lines += ["", f"the lowest {len(result['modes'])} of {result['degrees_of_freedom']} modes"]
    if "what_if" in result:
        rows = [
            {"mode": str(row["number"]), "now [Hz]": f"{row['frequency']:.4g}", "Eq. 8 [Hz]": f"{row['predicted']:.4g}",
             "Eq. 8": f"{100 * row['predicted_change']:+.1f} %", "exact [Hz]": f"{row['exact']:.4g}",
             "exact": f"{100 * row['exact_change']:+.1f} %"}
            for row in result["what_if"]["modes"]
        ]  # fmt: skip
        lines += ["", "with the changes (Eq. 8 is a first-order prediction; the exact solution is the true value):"]
        lines.append(aligned(rows))
    if "reduced" in result:
        lines += ["", f"reduced to {result['reference']}:"]
        lines += [f"  {name:40} {value:.5g}" for name, value in result["reduced"].items() if value]
    return "\n".join(lines)


AT_REST = 1e-9  # of a sensor's readings or error: it moves by no more than rounding
SMALLEST_TOLERANCE = 1e-9  # share of a reading's range; below, rounding decides


def run_simulate(arguments: Arguments) -> dict[str, Any]:
    """Simulate and write files; the result object holds what was run, and the misfit by sensor."""
    from matching.report.motions import simulation_files
    from modelling.linear.steady_motion import is_linear
    from modelling.writing import write_all

    tolerance = arguments.tolerance
    if not SMALLEST_TOLERANCE <= tolerance < 1:
        right = f"give a share of the range, {SMALLEST_TOLERANCE:g} to 1"
        raise InputError("--tolerance", f"{tolerance:g} is not possible", right)
    system = api.load(arguments.model)
    if not system.sensors:
        right = "add what is to be simulated, for example [sensors.speed] with measures and of"
        raise InputError(arguments.model, "has no sensor, so there is nothing to write", right)
    recording = api.read_recording(arguments.recording, system, arguments.channels)
    done = api.simulate(system, recording, start=arguments.start, tolerance=tolerance)
    misfit = {name: _misfit(done[name], recording[name], done.units[name]) for name in recording.sensors(system)}
    measured = {name: recording[name] for name in done.readings if name in recording.channels}
    *_, files = simulation_files(done, measured=measured)
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
        "notes": [*recording.notes, *done.notes, *_inaccurate(done.integration_error, tolerance, is_linear(system))],
        "files": sorted(files),
    }


def _inaccurate(errors: dict[str, float], tolerance: float, linear: bool) -> list[str]:
    """A note on the readings whose estimated error is beyond the tolerance."""
    beyond = {name: error for name, error in errors.items() if error > tolerance}
    if not beyond:
        return []
    shares = ", ".join(f"{name} {error:.2g}" for name, error in beyond.items())
    why = "the steps do not resolve the fastest vibration"
    if not linear:
        why += ", a flank or dry friction acts between two samples, or the motion is chaotic"
    return [f"the estimated error of the integration is larger than asked for ({shares} of the range): {why}"]


def _misfit(simulated: np.ndarray, recorded: np.ndarray, unit: str) -> dict[str, Any]:
    """Root mean square of a sensor's difference (t,), and its share of the recorded range; None of a sensor at rest."""
    import numpy as np

    there = np.isfinite(recorded)
    rms, spread = float(np.sqrt(np.mean((simulated - recorded)[there] ** 2))), float(np.ptp(recorded[there]))
    rests = spread <= AT_REST * max(rms, float(np.abs(recorded[there]).max()))
    return {"rms": rms, "unit": unit, "of_range": None if rests else rms / spread}


def simulate_summary(result: dict[str, Any]) -> str:
    """The misfit by sensor."""
    lines = [
        f"{result['samples']} samples over {result['duration']:g} s simulated from {result['start']['from']} start"
    ]
    for name, error in result["misfit"].items():
        share = f" ({error['of_range']:.2%} of its range)" if error["of_range"] is not None else ""
        lines.append(f"  {name}: root mean square of the difference {error['rms']:.4g} {error['unit']}{share}")
    lines += [f"note: {note}" for note in result["notes"]]
    return "\n".join([*lines, f"written: {', '.join(result['files'])}"])


# --- Match


def study_arguments(parser: argparse.ArgumentParser) -> None:
    """A cluster in place of this machine's processes; quantities on Tab."""
    parser.add_argument("--scheduler", metavar="ADDRESS", help="Dask scheduler to run on, e.g. tcp://host:8786")
    for axis in ("x", "y"):
        completed(parser, axis, lambda given: quantities_of_case(given.case))
    completed(parser, "added", lambda given: [f"{name}=" for name in quantities_of_case(given.case)])


# --- Go onto the bed


def verify_arguments(parser: argparse.ArgumentParser) -> None:
    """Whether recordings that grow are followed, and how long a bed that falls short is diagnosed."""
    parser.add_argument(
        "--diagnosis-limit", metavar="VALUE", default="240 s",
        help="a diagnosis of a bed that falls short ends after so much processor time with its best answer so far (s, "
        "or with a unit; default: 240 s)",
    )  # fmt: skip
    parser.add_argument(
        "--follow", metavar="VALUE",
        help="judge again while the recordings grow, until none has grown for so long (s, or with a unit)",
    )  # fmt: skip


def run_verify(arguments: Arguments) -> dict[str, Any]:
    """Judge and write files."""
    if arguments.follow is not None:
        arguments.follow = api.in_si(arguments.follow, "s", "--follow", positive=True)
    arguments.diagnosis_limit = api.in_si(arguments.diagnosis_limit, "s", "--diagnosis-limit", positive=True)
    case, channels = api.tuned_case_of(arguments.case), api.channels_of(arguments.channels)
    if arguments.channel_check:
        return written(api.checked_channels(case, arguments.recordings, channels), arguments)
    if arguments.follow is None:
        return _judged(arguments, case, channels, arguments.recordings)
    return _followed(arguments, case, channels)


def _judged(arguments: Arguments, case: Case, channels: Any, recordings: Sequence[str | Path]) -> dict[str, Any]:
    """Judge recordings, or copies of those on the command line, and write files; diagnose them where they are short."""
    from matching.bed.commission import why_short
    from matching.bed.verify import judge, read_recordings
    from matching.progress import shown

    read = read_recordings(recordings, case, channels, arguments.recordings)
    computing(lambda: dict.fromkeys(arguments.recordings, "a recording of the controlled bed"))
    verification = judge(case, read)
    reason = None
    if arguments.follow is None:  # nobody at the bed waits for minutes
        with shown("verify") as tell:
            reason = why_short(case, verification, recordings, channels, tell, arguments.diagnosis_limit)
    copies = dict(zip(arguments.recordings, recordings, strict=True))
    return written(verification, arguments, {"diagnosis": None if reason is None else reason.to_dict()}, copies)


def _followed(arguments: Arguments, case: Case, channels: Any) -> dict[str, Any]:
    """Judge growing recordings again and again; a line each time says how far the answer is."""
    from tempfile import TemporaryDirectory

    from matching.bed.verify import snapshots
    from matching.report.bed import interim

    result: dict[str, Any] | None = None
    wrong: InputError | None = None
    with TemporaryDirectory(prefix="rigmatch-") as folder:
        for copies in snapshots([Path(name) for name in arguments.recordings], arguments.follow, Path(folder)):
            try:
                result, wrong = _judged(arguments, case, channels, copies), None
                say(interim(result))
            except InputError as error:
                where = error.where
                for copy, name in zip(copies, arguments.recordings, strict=True):
                    where = where.replace(str(copy), name)
                wrong = InputError(where, error.wrong, error.right)
                say(f"not yet: {wrong}")
    if wrong is not None and result is not None:  # an answer that the files as they are do not give
        before = f"{arguments.out} holds what was judged before"
        raise InputError(wrong.where, wrong.wrong, "; ".join(filter(None, (wrong.right, before))))
    if result is None:
        raise wrong or InputError(arguments.recordings[0], "was never judged")
    return result


def wrong_channel(result: Mapping[str, Any]) -> bool:
    """Whether a check of the channels found a wrong one, or ended early."""
    return bool(result.get("right") is False or result.get("status") == "wrong_channel")


def run_commission(arguments: Arguments) -> dict[str, Any]:
    """Go round; a person at the bed is told every step in a line of its own."""
    more = {} if arguments.follow is None else {"progress": say}
    return written(called_with_pool(arguments, **more), arguments)


def say(what: str) -> None:
    """Tell a person at the bed, a line each."""
    print(what, file=sys.stderr, flush=True)


def export_arguments(parser: argparse.ArgumentParser) -> None:
    """What is exported: a model or the controller."""
    what = parser.add_mutually_exclusive_group(required=True)
    what.add_argument("--fmu", metavar="FILE", help="FMU of the residual vehicle or model to write, NAME.fmu")
    what.add_argument("--controller", metavar="FILE", help="FMU of the whole controller to write, NAME.fmu")


def run_export(arguments: Arguments) -> dict[str, Any]:
    """Write the FMU; the result object tells what is in it."""
    from matching.export import write, write_controller

    if arguments.controller:
        return write_controller(arguments.result, arguments.controller, arguments.fmi).to_dict()
    return write(arguments.result, arguments.fmu, arguments.fmi).to_dict()


def export_summary(result: dict[str, Any]) -> str:
    """What was written, in a few lines."""
    tuned = [parameter for parameter in result["parameters"] if parameter["tuned"]]
    where = f"binary for {result['platform']} and sources" if result["platform"] else "sources only"
    steps = (
        f"sample time {1e3 * result['communication_step']:.4g} ms, {result['states']} states, "
        f"{result['memory_bytes']} bytes"
        if result["of"] == "controller"
        else f"internal steps of at most {1e3 / result['steps_per_second']:.4g} ms"
    )
    lines = [
        f"{result['fmu']}: {result['title']}",
        f"FMI {result['fmi']} for co-simulation, {where}; {steps}",
        f"inputs: {', '.join(result['inputs']) or 'none'}",
        f"outputs: {', '.join(result['outputs']) or 'none'}",
        f"{len(result['parameters'])} parameters, {len(tuned)} of them tuned"
        + "".join(f"\n  {parameter['name']} = {parameter['value']:.6g} {parameter['unit']}" for parameter in tuned),
    ]
    return "\n".join(lines + [f"note: {note}" for note in result["notes"]])


# --- Names that a shell offers on Tab

# Quantities that every component of a table has, and those it has where its file gives them
ALWAYS = {"inertias": ("J", "drag"), "shafts": ("stiffness", "damping"), "gears": ("ratio",),
          "planetary_gears": ("ratio",), "gearboxes": ("deflection",)}  # fmt: skip
WHERE_GIVEN = {"shafts": ("ratio",), "gearboxes": ("settling",)}
OF_A_DRAWING = ("length", "diameter", "inner_diameter")  # of a shaft of the rig
LOOP = ("dead_time", "inverter_lag", "torque_sensor_lag", "sample_time")  # of every control structure
SPEED_CONTROLLER = (
    "proportional_gain", "integral_gain", "torque_feed_forward", "acceleration_feed_forward", "lead_time",
)  # fmt: skip
OBSERVER = (
    "torque_drift", "dynamometer_drift", "dynamometer_swing", "dynamometer_noise", "shaft_noise", "command_weight",
    "command_change_weight", "torque_sensor_noise", "rotor_speed_noise", "further_sensor_noise",
)  # fmt: skip
# As the structures themselves have them, which a test compares: to import them takes a second, and Tab should not wait
STRUCTURES = {"pi": SPEED_CONTROLLER, "model_based": SPEED_CONTROLLER, "observer": OBSERVER}


def parameters_of_model(path: str | Path) -> list[str]:
    """Names of a model's quantities; those of effects as far as its file gives them."""
    return _completed_parameters(read_toml(path))


def quantities_of_case(path: str | Path) -> list[str]:
    """Names of a case's quantities that can be set, as :func:`matching.match.map.quantities` has them."""
    data = read_toml(path)
    own = data.get("residual_vehicle", {}).get("model")
    files = [data["vehicle"], data["rig"], *([own] if own else [])]
    tables = [read_toml(Path(path).parent / file) for file in files]
    vehicle, rig, *simple = map(_completed_parameters, tables)
    drawn = [
        name for name, shaft in tables[1].get("shafts", {}).items()
        if "length" in shaft and name not in tables[0].get("shafts", {})
    ]  # fmt: skip
    loop = data["loop"]
    of_loop = dict.fromkeys((*LOOP, *STRUCTURES.get(loop["structure"], ())))
    return [
        *(f"residual_vehicle.{name}" for name in (simple[0] if simple else vehicle) if name not in rig),
        *(f"rig.{name}" for name in rig if name not in vehicle),
        *(f"rig.shafts.{name}.{key}" for name in drawn for key in OF_A_DRAWING),
        *(f"loop.{name}" for name in of_loop),
    ]


def _completed_parameters(model: dict[str, Any]) -> list[str]:
    names = [
        f"{table}.{name}.{key}"
        for table, keys in ALWAYS.items()
        for name, content in model.get(table, {}).items()
        for key in (*keys, *(key for key in WHERE_GIVEN.get(table, ()) if key in content))
    ]
    for name, content in model.get("gearboxes", {}).items():
        names += [f"gearboxes.{name}.ratio_{gear}" for gear in range(1, len(content["ratios"]) + 1)]
    for effect in model.get("effects", []):
        names += [f"{effect['at']}.{effect['kind']}.{key}" for key in effect if key not in ("at", "kind")]
    return names


# --- The list of commands

REQUIRED, OPTIONAL = "required", "optional"


@dataclass(frozen=True)
class Command:
    """A command of the terminal; it imports what computes when it runs, so that help is instant.

    Attributes
    ----------
    group : str
        Step of the work that it belongs to.
    function : callable
        Of :mod:`matching.api`: its parameters are the command's arguments, its docstring is the help.
    run : callable
        Does it and writes files; returns the result object.
    summary : callable, optional
        The result for a reader at a terminal; by default the view of its file.
    file : str
        Name of that file, where none is written.
    out : str, optional
        Whether ``--out`` is ``REQUIRED`` or ``OPTIONAL``; None: there is none, or the function has it.
    required, hidden : tuple of str
        Parameters that are options although they have no default; that exist in Python only.
    further : callable, optional
        Adds arguments that exist on the command line only.
    defect : callable
        Whether a result says that a channel of the bed is wrong, which is exit code 3.
    """

    group: str
    function: Callable[..., Any]
    run: Callable[[Arguments], dict[str, Any]] = run_function
    summary: Callable[[dict[str, Any]], str] | None = None
    file: str = ""
    out: str | None = REQUIRED
    required: tuple[str, ...] = ()
    hidden: tuple[str, ...] = ()
    further: Callable[[argparse.ArgumentParser], None] | None = None
    defect: Callable[[Mapping[str, Any]], bool] = lambda _: False

    def told(self, result: dict[str, Any], arguments: Arguments | None = None) -> str:
        """The result for a reader at a terminal; of a model with gearboxes gear by gear."""
        if "gears" in result:
            first = {key: value for key, value in result.items() if key != "gears"}
            every = [first, *result["gears"]]
            return "\n\n".join(f"{one['gear']}:\n{self.told(one, arguments)}" for one in every)
        return told(result, self.file, arguments) if self.summary is None else self.summary(result)


BEGIN, UNDERSTAND, MATCH, LACKS, TRUST, BED = (
    "begin, and look", "understand a model", "match", "find what a model lacks", "say how far it can be trusted",
    "go onto the bed",
)  # fmt: skip
EXAMPLES = {
    "new": (
        "new my_bed",
        "new bench/electric_drive",
    ),
    "show": (
        "show examples/road_to_rig/vehicle.toml --out out/drawing",
        "show examples/road_to_rig/case.toml --out out/drawing",
        "show examples/from_recordings/road.csv --model examples/from_recordings/vehicle.toml --out out/channels",
    ),
    "explore": (
        "explore examples/road_to_rig/case.toml",
        "explore examples/from_recordings/rig.toml examples/from_recordings/bed.csv --no-browser",
    ),
    "modes": (
        "modes examples/road_to_rig/vehicle.toml --out out/modes",
        'modes examples/road_to_rig/rig.toml --damped --change "inertias.rotor_left.J=1.8 kg*m^2" --out out/rig',
    ),
    "simulate": (
        "simulate examples/from_recordings/rig.toml examples/from_recordings/bed.csv --out out/simulated",
        "simulate examples/from_recordings/rig.toml examples/from_recordings/bed.csv --start steady --out "
        "out/from_steady_motion",
    ),
    "campbell": (
        'campbell examples/engine/engine.toml --speed "600:6000 1/min" --orders 2,4,6 --out out/campbell',
        'campbell examples/road_to_rig/vehicle.toml --speed "300:9000 1/min" --of motor --orders 1,24,48 '
        "--out out/campbell_of_motor",
    ),
    "response": (
        'response examples/engine/engine.toml --speed "600:6000:1000 1/min" --torques "engine_torque:2=150 N*m" '
        "--out out/response_to_one_order",
        'response examples/engine/engine.toml --speed "600:6000 1/min" --torques engine_torque:2=150 '
        '--torques engine_torque:4=40 --phases "engine_torque:4=30 deg" --out out/response',
    ),
    "match": (
        "match examples/road_to_rig/case.toml --out out/match",
        "match examples/compact_bev/case.toml --seed 3 --starts 20 --workers 2 --out out/compact",
        "match examples/road_to_rig/observer.toml --beds 2000 --out out/observer",
    ),
    "map": (
        "map examples/road_to_rig/case.toml --x loop.dead_time=1ms:8ms:4 --starts 1 --out out/sweep",
        "map examples/road_to_rig/case.toml --x loop.dead_time=1ms:8ms:4 --y "
        "rig.shafts.flange_left.stiffness=1e5:4e5:3 --out out/map",
        'map examples/road_to_rig/case.toml --x "loop.dead_time=1 ms,2 ms,5 ms" --y loop.inverter_lag '
        "--starts 1 --out out/map_of_lags",
    ),
    "tolerance": (
        "match examples/road_to_rig/case.toml --out out/match",
        'tolerance out/match/case.toml -n 10000 --tolerance "rig.*.stiffness=0.05" --out out/tolerance',
        'tolerance out/match/case.toml --tolerance "rig.inertias.*.J=0.02" --tolerance loop.dead_time=0.1 '
        "--out out/tolerance",
    ),
    "diagnose": (
        "python examples/diagnosis/record.py out/recordings",
        "diagnose examples/diagnosis/model.toml out/recordings/play.csv --out out/diagnosis",
        "diagnose examples/diagnosis/model.toml out/recordings/play.csv --holdout "
        "out/recordings/play_pulled_one_way.csv --out out/held_out",
    ),
    "uncertainty": (
        "uncertainty examples/sensors/torque_M2.toml --out out/torque",
        'uncertainty examples/sensors/torque_M2.toml --wanted "0.5 N*m" --out out/torque',
    ),
    "fidelity": (
        "fidelity examples/fidelity/tab2.toml --out out/fidelity",
        "fidelity examples/fidelity/tab2.toml --arithmetic published --out out/fidelity",
    ),
    "export": (
        "export out/road_to_rig --fmu out/residual_vehicle.fmu",
        "export out/road_to_rig --controller out/controller.fmu",
    ),
    "excite": (
        "excite out/road_to_rig --out out/excite",
        "excite out/road_to_rig --proof --out out/proof",
        "excite out/road_to_rig --channel-check --out out/channels",
        "excite examples/from_recordings/case.toml --duration 30 --speed 40 --limit motor_torque=60 --out out/excite",
    ),
    "identify": (
        "identify examples/from_recordings/case.toml --vehicle examples/from_recordings/road.csv --bed "
        "examples/from_recordings/bed.csv --diagnosis-limit 30 --out out/identify",
        "identify examples/from_recordings/case.toml --bed examples/from_recordings/bed.csv --out out/bed_alone",
    ),
    "verify": (
        "export examples/from_recordings/bed.toml --fmu out/bed.fmu",
        "commission examples/from_recordings/case.toml --bed out/bed.fmu --rounds 1 --diagnosis-limit 30 --out "
        "out/commissioned",
        "verify out/commissioned/1_match out/commissioned/1_verify/recording.csv --diagnosis-limit 30 --out out/verify",
        "verify out/commissioned/1_match out/commissioned/1_verify/recording.csv --follow 10 --out out/followed",
    ),
    "commission": (
        "commission examples/from_recordings/case.toml --bed out/bed_recordings --out out/by_hand",
        "export examples/from_recordings/bed.toml --fmu out/bed.fmu",
        "commission examples/from_recordings/case.toml --bed out/bed.fmu --rounds 2 --diagnosis-limit 30 --out "
        "out/commission",
        "commission examples/from_recordings/case.toml --vehicle-recording examples/from_recordings/road.csv "
        "--bed out/bed.fmu --rounds 1 --diagnosis-limit 30 --out out/known_vehicle",
    ),
    "learn": (
        "export examples/from_recordings/bed.toml --fmu out/bed.fmu",
        "commission examples/from_recordings/case.toml --bed out/bed.fmu --rounds 1 --repeat 2 --diagnosis-limit 30 "
        "--out out/repeated",
        "learn out/repeated/1_match out/repeated/learned/repetition_1/recording_1.csv "
        "out/repeated/learned/repetition_1/recording_2.csv --out out/learned",
        "learn out/repeated/1_match out/repeated/learned/repetition_2/recording_1.csv "
        "out/repeated/learned/repetition_2/recording_2.csv --played out/repeated/learned/repetition_1 --out "
        "out/learned_again",
    ),
}
NO_OUT: dict[str, Any] = {"out": None}
IF_ASKED: dict[str, Any] = {"out": OPTIONAL}
COMMANDS: dict[str, Command] = {
    "new": Command(BEGIN, api.new, run_new, summary=new_summary, **NO_OUT),
    "show": Command(BEGIN, api.show, run_show, summary=show_summary, further=show_arguments, **IF_ASKED),
    "explore": Command(BEGIN, api.explore, run_explore, hidden=("browser",), further=explore_arguments, **NO_OUT),
    "modes": Command(
        UNDERSTAND, api.modes, run_modes, summary=modes_summary, hidden=("values",), further=modes_arguments, **IF_ASKED
    ),
    "campbell": Command(UNDERSTAND, api.campbell, run_in_gears, required=("speed",)),
    "response": Command(UNDERSTAND, api.order_response, run_in_gears, required=("speed", "torques")),
    "simulate": Command(UNDERSTAND, api.simulate, run_simulate, summary=simulate_summary),
    "match": Command(MATCH, api.match),
    "map": Command(MATCH, api.map, required=("x",), hidden=("record",), further=study_arguments),
    "tolerance": Command(MATCH, api.tolerance, hidden=("record",), further=study_arguments),
    "diagnose": Command(LACKS, api.diagnose),
    "uncertainty": Command(TRUST, api.uncertainty, file="uncertainty.json", **IF_ASKED),
    "fidelity": Command(TRUST, api.fidelity, file="fidelity.json", **IF_ASKED),
    "export": Command(
        BED, api.export, run_export, summary=export_summary, hidden=("fmu",), further=export_arguments, **NO_OUT
    ),
    "excite": Command(BED, api.excite),
    "identify": Command(BED, api.identify),
    "verify": Command(BED, api.verify, run_verify, further=verify_arguments, defect=wrong_channel),
    "commission": Command(BED, api.commission, run_commission, required=("bed", "out"), **NO_OUT, defect=wrong_channel),
    "learn": Command(BED, api.learn),
}


def calls(command: str) -> list[str]:
    """Calls that work as typed, one after the other, in the program's folder after ``make run``."""
    return [call if call.startswith("python ") else f"rigmatch {call}" for call in EXAMPLES[command]]


@display.text.register
def saved_text(saved: SavedResult) -> str:
    """A result that was read again, as its command prints it."""
    return COMMANDS[saved.command].told(saved.content)
