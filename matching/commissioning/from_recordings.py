"""A case known from recordings: of its vehicle on the road, of its bed without emulation."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from matching.commissioning.bed_system import bed_system
from matching.commissioning.identified import IdentifiedValue, identified_case
from matching.commissioning.vehicle import known_vehicle, recorded_vehicle
from matching.diagnosis.diagnosis import diagnose
from matching.diagnosis.verdict.result import Diagnosis
from matching.frequency.case.case import Case
from matching.frequency.case.case_file import case_files
from modelling.common.errors import InputError
from modelling.common.time_limit import TimeLimit, limited
from modelling.measurement.contents import contents_of
from modelling.measurement.read import read_recording
from modelling.model.files import dumps
from modelling.model.system import System
from modelling.writing.output import strict_json

Progress = Callable[[str], None]


@dataclass(frozen=True)
class Identification:
    """A case with what recordings say of it.

    Attributes
    ----------
    case : Case
        With the values found, and under ``[uncertainty]`` what is still not known of them.
    diagnosis : Diagnosis
    values : tuple of IdentifiedValue
        One a quantity.
    notes : tuple of str
        What of the diagnosis the case does not hold, and whether it ended early.
    ended_early : float or None
        The seconds that the diagnosis was allowed, where they ended it.
    """

    case: Case
    diagnosis: Diagnosis
    values: tuple[IdentifiedValue, ...]
    notes: tuple[str, ...]
    ended_early: float | None

    def to_dict(self) -> dict[str, Any]:
        """Verdict, causes, values and notes as JSON holds them."""
        causes = self.diagnosis.to_dict()["causes"]
        return {
            "verdict": self.diagnosis.verdict,
            "causes": [{key: cause[key] for key in ("kind", "at", "evidence")} for cause in causes],
            "notes": list(self.notes), "values": [value.to_dict() for value in self.values],
            "torque_gains": {part.name: part.torque_gain for part in self.case.loop.dynamometers},
            "ended_early": self.ended_early,
        }  # fmt: skip

    def files(self) -> dict[str, str]:
        """Texts of the case file with its models, the diagnosis, and the extended model."""
        diagnosis = {"extended.toml": dumps(self.diagnosis.extended)}
        return diagnosis | {"diagnosis.json": strict_json(self.diagnosis.to_dict())} | case_files(self.case)


def vehicle_from_recordings(
    case: Case, recordings: Sequence[Path], progress: Progress, seconds: float | None
) -> Identification:
    """The case with the vehicle that recordings of the road show.

    ``seconds``: of the diagnosis, see :func:`_diagnosed`.

    Raises
    ------
    InputError
        If nothing of the vehicle is uncertain, or a recording cannot be read or fitted.
    """
    system, notes = recorded_vehicle(case, recordings)
    diagnosis, limit = _diagnosed(system, recordings, progress, seconds)
    known = known_vehicle(case, system, diagnosis)
    early = _ended_early(limit)
    ended = limit.seconds if early else None
    return Identification(known.case, diagnosis, known.values, (*early, *notes, *known.notes), ended)


def bed_from_recordings(
    case: Case, recordings: Sequence[Path], progress: Progress = lambda _: None, seconds: float | None = None
) -> Identification:
    """The case with the bed that recordings without emulation show: torque commands and every sensor of the rig.

    ``seconds``: of the diagnosis, see :func:`_diagnosed`.

    Raises
    ------
    InputError
        If a recording cannot be read or fitted.
    """
    diagnosis, limit = _diagnosed(bed_system(case), recordings, progress, seconds)
    made = identified_case(case, diagnosis)
    after = {quantity.name: quantity for quantity in made.case.uncertainty.uncertain}
    values = tuple(
        IdentifiedValue(quantity.name, quantity.value, after[quantity.name].value, after[quantity.name].half_width)
        for quantity in case.uncertainty.uncertain
    )
    early = _ended_early(limit)
    return Identification(made.case, diagnosis, values, (*early, *made.notes), limit.seconds if early else None)


def _diagnosed(
    system: System, recordings: Sequence[Path], progress: Progress, seconds: float | None
) -> tuple[Diagnosis, TimeLimit]:
    """The diagnosis of recordings, and whether its time was over.

    After 0.7 of the seconds no further cause is searched for, after all of them every fit ends where it is: what is
    then left takes some seconds more.
    """
    read = [read_recording(path, system) for path in recordings]
    with limited(seconds) as limit:
        return diagnose(system, read, None, progress), limit


def _ended_early(limit: TimeLimit) -> tuple[str, ...]:
    """A sentence on a diagnosis that its time ended."""
    if not limit.ended_at:
        return ()
    ended = f"the time of the diagnosis was over ({limit.seconds:g} s, --diagnosis-limit)"
    if limit.ended_at < 1:
        return (f"{ended}: its causes are the best that it had until then",)
    return (f"{ended}: causes and values are the best that it had until then, and less certain than they state",)


@dataclass(frozen=True)
class FromRecordings:
    """A case known from recordings of bed and vehicle, each None where it was not recorded."""

    case: Case
    bed: Identification | None
    vehicle: Identification | None

    def to_dict(self) -> dict[str, Any]:
        """As ``identification.json`` holds it."""
        return {name: None if part is None else part.to_dict() for name, part in self._parts()}

    def files(self) -> dict[str, str]:
        """Texts of the case file with its models, ``identification.json``, and a folder for bed and vehicle each."""
        files = {
            f"{name}/{file}": text
            for name, part in self._parts() if part is not None
            for file, text in part.files().items()
        }  # fmt: skip
        return files | case_files(self.case) | {"identification.json": strict_json(self.to_dict())}

    def _parts(self) -> tuple[tuple[str, Identification | None], ...]:
        return ("bed", self.bed), ("vehicle", self.vehicle)


def recordings_read(case: Case, vehicle: Sequence[Path], bed: Sequence[Path]) -> dict[str, str]:
    """What recordings of vehicle and bed hold, in words, by file; nothing is fitted.

    Raises
    ------
    InputError
        As :func:`identify`, as far as reading shows it.
    """
    _check_any(vehicle, bed)
    contents = {str(path): contents_of(read_recording(path, bed_system(case)), bed_system(case)) for path in bed}
    if vehicle:
        system, notes = recorded_vehicle(case, vehicle)
        contents |= {
            str(path): "; ".join((contents_of(read_recording(path, system), system), *notes)) for path in vehicle
        }
    return contents


def _check_any(vehicle: Sequence[Path], bed: Sequence[Path]) -> None:
    if not (vehicle or bed):
        raise InputError("--vehicle, --bed", "no recording is given", "give one of the vehicle or of the bed")


def identify(
    case: Case,
    vehicle: Sequence[Path],
    bed: Sequence[Path],
    progress: Progress = lambda _: None,
    seconds: float | None = None,
) -> FromRecordings:
    """The case as recordings of vehicle and bed show it; the bed, whose commands are known, comes first.

    ``seconds``: of each diagnosis at most; None: as many as it needs.

    Raises
    ------
    InputError
        If there is no recording, or as :func:`vehicle_from_recordings` and :func:`bed_from_recordings`.
    """
    _check_any(vehicle, bed)
    of_bed = of_vehicle = None
    if bed:
        of_bed = bed_from_recordings(case, bed, lambda step: progress(f"bed: {step}"), seconds)
        case = of_bed.case
    if vehicle:
        of_vehicle = vehicle_from_recordings(case, vehicle, lambda step: progress(f"vehicle: {step}"), seconds)
        case = of_vehicle.case
    return FromRecordings(case, of_bed, of_vehicle)
