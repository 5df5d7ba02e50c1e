"""The observer in time on many drawn beds with everything wrong at once: `python -m tests.benchmarks.observer_in_time`.

The reference drive with weights tuned as a match tunes them, on ``--beds`` beds drawn from its ``[uncertainty]`` (4 a
seed, as a match draws them) with all that :mod:`matching.frequency.in_time.imperfection` makes wrong, then with all but
one thing at a time. ``ROW`` is one of :mod:`tests.benchmarks.observer_table`. ``--limit command_noise=30`` changes a
limit of the case, ``--closed`` leaves beds with opened cut shafts out of the search, ``--short`` everything but the
first rows. A row of the table takes about 3 s of one core.
"""

import argparse
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any
from unittest import mock

import numpy as np

from matching.match import tune_observer as tuning
from matching.match.case import Case
from matching.match.in_time import (
    DRAWN_BEDS,
    EVERYTHING_DRAWN,
    EVERYTHING_STATED,
    WATCHED_S,
    BedRun,
    Imperfection,
    bed_motions,
    imperfections,
    vehicle_motions,
)
from matching.match.loop import control_law, linear_bed
from matching.match.tune_observer import tuner, with_opened
from matching.match.verify import manoeuvre_torques
from tests.benchmarks.observer_table import case_of, changed

ALLOWED = 0.025  # that was asked for measured torques on the bed whose values are stated
HEAD = f"| | measured torques: median, 95 %, largest | unmeasured | above {ALLOWED:.1%} |\n|---|---|---|---|"
LEFT_OUT: dict[str, Callable[[str], bool]] = {
    "stiffnesses": lambda name: name.endswith(".stiffness"),
    "dampings": lambda name: name.endswith(".damping"),
    "inertias": lambda name: name.endswith(".J"),
    "dead time and lags": lambda name: name.startswith("loop."),
    "gains of the dynamometers": lambda name: name.startswith("dynamometers."),
    "gains of the sensors": lambda name: name.startswith("sensors."),
}
HARMLESS: dict[str, dict[str, Any]] = {
    "lash": {"gap": 0.0},
    "dry friction": {"friction": 0.0},
    "driving torque off and late": {"demand_factor": 1.0, "demand_late": 0.0},
    "noise, offset, encoders": {"poor_sensors": False},
}


class Trial:
    """A tuned case over its manoeuvre."""

    def __init__(self, case: Case):
        parts = linear_bed(case)
        torques, lead = manoeuvre_torques(parts)
        count = lead + round(WATCHED_S / case.loop["sample_time"]) + 1
        self._case, self._law, self._lead = case, control_law(parts), lead
        self._torques = {name: torque[:count] for name, torque in torques.items()}
        self._sensors = tuple(dict.fromkeys(pair.sensor for pair in case.compared))
        (alone,) = vehicle_motions(case, [BedRun(Imperfection(""), self._torques)], self._sensors)
        torque_sensors = {sensor.name for sensor in case.vehicle.sensors if sensor.measures == "torque"}
        at = [i for i, name in enumerate(self._sensors) if name in torque_sensors]
        self.largest_torque = float(np.abs(alone[:, at]).max())

    def errors(self, beds: Sequence[Imperfection]) -> np.ndarray:
        """Largest error of any sensor (b, 2), measured and unmeasured torques; infinite where a bed is not stable."""
        on_rig = {part.name for part in self._case.rig.inputs}
        known = tuple(name for name in self._law.known if name in on_rig)
        vehicles = vehicle_motions(self._case, [BedRun(bed, self._torques) for bed in beds], self._sensors)
        found = []
        for told in (known, ()):
            runs = [BedRun(bed, self._torques, told) for bed in beds]
            motions = bed_motions(self._case, self._law, runs, self._sensors)
            found.append([
                np.inf if motion is None else self._error(motion.readings, vehicle)
                for motion, vehicle in zip(motions, vehicles, strict=True)
            ])  # fmt: skip
        return np.array(found).T

    def _error(self, bed: np.ndarray, vehicle: np.ndarray) -> float:
        off, wanted = (bed - vehicle)[self._lead :], vehicle[self._lead :]
        return float((np.sqrt(np.mean(off**2, axis=0)) / np.ptp(wanted, axis=0)).max())


def line(words: str, errors: np.ndarray) -> str:
    """One row of the table."""
    cells = [
        ", ".join(f"{100 * value:.2f}" for value in (*np.quantile(each, [0.5, 0.95]), each.max())) for each in errors.T
    ]
    return f"| {words} | {cells[0]} % | {cells[1]} % | {(errors[:, 0] > ALLOWED).sum()} of {len(errors)} |"


def tuned(case: Case, closed: bool) -> Case:
    """The case with its weights tuned."""
    with mock.patch.object(tuning, "with_opened", (lambda _, best, __: best) if closed else with_opened):
        weights, _ = tuning.tuned_weights(tuner(case))
    return replace(case, loop=case.loop.with_values(weights))


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("row", nargs="?", default="3g")
    parser.add_argument("--beds", type=int, default=40)
    parser.add_argument("--limit", action="append", default=[], type=changed, metavar="NAME=VALUE")
    parser.add_argument("--closed", action="store_true")
    parser.add_argument("--short", action="store_true")
    options = parser.parse_args()
    case = tuned(case_of(options.row, dict(options.limit), {}), options.closed)
    trial = Trial(case)
    rows = [imperfections(case, trial.largest_torque, seed) for seed in range(-(-options.beds // DRAWN_BEDS))]
    drawn = [row for of_seed in rows for row in of_seed if row.words == EVERYTHING_DRAWN][: options.beds]
    stated = next(row for row in rows[0] if row.words == EVERYTHING_STATED)
    print(HEAD, line(EVERYTHING_STATED, trial.errors([stated])), line("bed drawn", trial.errors(drawn)), sep="\n")
    if options.short:
        return
    for words, is_known in LEFT_OUT.items():
        values = [{name: value for name, value in bed.values.items() if not is_known(name)} for bed in drawn]
        beds = [replace(bed, values=of_bed) for bed, of_bed in zip(drawn, values, strict=True)]
        print(line(f"all but {words}", trial.errors(beds)), flush=True)
    for words, change in HARMLESS.items():
        print(line(f"all but {words}", trial.errors([replace(bed, **change) for bed in drawn])), flush=True)


if __name__ == "__main__":
    main()
