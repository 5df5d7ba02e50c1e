"""Laws of shafts and of friction: free play, springs, dampers, slip, losses, dry friction, drag."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from functools import partial

import numpy as np
import scipy
from sympy import Abs, Add, Expr, Integer, Rational, Symbol, atan, cos, exp, sign, sin

from modelling.effects import drifts
from modelling.effects.effect import (
    SECOND_STATE,
    Drivetrain,
    EquationBuilder,
    FittedMotion,
    GearLaw,
    Guess,
    Kind,
    Motion,
    Parameter,
    RecordedRange,
    ShaftLaw,
    SimplerEffect,
    Spring,
    State,
    Symbols,
    if_positive,
    smooth_sign,
)
from modelling.errors import ExcludedEffects

# --- Free play of a shaft.


class Backlash(Kind):
    """Dead zone of width ``gap`` (rad, total) in the twist; no torque across it."""

    kind = "backlash"
    words = "has {gap} of free play"
    in_recording = (
        "after a reversal of torque the speeds move apart freely for some milliseconds, then the torque "
        "jumps; a plot of torque over twist has a flat step of width gap."
    )
    tables = ("shafts",)
    parameters = {"gap": Parameter("rad", lower=0.0)}
    abrupt = True
    state_dependent = True
    free_play = "gap"

    def shaft(self, law: ShaftLaw, p: Symbols, assembly: EquationBuilder) -> None:
        law.gap = p["gap"]

    def guesses(self, motion: FittedMotion, at: str) -> Iterator[Guess]:
        name = at.split(".")[1]
        stiffness, twist = motion.value[f"{at}.stiffness"], motion.twist[name]
        for share in (0.02, 0.1, 0.3, 1.0):  # of the largest twist
            # free play takes half a gap of twist from the spring; around zero torque the transition has some width
            width = share * float(np.abs(twist).max())
            yield Guess(({at: -stiffness * np.clip(twist / width, -1, 1)},), if_positive("gap", 2.0))


# --- A further spring and inertia in series with a shaft: one more degree of freedom.


class Compliance(Kind):
    """Spring ``stiffness`` (N·m/rad) and inertia ``J`` (kg·m²) in series at the second end of the shaft."""

    kind = "compliance"
    words = "has a further spring of {stiffness} with an inertia of {J} at its second end"
    in_recording = "a further resonance; below it the shaft looks softer than stated."
    tables = ("shafts",)
    parameters = {"stiffness": Parameter("N*m/rad", lower=0.0), "J": Parameter("kg*m^2", lower=1e-12)}
    linear = True

    def shaft(self, law: ShaftLaw, p: Symbols, assembly: EquationBuilder) -> None:
        label = f"{law.place}.{self.kind}"
        middle = assembly.add_coordinate(label)
        further = middle - law.second
        assembly.add_inertia(label, p["J"], middle)
        assembly.potential[label] = p["stiffness"] * further.angle**2 / 2
        assembly.springs[label] = Spring(p["stiffness"], further, further.angle)
        law.second = middle

    def guesses(self, motion: FittedMotion, at: str) -> Iterator[Guess]:
        name, second = at.split(".")[1], motion.ends[at.split(".")[1]][1]
        k, c = motion.value[f"{at}.stiffness"], motion.value[f"{at}.damping"]
        J_end = min(motion.value[f"inertias.{end}.J"] for end in motion.ends[name])
        drive = k * motion.twist[name] + c * motion.twist_rate[name]
        for ratio in (1.0, 4.0, 16.0):  # of the shaft's stiffness
            for share in (0.02, 0.1, 0.4, 1.0):  # of the smaller inertia at its ends
                k2, J = ratio * k, share * J_end
                # J·d̈ + c·ḋ + (k + k2)·d = k·twist + c·rate − J·φ̈, with d the middle angle ahead of the second end
                b, a = scipy.signal.bilinear([1.0], [J, c, k + k2], 1 / motion.step)
                d = motion.filtered(list(b), list(a), drive - J * motion.acceleration[second])
                d_rate = motion.per_segment(lambda t, s: np.gradient(s, t), d)
                d_rate2 = motion.per_segment(lambda t, s: np.gradient(s, t), d_rate)
                addition = {at: -k * d - c * d_rate, f"inertias.{second}": -J * (motion.acceleration[second] + d_rate2)}
                yield Guess((addition,), partial(_softer, k2, J))

    def simpler(
        self, at: str, parameters: Mapping[str, float], value: Mapping[str, float], system: Drivetrain
    ) -> Iterator[SimplerEffect]:
        """A stiff one is a softer shaft, or a larger inertia at its second end."""
        name = f"{at}.stiffness"
        softer = 1 / (1 / value[name] + 1 / parameters["stiffness"])
        yield SimplerEffect("wrong_parameter", name, {"value": softer})
        second = next(shaft.between[1] for shaft in system.shafts if f"shafts.{shaft.name}" == at)
        name = f"inertias.{second}.J"
        yield SimplerEffect("wrong_parameter", name, {"value": value[name] + parameters["J"]})

    def fit_bounds(self, key: str, guess: float, step: float) -> tuple[float, float]:
        return (guess / 20, guess * 20)


def _softer(stiffness: float, J: float, a: np.ndarray) -> dict[str, float] | None:
    """Parameters for the amplitude a (1,) of the guessed effect: the larger, the softer the spring, the larger J."""
    return {"stiffness": stiffness / float(a[0]), "J": J * float(a[0])} if a[0] > 0.05 else None


# --- Dry friction of an inertia against ground.


class CoulombFriction(Kind):
    """torque·sgn(speed); with ``torque_reverse`` unequal by direction."""

    kind = "coulomb_friction"
    words = "has dry friction of {torque}"
    in_recording = (
        "speeds stop dead instead of fading out, and the difference to the model has the sign of the speed "
        "whatever its size."
    )
    tables = ("inertias",)
    parameters = {"torque": Parameter("N*m", lower=0.0), "torque_reverse": Parameter("N*m", lower=0.0, optional=True)}
    state_dependent = True
    sticks = True

    def inertia(self, motion: Motion, p: Symbols, assembly: EquationBuilder, name: str) -> None:
        sign = assembly.sign(motion.speed)
        forward, reverse = p["torque"], p.get("torque_reverse", p["torque"])
        friction = (forward * (1 + sign) - reverse * (1 - sign)) / 2 if reverse != forward else forward * sign
        assembly.add_torque(name, -friction, motion)

    def guesses(self, motion: FittedMotion, at: str) -> Iterator[Guess]:
        speed = motion.speed[at.split(".")[1]]
        sign = smooth_sign(speed)
        yield Guess(({at: -sign},), if_positive("torque"))
        if speed.min() < 0 < speed.max():
            forward, reverse = (1 + sign) / 2, (1 - sign) / 2
            yield Guess(
                ({at: -forward}, {at: reverse}),
                lambda a: {"torque": float(a[0]), "torque_reverse": float(a[1])} if min(a) > 0 else None,
            )

    def simpler(
        self, at: str, parameters: Mapping[str, float], value: Mapping[str, float], system: Drivetrain
    ) -> Iterator[SimplerEffect]:
        """The same in both directions."""
        if "torque_reverse" in parameters:
            yield SimplerEffect(self.kind, at, {"torque": sum(parameters.values()) / 2})

    def recorded_bounds(self, key: str, at: str, recorded: RecordedRange) -> tuple[float, float]:
        largest = recorded.torque[at.split(".")[1]]
        return -largest, largest


# --- Torque that a gear loses in proportion to what it passes on.

SMALLEST_LOSS, LARGEST_LOSS = 1e-4, 0.95  # share of the torque


class GearLoss(Kind):
    """Of the shaft's torque T, (1 − efficiency)·|T| is lost at the second end where that end is driven, and
    (1/efficiency_reverse − 1)·|T| where it drives; it opposes the second end's motion.

    Power in is then power out over the efficiency, either way. The shaft's sensor reads T, before the loss. Of a rigid
    gear T is what the train on its first side passes on, its own inertia accelerated.
    """

    kind = "gear_loss"
    words = "passes on torque with an efficiency of {efficiency}"
    in_recording = "torque is missing in proportion to the torque passed on: a step at zero speed that grows with load."
    tables = ("shafts", "gears")
    parameters = {
        "efficiency": Parameter("1", lower=1e-3, upper=1.0),
        "efficiency_reverse": Parameter("1", lower=1e-3, upper=1.0, optional=True),
    }
    state_dependent = True
    sticks = True

    def shaft(self, law: ShaftLaw, p: Symbols, assembly: EquationBuilder) -> None:
        of_size, of_torque = _shares(p, assembly.sign(law.second.speed))
        law.losses.append(lambda torque: of_size * Abs(torque) + of_torque * torque)

    def gear(self, law: GearLaw, p: Symbols, assembly: EquationBuilder) -> None:
        # (J₂ + (1 − share)·J₁)·T = J₂·F₁ − J₁·F₂, of both sides' torques and inertias; T has the sign of the right side
        of_size, of_torque = _shares(p, assembly.sign(law.second.speed))
        passed_on = law.second_inertia * law.first_torque - law.first_inertia * law.second_torque
        share = of_size * sign(passed_on) + of_torque
        inertia = law.second_inertia + (1 - share) * law.first_inertia
        lost = (of_size * Abs(passed_on) + of_torque * passed_on) / inertia
        assembly.add_torque(law.place, -lost, law.second)

    def simpler(
        self, at: str, parameters: Mapping[str, float], value: Mapping[str, float], system: Drivetrain
    ) -> Iterator[SimplerEffect]:
        """The same in both directions."""
        if "efficiency_reverse" in parameters:
            yield SimplerEffect(self.kind, at, {"efficiency": sum(parameters.values()) / 2})

    def guesses(self, motion: FittedMotion, at: str) -> Iterator[Guess]:
        table, name = at.split(".")
        ends, torques = (motion.ends, motion.torque) if table == "shafts" else (motion.gear_ends, motion.gear_torque)
        if name not in torques:
            return  # of a gear in a ring or beside a differential
        second, torque = ends[name][1], torques[name]
        direction = smooth_sign(motion.speed[second])
        lost = -np.abs(torque) * direction
        place = f"inertias.{second}"
        yield Guess(({place: lost},), _one_efficiency)
        driven = torque * direction > 0
        if driven.any() and not driven.all():
            yield Guess(({place: np.where(driven, lost, 0.0)}, {place: np.where(driven, 0.0, lost)}), _two_efficiencies)

    def possible(self, parameters: Mapping[str, float]) -> bool:
        return parameters["efficiency"] <= 1 and parameters.get("efficiency_reverse", 1.0) <= 1


def _shares(p: Symbols, direction: Expr) -> tuple[Expr, Expr]:
    """Shares lost of abs(T) and of T, ``direction`` the sign of the second end's speed.

    The loss is abs(T)·sgn(speed) at the mean of both shares, and half their difference where T drives the motion.
    """
    driven = 1 - p["efficiency"]
    driving = 1 / p.get("efficiency_reverse", p["efficiency"]) - 1
    return (driven + driving) / 2 * direction, (driven - driving) / 2 * direction**2


def _one_efficiency(a: np.ndarray) -> dict[str, float] | None:
    """The efficiency for the mean share (1 − e + 1/e − 1)/2 of torque that is lost."""
    share = float(a[0])
    return {"efficiency": float(np.sqrt(share**2 + 1) - share)} if SMALLEST_LOSS < share < LARGEST_LOSS else None


def _two_efficiencies(a: np.ndarray) -> dict[str, float] | None:
    driven, driving = (float(share) for share in a)
    if not (0 <= driven < LARGEST_LOSS and driving >= 0 and driven + driving > SMALLEST_LOSS):
        return None
    return {"efficiency": 1 - driven, "efficiency_reverse": 1 / (1 + driving)}


# --- Friction of a driven inertia that grows with the torque of its inputs: bearings and teeth that no gear stands for.


class LoadFriction(Kind):
    """coefficient·|T|·sgn(speed), T the torque of all inputs on the inertia. Of a shaft or gear: :class:`GearLoss`."""

    kind = "load_friction"
    words = "has dry friction of {coefficient} times the torque of its inputs"
    in_recording = "torque is missing in proportion to the torque put in, against the motion: braking is stronger."
    tables = ("inertias",)
    parameters = {"coefficient": Parameter("1", lower=0.0)}
    state_dependent = True
    sticks = True

    def inertia(self, motion: Motion, p: Symbols, assembly: EquationBuilder, name: str) -> None:
        load = assembly.load(name)
        if load == 0:
            raise ExcludedEffects(
                name, "has load_friction, and no torque input", "put gear_loss on a shaft or gear of it"
            )
        assembly.add_torque(name, -p["coefficient"] * Abs(load) * assembly.sign(motion.speed), motion)

    def guesses(self, motion: FittedMotion, at: str) -> Iterator[Guess]:
        name = at.split(".")[1]
        if name in motion.load:
            against = -np.abs(motion.load[name]) * smooth_sign(motion.speed[name])
            yield Guess(({at: against},), if_positive("coefficient"))

    def candidate_places(self, system: Drivetrain) -> list[str]:
        driven = (part.on for part in system.inputs if part.measures in (None, "torque"))
        return [f"inertias.{name}" for name in dict.fromkeys(driven)]


# --- A shaft whose stiffness grows or falls with its twist.


class Hardening(Kind):
    """Adds cubic·twist³ to the elastic torque; a negative value softens."""

    kind = "hardening"
    words = "has a torque that grows by {cubic} with the cube of its twist"
    in_recording = "the resonance frequency changes with amplitude, and torque over twist is a curve."
    tables = ("shafts",)
    parameters = {"cubic": Parameter("N*m/rad^3")}
    state_dependent = True

    def shaft(self, law: ShaftLaw, p: Symbols, assembly: EquationBuilder) -> None:
        law.potentials.append(lambda deflection: p["cubic"] * deflection**4 / 4)

    def guesses(self, motion: FittedMotion, at: str) -> Iterator[Guess]:
        yield Guess(({at: motion.twist[at.split(".")[1]] ** 3},), lambda a: {"cubic": float(a[0])})


# --- Rate-independent friction in parallel with a shaft (Dahl 1968).


class Hysteresis(Kind):
    """Dahl element: ż = twist_rate·(1 − sgn(twist_rate)·z/torque)·torque/angle.

    It is written with |twist_rate|, which is continuous.
    """

    kind = "hysteresis"
    slips = True
    words = "has hysteresis of {torque} over an angle of {angle}"
    in_recording = (
        "torque over twist is a loop that does not close up at low frequency; small oscillations see a "
        "stiffer and more damped shaft than large ones."
    )
    tables = ("shafts",)
    parameters = {"torque": Parameter("N*m", lower=0.0), "angle": Parameter("rad", lower=1e-9)}
    state = State("1", "hysteresis of {place}, as a share of its torque")
    state_dependent = True

    def shaft(self, law: ShaftLaw, p: Symbols, assembly: EquationBuilder) -> None:
        # z/torque is the state: it stays within ±1 and has a limit at torque = 0
        z = assembly.add_state(f"{law.place}.{self.kind}", lambda z: (law.rate - Abs(law.rate) * z) / p["angle"])
        law.parallel.append(p["torque"] * z)
        law.parallel_stiffness.append(p["torque"] / p["angle"])

    def guesses(self, motion: FittedMotion, at: str) -> Iterator[Guess]:
        name = at.split(".")[1]
        for share in (0.1, 0.3, 1.0, 3.0):  # of the standard deviation of the twist
            angle = share * float(motion.twist[name].std())
            yield Guess(
                ({at: motion.per_segment(partial(_dahl, angle), motion.twist_rate[name])},),
                if_positive("torque", angle=angle),
            )

    def simpler(
        self, at: str, parameters: Mapping[str, float], value: Mapping[str, float], system: Drivetrain
    ) -> Iterator[SimplerEffect]:
        """A spring, where the twist never reaches the angle."""
        name = f"{at}.stiffness"
        stiffer = value[name] + parameters["torque"] / parameters["angle"]
        yield SimplerEffect("wrong_parameter", name, {"value": stiffer})

    def fit_bounds(self, key: str, guess: float, step: float) -> tuple[float, float]:
        return (0.1 * guess, 10 * guess) if key == "angle" else super().fit_bounds(key, guess, step)


def _dahl(angle: float, time: np.ndarray, rate: np.ndarray) -> np.ndarray:
    """z/torque over a twist rate (t,), exact for a rate that is constant between samples."""
    mean = (rate[1:] + rate[:-1]) / 2
    kept = np.exp(-np.abs(mean) * np.diff(time) / angle)
    z, out = 0.0, [0.0]
    for share, toward in zip(kept.tolist(), (np.sign(mean) * (1 - kept)).tolist(), strict=True):
        z = share * z + toward
        out.append(z)
    return np.array(out)


# --- Rubber: a spring that a damper lets go, parallel to the shaft (Maxwell element of the standard linear solid).


class Relaxation(Kind):
    """A spring of ``stiffness`` in series with a damper, both parallel to the shaft: ż = twist_rate − z/time_constant.

    Slow twist meets the shaft alone, fast twist the shaft and the spring; in between it damps (dynamic stiffening of
    rubber; García Tárrago et al., Polymer Testing 26, 2007).
    """

    kind = "relaxation"
    words = "is stiffer by {stiffness} for fast twist, which relaxes within {time_constant} (rubber)"
    in_recording = (
        "fast oscillations see a stiffer shaft than slow ones, whatever their size; torque over twist is an ellipse."
    )
    tables = ("shafts",)
    parameters = {"stiffness": Parameter("N*m/rad", lower=0.0), "time_constant": Parameter("s", lower=1e-5)}
    state = State("rad", "twist of the relaxing spring of {place}")
    linear = True

    def shaft(self, law: ShaftLaw, p: Symbols, assembly: EquationBuilder) -> None:
        z = assembly.add_state(f"{law.place}.{self.kind}", lambda z: law.rate - z / p["time_constant"])
        law.parallel.append(p["stiffness"] * z)
        law.parallel_stiffness.append(p["stiffness"])

    def guesses(self, motion: FittedMotion, at: str) -> Iterator[Guess]:
        twist = motion.twist[at.split(".")[1]]
        for time_constant in (0.003, 0.01, 0.03, 0.1, 0.3, 1.0):  # s: of vibrations of 50 to 0.2 Hz
            fast = twist - motion.lagged(twist, time_constant)
            yield Guess(({at: fast},), if_positive("stiffness", time_constant=time_constant))

    def simpler(
        self, at: str, parameters: Mapping[str, float], value: Mapping[str, float], system: Drivetrain
    ) -> Iterator[SimplerEffect]:
        """A spring, where nothing in the recording is slow enough for it to relax; a damper, where nothing is fast."""
        stiffness, damping = f"{at}.stiffness", f"{at}.damping"
        yield SimplerEffect("wrong_parameter", stiffness, {"value": value[stiffness] + parameters["stiffness"]})
        added = parameters["stiffness"] * parameters["time_constant"]
        yield SimplerEffect("wrong_parameter", damping, {"value": value[damping] + added})

    def fit_bounds(self, key: str, guess: float, step: float) -> tuple[float, float]:
        return (0.1 * guess, 10 * guess) if key == "time_constant" else super().fit_bounds(key, guess, step)


# --- Rubber over a wide band: two springs that relax at different rates.


class DoubleRelaxation(Kind):
    """Two :class:`Relaxation` elements side by side: a fast and a slow one."""

    kind = "double_relaxation"
    words = (
        "is stiffer by {stiffness}, which relaxes within {time_constant}, and by {stiffness_2}, which relaxes within "
        "{time_constant_2} (rubber)"
    )
    in_recording = "the shaft grows stiffer and damps over several decades of frequency, whatever the amplitude."
    tables = ("shafts",)
    parameters = {
        "stiffness": Parameter("N*m/rad", lower=0.0), "time_constant": Parameter("s", lower=1e-5),
        "stiffness_2": Parameter("N*m/rad", lower=0.0), "time_constant_2": Parameter("s", lower=1e-5),
    }  # fmt: skip
    state = State("rad", "twist of the first relaxing spring of {place}")
    second_state = "twist of the second relaxing spring of {place}"
    linear = True

    def shaft(self, law: ShaftLaw, p: Symbols, assembly: EquationBuilder) -> None:
        for suffix, state in (("", ""), ("_2", SECOND_STATE)):
            relaxed = partial(_relaxed, law.rate, p[f"time_constant{suffix}"])
            z = assembly.add_state(f"{law.place}.{self.kind}{state}", relaxed)
            law.parallel.append(p[f"stiffness{suffix}"] * z)
            law.parallel_stiffness.append(p[f"stiffness{suffix}"])

    def guesses(self, motion: FittedMotion, at: str) -> Iterator[Guess]:
        twist = motion.twist[at.split(".")[1]]
        for fast, slow in ((0.003, 0.03), (0.01, 0.1), (0.03, 0.3), (0.1, 1.0)):  # s, a decade apart
            additions = tuple({at: twist - motion.lagged(twist, constant)} for constant in (fast, slow))
            yield Guess(additions, partial(_two_springs, fast, slow))

    def simpler(
        self, at: str, parameters: Mapping[str, float], value: Mapping[str, float], system: Drivetrain
    ) -> Iterator[SimplerEffect]:
        """One of the two alone."""
        for suffix in ("", "_2"):
            kept = {key: parameters[f"{key}{suffix}"] for key in ("stiffness", "time_constant")}
            yield SimplerEffect(Relaxation.kind, at, kept)

    def fit_bounds(self, key: str, guess: float, step: float) -> tuple[float, float]:
        return (0.1 * guess, 10 * guess) if key.startswith("time") else super().fit_bounds(key, guess, step)


def _relaxed(rate: Symbol, time_constant: Symbol, z: Symbol) -> Expr:
    """Rate of a relaxing spring's twist."""
    return rate - z / time_constant


def _two_springs(fast: float, slow: float, a: np.ndarray) -> dict[str, float] | None:
    if min(a) <= 0:
        return None
    return {"stiffness": float(a[0]), "time_constant": fast, "stiffness_2": float(a[1]), "time_constant_2": slow}


# --- A shaft that is softer or stiffer in one direction of its twist (chains, preloaded springs, split couplings).


class DirectionalStiffness(Kind):
    """The spring has ``factor`` times the stiffness where the twist is negative."""

    kind = "directional_stiffness"
    words = "has {factor} times the stiffness where its twist is negative"
    in_recording = "torque over twist has a corner at zero; the resonance frequency changes with the mean torque."
    tables = ("shafts",)
    parameters = {"factor": Parameter("1", lower=0.0)}
    state_dependent = True

    def shaft(self, law: ShaftLaw, p: Symbols, assembly: EquationBuilder) -> None:
        more = (p["factor"] - 1) * law.stiffness

        def energy(twist: Expr) -> Expr:
            return more * (twist - Abs(twist)) ** 2 / 8  # the square of its negative part, halved

        law.potentials.append(energy)

    def guesses(self, motion: FittedMotion, at: str) -> Iterator[Guess]:
        negative = np.minimum(motion.twist[at.split(".")[1]], 0.0)
        more = motion.value[f"{at}.stiffness"] * negative
        yield Guess(({at: more},), lambda a: {"factor": 1 + float(a[0])} if a[0] > -1 else None)


# --- Damping of a shaft that grows with the square of its twist rate (hydraulic damper, oil between plates).


class QuadraticDamping(Kind):
    """Adds coefficient·rate·|rate| to a shaft's torque, rate that of the twist."""

    kind = "quadratic_damping"
    words = "has damping that grows with the square of the twist rate by {coefficient}"
    in_recording = "large oscillations die out faster than small ones."
    tables = ("shafts",)
    parameters = {"coefficient": Parameter("N*m*s^2/rad^2", lower=0.0)}
    state_dependent = True

    def shaft(self, law: ShaftLaw, p: Symbols, assembly: EquationBuilder) -> None:
        law.quadratic += p["coefficient"]

    def guesses(self, motion: FittedMotion, at: str) -> Iterator[Guess]:
        rate = motion.twist_rate[at.split(".")[1]]
        yield Guess(({at: rate * abs(rate)},), if_positive("coefficient"))


# --- Drag that grows with the square of speed (air, churning).


class QuadraticDrag(Kind):
    """coefficient·speed·|speed|, resisting."""

    kind = "quadratic_drag"
    words = "has drag that grows with the square of speed by {coefficient}"
    in_recording = "the torque that holds a speed grows with the square of it; nothing is off at low speed."
    tables = ("inertias",)
    parameters = {"coefficient": Parameter("N*m*s^2/rad^2", lower=0.0)}
    state_dependent = True
    speed_exponent = 2

    def inertia(self, motion: Motion, p: Symbols, assembly: EquationBuilder, name: str) -> None:
        assembly.add_torque(name, -p["coefficient"] * motion.speed * Abs(motion.speed), motion)

    def guesses(self, motion: FittedMotion, at: str) -> Iterator[Guess]:
        speed = motion.speed[at.split(".")[1]]
        yield Guess(({at: -speed * abs(speed)},), if_positive("coefficient"))


# --- Dry friction that differs between recordings: warm and cold, with and without a seal, before and after a repair.

MOST_RECORDINGS = 24


class RecordingFriction(Kind):
    """torque[i]·sgn(speed) in the i-th recording that was fitted; their mean in any other motion."""

    kind = "recording_friction"
    words = "has dry friction that differs between the recordings"
    in_recording = "speeds stop dead, and the torque that is missing is another constant in every recording."
    tables = ("inertias",)
    arrays = ("torque",)
    parameters = {f"torque_{i}": Parameter("N*m", lower=0.0, optional=True) for i in range(1, MOST_RECORDINGS + 1)}
    state_dependent = True
    sticks = True
    by_recording = "torque"

    def inertia(self, motion: Motion, p: Symbols, assembly: EquationBuilder, name: str) -> None:
        torques = [p[f"torque_{i}"] for i in range(1, len(p) + 1)]
        mean = _share(assembly.recording) / len(torques)
        torque = Add(*((_share(assembly.recording - i) + mean) * t for i, t in enumerate(torques, 1)))
        assembly.add_torque(name, -torque * assembly.sign(motion.speed), motion)

    def fault(self, at: str, values: Mapping[str, float]) -> str:
        return "" if values else "needs a list torque, one for every recording"

    def guesses(self, motion: FittedMotion, at: str) -> Iterator[Guess]:
        count = int(motion.recording.max(initial=0))
        if not 1 < count <= MOST_RECORDINGS:
            return
        sign = smooth_sign(motion.speed[at.split(".")[1]])
        additions = tuple({at: np.where(motion.recording == i, -sign, 0.0)} for i in range(1, count + 1))
        yield Guess(additions, _torques)

    def simpler(
        self, at: str, parameters: Mapping[str, float], value: Mapping[str, float], system: Drivetrain
    ) -> Iterator[SimplerEffect]:
        yield SimplerEffect("coulomb_friction", at, {"torque": sum(parameters.values()) / len(parameters)})

    def recorded_bounds(self, key: str, at: str, recorded: RecordedRange) -> tuple[float, float]:
        largest = recorded.torque[at.split(".")[1]]
        return -largest, largest


def _share(difference: Expr) -> Expr:
    """1 where the difference is 0, and 0 where it is 1 or more."""
    return (1 - Abs(difference) + Abs(1 - Abs(difference))) / 2


def _torques(a: np.ndarray) -> dict[str, float] | None:
    """No friction where the guess drives; no such effect where it does so in every recording."""
    return {f"torque_{i}": max(float(x), 0.0) for i, x in enumerate(a, 1)} if a.max() > 0 else None


# --- Dry friction that falls, or grows, while the machine warms up.


class WarmingFriction(Kind):
    """torque·(1 + change·(1 − exp(−t/time_constant)))·sgn(speed), t from the start of the recording.

    In steady motion the change has happened; linear models at rest are without it.
    """

    kind = "warming_friction"
    words = "has dry friction of {torque} that changes by a factor of 1 + {change} within {time_constant}"
    in_recording = "the torque that is missing has the sign of the speed, and falls from beginning to end."
    tables = ("inertias",)
    parameters = {"torque": Parameter("N*m", lower=0.0)} | drifts.PARAMETERS
    state = drifts.STATE
    state_dependent = True
    sticks = True

    def inertia(self, motion: Motion, p: Symbols, assembly: EquationBuilder, name: str) -> None:
        now = p["torque"] * drifts.factor(p, assembly, f"{name}.{self.kind}")
        assembly.add_torque(name, -now * assembly.sign(motion.speed), motion)

    def state_after(self, seconds: float, parameters: Mapping[str, float]) -> float:
        return drifts.done_after(seconds, parameters["time_constant"])

    def guesses(self, motion: FittedMotion, at: str) -> Iterator[Guess]:
        sign, longest = smooth_sign(motion.speed[at.split(".")[1]]), float(motion.time.max(initial=0.0))
        for share in (1.0, 0.3) if longest > 0 else ():  # of the longest recording: nearly a straight line, and bent
            constant = share * longest
            happened = -np.expm1(-motion.time / constant)
            yield Guess(({at: -sign}, {at: -sign * happened}), partial(_warming, constant))

    def simpler(
        self, at: str, parameters: Mapping[str, float], value: Mapping[str, float], system: Drivetrain
    ) -> Iterator[SimplerEffect]:
        yield SimplerEffect("coulomb_friction", at, {"torque": parameters["torque"] * (1 + parameters["change"] / 2)})

    def fit_bounds(self, key: str, guess: float, step: float) -> tuple[float, float]:
        return drifts.drift_bounds(guess) if key == "time_constant" else super().fit_bounds(key, guess, step)

    def recorded_bounds(self, key: str, at: str, recorded: RecordedRange) -> tuple[float, float]:
        largest = recorded.torque[at.split(".")[1]]
        return (-largest, largest) if key == "torque" else super().recorded_bounds(key, at, recorded)


def _warming(time_constant: float, a: np.ndarray) -> dict[str, float] | None:
    """Parameters for the amplitudes of the friction at the start and of its change; some is left of it."""
    if a[0] <= 0:
        return None
    change = max(float(a[1] / a[0]), -drifts.MOST_FALL)
    return {"torque": float(a[0]), "change": change, "time_constant": time_constant}


# --- Tyre slip or another damper in series with a shaft.


class Slip(Kind):
    """A damper of ``coefficient`` (N·m·s/rad) in series: the spring relaxes (tyre slip, relaxation length)."""

    kind = "slip"
    slips = True
    words = "slips by a damper of {coefficient} in series"
    in_recording = (
        "under a constant torque the two ends turn at different speeds; oscillations through the shaft are damped."
    )
    tables = ("shafts",)
    parameters = {"coefficient": Parameter("N*m*s/rad", lower=1e-9)}
    state = State("rad", "deflection of the spring of {place}")
    linear = True

    def shaft(self, law: ShaftLaw, p: Symbols, assembly: EquationBuilder) -> None:
        law.put_in_series(p["coefficient"], f"{law.place}.{self.kind}")

    def guesses(self, motion: FittedMotion, at: str) -> Iterator[Guess]:
        stiffness, twist = motion.value[f"{at}.stiffness"], motion.twist[at.split(".")[1]]
        for relaxation in (0.02, 0.1, 0.5, 2.5, 12.5):  # s, coefficient over stiffness
            lost = motion.lagged(twist - twist[0], relaxation)
            yield Guess(({at: -stiffness * lost},), partial(_damper, stiffness * relaxation))


def _damper(coefficient: float, a: np.ndarray) -> dict[str, float] | None:
    """Parameters for the amplitude a (1,) of the lost twist: the more is lost, the weaker the damper."""
    return {"coefficient": coefficient / float(a[0])} if a[0] > 0.02 else None


# --- Dry friction that falls from breakaway to sliding (Stribeck).


class StribeckFriction(Kind):
    """sgn(speed)·(torque + (breakaway − torque)·exp(−(speed/``speed``)²))."""

    kind = "stribeck_friction"
    words = "has dry friction of {torque} that is {breakaway} from rest and falls off over {speed}"
    in_recording = "the drive breaks away with a jerk and may creep by stick and slip at low speed."
    tables = ("inertias",)
    parameters = {
        "torque": Parameter("N*m", lower=0.0),
        "breakaway": Parameter("N*m", lower=0.0),
        "speed": Parameter("rad/s", lower=1e-6),
    }
    state_dependent = True
    sticks = True

    def inertia(self, motion: Motion, p: Symbols, assembly: EquationBuilder, name: str) -> None:
        sliding = p["torque"] + (p["breakaway"] - p["torque"]) * exp(-((motion.speed / p["speed"]) ** 2))
        assembly.add_torque(name, -assembly.sign(motion.speed) * sliding, motion)

    def simpler(
        self, at: str, parameters: Mapping[str, float], value: Mapping[str, float], system: Drivetrain
    ) -> Iterator[SimplerEffect]:
        """Coulomb friction, where the torque hardly falls or the speed is seldom in the range over which it does."""
        yield SimplerEffect("coulomb_friction", at, {"torque": parameters["torque"]})

    def guesses(self, motion: FittedMotion, at: str) -> Iterator[Guess]:
        speed = motion.speed[at.split(".")[1]]
        sign = smooth_sign(speed)
        for share in (0.05, 0.15, 0.4):  # of the standard deviation of the speed
            scale = share * float(speed.std()) + 1e-9
            yield Guess(
                ({at: -sign}, {at: -sign * np.exp(-((speed / scale) ** 2))}),
                partial(_friction, scale),
            )

    def recorded_bounds(self, key: str, at: str, recorded: RecordedRange) -> tuple[float, float]:
        largest = recorded.torque[at.split(".")[1]]
        return (-largest, largest) if key != "speed" else super().recorded_bounds(key, at, recorded)

    def possible(self, parameters: Mapping[str, float]) -> bool:
        return parameters["breakaway"] >= parameters["torque"]


def _friction(speed: float, a: np.ndarray) -> dict[str, float] | None:
    """Sliding and breakaway torque from the amplitudes of the constant and of the decaying part."""
    sliding, breakaway = float(a[0]), float(a[0] + a[1])
    return {"torque": max(sliding, 0.0), "breakaway": breakaway, "speed": speed} if breakaway > 0 else None


# --- Tyre slip

SHAPE = Rational(165, 100)  # of a tyre along the road, where the file states none


class TyreSlip(Kind):
    """A contact patch in series with the shaft, after the Magic Formula with a constant relaxation length.

    The shaft is the carcass; its second end turns as the tyre would without slip (body, road). In the patch

        T = peak·sin(shape·atan(slip_stiffness·κ/(shape·peak))),  κ = (twist rate − deflection rate)/|speed|,

    and the carcass deflects in proportion to κ: slip_stiffness·κ = stiffness·deflection + damping·deflection rate.
    ``slip_stiffness`` is the torque over slip at slip 0 and ``peak`` the largest torque; both are on the second end's
    side and go with the wheel load. Small slips at one speed are :class:`Slip` with the coefficient
    slip_stiffness/|speed|; at standstill nothing slips until the torque nears the peak.

    Source: Pacejka, Tire and Vehicle Dynamics, 3rd ed. 2012, sections 4.3 and 7.2 (single contact point, longitudinal).
    """

    kind = "tyre_slip"
    slips = True
    words = "slips on the road with {slip_stiffness} over slip, up to {peak}"
    in_recording = "the ends differ in speed in proportion to speed and torque; the torque has a largest value."
    tables = ("shafts",)
    parameters = {
        "slip_stiffness": Parameter("N*m", lower=1e-9),
        "peak": Parameter("N*m", lower=1e-9),
        "shape": Parameter("1", lower=1.0, upper=1.99, optional=True),
    }
    state = State("rad", "deflection of the spring of {place}")
    state_dependent = True
    sought = False  # a diagnosis looks for ``slip``, which is the same at one speed and small torque

    def shaft(self, law: ShaftLaw, p: Symbols, assembly: EquationBuilder) -> None:
        peak, shape = p["peak"], p.get("shape", SHAPE)
        law.put_in_series(p["slip_stiffness"] / Abs(law.second.speed), f"{law.place}.{self.kind}")

        def saturated(torque: Expr) -> Expr:
            return peak * sin(shape * atan(torque / (shape * peak)))

        def slope(torque: Expr) -> Expr:
            share = torque / (shape * peak)
            return cos(shape * atan(share)) / (Integer(1) + share**2)

        law.contact = saturated, slope
