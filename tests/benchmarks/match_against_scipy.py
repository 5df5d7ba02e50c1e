"""The reference match: IPOPT with exact derivatives against SciPy, same objective, bounds and constraints, one run.

Two races. *The whole match*: starts until three agree to 0.5 %, and a third of all, by either side. Ours finds itself
the frequencies at which the margin has to be held beside the grid; the peer is told them. *First arrival*: both sides
told them, forgiven 2e-3 of every constraint, and stopped at the first point within 1 % of the whole match's value that
is stable; nobody is told that value in practice, so a search that only ever comes near gets the most out of it. Both
sides begin at the same starts, one after the other; ours builds its programme within the clock. Peers:

``least_squares, NumPy``         finite differences; the objective as an engineer writes it without CasADi: stacks of
                                 complex matrices over all frequencies, vectorised (:mod:`tests.benchmarks.numpy_loop`)
``least_squares, helped``        the same with our own compiled functions as its objective
``differential_evolution``       with our own compiled functions

Constraints enter the peers as a penalty on what is short of them, relative: the smallest singular value of the return
difference under its bound, loads over their limits. It starts light, which finds good optima, and grows tenfold from
each end to the next, as long as that is worth it; then comes another start. A heavier penalty at first, or one
on our own scaled rows, was slower to arrive (measured). Peers are helped further: a secant iteration finds the tracked
eigenpairs for them, and where the lightest penalty ends at a poor optimum they are spared the heavier ones.

Where a peer has not arrived within its budget the ratio is a lower bound. Processor time, so that other load does not
count, without the checks of stability and margin on either side.
"""

import os
import time
from dataclasses import dataclass, field
from itertools import count
from pathlib import Path
from unittest import mock

import casadi as ca
import numpy as np
from scipy.optimize import differential_evolution, least_squares

from matching.match import solve as solving
from matching.match.case_file import load_case
from matching.match.programme import (
    EIGENVALUE_WEIGHT,
    MEET,
    SLOTS,
    Problem,
    _expressions,
    eigenpairs,
    margin_points,
    scaled,
    unscaled,
)
from matching.match.solve import (
    AGREEING_STARTS,
    AGREEMENT,
    ONE_AGREES_OF,
    Solution,
    TuningTask,
    check,
    numbered_start,
    run_from,
    solve,
)
from tests.benchmarks.numpy_loop import NumpyLoop
from tests.benchmarks.row import peer_runs, row
from tests.match.programme import programme_of

CASE = Path(__file__).parents[2] / "examples" / "road_to_rig" / "case.toml"
SEEDS = int(os.environ.get("MATCH_SEEDS", 5))  # of the starts, of seed 0 first the case's own; medians count
BUDGET = float(os.environ.get("MATCH_BUDGET", 100))  # of a peer, in times of ours
PEERS = ("least_squares, NumPy", "least_squares, helped", "differential_evolution")
NEAR = 1.01  # times the whole match's value
PENALTIES = (30.0, 300.0, 3000.0)  # of a relative violation squared, one after the other
POOR = 1.5  # times the best value: an end at the lightest penalty that is not followed any further
LOOSE = 1e-4  # tolerances of the peer's whole match: it then ends to three or four digits
NEXT = 1e-7  # relative step of a root after which the next one would be lost in rounding
BESIDE = 1 + 1e-12  # times a root that makes the matrix singular, far less than a step that counts
SLACK = 2e-3  # relative violation forgiven


_spent_on_checks = 0.0


def clock() -> float:
    """Processor time but for the checks of stability and margin, ours and the peers', s."""
    return time.process_time() - _spent_on_checks


def checked(problem: Problem, v: np.ndarray) -> tuple[float, float, bool]:
    """Modulus margin, its frequency in Hz, and whether the loop is stable; off the clock."""
    global _spent_on_checks
    began = time.process_time()
    found = check(problem, v)
    _spent_on_checks += time.process_time() - began
    return found


class Arrived(Exception):
    """It is there, or has spent its budget."""


@dataclass
class Reduced:
    """Objective of the quantities that move alone, eigenpairs eliminated; keeps the clock of a run."""

    problem: Problem
    task: TuningTask
    target: float
    budget: float
    added: tuple[float, ...] = ()
    began: float = field(default_factory=clock)
    evaluations: int = 0
    best: float = np.inf
    arrived: bool = False
    penalty: float = PENALTIES[0]
    watch: ca.Callback | None = None  # kept alive for the solver

    def __post_init__(self) -> None:
        own = self.problem
        self.size = len(own.moves)
        self.roots = [goal.eigenvalue for goal in own.goals]  # the last ones found, to begin from
        self.start = np.array([scaled(move.planned, move) for move in own.moves])
        self.response = own.loop.response.map(len(self.task.objective.vehicle))
        self.s = ca.DM(2 * np.pi * self.task.objective.frequencies).T
        self.extra = own.extra(self.added)
        extra = ca.MX.sym("extra", own.slots)
        self.places = ca.Function("places", [extra], [margin_points(own.case, extra)])(self.extra).full()

    def vector(self, moves: np.ndarray) -> np.ndarray:
        """The decision vector with the eigenpairs of these moves, each followed from the last, else from its goal."""
        p, parts = self.values(moves), [moves]
        for number, goal in enumerate(self.problem.goals):
            pattern = goal.pattern / np.linalg.norm(goal.pattern)
            s, x, found = self._root(self.roots[number], pattern, p)
            if not found:
                s, x, _ = self._root(goal.eigenvalue, pattern, p)
            self.roots[number] = s
            size = abs(goal.eigenvalue)
            parts += [np.array([s.real, s.imag]) / size, x.real, x.imag]
        return np.concatenate(parts)

    def values(self, moves: np.ndarray) -> np.ndarray:
        """p of the loop."""
        return np.array([unscaled(part, move) for part, move in zip(moves, self.problem.moves, strict=True)])

    def _root(self, s: complex, pattern: np.ndarray, p: np.ndarray) -> tuple[complex, np.ndarray, bool]:
        """Where (I + L(s))·x = 0 by the secant rule on 1/(patternᵀ(I + L)⁻¹pattern), x with patternᵀx = 1, if found."""
        k = len(pattern)

        def at(s: complex) -> tuple[complex, np.ndarray]:
            re, im = self.problem.loop.difference(s.real, s.imag, p)
            try:
                x = np.linalg.solve((re.full() + 1j * im.full()).reshape(k, k), pattern)
            except np.linalg.LinAlgError:  # the root, hit exactly: just beside it
                return at(s * BESIDE)
            return 1 / (pattern @ x), x / (pattern @ x)

        before, (value, x) = s * (1 + 1e-4), at(s)
        last = at(before)[0]
        for _ in range(20):
            if value == last or not np.isfinite(value):
                break
            step = value * (s - before) / (value - last)
            step *= min(1.0, 0.3 * abs(s) / max(abs(step), 1e-300))
            before, last, s = s, value, s - step
            value, x = at(s)
            if abs(step) < NEXT * abs(s):
                return s, x, True
        return s, x, False

    def both(self, v: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Residuals of the objective, and what is kept of the constraints, relative, to stay above 0; no eigenpairs."""
        g = self.problem.objective(v, self.extra)[1].full().ravel()
        least, limits = self.places[2], self.problem.g_upper[np.isfinite(self.problem.g_upper)]
        held, asked = g[: len(least)], g[np.isfinite(self.problem.g_upper)]
        smallest = np.sqrt(np.maximum((held + least**2) / (1 - held), 0.0))
        loads = limits != 0  # the others are rows of the eigenpairs
        p = ca.repmat(ca.DM(self.values(v[: self.size])), 1, self.s.shape[1])
        re, im = self.response(0 * self.s, self.s, p)
        wrong = self.wrong(v, (re.full() + 1j * im.full()).T)
        return wrong, np.concatenate([smallest / least - 1, 1 - asked[loads] / limits[loads]])

    def scalar(self, moves: np.ndarray) -> float:
        """Objective and penalty."""
        residuals = self.residuals(moves)
        return min(float(residuals @ residuals), 1e6)

    def residuals(self, moves: np.ndarray) -> np.ndarray:
        """Residuals whose squares add up to objective and penalty."""
        v = self.vector(np.asarray(moves, float))
        wrong, kept = self.both(v)
        missed = np.maximum(-kept, 0.0)
        self._seen(v, float(wrong @ wrong), missed)
        return np.nan_to_num(np.concatenate([wrong, np.sqrt(self.penalty) * missed]), nan=1e3)

    def wrong(self, v: np.ndarray, H: np.ndarray) -> np.ndarray:
        """The same from responses (f, h)."""
        ratio = H / self.task.objective.vehicle
        parts = [np.log(np.abs(ratio)).ravel(), np.unwrap(np.angle(ratio), axis=0).ravel()]
        wrong = [part / np.sqrt(ratio.size) for part in parts]
        pairs = eigenpairs(v, self.size, self.problem.case)
        for goal, (sigma, omega, *_) in zip(self.problem.goals, pairs, strict=True):
            natural, ratio_wanted = np.hypot(sigma, omega), -goal.eigenvalue.real / abs(goal.eigenvalue)
            wrong.append(np.sqrt(EIGENVALUE_WEIGHT) * np.array([natural - 1, -sigma / natural - ratio_wanted]))
        return np.concatenate(wrong)

    def _seen(self, v: np.ndarray, f: float, missed: np.ndarray) -> None:
        """Count, watch the clock, and see whether this is as good as ours."""
        self.evaluations += 1
        if f < self.best and missed.max(initial=0.0) <= SLACK and checked(self.problem, v)[2]:
            self.best = f
            self.arrived = f <= NEAR * self.target
        if self.arrived or clock() - self.began > self.budget:
            raise Arrived


@dataclass
class Plain(Reduced):
    """The same in NumPy alone."""

    def __post_init__(self) -> None:
        super().__post_init__()
        own = self.problem
        self.loop = NumpyLoop(own.case, own.moves)
        self.band = 2j * np.pi * self.task.objective.frequencies
        self.at = np.concatenate([self.band, self.places[0] + 1j * self.places[1]])
        goals = own.goals
        self.patterns = np.array([goal.pattern / np.linalg.norm(goal.pattern) for goal in goals])
        self.wanted = np.array([goal.eigenvalue for goal in goals])

    def vector(self, moves: np.ndarray) -> np.ndarray:
        """As there; all secant iterations at once."""
        p = self.values(moves)

        def at(s: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            patterns = np.tile(self.patterns, (len(s) // len(self.patterns), 1))
            try:
                x = np.linalg.solve(self.loop.at(s, p, 0)[1], patterns[:, :, None])[:, :, 0]
            except np.linalg.LinAlgError:  # as there
                return at(s * BESIDE)
            share = np.sum(patterns * x, axis=1)
            return 1 / share, x / share[:, None]

        def found(s: np.ndarray) -> tuple[np.ndarray, np.ndarray, bool]:
            before = s * (1 + 1e-4)
            values, vectors = at(np.concatenate([before, s]))
            last, value, x = *np.split(values, 2), vectors[len(s) :]
            for _ in range(20):
                going = (value != last) & np.isfinite(value)
                step = np.where(going, value * (s - before) / np.where(going, value - last, 1), 0)
                step *= np.minimum(1.0, 0.3 * np.abs(s) / np.maximum(np.abs(step), 1e-300))
                before, last, s = s, value, s - step
                value, x = at(s)
                if np.all(np.abs(step) < NEXT * np.abs(s)):
                    return s, x, True
            return s, x, False

        s, x, done = found(np.array(self.roots))
        if not done:
            s, x, _ = found(self.wanted)
        self.roots, size = list(s), np.abs(self.wanted)
        parts = [np.concatenate([[a.real / b, a.imag / b], c.real, c.imag]) for a, b, c in zip(s, size, x)]
        return np.concatenate([moves, *parts])

    def both(self, v: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """As there, for two dynamometers."""
        p = self.values(v[: self.size])
        H, D = self.loop.at(self.at, p, len(self.band))
        D, least = D[len(self.band) :], self.places[2]
        gram = np.conj(np.swapaxes(D, 1, 2)) @ D
        own, across = np.real(np.diagonal(gram, axis1=1, axis2=2)), np.abs(gram[:, 0, 1]) ** 2
        apart = np.sqrt(((own[:, 0] - own[:, 1]) / 2) ** 2 + across + (MEET * least**2) ** 2)
        smallest = (own[:, 0] * own[:, 1] - across) / (own.sum(1) / 2 + apart)
        kept = np.sqrt(np.maximum(smallest, 0.0)) / least - 1
        return self.wrong(v, H), np.concatenate([kept, 1 - self.demands(p)])

    def demands(self, p: np.ndarray) -> np.ndarray:
        """What the manoeuvre asks of shafts and dynamometers, over its limits."""
        case, limits = self.problem.case, self.task.demands.limits
        values = {f"rig.{name}": own.value for name, own in case.rig.parameters.items()}
        values |= {name: p[i] for i, move in enumerate(self.problem.moves) for name in move.together}
        rows = []
        for chain in self.task.demands.chains:
            for shaft, before in chain.shafts:
                torque = chain.peak(before, sum(values[f"rig.inertias.{name}.J"] for name in before))
                twist = torque / values[f"rig.shafts.{shaft}.stiffness"]
                rows += [
                    peak / limits[f"shafts.{shaft}.{what}"]
                    for what, peak in (("torque", torque), ("twist", twist))
                    if f"shafts.{shaft}.{what}" in limits
                ]
            total = sum(values[f"rig.inertias.{name}.J"] for name in chain.inertias)
            peaks = ("dynamometer_torque", 1.0), ("dynamometer_power", chain.speed)
            rows += [
                chain.peak(chain.inertias, total, factor) / limits[name] for name, factor in peaks if name in limits
            ]
        return np.array(rows)


def disagreement(helped: Reduced, plain: Plain) -> float:
    """Largest relative difference of objective and constraints over ten random points."""
    random, worst = np.random.default_rng(1), 0.0
    for _ in range(10):
        v = helped.vector(random.uniform(0.05, 0.95, helped.size))
        f = float(helped.problem.objective(v, helped.extra)[0])
        (wrong, kept), (own, own_kept) = plain.both(v), helped.both(v)
        worst = max(worst, abs(float(wrong @ wrong) / f - 1), abs(float(own @ own) / f - 1))
        near = np.minimum([kept, own_kept], 1.0)  # far from its bound a margin is lost in our rows' rounding
        worst = max(worst, float(np.abs(near[0] - near[1]).max()))
    return worst


def descended(run: Reduced, seed: int, number: int, best: float, **tolerances: float) -> tuple[np.ndarray, float]:
    """End and value of ``least_squares`` from a start, penalty by penalty unless the end is poor against the best."""
    end = numbered_start(run.problem, seed, number)[: run.size]
    run.roots = [goal.eigenvalue for goal in run.problem.goals]
    for run.penalty in PENALTIES:
        found = least_squares(run.residuals, end, bounds=(0.0, 1.0), x_scale=1.0, **tolerances)
        end, value = found.x, 2 * found.cost
        if value > POOR * best:
            break
    return end, value


def peer(task: TuningTask, ours: Solution, budget: float, by: str, seed: int) -> Reduced:
    """Run one of SciPy's until it arrives or has spent its budget (s)."""
    kind = Plain if "NumPy" in by else Reduced
    run = kind(task.build(slots=SLOTS), task, ours.objective, budget, ours.added)
    bounds = [(0.0, 1.0)] * run.size
    run.began = clock()
    try:
        if by == "differential_evolution":
            run.penalty = PENALTIES[1]
            differential_evolution(run.scalar, bounds, seed=seed, maxiter=10**6, tol=0, polish=False, init="sobol")
        for number in () if by == "differential_evolution" else count(min(seed, 1)):
            descended(run, seed, number, ours.objective)
    except Arrived:
        pass
    return run


def whole(task: TuningTask, ours: Solution, seed: int) -> tuple[float, float, int]:
    """``least_squares, NumPy`` as a match would use it: processor time in s, objective, number of starts."""
    run, ends = Plain(task.build(slots=SLOTS), task, -np.inf, np.inf, ours.added), []
    began = clock()
    for number in range(20):
        end, value = descended(run, seed, number, min(ends, default=np.inf), ftol=LOOSE, xtol=LOOSE, gtol=LOOSE)
        if checked(run.problem, run.vector(end))[2]:
            ends.append(value)
        if sum(value <= min(ends) * (1 + AGREEMENT) for value in ends) >= max(
            AGREEING_STARTS, (number + 1) / ONE_AGREES_OF
        ):
            break
    return clock() - began, min(ends), number + 1


class Watch(ca.Callback):
    """Looks at every iterate of IPOPT and stops it where it has arrived."""

    def __init__(self, run: Reduced, sizes: dict[str, int]):
        ca.Callback.__init__(self)
        self.run, self.sizes = run, sizes
        self.construct("watch", {})

    def get_n_in(self) -> int:
        return ca.nlpsol_n_out()

    def get_n_out(self) -> int:
        return 1

    def get_sparsity_in(self, i: int) -> ca.Sparsity:
        return ca.Sparsity.dense(self.sizes.get(ca.nlpsol_out(i).removeprefix("lam_"), 1))

    def eval(self, arguments: list[ca.DM]) -> list[float]:
        """1 to stop."""
        found = dict(zip((ca.nlpsol_out(i) for i in range(ca.nlpsol_n_out())), arguments, strict=True))
        own, g = self.run.problem, found["g"].full().ravel()
        try:
            if float(found["f"]) <= NEAR * self.run.target and own.violation(g) <= SLACK:
                self.run.residuals(found["x"].full().ravel()[: self.run.size])  # by what the peers are judged by
        except Arrived:
            return [1.0]
        return [0.0]


def watched(task: TuningTask, ours: Solution, seed: int) -> float:
    """Processor time of IPOPT from the start of the building of its programme to its arrival, s."""
    run = Plain(task.build(slots=SLOTS), task, ours.objective, np.inf, ours.added)
    plain = ca.nlpsol

    def nlpsol(name: str, by: str, programme: dict, options: dict) -> ca.Function:
        sizes = {key: programme[key].numel() for key in ("x", "g", "p")}
        run.watch = Watch(run, sizes)
        return plain(name, by, programme, options | {"iteration_callback": run.watch})

    _expressions.cache_clear()
    with mock.patch.object(ca, "nlpsol", nlpsol):
        began = clock()
        problem = task.build(slots=SLOTS)
    for number in range(min(seed, 1), 14):
        try:
            run_from(problem.oscillating(), numbered_start(problem, seed, number), ours.added)
        except KeyboardInterrupt:  # the watch stops IPOPT as Ctrl-C does
            if not run.arrived:
                raise
        if run.arrived:
            return clock() - began
    raise SystemExit("none of our starts comes where the whole match ends")


def main() -> None:
    solving.check = checked  # our own checks are off the clock as well
    task = programme_of(load_case(CASE))
    task.build()  # compiles what the cache lacks
    found = solve(task)
    if not found.feasible or not found.holds:
        raise SystemExit("our own match is infeasible")
    moves = np.array([scaled(found.values[move.name], move) for move in task.moves])
    margin, _, stable = checked(task.build(), moves)
    if not stable or margin < task.case.limits["modulus_margin"]:
        raise SystemExit(f"our own match is unstable or keeps a margin of {margin} only")
    helped, plain = (kind(task.build(slots=SLOTS), task, 0.0, np.inf, found.added) for kind in (Reduced, Plain))
    for one in (helped, plain):
        wrong = one.residuals(moves)
        if abs(wrong @ wrong / found.objective - 1) > 0.005:
            raise SystemExit(f"the peers would see another value at our solution: {wrong @ wrong}, {found.objective}")
    worst = disagreement(helped, plain)
    print(f"objective and constraints in NumPy are ours to {worst:.1e}")
    if not worst < 1e-9:
        raise SystemExit("the NumPy peer's objective is another one")
    runs = []
    for seed in range(SEEDS):
        _expressions.cache_clear()
        began = clock()
        own = solve(task, seed)
        spent = clock() - began
        if abs(own.objective / found.objective - 1) > NEAR - 1:
            raise SystemExit(f"seed {seed}: our match ends at {own.objective}, not {found.objective}")
        print(f"  whole match, seed {seed}: {spent:.3g} s, {len(own.starts)} starts, {own.objective:.5f}", flush=True)
        with peer_runs(f"  whole match by least_squares, NumPy, seed {seed}"):
            theirs, value, starts = whole(task, found, seed)
            runs.append((spent, theirs))
            print(f"  the same by least_squares, NumPy: {theirs:.3g} s, {starts} starts, {value:.5f}", flush=True)
    if runs:
        spent, theirs = (float(np.median(own)) for own in zip(*runs, strict=True))
        note = f">= 20; {len(runs)} of {SEEDS} ran"
        print(row("a whole match against least_squares, NumPy, medians", spent, theirs, note), flush=True)
    ours = {seed: watched(task, found, seed) for seed in range(SEEDS)}
    print("ours: " + ", ".join(f"{own:.3f} s" for own in ours.values()))
    for by in PEERS:
        runs = []
        for seed, own in ours.items():
            run = None
            with peer_runs(f"  {by}, seed {seed}"):
                run = peer(task, found, BUDGET * own, by, seed)
            if run is None:
                continue
            spent = clock() - run.began
            runs.append((spent / own, own, spent, run))
            reached = (
                "arrived" if run.arrived else f"stopped, {100 * (run.best / found.objective - 1):.1f} % above ours"
            )
            each = 1e3 * spent / run.evaluations
            print(
                f"  {by}, seed {seed}: {reached} after {spent / own:.1f} times ours, {run.evaluations} x {each:.2f} ms"
            )
        if not runs:
            continue
        own, spent = (float(np.median([one[i] for one in runs])) for i in (1, 2))
        arrived = sum(one[3].arrived for one in runs)
        note = f">= 20; {arrived} of {len(runs)} arrived"
        print(row(f"first arrival against {by}, medians", own, spent, note), flush=True)


if __name__ == "__main__":
    main()
