"""What a tuned bed does: the controller as an FMU, excitation, recordings judged, the way round."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING

from matching.api.files import File

if TYPE_CHECKING:
    from matching.bed_test.result import BedVerification
    from matching.commissioning.circle import CommissionOrder
    from matching.commissioning.from_recordings import FromRecordings
    from matching.commissioning.rounds import Commissioning
    from matching.excitation.plan import ExcitationOrder
    from matching.excitation.result import ExcitationPlan
    from matching.frequency.case.case import Case


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
    from matching.commissioning import from_recordings
    from matching.fmu.export_source import tuned_case

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
    from matching.commissioning.circle import Circle, CommissionOrder

    circle = Circle(Path(out), Path(bed), order or CommissionOrder(), tell or (lambda _: None))
    return circle.run(Path(case))
