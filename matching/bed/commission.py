"""Commissioning in rounds: match, run and verify, then record, diagnose and match again; and why a bed falls short."""

from __future__ import annotations

import hashlib
import math
import shlex
import signal
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from matching.bed.channels import channel_recording, check_channels, judge_channels, plan_channels
from matching.bed.excite import (
    ExcitationOrder,
    ExcitationPlan,
    error_weights,
    excitation_csv,
    plan_excitation,
    steady_speed,
)
from matching.bed.identify import GAIN, IdentifiedValue, bed_from_recordings, measured_case, vehicle_from_recordings
from matching.bed.lost_motion import LostMotion, with_free_play
from matching.bed.plausible import NotThisBed, check_excitation
from matching.bed.proof import plan_proof, proof_csv
from matching.bed.simulated_bed import (
    KEPT,
    ByHand,
    FmuBed,
    FmuController,
    HandedRecording,
    Tell,
    Tripped,
    Waiting,
    bed_of,
    bed_system,
    check_bed,
    excited_recording,
    keep_recording,
    kept_recording,
    proof_recording,
    so_far,
)
from matching.bed.stated import Deviation
from matching.bed.vehicle_beside import reached_by_torques, vehicle_beside
from matching.bed.verify import COVERAGE_FACTOR, NEGLIGIBLE, BedVerification, judge, read_recordings
from matching.export import tuned_case
from matching.match.case import Case
from matching.match.case_file import case_files, load_case
from matching.match.exported import exported_controller
from matching.match.match import match
from matching.studies import append, rows
from modelling.display import Displayed
from modelling.effects.effect import place_in_words
from modelling.effects.friction_and_compliance import Backlash
from modelling.errors import VERSION, InputError
from modelling.fmu.export import controller_fmu
from modelling.recordings.read import Channel, read_channels, read_recording, read_signals
from modelling.recordings.recording import Recording
from modelling.resources import interrupted, reports_at_once
from modelling.toml import no_pipe
from modelling.writing import strict_json, write_all

# --- The rounds of a commissioning: what each found, when they end, and which controller is the best.

NEAR_ENOUGH_RATIO = 1.5  # times what a match with the true values reaches: as near as a further round is worth


@dataclass(frozen=True)
class Round:
    """What a round found; None where it has not come so far.

    Attributes
    ----------
    number : int
        From 1 on.
    identification : mapping, optional
        What the recording of the bed without emulation says: the content of ``identification.json`` for the bed.
    match : mapping, optional
        ``status`` and ``limits`` as in ``result.json``.
    verification : mapping, optional
        The content of ``verification.json`` in the round's folder.
    against_last_vehicle : mapping, optional
        Errors, functions, modes and fidelity of the same recording, judged against the vehicle of the last round.
    """

    number: int
    identification: Mapping[str, Any] | None = None
    match: Mapping[str, Any] | None = None
    verification: Mapping[str, Any] | None = None
    against_last_vehicle: Mapping[str, Any] | None = None

    def to_dict(self) -> dict[str, Any]:
        """As ``commission.json`` holds it; without what the round has not come to."""
        steps = {
            "identification": self.identification, "match": self.match, "verification": self.verification,
            "against_last_vehicle": self.against_last_vehicle,
        }  # fmt: skip
        return {"round": self.number, **{step: dict(content) for step, content in steps.items() if content is not None}}


@dataclass(frozen=True)
class Commissioning(Displayed):
    """How far a commissioning has come.

    Attributes
    ----------
    rounds : tuple of Round
    end : str or None
        Why no further round would gain; None where one may.
    waiting_for : str or None
        The recording that it waits for, in words.
    vehicle : mapping, optional
        What recordings of the road say: the content of ``identification.json`` for the vehicle.
    last : BedVerification, optional
        Of the last round that was verified, with its curves.
    channels : mapping, optional
        The content of ``channels.json``: what the check of the channels found before the first emulation.
    command, out : str
        What is typed to go on, and the folder of the steps.
    """

    rounds: tuple[Round, ...]
    end: str | None = None
    waiting_for: str | None = None
    vehicle: Mapping[str, Any] | None = None
    last: BedVerification | None = None
    channels: Mapping[str, Any] | None = None
    command: str = ""
    out: str = ""

    @property
    def status(self) -> str | None:
        """``waiting``, ``wrong_channel`` where no emulation was begun, else that of the last verification:
        ``as_predicted``, ``short``, ``undetermined``, or ``unlike_model`` where nothing could be judged."""
        if self.waiting_for:
            return "waiting"
        if self.channels is not None and not self.channels["right"]:
            return "wrong_channel"
        found = next((entry.verification["status"] for entry in reversed(self.rounds) if entry.verification), None)
        return found or ("undetermined" if self.end else None)

    @property
    def best_round(self) -> int | None:
        """Number of the round with the least measured error; None without any."""
        return best_round(self.rounds)

    def to_dict(self) -> dict[str, Any]:
        """As ``commission.json`` holds it."""
        return {
            "status": self.status, "waiting_for": self.waiting_for, "end": self.end, "best_round": self.best_round,
            "vehicle": None if self.vehicle is None else dict(self.vehicle),
            "channels": None if self.channels is None else dict(self.channels),
            "rounds": [entry.to_dict() for entry in self.rounds], "command": self.command or None,
            "out": self.out or None,
        }  # fmt: skip


def end_of(rounds: Sequence[Round]) -> str | None:
    """Why no further round would gain, in a sentence; None where one would, or nothing was verified yet."""
    now = rounds[-1].verification
    if now is None:
        return None
    before = rounds[-2].verification if len(rounds) > 1 else None
    unlike = [of_round is not None and of_round["status"] == "unlike_model" for of_round in (before, now)]
    if all(unlike):
        return "the bed answers otherwise than its model, also with what the recordings say of it"
    if any(unlike):
        return None
    if before is not None and not _gained(before, now):
        return "the last round gained nothing that could be measured"
    if now["status"] == "short" or any(_could_gain(error, now) for error in now["errors"]):
        return None
    if now["status"] == "as_predicted":
        near = all(error["error"] is not None and error["error"] <= _reached(error) for error in now["errors"])
        beyond = "a further round could not gain more than the uncertainty of this one"
        return "the bed answers as well as the match can make it" if near else beyond
    because = {question["because"] for question in now.get("open", ())}
    if "vehicle" in because:
        return "a further round could not gain more than its uncertainty: what is not known of the vehicle is more"
    if "excitation" in because and all(_planned_too_weak(error, now) for error in now["errors"]):
        return "a further round could not gain more than its uncertainty: the planned excitation is too weak for it"
    return None


def _could_gain(error: Mapping[str, Any], now: Mapping[str, Any]) -> bool:
    """Whether an error is larger than what a match with the bed's true values would leave, beyond its uncertainty; of
    one that does not show, whether the next proof is planned to show it."""
    if error["error"] is None:
        return not _planned_too_weak(error, now)
    return bool(error["error"] - COVERAGE_FACTOR * error["standard_uncertainty"] > _reached(error))


def _reached(error: Mapping[str, Any]) -> float:
    """What a match with the bed's true values would leave of an error, as near as a further round is worth."""
    return float(NEAR_ENOUGH_RATIO * max(error["predicted"], NEGLIGIBLE * error["allowed"]))


def _planned(error: Mapping[str, Any], now: Mapping[str, Any]) -> float:
    """Standard uncertainty that the plan of the proof expects of an error; 0 where nothing was planned."""
    return float(now.get("planned", {}).get(error["name"], 0.0))


def _planned_too_weak(error: Mapping[str, Any], now: Mapping[str, Any]) -> bool:
    """Whether the next proof leaves an error as open: what its plan expects is more than the case allows."""
    return error["status"] != "undetermined" or not COVERAGE_FACTOR * _planned(error, now) <= error["allowed"]


def _gained(before: Mapping[str, Any], now: Mapping[str, Any]) -> bool:
    """Whether an error fell by more than its expanded uncertainty; errors that are not determined say nothing."""
    known = [
        (old, new)
        for old, new in zip(before["errors"], now["errors"], strict=False)
        if old["error"] is not None and new["error"] is not None
    ]
    if not known:
        return True
    return any(
        old["error"] - new["error"]
        > COVERAGE_FACTOR * math.hypot(old["standard_uncertainty"], new["standard_uncertainty"])
        for old, new in known
    )


def _judged(entry: Round) -> bool:
    return entry.verification is not None and entry.verification.get("status") != "unlike_model"


def best_round(rounds: Sequence[Round]) -> int | None:
    """Number of the round with the least measured error, all against the vehicle of the last; None without any."""
    errors = {}
    for entry in rounds:
        measured = entry.against_last_vehicle or entry.verification or {}
        known = [error["error"] for error in measured.get("errors", ()) if error["error"] is not None]
        if known:
            errors[entry.number] = sum(error**2 for error in known) / len(known)
    return min(errors, key=lambda number: errors[number]) if errors else None


# --- Steps of a commissioning that are not repeated once they are done: a folder each, and a record with checksums.

Files = Mapping[str, str | bytes]
RECORD = "commission.jsonl"
KINDS = {"step": str, "inputs": str, "files": dict, "figures": dict}  # of a row on record, by key


@dataclass(frozen=True)
class Stages:
    """The folder of a commissioning."""

    folder: Path

    def done(self, name: str, inputs: str) -> dict[str, Any] | None:
        """Figures of a step that was done on the same inputs by the same version and whose files are as they were."""
        figures, key = None, checksum(f"{VERSION} {inputs}")
        for row in rows(self.folder / RECORD, KINDS):
            if row["step"] == name and row["inputs"] == key and self._unchanged(name, row["files"]):
                figures = row["figures"]
        return figures

    def run(
        self,
        name: str,
        inputs: str,
        work: Callable[[], tuple[Files, dict[str, Any]]],
        enough: Callable[[Mapping[str, Any]], bool] = lambda _: True,
    ) -> dict[str, Any]:
        """Figures of a step: as recorded, where they are ``enough``, or of the ``work`` that gives files and
        figures."""
        figures = self.done(name, inputs)
        if figures is not None and enough(figures):
            return figures
        if (self.folder / name).is_symlink():
            raise InputError(str(self.folder / name), "is a link", "remove it: steps are written to this folder only")
        files, figures = work()
        write_all(self.folder / name, files)
        sums = {path: checksum(content) for path, content in files.items()}
        key = checksum(f"{VERSION} {inputs}")
        append(self.folder / RECORD, {"step": name, "inputs": key, "files": sums, "figures": figures})
        return figures

    def _unchanged(self, name: str, files: Mapping[str, str]) -> bool:
        for path, wanted in files.items():
            place = self.folder / name / path
            if not place.is_file() or checksum(place.read_bytes()) != wanted:
                return False
        return True

    def of_files(self, *paths: Path) -> str:
        """Checksum of the formats and contents of files."""
        total = hashlib.sha256()
        for path in paths:
            no_pipe(path, str(path))
            total.update(path.suffix.encode())
            total.update(hashlib.sha256(path.read_bytes()).digest())
        return total.hexdigest()[:32]


def checksum(content: str | bytes) -> str:
    """Of a file's content."""
    return hashlib.sha256(content.encode() if isinstance(content, str) else content).hexdigest()[:32]


# --- Commissioning in rounds: match, run and verify; then record, diagnose and match again, until the bed is right.

BY_FMU = f"{KEPT}.csv"  # what an FMU of the bed recorded
CHECKING = "0_export"  # the controller whose mode 3 checks the channels; nothing of it is tuned yet
MEASURED = "1_measured"  # the case with what the check of the channels measured
VEHICLE = "0_vehicle"  # the step before the first round
DIAGNOSIS_LIMIT = 240.0  # s of processor time: thrice what a hidden effect among 24 uncertain quantities takes


EXCITED = 12.0  # s of excitation a round


@dataclass(frozen=True)
class CommissionOrder:
    """What is wanted: rounds at most, the excitation, seed and processes of the matches.

    ``follow`` (s): recordings in a folder are waited for, and followed until they have stood still for so long.
    ``vehicle``: recordings of the vehicle on the road, which are diagnosed before the first match.
    ``skip_channel_check``: the channels are known to be right, emulation begins at once.
    ``diagnosis_limit`` (s of processor time): after it a diagnosis ends with the best it has; None: it takes the time
    it needs.
    """

    rounds: int = 3
    excitation: ExcitationOrder = field(default_factory=lambda: ExcitationOrder(duration=EXCITED))
    seed: int = 0
    workers: int = 1
    follow: float | None = None
    vehicle: tuple[Path, ...] = ()
    diagnosis_limit: float | None = DIAGNOSIS_LIMIT
    skip_channel_check: bool = False
    channels: Path | None = None

    @property
    def names(self) -> Mapping[str, Channel] | None:
        """What the channels are called in recordings; None: as in the models."""
        return None if self.channels is None else read_channels(self.channels)

    def options(self) -> list[str]:
        """As typed, those that are not the defaults: what goes on has to be asked for the same."""
        usual, asked = CommissionOrder(), list[str]()
        for path in self.vehicle:
            asked += ["--vehicle-recording", str(path)]
        for option, own, default in (
            ("--rounds", self.rounds, usual.rounds), ("--seed", self.seed, usual.seed),
            ("--duration", self.excitation.duration, usual.excitation.duration),
            ("--speed", self.excitation.speed, usual.excitation.speed),
            ("--diagnosis-limit", self.diagnosis_limit, usual.diagnosis_limit), ("--follow", self.follow, None),
        ):  # fmt: skip
            if own != default and own is not None:
                asked += [option, f"{own:.10g}"]
        if self.channels is not None:
            asked += ["--channels", str(self.channels)]
        return [*asked, *(["--skip-channel-check"] if self.skip_channel_check else [])]


SHARES_OF_TORQUE = (1.0, 0.3, 0.1)  # of the check of the channels, one after another until no trip ends it


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
    keep : callable
        Is given after each stage what is known by then: a run that is killed leaves it.
    """

    def __init__(
        self, folder: Path, bed: Path, order: CommissionOrder, tell: Tell = lambda _: None,
        keep: Callable[[Commissioning], object] = lambda _: None,
    ):  # fmt: skip
        check_bed(bed)
        self._keep, self._again = keep, ""
        self._folder, self._bed, self._order, self._tell = folder, bed, order, tell
        self._stages = Stages(folder)
        self._by_hand = ByHand(bed, order.follow, tell)
        self._tuned: dict[int, Case] = {}  # the case of each round
        self._judged: dict[int, BedVerification] = {}  # of each round that was run now
        self._rounds: list[Round] = []
        self._channels: dict[str, Any] | None = None
        self._names = None if bed.is_file() else order.names  # an FMU has the names of the rig

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
        """
        case = _case_at(path)  # an error now, not after a match
        plan_speed(case, self._order)
        reached_by_torques(case)
        self._rounds = []
        self._again = shlex.join([
            "rigmatch", "commission", str(path), "--bed", str(self._bed), *self._order.options(), "--out",
            str(self._folder),
        ])  # fmt: skip
        waiting = end = vehicle = last = None
        if self._order.vehicle:
            vehicle = self._vehicle_known(path)
            path = self._folder / VEHICLE / "case.toml"
        try:
            with reports_at_once():
                end = self._go_round(path)
                self._why_short()
                self._on_one_scale()
                last = self._last()
        except Waiting as reason:
            waiting = reason.what
            self._on_one_scale()
            last = self._last()
        except KeyboardInterrupt as reason:
            interrupted(reason.args[0] if reason.args else signal.SIGINT)
            end, last = "it was ended from outside; the same command goes on", None
            self._rounds = [entry for entry in self._rounds if len(entry.to_dict()) > 1]
        return Commissioning(
            tuple(self._rounds), end, waiting, vehicle, last, self._channels, self._again, str(self._folder)
        )

    def _kept(self) -> None:
        """What is known after a stage."""
        rounds = tuple(entry for entry in self._rounds if len(entry.to_dict()) > 1)
        end = "the command is still running, or was ended from outside; the same command goes on"
        self._keep(Commissioning(rounds, end, None, None, None, self._channels, self._again, str(self._folder)))

    def _go_round(self, path: Path) -> str | None:
        """The rounds; why no further one would gain, None where one may."""
        end = None
        for number in range(1, self._order.rounds + 1):
            self._rounds.append(Round(number))
            matched = self._round(path, number)
            if matched is None:
                self._rounds.pop()
                return "no emulation was begun"
            path, end = matched, end_of(self._rounds)
            if end:
                break
        return end

    def _found(self, **of_step: Any) -> None:
        """Add what a step found to the present round; a step that waits for a recording keeps those before it."""
        self._rounds[-1] = replace(self._rounds[-1], **of_step)
        self._kept()

    def _vehicle_known(self, path: Path) -> dict[str, Any]:
        """Diagnose the recordings of the vehicle; what became of it."""
        self._tell("vehicle: diagnose")
        case = _case_at(path)

        def work() -> tuple[Files, dict[str, Any]]:
            vehicle = vehicle_from_recordings(
                case,
                self._order.vehicle,
                lambda step: self._tell(f"vehicle: {step}"),
                self._order.diagnosis_limit,
                self._order.names,
            )
            return vehicle.files(), vehicle.to_dict()

        inputs = self._stages.of_files(*self._order.vehicle) + _of_case(case)
        return self._stages.run(VEHICLE, inputs, work, self._long_enough)

    def _long_enough(self, identification: Mapping[str, Any]) -> bool:
        """Whether a diagnosis came to its end, or had as much time as it would get now."""
        had, limit = identification.get("ended_early"), self._order.diagnosis_limit
        return had is None or (limit is not None and had >= limit)

    def _why_short(self) -> None:
        """Of a last round that falls short, what a diagnosis of its proof says: no further recording tells it."""
        last = self._rounds[-1] if self._rounds else Round(0)
        if (last.verification or {}).get("status") != "short":
            return
        self._tell(f"round {last.number}: why it falls short")
        case, path = self._tuned[last.number], kept_recording(self._folder / f"{last.number}_verify")

        def work() -> tuple[Files, dict[str, Any]]:
            judged = self._last()
            assert judged is not None
            reason = why_short(
                case, judged, [path], self._names, lambda step: self._tell(f"diagnose: {step}"),
                self._order.diagnosis_limit, self._order.excitation.duration,
            )  # fmt: skip
            return {}, {} if reason is None else reason.to_dict()

        reason = self._stages.run(f"{last.number}_why", self._stages.of_files(path) + _of_case(case), work)
        self._found(verification={**(last.verification or {}), "diagnosis": reason or None})

    def _last(self) -> BedVerification | None:
        """The last recording under emulation, judged once more for its curves."""
        number = max((entry.number for entry in self._rounds if _judged(entry)), default=None)
        if number is None:
            return None
        if number in self._judged:
            return self._judged[number]
        case, path = self._tuned[number], kept_recording(self._folder / f"{number}_verify")
        return judge(case, read_recordings([path], case, self._names), of_this_controller=False)

    def _on_one_scale(self) -> None:
        """Judge the recordings of all rounds against the vehicle of the last, whose specimen is known best."""
        judged = [entry.number for entry in self._rounds if _judged(entry)]
        for number in judged[:-1]:
            name, case = f"{number}_verify", self._tuned[judged[-1]]
            self._tell(
                f"round {number} of {self._order.rounds} at most: judge against the vehicle of round {judged[-1]}"
            )
            path = kept_recording(self._folder / name)

            def work(path: Path = path, case: Case = case) -> tuple[Files, dict[str, Any]]:
                result = judge(case, read_recordings([path], case, self._names), of_this_controller=False).to_dict()
                return {}, {key: result[key] for key in ("errors", "functions", "modes", "fidelity")}

            inputs = checksum(self._stages.of_files(path) + _of_case(case))
            again = self._stages.run(f"{name}_again", inputs, work)
            self._rounds[number - 1] = replace(self._rounds[number - 1], against_last_vehicle=again)

    def _round(self, path: Path, number: int) -> Path | None:
        """One round; where the next one begins from. None: a channel is wrong, and nothing may be emulated."""
        if number > 1:
            self._found(identification=self._identified(number))
            path = self._folder / f"{number}_diagnose" / "case.toml"
        elif not self._order.skip_channel_check:
            case = _case_at(path)
            self._channels = self._checked(case, number)
            self._kept()
            if not self._channels["right"]:
                return None
            older = self._channels.get("free_play")  # of a folder that version 0.1 began
            found = self._channels.get("free_plays", [older] if older else [])
            plays = [LostMotion(**one) for one in found]
            if plays and not case.rig.free_plays:
                path = self._with_plays(case, plays)
                case = load_case(path)
            if any(one["told"] for one in self._channels["measured"]):
                path = self._with_measured(path, case)
        matched = self._matched(path, number)
        case = self._tuned[number] = tuned_case(matched).tuned
        self._exported(case, f"{number}_export")
        self._found(verification=self._verified(case, number))
        return matched

    def _with_plays(self, case: Case, seen: Sequence[LostMotion]) -> Path:
        """The case with the free play that the check of the channels shows: it is matched with its play closed."""

        def work() -> tuple[Files, dict[str, Any]]:
            made = case
            for one in seen:
                made = with_free_play(made, one)
            return case_files(made), {}

        self._stages.run("1_play", _of_case(case) + repr(seen), work)
        self._found(identification={
            "verdict": "of free play",
            "causes": [{"kind": Backlash.kind, "at": one.at,
                        "evidence": f"{one.gap:.2g} rad, by small torques from rest (check of the channels)"}
                       for one in seen],
            "notes": [f"free play of {place_in_words(one.at)}: this match has it closed, and the proof keeps it "
                      "closed by a mean torque" for one in seen],
            "values": [], "torque_gains": {one.name: one.torque_gain for one in case.loop.dynamometers},
            "ended_early": None,
        })  # fmt: skip
        return self._folder / "1_play" / "case.toml"

    def _with_measured(self, path: Path, case: Case) -> Path:
        """The case with what the check of the channels measured of its bed; a match that is given stays."""
        assert self._channels is not None
        measured = [Deviation(**{**one, "or_else": tuple(one["or_else"])}) for one in self._channels["measured"]]
        made, values = measured_case(case, measured)
        told = [f"{one['words']}: beyond what the case states" + (f"; write {one['line']}" if one["line"] else "")
                for one in self._channels["off"]]  # fmt: skip
        before = self._rounds[-1].identification or {
            "verdict": "of the check of the channels",
            "causes": [],
            "notes": [],
        }
        self._found(identification={
            "verdict": before["verdict"], "causes": before["causes"], "notes": [*before["notes"], *told],
            "values": [value.to_dict() for value in values],
            "torque_gains": {one.name: one.torque_gain for one in made.loop.dynamometers}, "ended_early": None,
        })  # fmt: skip
        if path.is_dir():  # its controller is run as it is
            return path
        self._stages.run(MEASURED, _of_case(case) + repr(measured), lambda: (case_files(made), {}))
        return self._folder / MEASURED / "case.toml"

    def _matched(self, path: Path, number: int) -> Path:
        if path.is_dir():
            self._found(match={"status": "as given"})
            return path
        self._tell(f"round {number} of {self._order.rounds} at most: match")
        case = load_case(path)

        def work() -> tuple[Files, dict[str, Any]]:
            # a case that a match has tuned before begins near its answer
            result = match(case, self._order.seed, 1 if number > 1 else None)
            entries = result.to_dict()
            files = {"result.json": strict_json(entries), **case_files(result.tuned)}
            told = {key: entries.get(key) for key in ("structure", "targets", "response_error", "beds")}
            return files, {"status": result.status, "limits": list(result.limits), **told}

        name = f"{number}_match"
        self._found(match=self._stages.run(name, checksum(f"{_of_case(case)} seed {self._order.seed}"), work))
        return self._folder / name

    def _exported(self, case: Case, name: str) -> None:
        self._tell(f"export the controller to {name}")

        def work() -> tuple[Files, dict[str, Any]]:
            return {"controller.fmu": controller_fmu(exported_controller(case)).content}, {}

        self._stages.run(name, _of_case(case), work)

    def _checked(self, case: Case, number: int) -> dict[str, Any]:
        """The channels, before anything is fed back; after a trip that no channel explains, with smaller torques."""
        self._exported(case, CHECKING)
        for share in SHARES_OF_TORQUE:
            found = self._checked_with(case, number, share)
            if not found["tripped"] or found["wrong"]:
                break
        return found

    def _checked_with(self, case: Case, number: int, share: float) -> dict[str, Any]:
        """The channels by a share of the torques of their check."""
        of_torque = "" if share == 1 else f"{100 * share:.0f} % of the torques, after a trip"
        self._tell(f"round {number} of {self._order.rounds} at most: check the channels {of_torque}".rstrip())
        name, plan = f"{number}_channels" if share == 1 else f"{number}_channels_{share:g}", plan_channels(case, share)
        exported, taken = self._folder / CHECKING / "controller.fmu", HandedRecording(BY_FMU, "")

        def recorded(known: Mapping[str, tuple[str, float]]) -> tuple[Recording, str]:
            nonlocal taken
            tripped = ""
            if not self._bed.is_file():
                taken = self._by_hand.recording(
                    name, {"excitation.csv": plan.csv()},
                    f"at rest, run {CHECKING}/controller.fmu in the mode 3 (check of the channels) with the "
                    f"torques of {name}_excitation.csv as added torques and demands, and record them with every "
                    "sensor of the rig",
                    lambda path: judge_channels(case, read_recording(path, bed_system(case), self._names)).sentence(),
                )  # fmt: skip
            else:
                law = exported_controller(case).law
                with self._fmu(case) as bed, FmuController(exported, law) as controller:
                    content, tripped = channel_recording(bed, case, law, controller, plan, known)
                taken = HandedRecording(BY_FMU, content)
            keep_recording(self._folder / name, taken)
            return read_recording(self._folder / name / taken.name, bed_system(case), self._names), tripped

        def work() -> tuple[Files, dict[str, Any]]:
            found = check_channels(case, recorded).to_dict()
            return {taken.name: taken.content, "channels.json": strict_json(found)}, found

        return self._stages.run(name, self._of_run(plan.csv() + _of_case(case)), work, lambda _: self._as_handed(name))

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
                    lambda path: so_far(judge(case, read_recordings([path], case, self._names))),
                )  # fmt: skip
            else:
                made = exported_controller(case)
                with (
                    self._fmu(case) as bed,
                    FmuController(exported, made.law) as controller,
                    vehicle_beside(case, made.law, speed) as vehicle,
                ):
                    try:
                        running = made.running()
                        text = proof_recording(bed, case, made.law, controller, wanted, speed, running, vehicle)
                    except Tripped as fault:
                        keep_recording(self._folder / name, HandedRecording(BY_FMU, fault.recording))
                        return {BY_FMU: fault.recording}, self._not_judged(fault) | {"tripped": fault.wrong}
                taken = HandedRecording(BY_FMU, text)
            keep_recording(self._folder / name, taken)
            recorded = read_recordings([self._folder / name / taken.name], case, self._names)
            planned = dict(zip(wanted.inputs, wanted.torques.T, strict=True))
            check_excitation(recorded.recordings[0], planned, wanted.step)
            try:
                verification = judge(case, recorded)
            except NotThisBed as fault:
                files = {taken.name: taken.content, "proof.json": strict_json(wanted.to_dict())}
                return files, self._not_judged(fault)
            self._judged[number] = verification
            planned = {one.name: one.largest for one in wanted.expected}
            result = verification.to_dict() | {"planned": planned}
            if short := what_is_short(verification):
                result["diagnosis"] = Reason("", tuple(short)).to_dict()
            files = {taken.name: taken.content, "proof.json": strict_json(wanted.to_dict())}
            return files | {"verification.json": strict_json(result)}, result

        def enough(figures: Mapping[str, Any]) -> bool:
            gone_on = any((self._folder / f"{number + 1}_{step}").is_dir() for step in ("excite", "diagnose"))
            return self._as_handed(name) and (gone_on or not figures.get("tripped"))  # a trip is where it goes on

        return self._stages.run(name, self._of_run(_of_case(case)), work, enough)

    def _not_judged(self, fault: InputError) -> dict[str, Any]:
        """A round whose bed is so unlike its model that nothing is judged; where the channels are right, it goes on."""
        if self._channels is None:
            raise fault
        return {"status": "unlike_model", "sentence": f"{fault.wrong}", "errors": [], "functions": [], "modes": [],
                "open": [], "fidelity": [], "notes": []}  # fmt: skip

    def _identified(self, number: int) -> dict[str, Any]:
        """Excite, record, diagnose. With free play the proof is diagnosed, whose mean torque keeps the play closed."""
        case = self._tuned[number - 1]
        proven, closed = self._folder / f"{number - 1}_verify", bool(case.rig.free_plays)
        if closed and (proven / "proof.json").is_file():
            recorded = kept_recording(proven)
        else:
            recorded, closed = self._excited(case, number), False
        self._tell(f"round {number} of {self._order.rounds} at most: diagnose")

        def work() -> tuple[Files, dict[str, Any]]:
            bed = bed_from_recordings(
                case, [recorded], lambda step: self._tell(f"diagnose: {step}"), self._order.diagnosis_limit,
                closed=closed, last=self._order.excitation.duration if closed else None, channels=self._names,
            )  # fmt: skip
            return bed.files(), bed.to_dict()

        return self._stages.run(
            f"{number}_diagnose", self._stages.of_files(recorded) + _of_case(case), work, self._long_enough
        )

    def _excited(self, case: Case, number: int) -> Path:
        """The recording of the bed without emulation under the torques that tell most."""
        self._tell(f"round {number} of {self._order.rounds} at most: excite")

        @cache
        def plan() -> ExcitationPlan:  # some seconds, and needed only by steps that are not done
            return plan_excitation(case, self._order.excitation)

        self._stages.run(
            f"{number}_excite", checksum(_of_case(case) + repr(self._order.excitation)),
            lambda: ({"excite.json": strict_json(plan().to_dict()), "excitation.csv": excitation_csv(plan())}, {}),
        )  # fmt: skip
        self._recorded(case, plan, number)
        return kept_recording(self._folder / f"{number}_record")

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
                    lambda path: f"{read_recording(path, bed_system(case), self._names).time[-1]:.1f} s are recorded",
                )  # fmt: skip
            else:
                with self._fmu(case) as bed:
                    taken = HandedRecording(BY_FMU, excited_recording(bed, case, plan()))
            keep_recording(self._folder / name, taken)
            return {taken.name: taken.content}, {}

        self._stages.run(name, self._of_run(excitation + _of_case(case)), work, lambda _: self._as_handed(name))

    def _as_handed(self, name: str) -> bool:
        """Whether nobody put another recording into the bed's folder since the step took one."""
        return self._bed.is_file() or self._by_hand.unchanged(name, kept_recording(self._folder / name))

    def _of_run(self, plan: str) -> str:
        """Checksum of what a run of the bed depends on: its plan, the order, and the bed itself."""
        bed = self._stages.of_files(self._bed) if self._bed.is_file() else str(self._bed.resolve())
        return checksum(f"{plan} {self._order.excitation!r} {bed}")

    def _fmu(self, case: Case) -> FmuBed:
        return bed_of(self._bed, case)


def plan_speed(case: Case, order: CommissionOrder) -> float:
    """Steady speed of the rotors, rad/s, of both kinds of run."""
    return steady_speed(case) if order.excitation.speed is None else order.excitation.speed


def _case_at(path: Path) -> Case:
    """The case of a case file, or of a match's directory as tuned."""
    return tuned_case(path).tuned if path.is_dir() else load_case(path)


def _of_case(case: Case) -> str:
    """Checksum of a case, and of the FMU of its vehicle."""
    vehicle = case.vehicle_in_the_loop
    fmu = Path(vehicle.fmu).read_bytes() if vehicle is not None and Path(vehicle.fmu).is_file() else b""
    return checksum(str(case_files(case)) + (checksum(fmu) if fmu else ""))


# --- Why short

MOST_TOLD = 6  # quantities that are off
LEAST_PART = 0.1  # of the response error of the one that makes most of it: what makes less is not told


@dataclass(frozen=True)
class Reason:
    """What a diagnosis of the bed behind its controller says.

    Attributes
    ----------
    verdict : str
        Of the diagnosis; empty where there was none.
    sentences : tuple of str
        Causes with their evidence, quantities that are off and the error that they make, or why nothing was diagnosed.
    """

    verdict: str
    sentences: tuple[str, ...]

    def to_dict(self) -> dict[str, Any]:
        """As ``verification.json`` holds it."""
        return {"verdict": self.verdict or None, "sentences": list(self.sentences)}


def why_short(
    case: Case,
    verification: BedVerification,
    recordings: Sequence[str | Path],
    channels: Mapping[str, Channel] | None = None,
    progress: Callable[[str], None] = lambda _: None,
    seconds: float | None = DIAGNOSIS_LIMIT,
    last: float | None = None,
) -> Reason | None:
    """What of a verification is ``short``, and what a diagnosis of its recordings says; None for any other.

    ``seconds``: of processor time, after which the diagnosis ends with its best answer so far. ``last`` (s): so much of
    each recording is diagnosed, from its end; None: all of it.

    They need the torque commands beside the sensors: between commands and readings the bed is as it is without
    control, whatever the controller does.
    """
    if verification.status != "short":
        return None
    system, judged = bed_system(case), what_is_short(verification)
    inputs = [part.name for part in system.inputs]
    for path in recordings:
        missing = sorted(set(inputs) - set(read_signals(Path(path), set(inputs), channels).channels))
        if missing:
            needed = f"{path} does not hold {', '.join(missing)}: record the torque commands as well, or use commission"
            return Reason("", (*judged, needed))
    found = bed_from_recordings(
        case, [Path(path) for path in recordings], progress, seconds, closed=bool(case.rig.free_plays), last=last,
        channels=channels,
    )  # fmt: skip
    diagnosed = found.to_dict()
    causes = [f"{cause['kind']} at {cause['at']}: {cause['evidence']}" for cause in diagnosed["causes"]]
    nothing = "The diagnosis finds nothing that is off beyond its uncertainty."
    return Reason(found.diagnosis.verdict, (*judged, *([*causes, *_what_is_off(case, found.values)] or [nothing])))


def _what_is_off(case: Case, values: Sequence[IdentifiedValue]) -> list[str]:
    """Quantities of the bed that are off beyond their uncertainty, with the response error that each makes alone; those
    that make most of it. A value at the end of its range is none that was found."""
    known = replace(case, uncertainty=case.uncertainty.without("vehicle."))
    weights = np.sqrt(np.maximum(np.diag(error_weights(known)), 0.0))
    rows = []
    for quantity, value, weight in zip(known.uncertainty.uncertain, values, weights, strict=True):
        gain = value.name.endswith(GAIN)
        off = abs(value.after - value.before)
        if value.found and off > value.half_width:
            rows.append((float(weight * off / (quantity.half_width * (value.before if gain else 1.0))), value, gain))
    rows.sort(key=lambda row: -row[0])
    said = []
    for alone, value, gain in rows[:MOST_TOLD]:
        if alone < LEAST_PART * rows[0][0]:
            break
        now = _with(value.after, value.half_width / COVERAGE_FACTOR)
        what = f"{value.name} is {now} instead of {value.before:.6g}"
        if gain:
            dynamometer = value.name.removeprefix("dynamometers.").removesuffix(GAIN)
            what = f"{dynamometer} gives {now} times what it is asked for, not {value.before:.6g}"
        said.append(f"{what}: alone a response error of {alone:.2g}")
    return said


def what_is_short(verification: BedVerification) -> list[str]:
    """Errors and target modes that fall short, each next to what it should be."""
    errors = [
        f"the response error to {error.name} torques is {_with(error.value, error.uncertainty)}, where "
        f"{error.predicted:.2g} was predicted and {error.allowed:.2g} is allowed"
        for error in verification.errors if error.status == "short"
    ]  # fmt: skip
    modes = []
    for mode in verification.modes:
        bed, vehicle = mode.measured, mode.vehicle
        if mode.status == "short" and bed is not None:
            modes.append(
                f"vehicle mode {mode.number}: {_with(bed.frequency, bed.frequency_uncertainty)} Hz for "
                f"{vehicle[0]:.4g} Hz, damping {_with(bed.damping_ratio, bed.damping_uncertainty)} for {vehicle[1]:.3g}"
            )
    return [*errors, *modes]


def _with(value: float, standard: float) -> str:
    """A value with its expanded uncertainty, both to two digits of that."""
    expanded = COVERAGE_FACTOR * standard
    if not expanded > 0 or not math.isfinite(expanded):
        return f"{value:.3g}"
    digits = max(0, 1 - math.floor(math.log10(expanded)))
    return f"{value:.{digits}f} ± {expanded:.{digits}f}"
