"""The commands of `rigmatch`: help, examples, arguments, what each runs and prints; ``COMMANDS`` lists them."""

from __future__ import annotations

import argparse
import sys
import threading
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

from matching.progress import seconds
from modelling.errors import InputError

if TYPE_CHECKING:
    import numpy as np

    from matching.bed.excite import ExcitationOrder
    from matching.match.case import Case
    from modelling.modal.result import Modes
    from modelling.recordings.read import Channel
    from modelling.system import System


# --- `rigmatch commission`: the whole way onto the bed, stoppable at every step.

COMMISSION_HELP = """\
The whole way onto the bed: match, export, run and verify; then excite, record, diagnose, match again with the
values and uncertainties that the diagnosis found, export, run, verify, as long as a further round would gain. BED is an
FMU of the bed (FMI 2.0, inputs and outputs named as in the rig file), stepped with the exported controller's FMU, or a
folder that recordings are put into: then the command stops and says what to record and where to put it. Called again
it goes on where it stopped; steps that are done are not repeated. CASE is a case file, or the directory of a match."""
COMMISSION_EXAMPLES = (
    "rigmatch commission examples/from_recordings/case.toml --bed out/bed_recordings --out out/by_hand",
    "rigmatch export examples/from_recordings/bed.toml --fmu out/bed.fmu",
    "rigmatch commission examples/from_recordings/case.toml --bed out/bed.fmu --rounds 2 --out out/commission",
    "rigmatch commission examples/from_recordings/case.toml --vehicle-recording examples/from_recordings/road.csv "
    "--bed out/bed.fmu --out out/known_vehicle",
)
COMMISSION_PAGE = "report.html"  # in the folder of --out


def add_commission_arguments(parser: argparse.ArgumentParser) -> None:
    """Case, bed, rounds, excitation, output directory."""
    from matching.progress import count, seconds

    parser.add_argument("case", metavar="CASE", help="case file (TOML), or the directory of a match")
    parser.add_argument("--bed", metavar="BED", required=True, help="FMU of the bed, or a folder for its recordings")
    parser.add_argument(
        "--vehicle-recording", metavar="RECORDING", nargs="+", default=[],
        help="of the vehicle on the road: its model is diagnosed on them before the first match",
    )  # fmt: skip
    parser.add_argument("--rounds", metavar="N", type=count(1), default=3, help="rounds at most (default: 3)")
    parser.add_argument("--duration", metavar="S", type=float, default=12.0, help="of the excitation, s (default: 12)")
    parser.add_argument("--speed", metavar="RAD_S", type=float, help="rotor speed (default: a quarter of the limit)")
    parser.add_argument(
        "--diagnosis-limit", type=seconds, default=600.0, metavar="SECONDS",
        help="a diagnosis that takes longer ends with the best it has, and says so (default: 600)",
    )  # fmt: skip
    parser.add_argument("--seed", metavar="N", type=count(0), default=0, help="seed of the matches (default: 0)")
    parser.add_argument("--workers", metavar="N", type=count(1), help="processes (default: one a core)")
    parser.add_argument(
        "--follow", type=seconds, metavar="SECONDS",
        help="with a folder: wait for each recording, and follow it until it has not grown for so long",
    )  # fmt: skip
    parser.add_argument("--out", metavar="DIR", required=True, help="directory to write to")


def run_commission(arguments: argparse.Namespace) -> dict[str, Any]:
    """Go round and write files; the result object is the content of ``commission.json``."""
    from pathlib import Path

    from matching.bed.commission import Circle, CommissionOrder
    from matching.bed.excite import ExcitationOrder
    from matching.progress import steps
    from matching.report.bed import commissioning_page
    from matching.report.common import made_from
    from modelling.resources import cores
    from modelling.writing import strict_json, write_all

    excitation = ExcitationOrder(duration=arguments.duration, speed=arguments.speed)
    order = CommissionOrder(
        arguments.rounds, excitation, arguments.seed, arguments.workers or cores(), arguments.follow,
        tuple(Path(name) for name in arguments.vehicle_recording), arguments.diagnosis_limit,
    )  # fmt: skip
    with steps("commission") as step:
        tell = step if arguments.follow is None else _said
        result = Circle(Path(arguments.out), Path(arguments.bed), order, tell).run(Path(arguments.case)).to_dict()
    case = Path(arguments.case)
    made = made_from(case / "case.toml" if case.is_dir() else case, arguments.seed, ("vehicle", "rig"))
    write_all(arguments.out, {"commission.json": strict_json(result), "report.html": commissioning_page(result, made)})
    return result


def check_commission(arguments: argparse.Namespace) -> dict[str, str]:
    """For ``--check``: what the bed is, and what the vehicle's recordings hold, by file."""
    from pathlib import Path

    from matching.bed.excite import ExcitationOrder, check_order
    from matching.bed.identify import recordings_read
    from matching.bed.simulated_bed import FmuBed, check_bed
    from matching.export import tuned_case

    case, bed = tuned_case(arguments.case).tuned, Path(arguments.bed)
    check_order(case, ExcitationOrder(duration=arguments.duration, speed=arguments.speed))
    check_bed(bed)
    contents = {arguments.bed: "a folder for recordings of the bed"}
    if bed.is_file():
        with FmuBed(bed, [part.name for part in case.rig.inputs], [part.name for part in case.rig.sensors]):
            contents[arguments.bed] = "an FMU with the rig's inputs and sensors"
    recordings = [Path(name) for name in arguments.vehicle_recording]
    return contents | (recordings_read(case, recordings, []) if recordings else {})


def _said(what: str) -> None:
    """For a person at the bed, a line each."""
    print(what, file=sys.stderr, flush=True)


def commission_summary(result: dict[str, Any]) -> str:
    """The answer, then a few lines a round."""
    from matching.report.bed import commissioning_summary as words

    return words(result)


# --- `rigmatch diagnose`: find what a model lacks, from recordings.

DIAGNOSE_HELP = """\
Fits the model to recordings, shows where it fails, names the cause and its place, and writes the extended
model. Writes diagnosis.json, extended.toml, report.html and figures. A quantity of the model with a range is fitted
within it; one without is taken as known. Every sensor's uncertainty is also the noise that the fit assumes. Without
--holdout the last 30 % of every recording is not fitted but used to judge the result. Files joined by + are one motion
recorded by several loggers, whose clocks are set to that of the one with the inputs."""
DIAGNOSE_EXAMPLES = (
    "python examples/diagnosis/record.py out/recordings",
    "rigmatch diagnose examples/diagnosis/model.toml out/recordings/play.csv --out out/diagnosis",
    "rigmatch diagnose examples/diagnosis/model.toml out/recordings/play.csv "
    "--holdout out/recordings/play_pulled_one_way.csv --out out/held_out",
)

PICTURING = 2  # processes: one draws, one makes figures that act in the browser
DIAGNOSE_PAGE = "report.html"  # in the folder of --out


def add_diagnose_arguments(parser: argparse.ArgumentParser) -> None:
    """Model, recordings, held-out recording, output directory."""
    parser.add_argument("model", metavar="MODEL", help="model file (TOML)")
    parser.add_argument(
        "recordings", metavar="RECORDING", nargs="+", help="recordings of the system (CSV, MDF, .mat, Parquet)"
    )
    parser.add_argument(
        "--holdout", metavar="RECORDING", action="append", default=[],
        help="a recording that is not fitted but used to judge the result; may be given several times",
    )  # fmt: skip
    parser.add_argument("--channels", metavar="FILE", help="what the channels are called in the recordings (TOML)")
    parser.add_argument(
        "--keep-rest", action="store_true",
        help="keep the torque that no cause explains as a table in the extended model, if unseen data gain by it",
    )  # fmt: skip
    parser.add_argument("--out", metavar="DIR", required=True, help="directory to write to")


def run_diagnose(arguments: argparse.Namespace) -> dict[str, Any]:
    """Diagnose and write files; the result object is that of diagnosis.json."""
    from tqdm import tqdm

    from matching.diagnosis.diagnose import diagnose
    from matching.diagnosis.loggers import read_loggers
    from matching.progress import watched
    from matching.worker_pool import beside
    from modelling.model_file import dumps, load
    from modelling.recordings.read import read_channels
    from modelling.resources import cores
    from modelling.writing import write_results

    tqdm.monitor_interval = 0  # no thread of its own, as for the copy below
    looks = {"desc": "diagnose", "bar_format": "{desc} [{elapsed}]"}
    with tqdm(disable=not watched(), leave=False, **looks) as bar, beside(cores(), PICTURING) as aside:
        aside.prepare("scipy.signal", "matching.report.diagnosis", "bokeh.plotting")  # while this one searches
        aside.start()
        threading.Thread(target=import_module, args=("scipy.signal",), daemon=True).start()  # which the fits need late
        system = load(arguments.model)
        channels = read_channels(arguments.channels) if arguments.channels else None
        recordings = [read_loggers(paths, system, channels) for paths in arguments.recordings]
        holdout = [read_loggers(paths, system, channels) for paths in arguments.holdout]
        pictures = _Pictures(aside, system)

        def tell(step: str) -> None:
            bar.set_description_str(f"{step:50.50}")
            bar.update()

        diagnosis = diagnose(system, recordings, holdout, tell, arguments.keep_rest, pictures.begin)
        tell("report")
        result, files = _written_diagnose(diagnosis, system, pictures, _made(arguments))
    files["extended.toml"] = dumps(diagnosis.extended)
    return write_results(arguments.out, "diagnosis.json", result, files)


def _made(arguments: argparse.Namespace) -> Any:
    from matching.diagnosis.loggers import SEVERAL_LOGGERS
    from matching.report.common import made_from, with_recordings

    recordings = [*arguments.recordings, *arguments.holdout]
    paths = [path for each in recordings for path in ([each] if Path(each).exists() else each.split(SEVERAL_LOGGERS))]
    if arguments.channels:
        paths.insert(0, arguments.channels)
    return with_recordings(made_from(arguments.model, None), zip(paths, paths, strict=True))


class _Pictures:
    """The figures as files and for the browser, made by other processes while this one judges the causes."""

    def __init__(self, aside: Any, system: Any):
        self._aside, self._system = aside, system

    def begin(self, shown: Any) -> None:
        """Have them made."""
        self._drawn = self._aside.begin(_drawn_diagnose, shown, self._system)
        self._moving = self._aside.begin(_moving, shown, self._system)

    def files(self) -> dict[str, bytes]:
        """SVG by name."""
        drawn: dict[str, bytes] = self._drawn.result()
        return drawn

    def moving(self) -> dict[str, str]:
        """Scripts and elements by name."""
        acting: dict[str, str] = self._moving.result()
        return acting


def _drawn_diagnose(shown: Any, system: Any) -> dict[str, bytes]:
    from matching.report.diagnosis import pictures  # here: the process that begins this does not draw

    return pictures(shown, system)


def _moving(shown: Any, system: Any) -> dict[str, str]:
    from matching.report.diagnosis import acting_figures

    return acting_figures(shown, system)


def _written_diagnose(
    diagnosis: Any, system: Any, pictures: _Pictures, made: Any
) -> tuple[dict[str, Any], dict[str, str | bytes]]:
    """Result and files by name."""
    from matching.report.diagnosis import content, page

    result, drawn = content(diagnosis), pictures.files()
    units = {sensor.name: sensor.unit for sensor in system.sensors}
    files: dict[str, str | bytes] = {"report.html": page(result, system.title, units, drawn, pictures.moving(), made)}
    return result, files | {f"figures/{name}.svg": picture for name, picture in drawn.items()}


def diagnose_summary(result: dict[str, Any]) -> str:
    """The answer in a sentence, then errors and causes."""
    from matching.report.diagnosis import summary as words

    return words(result)


# --- `rigmatch excite`: plan the recording that identifies what a match depends on most.

EXCITE_HELP = """\
Plan a recording of the bed without emulation that tells what the match depends on most: a multisine whose
spectrum makes the most of it (Fisher information), a chirp and steps on dynamometers and motor, as large as the case's
limits leave it with a margin, on the model and on beds drawn from [uncertainty]. States the standard uncertainties that
are expected. CASE is the directory that rigmatch match wrote, or a case file. Add the torques of excitation.csv to
those of a slow speed hold, and record the torque commands (speed hold included) and every sensor of the rig."""
EXCITE_EXAMPLES = (
    "rigmatch excite out/road_to_rig --out out/excite",
    "rigmatch excite examples/from_recordings/case.toml --duration 30 --speed 40 --limit motor_torque=60 "
    "--out out/excite",
)


def add_excite_arguments(parser: argparse.ArgumentParser) -> None:
    """Case, duration, margin, speed, limits, output directory."""
    from matching.progress import count

    parser.add_argument("case", metavar="CASE", help="directory or result.json of a match, or a case file (TOML)")
    parser.add_argument("--duration", metavar="S", type=float, default=20.0, help="length in s (default: 20)")
    parser.add_argument(
        "--margin", metavar="X", type=float, default=0.2, help="share of every limit left (default: 0.2)"
    )
    parser.add_argument(
        "--speed", metavar="RAD_S", type=float, help="steady rotor speed (default: a quarter of the limit)"
    )
    parser.add_argument(
        "--limit", metavar="INPUT=TORQUE", action="append", default=[],
        help="largest torque of an input that is no dynamometer's, N·m (default: that of the case's manoeuvre)",
    )  # fmt: skip
    parser.add_argument(
        "--beds", metavar="N", type=count(0), default=20, help="beds drawn that the limits hold on (default: 20)"
    )
    parser.add_argument("--seed", metavar="N", type=count(0), default=0, help="seed of phases and beds (default: 0)")
    parser.add_argument("--out", metavar="DIR", required=True, help="directory to write to")


def run_excite(arguments: argparse.Namespace) -> dict[str, Any]:
    """Plan and write files; the result object is the content of ``excite.json``."""
    from matching.bed.excite import excitation_csv, plan_excitation
    from matching.export import tuned_case
    from matching.report.bed import excitation
    from matching.report.common import image
    from modelling.writing import strict_json, write_all

    case = tuned_case(arguments.case).tuned
    plan = plan_excitation(case, _order(arguments))
    result = plan.to_dict()
    files: dict[str, str | bytes] = {
        "excite.json": strict_json(result), "excitation.csv": excitation_csv(plan),
        "figures/excitation.svg": image(excitation(plan)),
    }  # fmt: skip
    write_all(arguments.out, files)
    return result


def check_excite(arguments: argparse.Namespace) -> dict[str, str]:
    """For ``--check``: whether the wishes can be met; names no further file."""
    from matching.bed.excite import check_order
    from matching.export import tuned_case

    check_order(tuned_case(arguments.case).tuned, _order(arguments))
    return {}


def _order(arguments: argparse.Namespace) -> ExcitationOrder:
    from matching.bed.excite import ExcitationOrder

    return ExcitationOrder(
        arguments.duration, arguments.margin, arguments.speed, _limits(arguments.limit), arguments.beds, arguments.seed
    )


def _limits(entries: list[str]) -> dict[str, float]:
    from modelling.errors import InputError
    from modelling.units import to_si

    limits = {}
    for entry in entries:
        name, equals, value = entry.partition("=")
        if not equals:
            raise InputError(f"--limit {entry}", "is no pair", "write INPUT=TORQUE, e.g. motor_torque=150")
        try:
            limits[name] = float(value)
        except ValueError:
            limits[name] = to_si(value, "N*m", f"--limit {entry}")
        if not limits[name] > 0:
            raise InputError(f"--limit {entry}", "is not possible", "a torque greater than 0 is needed")
    return limits


def excite_summary(result: dict[str, Any]) -> str:
    """What is expected of the recording, in a few lines."""
    from matching.report.bed import excitation_summary as words

    return words(result)


# --- `rigmatch explore`: models, cases, recordings, budgets in the browser.

EXPLORE_HELP = """\
Open files in the browser: the drivetrain to click and change, modes and responses that follow a slider,
matches, recordings, budgets. FILE is a model, a case, a recording, a budget or a fidelity case; without any the starter
case is opened, as `rigmatch new` writes it to DIR. The page is served to this machine only, at an address with a secret
in it, until Ctrl-C. Files are changed only by Save; results are written to DIR."""
EXPLORE_EXAMPLES = (
    "rigmatch explore examples/road_to_rig/case.toml",
    "rigmatch explore examples/from_recordings/rig.toml examples/from_recordings/bed.csv --no-browser",
)


def add_explore_arguments(parser: argparse.ArgumentParser) -> None:
    """Files to open, place to write to."""
    from matching.progress import count

    parser.add_argument("files", metavar="FILE", nargs="*", help="model, case, recording, budget or fidelity case")
    parser.add_argument(
        "--out", metavar="DIR", default="out/explore", help="directory for results (default: %(default)s)"
    )
    parser.add_argument("--port", metavar="N", type=count(0), default=0, help="port to serve at (default: a free one)")
    parser.add_argument("--no-browser", action="store_true", help="print the address and open no browser")


def run_explore(arguments: argparse.Namespace) -> dict[str, Any]:
    """Serve the page until it is interrupted; the result object says where it was."""
    import signal
    import sys
    import webbrowser
    from pathlib import Path

    from matching.explore.files import opened, required_packages, starter

    required_packages()
    workspace = opened(arguments.files or [starter(Path(arguments.out))], arguments.out)
    print("preparing the page …", file=sys.stderr, flush=True)

    from bokeh.settings import settings

    from matching.explore.page import page, serve

    settings.resources = "server"  # the page needs no internet, whatever BOKEH_RESOURCES says
    interrupt = signal.getsignal(signal.SIGINT)
    server, address = serve(lambda: page(workspace), workspace.out, arguments.port)
    signal.signal(signal.SIGINT, interrupt)  # with Panel's own the command would end as if it had answered
    print(f"{address}\nCtrl-C ends it", file=sys.stderr, flush=True)
    if not arguments.no_browser:
        server.io_loop.add_callback(webbrowser.open, address)
    server.start()
    try:
        server.io_loop.start()
    finally:
        server.stop()
    return {"address": address}


# --- `rigmatch export`: the tuned residual vehicle, the whole controller, or any model, as an FMU.

EXPORT_HELP = """\
Write the tuned residual vehicle as an FMU for co-simulation: C by CasADi, compiled for this platform where
there is a C compiler, with its sources for others. RESULT is the directory that rigmatch match wrote, its result.json,
or a case file (then with the start values of its [move]); a model file is written as it is. Every quantity is a
parameter that can be set, named and in SI as in the model.

With --controller the whole controller is written instead: residual vehicle, feed-forward, observer, prediction, limits,
speed hold and watchdogs, sampled as it was tuned. Its C sources (controller.h, controller.c, controller_data.h) run on
a real-time system without FMI."""

VERSIONS = ("2.0", "3.0")
EXPORT_EXAMPLES = (
    "rigmatch export out/road_to_rig --fmu out/residual_vehicle.fmu",
    "rigmatch export out/road_to_rig --controller out/controller.fmu",
)


def add_export_arguments(parser: argparse.ArgumentParser) -> None:
    """What to export, where to, and which version of FMI."""
    parser.add_argument(
        "result", metavar="RESULT", help="directory or result.json of a match, case file, or model file"
    )
    what = parser.add_mutually_exclusive_group(required=True)
    what.add_argument("--fmu", metavar="FILE", help="FMU of the residual vehicle or model to write, NAME.fmu")
    what.add_argument("--controller", metavar="FILE", help="FMU of the whole controller to write, NAME.fmu")
    parser.add_argument("--fmi", choices=VERSIONS, default=VERSIONS[0], help="version of FMI (default: 2.0)")


def run_export(arguments: argparse.Namespace) -> dict[str, Any]:
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


# --- `rigmatch fidelity CASE`: partial and total XiL fidelity, its uncertainty and its causes.

FIDELITY_HELP = (
    "Judge how faithfully a test bed reproduces a manoeuvre: partial fidelities of system dynamics, residual vehicle "
    "model and measurement, their total R_XiL with its uncertainty, and which causes reduce it; write fidelity.json, "
    "the table, figures and the page fidelity.html. Recordings that the case names may be CSV, MDF, .mat or Parquet."
)
FIDELITY_EXAMPLES = (
    "rigmatch fidelity examples/fidelity/tab2.toml --out out/fidelity",
    "rigmatch fidelity examples/fidelity/tab2.toml --arithmetic published --out out/fidelity",
)
FIDELITY_PAGE = "fidelity.html"  # in the folder of --out


def add_fidelity_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the command."""
    parser.add_argument("case", metavar="CASE", help="fidelity case (TOML)")
    parser.add_argument("--channels", metavar="FILE", help="what the signals are called in the recordings (TOML)")
    parser.add_argument("--out", default=".", metavar="DIR", help="where files go (default: here)")
    parser.add_argument(
        "--arithmetic",
        choices=("definition", "published"),
        help="how partial fidelities combine (default: as the case says, else definition)",
    )
    parser.add_argument("--nrmse", choices=("definition", "literal"), help="form of Eq. 18 (default: as the case says)")
    parser.add_argument("--seed", type=int, default=1, help="seed of the Monte Carlo uncertainty (default: 1)")
    parser.add_argument("--draws", type=int, default=20_000, help="number of its draws (default: 20000)")


def run_fidelity(arguments: argparse.Namespace) -> dict[str, Any]:
    """Judge and write; returns the object of ``fidelity.json``."""
    from matching.fidelity import read_case, xil_fidelity
    from matching.report import common, evidence
    from matching.report.common import made_from
    from matching.report.evidence import fidelity_page
    from modelling.errors import InputError
    from modelling.recordings.read import read_channels
    from modelling.writing import write_results

    if not 100 <= arguments.draws <= 10**7:
        raise InputError("--draws", f"{arguments.draws} is out of range", "give a number in 100 ... 1e7")
    if arguments.seed < 0:
        raise InputError("--seed", f"{arguments.seed} is negative", "give 0 or more")
    channels = read_channels(arguments.channels) if arguments.channels else None
    judged = read_case(arguments.case, arguments.arithmetic, arguments.nrmse, channels)
    fidelity = xil_fidelity(*judged, arguments.draws, arguments.seed)
    answer = fidelity.to_dict()
    figures = {"delay": evidence.delay_curve(fidelity)}
    if fidelity.attribution is not None:
        figures["attribution"] = evidence.attribution_figure(fidelity)
    if fidelity.bands:
        figures["bands"] = evidence.bands_figure(fidelity)
    images = {name: common.image(figure) for name, figure in figures.items()}
    files: dict[str, str | bytes] = {f"{name}.svg": content for name, content in images.items()}
    files["fidelity.txt"] = evidence.fidelity_summary(answer)
    files["fidelity.html"] = fidelity_page(fidelity, figures, images, made_from(arguments.case, arguments.seed))
    return write_results(arguments.out, "fidelity.json", answer, files)


def fidelity_summary(answer: dict[str, Any]) -> str:
    """The answer for a reader, see :func:`matching.report.evidence.fidelity_summary`."""
    from matching.report.evidence import fidelity_summary

    return fidelity_summary(answer)


# --- `rigmatch identify`: a case known from recordings of its vehicle and its bed.

IDENTIFY_HELP = """\
Find out from recordings what vehicle and bed really are, and write the case with these values and, under
[uncertainty], with what is still not known of them. A recording of the vehicle holds the torques that act on it and any
of its sensors (tip-ins, coast-downs); a torque that the road alone gives may be missing. One of the bed is made without
emulation (rigmatch excite plans it) and holds the torque commands and the sensors of the rig. What vehicle and rig
share is the same hardware; its values are taken from the bed first. rigmatch match then tunes the case that is written.
CASE is a case file, or the directory of a match."""
IDENTIFY_EXAMPLES = (
    "rigmatch identify examples/from_recordings/case.toml --vehicle examples/from_recordings/road.csv "
    "--bed examples/from_recordings/bed.csv --out out/identify",
    "rigmatch identify examples/from_recordings/case.toml --bed examples/from_recordings/bed.csv --out out/bed_alone",
)


def add_identify_arguments(parser: argparse.ArgumentParser) -> None:
    """Case, recordings, output directory."""
    from matching.progress import seconds

    parser.add_argument("case", metavar="CASE", help="case file (TOML), or the directory of a match")
    parser.add_argument("--vehicle", metavar="RECORDING", nargs="+", default=[], help="of the vehicle on the road")
    parser.add_argument("--bed", metavar="RECORDING", nargs="+", default=[], help="of the bed without emulation")
    parser.add_argument(
        "--diagnosis-limit", type=seconds, metavar="SECONDS",
        help="a diagnosis that takes longer ends with the best it has, and says so (default: no limit)",
    )  # fmt: skip
    parser.add_argument("--out", metavar="DIR", required=True, help="directory to write to")


def run_identify(arguments: argparse.Namespace) -> dict[str, Any]:
    """Identify and write files; the result object is the content of ``identification.json``."""
    from pathlib import Path

    from matching.bed.identify import identify
    from matching.export import tuned_case
    from matching.progress import steps
    from modelling.writing import write_all

    case = tuned_case(arguments.case).tuned
    vehicle, bed = ([Path(name) for name in names] for names in (arguments.vehicle, arguments.bed))
    with steps("identify") as step:
        known = identify(case, vehicle, bed, step, arguments.diagnosis_limit)
    write_all(arguments.out, known.files())
    return known.to_dict()


def check_identify(arguments: argparse.Namespace) -> dict[str, str]:
    """For ``--check``: what the recordings hold, by file."""
    from pathlib import Path

    from matching.bed.identify import recordings_read
    from matching.export import tuned_case

    vehicle, bed = ([Path(name) for name in names] for names in (arguments.vehicle, arguments.bed))
    return recordings_read(tuned_case(arguments.case).tuned, vehicle, bed)


def identify_summary(result: dict[str, Any]) -> str:
    """What the recordings say, a few lines each."""
    from matching.report.bed import identification_lines

    return "\n".join(
        f"{name}: {line}" for name, part in result.items() if part is not None for line in identification_lines(part)
    )


# --- `rigmatch map`: the response error that a match reaches, over two quantities.

MAP_HELP = """Match the case at every pair of values of two quantities and draw the response error that is reached. A
quantity is named as in [move] of the case, or is one of the loop, e.g. loop.dead_time; it may carry its range and the
number of values, or all of them: loop.dead_time=0.001:0.008:6 or "loop.dead_time=1 ms,2 ms,5 ms". Mirror images get
the same value. Every point is then solved again from its neighbours' solutions until none improves. Writes map.json,
report.html, map.svg and map.png. Points are kept in map.partial.jsonl as they come; a map that was stopped continues
from them."""
MAP_PAGE = "report.html"  # in the folder of --out
MAP_EXAMPLES = (
    "rigmatch map examples/road_to_rig/case.toml --x loop.dead_time=1ms:8ms:4 "
    "--y rig.shafts.flange_left.stiffness=1e5:4e5:3 --out out/map",
    'rigmatch map examples/road_to_rig/case.toml --x "loop.dead_time=1 ms,2 ms,5 ms" --y loop.inverter_lag --starts 1 '
    "--out out/map_of_lags",
)


def add_map_arguments(parser: argparse.ArgumentParser) -> None:
    """Case file, both quantities, output directory, and effort."""
    from matching.progress import completed, count, scale_out

    parser.add_argument("case", metavar="CASE", help="case file (TOML)")
    for name in ("x", "y"):
        axis = parser.add_argument(
            f"--{name}", metavar="QUANTITY", required=True, help="QUANTITY[=LOW:HIGH[:N]] or QUANTITY=VALUE,VALUE,…"
        )
        completed(axis, _quantities_map)
    parser.add_argument("--out", metavar="DIR", required=True, help="directory to write to")
    parser.add_argument(
        "--seed", metavar="N", type=count(0), default=0, help="seed of the starting points (default: 0)"
    )
    parser.add_argument("--starts", metavar="N", type=count(1), default=2, help="starting points a match (default: 2)")
    scale_out(parser)


def _quantities_map(arguments: argparse.Namespace) -> list[str]:
    from matching.cli import quantities_of_case

    return quantities_of_case(arguments.case)


def run_map(arguments: argparse.Namespace) -> dict[str, Any]:
    """Draw the map; the result object is the content of ``map.json``."""
    from pathlib import Path

    from matching.match.case_file import load_case
    from matching.match.map import axis, map_case
    from matching.progress import progress
    from matching.report.common import image, provenance
    from matching.report.studies import map_figure, map_page
    from matching.worker_pool import executor_of
    from modelling.resources import cores
    from modelling.writing import write_results

    case = load_case(arguments.case)
    x, y = (axis(case, getattr(arguments, name), f"--{name}") for name in ("x", "y"))
    record = Path(arguments.out) / "map.partial.jsonl"
    with (
        executor_of(arguments.workers or cores(), arguments.scheduler) as executor,
        progress("map") as advance,
    ):
        study = map_case(
            case, x, y, executor, seed=arguments.seed, starts=arguments.starts, record=record, progress=advance
        )
    result = study.to_dict()
    drawn = map_figure(study)
    files: dict[str, str | bytes] = {f"map.{kind}": image(drawn, kind) for kind in ("svg", "png")}
    files["report.html"] = map_page(study, image(drawn), provenance(case, arguments.seed))
    written = write_results(arguments.out, "map.json", result, files)
    record.unlink(missing_ok=True)
    return written


def map_summary(result: dict[str, Any]) -> str:
    """The best point, how many match, and how many were improved from their neighbours' solutions."""
    from matching.report.common import amount, counted, number

    points = [point for point in result["points"] if point["error"] is not None]
    matched = [point for point in points if point["status"] == "matched"]
    lines = [f"{len(matched)} of {len(result['points'])} points matched"]
    if points:
        best = min(matched or points, key=lambda point: point["error"])
        place = ", ".join(f"{result[key]['name']} {amount(best[key], result[key]['unit'])}" for key in ("x", "y"))
        lines.append(f"least error {number(best['error'], 3)} at {place} ({best['status']})")
    better = [point for point in points if point["objective"] != point["objective_from_own_starts"]]
    if better:
        lines.append(f"{counted(len(better), 'point')} improved from their neighbours' solutions")
    return "\n".join(lines)


# --- `rigmatch match`: tune loop, residual vehicle and adapters until the rig reproduces the vehicle's response.

MATCH_HELP = """Tune the quantities under [move] of the case until the rig reproduces the vehicle's response, check the
result by methods other than those of the tuning, and write result.json, report.html, figures, and the tuned model
files (case.toml, vehicle.toml, rig.toml, residual_vehicle*.toml), which rigmatch reads again. Where the targets
cannot be met the status is "limited" and the limits name the reasons."""
BEDS_OF_FEEDBACK = 40  # drawn beds that judge a feedback law unless asked otherwise; they take about two seconds
MATCH_PAGE = "report.html"  # in the folder of --out
MATCH_EXAMPLES = (
    "rigmatch match examples/road_to_rig/case.toml --out out/match",
    "rigmatch match examples/compact_bev/case.toml --seed 3 --starts 20 --workers 2 --out out/compact",
    "rigmatch match examples/road_to_rig/observer.toml --beds 2000 --out out/observer",
)


def add_match_arguments(parser: argparse.ArgumentParser) -> None:
    """Case file, output directory, and effort of the search."""
    from matching.progress import count

    parser.add_argument("case", metavar="CASE", help="case file (TOML)")
    parser.add_argument("--out", metavar="DIR", required=True, help="directory to write to")
    parser.add_argument(
        "--seed", metavar="N", type=count(0), default=0, help="seed of the starting points (default: 0)"
    )
    parser.add_argument("--starts", metavar="N", type=count(1), help="largest number of starting points (default: 14)")
    parser.add_argument("--workers", metavar="N", type=count(1), help="processes (default: one a core)")
    parser.add_argument(
        "--beds",
        metavar="N",
        type=count(1),
        help="fresh beds drawn from [uncertainty] that judge the result (default: 200 of an observer, else 40)",
    )


def run_match(arguments: argparse.Namespace) -> dict[str, Any]:
    """Match and write files; the result object is the content of ``result.json``."""
    from matching.match.case_file import case_files, load_case
    from matching.match.match import match
    from matching.progress import OF_A_MATCH, steps
    from matching.worker_pool import beside
    from modelling.resources import cores
    from modelling.writing import check_inputs_kept, write_results

    case, workers = load_case(arguments.case), arguments.workers or cores()
    check_inputs_kept(arguments.out, case_files(case))  # before the work
    beds = arguments.beds
    if beds is None and not case.loop.structure.is_observer:
        beds = BEDS_OF_FEEDBACK
    effort = {} if arguments.starts is None else {"starts": arguments.starts}
    with beside(workers) as aside:
        aside.prepare("matching.report.match", "matching.report.curves", "bokeh.plotting")
        with steps("match", OF_A_MATCH) as tell:
            matched = match(case, arguments.seed, progress=tell, workers=workers, beds=beds, aside=aside, **effort)
        result, files = _written(matched, arguments.seed, aside)
    return write_results(arguments.out, "result.json", result, files)


def _written(matched: Any, seed: int, aside: Any) -> tuple[dict[str, Any], dict[str, str | bytes]]:
    """Result and files by name; the static figures are drawn by the other process."""
    from matching.match.case_file import case_files
    from matching.report.common import provenance
    from matching.report.curves import curve_data, moving_figures
    from matching.report.match import content, drawn_figures, page

    pictures = aside.begin(drawn_figures, matched)
    made = provenance(matched.case, seed)
    result, curves = content(matched) | {"made_by": made.to_dict()}, curve_data(matched)
    acting = moving_figures(matched)
    drawn = pictures.result()
    files: dict[str, str | bytes] = {"report.html": page(matched, drawn, made, acting, curves)}
    return result, files | {f"figures/{name}.svg": image for name, image in drawn.items()} | case_files(matched.tuned)


def match_summary(result: dict[str, Any]) -> str:
    """The result in at most twenty lines."""
    from matching.report.match import summary as words

    return words(result)


# --- `rigmatch modes`: modes of a model with energy shares and symmetry.

MODES_HELP = """Modes of a model: frequencies, where the kinetic and the potential energy sits, left/right symmetry.
Undamped unless --damped; of more than 300 degrees of freedom the lowest 100. Writes modes.json, and with --out the
figures modes.svg (frequencies and shares of the first modes) and energy_shares.svg (all shares)."""
MODES_EXAMPLES = (
    "rigmatch modes examples/road_to_rig/vehicle.toml --out out/modes",
    'rigmatch modes examples/road_to_rig/rig.toml --damped --change "inertias.rotor_left.J=1.8 kg*m^2" --out out/rig',
)


def add_modes_arguments(parser: argparse.ArgumentParser) -> None:
    """Model file, kind of modes, place to write to."""
    from matching.progress import completed

    parser.add_argument("model", metavar="MODEL", help="model file (TOML)")
    parser.add_argument("--damped", action="store_true", help="damped modes with damping ratios")
    parser.add_argument(
        "--reduced", action="store_true", help="also give values reduced to the model's reference shaft"
    )
    change = parser.add_argument(
        "--change",
        metavar="NAME=VALUE",
        action="append",
        default=[],
        help="what a new value does to the frequencies: first-order prediction (Eq. 8) beside the exact solution; "
        'e.g. --change "inertias.rotor_left.J=1.8 kg*m^2", may be repeated',
    )
    completed(change, _parameters)
    parser.add_argument("--out", metavar="DIR", help="directory to write to (default: here, without figures)")


def _parameters(arguments: argparse.Namespace) -> list[str]:
    from matching.cli import parameters_of_model

    return [f"{name}=" for name in parameters_of_model(arguments.model)]


def run_modes(arguments: argparse.Namespace) -> dict[str, Any]:
    """Find the modes and write files; the result object is the content of ``modes.json``."""
    from modelling.errors import InputError
    from modelling.model_file import load
    from modelling.writing import write_results

    system = load(arguments.model)
    try:
        changes = _changes(arguments.change, system)
        analysed = _modes(system, arguments.damped)
        result = analysed.to_dict()
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
    title = system.title or str(arguments.model)
    files = _figures(analysed, title) if arguments.out is not None else {}
    return write_results(arguments.out or ".", "modes.json", result, files)


def check_modes(arguments: argparse.Namespace) -> dict[str, str]:
    """For ``--check``: whether the quantities to change exist; names no further file."""
    from modelling.model_file import load

    _changes(arguments.change, load(arguments.model))
    return {}


def _modes(system: System, damped: bool) -> Modes:
    """Only what is asked for is imported: the answer comes while one waits for it."""
    if damped:
        from modelling.modal.modes import damped_modes

        return damped_modes(system)
    from modelling.modal.modes import modes

    return modes(system)


def _add_reduced(result: dict[str, Any], system: System, analysed: Modes) -> None:
    from modelling.modal.modes import reduced, reduced_values, speed_ratios

    result["reference"] = system.reference
    result["reduced"] = reduced_values(system)
    at_reference = reduced(analysed, speed_ratios(system))
    for entry, mass, stiffness in zip(result["modes"], at_reference.modal_mass, at_reference.modal_stiffness):
        entry |= {"modal_mass": float(mass), "modal_stiffness": float(stiffness)}


def _figures(analysed: Modes, title: str) -> dict[str, str | bytes]:
    from matching.report.common import VEHICLE, image
    from matching.report.modes import Column, energy_figure, shares_figure

    return {
        "modes.svg": image(energy_figure([Column(title, VEHICLE, analysed)])),
        "energy_shares.svg": image(shares_figure(analysed, title)),
    }


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
    from matching.report.common import aligned
    from matching.report.modes import mode_table

    lines = [aligned(mode_table(result["modes"]))]
    if "degrees_of_freedom" in result:
        lines += ["", f"the lowest {len(result['modes'])} of {result['degrees_of_freedom']} modes"]
    if "what_if" in result:
        rows = [
            {
                "mode": str(row["number"]),
                "now [Hz]": f"{row['frequency']:.4g}",
                "Eq. 8 [Hz]": f"{row['predicted']:.4g}",
                "Eq. 8": f"{100 * row['predicted_change']:+.1f} %",
                "exact [Hz]": f"{row['exact']:.4g}",
                "exact": f"{100 * row['exact_change']:+.1f} %",
            }
            for row in result["what_if"]["modes"]
        ]
        lines += [
            "",
            "with the changes (Eq. 8 is a first-order prediction; the exact solution is the true value):",
            aligned(rows),
        ]
    if "reduced" in result:
        lines += ["", f"reduced to {result['reference']}:"]
        lines += [f"  {name:40} {value:.5g}" for name, value in result["reduced"].items() if value]
    return "\n".join(lines)


# --- `rigmatch new`: write a commented case to start from.

NEW_HELP = """Write a vehicle, a rig and a case that run as they are, every key with a comment, into a new or empty
directory. Nothing is overwritten."""
NEW_EXAMPLES = (
    "rigmatch new my_bed",
    "rigmatch new bench/electric_drive",
)


def add_new_arguments(parser: argparse.ArgumentParser) -> None:
    """The directory."""
    parser.add_argument("directory", metavar="DIR", help="directory to make")


def run_new(arguments: argparse.Namespace) -> dict[str, Any]:
    """Write the files; the result object names them."""
    from importlib.resources import files
    from pathlib import Path

    from modelling.errors import InputError
    from modelling.writing import write_all

    target = Path(arguments.directory)
    if target.is_dir() and any(target.iterdir()):
        raise InputError(str(target), "is not empty", "name a new or an empty directory")
    if target.exists() and not target.is_dir():
        raise InputError(str(target), "is a file", "name a new or an empty directory")
    starter = {part.name: part.read_text(encoding="utf-8") for part in files("matching").joinpath("starter").iterdir()}
    write_all(target, dict(sorted(starter.items())))
    return {"directory": str(target), "files": sorted(starter)}


def new_summary(result: dict[str, Any]) -> str:
    """What to do next."""
    here = result["directory"]
    return f"{here}: {', '.join(result['files'])}\nnext: rigmatch match {here}/case.toml --out {here}/out"


# --- `rigmatch show`: a model, or vehicle and rig of a case, as a drawing; the channels of a recording as a list.

SHOW_HELP = """\
Draw a drivetrain as engineers do: inertias as discs, shafts as springs with dampers, gears, differentials,
dynamometers and sensors. FILE is a model file, or a case file: then the vehicle is drawn above its rig, with the cut in
both. Writes drivetrain.svg and drivetrain.png. Of a recording, its channels are listed with units, samples and ranges;
with --model, a channel file that fits the model is written, to be checked before use."""
SHOW_EXAMPLES = (
    "rigmatch show examples/road_to_rig/vehicle.toml --out out/drawing",
    "rigmatch show examples/road_to_rig/case.toml --out out/drawing",
    "rigmatch show examples/from_recordings/road.csv --model examples/from_recordings/vehicle.toml --out out/channels",
)


def add_show_arguments(parser: argparse.ArgumentParser) -> None:
    """Model, case or measurement file, a model for the channels, place to write to."""
    parser.add_argument("file", metavar="FILE", help="model or case file (TOML), or a recording")
    parser.add_argument("--model", metavar="MODEL", help="of a recording: write a channel file for this model")
    parser.add_argument("--out", metavar="DIR", default=".", help="directory to write to (default: here)")


def run_show(arguments: argparse.Namespace) -> dict[str, Any]:
    """Draw and write, or list; the result object says what was drawn, or which channels there are."""
    from modelling.errors import InputError
    from modelling.recordings.readers import READERS

    if Path(arguments.file).suffix.lower() in READERS:
        return _listed(arguments)
    if arguments.model:
        raise InputError("--model", f"{arguments.file} is no recording", f"one ends in {', '.join(READERS)}")
    return _drawn(arguments)


def _listed(arguments: argparse.Namespace) -> dict[str, Any]:
    from matching.explore.common import channel_list
    from modelling.escape import file_name
    from modelling.model_file import load
    from modelling.writing import write_all

    listed = channel_list(arguments.file, load(arguments.model) if arguments.model else None)
    files = []
    if arguments.model:
        files = [f"{file_name(Path(arguments.file).stem)}_channels.toml"]
        write_all(arguments.out, {files[0]: listed["channel_file"]})
    return {"file": arguments.file, **listed, "files": files}


def _drawn(arguments: argparse.Namespace) -> dict[str, Any]:
    from matching.match.case_file import is_case, load_case
    from matching.report.common import image
    from matching.report.drivetrain import case_figure, model_figure
    from modelling.model_file import load
    from modelling.toml import read_toml
    from modelling.writing import write_all

    if is_case(read_toml(arguments.file)):
        case = load_case(arguments.file)
        drawn, systems = case_figure(case), {"vehicle": case.vehicle, "rig": case.rig}
    else:
        system = load(arguments.file)
        drawn, systems = model_figure(system), {"model": system}
    write_all(arguments.out, {f"drivetrain.{kind}": image(drawn, kind) for kind in ("svg", "png")})
    counts = {
        role: {"title": system.title, "inertias": len(system.inertias), "shafts": len(system.shafts)}
        for role, system in systems.items()
    }
    return {"file": arguments.file, "drawn": counts, "files": ["drivetrain.png", "drivetrain.svg"]}


def show_summary(result: dict[str, Any]) -> str:
    """What was drawn or listed, and what was written."""
    from matching.report.common import aligned, counted

    written = [f"written: {', '.join(result['files'])}"] if result["files"] else []
    if "channels" in result:
        rows = [{head: _cell(value) for head, value in row.items()} for row in result["channels"]]
        notes = [f"note: {note}" for note in result["notes"]]
        parts = [aligned(rows), *notes, *([result["channel_file"].rstrip()] if result["channel_file"] else [])]
        return "\n".join([*parts, *written])

    lines = [
        f"{role}: {counted(counts['inertias'], 'inertia')}, {counted(counts['shafts'], 'shaft')}"
        + (f" ({counts['title']})" if counts["title"] else "")
        for role, counts in result["drawn"].items()
    ]
    return "\n".join([*lines, *written])


def _cell(value: str | float | None) -> str:
    return "-" if value is None or value == "" else f"{value:.6g}" if isinstance(value, float) else str(value)


# --- `rigmatch simulate`: run a model on recorded inputs.

SIMULATE_HELP = """\
Simulates a model on the inputs of a recording, all its effects included. Writes simulated.csv (time and every
sensor of the model, SI) and simulated.svg. Where the recording has sensors, the root mean square of the difference is
given for each, in the sensor's SI unit and as a share of its range. The steps of the integration are chosen so that no
reading is wrong by more than --tolerance of its range."""

SMALLEST_TOLERANCE = 1e-9  # below, rounding decides
STARTS = ("recorded", "rest", "steady")
SIMULATE_EXAMPLES = (
    "rigmatch simulate examples/from_recordings/rig.toml examples/from_recordings/bed.csv --out out/simulated",
    "rigmatch simulate examples/from_recordings/rig.toml examples/from_recordings/bed.csv --start steady "
    "--out out/from_steady_motion",
)


def add_simulate_arguments(parser: argparse.ArgumentParser) -> None:
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


def run_simulate(arguments: argparse.Namespace) -> dict[str, Any]:
    """Simulate and write files; the result object holds what was run, and the misfit by sensor."""
    from matching.report.common import image, simulation_figure
    from modelling.equations.casadi_code import compiled
    from modelling.errors import InputError
    from modelling.model_file import load
    from modelling.recordings.read import csv_text, read_channels, read_recording
    from modelling.simulation.simulate import check_speed_units, recorded_start, simulate, with_stick_speed
    from modelling.simulation.stepping import TOLERANCE
    from modelling.writing import write_all

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


def _misfit(simulated: np.ndarray, recorded: np.ndarray, unit: str) -> dict[str, Any]:
    """Root mean square of a sensor's difference (t,), and its share of the recorded range; None where that is 0."""
    import numpy as np

    there = np.isfinite(recorded)
    rms, spread = float(np.sqrt(np.mean((simulated - recorded)[there] ** 2))), float(np.ptp(recorded[there]))
    return {"rms": rms, "unit": unit, "of_range": rms / spread if spread else None}


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


# --- `rigmatch tolerance`: how tolerances of the bed spread a match.

TOLERANCE_HELP = """\
Draw the rig's quantities from the ranges in its file (and of --tolerance), keep the controller as it is,
and give the spread of modulus margin, loop modes and response error, the yield, and which quantities cause the
spread. CASE is the case.toml that a match wrote: its [move] start values are taken as tuned. Writes tolerance.json,
report.html and tolerance.svg; finished parts are kept in tolerance.partial.jsonl until the end: a study that was
stopped continues from them."""
TOLERANCE_PAGE = "report.html"  # in the folder of --out
TOLERANCE_EXAMPLES = (
    "rigmatch match examples/road_to_rig/case.toml --out out/match",
    'rigmatch tolerance out/match/case.toml -n 10000 --tolerance "rig.*.stiffness=0.05" --out out/tolerance',
    'rigmatch tolerance out/match/case.toml --tolerance "rig.inertias.*.J=0.02" --tolerance loop.dead_time=0.1 '
    "--out out/tolerance",
)


def add_tolerance_arguments(parser: argparse.ArgumentParser) -> None:
    """Case file, place to write to, what varies, and how many draws."""
    from matching.progress import completed, count, scale_out

    parser.add_argument("case", metavar="CASE", help="case file (TOML), as a match wrote it")
    parser.add_argument("--out", metavar="DIR", required=True, help="directory to write to")
    parser.add_argument("-n", "--draws", metavar="N", type=count(100), default=10_000, help="draws (default: 10000)")
    added = parser.add_argument(
        "--tolerance", metavar="NAME=SHARE", action="append", default=[],
        help="a further quantity of rig or loop and its relative tolerance, e.g. loop.dead_time=0.2, or many by "
        'a quoted pattern, e.g. "rig.*.stiffness=0.05"; repeatable',
    )  # fmt: skip
    completed(added, _quantities_tolerance)
    parser.add_argument("--seed", metavar="N", type=count(0), default=0, help="seed of the draws (default: 0)")
    scale_out(parser)


def _quantities_tolerance(arguments: argparse.Namespace) -> list[str]:
    """Quantities of rig and loop that may vary, as the command line names them."""
    from matching.cli import quantities_of_case

    return [f"{name}=" for name in quantities_of_case(arguments.case) if name.startswith(("rig.", "loop."))]


def run_tolerance(arguments: argparse.Namespace) -> dict[str, Any]:
    """Study and write; the result object is the content of ``tolerance.json``."""
    from pathlib import Path

    from matching.match.case_file import load_case
    from matching.match.tolerance import tolerance
    from matching.progress import progress
    from matching.report.common import image, provenance
    from matching.report.studies import plot_tolerance, tolerance_page
    from matching.worker_pool import executor_of
    from modelling.resources import cores
    from modelling.writing import write_results

    case = load_case(arguments.case)
    added = dict(_tolerance(text) for text in arguments.tolerance)
    record = Path(arguments.out) / "tolerance.partial.jsonl"
    with (
        executor_of(arguments.workers or cores(), arguments.scheduler) as executor,
        progress("tolerance") as advance,
    ):
        study = tolerance(
            case, arguments.draws, executor, seed=arguments.seed, added=added, record=record, progress=advance
        )
    result = study.to_dict()
    drawn = plot_tolerance(study)
    picture = image(drawn)
    report = tolerance_page(study, drawn, picture, provenance(case, arguments.seed))
    written = write_results(arguments.out, "tolerance.json", result, {"tolerance.svg": picture, "report.html": report})
    record.unlink(missing_ok=True)
    return written


def check_tolerance(arguments: argparse.Namespace) -> dict[str, str]:
    """For ``--check``: whether the study covers the case, and what varies exists; names no further file."""
    from matching.match.case_file import load_case
    from matching.match.tolerance import what_varies

    what_varies(load_case(arguments.case), dict(_tolerance(text) for text in arguments.tolerance))
    return {}


def tolerance_summary(result: dict[str, Any]) -> str:
    """Spread, yield and drivers in a few lines."""
    from matching.report.studies import summary as lines

    return lines(result)


def _tolerance(assignment: str) -> tuple[str, float]:
    from modelling.errors import InputError

    name, _, share = assignment.partition("=")
    try:
        return name.strip(), float(share)
    except ValueError:
        raise InputError("--tolerance", f"{assignment!r} is no NAME=SHARE", "write e.g. loop.dead_time=0.2") from None


# --- `rigmatch uncertainty BUDGET`: the budget, its result by propagation and by Monte Carlo, table and figures.

UNCERTAINTY_HELP = (
    "Evaluate a measurement uncertainty budget after the GUM: first and second order, degrees of freedom, Monte Carlo "
    "(JCGM 101) and the check of one by the other; write uncertainty.json, the budget table, figures and the page "
    "uncertainty.html."
)
UNCERTAINTY_EXAMPLES = (
    "rigmatch uncertainty examples/sensors/torque_M2.toml --out out/torque",
    'rigmatch uncertainty examples/sensors/torque_M2.toml --wanted "0.5 N*m" --out out/torque',
)
UNCERTAINTY_PAGE = "uncertainty.html"  # in the folder of --out


def add_uncertainty_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the command."""
    parser.add_argument("budget", metavar="BUDGET", help="budget file (TOML)")
    parser.add_argument("--out", default=".", metavar="DIR", help="where files go (default: here)")
    parser.add_argument(
        "--wanted",
        metavar="U",
        help='wanted expanded uncertainty, such as 0.5 or "0.5 N*m": tells which input must improve, and to what',
    )
    parser.add_argument("--seed", type=int, default=1, help="seed of the Monte Carlo method (default: 1)")
    parser.add_argument("--draws", type=int, help="number of draws (default: until the result is stable)")
    parser.add_argument(
        "--digits",
        type=int,
        default=2,
        choices=(1, 2, 3),
        help="significant digits of the uncertainty that must be stable (default: 2)",
    )


def run_uncertainty(arguments: argparse.Namespace) -> dict[str, Any]:
    """Evaluate and write; returns the object of ``uncertainty.json``."""
    from matching.report import common, evidence
    from matching.report.common import made_from
    from matching.report.evidence import uncertainty_page
    from matching.uncertainty.budget import read_budget
    from matching.uncertainty.evaluate import evaluate
    from modelling.errors import InputError
    from modelling.writing import file_stem, write_results

    if arguments.draws is not None and not 1000 <= arguments.draws <= 10**9:
        raise InputError("--draws", f"{arguments.draws} is out of range", "give a number in 1000 ... 1e9")
    if arguments.seed < 0:
        raise InputError("--seed", f"{arguments.seed} is negative", "give 0 or more")
    budget = read_budget(arguments.budget)
    uncertainty = evaluate(
        budget, seed=arguments.seed, draws=arguments.draws, digits=arguments.digits, wanted=arguments.wanted
    )
    answer = uncertainty.to_dict()
    files: dict[str, str | bytes] = {"uncertainty.txt": uncertainty_summary(answer)}
    prefixes: list[str] = []
    figures = {}
    for result in uncertainty.measurands:
        prefix = f"{file_stem(result.measurand.name)}_" if len(uncertainty.measurands) > 1 else ""
        if prefix in prefixes:
            prefix = f"{prefix}{len(prefixes) + 1}_"
        prefixes.append(prefix)
        figures[f"{prefix}contributions"] = evidence.contributions(result)
        figures[f"{prefix}ishikawa"] = evidence.ishikawa(result)
    images = {name: common.image(figure) for name, figure in figures.items()}
    files |= {f"{name}.svg": content for name, content in images.items()}
    files["uncertainty.html"] = uncertainty_page(
        uncertainty, figures, images, made_from(arguments.budget, arguments.seed)
    )
    return write_results(arguments.out, "uncertainty.json", answer, files)


def check_uncertainty(arguments: argparse.Namespace) -> dict[str, str]:
    """For ``--check``: whether the wanted uncertainty is one of the measurands'; names no further file."""
    from matching.uncertainty.budget import read_budget
    from matching.uncertainty.propagate import wanted_uncertainty

    budget = read_budget(arguments.budget)
    if arguments.wanted is not None:
        for measurand in budget.measurands:
            wanted_uncertainty(arguments.wanted, measurand, budget.where)
    return {}


def uncertainty_summary(answer: dict[str, Any]) -> str:
    """The answer for a reader, see :func:`matching.report.evidence.uncertainty_summary`."""
    from matching.report.evidence import uncertainty_summary

    return uncertainty_summary(answer)


# --- `rigmatch verify`: judge recordings of the controlled bed.

VERIFY_HELP = """Judge recordings of the controlled bed: frequency responses with their uncertainty, the response error,
frequency and damping of the target modes, and R_XiL, each beside vehicle and prediction. The answer is as_predicted,
short or undetermined. CASE is the directory that rigmatch match wrote, or a case file. A recording holds the compared
torques and sensors by name, and lasts four periods of the lowest frequency of the band or more. Where the bed falls
short and the recording holds the torque commands as well, a diagnosis of it says why."""
VERIFY_EXAMPLES = (
    "rigmatch export examples/from_recordings/bed.toml --fmu out/bed.fmu",
    "rigmatch commission examples/from_recordings/case.toml --bed out/bed.fmu --rounds 1 --out out/commissioned",
    "rigmatch verify out/commissioned/1_match out/commissioned/1_verify/recording.csv --out out/verify",
    "rigmatch verify out/commissioned/1_match out/commissioned/1_verify/recording.csv --follow 10 --out out/followed",
)
VERIFY_PAGE = "report.html"  # in the folder of --out


def add_verify_arguments(parser: argparse.ArgumentParser) -> None:
    """Match or case, recordings, output directory."""
    parser.add_argument("case", metavar="CASE", help="directory or result.json of a match, or a case file (TOML)")
    parser.add_argument(
        "recordings", metavar="RECORDING", nargs="+", help="recordings of the controlled bed (CSV, MDF, .mat, Parquet)"
    )
    parser.add_argument("--channels", metavar="FILE", help="what the signals are called in the recordings (TOML)")
    parser.add_argument(
        "--follow",
        type=seconds,
        metavar="SECONDS",
        help="judge again while the recordings grow, until none has grown for so long",
    )
    parser.add_argument("--out", metavar="DIR", required=True, help="directory to write to")


def run_verify(arguments: argparse.Namespace) -> dict[str, Any]:
    """Judge and write files; the result object is the content of ``verification.json``."""
    from matching.export import tuned_case
    from modelling.recordings.read import read_channels

    case = tuned_case(arguments.case).tuned
    channels = read_channels(arguments.channels) if arguments.channels else None
    if arguments.follow is None:
        return _judged(arguments, case, channels, arguments.recordings)
    return _followed(arguments, case, channels)


def _judged(
    arguments: argparse.Namespace, case: Case, channels: Mapping[str, Channel] | None, recordings: Sequence[str | Path]
) -> dict[str, Any]:
    """Judge recordings, or copies of those on the command line, and write files; diagnose them where they are short."""
    from matching.bed.commission import why_short
    from matching.bed.verify import judge, read_recordings
    from matching.progress import steps
    from matching.report.bed import curve_data, responses, verification_page
    from matching.report.common import image, made_from, with_recordings
    from matching.report.curves import acting
    from modelling.writing import write_results

    verification = judge(case, read_recordings(recordings, case, channels, arguments.recordings))
    result = verification.to_dict()
    if arguments.follow is None:  # nobody at the bed waits for minutes
        with steps("verify") as tell:
            reason = why_short(case, verification, recordings, channels, tell)
        result["diagnosis"] = None if reason is None else reason.to_dict()
    figure = responses(verification)
    drawn = {"responses": image(figure)}
    made = made_from(case.path, None, ("vehicle", "rig"))
    made = with_recordings(made, zip(arguments.recordings, recordings, strict=True))
    data = {"responses": curve_data(verification.curves)}
    files: dict[str, str | bytes] = {
        VERIFY_PAGE: verification_page(result, drawn, acting({"responses": figure}), made, data)
    }
    files |= {f"figures/{name}.svg": content for name, content in drawn.items()}
    return write_results(arguments.out, "verification.json", result, files)


def _followed(arguments: argparse.Namespace, case: Case, channels: Mapping[str, Channel] | None) -> dict[str, Any]:
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
                print(interim(result), file=sys.stderr, flush=True)
            except InputError as error:
                where = error.where
                for copy, name in zip(copies, arguments.recordings, strict=True):
                    where = where.replace(str(copy), name)
                wrong = InputError(where, error.wrong, error.right)
                print(f"not yet: {wrong}", file=sys.stderr, flush=True)
    if wrong is not None and result is not None:  # an answer that the files as they are do not give
        before = f"{arguments.out} holds what was judged before"
        raise InputError(wrong.where, wrong.wrong, "; ".join(filter(None, (wrong.right, before))))
    if result is None:
        raise wrong or InputError(arguments.recordings[0], "was never judged")
    return result


def verify_summary(result: dict[str, Any]) -> str:
    """The answer, errors, modes and fidelity in a few lines."""
    from matching.report.bed import verification_summary as words

    return words(result)


# --- The list of commands


@dataclass(frozen=True)
class Command:
    """A command of the terminal; it imports what computes when it runs, so that help is instant.

    Attributes
    ----------
    line : str
        One line of help.
    help : str
        A paragraph on what the command does.
    examples : tuple of str
        Two calls or more that work as typed, one after the other, in the program's folder after ``make run``.
    add_arguments : callable
        Its arguments, except ``--json`` and ``--traceback``, which every command has.
    run : callable
        Does it and writes files by :func:`modelling.writing.write_all`; returns the result object.
    summary : callable, optional
        The result for a reader at a terminal.
    check : callable, optional
        What ``--check`` reads next to model, case, budget and recordings, by file.
    page : str
        The report in the folder of ``--out``.
    """

    line: str
    help: str
    examples: tuple[str, ...]
    add_arguments: Callable[[argparse.ArgumentParser], None]
    run: Callable[[argparse.Namespace], dict[str, Any]]
    summary: Callable[[dict[str, Any]], str] | None = None
    check: Callable[[argparse.Namespace], dict[str, str]] | None = None
    page: str = ""


COMMANDS: dict[str, Command] = {
    "modes": Command(
        "modes of a model with energy shares and symmetry",
        MODES_HELP,
        MODES_EXAMPLES,
        add_modes_arguments,
        run_modes,
        modes_summary,
        check=check_modes,
    ),
    "show": Command(
        "drawing of a drivetrain, or of vehicle and rig of a case",
        SHOW_HELP,
        SHOW_EXAMPLES,
        add_show_arguments,
        run_show,
        show_summary,
    ),
    "match": Command(
        "tune loop, residual vehicle and adapters until the rig reproduces the vehicle's response",
        MATCH_HELP,
        MATCH_EXAMPLES,
        add_match_arguments,
        run_match,
        match_summary,
        page=MATCH_PAGE,
    ),
    "map": Command(
        "response error that a match reaches, over two quantities",
        MAP_HELP,
        MAP_EXAMPLES,
        add_map_arguments,
        run_map,
        map_summary,
        page=MAP_PAGE,
    ),
    "simulate": Command(
        "run a model on recorded inputs",
        SIMULATE_HELP,
        SIMULATE_EXAMPLES,
        add_simulate_arguments,
        run_simulate,
        simulate_summary,
    ),
    "diagnose": Command(
        "find what a model lacks, from recordings",
        DIAGNOSE_HELP,
        DIAGNOSE_EXAMPLES,
        add_diagnose_arguments,
        run_diagnose,
        diagnose_summary,
        page=DIAGNOSE_PAGE,
    ),
    "uncertainty": Command(
        "measurement uncertainty budget after the GUM",
        UNCERTAINTY_HELP,
        UNCERTAINTY_EXAMPLES,
        add_uncertainty_arguments,
        run_uncertainty,
        uncertainty_summary,
        check=check_uncertainty,
        page=UNCERTAINTY_PAGE,
    ),
    "fidelity": Command(
        "partial and total XiL fidelity",
        FIDELITY_HELP,
        FIDELITY_EXAMPLES,
        add_fidelity_arguments,
        run_fidelity,
        fidelity_summary,
        page=FIDELITY_PAGE,
    ),
    "tolerance": Command(
        "spread of a match over the tolerances of the bed",
        TOLERANCE_HELP,
        TOLERANCE_EXAMPLES,
        add_tolerance_arguments,
        run_tolerance,
        tolerance_summary,
        check=check_tolerance,
        page=TOLERANCE_PAGE,
    ),
    "excite": Command(
        "plan the recording that identifies what a match depends on",
        EXCITE_HELP,
        EXCITE_EXAMPLES,
        add_excite_arguments,
        run_excite,
        excite_summary,
        check=check_excite,
    ),
    "identify": Command(
        "vehicle and bed from recordings: a case with their values and uncertainties",
        IDENTIFY_HELP,
        IDENTIFY_EXAMPLES,
        add_identify_arguments,
        run_identify,
        identify_summary,
        check=check_identify,
    ),
    "verify": Command(
        "judge recordings of the controlled bed beside vehicle and prediction",
        VERIFY_HELP,
        VERIFY_EXAMPLES,
        add_verify_arguments,
        run_verify,
        verify_summary,
        page=VERIFY_PAGE,
    ),
    "commission": Command(
        "the whole way onto the bed: match, run, verify, excite, record, diagnose, match again",
        COMMISSION_HELP,
        COMMISSION_EXAMPLES,
        add_commission_arguments,
        run_commission,
        commission_summary,
        check=check_commission,
        page=COMMISSION_PAGE,
    ),
    "export": Command(
        "write the tuned residual vehicle as an FMU",
        EXPORT_HELP,
        EXPORT_EXAMPLES,
        add_export_arguments,
        run_export,
        export_summary,
    ),
    "explore": Command(
        "models, cases, recordings and budgets in the browser",
        EXPLORE_HELP,
        EXPLORE_EXAMPLES,
        add_explore_arguments,
        run_explore,
    ),
    "new": Command(
        "write a commented case to start from",
        NEW_HELP,
        NEW_EXAMPLES,
        add_new_arguments,
        run_new,
        new_summary,
    ),
}
