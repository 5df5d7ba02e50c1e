"""The terms of the programme as functions with first and second derivatives, compiled where there is a compiler.

CasADi's own Jacobian of a mapped function sweeps the whole map once a direction. Here the expression of a single
frequency is differentiated, simplified and then mapped: the same numbers in a tenth of the time. No number of the case
stands in the expressions, so what is compiled serves every case of the same structure: it is kept in the cache under
what it is made from, and neither derived nor compiled again. Second derivatives are needed once a match and not
compiled: the compiler would take longer than it saves.
"""

from __future__ import annotations

import functools
import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from threading import Lock
from typing import Any

import casadi as ca

from matching.frequency.programme.terms import Term
from modelling.simulation.integrator.c_compiler import compiler
from modelling.simulation.integrator.c_library import generated, loaded, shared

OPTIMISATION = "-O1"  # beyond it the compiler takes longer than it saves
MOST_OPERATIONS = 10_000  # operations of a term beyond which the compiler would take minutes over its derivatives
FUNCTIONS_REMEMBERED = 64  # functions remembered in a process

Derivation = Callable[[str, Term], ca.Function]
_REMEMBERED: dict[tuple[str, bool], ca.Function] = {}


def value(name: str, term: Term) -> ca.Function:
    """(at, free, fixed) → value (a,)."""
    return _function(name, term, [], [term.value])


def jacobian(name: str, term: Term) -> ca.Function:
    """(at, free, fixed) → value (a,), derivative with respect to what moves (a, m) column by column."""
    return _function(name, term, [], [term.value, ca.vec(_jacobian(term.value, term.free))])


def weighted_gradient(name: str, term: Term) -> ca.Function:
    """(at, free, fixed, weight) → derivative (m,) of weightᵀ·value."""
    weight = ca.SX.sym("weight", term.value.numel())
    return _function(name, term, [weight], [ca.gradient(ca.dot(weight, term.value), term.free)])


def weighted_hessian(name: str, term: Term) -> ca.Function:
    """(at, free, fixed, weight) → second derivative (m·m,) of weightᵀ·value."""
    weight = ca.SX.sym("weight", term.value.numel())
    return _function(name, term, [weight], [ca.vec(ca.hessian(ca.dot(weight, term.value), term.free)[0])])


def together(terms: dict[str, tuple[Derivation, Term]], compiled: bool) -> dict[str, ca.Function]:
    """Functions by name, each a derivation of a term; compiled side by side where that is wanted and possible."""
    compiled = compiled and compiler() is not None
    keys = {name: (_key(name, derive, term), compiled) for name, (derive, term) in terms.items()}
    missing = [name for name, key in keys.items() if key not in _REMEMBERED]
    one_by_one = Lock()  # CasADi's expressions are not thread-safe

    def built(name: str) -> Path | None:
        derive, term = terms[name]
        if term.plain.n_instructions() > MOST_OPERATIONS:
            return None

        def source() -> str:
            with one_by_one:
                return generated(derive(name, term))

        return shared(keys[name][0], source, OPTIMISATION)

    libraries: list[Path | None] = [None] * len(missing)
    if compiled and missing:
        with ThreadPoolExecutor(max(1, min(len(missing), os.cpu_count() or 1))) as pool:
            libraries = list(pool.map(built, missing))
    functions = {name: _REMEMBERED[key] for name, key in keys.items() if name not in missing}
    for name, library in zip(missing, libraries, strict=True):
        derive, term = terms[name]
        functions[name] = _REMEMBERED[keys[name]] = loaded(name, library) or derive(name, term)
    while len(_REMEMBERED) > FUNCTIONS_REMEMBERED:
        _REMEMBERED.pop(next(iter(_REMEMBERED)))
    return functions


def _key(name: str, derive: Derivation, term: Term) -> str:
    """All that a function is made from."""
    return "\0".join((name, derive.__name__, term.text, ca.CasadiMeta.version(), _source_text()))


@functools.cache
def _source_text() -> str:
    return Path(__file__).read_text(encoding="utf-8")


def _function(name: str, term: Term, more: list[ca.SX], outputs: list[ca.SX]) -> ca.Function:
    dense: Any = [ca.densify(output) for output in outputs]
    return ca.Function(name, [term.at, term.free, term.fixed, *more], ca.cse(dense))


def _jacobian(value: ca.SX, free: ca.SX) -> ca.SX:
    if value.numel() < free.numel():
        return ca.vertcat(*(ca.gradient(value[i], free).T for i in range(value.numel())))
    return ca.jtimes(value, free, ca.SX.eye(free.numel()))
