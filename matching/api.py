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
    from matching.diagnosis.verdict.result import Diagnosis
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
    """A model file as a System, which shows its equations in a notebook.

    Raises
    ------
    InputError
        One line: file, key, what is wrong, what would be right. So do all functions here.
    """
    from modelling.model.files import load as read

    return read(Path(path))


def load_case(path: File) -> Case:
    """A case file with all that it names."""
    from matching.frequency.case.load import load_case as read

    return read(Path(path))


def show(file: System | Case | File) -> Figure:
    """The drivetrain of a model, or vehicle and rig of a case, as a Matplotlib figure."""
    from matching.frequency.case.case import Case
    from matching.frequency.case.load import is_case
    from matching.report.drawing.figures import case_figure, model_figure
    from modelling.common.tables import read_toml

    if isinstance(file, str | PathLike):
        file = load_case(file) if is_case(read_toml(Path(file))) else load(file)
    return case_figure(file) if isinstance(file, Case) else model_figure(file)


def read_recording(path: File, model: System | File, channels: File | None = None) -> Recording:
    """The channels of a model from CSV, MDF, ``.mat`` or Parquet, SI.

    Parameters
    ----------
    channels : path, optional
        A file that says what the channels are called there (:func:`modelling.measurement.channels.read_channels`).
    """
    from modelling.measurement.channels import read_channels
    from modelling.measurement.read import read_recording as read

    return read(Path(path), _system(model), None if channels is None else read_channels(channels))


def modes(model: System | File, values: Mapping[str, float] | None = None, *, damped: bool = False) -> Modes:
    """Modes with energy shares and symmetry (Eqs. 1–8); ``values`` (SI) replace those of the model, by name."""
    from modelling.modal.damped_modes import damped_modes
    from modelling.modal.modes import modes as undamped

    return (damped_modes if damped else undamped)(_system(model), values)


def response(model: System | File, frequencies: np.ndarray) -> Response:
    """Frequency responses (f, y, u) of all sensors to all inputs at frequencies (f,) in Hz."""
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
    """The model's response to the inputs of a recording.

    Parameters
    ----------
    channels : path, optional
        A file that says what the channels are called in the recording.
    start : "recorded", "rest", "steady", states by name or all states
        ``"recorded"``: estimated from the first quarter second of the recorded sensors, at rest if there are none;
        others as :func:`modelling.simulation.simulate.simulate` has them.
    tolerance : float, optional
        Largest error of the integration, as a share of each reading's range; by default 1e-4.
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
    case: Case | File, seed: int = 0, starts: int = 14, workers: int = 1, progress: Callable[[str], None] | None = None
) -> MatchResult:
    """Tune what the case lets move until the rig reproduces the vehicle's response, and verify the result.

    See :func:`matching.frequency.search.match.match`.
    """
    from matching.frequency.search.match import match as run

    return run(_case(case), seed, starts, progress, workers)


def map(  # noqa: A001
    case: Case | File, x: str | Axis, y: str | Axis, executor: Executor | None = None, *,
    seed: int = 0, starts: int = 2,
    workers: int | None = None, record: File | None = None, progress: Callable[[int, int], None] | None = None,
) -> Map:  # fmt: skip
    """The response error that a match reaches over two quantities.

    Each is ``NAME``, ``NAME=LOW:HIGH[:N]`` or ``NAME=VALUE,VALUE,…``.

    It runs on any ``concurrent.futures`` executor, that of a Dask cluster (``Client(…).get_executor()``) included, else
    on ``workers`` processes. Finished points are kept in ``record``, from which a map that was stopped continues. See
    :func:`matching.frequency.studies.map.map_case`.
    """
    from matching.frequency.studies.map import map_case

    return map_case(
        _case(case), x, y, executor, seed=seed, starts=starts, workers=workers, record=_path(record), progress=progress
    )


def tolerance(
    case: Case | File, draws: int = 10_000, executor: Executor | None = None, *, seed: int = 0,
    added: Mapping[str, float] | None = None, workers: int | None = None, record: File | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> Tolerance:  # fmt: skip
    """Spread of margin, modes and response errors of a match over tolerances of the bed.

    Executor, ``workers`` and ``record`` as for :func:`map`; see :func:`matching.frequency.studies.tolerance.tolerance`.
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
    """Find what a model lacks, from recordings; see :func:`matching.diagnosis.diagnosis.diagnose`."""
    from matching.diagnosis.diagnosis import diagnose as run
    from modelling.measurement.recording import Recording

    system = _system(model)
    single = isinstance(recordings, str | PathLike | Recording)
    several = [recordings] if single else list(recordings)  # type: ignore[arg-type, list-item]
    read = [_recording(one, system, channels) for one in several]  # type: ignore[arg-type]
    judge = None if holdout is None else _recording(holdout, system, channels)
    return run(system, read, judge, tell or (lambda _: None))


def verify(case: Case | File, *recordings: File, channels: File | None = None) -> BedVerification:
    """Recordings of the controlled bed beside vehicle and prediction, see :func:`matching.bed_test.judge.judge`.

    Parameters
    ----------
    case : Case or path
        Tuned; a path is a directory or ``result.json`` of a match, or a case file.
    recordings : paths
        They hold the compared torques and sensors.
    channels : path, optional
        A file that says what the signals are called in the recordings.
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
    """A budget file evaluated after the GUM, first order and by Monte Carlo."""
    from matching.validity.budget.budget_file import read_budget
    from matching.validity.uncertainty.evaluate import evaluate

    return evaluate(read_budget(str(budget)), seed=seed, draws=draws, digits=digits)


def fidelity(
    case: File, *, channels: File | None = None, arithmetic: str | None = None, nrmse: str | None = None,
    draws: int = 20_000, seed: int = 1,
) -> XilFidelity:  # fmt: skip
    """Partial and total XiL fidelity of a fidelity case (Eqs. 13–23); everything as the command has it."""
    from matching.validity.fidelity.case_file import read_case
    from matching.validity.fidelity.result import xil_fidelity
    from modelling.measurement.channels import read_channels

    names = None if channels is None else read_channels(channels)
    return xil_fidelity(*read_case(str(case), arithmetic, nrmse, names), draws, seed)


def export(result: File, fmu: File, fmi: str = "2.0") -> Path:
    """Write the tuned residual vehicle of a match, or any model, as an FMU for co-simulation; returns its path."""
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
