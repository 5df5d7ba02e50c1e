"""What manufacturing tolerances of the bed do to a match whose controller stays as it is.

Every quantity of the rig that has a range in its file, and what the user adds, is drawn evenly from it, each on its
own (a mirror image too). The margin, stability and the feedback loop's modes come of every draw, from the exact loop;
response errors, which take longer, of the first few hundred. A component that vehicle and rig share is the same piece
of hardware: there the vehicle it is compared with has the drawn value too.

Stability of a draw: det(I + L(jω)) of the draw over that of the nominal loop, which is known to be stable, must not
turn round the origin. Where it turns too fast to be followed on the grid, or comes near zero, encirclements decide.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np

from matching import __version__
from matching.frequency.case import Case, movable
from matching.frequency.case_file import case_files
from matching.frequency.closed_loop import closed_loop
from matching.frequency.tuned import apply
from matching.frequency.verification.body import body
from matching.frequency.verification.encirclements import encirclements
from matching.frequency.verification.exact_loop import ExactLoop
from matching.frequency.verification.loop_modes import feedback_modes
from matching.frequency.verification.parts import Parts, parts_of, watched
from matching.frequency.verification.responses import response_error
from matching.frequency.verification.robustness import compared
from matching.spread import Spread, spread
from matching.studies import run
from modelling.errors import InputError
from modelling.modes import modes
from modelling.residual_vehicle import cut
from modelling.shown import Shown
from modelling.system import unknown
from modelling.twin import Twin, twin

CHUNK = 1000  # draws
RESPONSES = 400  # draws whose response errors are worked out
POINTS = 48  # frequencies of a response error
AT_ONCE = 20_000  # values of s in one call
FOLLOWED = 1.0  # rad: largest step of the phase between frequencies that is believed
CLOSE = 0.6  # relative distance within which a mode of the loop counts as the target's
SAME = (0.01, 0.02)  # of a target: relative in frequency, absolute in damping ratio


@dataclass(frozen=True)
class Varied:
    """A quantity that is drawn evenly from its range, SI."""

    name: str
    value: float
    lower: float
    upper: float
    unit: str


@dataclass(frozen=True)
class Tolerance(Shown):
    """A tolerance study.

    Attributes
    ----------
    draws, seed : int
    varied : tuple of Varied
    spreads : tuple of Spread
        Modulus margin, modes of the feedback loop near the targets, response errors.
    shares : dict of str to float
        Yield: the share of draws that is stable, keeps the margin asked for, keeps every target mode near its nominal
        value (1 % in frequency, 0.02 in damping ratio), and all of these.
    """

    title: str
    draws: int
    seed: int
    varied: tuple[Varied, ...]
    spreads: tuple[Spread, ...]
    shares: dict[str, float]
    asked: float

    _view = "matching.report.views.tolerance"

    def to_dict(self) -> dict[str, Any]:
        """The content of ``tolerance.json``."""
        return {
            "title": self.title, "draws": self.draws, "seed": self.seed, "varied": [vars(one) for one in self.varied],
            "quantities": [one.to_dict() for one in self.spreads], "yield": self.shares,
            "modulus_margin_asked": self.asked,
        }  # fmt: skip


def varied_of(case: Case, added: Mapping[str, float] | None = None) -> tuple[Varied, ...]:
    """What varies: quantities of the rig with a range, and ``added`` ones by their relative tolerance.

    Raises
    ------
    InputError
        If nothing varies, a name is unknown or belongs to the residual vehicle, or a tolerance is not in (0, 1).
    """
    known = {f"rig.{name}": (own.value, case.rig.units[name]) for name, own in case.rig.parameters.items()}
    every = movable(case.rig, case.residual_vehicle, case.loop)
    known |= {name: own[:2] for name, own in every.items() if not name.startswith("rig.")}
    found = {}
    for name, own in case.rig.uncertain.items():
        if own.lower is not None and own.upper is not None and own.lower < own.upper:
            unit = known[f"rig.{name}"][1]
            found[f"rig.{name}"] = Varied(f"rig.{name}", own.value, own.lower, own.upper, unit)
    for name, share in (added or {}).items():
        if name not in known:
            raise unknown(name, list(known), "--tolerance")
        if name.startswith("residual_vehicle."):
            raise InputError(
                "--tolerance", f"{name} is a number in the controller", "name a quantity of the rig or loop"
            )
        value, unit = known[name]
        if not 0 < share < 1 or value == 0:
            raise InputError("--tolerance", f"{name} = {value:g} cannot vary by {share:g}", "give 0 < SHARE < 1")
        found[name] = Varied(name, value, value - share * abs(value), value + share * abs(value), unit)
    if not found:
        right = "write { value = …, tolerance = 0.05 } in the rig file, or add --tolerance NAME=0.05"
        raise InputError(case.path, "no quantity of the rig has a tolerance", right)
    return tuple(found.values())


def tuned(case: Case) -> Case:
    """The case at the start values of its ``[move]``, which a match writes as tuned."""
    return apply(case, {name: move.start for move in case.moves for name in move.together})


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
    added : mapping of str to float, optional
        Relative tolerances beside those of the rig file.
    record, progress : see :func:`matching.studies.run`

    Raises
    ------
    InputError
        If nothing varies, or the nominal loop is unstable.
    """
    case = tuned(case)
    varied = varied_of(case, added)
    winding = encirclements(parts_of(case))
    if winding.unstable or not winding.clear:
        raise InputError(case.path, "the loop is unstable as it stands", "match first and give DIR/case.toml")
    few = -(-RESPONSES // max(1, -(-draws // CHUNK)))
    chunks = [[number, min(CHUNK, draws - CHUNK * number), few] for number in range(-(-draws // CHUNK))]
    content = [__version__, str(seed), *(str(vars(one)) for one in varied)]
    content += [f"{name}: {text}" for name, text in case_files(case).items()]
    rows = run(
        work, Prepared, (case, varied, seed), chunks, executor,
        content="\n".join(content), record=record, progress=progress,
    )  # fmt: skip
    values: dict[str, np.ndarray] = {
        name: np.concatenate([np.array(row["values"][name], float) for row in rows]) for name in rows[0]["values"]
    }
    x = np.concatenate([draw(varied, seed, number, count) for number, count, _ in chunks])
    first = np.concatenate([np.arange(count) < few for _, count, _ in chunks])
    nominal = rows[0]["nominal"]
    names = [one.name for one in varied]
    spreads = []
    for name, unit in rows[0]["units"].items():
        drawn = x[first] if len(values[name]) < len(x) else x
        spreads.append(spread(name, unit, nominal[name], values[name], names, drawn))
    asked = case.limits["modulus_margin"]
    kept = {"stable": values["stable"] > 0.5}
    kept["modulus_margin"] = kept["stable"] & (values["modulus_margin"] >= asked)
    for name in nominal:
        if name.startswith("target"):
            own = values[name] / nominal[name] - 1 if name.endswith("frequency") else values[name] - nominal[name]
            kept[name] = np.abs(own) <= SAME[0 if name.endswith("frequency") else 1]
    kept["all"] = np.logical_and.reduce(list(kept.values()))
    shares = {name: float(own.mean()) for name, own in kept.items()}
    return Tolerance(case.title, draws, seed, varied, tuple(spreads), shares, asked)


def draw(varied: tuple[Varied, ...], seed: int, number: int, count: int) -> np.ndarray:
    """Values (count, p) of chunk ``number``."""
    random = np.random.default_rng([seed, number])
    lower, upper = (np.array([getattr(one, key) for one in varied]) for key in ("lower", "upper"))
    return lower + (upper - lower) * random.random((count, len(varied)))


class Prepared:
    """What all chunks share, built once a worker."""

    def __init__(self, given: tuple[Case, tuple[Varied, ...], int]):
        self.case, self.varied, self.seed = given
        loop = closed_loop(self.case, [(one.name,) for one in self.varied])
        self.difference, self.k = loop.difference, len(self.case.loop.dynamometers)
        self.parts: Parts = parts_of(self.case)
        winding = encirclements(self.parts)
        corners = [mode.frequency for mode in modes(self.case.rig) if 0 < mode.frequency < 1000]
        near = np.concatenate([own * np.linspace(0.92, 1.08, 9) for own in (winding.margin_frequency, *corners)])
        self.frequencies = np.unique(np.concatenate([np.geomspace(0.01, 1500, 140), near]))
        self.center = np.array([one.value for one in self.varied])
        self.nominal = _determinant(self.returns(2j * np.pi * self.frequencies, self.center[None])[0])
        self.margin = float(self.margins(self.center[None])[0][0])
        self.goals = self._goals()
        self.told: Twin | None = None
        if self.case.loop.structure == "model_based":
            self.told = twin(self.case.rig, cut(self.case.vehicle, self.case.rig), self.case.loop)
        self.vehicle = body(self.case.vehicle)

    def returns(self, s: np.ndarray, x: np.ndarray) -> np.ndarray:
        """I + L (b, f, k, k) at s (f,) for draws x (b, p)."""
        return self._at(np.tile(s, len(x)), np.repeat(x, len(s), axis=0)).reshape(len(x), len(s), self.k, self.k)

    def _at(self, s: np.ndarray, x: np.ndarray) -> np.ndarray:
        """I + L (n, k, k), each s (n,) with its own draw (n, p)."""
        out = np.empty((len(s), self.k * self.k), complex)
        for begin in range(0, len(s), AT_ONCE):
            part = slice(begin, begin + AT_ONCE)
            many = self.difference.map(len(s[part]))
            re, im = many(ca.DM(s[part].real).T, ca.DM(s[part].imag).T, ca.DM(x[part].T))
            out[part] = (re.full() + 1j * im.full()).T
        return out.reshape(-1, self.k, self.k)

    def margins(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Modulus margins (b,) and return differences' determinants (b, f)."""
        least, determinants = [], []
        for begin in range(0, len(x), 64):
            D = self.returns(2j * np.pi * self.frequencies, x[begin : begin + 64])
            determinant, square = _determinant(D), np.sum(np.abs(D) ** 2, axis=(-2, -1))
            # eigenvalues of DᴴD of one or two rows, from its trace and determinant
            root = np.sqrt(np.maximum(square**2 / 4 - np.abs(determinant) ** 2, 0.0)) if self.k == 2 else square / 2
            small = square / 2 - root if self.k == 2 else square
            least.append(np.sqrt(np.maximum(small, 0.0)).min(axis=1))
            determinants.append(determinant)
        return np.concatenate(least), np.concatenate(determinants)

    def stable(self, x: np.ndarray, determinants: np.ndarray) -> np.ndarray:
        """Whether each draw is stable, (b,)."""
        ratio = determinants / self.nominal
        steps = np.angle(ratio[:, 1:] / ratio[:, :-1])
        turns = np.abs(steps.sum(axis=1) + np.angle(ratio[:, 0]) - np.angle(ratio[:, -1]))
        found = turns < np.pi
        for i in np.flatnonzero((np.abs(steps) > FOLLOWED).any(axis=1)):
            winding = encirclements(self.true(x[i]), self.dead_time(x[i]))
            found[i] = winding.unstable == 0 and winding.clear
        return found

    def roots(self, x: np.ndarray) -> np.ndarray:
        """Eigenvalues (b, goals) of the loop, each followed from the nominal one by the secant rule on det(I + L)."""
        found = np.empty((len(x), len(self.goals)), complex)
        for j, goal in enumerate(self.goals):
            before, s = np.full(len(x), goal * (1 + 1e-4)), np.full(len(x), goal)
            last = _determinant(self._at(before, x))
            for _ in range(25):
                value = _determinant(self._at(s, x))
                slope = value - last
                step = np.where(slope == 0, 0, value * (s - before) / np.where(slope == 0, 1, slope))
                limit = 0.2 * np.abs(goal)
                step = np.where(np.abs(step) > limit, step * limit / np.maximum(np.abs(step), 1e-300), step)
                before, last, s = s, value, s - step
                if np.abs(step).max() < 1e-9 * abs(goal):
                    break
            found[:, j] = s
        return found

    def true(self, x: np.ndarray) -> Parts:
        """The bed as drawn, with the controller as it is."""
        values = {one.name.removeprefix("rig."): v for one, v in zip(self.varied, x) if one.name.startswith("rig.")}
        system = self.case.rig.with_values(values)
        loop = {one.name.removeprefix("loop."): v for one, v in zip(self.varied, x) if one.name.startswith("loop.")}
        case = replace(self.case, loop=self.case.loop.with_values(loop)) if loop else self.case
        return replace(self.parts, case=case, rig=body(watched(system, self.parts.cuts, rig_side=True)))

    def dead_time(self, x: np.ndarray) -> float:
        """Dead time of a draw, s."""
        names = [one.name for one in self.varied]
        return float(x[names.index("loop.dead_time")]) if "loop.dead_time" in names else self.case.loop["dead_time"]

    def errors(self, x: np.ndarray) -> list[float]:
        """Response error of a draw to all torques as the case announces them, and to torques nobody announces."""
        own = {one.name.removeprefix("rig."): v for one, v in zip(self.varied, x)}
        shared = {name: v for name, v in own.items() if name in self.case.vehicle.parameters}
        vehicle = body(self.case.vehicle.with_values(shared)) if shared else self.vehicle
        loop = ExactLoop(self.true(x), self.dead_time(x))
        frequencies = np.geomspace(*self.case.band, POINTS)
        told = [self.told, None] if self.told is not None else [None]
        return [response_error(*compared(loop, one, vehicle, frequencies)) for one in told]

    def _goals(self) -> list[complex]:
        """Modes of the nominal feedback loop near the targets, as far as it has any."""
        found = []
        own = [
            mode.eigenvalue for mode in feedback_modes(self.parts) if mode.frequency > 0 and mode.eigenvalue.imag > 0
        ]
        plain = modes(self.case.vehicle)
        for target in self.case.targets:
            wanted = 2j * np.pi * plain[target.mode - 1].frequency
            near = min(own, key=lambda s: abs(s - wanted), default=0j)
            if abs(near - wanted) < CLOSE * abs(wanted):
                found.append(complex(near))
        return found


def work(prepared: Prepared, chunk: list[int]) -> dict[str, Any]:
    """One chunk: number, draws, and how many of them get response errors."""
    number, count, few = chunk
    x = draw(prepared.varied, prepared.seed, number, count)
    least, determinants = prepared.margins(x)
    values: dict[str, Any] = {
        "modulus_margin": least.tolist(), "stable": prepared.stable(x, determinants).astype(float).tolist(),
    }  # fmt: skip
    units, nominal = {"modulus_margin": ""}, {"modulus_margin": prepared.margin}
    for j, (goal, root) in enumerate(zip(prepared.goals, prepared.roots(x).T), 1):
        for what, unit, of in (("frequency", "Hz", _frequency), ("damping_ratio", "", _damping)):
            name = f"target_{j}_{what}"
            values[name], units[name], nominal[name] = of(root).tolist(), unit, float(of(np.array([goal]))[0])
    errors = np.array([prepared.errors(row) for row in x[:few]])
    here = prepared.errors(prepared.center)
    names = ["response_error", "response_error_not_announced"] if len(here) == 2 else ["response_error"]
    for j, name in enumerate(names):
        values[name], units[name], nominal[name] = errors[:, j].tolist(), "", here[j]
    return {"values": values, "units": units, "nominal": nominal}


def _determinant(D: np.ndarray) -> np.ndarray:
    """Of matrices (…, k, k) with one or two rows."""
    return D[..., 0, 0] if D.shape[-1] == 1 else D[..., 0, 0] * D[..., 1, 1] - D[..., 0, 1] * D[..., 1, 0]


def _frequency(root: np.ndarray) -> np.ndarray:
    return np.abs(root) / (2 * np.pi)


def _damping(root: np.ndarray) -> np.ndarray:
    return -root.real / np.abs(root)
