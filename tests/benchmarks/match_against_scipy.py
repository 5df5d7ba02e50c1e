"""The reference match: IPOPT with exact derivatives against SciPy, same objective, bounds and constraints, one run.

Ours is one start after the other, stability by encirclements included, until one ends within 1 % of the value of the
whole match; the whole match, with starts that agree and the tight end, is printed beside it. Programmes are built
before any clock starts. The peers are helped: their evaluator is the same compiled CasADi graph and spares them the
tracked eigenpairs, which a secant iteration finds for them; they stop as soon as they come within 1 % of our value.
Constraints enter as a penalty on their violation; what is unstable by encirclements does not count. ``least_squares``
begins where our starts begin, anew after each end. Where a peer has not arrived within its budget the ratio is a lower
bound. Processor time, so that other load does not count.
"""

import os
import time
from dataclasses import dataclass, field
from pathlib import Path

import casadi as ca
import numpy as np
from scipy.optimize import differential_evolution, least_squares

from matching.frequency.case import load_case
from matching.frequency.demands import demands
from matching.frequency.goals import goals, target_modes
from matching.frequency.match import _weight
from matching.frequency.problem import EIGEN, PRICE, Problem, grid, scaled, unscaled
from matching.frequency.solve import Task, _check, _one, _start, solve
from matching.frequency.verification import responses
from matching.frequency.weights import FREEZE_BELOW, counterparts, share
from modelling.modes import modes
from tests.benchmarks.row import row

CASE = Path(__file__).parents[2] / "examples" / "road_to_rig" / "case.toml"
BUDGET = float(os.environ.get("MATCH_BUDGET", 25))  # of a peer, in times of ours
NEAR = 1.01
PENALTY = 1e3  # of a violation squared: large enough that its minimum keeps SLACK
SLACK = 5e-3  # violation forgiven to a peer; ours has to keep 1e-5


class Arrived(Exception):
    """A peer has reached our value, or spent its budget."""


@dataclass
class Reduced:
    """Objective of the quantities that move alone, eigenpairs eliminated; keeps the clock of a peer."""

    problem: Problem
    task: Task
    target: float
    budget: float
    began: float = field(default_factory=time.process_time)
    evaluations: int = 0
    best: float = np.inf
    arrived: bool = False

    def __post_init__(self) -> None:
        own = self.problem
        self.size = len(own.moves)
        self.roots = [goal.eigenvalue for goal in own.goals]  # the last ones found, to begin from
        self.start = np.array([scaled(move.start, move) for move in own.moves])
        self.response = own.loop.response.map(len(self.task.reference))
        self.s = ca.DM(2 * np.pi * grid(own.case)).T

    def vector(self, moves: np.ndarray) -> np.ndarray:
        """The decision vector with the eigenpairs of these moves, each the nearest its goal that is found."""
        p, parts = self.values(moves), [moves]
        for number, goal in enumerate(self.problem.goals):
            pattern = goal.pattern / np.linalg.norm(goal.pattern)
            found = [self._root(begin, pattern, p) for begin in (goal.eigenvalue, self.roots[number])]
            s, x = min(found, key=lambda pair: abs(pair[0] - goal.eigenvalue))
            self.roots[number] = s
            size = abs(goal.eigenvalue)
            parts += [np.array([s.real, s.imag]) / size, x.real, x.imag]
        return np.concatenate(parts)

    def values(self, moves: np.ndarray) -> np.ndarray:
        """p of the loop."""
        return np.array([unscaled(part, move) for part, move in zip(moves, self.problem.moves, strict=True)])

    def _root(self, s: complex, pattern: np.ndarray, p: np.ndarray) -> tuple[complex, np.ndarray]:
        """Where (I + L(s))·x = 0 by the secant rule on 1/(patternᵀ(I + L)⁻¹pattern), and x with patternᵀx = 1."""
        k = len(pattern)

        def at(s: complex) -> tuple[complex, np.ndarray]:
            re, im = self.problem.loop.difference(s.real, s.imag, p)
            x = np.linalg.solve((re.full() + 1j * im.full()).reshape(k, k), pattern)
            return 1 / (pattern @ x), x / (pattern @ x)

        before, (value, x) = s * (1 + 1e-4), at(s)
        last = at(before)[0]
        for _ in range(20):
            if value == last or not np.isfinite(value) or abs(value) < 1e-9:
                break
            step = value * (s - before) / (value - last)
            step *= min(1.0, 0.3 * abs(s) / max(abs(step), 1e-300))
            before, last, s = s, value, s - step
            value, x = at(s)
        return s, x

    def violation(self, g: np.ndarray) -> np.ndarray:
        """How far each constraint is missed, (g,)."""
        return np.maximum(np.maximum(self.problem.g_lower - g, g - self.problem.g_upper), 0.0)

    def scalar(self, moves: np.ndarray) -> float:
        """Objective and penalty."""
        v = self.vector(np.asarray(moves, float))
        f, g = (part.full().ravel() for part in self.problem.objective(v))
        return self._seen(v, float(f[0]), self.violation(g))

    def residuals(self, moves: np.ndarray) -> np.ndarray:
        """Residuals whose squares add up to objective and penalty."""
        v = self.vector(np.asarray(moves, float))
        g = self.problem.objective(v)[1].full().ravel()
        missed = self.violation(g)
        wrong = self.plain(v)
        self._seen(v, float(wrong @ wrong), missed)
        return np.nan_to_num(np.concatenate([wrong, np.sqrt(PENALTY) * missed]), nan=1e3)

    def plain(self, v: np.ndarray) -> np.ndarray:
        """Residuals of the objective alone."""
        p = ca.repmat(ca.DM(self.values(v[: self.size])), 1, self.s.shape[1])
        re, im = self.response(0 * self.s, self.s, p)
        ratio = (re.full() + 1j * im.full()).T / self.task.reference
        parts = [np.log(np.abs(ratio)).ravel(), np.unwrap(np.angle(ratio), axis=0).ravel()]
        wrong = [part / np.sqrt(ratio.size) for part in parts]
        wrong.append(np.sqrt(PRICE * self.task.weights) * (v[: self.size] - self.start))
        width = 2 + 2 * len(self.problem.case.loop.dynamometers)
        for number, goal in enumerate(self.problem.goals):
            sigma, omega = v[self.size + number * width :][:2]
            natural, ratio_wanted = np.hypot(sigma, omega), -goal.eigenvalue.real / abs(goal.eigenvalue)
            wrong.append(np.sqrt(EIGEN) * np.array([natural - 1, -sigma / natural - ratio_wanted]))
        return np.concatenate(wrong)

    def _seen(self, v: np.ndarray, f: float, missed: np.ndarray) -> float:
        """Count, watch the clock, and see whether this is as good as ours; the penalised value."""
        self.evaluations += 1
        value = f + PENALTY * float(missed @ missed)
        if not np.isfinite(value):
            return 1e6
        if value < self.best and missed.max(initial=0.0) <= SLACK:
            if not _check(self.problem, v)[2]:
                return value + 10.0
            self.best = value
            self.arrived = value <= NEAR * self.target
        if self.arrived or time.process_time() - self.began > self.budget:
            raise Arrived
        return value


def task_of(path: Path) -> Task:
    """The programme of a case file, as :func:`matching.frequency.match.match` sets it up."""
    case = load_case(path)
    targets, vehicle, on_rig = target_modes(case), modes(case.vehicle), counterparts(case)
    shares = [share(case, move, vehicle, on_rig) for move in case.moves]
    free = [i for i, part in enumerate(shares) if part >= FREEZE_BELOW]
    reference = responses(case, grid(case)).vehicle
    moves, weights = tuple(case.moves[i] for i in free), np.array([_weight(shares[i]) for i in free])
    return Task(case, moves, weights, goals(case, targets), reference, demands(case))


def peer(task: Task, target: float, budget: float, by: str) -> Reduced:
    """Run one of SciPy's until it arrives or has spent its budget (s)."""
    run = Reduced(task.build(), task, target, budget)
    bounds = [(0.0, 1.0)] * run.size
    if by == "least_squares":
        v = run.vector(np.clip(_start(run.problem, None)[: run.size], 0.01, 0.99))
        own, f = run.plain(v), float(run.problem.objective(v)[0])
        if abs(own @ own / f - 1) > 1e-6:
            raise SystemExit(f"the peer's objective is another one: {own @ own} and {f}")
    run.began = time.process_time()
    try:
        if by == "differential_evolution":
            differential_evolution(run.scalar, bounds, seed=0, maxiter=10**6, tol=0, polish=False, init="sobol")
        for number in range(10**6 if by == "least_squares" else 0):
            random = np.random.default_rng([0, number]) if number else None
            begin = _start(run.problem, random)[: run.size]
            least_squares(run.residuals, begin, bounds=(0.0, 1.0), x_scale=1.0)
    except Arrived:
        pass
    return run


def first_arrival(task: Task, target: float) -> float:
    """Processor time of our starts until one ends within 1 % of the target, s."""
    problem, began = task.build(), time.process_time()
    for number in range(14):
        end = _one(problem, 0, number)
        if end is not None and end[0] <= NEAR * target:
            return time.process_time() - began
    raise SystemExit("none of our starts ends where the whole match does")


def main() -> None:
    task = task_of(CASE)
    began = time.process_time()
    found = solve(task)
    whole = time.process_time() - began
    if not found.feasible:
        raise SystemExit("our own match is infeasible")
    ours = first_arrival(task, found.objective)
    moves = np.array([scaled(found.values[move.name], move) for move in task.moves])
    check = Reduced(task.build(), task, 0.0, np.inf).scalar(moves)
    if abs(check / found.objective - 1) > 0.005:
        raise SystemExit(f"the peers would see another value at our solution: {check} and {found.objective}")
    for by in ("least_squares", "differential_evolution"):
        run = peer(task, found.objective, BUDGET * ours, by)
        spent = time.process_time() - run.began
        asked = ">= 20" if run.arrived else f">= 20; stopped, {100 * (run.best / found.objective - 1):.1f} % above ours"
        print(
            row(
                f"a match against {by}",
                ours,
                spent,
                f"{asked}; {run.evaluations} evaluations; whole match {whole:.3g} s",
            ),
            flush=True,
        )


if __name__ == "__main__":
    main()
