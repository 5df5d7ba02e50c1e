"""What the commands do, as functions: the same names, paths or loaded objects in, results out.

Every result has ``to_dict()`` (what the command writes as JSON), ``plot()`` and shows itself in a notebook.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import numpy as np
    from matplotlib.figure import Figure

    from matching.bed.commission import Commissioning, CommissionOrder
    from matching.bed.excite import ExcitationOrder, ExcitationPlan
    from matching.bed.identify import FromRecordings
    from matching.bed.verify import BedVerification
    from matching.diagnosis.result import Diagnosis
    from matching.explore.page import Explorer
    from matching.fidelity import XilFidelity
    from matching.match.case import Case
    from matching.match.map import Axis, Map
    from matching.match.result import MatchResult
    from matching.match.tolerance import Tolerance
    from matching.uncertainty.result import Uncertainty
    from modelling.linear.state_space import Response
    from modelling.modal.result import Modes
    from modelling.recordings.recording import Recording
    from modelling.simulation.stepping import Simulation
    from modelling.system import System


# --- What a file holds: models, cases, recordings, and their drawing.

File = str | PathLike[str]


def load(path: File) -> System:
    """Read a model file.

    Parameters
    ----------
    path : path
        A model file (TOML).

    Returns
    -------
    System
        The drivetrain as data, SI; it shows its equations in a notebook.

    Raises
    ------
    InputError
        One line: file, key, what is wrong, what would be right. So do all functions here.

    Examples
    --------
    >>> model = rm.load("examples/diagnosis/model.toml")
    >>> model.parameters["shafts.link.stiffness"].value  # N·m/rad
    380.0
    """
    from modelling.model_file import load as read

    return read(Path(path))


def load_case(path: File) -> Case:
    """Read a case file with all that it names.

    Parameters
    ----------
    path : path
        A case file (TOML) of ``rigmatch match``.

    Returns
    -------
    Case
        Vehicle, rig, loop and what may be tuned, SI.

    Raises
    ------
    InputError
        One line that names file and key.

    Examples
    --------
    >>> case = rm.load_case("examples/road_to_rig/case.toml")
    >>> case.loop["dead_time"]  # s
    0.003
    """
    from matching.match.case_file import load_case as read

    return read(Path(path))


def show(file: System | Case | File) -> Figure:
    """Draw the drivetrain of a model, or vehicle and rig of a case.

    Parameters
    ----------
    file : System, Case or path
        A model or a case.

    Returns
    -------
    Figure
        Of Matplotlib; ``savefig`` writes it as SVG, PNG or PDF.

    Raises
    ------
    InputError
        One line that names file and key.

    Examples
    --------
    >>> rm.show("examples/road_to_rig/case.toml").savefig("drivetrain.svg")
    """
    from matching.match.case import Case
    from matching.match.case_file import is_case
    from matching.report.drivetrain import case_figure, model_figure
    from modelling.toml import read_toml

    if isinstance(file, str | PathLike):
        file = load_case(file) if is_case(read_toml(Path(file))) else load(file)
    return case_figure(file) if isinstance(file, Case) else model_figure(file)


def read_recording(path: File, model: System | File, channels: File | None = None) -> Recording:
    r"""Read the channels of a model from CSV, MDF, ``.mat`` or Parquet.

    Parameters
    ----------
    path : path
        The recording.
    model : System or path
        Its inputs and sensors are the channels that are read.
    channels : path, optional
        A file that says what the channels are called there (:func:`modelling.recordings.read.read_channels`).

    Returns
    -------
    Recording
        Time (t,) in s and channels (t,) in SI by name.

    Raises
    ------
    InputError
        One line that names file, column or row.

    Examples
    --------
    >>> from pathlib import Path
    >>> rows = "time [s],motor_torque [N*m],motor_speed [1/min]\n0,10,0\n0.001,10,0.06\n0.002,10,0.12\n"
    >>> _ = Path("tip_in.csv").write_text(rows)
    >>> recording = rm.read_recording("tip_in.csv", "examples/diagnosis/model.toml")
    >>> recording.channels["motor_speed"].round(5).tolist()  # rad/s
    [0.0, 0.00628, 0.01257]
    """
    from modelling.recordings.read import read_channels
    from modelling.recordings.read import read_recording as read

    return read(Path(path), system_of(model), None if channels is None else read_channels(channels))


def system_of(model: System | File) -> System:
    """A model, read where a path stands for it; raises as :func:`load` does."""
    return load(model) if isinstance(model, str | PathLike) else model


def path_of(path: File | None) -> Path | None:
    """A path, where there is one."""
    return None if path is None else Path(path)


def case_of(case: Case | File) -> Case:
    """A case, read where a path stands for it; raises as :func:`load_case` does."""
    return load_case(case) if isinstance(case, str | PathLike) else case


def recording_of(recording: Recording | File, system: System, channels: File | None = None) -> Recording:
    """A recording, read where a path stands for it; raises as :func:`read_recording` does."""
    return read_recording(recording, system, channels) if isinstance(recording, str | PathLike) else recording


# --- What a drivetrain does: modes, frequency responses, motions.


def modes(model: System | File, values: Mapping[str, float] | None = None, *, damped: bool = False) -> Modes:
    """Modes with energy shares and symmetry (Eqs. 1–8 of the paper).

    Parameters
    ----------
    model : System or path
        A model.
    values : mapping of str to float, optional
        Replace those of the model by name, SI, e.g. ``{"shafts.link.stiffness": 400}``.
    damped : bool
        Modes with damping, at the operating point; else undamped.

    Returns
    -------
    Modes
        A sequence of modes, in order of frequency: ``frequency`` (Hz), ``damping_ratio``, ``kinetic`` and ``potential``
        energy shares by part, ``symmetry``.

    Raises
    ------
    InputError
        One line that names file and key.

    Examples
    --------
    >>> modes = rm.modes("examples/road_to_rig/vehicle.toml")
    >>> print(f"{modes[1].frequency:.3f} Hz, {modes[1].symmetry}")
    1.600 Hz, antisymmetric
    """
    from modelling.modal.modes import damped_modes
    from modelling.modal.modes import modes as undamped

    return (damped_modes if damped else undamped)(system_of(model), values)


def response(model: System | File, frequencies: np.ndarray) -> Response:
    """Frequency responses of all sensors to all inputs.

    Parameters
    ----------
    model : System or path
        A model.
    frequencies : ndarray (f,)
        Hz.

    Returns
    -------
    Response
        ``values`` (f, y, u), complex: the sensor's SI unit per N·m.

    Raises
    ------
    InputError
        One line that names file and key.

    Examples
    --------
    >>> import numpy as np
    >>> response = rm.response("examples/diagnosis/model.toml", np.array([1.0, 10.0, 50.0]))
    >>> response.values.shape  # frequencies, sensors, inputs
    (3, 3, 1)
    """
    from modelling.linear.state_space import response as of

    return of(system_of(model), frequencies)


def simulate(
    model: System | File,
    recording: Recording | File,
    *,
    channels: File | None = None,
    start: Any = "recorded",
    tolerance: float | None = None,
) -> Simulation:
    r"""The model's response to the inputs of a recording.

    Parameters
    ----------
    model : System or path
        A model.
    recording : Recording or path
        Its inputs vary linearly between the samples.
    channels : path, optional
        A file that says what the channels are called in the recording.
    start : "recorded", "rest", "steady", states by name or all states
        ``"recorded"``: estimated from the first quarter second of the recorded sensors, at rest if there are none;
        others as :func:`modelling.simulation.simulate.simulate` has them.
    tolerance : float, optional
        Largest error of the integration, as a share of each reading's range; by default 1e-4.

    Returns
    -------
    Simulation
        ``time`` (t,) in s, readings of all sensors (t,) by name, SI.

    Raises
    ------
    InputError
        One line that names file, key or column.
    SimulationError
        If a state is not finite.

    Examples
    --------
    >>> from pathlib import Path
    >>> rows = "\n".join(f"{k / 1000},{10 if k >= 100 else 0}" for k in range(500))
    >>> _ = Path("tip_in.csv").write_text("time [s],motor_torque [N*m]\n" + rows)
    >>> simulated = rm.simulate("examples/diagnosis/model.toml", "tip_in.csv", start="rest")
    >>> print(f"{simulated.readings['link_torque'].max():.1f} N·m")
    17.8 N·m
    """
    from modelling.equations.casadi_code import compiled
    from modelling.simulation.simulate import check_speed_units, recorded_start, with_stick_speed
    from modelling.simulation.simulate import simulate as run
    from modelling.simulation.stepping import TOLERANCE

    built = compiled(system_of(model))
    measured = recording_of(recording, built.system, channels)
    measured.check_continuous()
    check_speed_units(built, measured)
    inputs = measured.inputs(built.system)
    if isinstance(start, str) and start == "recorded":
        start = recorded_start(built, measured, with_stick_speed(built, measured.time, inputs, built.p0))
    return run(built, measured.time, inputs, start=start, tolerance=TOLERANCE if tolerance is None else tolerance)


# --- What measurements say: causes that a model lacks, measurement uncertainty, XiL fidelity.


def diagnose(
    model: System | File, recordings: Sequence[Recording | File] | Recording | File,
    holdout: Sequence[Recording | File] | Recording | File | None = None, *, channels: File | None = None,
    keep_rest: bool = False, tell: Callable[[str], None] | None = None,
) -> Diagnosis:  # fmt: skip
    """Find what a model lacks, from recordings: name the cause, extend the model, measure the gain.

    Parameters
    ----------
    model : System or path
        What is believed of the drivetrain; quantities with a range are fitted within it.
    recordings : Recording, path or a sequence of them
        What was measured.
    holdout : Recording, path or a sequence of them, optional
        Is never fitted and judges the result; by default the last 30 % of the recordings.
    channels : path, optional
        A file that says what the channels are called in the recordings.
    keep_rest : bool
        Whether the extended model keeps the torque that no cause explains as a table, where unseen data gain by it.
    tell : callable, optional
        Is called with a line of text at every step.

    Returns
    -------
    Diagnosis
        ``verdict`` is ``"adequate"``, ``"explained"`` or ``"unexplained"``; ``causes`` with parameters, standard
        uncertainties, confidence and evidence; ``extended`` is the extended model.

    Raises
    ------
    InputError
        One line that names file, key or column.

    Examples
    --------
    >>> found = rm.diagnose("examples/diagnosis/model.toml", "bench.csv")  # doctest: +SKIP
    >>> for cause in found.causes:  # doctest: +SKIP
    ...     print(cause.kind, cause.at, cause.evidence)
    """
    from matching.diagnosis.diagnose import diagnose as run
    from modelling.recordings.recording import Recording

    system = system_of(model)
    fitted, judging = (
        [what] if isinstance(what, str | PathLike | Recording) else list(what or ()) for what in (recordings, holdout)
    )
    read, judge = ([recording_of(each, system, channels) for each in some] for some in (fitted, judging))
    return run(system, read, judge, tell or (lambda _: None), keep_rest)


def uncertainty(budget: File, *, draws: int | None = None, seed: int = 0, digits: int = 2) -> Uncertainty:
    """Evaluate a measurement uncertainty budget after the GUM, first order and by Monte Carlo.

    Parameters
    ----------
    budget : path
        A budget file (TOML).
    draws : int, optional
        Of Monte Carlo; by default as many as make the result stable (JCGM 101, 7.9).
    seed : int
        Of the draws.
    digits : int
        Significant digits of the stated uncertainty.

    Returns
    -------
    Uncertainty
        For every measurand the complete result, the budget's table and the check of first order against Monte Carlo.

    Raises
    ------
    InputError
        One line that names file and key.

    Examples
    --------
    >>> budget = rm.uncertainty("examples/gum/end_gauge.toml", draws=10_000)
    >>> print(f"{budget.measurands[0].propagation.first_order * 1e9:.1f} nm")  # standard uncertainty, first order
    31.7 nm
    """
    from matching.uncertainty.budget import read_budget
    from matching.uncertainty.evaluate import evaluate

    return evaluate(read_budget(str(budget)), seed=seed, draws=draws, digits=digits)


def fidelity(
    case: File, *, channels: File | None = None, arithmetic: str | None = None, nrmse: str | None = None,
    draws: int = 20_000, seed: int = 1,
) -> XilFidelity:  # fmt: skip
    """Partial and total XiL fidelity of a fidelity case (Eqs. 13–23 of the paper).

    Parameters
    ----------
    case : path
        A fidelity case (TOML).
    channels : path, optional
        A file that says what the channels are called in the recordings.
    arithmetic : {"definition", "published"}, optional
        Replaces that of the file: the equations as defined, or as the paper's table was calculated.
    nrmse : {"definition", "literal"}, optional
        Form of Eq. 18; replaces that of the file.
    draws, seed : int
        Of Monte Carlo.

    Returns
    -------
    XilFidelity
        ``R_XiL`` (0 … 1), its parts, and their uncertainties.

    Raises
    ------
    InputError
        One line that names file and key.

    Examples
    --------
    >>> print(f"{rm.fidelity('examples/fidelity/tab2.toml').R_XiL:.3f}")
    0.885
    """
    from matching.fidelity import read_case, xil_fidelity
    from modelling.recordings.read import read_channels

    names = None if channels is None else read_channels(channels)
    return xil_fidelity(*read_case(str(case), arithmetic, nrmse, names), draws, seed)


# --- The explorer, from a program or a notebook.


def explore(*files: File, out: File = "out/explore", port: int = 0, browser: bool = False) -> Explorer:
    """Open models, cases, recordings, budgets in the browser, or inside a notebook as the last line of a cell.

    Parameters
    ----------
    files : paths
        What is opened; without any the starter case.
    out : path
        Folder for results.
    port : int
        To serve at; by default a free one.
    browser : bool
        Open the page in the browser at once.

    Returns
    -------
    Explorer
        ``address`` of the page, for this machine only; ``stop()`` ends it, ``wait()`` keeps a program alive. A notebook
        shows the page itself.

    Raises
    ------
    InputError
        If a file cannot be read, or the packages of the explorer are not installed.

    Examples
    --------
    >>> explorer = rm.explore("examples/road_to_rig/case.toml")  # doctest: +SKIP
    >>> explorer.stop()  # doctest: +SKIP
    """
    import webbrowser
    from pathlib import Path

    from matching.explore.files import opened, required_packages, starter

    required_packages()
    workspace = opened([str(file) for file in files] or [starter(Path(out))], str(out))
    from matching.explore.page import Explorer

    explorer = Explorer(workspace, port)
    if browser:
        webbrowser.open(explorer.address)
    return explorer


# --- What a tuned bed does: the controller as an FMU, excitation, recordings judged, the way round.


def export(result: File, fmu: File, fmi: str = "2.0") -> Path:
    """Write the tuned residual vehicle of a match, or any model, as an FMU for co-simulation.

    Parameters
    ----------
    result : path
        Directory or ``result.json`` of a match, a case file or a model file.
    fmu : path
        The file to write; ends in ``.fmu``.
    fmi : {"2.0", "3.0"}
        Version of the standard.

    Returns
    -------
    Path
        Of the FMU.

    Raises
    ------
    InputError
        One line that names file and key, or the name of the FMU.

    Examples
    --------
    >>> rm.export("examples/road_to_rig/case.toml", "residual_vehicle.fmu").name  # doctest: +LONG
    'residual_vehicle.fmu'
    """
    from matching.export import write

    write(str(result), str(fmu), fmi)
    return Path(fmu)


def excite(case: Case | File, order: ExcitationOrder | None = None) -> ExcitationPlan:
    """Plan the recording that identifies what a match depends on most, within the limits of the bed.

    Parameters
    ----------
    case : Case or path
        Tuned, or at its start values; a path is a directory or ``result.json`` of a match, or a case file.
    order : ExcitationOrder, optional
        Duration, margin, speed, largest torques.

    Returns
    -------
    ExcitationPlan
        Torques over time, the share of every limit that they use, and the uncertainties to expect.

    Raises
    ------
    InputError
        If the case lacks limits, nothing is uncertain, or a wish cannot be met.

    Examples
    --------
    >>> plan = rm.excite("out/road_to_rig")  # doctest: +SKIP
    >>> plan.error_after  # doctest: +SKIP
    """
    from matching.bed.excite import plan_excitation
    from matching.export import tuned_case

    return plan_excitation(tuned_case(Path(case)).tuned if isinstance(case, str | PathLike) else case, order)


def identify(case: Case | File, vehicle: Sequence[File] = (), bed: Sequence[File] = ()) -> FromRecordings:
    """Find out from recordings what vehicle and bed are: the case with their values and uncertainties.

    Parameters
    ----------
    case : Case or path
        A path is a directory or ``result.json`` of a match, or a case file.
    vehicle, bed : sequences of paths
        Recordings of the vehicle on the road, and of the bed without emulation.

    Returns
    -------
    FromRecordings
        The case, and what was diagnosed of bed and vehicle.

    Raises
    ------
    InputError
        One line that names file, key or column.

    Examples
    --------
    >>> known = rm.identify("case.toml", vehicle=["road.csv"], bed=["bed.csv"])  # doctest: +SKIP
    >>> rm.match(known.case).status  # doctest: +SKIP
    """
    from matching.bed import identify as from_recordings
    from matching.export import tuned_case

    known = tuned_case(Path(case)).tuned if isinstance(case, str | PathLike) else case
    return from_recordings.identify(known, [Path(path) for path in vehicle], [Path(path) for path in bed])


def verify(case: Case | File, *recordings: File, channels: File | None = None) -> BedVerification:
    """Judge recordings of the controlled bed beside vehicle and prediction.

    Parameters
    ----------
    case : Case or path
        Tuned; a path is a directory or ``result.json`` of a match, or a case file.
    recordings : paths
        They hold the compared torques and sensors.
    channels : path, optional
        A file that says what the signals are called in the recordings.

    Returns
    -------
    BedVerification
        Response errors with uncertainties, modes and fidelity of the bed, each beside its prediction.

    Raises
    ------
    InputError
        One line that names file, key or column.

    Examples
    --------
    >>> judged = rm.verify("out/road_to_rig", "bed_1.csv", "bed_2.csv")  # doctest: +SKIP
    >>> judged.status  # doctest: +SKIP
    """
    from matching.bed.verify import judge, read_recordings
    from matching.export import tuned_case
    from modelling.recordings.read import read_channels

    tuned = tuned_case(Path(case)).tuned if isinstance(case, str | PathLike) else case
    return judge(
        tuned,
        read_recordings(
            [Path(path) for path in recordings], tuned, None if channels is None else read_channels(channels)
        ),
    )


def commission(
    case: File, bed: File, out: File, order: CommissionOrder | None = None, *, tell: Callable[[str], None] | None = None
) -> Commissioning:
    """Go the whole way onto the bed: match, run, verify; excite, record, diagnose, match again.

    Parameters
    ----------
    case : path
        A case file, or the directory of a match.
    bed : path
        The FMU of a bed, or a folder that recordings are put into.
    out : path
        A folder a step is written there; called again, it goes on where it stopped.
    order : CommissionOrder, optional
        Rounds, excitation, seed, processes.
    tell : callable, optional
        Is given the name of each step.

    Returns
    -------
    Commissioning
        What each round found, and why it ended or what it waits for.

    Raises
    ------
    InputError
        One line that names what of case, bed or recording is not as it has to be.

    Examples
    --------
    >>> result = rm.commission("case.toml", "bed.fmu", "out/commission")  # doctest: +SKIP
    >>> result.status  # doctest: +SKIP
    """
    from matching.bed.commission import Circle, CommissionOrder

    circle = Circle(Path(out), Path(bed), order or CommissionOrder(), tell or (lambda _: None))
    return circle.run(Path(case))


# --- What a test bed can be tuned to: a match, over two quantities, over tolerances.


def match(
    case: Case | File, seed: int = 0, starts: int = 14, workers: int = 1,
    progress: Callable[[str], None] | None = None, *, beds: int | None = None,
) -> MatchResult:  # fmt: skip
    """Tune what the case lets move until the rig reproduces the vehicle's response, and verify the result.

    Parameters
    ----------
    case : Case or path
        A case.
    seed : int
        Of the random starts.
    starts : int
        How many starts the search tries; the first is the case's own.
    workers : int
        Processes that share the starts.
    progress : callable, optional
        Is called with a line of text at every step.
    beds : int, optional
        Fresh beds, drawn from the case's ``[uncertainty]``, that judge the result; 200 with an observer unless given,
        none with a feedback law.

    Returns
    -------
    MatchResult
        ``status`` is ``"matched"`` or ``"limited"``, ``limits`` says what stands in the way; ``targets``,
        ``parameters``, ``response_error`` and ``verification`` hold the figures; ``tuned`` is the tuned case.

    Raises
    ------
    InputError
        One line that names file and key, also where no stable solution exists.

    Examples
    --------
    >>> result = rm.match("examples/adapter_only/case.toml", starts=1)  # doctest: +LONG
    >>> result.status  # doctest: +LONG
    'limited'
    """
    from matching.match.match import match as run

    return run(case_of(case), seed, starts, progress, workers, beds=beds)


# more than six parameters: the options of the command
def map(  # noqa: A001
    case: Case | File, x: str | Axis, y: str | Axis, executor: Executor | None = None, *,
    seed: int = 0, starts: int = 2,
    workers: int | None = None, record: File | None = None, progress: Callable[[int, int], None] | None = None,
) -> Map:  # fmt: skip
    """The response error that a match reaches over two quantities.

    It runs on any ``concurrent.futures`` executor, that of a Dask cluster (``Client(…).get_executor()``) included, else
    on ``workers`` processes. Finished points are kept in ``record``, from which a map that was stopped continues.

    Parameters
    ----------
    case : Case or path
        A case.
    x, y : str or Axis
        ``NAME``, ``NAME=LOW:HIGH[:N]`` or ``NAME=VALUE,VALUE,…``; units as in the case file, SI where none is written.
    executor : Executor, optional
        Where the points are solved.
    seed, starts : int
        As of :func:`match`, for every point.
    workers : int, optional
        Processes where there is no executor; by default one a core.
    record : path, optional
        A file of finished points.
    progress : callable, optional
        Is called with the numbers of finished and of all points.

    Returns
    -------
    Map
        Response errors, margins and status of every point.

    Raises
    ------
    InputError
        One line that names the quantity, file or key.

    Examples
    --------
    >>> axes = "loop.dead_time=0.001:0.005:3", "rig.shafts.adapter_left.stiffness=2e4:1e5:3"
    >>> rm.map("examples/road_to_rig/case.toml", *axes).plot().savefig("map.svg")  # doctest: +SKIP
    """
    from matching.match.map import map_case

    return map_case(
        case_of(case),
        x,
        y,
        executor,
        seed=seed,
        starts=starts,
        workers=workers,
        record=path_of(record),
        progress=progress,
    )  # fmt: skip


# more than six parameters: the options of the command
def tolerance(
    case: Case | File, draws: int = 10_000, executor: Executor | None = None, *, seed: int = 0,
    added: Mapping[str, float] | None = None, workers: int | None = None, record: File | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> Tolerance:  # fmt: skip
    """Spread of margin, modes and response errors of a match over tolerances of the bed.

    Parameters
    ----------
    case : Case or path
        A tuned case, e.g. ``case.toml`` of a match's directory.
    draws : int
        How many beds are drawn.
    executor, workers, record, progress
        As of :func:`map`.
    seed : int
        Of the draws.
    added : mapping of str to float, optional
        Relative tolerances by name or pattern beside those of the model files, e.g. ``{"loop.dead_time": 0.2}``.

    Returns
    -------
    Tolerance
        Quantiles of every quantity, shares of the inputs in their spread, and the yield: the share of beds within
        limits.

    Raises
    ------
    InputError
        One line that names the quantity, file or key.

    Examples
    --------
    >>> case = "examples/road_to_rig/case.toml"
    >>> study = rm.tolerance(case, 200, added={"loop.dead_time": 0.2}, workers=1)  # doctest: +LONG
    >>> study.draws  # doctest: +LONG
    200
    """
    from contextlib import nullcontext

    from matching.match.tolerance import tolerance as run
    from matching.worker_pool import executor_of

    with nullcontext(executor) if executor else executor_of(workers) as pool:
        return run(case_of(case), draws, pool, seed=seed, added=added, record=path_of(record), progress=progress)
