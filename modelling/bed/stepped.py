"""One observer over a range of speeds: designs on a grid, and the vehicle itself stepped beside them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import casadi as ca
import numpy as np
from scipy.linalg import expm

from modelling.bed.bed import BedModel, ControlLaw, Loop, bed_model, predicted_part
from modelling.bed.clutches import LiveClutches, carried_torques, live_clutches, opened, reaction
from modelling.bed.firing import PulseFollowing, Pulses, no_following, pulses_in
from modelling.bed.observer import (
    FORGETTING_PER_SAMPLE,
    assembled,
    emulated_modes,
    filter_of,
    observer_model,
    riccati,
    runs_ahead,
    state_feedback,
)
from modelling.bed.vehicle import ResidualVehicle
from modelling.equations.casadi_code import Model, compiled
from modelling.equations.lagrange import CREEP, STICK_SPEED
from modelling.linear.elements import elements
from modelling.linear.linearise import deflated, linearise
from modelling.linear.steady_motion import operating_motion, speeds_of, torques_of
from modelling.system import Input, System

# --- The law.
#
# The residual vehicle is a nonlinear simulation of its own: it takes the torque at each cut and gives the speed of the
# wheel there, one sample later. The observer has a linear likeness of it. What the vehicle does beyond the likeness,
# where it is, acts on the likeness as a known torque (the remainder), and a load that wanders at each wheel is
# estimated next to it: both together make the likeness follow the wheel speeds that the vehicle gives. The bed's
# readings correct rig and unmeasured torques as always, and what they say of the inertias at the cuts goes into the
# vehicle as momentum. At every speed of a grid rig, lags and likeness are linearised and a controller is designed with
# the same weights; all have the same physical states, so matrices are interpolated in the vehicle's speed.
# Nothing that the vehicle does fast is held over a sample inside the vehicle: it is as stable as its own integration.


@dataclass(frozen=True)
class SteppedSettings:
    """The numbers of the law that no search tunes.

    Attributes
    ----------
    load_drift : float
        N·m/√s: how fast the load of a wheel may wander beside what is computed. Chosen by
        trial: 1000 changes no error by more than a tenth.
    wheel_noise : float
        rad/s: how far the speed that the vehicle gives is trusted. Chosen by trial: less of it makes commands jump
        (10⁻⁴ by 400 N·m from sample to sample), and gains nothing. Between 0.003 and 0.3 no part of a drive changes by
        more than a tenth of a per cent of its range, so it is no weight of the search.
    angle_time : float
        s in which an angle between rotor and wheel is taken back while the wheels stand. Encoders count, so the angle
        is exact on a bed; without it the noise of the speeds piles up as a twist. Chosen by trial: 0.15 to 0.5 do.
    angle_roll : float
        rad that a wheel rolls while such an angle is forgotten: rolling, a tyre's contact patch forgets it. Chosen by
        trial: 0.25 leaves twice the twist when noise is added to the counts.
    sticks_below : float
        rad/s: dry friction of the vehicle rises to its torque up to here, as a creeping tyre does.
    sub_steps : float
        s, at most, of a step of the vehicle's integration.
    clutch_change : float
        (rad/s per N·m)²: price of changes of the commands that known torques ask for, of a vehicle with live clutches.
        A clutch that sticks changes its torque at once, and free commands would make up for the dead time in one
        sample. Chosen by trial on 42 drives at 8 ms: with 0, 10⁻⁹ or 10⁻⁷ one of them ended, at the clutch's capacity.
    """

    load_drift: float = 300.0
    wheel_noise: float = 0.03
    angle_time: float = 0.3
    angle_roll: float = 1.0
    sticks_below: float = 0.1
    sub_steps: float = 5e-4
    clutch_change: float = 1e-8


STEPPED = SteppedSettings()
GAMMA = 1.0 - 0.5**0.5  # of the Rosenbrock method ROS2: with it L-stable (Verwer et al., SIAM J. Sci. Comput. 20, 1999)
GRAVITY = 9.81  # m/s²
SLOPES = (0.25, 0.06, 0.01)  # of the tyres, for which a controller is designed beside that of the highest speed
SMALLEST_SLOPE = 1e-3  # of a tyre, by which a speed is divided
SLOWEST_SLIP = 0.5  # rad/s: slip is a speed difference over the body's speed, or over this where it is slower
FIRM = 1e6  # times the friction: nothing slips beyond proportion
ROUNDING = 1e-3  # of the wheels' noise, on every state of the vehicle, so that none counts as known exactly
ROAD = ("mass", "grade")  # what the vehicle is told beside the friction of each tyre


@dataclass(frozen=True)
class SteppedVehicle:
    """A residual vehicle as a simulation; v states without free angles, k cuts, r inputs, t tyres, g speeds.

    Attributes
    ----------
    rates, slopes, outputs : casadi.Function
        (states (v,), torques at the cuts (k,), own inputs (r,), road (t + 2,)) → rates (v,), their derivatives by the
        states (v, v), and [slip; torque, N·m; slope] (3·t) of the tyres: torque over slip, 1 where both are in
        proportion and 0 at the largest torque. ``road``: friction coefficient of each tyre over the
        planned one, mass of the bodies over the planned one, grade (1).
    by_cut : ndarray (v, k)
        Rates for 1 N·m at each cut.
    by_body : ndarray (v, m)
        Rates for 1 N·m at each body.
    wheel : ndarray (k, v)
        Speed of the wheel at each cut by state, rad/s.
    body : ndarray (v,)
        Speed of the vehicle by state, rad/s.
    radius : float
        m of the rolling tyre: distance over the body's angle.
    steady, steady_own : ndarray (g, v), (g, r)
        States of steady motion at speeds of the vehicle, and its own inputs there.
    inputs, tyres : tuple of str (r), (t)
        Torques and pedals of its own; shafts whose tyres slip.
    nonlinear : ndarray (r,)
        1 of an input whose effect depends on the motion, or on the input itself; 0 of a plain torque.
    pieces : int
        Steps of its integration in a sample.
    sample_time : float
        s.
    pulses : Pulses
        Torques over the angles of its inertias: of an engine. They are no part of ``rates``.
    without_effect : int
        How many of the inputs, the last ones, do nothing: what locked clutches can carry.
    slip : ndarray (c, v)
        rad/s of each live clutch by state; the last inputs are its torque, see :mod:`modelling.bed.clutches`.
    """

    rates: ca.Function
    slopes: ca.Function
    outputs: ca.Function
    by_cut: np.ndarray
    by_body: np.ndarray
    wheel: np.ndarray
    body: np.ndarray
    radius: float
    steady: np.ndarray
    steady_own: np.ndarray
    inputs: tuple[str, ...]
    nonlinear: np.ndarray
    tyres: tuple[str, ...]
    pieces: int
    sample_time: float
    pulses: Pulses
    without_effect: int = 0
    slip: np.ndarray = field(default_factory=lambda: np.zeros((0, 0)))

    def schedule_speed(self, x: np.ndarray, road: np.ndarray) -> float:
        """The speed, rad/s, at which the vehicle's tyres would damp as they do at this state (v,) and on this road.

        What a tyre damps goes with its slope over the speed. Near the largest torque it damps as at a much higher one.
        """
        speed, t = float(self.body @ x), len(self.tyres)
        if not t:
            return speed
        k, r = self.rates.size1_in(1), len(self.inputs)
        slope = self.outputs(x, np.zeros(k), np.zeros(r), road).full()[2 * t :, 0].min(initial=1.0)
        return speed / max(slope, SMALLEST_SLOPE)

    @property
    def as_planned(self) -> np.ndarray:
        """Road (t + 2,) as planned: friction and mass as in the file, level."""
        return np.r_[np.ones(len(self.tyres) + 1), 0.0]

    def step(
        self, x: np.ndarray, torques: np.ndarray, own: np.ndarray, road: np.ndarray, pulsing: np.ndarray | float = 0.0
    ) -> np.ndarray:
        """States (v,) a sample later; torques (k,), own inputs (r,) in N·m, road (t + 2,) and ``pulsing``, the rates
        (v,) of its pulses, are held.

        ROS2, linearly implicit: the fast states of a brake on a turning wheel and of a tyre at standstill are stable
        whatever the step is.
        """
        return self.step_carrying(x, torques, own, road, pulsing, np.zeros(len(self.slip)))[0]

    def step_carrying(
        self, x: np.ndarray, torques: np.ndarray, own: np.ndarray, road: np.ndarray, pulsing: np.ndarray | float,
        carried: np.ndarray,
    ) -> tuple[np.ndarray, np.ndarray]:  # fmt: skip
        """:meth:`step` where clutches carried torques (c,), and what they carry at its end; the last inputs are what
        they can carry.
        """
        h, c = self.sample_time / self.pieces, len(self.slip)
        most, acting = own[len(own) - c :], own.copy()
        for _ in range(self.pieces):
            acting[len(own) - c :] = carried
            slopes = self.slopes(x, torques, acting, road).full()
            W = np.eye(len(x)) - GAMMA * h * slopes
            first = np.linalg.solve(W, self.rates(x, torques, acting, road).full()[:, 0] + pulsing)
            second = self.rates(x + h * first, torques, acting, road).full()[:, 0] + pulsing - 2 * first
            x = x + h * (1.5 * first + 0.5 * np.linalg.solve(W, second))
            if c:
                by = np.linalg.solve(W, self.by_clutch)
                more = h * (1.5 * by + 0.5 * np.linalg.solve(W, self.by_clutch + h * slopes @ by - 2 * by))
                now = carried_torques(self.slip @ x, self.slip @ more, carried, most)
                x, carried = x + more @ (now - carried), now
        return x, carried

    @cached_property
    def by_clutch(self) -> np.ndarray:
        """Rates (v, c) for 1 N·m that each clutch carries."""
        return self.rates_by_own(np.zeros(len(self.body)), np.zeros(len(self.inputs)))[
            :, len(self.inputs) - len(self.slip) :
        ]

    def drive(self, x: np.ndarray, torques: np.ndarray, own: np.ndarray, road: np.ndarray) -> np.ndarray:
        """States (n + 1, v) sample after sample as by :meth:`step`, under torques (n, k) and own inputs (n, r)."""
        if not len(torques):
            return np.asarray(x)[None]
        driven = self._one.mapaccum("driven", len(torques)) if len(torques) > 1 else self._one
        after = driven(x, torques.T, own.T, ca.repmat(ca.DM(road), 1, len(torques))).full().T
        return np.vstack([x, after])

    @cached_property
    def _one(self) -> ca.Function:
        """:meth:`step` in CasADi."""
        args = [ca.SX.sym(f"in{number}", self.rates.size1_in(number)) for number in range(4)]
        x, h = args[0], self.sample_time / self.pieces
        for _ in range(self.pieces):
            inverse = ca.inv(ca.SX.eye(x.numel()) - GAMMA * h * self.slopes(x, *args[1:]))
            first = inverse @ self.rates(x, *args[1:])
            second = self.rates(x + h * first, *args[1:]) - 2 * first
            x = x + h * (1.5 * first + 0.5 * (inverse @ second))
        return ca.Function("one", args, [x])

    def steady_at(self, speed: float, speeds: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """States (v,) and own inputs (r,) of steady motion at a speed, straight between those at ``speeds`` (g,)."""
        states, own = (
            np.array([np.interp(speed, speeds, each) for each in rows.T]) for rows in (self.steady, self.steady_own)
        )
        return states, own

    def slope_at(self, x: np.ndarray, own: np.ndarray) -> np.ndarray:
        """Derivatives (v, v) of the rates at a state and own inputs (r,), no torque at the cuts, as planned."""
        slopes: np.ndarray = self.slopes(x, np.zeros(self.rates.size1_in(1)), own, self.as_planned).full()
        return slopes

    def rates_by_own(self, x: np.ndarray, own: np.ndarray) -> np.ndarray:
        """Rates (v, r) at a state and own inputs (r,) for one more of each."""
        by: np.ndarray = self._derivatives(x, np.zeros(self.rates.size1_in(1)), own, self.as_planned)[2].full()
        return by

    def by_own(self, x: np.ndarray, own: np.ndarray) -> np.ndarray:
        """Rates (v, r) at a state and own inputs (r,) for one more of an own input whose effect depends on the motion
        or on itself, 0 of a plain torque."""
        return self.rates_by_own(x, own) * self.nonlinear

    def by_tyres(self, x: np.ndarray) -> np.ndarray:
        """The part (v, v) of the rates' derivatives at a state that the slope of the tyres makes."""
        zero = np.zeros(self.rates.size1_in(1)), np.zeros(len(self.inputs))
        road = np.r_[np.full(len(self.tyres), FIRM), 1.0, 0.0]
        loose = np.r_[np.full(len(self.tyres), 1 / FIRM), 1.0, 0.0]
        # a tyre that slides on nothing has no slope, whatever its deflection is
        slid = x + 1e-3
        firm, none = (self.slopes(slid, *zero, each).full() for each in (road, loose))
        return firm - none

    def linear(
        self, x: np.ndarray, own: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:  # fmt: skip
        """Matrices of a sample at one state (v,) and own inputs (r,): (v, v), by torques at the cuts (v, k), by own
        inputs (v, r) and by pulses (v, m)."""
        zero = [np.zeros(self.rates.size1_in(1)), own, self.as_planned]
        by = [*(part.full() for part in self._derivatives(x, *zero)), self.pulses.by]
        on, by_cut, by_own, by_pulse = sampled(by, self.sample_time)
        return on, by_cut, by_own, by_pulse

    @cached_property
    def _derivatives(self) -> ca.Function:
        args = [ca.SX.sym(f"in{number}", self.rates.size1_in(number)) for number in range(4)]
        f = self.rates(*args)
        return ca.Function("derivatives", args, [ca.jacobian(f, each) for each in args[:3]])


def sampled(rates: Sequence[np.ndarray], step: float) -> list[np.ndarray]:
    """From sample to sample (s): rates by the states (v, v), then by what is held over a sample."""
    v, size = len(rates[0]), sum(part.shape[1] for part in rates)
    block = np.zeros((size, size))
    block[:v] = np.hstack(rates)
    return np.split(expm(block * step)[:v], np.cumsum([part.shape[1] for part in rates[:-1]]), axis=1)


def stepped_vehicle(
    residuals: Sequence[ResidualVehicle], loop: Loop, bodies: Sequence[str], radius: float,
    settings: SteppedSettings = STEPPED, locked: Sequence[str] = (),
) -> SteppedVehicle:  # fmt: skip
    """The residual vehicle of a range; one with live clutches has no states of steady motion. What these carry stands
    last among its inputs.

    Parameters
    ----------
    residuals : sequence of ResidualVehicle (g)
        The same at every speed, but for its operating point.
    loop : Loop
        Its dynamometers give the order of the cuts.
    bodies : sequence of str
        Inertias whose mean speed is the vehicle's, and which carry its mass.
    radius : float
        m of the rolling tyre.
    locked : sequence of str
        Further inputs, without an effect: what clutches can carry that are locked here.
    """
    first = residuals[0]
    cuts = [first.cut_at(one.follows) for one in loop.dynamometers]
    cut_names = [cut.torque for cut in cuts]
    boxes = [box for system in first.parts for box in system.gearboxes]
    live = [box.capacities[0] for box in boxes]
    clutches = {reaction(name): name for name in live}
    ratios = {reaction(box.capacities[0]): box.ratios[0].value for box in boxes}
    plain = [part.name for system in first.parts for part in system.inputs if part.name not in (*cut_names, *live)]
    own = (*plain, *live, *locked)
    tyres = tuple(effect.at for system in first.parts for effect in system.effects if effect.kind == "tyre_slip")
    at_cuts, at_own = ca.SX.sym("T", len(cuts)), ca.SX.sym("w", len(own))
    road, at_bodies = ca.SX.sym("road", len(tyres) + len(ROAD)), ca.SX.sym("B", len(bodies))
    rippled = [effect for system in first.parts for effect in pulses_in(system)]
    pulse_names, at_pulses = [f"pulse_{number}" for number in range(len(rippled))], ca.SX.sym("P", len(rippled))
    pulsed = {name: effect.at.removeprefix("inertias.") for name, effect in zip(pulse_names, rippled, strict=True)}
    grade = road[len(tyres) + 1]
    states, rates, body, slips, torques, steepness = [], [], [], [], [], []
    speeds_by_name: dict[str, tuple[int, np.ndarray]] = {}
    parts_of = [opened(system) if system.gearboxes else system for system in first.parts]
    lifts = [_lift(system) for system in parts_of]  # which angles nothing depends on is the same at every speed
    for number, (system, lift) in enumerate(zip(parts_of, lifts, strict=True)):
        here = [name for name in bodies if any(part.name == name for part in system.inertias)]
        inside = {part.name for part in system.inertias}
        more = replace(
            system,
            inputs=(
                *system.inputs,
                *(Input(f"grade_on_{name}", name) for name in here),
                *(Input(name, at) for name, at in pulsed.items() if at in inside),
            ),
        )
        model = compiled(more)
        x = ca.SX.sym(f"x{number}", lift.shape[1])
        values = _values_on(model, system, here, tyres, road, settings)
        downhill = GRAVITY / radius * grade / ca.sqrt(1 + grade**2)
        inertia = {name: values[model.parameters.index(f"inertias.{name}.J")] for name in here}
        u = ca.vertcat(*(
            at_cuts[cut_names.index(name)] if name in cut_names
            else -at_own[own.index(name)] if name in live
            else ratios[name] * at_own[own.index(clutches[name])] if name in clutches
            else at_own[own.index(name)] if name in own
            else at_pulses[pulse_names.index(name)] if name in pulsed
            else at_bodies[bodies.index(name.removeprefix("grade_on_"))]
            - inertia[name.removeprefix("grade_on_")] * downhill
            for name in model.inputs
        ))  # fmt: skip
        rates.append(lift.T @ model.rates(lift @ x, u, values))
        states.append(x)
        parts = elements(model, model.p0[None])
        rows = parts.mass_transformation.reshape(-1, model.n) @ lift[model.n : 2 * model.n]
        named = {name.removeprefix("inertias."): row for name, row in zip(parts.masses, rows, strict=True)}
        speeds_by_name |= {name: (number, row) for name, row in named.items()}
        body.append(sum((named[name] for name in here), np.zeros(lift.shape[1])))
        for at in tyres:
            shaft = next((one for one in system.shafts if f"shafts.{one.name}" == at), None)
            if shaft is not None:
                inner, outer = (ca.DM(named[end][None]) @ x for end in shaft.between)
                slips.append((inner - outer) / ca.fmax(ca.fabs(outer), SLOWEST_SLIP))
                all_states = ca.SX.sym("all", len(model.states))
                through = model.shaft_torques(all_states, u, values)[
                    [one.name for one in system.shafts].index(shaft.name)
                ]
                by_carcass = ca.jacobian(through, all_states[model.states.index(f"{at}.tyre_slip")])
                slope = by_carcass / ca.substitute(by_carcass, road[: len(tyres)], ca.SX.ones(len(tyres)) * FIRM)
                torques.append(ca.substitute(through, all_states, lift @ x))
                steepness.append(ca.substitute(slope, all_states, lift @ x))
    starts = np.cumsum([0, *(lift.shape[1] for lift in lifts)])
    steady = [np.zeros(starts[-1])] if live else [
        np.concatenate([lift.T @ operating_motion(system).state for system, lift in zip(one.parts, lifts, strict=True)])
        for one in residuals
    ]  # fmt: skip
    acting = [{name: value for part in one.parts for name, value in torques_of(part).items()} for one in residuals]
    steady_own = np.array([[each.get(name, 0.0) for name in own] for each in acting]).reshape(len(residuals), len(own))
    wheel = np.zeros((len(cuts), starts[-1]))
    for j, cut in enumerate(cuts):
        number, row = speeds_by_name[cut.vehicle_end]
        wheel[j, starts[number] : starts[number + 1]] = row
    slip = np.zeros((len(boxes), starts[-1]))
    for clutch, box in enumerate(boxes):
        for end, share in zip(box.between, (1.0, -box.ratios[0].value), strict=True):
            number, row = speeds_by_name[end]
            slip[clutch, starts[number] : starts[number + 1]] += share * row
    whole, motion = ca.vertcat(*rates), ca.vertcat(*states)
    every = ca.substitute(
        whole, ca.vertcat(at_bodies, at_pulses), ca.SX.zeros(len(bodies) + len(rippled))
    )  # fmt: skip
    arguments = [motion, at_cuts, at_own, road]
    step = loop["sample_time"]
    by_own = ca.horzsplit(ca.jacobian(every, at_own))
    nonlinear = np.array([ca.depends_on(each, ca.vertcat(motion, at_own)) for each in by_own], dtype=float)
    nonlinear[len(plain) :] = 1.0  # what clutches carry depends on the motion
    there, others = ca.vertcat(*arguments, at_bodies, at_pulses), np.zeros(1 + len(bodies) + len(rippled))
    planned = ca.vertcat(steady[-1], np.zeros(len(cuts) + len(own)), np.ones(len(tyres) + 1), others)
    by_cut, by_body, by_pulse = (
        ca.DM(ca.evalf(ca.substitute(ca.jacobian(whole, each), there, planned))).full()
        for each in (at_cuts, at_bodies, at_pulses)
    )
    turns = np.zeros((len(rippled), starts[-1]))
    for pulse, at in enumerate(pulsed.values()):
        number, of_state = speeds_by_name[at]
        turns[pulse, starts[number] : starts[number + 1]] = of_state
    order, amplitude, phase = (
        np.array([dict(effect.parameters)[key].value for effect in rippled]) for key in ("order", "amplitude", "phase")
    )
    pulses = Pulses(tuple(pulsed.values()), order, amplitude, phase, by_pulse, turns)
    return SteppedVehicle(
        ca.Function("vehicle_rates", arguments, [ca.cse(every)]),
        ca.Function("vehicle_slopes", arguments, [ca.cse(ca.densify(ca.jacobian(every, motion)))]),
        ca.Function("vehicle_outputs", arguments, [ca.cse(ca.densify(ca.vertcat(*slips, *torques, *steepness)))]),
        by_cut, by_body, wheel, np.concatenate(body) / max(len(bodies), 1), radius, np.stack(steady),
        steady_own, own, nonlinear,
        tuple(at.removeprefix("shafts.") for at in tyres), max(int(np.ceil(step / settings.sub_steps - 1e-9)), 1), step,
        pulses, len(locked), slip,
    )  # fmt: skip


def _values_on(
    model: Model, system: System, bodies: Sequence[str], tyres: Sequence[str], road: ca.SX, settings: SteppedSettings
) -> ca.SX:
    """Parameters (p,) of a part with friction, mass and rolling resistance as the road and the load have them."""
    values = ca.SX(ca.DM(model.p0))
    still = [(f"{effect.name}.amplitude", 0.0) for effect in pulses_in(system)]  # pulses are the law's to count
    for name, value in ((STICK_SPEED, settings.sticks_below), (CREEP, 0.0), *still):
        if name in model.parameters:
            values[model.parameters.index(name)] = value
    for effect in system.effects:
        scaled = None
        if effect.at in tyres and effect.kind == "tyre_slip":
            scaled = f"{effect.name}.peak", road[list(tyres).index(effect.at)]
        if effect.kind == "coulomb_friction" and effect.at.removeprefix("inertias.") in bodies:
            scaled = f"{effect.name}.torque", road[len(tyres)]
        if scaled is not None:
            values[model.parameters.index(scaled[0])] *= scaled[1]
    for name in bodies:
        values[model.parameters.index(f"inertias.{name}.J")] *= road[len(tyres)]
    return values


def _lift(system: System) -> np.ndarray:
    linear = linearise(system, {f"{effect.name}.amplitude": 0.0 for effect in pulses_in(system)})  # over an angle
    return deflated(linear, elements(linear.model, linear.p[None], linear.x0)).lift


# --- The law's numbers and how it steps.


@dataclass(frozen=True)
class Emulation:
    """What a law over a range of speeds keeps while it emulates, of one bed.

    Attributes
    ----------
    state : ndarray (x,)
        Of the linear law, in deviations from where it was switched on.
    load : ndarray (k,)
        Estimated load of each wheel, N·m, as a deviation, too.
    angle : ndarray (k,)
        rad by which each rotor is ahead of its wheel, forgotten as the wheel rolls.
    vehicle : ndarray (v,)
        States of the vehicle, absolute.
    distance : float
        m.
    phase, pulse_speed : ndarray (m,)
        rad of each pulse (order times angle), and rad/s of its inertia, averaged.
    correction : ndarray (m,), complex
        N·m added to the command for each pulse, beside what is planned, as a turning phasor.
    carried : ndarray (c,)
        N·m that each clutch of the vehicle carried last.
    """

    state: np.ndarray
    load: np.ndarray
    angle: np.ndarray
    vehicle: np.ndarray
    distance: float = 0.0
    phase: np.ndarray = field(default_factory=lambda: np.zeros(0))
    pulse_speed: np.ndarray = field(default_factory=lambda: np.zeros(0))
    correction: np.ndarray = field(default_factory=lambda: np.zeros(0, complex))
    carried: np.ndarray = field(default_factory=lambda: np.zeros(0))


@dataclass(frozen=True)
class SlippingDesign:
    """Designs over speed for a vehicle whose clutches slip, with the states of the others; see :class:`SteppedLaw`.

    Attributes
    ----------
    laws : tuple of ControlLaw (d)
    likeness, by_wheel : ndarray (d, v, v), (d, v + k, k)
    momentum : ndarray (k, y)
    clutches : LiveClutches[SteppedVehicle]
    """

    laws: tuple[ControlLaw, ...]
    likeness: np.ndarray
    by_wheel: np.ndarray
    momentum: np.ndarray
    clutches: LiveClutches[SteppedVehicle]


@dataclass(frozen=True)
class SteppedLaw:
    """Designs over speed as one law, and the vehicle beside it; x states, y readings, w known, k cuts.

    Per sample: the readings correct the state, the vehicle's wheel speeds correct its likeness in the observer and the
    loads, the command follows as in :class:`modelling.bed.bed.ControlLaw`, and the vehicle takes a step with the mean
    torque at the cut. All matrices lie straight between those of the two nearest speeds.

    Attributes
    ----------
    laws : tuple of ControlLaw (d)
        At each of the ``designed`` speeds. Columns of the rates of the vehicle's states (v) follow those of the known
        torques: of the rig, then of the vehicle. Those whose effect depends on the motion (a brake) are in the vehicle
        alone, and their columns zero.
    likeness : ndarray (d, v, v)
        Rates of the observer's vehicle by its states.
    designed : ndarray (d,)
        rad/s of the vehicle, rising: those of the range, and higher ones at which its tyres damp as at the highest
        with a slope of :data:`SLOPES` (see :meth:`SteppedVehicle.schedule_speed`).
    by_wheel : ndarray (d, v + k, k)
        Correction of the observer's vehicle and of the loads by wheel speeds that are off by 1 rad/s.
    momentum : ndarray (k, y)
        N·m·s into the vehicle at each cut for a reading that is off by 1.
    vehicle : SteppedVehicle
    observed : slice
        Where the observer's vehicle stands among the states.
    cut_torque : ndarray (k, x)
        Torque into the vehicle at each cut by state.
    speeds, rotor_speeds : ndarray (g,)
        rad/s of the vehicle, rising, and mean of the rotors' speeds there, each counted as it turns forwards.
    rotor_shares : ndarray (k,)
        Of each rotor's speed in that mean.
    over : ndarray (k,)
        Speed of each rotor over that of its wheel.
    cut_by_reading, cut_by_command : ndarray (k, y), (k, k)
        Torque into the vehicle at each cut, N·m, by what was read and commanded in steady motion.
    speed_readings : tuple of int (k)
        Which readings are the rotors' speeds.
    operating_speed : float
        rad/s of the vehicle's bodies, about which a case reports its match.
    following : PulseFollowing
        Torques that are added to the commands for the vehicle's pulses.
    slipping : SlippingDesign or None
        Of a vehicle with live clutches: ``vehicle`` and the designs beside it hold them locked.
    settings : SteppedSettings
    """

    laws: tuple[ControlLaw, ...]
    designed: np.ndarray
    likeness: np.ndarray
    by_wheel: np.ndarray
    momentum: np.ndarray
    vehicle: SteppedVehicle
    observed: slice
    cut_torque: np.ndarray
    speeds: np.ndarray
    rotor_speeds: np.ndarray
    rotor_shares: np.ndarray
    over: np.ndarray
    cut_by_reading: np.ndarray
    cut_by_command: np.ndarray
    speed_readings: tuple[int, ...]
    operating_speed: float
    following: PulseFollowing
    slipping: SlippingDesign | None = None
    settings: SteppedSettings = STEPPED

    @property
    def stepped(self) -> SteppedVehicle:
        """The vehicle that is stepped in time."""
        return self.vehicle if self.slipping is None else self.slipping.clutches.vehicle

    @property
    def steps_vehicle(self) -> bool:
        """The vehicle is stepped by the law itself."""
        return True

    @property
    def first(self) -> ControlLaw:
        """The law at the lowest speed: names, sizes and expectation are the same at all."""
        return self.laws[0]

    @property
    def sensors(self) -> tuple[str, ...]:
        """Names of the readings (y)."""
        return self.first.sensors

    @property
    def known(self) -> tuple[str, ...]:
        """Names of the known torques (w)."""
        return self.first.known

    @property
    def dynamometers(self) -> tuple[str, ...]:
        """Names of the dynamometers (k)."""
        return self.first.dynamometers

    @property
    def sample_time(self) -> float:
        """In s."""
        return self.first.sample_time

    @property
    def states(self) -> int:
        """Number x of states of the linear law."""
        return self.first.states

    @property
    def E(self) -> np.ndarray:
        """Expectation (y, x) of the readings: sensors do not change with the speed."""
        return self.first.E

    @property
    def L(self) -> np.ndarray:
        """Correction (x, y) by the readings at the lowest speed: what is zero in it is zero at all."""
        return self.first.L

    @property
    def by_load(self) -> np.ndarray:
        """Rates (v, q) of the vehicle for each of the loads that are estimated: here those of its wheels."""
        return self.vehicle.by_cut

    @property
    def load_stays(self) -> float:
        """Share of a load that stays from sample to sample where nothing corrects it."""
        return 1.0

    @property
    def vehicle_states(self) -> int:
        """Number v of states of the vehicle."""
        return len(self.vehicle.body)

    @property
    def linear(self) -> ControlLaw:
        """The law about the operating point of its case."""
        return self.frozen(self.operating_speed)

    @property
    def _over_speed(self) -> dict[str, np.ndarray]:
        return _matrices(self)

    @cached_property
    def _stacked(self) -> dict[str, np.ndarray]:
        return self._over_speed

    @cached_property
    def _stacked_slipping(self) -> dict[str, np.ndarray]:
        assert self.slipping is not None
        return _matrices(self.slipping)

    def at(self, speed: float, slipping: bool = False) -> dict[str, np.ndarray]:
        """Matrices at a speed of the vehicle, rad/s, and whether a clutch of it slips."""
        stacked = self._stacked_slipping if slipping else self._stacked
        low = int(np.clip(np.searchsorted(self.designed, speed, side="right") - 1, 0, len(self.designed) - 2))
        share = float(np.clip((speed - self.designed[low]) / (self.designed[low + 1] - self.designed[low]), 0.0, 1.0))
        return {name: stack[low] + share * (stack[low + 1] - stack[low]) for name, stack in stacked.items()}

    def begin(self, readings: np.ndarray, sent: np.ndarray) -> tuple[Emulation, np.ndarray]:
        """Where an emulation begins, from absolute readings (y,) and commands (k,), and the torques at the cuts (k,).

        The vehicle begins as it runs steadily at the rotors' speed, below the lowest speed of a grid above 0 in
        proportion.
        """
        k, vehicle, pulses = len(self.dynamometers), self.steady_vehicle(readings), self.stepped.pulses
        if self.slipping is not None:
            vehicle = self.slipping.clutches.locked @ vehicle
        begun = Emulation(
            np.zeros(self.states), np.zeros(k), np.zeros(k), vehicle, 0.0, pulses.phase.copy(), pulses.turns @ vehicle,
            np.zeros(pulses.count, complex), np.zeros(len(self.stepped.slip)),
        )  # fmt: skip
        return begun, self.cut_torque_read(readings, sent)

    def steady_vehicle(self, readings: np.ndarray) -> np.ndarray:
        """States (v,) of the design vehicle that runs steadily at the rotors' speed, from absolute readings (y,)."""
        rotor = float(self.rotor_shares @ readings[list(self.speed_readings)])
        part = float(np.clip(rotor / self.rotor_speeds[0], -1.0, 1.0)) if self.rotor_speeds[0] > 0 else 1.0
        return part * np.array([np.interp(rotor, self.rotor_speeds, each) for each in self.vehicle.steady.T])

    def cut_torque_read(self, readings: np.ndarray, sent: np.ndarray) -> np.ndarray:
        """Torques (k,) at the cuts, N·m, from absolute readings (y,) and commands (k,)."""
        cut: np.ndarray = self.cut_by_reading @ readings + self.cut_by_command @ sent
        return cut

    def pulsing(self, now: Emulation) -> tuple[np.ndarray, np.ndarray]:
        """Of the pulses in the sample that begins: their torques (m,), held, and torques (k,) to be added."""
        pulses, added = self.stepped.pulses, np.zeros(len(self.dynamometers))
        turning = pulses.turns @ now.vehicle
        middle = pulses.amplitude * np.sin(now.phase + self.sample_time / 2 * pulses.order * turning)
        for number in range(pulses.count):
            gains = self.following.at(number, float(now.pulse_speed[number]))
            turned = np.sin(now.phase[number]) * gains.real + np.cos(now.phase[number]) * gains.imag
            added += pulses.amplitude[number] * turned
            by_error = now.correction[number] * np.exp(1j * now.phase[number])
            added[self.following.machines[number]] += by_error.imag
        return middle, added

    def _turned(
        self, now: Emulation, after: np.ndarray, errors: np.ndarray, free: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Phases, averaged speeds and corrections (m,) of the pulses a sample later, with the vehicle's states (v,)
        there; ``errors`` (k,) of the speeds at the cuts, rad/s, ``free`` (k,) of the commands' limits."""
        pulses, h = self.stepped.pulses, self.sample_time
        ends = pulses.turns @ after
        phase = now.phase + h / 2 * pulses.order * (pulses.turns @ now.vehicle + ends)
        share = h / (h + self.following.speed_time)
        correction = now.correction.copy()
        for number, machine in enumerate(self.following.machines):
            if free[machine]:
                correction[number] = self.following.corrected(
                    number, float(now.pulse_speed[number]), complex(correction[number]), float(errors[machine]),
                    float(now.phase[number]), h,
                )  # fmt: skip
        return np.mod(phase, 2 * np.pi), now.pulse_speed + share * (ends - now.pulse_speed), correction

    def step(
        self, now: Emulation, begun: Emulation, cut: np.ndarray, readings: np.ndarray, known: np.ndarray,
        own: np.ndarray, limits: tuple[np.ndarray, np.ndarray], road: np.ndarray, turned: np.ndarray,
        added: np.ndarray | float = 0.0,
    ) -> tuple[np.ndarray, Emulation]:  # fmt: skip
        """Commands (k,), N·m, and what is kept for the next sample.

        Parameters
        ----------
        now, begun : Emulation
            Before the sample, and where the emulation began.
        cut : ndarray (k,)
            Torques at the cuts then, N·m.
        readings, known : ndarray (y,), (w,)
            Less those of the begin.
        own, road : ndarray (r,), (t + 2,)
            Torques of the vehicle's own, what its clutches can carry last, N·m, absolute, and the road: see
            :class:`SteppedVehicle`.
        limits : (ndarray (k,), ndarray (k,))
            Of the commands, less those of the begin.
        turned : ndarray (k,)
            rad/s: each rotor's speed as it is read, absolute.
        """
        vehicle, settings, h, v = self.stepped, self.settings, self.sample_time, self.vehicle_states
        of_design = self.design_of(now, own)
        wheel = vehicle.wheel @ now.vehicle
        made = self.at(vehicle.schedule_speed(now.vehicle, road), of_design.slips)
        angle = (now.angle + h * (turned / self.over - wheel)) / (1 + h * np.abs(wheel) / settings.angle_roll)
        target = wheel - angle / settings.angle_time - vehicle.wheel @ begun.vehicle
        found = made["by_wheel"] @ (target - self.vehicle.wheel @ now.state[self.observed])
        innovation = readings - self.E @ now.state
        corrected = now.state + made["L"] @ innovation
        corrected[self.observed] += found[:v]
        load = now.load + found[v:]
        off = of_design.seen @ (now.vehicle - begun.vehicle)
        there = own - (1 - vehicle.nonlinear) * known[len(known) - len(own) :]  # plain torques are among the known ones
        pulsing, more = self.pulsing(now)
        remainder = of_design.rates(now, cut, there, road) - made["likeness"] @ off
        if of_design.slips:
            more = 0.0 * more
        elif len(pulsing):
            remainder = remainder + self.vehicle.pulses.by @ pulsing
        acting = np.concatenate([known, remainder + of_design.by_cut @ load])
        asked = made["K"] @ corrected + made["Dw"] @ acting + added + more
        sent = np.clip(asked, *limits)
        state = made["A"] @ corrected + made["Bw"] @ acting + made["Bs"] @ sent
        torque = cut + self.cut_torque @ (corrected + state) / 2 + of_design.momentum @ innovation / h
        after, carried = vehicle.step_carrying(
            now.vehicle, torque, own, road, vehicle.pulses.by @ pulsing, now.carried
        )  # fmt: skip
        speed = float(vehicle.body @ (now.vehicle + after)) / 2
        free = (asked == sent) & (not of_design.slips)
        return sent, Emulation(
            state,
            load,
            angle,
            after,
            now.distance + h * vehicle.radius * speed,
            *self._turned(now, after, turned / self.over - wheel, free),
            carried,
        )

    def design_of(self, now: Emulation, own: np.ndarray) -> _Design:
        """What the observer holds of the vehicle in this sample, under its inputs (r,)."""
        if self.slipping is None:
            return _Design(self.vehicle.by_cut, np.eye(self.vehicle_states), self.momentum, self.vehicle, None)
        clutches = self.slipping.clutches
        if not clutches.slipping(now.vehicle, own):
            return _Design(self.vehicle.by_cut, clutches.seen, self.momentum, self.vehicle, None)
        return _Design(clutches.by_cut, clutches.seen, self.slipping.momentum, clutches.vehicle, clutches)

    def frozen(self, speed: float, driven: bool = False, slipping: bool = False) -> ControlLaw:
        """The law and its vehicle about steady motion at one speed (rad/s) as one linear law.

        States [law (x); loads (k); vehicle (v)]; the angles that are taken back at standstill are left out. With
        ``driven`` the pulses (m) and torques that are added to the commands (k) follow the known torques. Clutches of
        the vehicle are locked; while they are ``slipping`` nothing passes them but what they carry.
        """
        made, v, by_load = self.at(speed, slipping), self.vehicle_states, self.by_load
        q = by_load.shape[1]
        x, w, y = self.states, len(self.known), len(self.sensors)
        r, m, k = len(self.vehicle.inputs), self.vehicle.pulses.count, len(self.dynamometers)
        steady, held = self.vehicle.steady_at(speed, self.speeds)
        slope, momentum = self.vehicle.slope_at(steady, held), self.momentum
        on, by_cut, by_own, by_pulse = self.vehicle.linear(steady, held)
        if slipping:
            assert self.slipping is not None
            clutches, momentum = self.slipping.clutches, self.slipping.momentum
            by_load, slope = clutches.by_cut, clutches.free_likeness(steady, held)
            on, by_cut = sampled([slope, by_load], self.sample_time)
            by_own, by_pulse = np.zeros_like(by_own), np.zeros_like(by_pulse)
        size = x + q + v
        # of [states; innovation; known; pulses; added]: corrected states and loads
        width = size + y + w + m + k
        pulse, added = np.eye(m, width, size + y + w), np.eye(k, width, width - k)
        state, innovation = np.eye(x, width), np.eye(y, width, size)
        off = -self.vehicle.wheel @ state[self.observed]
        off[:, x + q : size] += self.vehicle.wheel
        found = made["by_wheel"] @ off
        corrected = state + made["L"] @ innovation
        corrected[self.observed] += found[:v]
        load = self.load_stays * np.eye(q, width, x) + found[v:]
        remainder = (slope - made["likeness"]) @ np.eye(v, width, x + q)
        acting = np.vstack([np.eye(w, width, size + y), remainder + by_load @ load + self.vehicle.pulses.by @ pulse])
        command = made["K"] @ corrected + made["Dw"] @ acting + added
        after = made["A"] @ corrected + made["Bw"] @ acting
        torque = self.cut_torque @ (corrected + after) / 2 + momentum @ innovation / self.sample_time
        own = np.eye(r, width, size + y + w - r)
        vehicle = on @ np.eye(v, width, x + q) + by_cut @ torque + by_own @ own + by_pulse @ pulse
        rows = np.vstack([after, load, vehicle])
        sending = np.vstack(
            [made["Bs"], np.zeros((q, len(self.dynamometers))), by_cut @ self.cut_torque @ made["Bs"] / 2]
        )
        # by corrected states and readings in place of states and innovation: innovation = N·(y − E·xc)
        L, E = np.zeros((size, y)), np.zeros((y, size))
        L[:x], E[:, :x] = made["L"], self.E
        N = np.linalg.inv(np.eye(y) - E @ L)

        def form(of: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
            by_reading = (of[:, size : size + y] - of[:, :size] @ L) @ N
            return of[:, :size] - by_reading @ E, by_reading, of[:, size + y : width if driven else size + y + w]

        (A, By, Bw), (K, Dy, Dw) = form(rows), form(command)
        return ControlLaw(
            A, By, Bw, sending, K, Dy, Dw, L, E, self.sensors, self.known, self.dynamometers, self.sample_time,
            self.first.delayed_commands,
        )  # fmt: skip


@dataclass(frozen=True)
class _Design:
    """The vehicle that the observer holds, clutches locked or slipping; v states of it, x of the one that is stepped.

    ``seen`` (v, x) takes states of the one that is stepped to its own.
    """

    by_cut: np.ndarray
    seen: np.ndarray
    momentum: np.ndarray
    vehicle: SteppedVehicle
    clutches: LiveClutches[SteppedVehicle] | None

    @property
    def slips(self) -> bool:
        """Whether a clutch slips."""
        return self.clutches is not None

    def rates(self, now: Emulation, torques: np.ndarray, own: np.ndarray, road: np.ndarray) -> np.ndarray:
        """Rates (v,) of the vehicle that is stepped."""
        x = now.vehicle
        if self.clutches is not None:
            acting = self.clutches.acting(x, own, now.carried)
            slipping: np.ndarray = self.seen @ self.vehicle.rates(x, torques, acting, road).full()[:, 0]
            return slipping
        locked: np.ndarray = self.vehicle.rates(self.seen @ x, torques, own, road).full()[:, 0]
        return locked


def _matrices(of: SteppedLaw | SlippingDesign) -> dict[str, np.ndarray]:
    """By name, stacked over the designs."""
    stacked = {name: np.stack([getattr(law, name) for law in of.laws]) for name in ("A", "Bw", "Bs", "K", "Dw", "L")}
    return {**stacked, "by_wheel": of.by_wheel, "likeness": of.likeness}


Law = ControlLaw | SteppedLaw


def own_vehicle(law: Law) -> SteppedVehicle | None:
    """The vehicle that a law steps itself; None where there is none, or where others step it."""
    return law.stepped if isinstance(law, SteppedLaw) and law.steps_vehicle else None


def shown_of(law: Law) -> list[tuple[str, str, str]]:
    """Name, unit and meaning of what the emulated vehicle shows; nothing of a law without one."""
    own = own_vehicle(law)
    if own is None:
        return []
    tyres = own.tyres
    return [
        ("vehicle.speed", "m/s", "of the emulated vehicle"),
        ("vehicle.distance", "m", "since the emulation began"),
        *((f"{name}.wheel_speed", "rad/s", "of the emulated wheel at this cut") for name in law.dynamometers),
        *((f"{tyre}.slip", "1", "of the emulated tyre") for tyre in tyres),
        *((f"{tyre}.torque", "N*m", "of the emulated tyre on its road") for tyre in tyres),
    ]


def stepped_law(
    rigs: Sequence[System], residuals: Sequence[ResidualVehicle], loop: Loop, weights: Mapping[str, float],
    bodies: Sequence[str], radius: float, torque_signs: np.ndarray, operating_speed: float,
    live: ResidualVehicle | None = None, settings: SteppedSettings = STEPPED,
) -> SteppedLaw:  # fmt: skip
    """Design the law of a range; what pulses of its vehicle ask for is worked out with it, see
    :mod:`modelling.bed.pulse_following`.

    Parameters
    ----------
    rigs, residuals : sequence of System, sequence of ResidualVehicle (g)
        At operating points of rising speed.
    weights : mapping of str to float
        Of the observer.
    bodies : sequence of str
        Inertias whose mean speed is the vehicle's.
    radius : float
        m of the rolling tyre.
    torque_signs : ndarray (k,)
        Torque that drives the rotor for a flange reading of 1 N·m, see ``LinearBed.torque_signs``.
    operating_speed : float
        rad/s, see :class:`SteppedLaw`.
    live : ResidualVehicle, optional
        The same with clutches that slip and open; ``residuals`` hold them locked.
    """
    carried = () if live is None else tuple(name for part in live.parts for name in part.capacities)
    k, vehicle = len(loop.dynamometers), stepped_vehicle(residuals, loop, bodies, radius, settings, carried)
    cuts = [residuals[0].cut_at(one.follows) for one in loop.dynamometers]
    modes = [
        emulated_modes(residual, loop["sample_time"], predicted_part(rig, residual, loop))
        for rig, residual in zip(rigs, residuals, strict=True)
    ]
    most = max(map(len, modes))
    full = [number for number, each in enumerate(modes) if len(each) == most]
    nearest = [min(full, key=lambda other: abs(other - number)) for number in range(len(modes))]
    turning = [speeds_of(one.vehicle) for one in residuals]
    speeds = np.array([np.mean([each[name] for name in bodies]) for each in turning])
    places = [(number, 1.0) for number in range(len(speeds))]
    if vehicle.tyres:  # tyres that slide, either way
        backwards = [(0, slope) for slope in SLOPES[::-1]] if speeds[0] < 0 else []
        places = [*backwards, *places, *((len(speeds) - 1, slope) for slope in SLOPES)]
    scheduled = np.array([speeds[number] / slope for number, slope in places])
    about = int(np.abs(speeds - operating_speed).argmin())
    momentum = _momentum(rigs[about], residuals[about], vehicle, loop, weights, modes[nearest[about]])
    found = [
        _design(
            rigs[number], residuals[number], momentum, vehicle, loop, weights, modes[nearest[number]], settings, slope,
            (vehicle.steady[number], vehicle.steady_own[number]),
        )
        for number, slope in places
    ]  # fmt: skip
    laws, likeness, by_wheel = zip(*found, strict=True)
    slipping = None
    if live is not None:
        clutches = _with_live_clutches(live, residuals, vehicle, loop, bodies, radius, settings)
        free = [_free_modes(live, rig, loop, each) for rig, each in zip(rigs, modes, strict=True)]
        slips = clutches, (vehicle.steady[about], vehicle.steady_own[about])
        of_slips = _momentum(rigs[about], residuals[about], vehicle, loop, weights, free[nearest[about]], slips)
        made = [
            _design(
                rigs[number], residuals[number], of_slips, vehicle, loop, weights, free[nearest[number]], settings,
                slope, (vehicle.steady[number], vehicle.steady_own[number]), clutches,
            )
            for number, slope in places
        ]  # fmt: skip
        each = tuple(zip(*made, strict=True))
        slipping = SlippingDesign(each[0], np.stack(each[1]), np.stack(each[2]), of_slips, clutches)
    law, v = laws[0], len(vehicle.body)
    space = bed_model(rigs[0], residuals[0], loop)
    n = space.rig_states + loop.lag_states
    by_state = np.zeros((k, law.states))
    by_state[:, :n] = np.linalg.pinv(vehicle.by_cut) @ space.space.A[n:, :n]
    rotors = [next(part.on for part in rigs[0].inputs if part.name == one.torque_input) for one in loop.dynamometers]
    by_rig = [speeds_of(one) for one in rigs]
    # what turns the rotor turns the vehicle's end of the cut, by the ratio of their speeds
    over = np.array([by_rig[-1][rotor] / turning[-1][cut.vehicle_end] for rotor, cut in zip(rotors, cuts, strict=True)])
    turned = np.array([[each[name] for name in rotors] for each in by_rig])  # (g, k)
    # an engine beyond a cut may turn as it likes: the speed of the vehicle is that of its wheels
    parts = [residuals[0].part_of(cut) for cut in cuts]
    of_wheels = np.array([any(part.name in bodies for part in each.inertias) for each in parts], dtype=float)
    shares = np.sign(turned[-1]) * of_wheels / of_wheels.sum()
    by_reading, by_command = np.zeros((k, len(law.sensors))), np.zeros((k, k))
    for j, one in enumerate(loop.dynamometers):
        if one.torque_sensor is None:
            by_command[j, j] = -over[j]
        else:
            by_reading[j, law.sensors.index(one.torque_sensor)] = torque_signs[j] * over[j]
    return SteppedLaw(
        laws, scheduled, np.stack(likeness), np.stack(by_wheel), momentum, vehicle, slice(n, n + v), by_state,
        speeds, turned @ shares, shares, over, by_reading, by_command,
        tuple(law.sensors.index(one.speed_sensor) for one in loop.dynamometers), operating_speed,
        no_following(k), slipping, settings,
    )  # fmt: skip


def _with_live_clutches(
    live: ResidualVehicle, residuals: Sequence[ResidualVehicle], vehicle: SteppedVehicle, loop: Loop,
    bodies: Sequence[str], radius: float, settings: SteppedSettings,
) -> LiveClutches[SteppedVehicle]:  # fmt: skip
    """The vehicle whose clutches slip beside the one that has them locked, at the same steady motions."""
    stepped = stepped_vehicle([live], loop, bodies, radius, settings)
    lifts = [(_lift(opened(ours)), _lift(theirs)) for ours, theirs in zip(live.parts, residuals[0].parts, strict=True)]
    made = live_clutches(live, residuals[0], stepped, lifts)
    steady = vehicle.steady @ made.locked.T
    return replace(made, vehicle=replace(stepped, steady=steady, steady_own=vehicle.steady_own))


def _free_modes(
    live: ResidualVehicle, rig: System, loop: Loop, locked: Sequence[complex]
) -> Sequence[complex]:  # fmt: skip
    """Modes that torques at the rotors swing with while the clutches are open, as many as with them locked."""
    gone, vehicle = set(live.vehicle.capacities), live.vehicle
    freed = replace(
        vehicle, gearboxes=(), inputs=tuple(part for part in vehicle.inputs if part.name not in gone),
        operating_point=None,
    )  # fmt: skip
    free = replace(live, vehicle=freed)
    found = emulated_modes(free, loop["sample_time"], predicted_part(rig, free, loop))
    return found if len(found) == len(locked) else locked


def _design(
    rig: System, residual: ResidualVehicle, momentum: np.ndarray, vehicle: SteppedVehicle, loop: Loop,
    weights: Mapping[str, float], modes: Sequence[complex], settings: SteppedSettings, slope: float,
    steady: tuple[np.ndarray, np.ndarray], clutches: LiveClutches[SteppedVehicle] | None = None,
) -> tuple[ControlLaw, np.ndarray, np.ndarray]:  # fmt: skip
    """The observer at one speed, its vehicle (v, v), and its correction by wheel speeds (v + k, k).

    Its tyres have a ``slope`` of that at small slips; ``steady`` are its states and own inputs. With ``clutches`` these
    slip.
    """
    space = bed_model(rig, residual, loop)
    first = space.rig_states + loop.lag_states
    by_cut, by_tyres = vehicle.by_cut, vehicle.by_tyres(steady[0]) if slope < 1 else 0.0
    if clutches is not None:
        if slope < 1:
            by_tyres = clutches.seen @ clutches.vehicle.by_tyres(clutches.locked @ steady[0]) @ clutches.locked
        by_cut, space = clutches.by_cut, _slipping(space, first, vehicle, clutches, steady)
    if slope < 1:
        A = space.space.A.copy()
        A[first:, first:] -= (1 - slope) * by_tyres
        space = replace(space, space=replace(space.space, A=A))
    model = observer_model(rig, residual, loop, modes, True, space)
    F = state_feedback(model, weights["command_weight"], weights["command_change_weight"])
    found = filter_of(model, weights)
    ahead = runs_ahead(model, settings.clutch_change if vehicle.without_effect else 0.0)
    law = assembled(model, ahead, F, np.vstack([found.L, by_cut @ momentum]))
    w, v = len(law.known), len(vehicle.body)
    carried = vehicle.inputs[len(vehicle.inputs) - vehicle.without_effect :]
    r = len(vehicle.inputs) - len(carried)
    acts = np.r_[np.ones(w - r), 1 - vehicle.nonlinear[:r]]

    def together(
        columns: np.ndarray,
    ) -> np.ndarray:  # both vehicles, of the observer and ahead of it, have one remainder
        none = np.zeros((len(columns), len(carried)))
        return np.hstack([columns[:, :w] * acts, none, columns[:, w : w + v] + columns[:, w + v :]])

    law = replace(law, Bw=together(law.Bw), Dw=together(law.Dw), known=(*law.known, *carried))
    n = model.states
    on = model.bed.whole[n : n + v, n : n + v]
    of_loads = model.bed.torques[n : n + v, -v:] @ by_cut
    by_wheel = load_filter(on, of_loads, vehicle.wheel, loop["sample_time"], settings)
    return law, space.space.A[first:, first:], by_wheel


def _momentum(
    rig: System, residual: ResidualVehicle, vehicle: SteppedVehicle, loop: Loop, weights: Mapping[str, float],
    modes: Sequence[complex], slips: tuple[LiveClutches[SteppedVehicle], tuple[np.ndarray, np.ndarray]] | None = None,
) -> np.ndarray:  # fmt: skip
    """N·m·s into the vehicle at each cut for a reading that is off by 1 (k, y); with ``slips``, clutches and the states
    and own inputs of steady motion, while these slip.

    A reading that is off says that the torques before it were, too. Most of what they did has gone on into the vehicle;
    what of the filter's correction is left in the inertias at the cuts is made up for. All of their momentum would push
    a second time, and where the filter looks far back that is not stable.
    """
    space, by_cut = bed_model(rig, residual, loop), vehicle.by_cut
    if slips is not None:
        by_cut, first = slips[0].by_cut, space.rig_states + loop.lag_states
        space = _slipping(space, first, vehicle, *slips)
    model = observer_model(rig, residual, loop, modes, True, space)
    made: np.ndarray = np.linalg.pinv(by_cut) @ filter_of(model, weights).of_vehicle
    return made


def _slipping(
    space: BedModel, first: int, vehicle: SteppedVehicle, clutches: LiveClutches[SteppedVehicle],
    steady: tuple[np.ndarray, np.ndarray],
) -> BedModel:  # fmt: skip
    """A bed whose residual vehicle (its states from ``first`` on) has clutches that slip: what they carry is known."""
    A, B, by_shafts = space.space.A.copy(), space.space.B.copy(), space.shaft_torques.copy()
    onto = clutches.by_cut @ np.linalg.pinv(vehicle.by_cut)
    A[first:, first:] = clutches.free_likeness(*steady)
    A[first:, :first], by_shafts[first:] = onto @ A[first:, :first], onto @ by_shafts[first:]
    by_own = clutches.free_by_own(*steady)
    for column, name in enumerate(space.space.inputs):
        if name in vehicle.inputs:
            B[first:, column] = by_own[:, vehicle.inputs.index(name)]
    return replace(space, space=replace(space.space, A=A, B=B), shaft_torques=by_shafts)


def with_loads(on: np.ndarray, of_loads: np.ndarray) -> np.ndarray:
    """A vehicle (v, v) and the loads (v, q) that act on it, from sample to sample (v + q, v + q)."""
    v, q = of_loads.shape
    return np.block([[on, of_loads], [np.zeros((q, v)), (1 - FORGETTING_PER_SAMPLE) * np.eye(q)]])


def load_filter(
    on: np.ndarray, of_loads: np.ndarray, wheel: np.ndarray, step: float, settings: SteppedSettings, steps: int = 1
) -> np.ndarray:
    """Gain (v + q, k) of the Kalman filter that estimates a vehicle's states and its loads from its wheel speeds.

    Parameters
    ----------
    on, of_loads : ndarray (v, v), (v, q)
        The vehicle and what loads do to it, from sample to sample.
    wheel : ndarray (k, v)
    step : float
        s.
    steps : int
        Samples from one wheel speed to the next.
    """
    v, q = of_loads.shape
    unit = settings.load_drift * np.sqrt(step)  # N·m of a load, so that all states are of one size
    A = np.linalg.matrix_power(with_loads(on, unit * of_loads), steps)
    C = np.hstack([wheel, np.zeros((len(wheel), q))])
    Q = np.diag(np.r_[np.full(v, (ROUNDING * settings.wheel_noise) ** 2), np.full(q, float(steps))])
    R = settings.wheel_noise**2 * np.eye(len(wheel))
    P = riccati(A.T, C.T, Q, R, what="estimate of the vehicle's loads")
    gain: np.ndarray = np.linalg.solve(C @ P @ C.T + R, C @ P).T
    gain[v:] *= unit
    return gain
