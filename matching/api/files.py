"""What a file holds: models, cases, recordings, and their drawing."""

from __future__ import annotations

from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from matching.frequency.case.case import Case
    from modelling.measurement.recording import Recording
    from modelling.model.system import System

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
