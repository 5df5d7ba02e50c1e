"""Lagrange's equations of a system, from energies, dissipation and virtual work.

d/dt ∂T/∂q̇ − ∂T/∂q + ∂V/∂q + ∂D/∂q̇ = Q, with D the Rayleigh dissipation function and Q the generalised
forces of virtual work (Dresig and Holzweissig, Dynamics of Machinery, the paper's reference 10).
Each energy is differentiated by the coordinates it contains only, so the work grows with the chain, not its square.
"""

from __future__ import annotations

import functools
from dataclasses import dataclass, field

import sympy as sm

from modelling.common import display
from modelling.equations.assembly import Assembly
from modelling.equations.derivative import differentiate
from modelling.model.system import System


@dataclass(frozen=True)
class Equations:
    """M(p)·q̈ = force(q, q̇, z, u, p), ż = rates, y = readings; all SymPy, the mass matrix never inverted.

    Attributes
    ----------
    assembly : Assembly
        Energies by component, virtual work, coordinates, states, input and sensor paths.
    mass : dict of (int, int) to Expr
        Entries of the mass matrix (n, n) that are not zero, both triangles.
    force : list of Expr, length n
        Right-hand side.
    """

    assembly: Assembly
    mass: dict[tuple[int, int], sm.Expr] = field(repr=False)
    force: list[sm.Expr] = field(repr=False)

    @property
    def kinetic_energy(self) -> sm.Expr:
        """T = ½·Σ J·ω², J."""
        return sm.Add(*self.assembly.kinetic.values())

    @property
    def potential_energy(self) -> sm.Expr:
        """V, the elastic energy of the shafts, J."""
        return sm.Add(*self.assembly.potential.values())

    @property
    def dissipation(self) -> sm.Expr:
        """Rayleigh's dissipation function D = ½·Σ d·Δω², W."""
        return sm.Add(*self.assembly.dissipation.values())

    @property
    def motion(self) -> list[sm.Eq]:
        """Equations of motion, one a coordinate."""
        a = self.assembly
        inertial: list[list[sm.Expr]] = [[] for _ in a.q]
        for (i, j), entry in self.mass.items():
            inertial[i].append(entry * a.qdd[j])
        return [sm.Eq(sm.Add(*row), force, evaluate=False) for row, force in zip(inertial, self.force, strict=True)]

    def mass_matrix(self) -> sm.Matrix:
        """M as a SymPy matrix (n, n)."""
        n = len(self.assembly.q)
        return sm.Matrix(n, n, lambda i, j: self.mass.get((i, j), sm.Integer(0)))

    def _repr_html_(self) -> str:
        return display.html(self)


def derive(system: System) -> Equations:
    """Derive the equations of a system; systems that differ in values only share them.

    Raises
    ------
    InputError
        If rigid gears lock the system.
    """
    return _derive(_Structure(system))


class _Structure:
    """The structure of a system, equal for systems of the same equations; values do not count."""

    def __init__(self, system: System):
        self.system = system
        self._key = (
            tuple(part.name for part in system.inertias),
            tuple((part.name, part.between, part.ratio is None) for part in system.shafts),
            tuple((part.name, part.between) for part in system.gears),
            system.differentials,
            system.inputs,
            tuple((part.name, part.measures, part.of) for part in system.sensors),
            tuple((effect.kind, effect.at, tuple(key for key, _ in effect.parameters)) for effect in system.effects),
        )

    def __hash__(self) -> int:
        return hash(self._key)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _Structure) and self._key == other._key


@functools.lru_cache(maxsize=256)
def _derive(structure: _Structure) -> Equations:
    a = Assembly(structure.system)
    index = {symbol: i for symbols in (a.q, a.qd) for i, symbol in enumerate(symbols)}
    force: list[list[sm.Expr]] = [[] for _ in a.q]
    mass: dict[tuple[int, int], list[sm.Expr]] = {}
    for energy in a.kinetic.values():
        moving = sorted({index[s] for s in energy.free_symbols if s in index})
        for i in moving:
            momentum = differentiate(energy, a.qd[i])
            for j in moving:
                if entry := differentiate(momentum, a.qd[j]):
                    mass.setdefault((i, j), []).append(entry)
                if drift := differentiate(momentum, a.q[j]):
                    force[i].append(-drift * a.qd[j])
            if gradient := differentiate(energy, a.q[i]):
                force[i].append(gradient)
    for energies, symbols in ((a.potential, set(a.q)), (a.dissipation, set(a.qd))):
        for energy in energies.values():
            for s in energy.free_symbols:
                if s in symbols:
                    force[index[s]].append(-differentiate(energy, s))
    for _, torque, motion in a.work:
        for i, coefficient in motion.coefficients.items():
            force[i].append(torque * coefficient)
    _impose(a, mass, force)
    return Equations(a, {ij: sm.Add(*parts) for ij, parts in mass.items()}, [sm.Add(*parts) for parts in force])


def _impose(a: Assembly, mass: dict[tuple[int, int], list[sm.Expr]], force: list[list[sm.Expr]]) -> None:
    """Replace, in place, the equations of coordinates with an imposed acceleration, which acts on those coupled."""
    for i, (_, acceleration) in a.imposed.items():
        for j in range(len(force)):
            coupling = mass.pop((j, i), None)
            mass.pop((i, j), None)
            if coupling and j != i:
                force[j].append(-sm.Add(*coupling) * acceleration)
        mass[i, i], force[i] = [sm.Integer(1)], [acceleration]
