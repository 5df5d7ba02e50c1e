"""What manufacturing tolerances of the bed do to a match whose controller stays as it is.

Every quantity of the rig that has a range in its file, and what the user adds, is drawn evenly from it, each on its
own (a mirror image too). Margin, stability, the target modes of the closed loop and the response errors come of every
draw. A component that vehicle and rig share is the same piece of hardware: there the vehicle it is compared with has
the drawn value too. Every draw is worked out by the exact loop, as a match judges its beds.
"""

from __future__ import annotations

import fnmatch
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import scipy

from matching.match.beds import loop_frequencies, margins_of
from matching.match.case import Case, apply
from matching.match.case_file import case_files
from matching.match.damping import damping_ratios, is_stable_loop, rates, stable_loops, without_resting
from matching.match.kept import FollowedModes, allowed_of, candidates_of, errors_of_mode, kept, target_modes_of
from matching.match.loop import (
    SampledController,
    beds_of,
    can_be_unmeasured,
    closed_poles,
    controller_of,
    controller_on,
    frequency_response,
    linear_bed,
    responses,
    responses_of,
    side_by_side,
)
from matching.match.loop_modes import ClosedLoop, LoopMode, neutral_motions
from matching.match.movable import movable
from matching.match.requirements import requirements
from matching.match.responses import ComparedBed, log_squares, nodes_of
from matching.studies import run
from modelling.display import Displayed
from modelling.errors import VERSION, InputError, unknown

# --- How a result spreads over draws, and which inputs drive it.

LEVELS = (0.01, 0.05, 0.5, 0.95, 0.99)
CONFIDENCE = 0.95  # of the intervals of quantiles
BINS = 60


@dataclass(frozen=True)
class Spread:
    """Distribution of one result.

    Attributes
    ----------
    nominal, mean, standard_deviation : float
    quantiles : dict of float to float
    intervals : dict of float to (float or None, float or None)
        Confidence interval (95 %) of each quantile from order statistics, whatever the distribution; None for an end
        that so few draws do not bound (David and Nagaraja, Order Statistics, 2003, 7.1).
    drivers : tuple of (str, float)
        Share of the variance that goes along with each input, straight or as its square, largest first: covariance of
        its part of a regression with the regression (Pratt 1987). For independent inputs these are the squared
        standardised regression coefficients (Saltelli et al., Global Sensitivity Analysis, 2008, 1.2.5); they add up
        to ``explained`` also where the draws are correlated by chance.
    explained : float
        Share of the variance that all inputs explain so (R²), each for itself; NaN where nothing spreads.
    edges, counts : ndarray (b + 1,), (b,)
        Histogram.
    """

    name: str
    unit: str
    nominal: float
    mean: float
    standard_deviation: float
    quantiles: dict[float, float]
    intervals: dict[float, tuple[float | None, float | None]]
    drivers: tuple[tuple[str, float], ...]
    explained: float
    draws: int
    edges: np.ndarray
    counts: np.ndarray

    def to_dict(self) -> dict[str, Any]:
        """Plain values."""
        return {
            "name": self.name, "unit": self.unit, "nominal": self.nominal, "mean": self.mean,
            "standard_deviation": self.standard_deviation, "draws": self.draws,
            "quantiles": {f"{level:g}": value for level, value in self.quantiles.items()},
            "quantile_intervals": {f"{level:g}": list(ends) for level, ends in self.intervals.items()},
            "drivers": [{"name": name, "share": share} for name, share in self.drivers],
            "explained": self.explained if np.isfinite(self.explained) else None,
        }  # fmt: skip


class Regressors:
    """Draws x (b, p) of named inputs, straight and squared, each with mean 0 and standard deviation 1."""

    def __init__(self, inputs: Sequence[str], x: np.ndarray):
        self.inputs = tuple(inputs)
        plain = _standard(x)
        self._terms = np.hstack([plain, _standard(plain**2)])
        self._products = self._terms.T @ self._terms

    def __len__(self) -> int:
        return len(self._terms)

    def explained(self, values: np.ndarray) -> tuple[list[float], float]:
        """Share of the variance of values (b,) by input, and of all together, by least squares; NaN for too few."""
        if len(self) <= 2 * len(self.inputs) + 1:
            return [0.0] * len(self.inputs), float("nan")
        wanted = (values - values.mean()) / values.std()
        coefficients = np.linalg.lstsq(self._products, self._terms.T @ wanted, rcond=None)[0]
        along = coefficients * (self._products @ coefficients) / len(self)  # covariance of each term with the fit
        shares = np.clip(np.sum(along.reshape(2, -1), axis=0), 0, 1).tolist()
        return shares, float(1 - np.mean((wanted - self._terms @ coefficients) ** 2))


def spread(name: str, unit: str, nominal: float, values: np.ndarray, drawn: Regressors) -> Spread:
    """Spread of values (b,) over draws of the inputs."""
    shares, explained = [0.0] * len(drawn.inputs), float("nan")
    size = float(values.std())
    if size > 1e-9 * max(abs(nominal), 1e-300):
        shares, explained = drawn.explained(values)
    counts, edges = np.histogram(values, BINS)
    ranked = sorted(zip(drawn.inputs, shares, strict=True), key=lambda pair: -pair[1])
    return Spread(
        name, unit, float(nominal), float(values.mean()), size,
        dict(zip(LEVELS, np.quantile(values, LEVELS).tolist(), strict=True)), quantile_intervals(values),
        tuple(ranked), explained, len(values), edges, counts,
    )  # fmt: skip


def quantile_intervals(values: np.ndarray) -> dict[float, tuple[float | None, float | None]]:
    """Confidence intervals of the quantiles :data:`LEVELS` by order statistics of values (b,).

    The number of draws below a quantile is binomial, so the interval from one ordered draw to another covers it at
    least as often as stated.
    """
    ordered, count = np.sort(values), len(values)
    intervals: dict[float, tuple[float | None, float | None]] = {}
    for level in LEVELS:
        # this many draws and one lie below, or fewer
        first = int(scipy.stats.binom.ppf((1 - CONFIDENCE) / 2, count, level)) - 1
        last = int(scipy.stats.binom.ppf((1 + CONFIDENCE) / 2, count, level))
        below = float(ordered[first]) if first >= 0 else None
        intervals[level] = (below, float(ordered[last]) if last < count else None)
    return intervals


def _standard(x: np.ndarray) -> np.ndarray:
    """Columns (b, p) with mean 0 and standard deviation 1."""
    size = x.std(axis=0)
    return (x - x.mean(axis=0)) / np.where(size > 0, size, 1.0)


# --- Draws of a match whose hardware varies: margin, stability, modes and response errors, by the exact loop.

AT_ONCE = 50  # draws
HARDWARE = ("loop.dead_time", "loop.inverter_lag", "loop.torque_sensor_lag")  # of the loop; the rest is the controller


@dataclass(frozen=True)
class Varied:
    """A quantity that is drawn evenly from its range, SI; ``specimen``: the vehicle has the same component."""

    name: str
    value: float
    lower: float
    upper: float
    unit: str
    specimen: bool = False


def draw(varied: tuple[Varied, ...], seed: int, number: int, count: int) -> np.ndarray:
    """Values (count, p) of chunk ``number``."""
    random = np.random.default_rng([seed, number])
    lower, upper = (np.array([getattr(quantity, key) for quantity in varied]) for key in ("lower", "upper"))
    return lower + (upper - lower) * random.random((count, len(varied)))


class Prepared:
    """What all chunks share, built once a worker: the loop as tuned, and the modes that its targets became."""

    def __init__(self, task: tuple[Case, tuple[Varied, ...], int]):
        self.case, self.varied, self.seed = task
        self.bed = linear_bed(self.case)
        self.controller = controller_on(self.bed)
        self.required, self.neutral = requirements(self.case), neutral_motions(self.bed)
        self.center = np.array([quantity.value for quantity in self.varied])
        modes = ClosedLoop.of(self.bed, self.controller).modes()
        reached = {"target": target_modes_of(self.case, candidates_of(self.case, modes))}
        if self.case.loop.structure.has_feed_forward:  # what measured torques excite, no bed moves
            reached["feedback"] = target_modes_of(self.case, _of_feedback(modes))
        self.modes = {
            f"{kind}_mode_{row.vehicle_mode}": row.mode for kind, rows in reached.items() for row in rows if row.mode
        }
        step, planned = self.controller.sample_time, closed_poles(side_by_side([self.bed.bed]), self.controller)
        self.followed = FollowedModes.of(self.case, rates(planned, step)[0], self.modes)
        self.nodes = nodes_of(ComparedBed(self.case, self.bed, self.controller))
        grid = loop_frequencies(self.case)
        begin = min(self.required.margin_from, grid[-1])
        self._grid = np.union1d(grid[grid > begin], [begin])
        self.nominal = {name: float(values[0]) for name, values in self.figures(self.center[None]).items()}

    def figures(self, x: np.ndarray) -> dict[str, np.ndarray]:
        """Results (b,) by name of draws x (b, p)."""
        parts = [self._figures(x[i : i + AT_ONCE]) for i in range(0, len(x), AT_ONCE)]
        return {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}

    def _figures(self, x: np.ndarray) -> dict[str, np.ndarray]:
        names = [quantity.name for quantity in self.varied]
        own = [name.startswith("loop.") and name not in HARDWARE for name in names]
        if not any(own):
            return self._of_beds(self.case, self.controller, [dict(zip(names, row)) for row in x.tolist()])
        rows = []  # the controller itself is drawn: one by one
        for row in x.tolist():
            of_controller = {name: value for name, value, one in zip(names, row, own, strict=True) if one}
            values = {name: value for name, value, one in zip(names, row, own, strict=True) if not one}
            case = replace(self.case, loop=self.case.loop.with_values(
                {name.removeprefix("loop."): value for name, value in of_controller.items()}
            ))  # fmt: skip
            rows.append(self._of_beds(case, controller_of(case), [values]))
        return {name: np.concatenate([row[name] for row in rows]) for name in rows[0]}

    def _of_beds(
        self, case: Case, controller: SampledController, values: Sequence[Mapping[str, float]]
    ) -> dict[str, np.ndarray]:  # fmt: skip
        beds = beds_of(case, values)
        grids = np.concatenate([self._grid, self.nodes.frequencies])  # one Schur form of a bed serves both
        responding = responses_of(case, beds, values, grids)
        sampled, count = responding.sampled, len(self._grid)
        poles = closed_poles(sampled, controller)
        z = without_resting(poles, self.neutral)
        asked = sampled.asked_damping(z, controller.sample_time, self.required)
        figures = {
            "modulus_margin": margins_of(responding.at(slice(count)), controller),
            "stable": stable_loops(poles, self.neutral).astype(float),
            "damped": (damping_ratios(z, controller.sample_time) >= asked).all(axis=1).astype(float),
        }
        of_band = responding.at(slice(count, None))
        acting = frequency_response(controller, self.nodes.frequencies)
        every = np.ones(len(case.compared), bool)
        for name, known, pairs in (
            ("response_error", case.loop.measured, every), ("response_error_unmeasured", (), can_be_unmeasured(case)),
        ):  # fmt: skip
            squares = log_squares(responses(of_band, acting, known), of_band.vehicle)[:, :, pairs].mean(axis=2)
            figures[name] = np.sqrt(squares @ self.nodes.weights)
        of_vehicles, of_beds = self.followed.on(case, values, rates(poles, controller.sample_time))
        for name, mode in self.modes.items():
            # no bed moves what known torques alone excite
            s = of_beds.get(name, np.full(len(beds), mode.eigenvalue))
            figures[f"{name}_frequency"], figures[f"{name}_damping_ratio"] = (
                np.abs(s) / (2 * np.pi),
                -s.real / np.abs(s),
            )
            if name.startswith("target"):  # against the vehicle with the same specimen
                figures |= errors_of_mode(name, s, of_vehicles[int(name.rpartition("_")[2])])
        return figures


def _of_feedback(modes: Sequence[LoopMode]) -> tuple[LoopMode, ...]:
    return tuple(mode for mode in modes if mode.belongs_to == "feedback")


def work(prepared: Prepared, chunk: list[int]) -> dict[str, Any]:
    """One chunk: its number and draws."""
    number, count = chunk
    figures = prepared.figures(draw(prepared.varied, prepared.seed, number, count))
    return {
        "values": {name: _finite(values) for name, values in figures.items()}, "nominal": prepared.nominal,
    }  # fmt: skip


def _finite(values: np.ndarray) -> list[float | None]:
    """Values (b,) as a record holds them: None where a draw has lost the mode."""
    return [value if np.isfinite(value) else None for value in values.tolist()]


def unit_of(name: str) -> str:
    """Unit of a result."""
    return "Hz" if name.endswith("frequency") else ""


def judged(name: str) -> bool:
    """Whether a result is a verdict, 1 or 0, of every draw."""
    return name in ("stable", "damped")


# --- Tolerance

CHUNK = 1000  # draws


@dataclass(frozen=True)
class Tolerance(Displayed):
    """A tolerance study.

    Attributes
    ----------
    draws, seed : int
    varied : tuple of Varied
    spreads : tuple of Spread
        Modulus margin, the modes that the targets became (of a model-based feed-forward those that measured torques
        excite, and also those of its feedback), response errors.
    shares : dict of str to float
        Yield: the share of draws that is stable, is damped as a match asks it, keeps the response errors within their
        tolerances and every target mode within its own of the vehicle with the same specimen, and all of these.
    allowed : dict of str to float
        By result, how large it may be either way.
    asked, asked_from : float
        Modulus margin that is required, and from which frequency (Hz) on it counts.
    """

    title: str
    draws: int
    seed: int
    varied: tuple[Varied, ...]
    spreads: tuple[Spread, ...]
    shares: dict[str, float]
    asked: float
    asked_from: float
    allowed: dict[str, float] = field(default_factory=dict)

    def to_dict(self) -> dict[str, Any]:
        """The content of ``tolerance.json``."""
        return {
            "title": self.title, "draws": self.draws, "seed": self.seed,
            "varied": [vars(quantity) for quantity in self.varied],
            "quantities": [spread.to_dict() for spread in self.spreads], "yield": self.shares, "allowed": self.allowed,
            "modulus_margin_asked": self.asked, "modulus_margin_from": self.asked_from,
        }  # fmt: skip


def varied_of(case: Case, added: Mapping[str, float] | None = None) -> tuple[Varied, ...]:
    """What varies: quantities of the rig with a range, and ``added`` ones by their relative tolerance; without any of
    these, what the case says of rig and loop under ``[uncertainty]``."""
    known = {f"rig.{name}": (parameter.value, case.rig.units[name]) for name, parameter in case.rig.parameters.items()}
    every = movable(case.rig, case.residual_vehicle, case.loop)
    known |= {name: (place.start, place.unit) for name, place in every.items() if not name.startswith("rig.")}
    varied = {}
    for name, quantity in case.rig.uncertain.items():
        if quantity.lower is not None and quantity.upper is not None and quantity.lower < quantity.upper:
            unit = known[f"rig.{name}"][1]
            varied[f"rig.{name}"] = Varied(f"rig.{name}", quantity.value, quantity.lower, quantity.upper, unit)
    for name, share in _named(added or {}, known):
        if name.startswith("residual_vehicle."):
            raise InputError(
                "--tolerance", f"{name} is a number in the controller", "name a quantity of the rig or loop"
            )
        value, unit = known[name]
        if not 0 < share < 1 or value == 0:
            raise InputError("--tolerance", f"{name} = {value:g} cannot vary by {share:g}", "give 0 < SHARE < 1")
        varied[name] = Varied(name, value, value - share * abs(value), value + share * abs(value), unit)
    for one in () if varied else case.uncertainty.uncertain:
        if one.name in known and one.half_width > 0:
            low, high = one.value - one.half_width, one.value + one.half_width
            varied[one.name] = Varied(one.name, one.value, low, high, known[one.name][1])
    specimen = {f"rig.{name}" for name in case.vehicle.parameters}
    varied = {name: replace(one, specimen=name in specimen) for name, one in varied.items()}
    if not varied:
        right = 'write { value = …, tolerance = 0.05 } in the rig file, or add --tolerance "rig.*.stiffness=0.05"'
        raise InputError(case.path, "no quantity of the rig has a tolerance", right)
    return tuple(varied.values())


def _named(added: Mapping[str, float], known: Mapping[str, tuple[float, str]]) -> list[tuple[str, float]]:
    """Names with their tolerances; a pattern stands for all of the rig and loop that it fits and that are not zero."""
    named = []
    for name, share in added.items():
        fitting = [name] if name in known else []
        if "*" in name:
            not_zero = [candidate for candidate in known if known[candidate][0] != 0]
            possible = [candidate for candidate in not_zero if not candidate.startswith("residual_vehicle.")]
            fitting = fnmatch.filter(possible, name)
        if not fitting:
            raise unknown(name, list(known), "--tolerance")
        named += [(match, share) for match in fitting]
    return named


def tuned(case: Case) -> Case:
    """The case at the start values of its ``[move]``, which a match writes as tuned."""
    return apply(case, {name: move.start for move in case.moves for name in move.together})


def what_varies(case: Case, added: Mapping[str, float] | None) -> tuple[Varied, ...]:
    """What varies of a case as tuned, see :func:`varied_of`."""
    return varied_of(tuned(case), added)


def tolerance(
    case: Case, draws: int, executor: Executor, *, seed: int = 0, added: Mapping[str, float] | None = None,
    record: Path | None = None, progress: Callable[[int, int], None] | None = None,
) -> Tolerance:  # fmt: skip
    """Spread of margin, modes and response errors over tolerances, with the yield and what drives it.

    Parameters
    ----------
    case : Case
        Its moves stand at their start values: give the case file that a match wrote.
    draws : int
    executor : concurrent.futures.Executor
    added : mapping of str to float, or None
        Relative tolerances in addition to those of the rig file, by name or by a pattern such as
        ``rig.*.stiffness``; what stands later counts.
    record, progress : see :func:`matching.studies.run`
    """
    varied = what_varies(case, added)
    case = tuned(case)
    bed = linear_bed(case)
    if not is_stable_loop(ClosedLoop.of(bed, controller_on(bed)).poles, neutral_motions(bed)):
        raise InputError(case.path, "the loop is unstable as it stands", "match first and give DIR/case.toml")
    chunks = [[number, min(CHUNK, draws - CHUNK * number)] for number in range(-(-draws // CHUNK))]
    content = [VERSION, str(seed), *(str(vars(quantity)) for quantity in varied)]
    content += [f"{name}: {text}" for name, text in case_files(case).items()]
    rows = run(
        work, Prepared, (case, varied, seed), chunks, executor,
        content="\n".join(content), record=record, progress=progress,
    )  # fmt: skip
    values: dict[str, np.ndarray] = {
        name: np.concatenate([np.array(row["values"][name], float) for row in rows]) for name in rows[0]["values"]
    }
    x = np.concatenate([draw(varied, seed, number, count) for number, count in chunks])
    nominal = rows[0]["nominal"]
    names = [quantity.name for quantity in varied]
    inputs = Regressors(names, x)
    spreads = []
    for name in (name for name in nominal if not judged(name)):
        there = np.isfinite(values[name])  # a draw without the mode has lost it, which its yield says
        of_draws = inputs if there.all() else Regressors(names, x[there])
        if there.any():
            spreads.append(spread(name, unit_of(name), nominal[name], values[name][there], of_draws))
    asked, counted_from = case.limits["modulus_margin"], requirements(case).margin_from
    allowed = allowed_of(case, nominal)
    shares = {name: float(which.mean()) for name, which in kept(values, allowed).items()}
    return Tolerance(case.title, draws, seed, varied, tuple(spreads), shares, asked, counted_from, allowed)


def required_range(name: str, allowed: Mapping[str, float], asked: float) -> tuple[float, float]:
    """Least and largest value of a result that is asked for; infinite where nothing is.

    Parameters
    ----------
    name : str
        As in :func:`matching.match.kept.kept`, or ``modulus_margin``.
    allowed : mapping of str to float
    asked : float
        Modulus margin.
    """
    if name == "modulus_margin":
        return asked, np.inf
    limit = allowed.get(name, np.inf)
    return (0.0 if name.startswith("response_error") else -limit), limit
