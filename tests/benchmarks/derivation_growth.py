"""Derivation and compilation of a chain: time over its length, against SymPy's LagrangesMethod on a short one."""

import math
import time

import sympy as sm
import sympy.physics.mechanics as me

from modelling.equations.casadi_code import compiled
from modelling.model_file import from_dict
from modelling.system import System
from tests.benchmarks.row import peer_runs, row

LENGTHS = (10, 30, 100, 300)


def chain(count: int, mark: str) -> System:
    parts = {f"{mark}{i}": {"J": 1.0 + 0.01 * i} for i in range(count)}
    shafts = {
        f"{mark}{i}": {"between": [f"{mark}{i}", f"{mark}{i + 1}"], "stiffness": 100.0, "damping": 0.1}
        for i in range(count - 1)
    }
    return from_dict({"inertias": parts, "shafts": shafts, "inputs": {"u": {"on": f"{mark}0"}}})


def seconds(count: int) -> float:
    """Best of two, each with names of its own so that nothing is kept from the first."""
    times = []
    for mark in ("a", "b"):
        system = chain(count, f"{mark}{count}_")
        began = time.perf_counter()
        compiled(system)
        times.append(time.perf_counter() - began)
    return min(times)


def lagranges_method(count: int) -> float:
    began = time.perf_counter()
    t = me.dynamicsymbols._t
    q = me.dynamicsymbols(f"q0:{count}")
    J, k = sm.symbols(f"J0:{count}"), sm.symbols(f"k0:{count - 1}")
    T = sum(j * angle.diff(t) ** 2 for j, angle in zip(J, q)) / 2
    V = sum(c * (a - b) ** 2 for c, a, b in zip(k, q, q[1:])) / 2
    method = me.LagrangesMethod(T - V, list(q))
    method.form_lagranges_equations()
    sm.lambdify([*q, *J, *k], [method.mass_matrix, method.forcing], cse=True)
    return time.perf_counter() - began


def main() -> None:
    seconds(5)  # imports and warm-up
    times = {count: seconds(count) for count in LENGTHS}
    what = "equations and functions of 30 inertias"
    with peer_runs(what):
        print(row(what, times[30], lagranges_method(30), "–"))
    for count, took in times.items():
        print(f"  chain of {count:3}: {took:6.2f} s")
    growth = math.log(times[300] / times[10]) / math.log(30)
    print(f"  growth from 10 to 300: n^{growth:.2f} (asked for: n^1.3 at most, 300 in under 5 s)")


if __name__ == "__main__":
    main()
