"""Commissioning in rounds: match, run and verify; then record, diagnose and match again, until the bed is right."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import cache
from pathlib import Path
from typing import Any

from matching.bed_test.judge import judge
from matching.bed_test.recorded import read_recordings
from matching.commissioning.bed_system import bed_system
from matching.commissioning.by_hand import (
    KEPT,
    ByHand,
    HandedRecording,
    Tell,
    Waiting,
    keep_recording,
    kept_recording,
    so_far,
)
from matching.commissioning.fmu_bed import FmuBed, FmuController, check_bed
from matching.commissioning.from_recordings import bed_from_recordings, vehicle_from_recordings
from matching.commissioning.rounds import Commissioning, Round, end_of
from matching.commissioning.runs import excited_recording, proof_recording
from matching.commissioning.stages import Files, Stages, checksum
from matching.excitation.plan import ExcitationOrder, plan_excitation, steady_speed
from matching.excitation.proof import plan_proof, proof_csv
from matching.excitation.result import ExcitationPlan, excitation_csv
from matching.fmu.controller import exported_controller
from matching.fmu.export_source import tuned_case
from matching.frequency.case.case import Case
from matching.frequency.case.case_file import case_files
from matching.frequency.case.load import load_case
from matching.frequency.search.match import match
from modelling.fmu.controller import controller_fmu
from modelling.measurement.read import read_recording
from modelling.writing.output import strict_json

BY_FMU = f"{KEPT}.csv"  # what an FMU of the bed recorded
VEHICLE = "0_vehicle"  # the step before the first round
DIAGNOSIS_LIMIT = 600.0  # s


@dataclass(frozen=True)
class CommissionOrder:
    """What is wanted: rounds at most, the excitation, seed and processes of the matches.

    ``follow`` (s): recordings in a folder are waited for, and followed until they have stood still for so long.
    ``vehicle``: recordings of the vehicle on the road, which are diagnosed before the first match.
    ``diagnosis_limit`` (s): after it a diagnosis ends with the best it has; None: it takes the time it needs.
    """

    rounds: int = 3
    excitation: ExcitationOrder = field(default_factory=ExcitationOrder)
    seed: int = 0
    workers: int = 1
    follow: float | None = None
    vehicle: tuple[Path, ...] = ()
    diagnosis_limit: float | None = DIAGNOSIS_LIMIT


class Circle:
    """A commissioning in a folder.

    Parameters
    ----------
    folder : Path
        A folder a step, and the record of what is done.
    bed : Path
        An FMU of the bed, or a folder that recordings are put into.
    order : CommissionOrder
    tell : callable
        Is given the name of each step.
    """

    def __init__(self, folder: Path, bed: Path, order: CommissionOrder, tell: Tell = lambda _: None):
        check_bed(bed)
        self._folder, self._bed, self._order, self._tell = folder, bed, order, tell
        self._stages = Stages(folder)
        self._by_hand = ByHand(bed, order.follow, tell)
        self._tuned: dict[int, Case] = {}  # the case of each round
        self._rounds: list[Round] = []

    def run(self, path: Path) -> Commissioning:
        """Go round as long as a further round would gain, until the rounds are over, or a recording is waited for.

        Parameters
        ----------
        path : Path
            A case file, or the directory of a match, which the first round then takes as it is.

        Returns
        -------
        Commissioning
            What each round found, and why it ended or what it waits for.

        Raises
        ------
        InputError
            If a file is not what it has to be, or the bed's controller gives up.
        """
        plan_speed(_case_at(path), self._order)  # an error now, not after a match
        self._rounds = []
        waiting = end = vehicle = None
        if self._order.vehicle:
            vehicle = self._vehicle_known(path)
            path = self._folder / VEHICLE / "case.toml"
        try:
            for number in range(1, self._order.rounds + 1):
                self._rounds.append(Round(number))
                path = self._round(path, number)
                end = end_of(self._rounds)
                if end:
                    break
        except Waiting as reason:
            waiting = reason.what
        self._on_one_scale()
        return Commissioning(tuple(self._rounds), end, waiting, vehicle)

    def _found(self, **of_step: Any) -> None:
        """Add what a step found to the present round; a step that waits for a recording keeps those before it."""
        self._rounds[-1] = replace(self._rounds[-1], **of_step)

    def _vehicle_known(self, path: Path) -> dict[str, Any]:
        """Diagnose the recordings of the vehicle; what became of it."""
        self._tell("vehicle: diagnose")
        case = _case_at(path)

        def work() -> tuple[Files, dict[str, Any]]:
            vehicle = vehicle_from_recordings(
                case, self._order.vehicle, lambda step: self._tell(f"vehicle: {step}"), self._order.diagnosis_limit
            )
            return vehicle.files(), vehicle.to_dict()

        inputs = self._stages.of_files(*self._order.vehicle) + _of_case(case)
        return self._stages.run(VEHICLE, inputs, work, self._long_enough)

    def _long_enough(self, identification: Mapping[str, Any]) -> bool:
        """Whether a diagnosis came to its end, or had as much time as it would get now."""
        had, limit = identification.get("ended_early"), self._order.diagnosis_limit
        return had is None or (limit is not None and had >= limit)

    def _on_one_scale(self) -> None:
        """Judge the recordings of all rounds against the vehicle of the last, whose specimen is known best."""
        judged = [entry.number for entry in self._rounds if entry.verification is not None]
        for number in judged[:-1]:
            name, case = f"{number}_verify", self._tuned[judged[-1]]
            self._tell(
                f"round {number} of {self._order.rounds} at most: judge against the vehicle of round {judged[-1]}"
            )
            path = kept_recording(self._folder / name)

            def work(path: Path = path, case: Case = case) -> tuple[Files, dict[str, Any]]:
                result = judge(case, read_recordings([path], case)).to_dict()
                return {}, {key: result[key] for key in ("errors", "functions", "modes", "fidelity")}

            inputs = checksum(self._stages.of_files(path) + _of_case(case))
            again = self._stages.run(f"{name}_again", inputs, work)
            self._rounds[number - 1] = replace(self._rounds[number - 1], against_last_vehicle=again)

    def _round(self, path: Path, number: int) -> Path:
        """One round; where the next one begins from."""
        if number > 1:
            self._found(identification=self._identified(path, number))
            path = self._folder / f"{number}_diagnose" / "case.toml"
        matched = self._matched(path, number)
        case = self._tuned[number] = tuned_case(matched).tuned
        self._exported(case, number)
        self._found(verification=self._verified(case, number))
        return matched

    def _matched(self, path: Path, number: int) -> Path:
        if path.is_dir():
            self._found(match={"status": "as given"})
            return path
        self._tell(f"round {number} of {self._order.rounds} at most: match")
        case = load_case(path)

        def work() -> tuple[Files, dict[str, Any]]:
            result = match(case, self._order.seed, workers=self._order.workers)
            entries = result.to_dict()
            files = {"result.json": strict_json(entries), **case_files(result.tuned)}
            return files, {"status": result.status, "limits": list(result.limits)}

        name = f"{number}_match"
        self._found(match=self._stages.run(name, _of_case(case), work))
        return self._folder / name

    def _exported(self, case: Case, number: int) -> None:
        self._tell(f"round {number} of {self._order.rounds} at most: export")

        def work() -> tuple[Files, dict[str, Any]]:
            return {"controller.fmu": controller_fmu(exported_controller(case)).content}, {}

        self._stages.run(f"{number}_export", _of_case(case), work)

    def _verified(self, case: Case, number: int) -> dict[str, Any]:
        self._tell(f"round {number} of {self._order.rounds} at most: run and verify")
        name = f"{number}_verify"
        exported = self._folder / f"{number}_export" / "controller.fmu"

        def work() -> tuple[Files, dict[str, Any]]:
            speed = plan_speed(case, self._order)
            wanted = plan_proof(case, speed)
            if not self._bed.is_file():  # a folder, perhaps not there yet
                taken = self._by_hand.recording(
                    name, {"excitation.csv": proof_csv(wanted)},
                    f"run {number}_export/controller.fmu at {speed:.3g} rad/s, emulation on, add the torques of "
                    f"{name}_excitation.csv, and record them with the torque commands and every sensor of the rig",
                    lambda path: so_far(judge(case, read_recordings([path], case))),
                )  # fmt: skip
            else:
                law = exported_controller(case).law
                with self._fmu(case) as bed, FmuController(exported, law) as controller:
                    taken = HandedRecording(BY_FMU, proof_recording(bed, case, law, controller, wanted, speed))
            keep_recording(self._folder / name, taken)
            result = judge(case, read_recordings([self._folder / name / taken.name], case)).to_dict()
            files = {taken.name: taken.content, "proof.json": strict_json(wanted.to_dict())}
            return files | {"verification.json": strict_json(result)}, result

        return self._stages.run(name, _of_case(case), work)

    def _identified(self, matched: Path, number: int) -> dict[str, Any]:
        """Excite, record, diagnose."""
        case = tuned_case(matched).tuned
        self._tell(f"round {number} of {self._order.rounds} at most: excite")

        @cache
        def plan() -> ExcitationPlan:  # some seconds, and needed only by steps that are not done
            return plan_excitation(case, self._order.excitation)

        self._stages.run(
            f"{number}_excite", checksum(_of_case(case) + repr(self._order.excitation)),
            lambda: ({"excite.json": strict_json(plan().to_dict()), "excitation.csv": excitation_csv(plan())}, {}),
        )  # fmt: skip
        self._recorded(case, plan, number)
        self._tell(f"round {number} of {self._order.rounds} at most: diagnose")
        path = kept_recording(self._folder / f"{number}_record")

        def work() -> tuple[Files, dict[str, Any]]:
            bed = bed_from_recordings(
                case, [path], lambda step: self._tell(f"diagnose: {step}"), self._order.diagnosis_limit
            )
            return bed.files(), bed.to_dict()

        return self._stages.run(
            f"{number}_diagnose", self._stages.of_files(path) + _of_case(case), work, self._long_enough
        )

    def _recorded(self, case: Case, plan: Callable[[], ExcitationPlan], number: int) -> None:
        self._tell(f"round {number} of {self._order.rounds} at most: record")
        name = f"{number}_record"
        excitation = (self._folder / f"{number}_excite" / "excitation.csv").read_bytes().decode()

        def work() -> tuple[Files, dict[str, Any]]:
            if not self._bed.is_file():  # a folder, perhaps not there yet
                taken = self._by_hand.recording(
                    name, {"excitation.csv": excitation},
                    f"hold the rotors slowly at {plan().speed:.3g} rad/s (gains in {number}_excite/excite.json), add "
                    f"the torques of {name}_excitation.csv, and record the torque commands and every sensor of the rig",
                    lambda path: f"{read_recording(path, bed_system(case)).time[-1]:.1f} s are recorded",
                )  # fmt: skip
            else:
                with self._fmu(case) as bed:
                    taken = HandedRecording(BY_FMU, excited_recording(bed, case, plan()))
            keep_recording(self._folder / name, taken)
            return {taken.name: taken.content}, {}

        self._stages.run(name, checksum(excitation), work)

    def _fmu(self, case: Case) -> FmuBed:
        driven = [dynamometer.torque_input for dynamometer in case.loop.dynamometers]
        others = [part.name for part in case.rig.inputs if part.name not in driven]
        return FmuBed(self._bed, [*driven, *others], [sensor.name for sensor in case.rig.sensors])


def plan_speed(case: Case, order: CommissionOrder) -> float:
    """Steady speed of the rotors, rad/s, of both kinds of run."""
    return steady_speed(case) if order.excitation.speed is None else order.excitation.speed


def _case_at(path: Path) -> Case:
    """The case of a case file, or of a match's directory as tuned."""
    return tuned_case(path).tuned if path.is_dir() else load_case(path)


def _of_case(case: Case) -> str:
    return checksum("".join(case_files(case).values()))
