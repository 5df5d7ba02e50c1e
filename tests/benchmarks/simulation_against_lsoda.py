"""Time simulation against SciPy's LSODA on the NumPy-lambdified equations, at equal error, in one run.

A vehicle chain of nine degrees of freedom with modes to 480 Hz (the parameter set of the reference case, with damping)
and a lash in the gearbox that a reversing torque crosses again and again. The error of a run is the largest root mean
square over the sensors, each over its range, against a reference with 64 times the steps, which an explicit Runge-Kutta
method of order eight confirms. LSODA is run at several tolerances; its time at equal error is read off between them.
Times are processor times.

    python -m tests.benchmarks.simulation_against_lsoda
"""

from __future__ import annotations

import math
import os
import tempfile
import time as clock
import tomllib
from collections.abc import Callable

import numpy as np

from modelling.equations.casadi_code import Model, compiled
from modelling.equations.shaft_law import CONTACT_TIME
from modelling.model_file import from_dict
from modelling.simulation.compiled import compiler
from modelling.simulation.simulate import sensitivities, simulate_batch
from tests.benchmarks.row import peer_runs

CHAIN = """
inertias.motor = { J = 4.98, drag = 0.5 }
inertias.gearbox.J = 1.0
inertias.differential.J = 0.05
inertias.wheel_left = { J = 0.69, drag = 0.1 }
inertias.wheel_right = { J = 0.69, drag = 0.1 }
inertias.tyre_left.J = 0.456
inertias.tyre_right.J = 0.456
inertias.body_left = { J = 90.1, drag = 1.0 }
inertias.body_right = { J = 90.1, drag = 1.0 }
shafts.mesh = { between = ["motor", "gearbox"], stiffness = 172716, damping = 20 }
shafts.final_drive = { between = ["gearbox", "differential"], stiffness = 412000, damping = 20 }
shafts.side_left = { between = ["differential", "wheel_left"], stiffness = 10920, damping = 4 }
shafts.side_right = { between = ["differential", "wheel_right"], stiffness = 10500, damping = 4 }
shafts.wheel_left = { between = ["wheel_left", "tyre_left"], stiffness = 118000, damping = 20 }
shafts.wheel_right = { between = ["wheel_right", "tyre_right"], stiffness = 118000, damping = 20 }
shafts.tyre_left = { between = ["tyre_left", "body_left"], stiffness = 114700, damping = 50 }
shafts.tyre_right = { between = ["tyre_right", "body_right"], stiffness = 114700, damping = 50 }
inputs.motor_torque.on = "motor"
sensors.motor_speed = { measures = "speed", of = "motor" }
sensors.wheel_speed = { measures = "speed", of = "wheel_left" }
sensors.body_speed = { measures = "speed", of = "body_left" }
sensors.side_torque = { measures = "torque", of = "side_left" }
[[effects]]
kind = "backlash"
at = "shafts.mesh"
gap = 0.004
"""
SECONDS, RATE = 2.0, 1000.0
TOLERANCES = (1e-3, 1e-4, 1e-5, 1e-6, 1e-7)
CHOSEN = ", choosing its steps"
GOALS = {"compiled": 300.0, "virtual machine": 10.0}


def motion() -> tuple[np.ndarray, np.ndarray]:
    """Time (t,) and motor torque (t, 1): reversing, with tip-ins."""
    time = np.arange(round(SECONDS * RATE) + 1) / RATE
    torque = 500 * np.sin(2 * np.pi * 1.3 * time) + 250 * np.sign(np.sin(2 * np.pi * 2.1 * time + 0.5))
    return time, torque[:, None]


def lambdified(model: Model) -> Callable[[float, np.ndarray, np.ndarray], np.ndarray]:
    """Rates (x,) as a SciPy user has them: force by sympy.lambdify, values in it, the mass matrix inverted once."""
    import sympy as sm

    a = model.equations.assembly
    p = model.vector({CONTACT_TIME: 1e-7})
    values = dict(zip(a.parameters.values(), map(float, p), strict=True))
    symbols = [*a.q, *a.qd, sm.Symbol("u(motor_torque)", real=True)]
    force = sm.lambdify(symbols, [term.xreplace(values) for term in model.equations.force], "numpy", cse=True)
    inverse = np.linalg.inv(np.array(model.mass(p)))
    n = model.n

    def rates(u: float, x: np.ndarray) -> np.ndarray:
        return np.concatenate([x[n:], inverse @ np.array(force(*x, u))])

    return rates


def by_scipy(model: Model, time: np.ndarray, u: np.ndarray, method: str, tolerance: float) -> tuple[np.ndarray, float]:
    """Readings (t, y) and seconds."""
    from scipy.integrate import solve_ivp

    rates = lambdified(model)
    torque = u[:, 0]

    def field(t: float, x: np.ndarray) -> np.ndarray:
        return rates(np.interp(t, time, torque), x)

    begin = clock.process_time()
    x0 = np.zeros(len(model.states))
    span, options = (0, time[-1]), {"rtol": tolerance, "atol": 1e-2 * tolerance, "max_step": 10 / RATE}
    done = solve_ivp(field, span, x0, method, time, **options)
    seconds = clock.process_time() - begin
    p = model.vector({CONTACT_TIME: 1e-7})
    return np.array(model.readings.map(len(time))(done.y, u.T, np.tile(p[:, None], len(time)), time[None])).T, seconds


def best_of(work: Callable[[], np.ndarray], times: int) -> tuple[np.ndarray, float]:
    """Result and the shortest time."""
    shortest = math.inf
    for _ in range(times):
        begin = clock.process_time()
        result = work()
        shortest = min(shortest, clock.process_time() - begin)
    return result, shortest


def main() -> dict[str, float]:
    """Measure, print, return the ratios."""
    model = compiled(from_dict(tomllib.loads(CHAIN), "benchmark"))
    time, u = motion()
    from modelling.simulation.stepping import steps_per_second

    steps = steps_per_second(model, model.p0[None])
    p = model.p0[None]
    if compiler():
        os.environ["RIGMATCH_CACHE"] = tempfile.mkdtemp()
        begin = clock.perf_counter()  # the compiler is another process
        simulate_batch(model, time[:10], u[:10], p, steps_per_second=steps)
        print(f"first call, generating and compiling: {clock.perf_counter() - begin:.2f} s")
    reference = simulate_batch(model, time, u, p, steps_per_second=64 * steps)[0]

    def error(readings: np.ndarray) -> float:
        return float((np.sqrt(np.mean((readings - reference) ** 2, axis=0)) / np.ptp(reference, axis=0)).max())

    with peer_runs("DOP853 at 1e-9"):
        check, seconds = by_scipy(model, time, u, "DOP853", 1e-9)
        print(f"the reference differs from DOP853 at 1e-9 ({seconds:.0f} s) by {error(check):.1e}")
    own: dict[str, tuple[float, float]] = {}
    for name, rate, compile_it, times in (
        ("compiled", steps, None, 20),
        ("compiled" + CHOSEN, None, None, 20),
        ("virtual machine", steps, False, 3),
        ("virtual machine" + CHOSEN, None, False, 3),
    ):
        if compile_it is None and not compiler():
            print("no C compiler here: only the virtual machine is measured")
            continue
        readings, shortest = best_of(
            lambda: simulate_batch(model, time, u, p, steps_per_second=rate, compile=compile_it)[0],  # noqa: B023
            times,
        )
        own[name] = error(readings), shortest
        told = f"{rate:.0f} steps a second" if rate else "within 1e-4 of every range"
        print(f"{name}: {shortest * 1e3:.2f} ms, error {own[name][0]:.1e}, {told}")
    peers = []
    for tolerance in TOLERANCES:
        with peer_runs(f"LSODA at {tolerance:g}"):
            readings, seconds = by_scipy(model, time, u, "LSODA", tolerance)
            peers.append((error(readings), seconds))
            print(f"LSODA at {tolerance:g}: {seconds:.2f} s, error {peers[-1][0]:.1e}")
    ratios = {}
    for name, (wrong, shortest) in own.items() if peers else ():
        equal = seconds_at(wrong, peers)
        ratios[name] = equal / shortest
        goal = f" (goal {GOALS[name.removesuffix(CHOSEN)]:g})"
        print(f"{name}: {ratios[name]:.0f} times as fast as LSODA at equal error{goal}")
    if "compiled" in own:
        names = model.parameters[:10]
        sensitivities(model, time[:10], u[:10], model.p0, names, steps_per_second=steps)
        _, shortest = best_of(
            lambda: sensitivities(model, time, u, model.p0, names, steps_per_second=steps).jacobian, 5
        )
        print(
            f"with ten sensitivities: {shortest * 1e3:.1f} ms, {shortest / own['compiled'][1]:.1f} times the simulation"
        )
    return ratios


def seconds_at(wrong: float, peers: list[tuple[float, float]]) -> float:
    """LSODA's seconds at an error: between its runs on logarithmic scales, at their ends the nearest run."""
    errors, seconds = (np.log(np.array(part)) for part in zip(*sorted(peers), strict=True))
    return float(np.exp(np.interp(np.log(wrong), errors, seconds)))


if __name__ == "__main__":
    main()
