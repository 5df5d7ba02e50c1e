"""What the commands do, as functions: the same names, paths or loaded objects in, results out.

Every result has ``to_dict()`` (what the command writes as JSON), ``plot()`` and shows itself in a notebook. Wrong input
raises ``InputError``: one line with file and key, what is wrong, and what would be right.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import Executor
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from matching.dry_run import case_words, computing, model_words, was_read
from matching.progress import OF_A_COUNT, OF_A_MATCH, shown
from modelling.display import counted
from modelling.errors import InputError, unknown
from modelling.resources import cores

if TYPE_CHECKING:
    import numpy as np
    from matplotlib.figure import Figure

    from matching.bed.channels import ChannelCheck, ChannelPlan
    from matching.bed.commission import Commissioning, CommissionOrder
    from matching.bed.excite import ExcitationPlan
    from matching.bed.identify import FromRecordings
    from matching.bed.learn import Learned
    from matching.bed.proof import Proof
    from matching.bed.verify import BedVerification
    from matching.diagnosis.result import Diagnosis
    from matching.diagnosis.settings import DiagnosisSettings
    from matching.explore.page import Explorer
    from matching.fidelity import XilFidelity
    from matching.match.case import Case
    from matching.match.map import Axis, Map
    from matching.match.match import JudgeSettings
    from matching.match.result import MatchResult
    from matching.match.tolerance import Tolerance
    from matching.match.variables import SearchSettings
    from matching.saved import SavedCurves, SavedResult
    from matching.uncertainty.result import Uncertainty
    from modelling.bed.manoeuvres import Manoeuvre
    from modelling.linear.state_space import Response, StateSpace
    from modelling.modal.forced import CriticalSettings, OrderResponse
    from modelling.modal.orders import Campbell
    from modelling.modal.result import Modes
    from modelling.recordings.read import Channel
    from modelling.recordings.recording import Recording
    from modelling.simulation.stepping import Simulation
    from modelling.system import System

    Torques = Mapping[str, Manoeuvre]


# --- What a file holds: models, cases, recordings, and their drawing.

File = str | PathLike[str]
Kind = TypeVar("Kind")


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

    Examples
    --------
    >>> model = rm.load("examples/diagnosis/model.toml")
    >>> model.parameters["shafts.link.stiffness"].value  # N·m/rad
    380.0
    """
    from modelling.model_file import load as read

    system = read(Path(path))
    was_read(path, lambda: model_words(system) + "".join(f"\n  note: {note}" for note in system.doubts))
    return system


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

    Examples
    --------
    >>> case = rm.load_case("examples/road_to_rig/case.toml")
    >>> case.loop["dead_time"]  # s
    0.003
    """
    from matching.match.case_file import load_case as read

    case = read(Path(path))
    was_read(path, lambda: case_words(case))
    return case


def new(directory: File) -> list[Path]:
    """Write a commented case to start from, ready to run: vehicle, rig and case; a budget and a fidelity case.

    The folder schemas holds JSON schemas of model, case, budget, fidelity and channel files. An editor that knows TOML
    completes and checks a file by the schema that its first line names. Nothing is overwritten.

    Parameters
    ----------
    directory : path
        A new or an empty directory.

    Returns
    -------
    list of Path
        The files.

    Raises
    ------
    InputError
        If the directory is not empty.

    Examples
    --------
    >>> [path.name for path in rm.new("my_bed") if path.suffix == ".toml"]
    ['budget.toml', 'case.toml', 'fidelity.toml', 'rig.toml', 'vehicle.toml']
    """
    from matching.schemas import write_starter

    return write_starter(Path(directory))


def show(file: System | Case | File) -> Figure:
    """Draw the drivetrain of a model, or vehicle and rig of a case; or list a recording's channels.

    Inertias are discs, shafts are springs with dampers; gears, differentials, dynamometers and sensors have their
    symbols. Of a case, the vehicle is drawn above its rig, with the cut in both. The command writes drivetrain.svg and
    drivetrain.png. Of a recording it lists the channels with units, samples and ranges; with --model it writes a
    channel file for that model: check it before use.

    Parameters
    ----------
    file : System, Case or path
        Model or case file (TOML); on the command line also a recording.

    Returns
    -------
    Figure
        Of Matplotlib; ``savefig`` writes it as SVG, PNG or PDF.

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
    computing()
    return case_figure(file) if isinstance(file, Case) else model_figure(file)


def read_recording(path: File, model: System | File, channels: File | None = None) -> Recording:
    r"""Read the channels of a model from CSV, MDF, ``.mat`` or Parquet.

    Parameters
    ----------
    path : path
        The recording; files of several loggers joined by +.
    model : System or path
        Its inputs and sensors are the channels that are read.
    channels : path, optional
        A file that says what the channels are called there (:func:`modelling.recordings.read.read_channels`).

    Returns
    -------
    Recording
        Time (t,) in s and channels (t,) in SI by name.

    Examples
    --------
    >>> from pathlib import Path
    >>> rows = "time [s],motor_torque [N*m],motor_speed [1/min]\n0,10,0\n0.001,10,0.06\n0.002,10,0.12\n"
    >>> _ = Path("tip_in.csv").write_text(rows)
    >>> recording = rm.read_recording("tip_in.csv", "examples/diagnosis/model.toml")
    >>> recording.channels["motor_speed"].round(5).tolist()  # rad/s
    [0.0, 0.00628, 0.01257]
    """
    from matching.diagnosis.loggers import read_loggers
    from modelling.recordings.read import contents_of

    system = system_of(model)
    recording = read_loggers(str(path), system, channels_of(channels))
    was_read(path, lambda: contents_of(recording, system))
    return recording


def load_result(path: File) -> SavedResult | SavedCurves:
    """Read a result that a command or ``save`` wrote.

    Parameters
    ----------
    path : path
        Its folder, or the result's file in it (JSON; CSV of a simulation or a frequency response).

    Returns
    -------
    SavedResult or SavedCurves
        Every entry of the file as an attribute, as the result itself has them, with ``to_dict()``, ``to_dataframe()``,
        ``plot()`` and ``save()``; printed as the command prints it. Of a simulation or a frequency response every curve
        by its name. The tuned case of a match is ``rm.load_case(folder / "case.toml")``.

    Raises
    ------
    InputError
        If there is no result, or the folder holds several.

    Examples
    --------
    >>> folder = rm.modes("examples/road_to_rig/vehicle.toml").save("modes_of_vehicle")
    >>> saved = rm.load_result(folder)
    >>> print(f"{saved.modes[1].frequency:.3f} Hz, {saved.modes[1].symmetry}")
    1.600 Hz, antisymmetric
    """
    from matching.saved import load_result as read

    return read(Path(path))


def system_of(model: System | File) -> System:
    """A model, read where a path stands for it; raises as :func:`load` does."""
    from modelling.system import System as Drivetrain

    return load(model) if isinstance(model, str | PathLike) else _of_kind(model, Drivetrain, "model", "rm.load")


def in_one_gear(system: System) -> System:
    """A drivetrain with its gearboxes in the first gear, and a warning that says so; others as they are."""
    if not system.capacities:
        return system
    import warnings

    named = ", ".join(f"gearboxes.{box.name}" for box in system.gearboxes)
    warnings.warn(f"{named}: in gear 1, its clutch locked; System.in_gear(2) is the second gear", stacklevel=3)
    return system.in_gear(1)


def _of_kind(given: Any, kind: type[Kind], name: str, loader: str) -> Kind:
    """An argument that was not given as a path, if it is of its kind."""
    if not isinstance(given, kind):
        right = f"give a path, or what {loader} returns"
        raise InputError(name, f"{type(given).__name__} is no {kind.__name__}", right)
    return given


def in_si(value: float | str, unit: str, name: str, *, positive: bool = False) -> float:
    """An argument that is a quantity, a number in SI or a text such as "20 s"."""
    from modelling.units import in_unit, to_si

    number = to_si(value, unit, name)
    if positive and number <= 0:
        raise InputError(name, f"{value} is not possible", f"give a number above 0{in_unit(unit)}")
    return number


def channels_of(path: File | None) -> Mapping[str, Channel] | None:
    """What a channel file says, where there is one."""
    from modelling.recordings.read import read_channels

    if path is None:
        return None
    channels = read_channels(path)
    was_read(path, lambda: f"a channel file: {', '.join(channels)}")
    return channels


def path_of(path: File | None) -> Path | None:
    """A path, where there is one."""
    return None if path is None else Path(path)


def case_of(case: Case | File) -> Case:
    """A case, read where a path stands for it; raises as :func:`load_case` does."""
    from matching.match.case import Case as Read

    return load_case(case) if isinstance(case, str | PathLike) else _of_kind(case, Read, "case", "rm.load_case")


def tuned_case_of(case: Case | File) -> Case:
    """A tuned case; a path is a directory or ``result.json`` of a match, or a case file."""
    from matching.export import tuned_case

    if not isinstance(case, str | PathLike):
        return case_of(case)
    tuned = tuned_case(Path(case)).tuned
    was_read(case, lambda: case_words(tuned))
    return tuned


def _check_seed(seed: int) -> None:
    if not isinstance(seed, int) or isinstance(seed, bool):
        raise InputError("seed", f"{seed!r} is no whole number", "give 0 or more")
    if seed < 0:
        raise InputError("seed", f"{seed} is negative", "give 0 or more")


def same_file(one: Recording | File, other: Recording | File) -> bool:
    """Whether two arguments are the same recording."""
    if isinstance(one, str | PathLike) and isinstance(other, str | PathLike):
        return Path(one).exists() and Path(other).exists() and Path(one).samefile(other)
    return one is other


def _each(recordings: Any) -> list[Any]:
    """Recordings in a list, where one alone may stand for it."""
    from modelling.recordings.frames import is_frame
    from modelling.recordings.recording import Recording as Read

    if isinstance(recordings, str | PathLike | Read) or is_frame(recordings):
        return [recordings]
    return list(recordings or ())


def recording_of(recording: Recording | File, system: System, channels: File | None = None) -> Recording:
    """A recording, read where a path or a pandas DataFrame stands for it; raises as :func:`read_recording` does."""
    from modelling.recordings.frames import is_frame
    from modelling.recordings.read import recording_of_frame
    from modelling.recordings.recording import Recording as Read

    if isinstance(recording, str | PathLike):
        return read_recording(recording, system, channels)
    if is_frame(recording):
        return recording_of_frame(recording, system, channels_of(channels))
    if not isinstance(recording, Read):
        right = "give a path, a pandas DataFrame, or what rm.read_recording returns"
        raise InputError("recording", f"{type(recording).__name__} is no recording", right)
    return recording


# --- What a drivetrain does: modes, frequency responses, motions.


def modes(model: System | File, values: Mapping[str, float | str] | None = None, *, damped: bool = False) -> Modes:
    """Modes of a model: frequencies, energy shares, left/right symmetry (Eqs. 1–8 of the paper).

    The command answers gear by gear where the model has a gearbox; in Python it is gear 1, see ``System.in_gear``.
    Of more than 300 degrees of freedom the lowest 100 modes. The command writes modes.json and, with --out, modes.svg
    (frequencies and shares of the first modes) and energy_shares.svg (all shares).

    Parameters
    ----------
    model : System or path
        Model file (TOML).
    values : mapping of str to float or str, optional
        Replace those of the model by name, SI or with a unit, e.g. ``{"shafts.link.stiffness": "0.4 kN*m/rad"}``.
    damped : bool
        Damped modes with damping ratios, at the operating point; else undamped.

    Returns
    -------
    Modes
        A sequence of modes, in order of frequency: ``frequency`` (Hz), ``damping_ratio``, ``kinetic`` and ``potential``
        energy shares by part, ``symmetry``.

    Examples
    --------
    >>> modes = rm.modes("examples/road_to_rig/vehicle.toml")
    >>> print(f"{modes[1].frequency:.3f} Hz, {modes[1].symmetry}")
    1.600 Hz, antisymmetric
    """
    from modelling.modal.modes import damped_modes
    from modelling.modal.modes import modes as undamped

    system = in_one_gear(system_of(model))
    computing()
    return (damped_modes if damped else undamped)(system, None if values is None else system.in_si(values))


def response(model: System | File, frequencies: Sequence[float | str] | np.ndarray) -> Response:
    """Frequency responses of all sensors to all inputs.

    Parameters
    ----------
    model : System or path
        A model.
    frequencies : ndarray (f,), or sequence of float or str
        Hz, or with a unit, such as "2 Hz" or "600 1/min".

    Returns
    -------
    Response
        ``values`` (f, y, u), complex: the sensor's SI unit per N·m, or per pedal of a torque map.

    Examples
    --------
    >>> import numpy as np
    >>> response = rm.response("examples/diagnosis/model.toml", np.array([1.0, 10.0, 50.0]))
    >>> response.values.shape  # frequencies, sensors, inputs
    (3, 3, 1)
    """
    import numpy as np

    from modelling.linear.state_space import response as of

    hertz = [in_si(each, "Hz", "frequencies") if isinstance(each, str) else each for each in frequencies]
    return of(in_one_gear(system_of(model)), np.asarray(hertz, dtype=float))


def campbell(
    model: System | File, speed: str | np.ndarray, *, of: str | None = None, orders: str | Iterable[float] = "0.5,1,2,4"
) -> Campbell:
    """Campbell diagram: damped modes over speed, and where orders of a turning part meet them.

    Modes of a model that is not linear (tyre slip, say) are those of steady motion at each speed, followed by their
    shapes. The command writes campbell.json, a figure and report.html.

    Parameters
    ----------
    model : System or path
        A model file.
    speed : str or ndarray
        LOWEST:HIGHEST, or LOWEST:HIGHEST:POINTS, with a unit, e.g. "600:6000 1/min"; in Python also rad/s as an array.
    of : str, optional
        The inertia that has these speeds and whose turns orders count (default: that of the first input).
    orders : str or iterable of float
        Cycles a turn.

    Returns
    -------
    Campbell
        ``crossings`` with order, mode, speed (rad/s), and the frequencies (Hz) at which the mode rings and would ring
        undamped; ``speeds`` and ``frequencies``.

    Examples
    --------
    >>> found = rm.campbell("examples/engine/engine.toml", "600:6000 1/min", orders=[2, 4])
    >>> print(f"{found.crossings[0].speed:.1f} rad/s")
    86.4 rad/s
    """
    from modelling.modal.orders import campbell as find
    from modelling.modal.orders import check_orders, checked_speeds

    system = in_one_gear(system_of(model))
    of = of or _first_driven(system)
    given = [in_si(one, "1", "orders") for one in (orders.split(",") if isinstance(orders, str) else orders)]
    speeds = checked_speeds(system, of, _speeds(speed))
    check_orders(given)
    computing()
    return find(system, speeds, of, given)


def order_response(
    model: System | File, speed: str | np.ndarray, torques: Mapping[str, Any], *, of: str | None = None,
    phases: Mapping[str, float | str] | None = None, load: float | str | None = None,
    settings: CriticalSettings | None = None,
) -> OrderResponse:  # fmt: skip
    """Forced response to orders: torque of every shaft and angle of every inertia over speed; critical speeds.

    Linear about the steady motion at every speed. The command writes response.json, response.csv, a figure and
    report.html.

    Parameters
    ----------
    model : System or path
        A model file.
    speed : str or ndarray
        As in campbell.
    torques : mapping of str to float, str or function
        Amplitude (N·m) by input and order, e.g. --torques "engine_torque:2=100"; or a table over speed, and over load
        where it has one, e.g. "engine_torque:2=order_2.csv" with the columns speed, torque, phase and load; or a
        formula in rpm (1/min) and load (a share), e.g. "engine_torque:2=load*(100 + rpm/50)". An input that imposes a
        speed or an angle takes rad/s or rad. In Python also a function of speeds in rad/s.
    of : str, optional
        As in campbell.
    phases : mapping of str to float or str
        Phase (rad, or "30 deg") by input and order; 0 unless stated.
    load : float or str, optional
        At which tables and formulas over load are taken, e.g. "80 %".
    settings : CriticalSettings, optional
        Numbers by which a speed is called critical.

    Returns
    -------
    OrderResponse
        ``critical`` with shaft, speed (rad/s), torque (N·m), order and mode; ``largest`` of every shaft with its
        peak-to-peak and fatigue torque; ``torques`` and ``angles`` by order.

    Examples
    --------
    >>> found = rm.order_response("examples/engine/engine.toml", "600:6000 1/min", {"engine_torque:2": 150})
    >>> worst = max(found.largest, key=lambda one: one.torque)
    >>> print(f"{worst.shaft}: {worst.torque:.0f} N·m")
    crank: 118 N·m
    """
    from modelling.modal.forced import check_acting
    from modelling.modal.forced import order_response as find
    from modelling.modal.orders import checked_speeds

    system, phases = in_one_gear(system_of(model)), phases or {}
    speeds = checked_speeds(system, of or _first_driven(system), _speeds(speed))
    for name in phases:
        if name not in torques:
            raise unknown(name, list(torques), "phases")
    named: dict[tuple[str, float], Any] = {}
    for name in torques:
        source, colon, order = name.rpartition(":")
        if not colon:
            raise InputError("torques", f"{name!r} has no order", "write INPUT:ORDER=TORQUE, e.g. engine_torque:2=100")
        named[source, in_si(order, "1", f"torques {name}")] = name
    check_acting(system, named)
    acting = {
        (source, order): _amplitude(torques[name], name, system.input_units[source], phases.get(name, 0.0), load)
        for (source, order), name in named.items()
    }
    over_load = (isinstance(one, str) and (_is_table(one) or "load" in _names_of(one)) for one in torques.values())
    if load is not None and not any(over_load):
        raise InputError(
            "load", "no torque over load is named", 'name one, e.g. --torques "engine_torque:2=order_2.csv"'
        )
    for each in acting.values():
        if callable(each):
            each(speeds)  # what a table does not cover is told before anything is computed
    computing()
    return find(system, speeds, of or _first_driven(system), acting, settings)


OF_FORMULA = ("rpm", "load")  # what a torque may be a formula of: speed in 1/min, load as a share


def _names_of(stated: str) -> set[str]:
    return set(re.findall(r"[A-Za-z_]\w*", stated))


def _formula(stated: str, where: str, load: float | None) -> Callable[[np.ndarray], np.ndarray]:
    """A torque (SI) as a function of speeds (rad/s), from its formula."""
    import numpy as np
    import sympy

    from matching.uncertainty.budget import parse_formula

    expression = parse_formula(stated, OF_FORMULA, where)
    rpm, share = (sympy.Symbol(name, real=True) for name in OF_FORMULA)
    if share in expression.free_symbols and load is None:
        raise InputError("load", f"{stated!r} is a formula over load", 'state one, e.g. --load "80 %"')
    found = sympy.lambdify((rpm, share), expression, "numpy")

    def torque(speeds: np.ndarray) -> np.ndarray:
        with np.errstate(all="ignore"):
            values = np.broadcast_to(np.asarray(found(speeds * 30 / np.pi, load), complex), np.shape(speeds))
        if not np.isfinite(values).all():
            at = 30 / np.pi * float(speeds[~np.isfinite(values)][0])
            raise InputError(where, f"{stated!r} has no value at {at:.4g} 1/min", "check the formula")
        return values

    return torque


def _is_table(stated: str) -> bool:
    return Path(stated).suffix.lower() in (".csv", ".txt", ".parquet", ".mat")


def _amplitude(stated: Any, name: str, unit: str, phase: float | str, load: float | str | None) -> Any:
    """Of an order, complex, or a function of speeds (rad/s) that gives it."""
    import numpy as np

    from modelling.recordings.torque_table import torque_table

    turned = np.exp(1j * in_si(phase, "rad", f"phases {name}"))
    if isinstance(stated, str) and _is_table(stated):
        table = torque_table(Path(stated), unit, None if load is None else in_si(load, "1", "load"))
        return lambda speeds: turned * table(speeds)
    if isinstance(stated, str) and not _names_of(stated).isdisjoint(OF_FORMULA):
        formula = _formula(stated, f"torques {name}", None if load is None else in_si(load, "1", "load"))
        return lambda speeds: turned * formula(speeds)
    if callable(stated):
        return lambda speeds: turned * np.asarray(stated(speeds), complex)
    return complex(in_si(stated, unit, f"torques {name}") * turned)


def _first_driven(system: System) -> str:
    if not system.inputs:
        raise InputError("of", "the model has no input whose inertia could be taken", "name the inertia")
    return system.inputs[0].on


def _speeds(stated: str | np.ndarray) -> np.ndarray:
    """Speeds (s,) in rad/s from LOWEST:HIGHEST[:POINTS], whose unit stands behind any of them and holds for both."""
    import numpy as np

    from modelling.modal.orders import POINTS

    if isinstance(stated, np.ndarray):
        return stated.astype(float)
    right = 'write LOWEST:HIGHEST with a unit, e.g. "600:6000 1/min" or "60:600 rad/s"'
    if not isinstance(stated, str):
        raise InputError("speed", f"{stated!r} has no unit", f"{right}; or give an array in rad/s")
    parts = [_number_and_unit(part.strip()) for part in stated.split(":")]
    units = [unit for _, unit in parts if unit]
    numbers = [number for number, _ in parts]
    if len(parts) not in (2, 3):
        raise InputError("speed", f"{stated!r} is no range", right)
    if not units:
        raise InputError("speed", f"{stated!r} has no unit", right)
    points = numbers[2] if len(parts) == 3 else str(POINTS)
    if not points.isdecimal() or int(points) < 2:
        raise InputError("speed", f"{points!r} is no number of speeds", "give 2 or more")
    low, high = (in_si(f"{number} {own or units[0]}", "rad/s", "speed") for number, own in parts[:2])
    if not 0 < low < high:
        raise InputError("speed", f"{stated!r} does not rise from above 0", "give the lowest speed first")
    return np.linspace(low, high, int(points))


def _number_and_unit(text: str) -> tuple[str, str]:
    """A number and what stands behind it, with a blank between them or without: ``6000rpm``."""
    number = re.match(r"[-+.,\d]*(?:[eE][-+]?\d+)?", text)
    end = number.end() if number else 0
    return text[:end], text[end:].strip()


def to_ss(of: System | Case | MatchResult | File, part: str = "") -> StateSpace:
    """Linear state space, for example for python-control or SciPy.

    Parameters
    ----------
    of : System, Case, MatchResult or path
        A drivetrain, or a case: of a match its tuned one, of a path ``out/case.toml``.
    part : {"vehicle", "rig", "bed", "controller"}
        Of a case. ``bed`` and ``controller`` are of the controller's sample time, with the dead time as states, and are
        closed by their names.

    Returns
    -------
    StateSpace
        ``A`` (x, x), ``B`` (x, u), ``C`` (y, x), ``D`` (y, u) in SI, ``inputs`` and ``outputs`` by name, and
        ``sample_time``, s, 0 in continuous time. Angles that nothing depends on are left out.

    Raises
    ------
    InputError
        If the part is unknown, or a model has a dead time of its own.

    Examples
    --------
    >>> rig = rm.to_ss("examples/road_to_rig/rig.toml")
    >>> rig.A.shape, rig.inputs
    ((13, 13), ('motor_torque', 'dyno_left', 'dyno_right'))
    >>> control.ss(rig.A, rig.B, rig.C, rig.D, inputs=rig.inputs, outputs=rig.outputs)  # doctest: +SKIP
    """
    from matching.match.case import Case
    from matching.match.case_file import is_case
    from matching.match.loop import bed_space, controller_space
    from matching.match.result import MatchResult
    from modelling.linear.state_space import state_space
    from modelling.system import System
    from modelling.toml import read_toml

    if isinstance(of, MatchResult):
        of = of.tuned
    if not isinstance(of, System | Case):
        of = load_case(of) if is_case(read_toml(Path(of))) else load(of)
    if isinstance(of, System):
        if part:
            raise InputError("part", f"{part!r} of a model", "leave it out, or give a case")
        return state_space(in_one_gear(of))
    case = of
    parts = {
        "vehicle": lambda: state_space(case.vehicle), "rig": lambda: state_space(case.rig),
        "bed": lambda: bed_space(case), "controller": lambda: controller_space(case),
    }  # fmt: skip
    if part not in parts:
        raise unknown(part, list(parts), "part")
    return parts[part]()


def simulate(
    model: System | File,
    recording: Recording | File | Torques,
    *,
    channels: File | None = None,
    start: Any = "recorded",
    tolerance: float = 1e-4,
) -> Simulation:
    r"""Run a model on the inputs of a recording, with all its effects.

    Inputs vary linearly between the samples. The steps of the integration are chosen so that no reading is wrong by
    more than the tolerance. The command writes simulated.csv (time and every sensor of the model, SI) and
    simulated.svg, and states the root mean square of the difference from each recorded sensor.

    Parameters
    ----------
    model : System or path
        Model file (TOML).
    recording : Recording, path, DataFrame, or mapping of input to manoeuvre
        Recording (CSV, MDF, .mat or Parquet). In Python also a pandas DataFrame, or torques of inputs as manoeuvres,
        such as ``{"motor_torque": rm.TipIn(amplitude=100)}``; other inputs are 0 and it starts at rest.
    channels : path, optional
        File that says what the channels are called in the recording (TOML).
    start : {"recorded", "rest", "steady"}, states by name or all states
        Start state: estimated from the first quarter second of the recorded sensors (at rest if there are none), at
        rest, or in steady motion under the first inputs.
    tolerance : float
        Largest error of the integration, as a share of each reading's range.

    Returns
    -------
    Simulation
        ``time`` (t,) in s, readings of all sensors (t,) by name, SI.

    Raises
    ------
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
    from dataclasses import replace

    from modelling.equations.casadi_code import compiled
    from modelling.simulation.engagements import engagements
    from modelling.simulation.simulate import check_speed_units, recorded_start, undetermined_note, with_stick_speed
    from modelling.simulation.simulate import simulate as run

    system = system_of(model)
    if isinstance(recording, Mapping):
        from modelling.bed.manoeuvres import driven

        recording, start = driven(system, recording), "rest" if start == "recorded" else start
    measured = recording_of(recording, system, channels)
    computing()
    built = compiled(system)
    measured.check_continuous()
    check_speed_units(built, measured)
    inputs = measured.inputs(built.system)
    notes = built.system.doubts
    if isinstance(start, str) and start == "recorded":
        start = recorded_start(built, measured, with_stick_speed(built, measured.time, inputs, built.p0))
        notes += [undetermined_note(start.undetermined)] if start.undetermined else []
    done = run(built, measured.time, inputs, start=start, tolerance=tolerance)
    return replace(done, notes=[*notes, *engagements(built, done)])


# --- What measurements say: causes that a model lacks, measurement uncertainty, XiL fidelity.


def diagnose(
    model: System | File, recordings: Sequence[Recording | File] | Recording | File,
    holdout: Sequence[Recording | File] | Recording | File | None = None, *, channels: File | None = None,
    keep_rest: bool = False, time_limit: float | None = None, progress: Callable[[str], None] | None = None,
    settings: DiagnosisSettings | None = None,
) -> Diagnosis:  # fmt: skip
    """Find what a model lacks, from recordings: name the cause, extend the model, measure the gain.

    Quantities of the model with a range are fitted within it; those without are taken as known. Every sensor's
    uncertainty is also the noise that the fit assumes. Files joined by + are one motion recorded by several loggers,
    whose clocks are set to that of the logger with the inputs. With a gearbox the rows in one gear are used: the one of
    most seconds, by a channel with the gearbox's name that holds the gear's number, or by what the clutches carry. The
    command writes diagnosis.json, extended.toml, report.html and figures.

    Parameters
    ----------
    model : System or path
        Model file (TOML).
    recordings : Recording, path or a sequence of them
        Recordings of the system (CSV, MDF, .mat, Parquet).
    holdout : Recording, path or a sequence of them, optional
        Recording that is not fitted, decides last which causes are kept, and measures the answer; by default blocks of
        the recordings do; repeatable.
    channels : path, optional
        File that says what the channels are called in the recordings (TOML).
    keep_rest : bool
        Keep the torque that no cause explains as a table in the extended model, if unseen data gain by it.
    time_limit : float, optional
        Seconds that it may take; then it answers the best so far, and a note says so; by default 120 s of processor
        time.
    progress : callable, optional
        Is called with a line of text at every step; by default a terminal or a notebook shows it.
    settings : DiagnosisSettings, optional
        The numbers by which causes are searched for and accepted.

    Returns
    -------
    Diagnosis
        ``verdict`` is ``"adequate"``, ``"explained"`` or ``"unexplained"``; ``causes`` with parameters, standard
        uncertainties, confidence and evidence; ``extended`` is the extended model.

    Examples
    --------
    >>> found = rm.diagnose("examples/diagnosis/model.toml", "bench.csv")  # doctest: +SKIP
    >>> for cause in found.causes:  # doctest: +SKIP
    ...     print(cause.kind, cause.at, cause.evidence)
    """
    from matching.diagnosis.data import segments_between_gaps
    from matching.diagnosis.diagnose import diagnose as run
    from matching.diagnosis.other_gears import errors_in_other_gears
    from modelling.recordings.gears import in_one_gear
    from modelling.recordings.plausible import check_motion

    system = system_of(model)
    fitted, judging = ([*_each(what)] for what in (recordings, holdout))
    for each in judging:
        if any(same_file(each, other) for other in fitted):
            raise InputError(f"holdout {each}", "is fitted as well", "name a recording that the fit does not see")
    read, judge = ([recording_of(each, system, channels) for each in some] for some in (fitted, judging))
    shifting, whole = system, [*read, *judge]
    system, read, judge = in_one_gear(shifting, read, judge)
    for each in read:
        source = each.source or "recording"
        check_motion(each.channels, system, source)
        segments_between_gaps(each.time, source)  # so that --check says what is too short
    if time_limit is not None and not time_limit > 0:
        raise InputError("time_limit", f"{time_limit:g} s is out of range", "give a positive number of seconds")
    computing()
    with shown("diagnose", progress) as tell:
        found = run(system, read, judge, tell, keep_rest, settings=settings, time_limit=time_limit)
    found.notes.extend(errors_in_other_gears(shifting, system, found.extended, whole))
    return found


def uncertainty(
    budget: File, *, wanted: str | None = None, seed: int = 1, draws: int | None = None, digits: int = 2
) -> Uncertainty:
    """Evaluate a measurement uncertainty budget after the GUM, to first and second order and by Monte Carlo (JCGM 101).

    The command writes uncertainty.json, the budget's table, figures and the page uncertainty.html.

    Parameters
    ----------
    budget : path
        Budget file (TOML).
    wanted : str, optional
        Wanted expanded uncertainty, such as 0.5 or "0.5 N*m": tells which input must improve, and to what.
    seed : int
        Seed of the Monte Carlo method: the same seed gives the same result.
    draws : int, optional
        Number of draws, 1000 to 1e9; by default until the result is stable (JCGM 101, 7.9).
    digits : {1, 2, 3}
        Significant digits of the uncertainty that must be stable.

    Returns
    -------
    Uncertainty
        For every measurand the complete result, the budget's table and the check of first order against Monte Carlo.

    Examples
    --------
    >>> budget = rm.uncertainty("examples/gum/end_gauge.toml", draws=10_000)
    >>> print(f"{budget.measurands[0].propagation.first_order * 1e9:.1f} nm")  # standard uncertainty, first order
    31.7 nm
    """
    from matching.uncertainty.budget import read_budget
    from matching.uncertainty.evaluate import evaluate
    from matching.uncertainty.propagate import wanted_uncertainty

    if draws is not None and not 1000 <= draws <= 10**9:
        raise InputError("draws", f"{draws} is out of range", "give a number in 1000 ... 1e9")
    _check_seed(seed)
    read = read_budget(str(budget))
    was_read(
        budget, lambda: f"a budget: {counted(len(read.measurands), 'measurand')}, {counted(len(read.inputs), 'input')}"
    )
    if wanted is not None:
        for measurand in read.measurands:
            wanted_uncertainty(wanted, measurand, read.where)
    computing()
    return evaluate(read, seed=seed, draws=draws, digits=digits, wanted=wanted)


def fidelity(
    case: File, *, channels: File | None = None, arithmetic: str | None = None, nrmse: str | None = None,
    draws: int = 20_000, seed: int = 1,
) -> XilFidelity:  # fmt: skip
    """Judge how faithfully a test bed reproduces a manoeuvre: XiL fidelity (Eqs. 13–23 of the paper).

    Partial fidelities of system dynamics, residual vehicle model and measurement, their total R_XiL with its
    uncertainty, and which causes reduce it. The command writes fidelity.json, the table, figures and fidelity.html.

    Parameters
    ----------
    case : path
        Fidelity case (TOML).
    channels : path, optional
        File that says what the signals are called in the recordings (TOML).
    arithmetic : {"definition", "published"}, optional
        How partial fidelities combine: as defined, or as the paper's table was calculated; by default as the case says.
    nrmse : {"definition", "literal"}, optional
        Form of Eq. 18; by default as the case says.
    draws : int
        Draws of the Monte Carlo uncertainty, 100 to 1e7.
    seed : int
        Seed of the draws: the same seed gives the same result.

    Returns
    -------
    XilFidelity
        ``R_XiL`` (0 … 1), its parts, and their uncertainties.

    Examples
    --------
    >>> print(f"{rm.fidelity('examples/fidelity/tab2.toml').R_XiL:.3f}")
    0.885
    """
    from matching.fidelity import read_case, xil_fidelity

    if not 100 <= draws <= 10**7:
        raise InputError("draws", f"{draws} is out of range", "give a number in 100 ... 1e7")
    _check_seed(seed)
    title, read = read_case(str(case), arithmetic, nrmse, channels_of(channels))
    computing(lambda: {str(case): f"a fidelity case: {title}"})
    return xil_fidelity(title, read, draws, seed)


# --- The explorer, from a program or a notebook.


def explore(*files: File, out: File = "out/explore", port: int = 0, browser: bool = False) -> Explorer:
    """Open models, cases, recordings and budgets in the browser, or inside a notebook as the last line of a cell.

    Click a part of the drivetrain and change it: modes and responses follow. Match, drop recordings, judge budgets. New
    files and copies are made in the folder it was started in, and nowhere else. The
    page is served to this machine only, at an address with a secret in it, until Ctrl-C. Files change only by Save.

    Parameters
    ----------
    files : paths
        Model, case, recording, budget or fidelity case; without any, the starter case of `rigmatch new`.
    out : path
        Folder for results.
    port : int
        Port to serve at; 0: a free one.
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
    from matching.explore.files import opened, required_packages, starter

    required_packages()
    workspace = opened([str(file) for file in files] or starter(Path(out)), str(out))
    from matching.explore.page import Explorer

    explorer = Explorer(workspace, port)
    if browser:
        explorer.open()
    return explorer


# --- What a tuned bed does: the controller as an FMU, excitation, recordings judged, the way round.


def export(result: File, fmu: File, fmi: str = "2.0") -> Path:
    """Write the tuned residual vehicle, the whole controller, or any model as an FMU for co-simulation.

    The FMU holds C by CasADi with its sources, compiled for this platform if there is a C compiler. Every quantity is a
    parameter that can be set, named and in SI as in the model. A case file is exported with the start values of its
    [move], a model file as it is. With --controller the command writes the whole controller instead: residual vehicle,
    feed-forward, observer, prediction, limits, speed hold and watchdogs, sampled as it was tuned; its C sources
    (controller.h, controller.c, controller_data.h) run on a real-time system without FMI.

    Parameters
    ----------
    result : path
        Directory or result.json of a match, case file or model file.
    fmu : path
        FMU of the residual vehicle or model to write, NAME.fmu.
    fmi : {"2.0", "3.0"}
        Version of FMI.

    Returns
    -------
    Path
        Of the FMU.

    Examples
    --------
    >>> rm.export("examples/road_to_rig/case.toml", "residual_vehicle.fmu").name  # doctest: +LONG
    'residual_vehicle.fmu'
    """
    from matching.export import write

    write(str(result), str(fmu), fmi)
    return Path(fmu)


def excite(
    case: Case | File, *, proof: bool = False, channel_check: bool = False, duration: float | str = 20.0,
    margin: float | str = 0.2, speed: float | str | None = None, limit: Mapping[str, float | str] | None = None,
    beds: int = 20, seed: int = 0, torque_share: float | str = 1.0,
) -> ExcitationPlan | Proof | ChannelPlan:  # fmt: skip
    """Plan the recording that identifies what a match depends on most, within the limits of the bed.

    A multisine whose spectrum carries the most information (Fisher), a chirp and steps on dynamometers and motor, as
    large as the case's limits and the margin allow, on the model and on beds drawn from [uncertainty]. The bed runs
    without emulation. Add the torques of excitation.csv to those of a slow speed hold, and record the torque commands
    (speed hold included) and every sensor of the rig. The command writes excite.json with the standard uncertainties to
    expect, excitation.csv and a figure.

    Parameters
    ----------
    case : Case or path
        Directory or result.json of a match, or a case file (TOML).
    proof : bool
        Plan the proof of the controlled bed instead: compared torques, emulation on, as long as the verdict needs.
    channel_check : bool
        Plan the check of the channels instead: small torques one after another, at rest, before anything is fed back.
    duration : float or str
        Length in s, or with a unit.
    margin : float or str
        Share of every limit that stays unused.
    speed : float or str, optional
        Steady rotor speed in rad/s, or with a unit, such as "400 rpm"; by default a quarter of the limit.
    limit : mapping of str to float or str, optional
        Largest torque (N·m) of an input that is no dynamometer's, INPUT=TORQUE; by default that of the manoeuvre.
    beds : int
        Drawn beds on which the limits hold.
    seed : int
        Seed of phases and beds: the same seed gives the same result.
    torque_share : float or str
        With channel_check: share of its torques, for a check that tripped.

    Returns
    -------
    ExcitationPlan, Proof or ChannelPlan
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
    from matching.bed.channels import plan_channels
    from matching.bed.excite import ExcitationOrder, check_order, plan_excitation, steady_speed
    from matching.bed.proof import plan_proof

    tuned = tuned_case_of(case)
    if proof and channel_check:
        raise InputError("proof", "and channel_check are two recordings", "plan one after the other")
    if channel_check:
        share = in_si(torque_share, "1", "torque_share", positive=True)
        if share > 1:
            raise InputError("torque_share", f"is {share:g}", "give a share of at most 1")
        computing()
        return plan_channels(tuned, share)
    steady = None if speed is None else in_si(speed, "rad/s", "speed")
    if proof:
        computing()
        return plan_proof(tuned, steady_speed(tuned) if steady is None else steady, seed)
    torques = {name: in_si(value, "N*m", f"limit {name}", positive=True) for name, value in (limit or {}).items()}
    order = ExcitationOrder(in_si(duration, "s", "duration"), in_si(margin, "1", "margin"), steady, torques, beds, seed)
    check_order(tuned, order)
    computing()
    return plan_excitation(tuned, order)


def identify(
    case: Case | File, vehicle: Sequence[File] = (), bed: Sequence[File] = (), *,
    channels: File | None = None, diagnosis_limit: float | str | None = None,
    progress: Callable[[str], None] | None = None,
) -> FromRecordings:  # fmt: skip
    """Find out from recordings what vehicle and bed really are: a case with their values and uncertainties.

    A recording of the vehicle holds the torques that act on it and any of its sensors (tip-ins, coast-downs); a torque
    that the road alone gives may be missing. A recording of the bed is made without emulation (`rigmatch excite` plans
    it) and holds the torque commands and the sensors of the rig. What vehicle and rig share is the same hardware: its
    values are taken from the bed first. The command writes the case and its models, and identification.json.

    Parameters
    ----------
    case : Case or path
        Case file (TOML), or the directory of a match.
    vehicle : sequence of paths
        Recordings of the vehicle on the road.
    bed : sequence of paths
        Recordings of the bed without emulation.
    channels : path, optional
        File that says what the channels are called in the recordings (TOML).
    diagnosis_limit : float or str, optional
        A diagnosis that takes longer (s of processor time, or with a unit) ends with its best answer so far, and says
        so; by default no limit.
    progress : callable, optional
        Is called with a line of text at every step; by default a terminal or a notebook shows it.

    Returns
    -------
    FromRecordings
        The case, and what was diagnosed of bed and vehicle.

    Examples
    --------
    >>> known = rm.identify("case.toml", vehicle=["road.csv"], bed=["bed.csv"])  # doctest: +SKIP
    >>> rm.match(known.case).status  # doctest: +SKIP
    """
    from matching.bed.identify import identify as run
    from matching.bed.identify import recordings_read

    on_the_road, on_the_bed = ([Path(path) for path in paths] for paths in (vehicle, bed))
    limit = None if diagnosis_limit is None else in_si(diagnosis_limit, "s", "diagnosis_limit", positive=True)
    tuned = tuned_case_of(case)
    names = channels_of(channels)
    computing(lambda: recordings_read(tuned, on_the_road, on_the_bed, names))
    with shown("identify", progress) as tell:
        return run(tuned, on_the_road, on_the_bed, tell, limit, names)


def verify(
    case: Case | File, *recordings: File, channels: File | None = None, channel_check: bool = False
) -> BedVerification | ChannelCheck:  # fmt: skip
    """Judge recordings of the controlled bed beside vehicle and prediction.

    Frequency responses with their uncertainty, the response error, frequency and damping of the target modes, and
    R_XiL. The answer is as_predicted, short or undetermined. A recording holds the compared torques and sensors by name
    and lasts four periods of the lowest frequency of the band or more. If the bed is short and the recording holds the
    torque commands as well, the command diagnoses it. It writes verification.json, report.html and a figure.

    Parameters
    ----------
    case : Case or path
        Directory or result.json of a match, or a case file (TOML).
    recordings : paths
        Recordings of the controlled bed (CSV, MDF, .mat, Parquet).
    channels : path, optional
        File that says what the signals are called in the recordings (TOML).
    channel_check : bool
        The recording is one of the check of the channels (`excite --channel-check`): say which channel is wrong.

    Returns
    -------
    BedVerification or ChannelCheck
        Response errors with uncertainties, modes and fidelity of the bed, each beside its prediction; or every channel
        with its gain, delay, zero and noise, and what is wrong of it.

    Examples
    --------
    >>> judged = rm.verify("out/road_to_rig", "bed_1.csv", "bed_2.csv")  # doctest: +SKIP
    >>> judged.status  # doctest: +SKIP
    """
    from matching.bed.verify import judge, read_recordings

    tuned = tuned_case_of(case)
    if channel_check:
        return checked_channels(tuned, recordings, channels_of(channels))
    return judge(tuned, read_recordings([Path(path) for path in recordings], tuned, channels_of(channels)))


def checked_channels(case: Case, recordings: Sequence[File], channels: Mapping[str, Channel] | None) -> ChannelCheck:
    """The channels by a recording of their check."""
    from matching.bed.channels import judge_channels
    from matching.bed.simulated_bed import bed_system
    from modelling.recordings.read import read_recording

    if len(recordings) != 1:
        raise InputError("recordings", f"are {len(recordings)}", "give the one recording of the check of the channels")
    return judge_channels(case, read_recording(Path(recordings[0]), bed_system(case), channels))


def commission(
    case: File, bed: File, out: File, *, vehicle_recording: Sequence[File] = (), channels: File | None = None,
    rounds: int = 3,
    duration: float | str = 12.0, speed: float | str | None = None, diagnosis_limit: float | str = 240.0, seed: int = 0,
    workers: int | None = None, follow: float | str | None = None, skip_channel_check: bool = False,
    repeat: int = 0, progress: Callable[[str], None] | None = None,
) -> Commissioning:  # fmt: skip
    """Go the whole way onto the bed: match, check the channels, run, verify; then record, diagnose and match again.

    The channels are checked at rest with small torques before anything is fed back; a wrong one ends it with its name.
    Rounds go on as long as a further round would gain. An FMU of the bed (FMI 2.0, inputs and outputs named as in the
    rig file) is stepped with the exported controller. With a folder the command stops, says what to record and where to
    put it. Called again it goes on where it stopped; finished steps are not repeated. The command writes a folder a
    step, commission.json and report.html.

    Parameters
    ----------
    case : path
        Case file (TOML), or the directory of a match.
    bed : path
        FMU of the bed, or a folder for its recordings.
    out : path
        Directory to write to.
    vehicle_recording : sequence of paths
        Recordings of the vehicle on the road: its model is diagnosed on them before the first match.
    channels : path, optional
        File that says what the channels are called in the recordings (TOML); an FMU has the names of the rig.
    rounds : int
        Rounds at most.
    duration : float or str
        Length of the excitation in s, or with a unit.
    speed : float or str, optional
        Rotor speed of the excitation in rad/s, or with a unit; by default a quarter of the limit.
    diagnosis_limit : float or str
        A diagnosis that takes longer (s of processor time, or with a unit) ends with its best answer so far, and says
        so.
    seed : int
        Seed of the matches: the same seed gives the same result.
    workers : int, optional
        Processes; by default one a core.
    follow : float or str, optional
        With a folder: wait for each recording, and follow it until it has not grown for so long (s, or with a unit).
    skip_channel_check : bool
        Begin emulation at once: sign, unit and place of every channel are known to be right.
    repeat : int
        With an FMU: repeat the case's manoeuvre so often at the end with the best controller, learning each time.
    progress : callable, optional
        Is called with a line of text at every step; by default a terminal or a notebook shows it.

    Returns
    -------
    Commissioning
        What each round found, and why it ended or what it waits for.

    Examples
    --------
    >>> result = rm.commission("case.toml", "bed.fmu", "out/commission")  # doctest: +SKIP
    >>> result.status  # doctest: +SKIP
    """
    from matching.bed.commission import Circle, CommissionOrder
    from matching.bed.excite import ExcitationOrder

    steady = None if speed is None else in_si(speed, "rad/s", "speed")
    order = CommissionOrder(
        rounds=rounds, excitation=ExcitationOrder(duration=in_si(duration, "s", "duration"), speed=steady), seed=seed,
        workers=workers or cores(), follow=None if follow is None else in_si(follow, "s", "follow", positive=True),
        vehicle=tuple(Path(path) for path in vehicle_recording),
        diagnosis_limit=in_si(diagnosis_limit, "s", "diagnosis_limit", positive=True),
        skip_channel_check=skip_channel_check, channels=path_of(channels),
    )  # fmt: skip
    channels_of(channels)
    computing(lambda: _files_read(tuned_case_of(case), Path(bed), order))
    if repeat < 0 or (repeat and not Path(bed).is_file()):
        raise InputError("repeat", f"{repeat} is not possible here", "0 or more, and the FMU of a bed; else use learn")
    with shown("commission", progress) as tell:
        result = Circle(Path(out), Path(bed), order, tell, lambda known: known.save(Path(out))).run(Path(case))
        if repeat and result.best_round is not None:
            from matching.bed.learn import learn_on_bed

            tuned = tuned_case_of(Path(out) / f"{result.best_round}_match")
            learn_on_bed(tuned, Path(bed), Path(out) / "learned", repeat, tell=tell)
        return result


def learn(
    case: Case | File, *recordings: File, channels: File | None = None, played: File | None = None,
    vehicle_speed: float | str | None = None,
) -> Learned:  # fmt: skip
    """Learn from repetitions of a manoeuvre on the bed what to add to the commands the next time.

    What the controlled bed gets wrong in the same way every time is foreseen: torques, sample by sample from the
    trigger of the manoeuvre on, corrected after every repetition. A correction improves the bed as planned and every
    drawn bed; noise is not learned. The command writes learned.csv, controller.fmu, which plays it from its trigger on,
    learned.json and report.html.

    Parameters
    ----------
    case : Case or path
        Directory or result.json of a match with an observer, or a case file (TOML).
    recordings : paths
        Two or more recordings of the same manoeuvre, each from its trigger on, with the compared torques and sensors by
        name (CSV, MDF, .mat, Parquet).
    channels : path, optional
        File that says what the signals are called in the recordings (TOML).
    played : path, optional
        Directory that the last repetition was written to, whose torques were played.
    vehicle_speed : float or str, optional
        Speed of the vehicle in m/s, or with a unit, at which the manoeuvre begins: of a case with a range of speeds.

    Returns
    -------
    Learned
        The torques of the next repetition, the error, what of it does not repeat, and whether another one is worth it.

    Examples
    --------
    >>> learned = rm.learn("out/road_to_rig", "tip_in_1.csv", "tip_in_2.csv")  # doctest: +SKIP
    >>> learned.sentence()  # doctest: +SKIP
    """
    from matching.bed.learn import learn as run

    if not recordings:
        raise InputError("recordings", "are none", "give two or more recordings of the same manoeuvre")
    speed = None if vehicle_speed is None else in_si(vehicle_speed, "m/s", "vehicle_speed")
    return run(
        tuned_case_of(case), [Path(path) for path in recordings], channels_of(channels), path_of(played), speed
    )  # fmt: skip


def _files_read(case: Case, bed: Path, order: CommissionOrder) -> dict[str, str]:
    """What :func:`commission` reads beside its case, in words by file."""
    from matching.bed.excite import check_order
    from matching.bed.identify import recordings_read
    from matching.bed.simulated_bed import bed_of, check_bed

    check_order(case, order.excitation)
    check_bed(bed)
    contents = {str(bed): "a folder for recordings of the bed"}
    if bed.is_file():
        with bed_of(bed, case):
            contents[str(bed)] = "an FMU with the rig's inputs and sensors"
    return contents | (recordings_read(case, order.vehicle, [], order.names) if order.vehicle else {})


# --- What a test bed can be tuned to: a match, over two quantities, over tolerances.


def match(
    case: Case | File, seed: int = 0, starts: int = 4, workers: int | None = None,
    progress: Callable[[str], None] | None = None, *, beds: int | None = None,
    settings: SearchSettings | None = None, judging: JudgeSettings | None = None,
) -> MatchResult:  # fmt: skip
    """Tune what the case lets move until the rig reproduces the vehicle's response, and verify the result.

    The quantities under [move] of the case are tuned; a second, independent method checks the result. If a match is not
    possible the status is "limited" and the limits name the reasons. The command writes result.json, report.html,
    figures, and the tuned files (case.toml, vehicle.toml, rig.toml, residual_vehicle*.toml), which rigmatch reads
    again.

    Parameters
    ----------
    case : Case or path
        Case file (TOML).
    seed : int
        Seed of the fresh beds that judge the result: the same seed gives the same result.
    starts : int
        Largest number of starting points; the first is the case's own.
    workers : int, optional
        Processes; by default one a core.
    progress : callable, optional
        Is called with a line of text at every step; by default a terminal or a notebook shows it.
    beds : int, optional
        Fresh beds drawn from [uncertainty] that judge the result; 200 unless given.
    settings : SearchSettings, optional
        Numbers of the search, as ``rm.SearchSettings(pool=300)``; each has its meaning and origin there.
    judging : JudgeSettings, optional
        Numbers of the judge, as ``rm.JudgeSettings(...)``, likewise.

    Returns
    -------
    MatchResult
        ``status`` is ``"matched"`` or ``"limited"``, ``limits`` says what stands in the way; ``targets``,
        ``parameters``, ``response_error`` and ``verification`` hold the figures; ``tuned`` is the tuned case.

    Examples
    --------
    >>> result = rm.match("examples/adapter_only/case.toml", starts=1)  # doctest: +LONG
    >>> result.status  # doctest: +LONG
    'limited'
    """
    from matching.match.match import JUDGING
    from matching.match.match import match as run
    from matching.worker_pool import beside

    case = case_of(case)
    _check_seed(seed)
    computing()
    with beside(workers or cores()) as aside, shown("match", progress, OF_A_MATCH) as tell:
        return run(case, seed, starts, tell, beds=beds, aside=aside, settings=settings, judging=judging or JUDGING)


def map(  # noqa: A001
    case: Case | File, x: str | Axis, y: str | Axis | None = None, executor: Executor | None = None, *,
    seed: int = 0, starts: int = 2,
    workers: int | None = None, record: File | None = None, progress: Callable[[str], None] | None = None,
) -> Map:  # fmt: skip
    """The response error that a match reaches over one or two quantities.

    A quantity is named as in [move] of the case, or is one of the loop, e.g. loop.dead_time; it may carry its range and
    the number of values, or all values: loop.dead_time=0.001:0.008:6 or "loop.dead_time=1 ms,2 ms,5 ms". Mirror images
    get the same value. Every point is solved again from its neighbours' solutions until none improves. Finished points
    are kept in ``record`` (of the command: map.partial.jsonl), from which a map that was stopped continues. In Python
    it runs on any ``concurrent.futures`` executor, that of a Dask cluster (``Client(…).get_executor()``) included. The
    command writes map.json, report.html, map.svg and map.png.

    Parameters
    ----------
    case : Case or path
        Case file (TOML).
    x, y : str or Axis
        QUANTITY[=LOW:HIGH[:N]] or QUANTITY=VALUE,VALUE,…; units as in the case file, SI where none is written. Without
        y one quantity is swept.
    executor : Executor, optional
        Where the points are solved.
    seed : int
        Seed of the starting points: the same seed gives the same result.
    starts : int
        Starting points a match.
    workers : int, optional
        Processes; by default one a core.
    record : path, optional
        A file of finished points.
    progress : callable, optional
        Is called with a line of text at every step; by default a terminal or a notebook shows it.

    Returns
    -------
    Map
        Response errors, margins and status of every point.

    Examples
    --------
    >>> axes = "loop.dead_time=0.001:0.005:3", "rig.shafts.adapter_left.stiffness=2e4:1e5:3"
    >>> rm.map("examples/road_to_rig/case.toml", *axes).plot().savefig("map.svg")  # doctest: +SKIP
    """
    from matching.match.map import axis, map_case

    case = case_of(case)
    x = axis(case, x, "--x") if isinstance(x, str) else x
    y = axis(case, y, "--y") if isinstance(y, str) else y
    computing()
    with shown("map", progress, OF_A_COUNT) as tell:
        return map_case(
            case, x, y, executor, seed=seed, starts=starts, workers=workers, record=path_of(record),
            progress=lambda done, total: tell(f"{done} of {total} points"),
        )  # fmt: skip


def sweep(case: Case | File, x: str | Axis, executor: Executor | None = None, **options: Any) -> Map:
    """The response error that a match reaches over one quantity: :func:`map` without its second axis.

    Parameters
    ----------
    case, x, executor, options : see :func:`map`

    Returns
    -------
    Map
        With one row of points.

    Examples
    --------
    >>> rm.sweep("examples/road_to_rig/case.toml", "loop.dead_time=1ms:8ms:6").plot()  # doctest: +SKIP
    """
    return map(case, x, None, executor, **options)


def tolerance(
    case: Case | File, draws: int = 10_000, executor: Executor | None = None, *, seed: int = 0,
    added: Mapping[str, float | str] | None = None, workers: int | None = None, record: File | None = None,
    progress: Callable[[str], None] | None = None,
) -> Tolerance:  # fmt: skip
    """Spread of margin, modes and response errors of a match over tolerances of the bed.

    Draws the rig's quantities from the ranges in its file and from those added, without any from those that the case
    states under [uncertainty]. The controller stays as it is; start values under [move] are taken as tuned. The answer
    states the yield and which quantities cause the spread. The command writes tolerance.json, report.html and
    tolerance.svg; finished parts are kept in tolerance.partial.jsonl until the end: a study that was stopped continues
    from them.

    Parameters
    ----------
    case : Case or path
        Case file (TOML), as a match wrote it.
    draws : int
        Number of drawn beds, at least 100.
    executor, record, progress : see :func:`map`
    seed : int
        Seed of the draws: the same seed gives the same result.
    added : mapping of str to float or str, optional
        Relative tolerance of a further quantity of rig or loop, e.g. loop.dead_time=0.2, or of many by a quoted
        pattern, e.g. "rig.*.stiffness=0.05"; repeatable.
    workers : int, optional
        Processes; by default one a core.

    Returns
    -------
    Tolerance
        Quantiles of every quantity, shares of the inputs in their spread, and the yield: the share of beds within
        limits.

    Examples
    --------
    >>> case = "examples/road_to_rig/case.toml"
    >>> study = rm.tolerance(case, 200, added={"loop.dead_time": 0.2}, workers=1)  # doctest: +LONG
    >>> study.draws  # doctest: +LONG
    200
    """
    from contextlib import nullcontext

    from matching.match.tolerance import tolerance as run
    from matching.match.tolerance import what_varies
    from matching.worker_pool import executor_of

    case, shares = (
        case_of(case),
        {name: in_si(share, "1", f"tolerance {name}") for name, share in (added or {}).items()},
    )
    what_varies(case, shares)
    computing()
    with (
        nullcontext(executor) if executor else executor_of(workers) as pool,
        shown("tolerance", progress, OF_A_COUNT) as tell,
    ):
        return run(
            case, draws, pool, seed=seed, added=shares, record=path_of(record),
            progress=lambda done, total: tell(f"{done} of {total} parts"),
        )  # fmt: skip
