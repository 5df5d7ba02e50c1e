"""The tuned controller as it runs, on beds that are not the model, next to the nonlinear vehicle."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from matching.match.case import Case
from matching.match.exported import exported_controller
from matching.match.free_play import FREE_PLAY, pulse_at_hardest, swing
from matching.match.imperfections import (
    EVERYTHING_DRAWN,
    BedMotion,
    BedRun,
    Imperfection,
    bed_motions,
    imperfections,
    vehicle_motions,
    with_cut_torques,
)
from matching.match.loop import linear_bed, shaft_torque
from matching.match.verify import manoeuvre_torques
from modelling.controller.law import ExportedController
from modelling.errors import NoDesign
from modelling.fidelity.over_range import error_over_range
from modelling.running.controllers import unsupervised
from modelling.simulation.stepping import SimulationError

# --- Whether the counts of encoders keep a bed swinging at standstill.

COME_TO_REST_S = 4.0  # after a pulse and its opposite, which leave no speed behind


@dataclass(frozen=True)
class Standstill:
    """What encoders alone do after a pulse and its opposite, against the same bed with exact speeds.

    Attributes
    ----------
    command, flange : float
        N·m rms over the last two seconds, of the worst dynamometer: what encoders add to the command and to the torque
        at the flange, without one in the cut shaft. Noise and offset add to that.
    """

    command: float
    flange: float


def standstill(
    case: Case, controller: ExportedController, torques: Mapping[str, np.ndarray], known: tuple[str, ...]
) -> Standstill | None:
    """The bed of a case without an operating point; None where it turns, where no input could move it, or where it is
    not stable.

    Parameters
    ----------
    torques : mapping of str to ndarray (t,)
        The manoeuvre, which says how large the pulse is.
    """
    pulse = pulse_at_hardest(case, torques, round(COME_TO_REST_S / controller.law.sample_time))
    if not pulse or case.rig.operating_point is not None:
        return None
    back = round((FREE_PLAY.pulse[1] - FREE_PLAY.pulse[0]) / controller.law.sample_time)
    both = {name: torque - np.roll(torque, back) for name, torque in pulse.items()}
    runs = [BedRun(Imperfection("", encoders=encoders), both, known) for encoders in (True, False)]
    case, _ = with_cut_torques(case)
    torques_read = [one.torque_sensor or shaft_torque(one.follows) for one in case.loop.dynamometers]
    counting, exact = bed_motions(case, controller, runs, torques_read)
    if counting is None or exact is None:
        return None
    count = len(exact.commands) // 2
    off = counting.commands - exact.commands, counting.readings - exact.readings
    return Standstill(*(float(swing(torque[-count:]).max()) for torque in off))


# --- How far imperfect beds are from the nonlinear vehicle over the manoeuvre, and what they do with an open lash.

WATCHED_S = 3.0  # of the manoeuvre at most, from its beginning


@dataclass(frozen=True)
class TimeErrors:
    """Errors of one bed: root mean square over the range of the vehicle's signal; None where the bed is not stable.

    ``measured`` and ``unmeasured`` by sensor: the controller knows the rig's torques, or not.
    """

    words: str
    measured: Mapping[str, float] | None
    unmeasured: Mapping[str, float] | None

    def to_dict(self) -> dict[str, Any]:
        """As ``result.json`` holds it."""
        return {"what_is_wrong": self.words, "measured": self.measured, "unmeasured": self.unmeasured}

    def largest(self) -> float:
        """Over sensors and both kinds of torques; infinite where a bed is not stable."""
        both = (self.measured, self.unmeasured)
        return max(np.inf if errors is None else max(errors.values(), default=0.0) for errors in both)


@dataclass(frozen=True)
class BedTraces:
    """One bed for a figure: what is wrong, time (t,), by sensor (t,) vehicle and bed, torques measured and not."""

    words: str
    time: np.ndarray
    vehicle: Mapping[str, np.ndarray]
    measured: Mapping[str, np.ndarray]
    unmeasured: Mapping[str, np.ndarray]


@dataclass(frozen=True)
class InTime:
    """The tuned controller on beds that are not the model.

    Attributes
    ----------
    sensors : tuple of str
        Of the compared functions.
    rows : tuple of TimeErrors
        For what is wrong; of the drawn beds with everything wrong the worst.
    standstill : Standstill or None
        None where the case has an operating point, or no input but the dynamometers' could move the bed.
    seconds : float
        Of the manoeuvre.
    not_simulated : str
        Why there is nothing; empty otherwise.
    traces : BedTraces or None
        Of the worst bed with everything wrong; None where it is not stable.
    """

    sensors: tuple[str, ...] = ()
    rows: tuple[TimeErrors, ...] = ()
    standstill: Standstill | None = None
    seconds: float = 0.0
    not_simulated: str = ""
    traces: BedTraces | None = field(repr=False, default=None)

    def to_dict(self) -> dict[str, Any]:
        """As ``result.json`` holds it."""
        return {
            "duration": self.seconds, "sensors": list(self.sensors), "rows": [row.to_dict() for row in self.rows],
            "encoders_at_standstill": None if self.standstill is None else dict(vars(self.standstill)),
            "not_simulated": self.not_simulated,
        }  # fmt: skip


def simulate_deviations(case: Case, seed: int = 0) -> InTime:
    """The table of a tuned case over its manoeuvre; where it cannot be simulated the result says why."""
    if case.loop.torqueless:
        return InTime(not_simulated="the dynamometers give no torque")
    try:
        torques, lead = manoeuvre_torques(linear_bed(case))
        return errors_in_time(case, unsupervised(exported_controller(case)), torques, lead, seed)
    except (NoDesign, SimulationError) as fault:
        return InTime(not_simulated=str(fault))


def errors_in_time(
    case: Case, controller: ExportedController, torques: Mapping[str, np.ndarray], lead: int = 0, seed: int = 0
) -> InTime:
    """Run an exported controller on imperfect beds over a manoeuvre, after a speed hold.

    Parameters
    ----------
    torques : mapping of str to ndarray (t,)
        The manoeuvre by input, one value a sample.
    lead : int
        Samples at the beginning that only lead in and do not count.
    seed : int
        Of the drawn beds and the noise.
    """
    law = controller.law
    count = min(len(next(iter(torques.values()))), lead + round(WATCHED_S / law.sample_time) + 1)
    torques = {name: torque[:count] for name, torque in torques.items()}
    sensors = tuple(dict.fromkeys(pair.sensor for pair in case.compared))
    case, cuts = with_cut_torques(case)
    alone = vehicle_motions(case, [BedRun(Imperfection(""), torques)], cuts)[0]
    rows = imperfections(case, float(np.abs(alone).max(initial=0.0)), seed)
    known = tuple(name for name in law.known if name in {part.name for part in case.rig.inputs})
    measures = {sensor.name: sensor.measures for sensor in case.rig.sensors}
    kinds = [measures[name] for name in sensors]
    runs = [BedRun(row, torques, measured) for row in rows for measured in (known, ())]
    read = (*sensors, *cuts)
    of_vehicles, of_beds = _simulated(case, controller, runs, read, seed)
    results = [
        TimeErrors(row.words, *(_errors(of_beds[2 * i + j], of_vehicles[2 * i], sensors, lead, kinds) for j in (0, 1)))
        for i, row in enumerate(rows)
    ]
    every = [i for i, row in enumerate(rows) if row.words == EVERYTHING_DRAWN]
    worst = max(every, key=lambda i: results[i].largest())
    time = (np.arange(count) - lead) * law.sample_time
    signals = [of_vehicles[2 * worst], *(bed.readings for bed in of_beds[2 * worst : 2 * worst + 2] if bed is not None)]
    traces = None
    if len(signals) == 3:
        traces = BedTraces(EVERYTHING_DRAWN, time, *(dict(zip(sensors, signal.T, strict=False)) for signal in signals))
    kept = [results[i] for i in range(len(rows)) if i not in every or i == worst]
    still = standstill(case, controller, torques, known)
    return InTime(sensors, tuple(kept), still, float(time[-1]), "", traces)


def _simulated(
    case: Case, controller: ExportedController, runs: Sequence[BedRun], sensors: Sequence[str], seed: int
) -> tuple[list[np.ndarray], list[BedMotion | None]]:
    """Vehicle and bed of every run; those without and those with lash side by side."""
    vehicles: dict[int, np.ndarray] = {}
    beds: dict[int, BedMotion | None] = {}
    for lash in (False, True):
        places = [i for i, run in enumerate(runs) if (run.imperfection.gap > 0) == lash]
        chosen = [runs[i] for i in places]
        distinct = {id(run.imperfection): run for run in chosen}
        motions = dict(zip(distinct, vehicle_motions(case, [*distinct.values()], sensors), strict=True))
        vehicles |= {i: motions[id(runs[i].imperfection)] for i in places}
        beds |= dict(zip(places, bed_motions(case, controller, chosen, sensors, seed), strict=True))
    return [vehicles[i] for i in range(len(runs))], [beds[i] for i in range(len(runs))]


def _errors(
    bed: BedMotion | None, vehicle: np.ndarray, sensors: tuple[str, ...], lead: int, kinds: Sequence[str]
) -> dict[str, float] | None:  # fmt: skip
    if bed is None:
        return None
    wanted, found = (each[lead:, : len(sensors)] for each in (vehicle, bed.readings))
    return error_over_range(wanted, found, kinds=kinds).by_name(sensors)
