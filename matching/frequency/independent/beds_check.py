"""Fresh beds drawn from what is not known exactly, judged by the assembly of this room."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from matching.frequency.case.case import Case
from matching.frequency.independent.chain import Chain, NotCovered
from matching.frequency.independent.closed_loop import plain_responses
from matching.frequency.independent.drawn_bed import DrawnBed
from matching.frequency.independent.opened_shafts import dampings_opened
from matching.frequency.independent.worst_bed import LargestError, WorstBed, largest_error, worst_bed
from modelling.controller.law import ControlLaw

POINTS = 150  # of the response error over the band, midpoints of equal parts of its logarithm
AT_REST = 1e-7  # of z: a rigid motion stands at 1; rounding moves it by less
SLOWEST_SWING_RAD_S = 1.0  # below, a pair of poles is a drift, not a mode
LEFT_TO_ITS_OWN = 0.95  # of the damping of a mode of the bed's own, where the loop has rolled off
MODES = 16  # of a bed, the least damped ones, that the search for the worst bed looks at
LOWEST_Z = 1e-3  # poles that decay faster from sample to sample have no frequency worth a number


@dataclass(frozen=True)
class BedVerdict:
    """One bed: stable or not, its least damping ratio, damped enough or not, errors to measured, unmeasured torques."""

    stable: bool
    damping_ratio: float
    damped: bool
    measured: float
    unmeasured: float


@dataclass(frozen=True)
class BedsCheck:
    """Of all drawn beds; ``not_covered`` says what of the case this method does not know, all else is empty then.

    Attributes
    ----------
    drawn, stable, damped : int
        ``damped`` beds have every mode damped by ``required_damping`` at least, or, of those where the loop has rolled
        off, by what the bed without control leaves it at least.
    smallest_damping_ratio, required_damping : float
    measured, unmeasured : tuple of float
        Response errors of every stable bed, smallest first, each against the vehicle with the same specimen.
    worst : WorstBed or None
        The least damped bed of the box that descents from the bed as planned and from the worst drawn one find.
    largest_error : LargestError or None
        The bed with the largest error to unmeasured torques that an ascent from the worst of the drawn ones finds.
    opened : mapping of float to float
        Least damping ratio of the bed as planned, by the share that is left of its cut shafts' stiffness and damping;
        −1 where it grows without swinging. In ``result.json``: ``opened_cut_shafts``, a list with ``share_left``,
        ``damping_ratio``, ``stable`` and ``smallest_damping_ratio_alone``, that with one cut shaft opened alone.
    opened_alone : mapping of str to mapping of float to float
        The same where one cut shaft opens and the others do not, by its name.
    """

    drawn: int
    stable: int
    damped: int
    smallest_damping_ratio: float
    required_damping: float
    measured: tuple[float, ...]
    unmeasured: tuple[float, ...]
    worst: WorstBed | None = None
    largest_error: LargestError | None = None
    not_covered: str = ""
    opened: Mapping[float, float] = field(default_factory=dict)
    opened_alone: Mapping[str, Mapping[float, float]] = field(default_factory=dict)

    @property
    def holds(self) -> bool:
        """Whether every bed is stable and damped."""
        return not self.not_covered and self.stable == self.damped == self.drawn

    def to_dict(self) -> dict[str, Any]:
        """As ``result.json`` holds it."""
        return {
            "drawn": self.drawn, "stable": self.stable, "damped": self.damped,
            "smallest_damping_ratio": None if self.not_covered else self.smallest_damping_ratio,
            "required_damping_ratio": self.required_damping,
            "error_median": quantile(self.measured, 0.5), "error_95": quantile(self.measured, 0.95),
            "unmeasured_median": quantile(self.unmeasured, 0.5), "unmeasured_95": quantile(self.unmeasured, 0.95),
            "worst": None if self.worst is None else self.worst.to_dict(),
            "largest_error": None if self.largest_error is None else self.largest_error.to_dict(),
            "opened_cut_shafts": [
                {"share_left": share, "damping_ratio": ratio, "stable": ratio > 0,
                 "smallest_damping_ratio_alone": min(
                     (alone[share] for alone in self.opened_alone.values()), default=ratio
                 )}
                for share, ratio in self.opened.items()
            ],
            "not_covered": self.not_covered,
        }  # fmt: skip


def quantile(values: Sequence[float], share: float) -> float | None:
    """Quantile of values; None where there are none."""
    return float(np.quantile(values, share)) if values else None


class Judge:
    """A control law on any bed of a case.

    Parameters
    ----------
    frequencies : ndarray (f,), optional
        Hz; over the band unless given.
    required : (float, float)
        Least damping ratio of any mode, and from where the loop has to have rolled off, Hz.

    Raises
    ------
    NotCovered
        If rig or vehicle hold what this room does not know.
    """

    def __init__(
        self, case: Case, law: ControlLaw, frequencies: np.ndarray | None = None,
        required: tuple[float, float] = (0.0, np.inf),
    ):  # fmt: skip
        self.case, self.law, self.required = case, law, required
        self.rig, self.vehicle = Chain(case.rig), Chain(case.vehicle)
        low, high = np.log(case.band)
        over_band = np.exp(low + (high - low) * (np.arange(POINTS) + 0.5) / POINTS)
        self.frequencies = over_band if frequencies is None else frequencies
        self._of_readings, self._of_known = self._action()
        self._rig_inputs = {part.name for part in case.rig.inputs}
        self._sources = list(dict.fromkeys(pair.input for pair in case.compared))
        self._sensors = list(dict.fromkeys(pair.sensor for pair in case.compared))
        resting = [self.rig.stiffness(np.zeros(1, complex))[0].real, *self._residual()]
        self._at_rest = sum(len(K) - np.linalg.matrix_rank(K) for K in resting)

    def _residual(self) -> list[np.ndarray]:
        return [Chain(part).stiffness(np.zeros(1, complex))[0].real for part in self.case.residual_vehicle.parts]

    def _action(self) -> tuple[np.ndarray, np.ndarray]:
        """Commands for readings (f, k, y) and known torques (f, k, w), from the law as it runs."""
        law, x, y = self.law, len(self.law.A), len(self.law.sensors)
        z = np.exp(2j * np.pi * self.frequencies * law.sample_time)
        keep, sending = np.eye(x) - law.L @ law.E, law.A + law.Bs @ law.K
        inputs = np.hstack([sending @ law.L + law.By + law.Bs @ law.Dy, law.Bw + law.Bs @ law.Dw])
        loop = z[:, None, None] * np.eye(x) - sending @ keep
        states = np.linalg.solve(loop, np.broadcast_to(inputs, (len(z), *inputs.shape)))
        commands = law.K @ keep @ states
        commands[:, :, :y] += law.K @ law.L + law.Dy
        commands[:, :, y:] += law.Dw
        return commands[:, :, :y], commands[:, :, y:]

    def verdict(self, values: Mapping[str, float]) -> BedVerdict:
        """One bed, by its values."""
        bed = self._bed(values)
        z = np.linalg.eigvals(bed.closed(self.law))
        stable, ratio = self._poles(z)
        drawn = {
            name.split(".", 1)[1]: value for name, value in values.items() if name.startswith(("rig.", "vehicle."))
        }
        known = self.case.vehicle.parameters
        vehicle = self.vehicle.with_values({name: value for name, value in drawn.items() if name in known})
        measured, unmeasured = self._errors(bed, vehicle)
        return BedVerdict(stable, ratio, self._damped(z, bed), measured, unmeasured)

    def _damped(self, z: np.ndarray, bed: DrawnBed) -> bool:
        """Whether every mode of a bed has the damping it needs.

        Where the loop has rolled off, a mode of the bed's own that has less without control cannot be given more.
        """
        least, fast_from = self.required
        alone = np.linalg.eigvals(bed.rates[0])
        alone = alone[(alone.imag > 0) & (np.abs(alone) >= 2 * np.pi * fast_from)]
        of_its_own = LEFT_TO_ITS_OWN * float(np.min(-alone.real / np.abs(alone), initial=1.0))
        s = self._swinging(z)
        need = np.where(np.abs(s) >= 2 * np.pi * fast_from, min(least, of_its_own), least)
        return bool(np.all(-s.real / np.abs(s) >= need))

    def damping(self, values: Mapping[str, float]) -> float:
        """Least damping ratio of any mode of one bed; −1 where it grows without swinging."""
        return float(self.dampings(values)[0])

    def dampings(self, values: Mapping[str, float]) -> np.ndarray:
        """Damping ratios (m,) of the least damped modes of one bed, least first, which is :meth:`damping`; 1 beyond."""
        z = np.linalg.eigvals(self._bed(values).closed(self.law))
        stable, ratio = self._poles(z)
        s = self._swinging(z)
        s = s[s.imag > 0]
        least = np.sort(np.append(-s.real / np.abs(s), np.ones(MODES)))[:MODES]
        least[0] = ratio if stable or ratio < 0 else -1.0
        return least

    def _bed(self, values: Mapping[str, float]) -> DrawnBed:
        of_rig = {name.removeprefix("rig."): value for name, value in values.items() if name.startswith("rig.")}
        return DrawnBed(self.case, self.rig.with_values(of_rig), values)

    def _poles(self, z: np.ndarray) -> tuple[bool, float]:
        resting = np.abs(z - 1) < AT_REST
        stable = bool(np.all(np.abs(z[~resting]) < 1)) and int(resting.sum()) <= self._at_rest
        s = self._swinging(z)
        return stable, float(np.min(-s.real / np.abs(s), initial=1.0))

    def _swinging(self, z: np.ndarray) -> np.ndarray:
        """Poles that swing, 1/s, of poles from sample to sample."""
        alive = z[(np.abs(z - 1) >= AT_REST) & (np.abs(z) > LOWEST_Z)]
        s: np.ndarray = np.log(alive.astype(complex)) / self.law.sample_time
        return s[np.abs(s.imag) > SLOWEST_SWING_RAD_S]

    def planned(self) -> tuple[np.ndarray, np.ndarray]:
        """I + L at the commands (f, k, k) of the bed as planned, and the law's commands for readings (f, k, y)."""
        return self._return_difference(self._bed({})), self._of_readings

    def _return_difference(self, bed: DrawnBed) -> np.ndarray:
        A, B, C = bed.stepped
        z = np.exp(2j * np.pi * self.frequencies * self.law.sample_time)
        loop = C @ np.linalg.solve(z[:, None, None] * np.eye(len(A)) - A, np.broadcast_to(B, (len(z), *B.shape)))
        return np.eye(B.shape[1]) - self._of_readings @ loop

    def _errors(self, bed: DrawnBed, vehicle: Chain) -> tuple[float, float]:
        """Response errors over the compared functions, rig torques known as the case says, and unknown."""
        s = 2j * np.pi * self.frequencies
        k, on_rig = len(bed.gains), [source for source in self._sources if source in self._rig_inputs]
        moved = bed.moved(s, np.hstack([bed.drive, bed.rig.drive(on_rig)]))
        by_command, sensed = moved[:, :, :k] * bed.command_at(s)[:, None, :], bed.sensors(s) @ moved[:, :, k:]
        commanded = {known: self._commands(sensed, on_rig, known) for known in (True, False)}
        commands = np.linalg.solve(self._return_difference(bed), np.concatenate([*commanded.values()], axis=2))
        i = len(self._sources)
        wanted = plain_responses(vehicle, s, self._sources, self._sensors)
        rows = np.stack([bed.rig.reading(sensor, s) for sensor in self._sensors], axis=1)
        answered = rows @ by_command @ commands
        alone = rows @ moved[:, :, k:]
        squares: dict[bool, list[np.ndarray]] = {True: [], False: []}
        for pair in self.case.compared:
            row, column = self._sensors.index(pair.sensor), self._sources.index(pair.input)
            of_rig = alone[:, row, on_rig.index(pair.input)] if pair.input in on_rig else 0.0
            for known, first in ((True, 0), (False, i)):
                response = of_rig + answered[:, row, first + column]
                squares[known].append(np.abs(np.log(response / wanted[:, row, column])) ** 2)
        return float(np.sqrt(np.mean(squares[True]))), float(np.sqrt(np.mean(squares[False])))

    def _commands(self, sensed: np.ndarray, on_rig: list[str], known: bool) -> np.ndarray:
        """What the controller makes (f, k, i) of the sources, before its commands return; readings (f, y, rig)."""
        made = np.zeros((*self._of_known.shape[:2], len(self._sources)), complex)
        for column, source in enumerate(self._sources):
            if source in on_rig:
                made[:, :, column] += (self._of_readings @ sensed[:, :, [on_rig.index(source)]])[:, :, 0]
            if source not in on_rig or (known and source in self.law.known):
                made[:, :, column] += self._of_known[:, :, self.law.known.index(source)]
        return made


def check_beds(
    case: Case, law: ControlLaw, required_damping: float, count: int, seed: int, rolled_off_from: float = np.inf
) -> BedsCheck:  # fmt: skip
    """Draw fresh beds from the case's box and judge every one; then look for the worst of the box.

    ``rolled_off_from`` (Hz) says from where on no control can be asked to damp a mode of the bed's own.
    """
    try:
        judge = Judge(case, law, required=(required_damping, rolled_off_from))
        positions = case.uncertainty.draw(count, seed)
        verdicts = [judge.verdict(case.uncertainty.at(position)) for position in positions]
        # rounded: beds whose least damped mode is the same that none of them moves stay as they were drawn
        order = np.argsort(np.round([verdict.damping_ratio for verdict in verdicts], 9), kind="stable")
        worst = worst_bed(judge.dampings, case.uncertainty, positions[order])
        largest = _largest_error(judge, positions, verdicts)
        opened, alone = dampings_opened(case, judge.damping)
    except NotCovered as reason:
        return BedsCheck(0, 0, 0, float("nan"), required_damping, (), (), None, None, str(reason))
    stable = [verdict for verdict in verdicts if verdict.stable]
    return BedsCheck(
        count, len(stable), sum(verdict.damped for verdict in stable),
        min(verdict.damping_ratio for verdict in verdicts), required_damping,
        tuple(sorted(verdict.measured for verdict in stable)), tuple(sorted(verdict.unmeasured for verdict in stable)),
        worst, largest, opened=opened, opened_alone=alone,
    )  # fmt: skip


def _largest_error(judge: Judge, positions: np.ndarray, verdicts: Sequence[BedVerdict]) -> LargestError | None:
    """From the stable drawn bed with the largest error, over all frequencies: fewer of them lead elsewhere."""
    errors = [verdict.unmeasured if verdict.stable else -np.inf for verdict in verdicts]
    worst = int(np.argmax(errors))
    if not verdicts[worst].stable:
        return None

    def error(values: Mapping[str, float]) -> float:
        verdict = judge.verdict(values)
        return verdict.unmeasured if verdict.stable else np.inf

    return largest_error(error, judge.case.uncertainty, positions[worst])
