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

    from matching.bed_test.result import BedVerification
    from matching.commissioning.circle import CommissionOrder
    from matching.diagnosis.verdict.result import Diagnosis
    from matching.excitation.plan import ExcitationOrder
    from matching.excitation.result import ExcitationPlan
    from matching.frequency.case.case import Case
    from matching.frequency.search.result import MatchResult
    from matching.frequency.studies.map import Map
    from matching.frequency.studies.map_axis import Axis
    from matching.frequency.studies.tolerance import Tolerance
    from matching.validity.fidelity.result import XilFidelity
    from matching.validity.uncertainty.result import Uncertainty
    from modelling.linear.response import Response
    from modelling.measurement.recording import Recording
    from modelling.modal.modes import Modes
    from modelling.model.system import System
    from modelling.simulation.result import Simulation

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
    from modelling.model.files import load as read

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
    from matching.frequency.case.load import load_case as read

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
    from matching.frequency.case.case import Case
    from matching.frequency.case.load import is_case
    from matching.report.drawing.figures import case_figure, model_figure
    from modelling.common.tables import read_toml

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
        A file that says what the channels are called there (:func:`modelling.measurement.channels.read_channels`).

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
    from modelling.measurement.channels import read_channels
    from modelling.measurement.read import read_recording as read

    return read(Path(path), _system(model), None if channels is None else read_channels(channels))


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
    from modelling.modal.damped_modes import damped_modes
    from modelling.modal.modes import modes as undamped

    return (damped_modes if damped else undamped)(_system(model), values)


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
    from modelling.linear.response import response as of

    return of(_system(model), frequencies)


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
    from modelling.equations.compiled import compiled
    from modelling.simulation.recorded_start import recorded_start
    from modelling.simulation.simulate import simulate as run
    from modelling.simulation.simulate import with_stick_speed
    from modelling.simulation.speed_units import check_speed_units
    from modelling.simulation.step_control import TOLERANCE

    built = compiled(_system(model))
    measured = _recording(recording, built.system, channels)
    measured.check_continuous()
    check_speed_units(built, measured)
    inputs = measured.inputs(built.system)
    if isinstance(start, str) and start == "recorded":
        start = recorded_start(built, measured, with_stick_speed(built, measured.time, inputs, built.p0))
    return run(built, measured.time, inputs, start=start, tolerance=TOLERANCE if tolerance is None else tolerance)


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
    from matching.frequency.search.match import match as run

    return run(_case(case), seed, starts, progress, workers, beds=beds)


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
    from matching.frequency.studies.map import map_case

    return map_case(
        _case(case), x, y, executor, seed=seed, starts=starts, workers=workers, record=_path(record), progress=progress
    )


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

    from matching.executors import executor_of
    from matching.frequency.studies.tolerance import tolerance as run

    with nullcontext(executor) if executor else executor_of(workers) as pool:
        return run(_case(case), draws, pool, seed=seed, added=added, record=_path(record), progress=progress)


def diagnose(
    model: System | File, recordings: Sequence[Recording | File] | Recording | File,
    holdout: Recording | File | None = None, *, channels: File | None = None, tell: Callable[[str], None] | None = None,
) -> Diagnosis:  # fmt: skip
    """Find what a model lacks, from recordings: name the cause, extend the model, measure the gain.

    Parameters
    ----------
    model : System or path
        What is believed of the drivetrain; quantities with a range are fitted within it.
    recordings : Recording, path or a sequence of them
        What was measured.
    holdout : Recording or path, optional
        Is never fitted and judges the result; by default the last 30 % of the recordings.
    channels : path, optional
        A file that says what the channels are called in the recordings.
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
    from matching.diagnosis.diagnosis import diagnose as run
    from modelling.measurement.recording import Recording

    system = _system(model)
    single = isinstance(recordings, str | PathLike | Recording)
    several = [recordings] if single else list(recordings)  # type: ignore[arg-type, list-item]
    read = [_recording(one, system, channels) for one in several]  # type: ignore[arg-type]
    judge = None if holdout is None else _recording(holdout, system, channels)
    return run(system, read, judge, tell or (lambda _: None))


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
    from matching.excitation.plan import plan_excitation
    from matching.fmu.export_source import tuned_case

    return plan_excitation(tuned_case(Path(case)).tuned if isinstance(case, str | PathLike) else case, order)


def commission(
    case: File, bed: File, out: File, order: CommissionOrder | None = None, *, tell: Callable[[str], None] | None = None
) -> dict[str, Any]:
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
    dict
        As ``commission.json`` holds it.

    Raises
    ------
    InputError
        One line that names what of case, bed or recording is not as it has to be.

    Examples
    --------
    >>> result = rm.commission("case.toml", "bed.fmu", "out/commission")  # doctest: +SKIP
    >>> result["status"]  # doctest: +SKIP
    """
    from matching.commissioning.circle import Circle, CommissionOrder

    circle = Circle(Path(out), Path(bed), order or CommissionOrder(), tell or (lambda _: None))
    return circle.run(Path(case))


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
    from matching.bed_test.judge import judge
    from matching.bed_test.recorded import read_recordings
    from matching.fmu.export_source import tuned_case
    from modelling.measurement.channels import read_channels

    tuned = tuned_case(Path(case)).tuned if isinstance(case, str | PathLike) else case
    return judge(
        tuned,
        read_recordings(
            [Path(path) for path in recordings], tuned, None if channels is None else read_channels(channels)
        ),
    )


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
    from matching.validity.budget.budget_file import read_budget
    from matching.validity.uncertainty.evaluate import evaluate

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
    from matching.validity.fidelity.case_file import read_case
    from matching.validity.fidelity.result import xil_fidelity
    from modelling.measurement.channels import read_channels

    names = None if channels is None else read_channels(channels)
    return xil_fidelity(*read_case(str(case), arithmetic, nrmse, names), draws, seed)


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
    from matching.fmu.write import write

    write(str(result), str(fmu), fmi)
    return Path(fmu)


def _system(model: System | File) -> System:
    return load(model) if isinstance(model, str | PathLike) else model


def _path(path: File | None) -> Path | None:
    return None if path is None else Path(path)


def _case(case: Case | File) -> Case:
    return load_case(case) if isinstance(case, str | PathLike) else case


def _recording(recording: Recording | File, system: System, channels: File | None = None) -> Recording:
    return read_recording(recording, system, channels) if isinstance(recording, str | PathLike) else recording
