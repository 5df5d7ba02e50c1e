"""What an effect may read of a drivetrain and change in its equations; laws import nothing else of the program.

The equations under construction (:class:`modelling.equations.assembly.Assembly`) and the model
(:class:`modelling.model.system.System`) fit the two protocols here.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any, Protocol

import sympy as sm

from modelling.common.errors import InputError

Symbols = Mapping[str, sm.Symbol]


class Drivetrain(Protocol):
    """The model that an effect belongs to."""

    @property
    def parameters(self) -> Mapping[str, Any]:
        """Every quantity by its full name."""

    @property
    def shafts(self) -> Iterable[Any]:
        """Shafts, see :class:`modelling.model.components.Shaft`."""

    @property
    def inputs(self) -> Iterable[Any]:
        """Inputs, see :class:`modelling.model.components.Input`."""

    @property
    def sensors(self) -> Iterable[Any]:
        """Sensors, see :class:`modelling.model.components.Sensor`."""

    def places(self) -> Iterable[str]:
        """Every ``table.name``."""


class EquationBuilder(Protocol):
    """The equations while components and effects write into them."""

    q: list[sm.Symbol]
    qd: list[sm.Symbol]
    qdd: list[sm.Symbol]
    time: sm.Symbol
    parameters: dict[str, sm.Symbol]
    potential: dict[str, sm.Expr]
    springs: dict[str, Spring]
    motions: dict[str, Motion]

    @property
    def recording(self) -> sm.Symbol:
        """Number of the recording that is simulated, from 1 in the order of a fit; 0 of any other motion."""

    def add_coordinate(self, name: str) -> Motion:
        """Add a degree of freedom."""

    def add_inertia(self, component: str, inertia: sm.Expr, motion: Motion) -> None:
        """Give a component its kinetic energy."""

    def add_state(self, name: str, derivative: Callable[[sm.Symbol], sm.Expr]) -> sm.Symbol:
        """Add a first-order state with its time derivative, as a function of its symbol."""

    def add_torque(self, component: str, torque: sm.Expr, motion: Motion) -> None:
        """Let a torque (N·m) act on a motion: it does virtual work on it, named after a component."""

    def impose(self, place: str, motion: Motion, acceleration: sm.Expr) -> None:
        """Let a motion have an acceleration (rad/s²) whatever torques act on it; a later one replaces an earlier."""

    def abbreviate(self, expression: sm.Expr) -> sm.Symbol:
        """A symbol for a constant expression of parameters and earlier abbreviations."""

    def symbol(self, name: str) -> sm.Expr:
        """The symbol of a parameter of the model; what effects make of it, where they replace or change it."""

    def sign(self, speed: sm.Expr) -> sm.Expr:
        """Sign of a speed (rad/s), smoothed over a stick speed that the simulation keeps small."""


@dataclass(frozen=True)
class Motion:
    """A rotation as a linear combination of coordinates: ``coefficients[i]`` is the coefficient of coordinate i."""

    coefficients: dict[int, sm.Expr]
    assembly: EquationBuilder = field(repr=False)

    def _sum(self, symbols: list[sm.Symbol]) -> sm.Expr:
        return sm.Add(*(coefficient * symbols[i] for i, coefficient in self.coefficients.items()))

    @property
    def angle(self) -> sm.Expr:
        """Angle, rad."""
        return self._sum(self.assembly.q)

    @property
    def speed(self) -> sm.Expr:
        """Speed, rad/s."""
        return self._sum(self.assembly.qd)

    @property
    def acceleration(self) -> sm.Expr:
        """Acceleration, rad/s²."""
        return self._sum(self.assembly.qdd)

    def __sub__(self, other: Motion) -> Motion:
        difference = dict(self.coefficients)
        for i, coefficient in other.coefficients.items():
            difference[i] = difference.get(i, sm.Integer(0)) - coefficient
        return Motion({i: c for i, c in difference.items() if c != 0}, self.assembly)

    def divided_by(self, ratio: sm.Expr) -> Motion:
        """The motion divided by a ratio."""
        return Motion({i: c / ratio for i, c in self.coefficients.items()}, self.assembly)


@dataclass(frozen=True)
class Spring:
    """A spring in small oscillations: tangent ``stiffness`` (N·m/rad), the ``twist`` it resists, its ``deflection``.

    Deflection and twist differ where a damper is in series with the spring.
    """

    stiffness: sm.Expr
    twist: Motion
    deflection: sm.Expr


@dataclass
class ShaftLaw:
    """The torque law of a shaft while effects shape it; closed by :func:`modelling.equations.shaft_law.close`.

    Attributes
    ----------
    place : str
        ``shafts.NAME``.
    first, second : Motion
        Of both ends, the first divided by the ratio.
    stiffness, damping : Expr
        N·m/rad, N·m·s/rad.
    rate : Symbol
        Placeholder of the twist rate (rad/s) until the law is closed.
    potentials : list of callable
        Twist → elastic energy.
    gap : Expr or None
        Free play, rad.
    series : Expr or None
        Coefficient of a damper in series, N·m·s/rad.
    series_state : str
        Name of the state that the damper in series adds, the deflection of the spring.
    quadratic : Expr
        Coefficient of damping in parallel that grows with the square of the rate, N·m·s²/rad².
    contact : pair of callable or None
        What passes on of the torque that spring, damper and parallel elements together would have: torque → torque,
        and the derivative of it. Goes with a damper in series.
    parallel, parallel_stiffness : list of Expr
        Torques of parallel elements, and their tangent stiffness for small oscillations about rest.
    losses : list of callable
        Torque of the closed law → torque (N·m) that is lost of it at the second end.
    torque : Expr
        All that the shaft transmits (N·m), once the law is closed.
    """

    place: str
    first: Motion
    second: Motion
    stiffness: sm.Expr
    damping: sm.Expr
    rate: sm.Symbol
    potentials: list[Callable[[sm.Expr], sm.Expr]]
    gap: sm.Expr | None = None
    series: sm.Expr | None = None
    series_state: str = ""
    contact: tuple[Callable[[sm.Expr], sm.Expr], Callable[[sm.Expr], sm.Expr]] | None = None
    quadratic: sm.Expr = sm.S.Zero
    parallel: list[sm.Expr] = field(default_factory=list)
    parallel_stiffness: list[sm.Expr] = field(default_factory=list)
    losses: list[Callable[[sm.Expr], sm.Expr]] = field(default_factory=list)
    torque: sm.Expr = sm.S.Zero

    def put_in_series(self, coefficient: sm.Expr, state: str) -> None:
        """Put a damper of a coefficient in series, whose spring's deflection is a state.

        Raises
        ------
        InputError
            If one is there.
        """
        if self.series is not None:
            raise InputError(self.place, "slips twice", "leave out slip or tyre_slip, or put it on a shaft of its own")
        self.series, self.series_state = coefficient, state


@dataclass(frozen=True)
class GearLaw:
    """What a rigid gear joins, reflected to its second end.

    Attributes
    ----------
    place : str
        ``gears.NAME``.
    second : Motion
        Of the second end.
    first_torque, second_torque : Expr
        All torques on the train on that side, N·m.
    first_inertia, second_inertia : Expr
        kg·m².
    """

    place: str
    second: Motion
    first_torque: sm.Expr
    first_inertia: sm.Expr
    second_torque: sm.Expr
    second_inertia: sm.Expr

    @property
    def torque(self) -> sm.Expr:
        """What the gear passes on where it loses nothing, N·m at the second end, positive when the first end leads."""
        taken = self.second_inertia * self.first_torque - self.first_inertia * self.second_torque
        return taken / (self.first_inertia + self.second_inertia)


@dataclass
class InputPath:
    """What happens to a recorded input before it acts: ``value`` (N·m) acts ``delay`` (s) later."""

    place: str
    value: sm.Expr
    delay: sm.Expr


@dataclass
class SensorPath:
    """What happens to the measured quantity before it is recorded: ``value`` (SI) is read ``delay`` (s) later."""

    place: str
    value: sm.Expr
    delay: sm.Expr
