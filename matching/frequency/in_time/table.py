"""How far imperfect beds are from the nonlinear vehicle over the manoeuvre, and what they do with an open lash."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from matching.frequency.case.case import Case
from matching.frequency.in_time.closed_loop import BedMotion, BedRun, bed_motions, vehicle_motions
from matching.frequency.in_time.imperfection import EVERYTHING_DRAWN, Imperfection, imperfections
from matching.frequency.in_time.open_lash import OpenLash, lash_runs, open_lash
from matching.frequency.loop.control_law import control_law
from matching.frequency.loop.parts import parts_of, shaft_torque
from matching.frequency.verification.reading import manoeuvre_torques
from modelling.common.errors import InputError
from modelling.controller.law import ControlLaw
from modelling.model.components import Sensor
from modelling.simulation.result import SimulationError

WATCHED_S = 3.0  # of the manoeuvre at most, from its beginning
SMALLEST_RANGE = 1e-300  # of a signal that the manoeuvre leaves at rest


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
        return max(np.inf if errors is None else max(errors.values()) for errors in both)


@dataclass(frozen=True)
class BedTraces:
    """One bed for a figure: what is wrong, time (t,), by sensor (t,) vehicle and bed, torques measured and not."""

    words: str
    time: np.ndarray
    vehicle: Mapping[str, np.ndarray]
    measured: Mapping[str, np.ndarray]
    unmeasured: Mapping[str, np.ndarray]


@dataclass(frozen=True)
class TruthInTime:
    """The tuned controller on beds that are not the model.

    Attributes
    ----------
    sensors : tuple of str
        Of the compared functions.
    rows : tuple of TimeErrors
        For what is wrong; of the drawn beds with everything wrong the worst.
    lash : OpenLash or None
        None where no input but the dynamometers' could open one.
    seconds : float
        Of the manoeuvre.
    not_simulated : str
        Why there is nothing; empty otherwise.
    traces : BedTraces or None
        Of the worst bed with everything wrong; None where it is not stable.
    """

    sensors: tuple[str, ...] = ()
    rows: tuple[TimeErrors, ...] = ()
    lash: OpenLash | None = None
    seconds: float = 0.0
    not_simulated: str = ""
    traces: BedTraces | None = field(repr=False, default=None)

    def to_dict(self) -> dict[str, Any]:
        """As ``result.json`` holds it."""
        return {
            "duration": self.seconds, "sensors": list(self.sensors), "rows": [row.to_dict() for row in self.rows],
            "open_lash": None if self.lash is None else self.lash.to_dict(), "not_simulated": self.not_simulated,
        }  # fmt: skip


def truth_of(case: Case, seed: int = 0) -> TruthInTime:
    """The table of a tuned case over its manoeuvre; where it cannot be simulated the result says why."""
    if case.loop.torqueless:
        return TruthInTime(not_simulated="the dynamometers give no torque")
    try:
        parts = parts_of(case)
        torques, lead = manoeuvre_torques(parts)
        return truth_in_time(case, control_law(parts), torques, lead, seed)
    except (InputError, SimulationError) as fault:
        return TruthInTime(not_simulated=str(fault))


def truth_in_time(
    case: Case, law: ControlLaw, torques: Mapping[str, np.ndarray], lead: int = 0, seed: int = 0
) -> TruthInTime:
    """Run a law on imperfect beds over a manoeuvre.

    Parameters
    ----------
    torques : mapping of str to ndarray (t,)
        The manoeuvre by input, one value a sample.
    lead : int
        Samples at the beginning that only lead in and do not count.
    seed : int
        Of the drawn beds and the noise.

    Raises
    ------
    InputError, SimulationError
        If an imperfect vehicle has no operating point or cannot be simulated.
    """
    count = min(len(next(iter(torques.values()))), lead + round(WATCHED_S / law.sample_time) + 1)
    torques = {name: torque[:count] for name, torque in torques.items()}
    sensors = tuple(dict.fromkeys(pair.sensor for pair in case.compared))
    case, cuts = with_cut_torques(case)
    alone = vehicle_motions(case, [BedRun(Imperfection(""), torques)], cuts)[0]
    rows = imperfections(case, float(np.abs(alone).max(initial=0.0)), seed)
    known = tuple(name for name in law.known if name in {part.name for part in case.rig.inputs})
    lashed = lash_runs(case, torques, known, seed)
    runs = [BedRun(row, torques, measured) for row in rows for measured in (known, ())]
    read = (*sensors, *cuts)
    of_vehicles, of_beds = _simulated(case, law, [*runs, *lashed], read, seed)
    results = [
        TimeErrors(row.words, *(_errors(of_beds[2 * i + j], of_vehicles[2 * i], sensors, lead) for j in (0, 1)))
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
    at, first = [read.index(name) for name in cuts], len(runs)
    lash = open_lash(of_vehicles[first:], of_beds[first:], at, law.sample_time) if lashed else None
    return TruthInTime(sensors, tuple(kept), lash, float(time[-1]), "", traces)


def with_cut_torques(case: Case) -> tuple[Case, list[str]]:
    """The case with a sensor of the torque at each cut in vehicle and rig, and their names: models may have none."""
    added = [Sensor(shaft_torque(cut.shaft), "torque", cut.shaft) for cut in case.residual_vehicle.interfaces]
    vehicle, rig = (replace(system, sensors=(*system.sensors, *added)) for system in (case.vehicle, case.rig))
    return replace(case, vehicle=vehicle, rig=rig), [sensor.name for sensor in added]


def _simulated(
    case: Case, law: ControlLaw, runs: Sequence[BedRun], sensors: Sequence[str], seed: int
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
        beds |= dict(zip(places, bed_motions(case, law, chosen, sensors, seed), strict=True))
    return [vehicles[i] for i in range(len(runs))], [beds[i] for i in range(len(runs))]


def _errors(bed: BedMotion | None, vehicle: np.ndarray, sensors: tuple[str, ...], lead: int) -> dict[str, float] | None:
    if bed is None:
        return None
    off, wanted = (bed.readings - vehicle)[lead:, : len(sensors)], vehicle[lead:, : len(sensors)]
    share = np.sqrt(np.mean(off**2, axis=0)) / np.maximum(np.ptp(wanted, axis=0), SMALLEST_RANGE)
    return dict(zip(sensors, share.tolist(), strict=True))
