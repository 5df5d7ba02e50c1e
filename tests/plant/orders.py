"""The list of cases that judges a diagnosis on what it was not tuned on: effects of several sizes, alone and together,
models that are wrong in a way that no kind explains, perfect models at several sampling rates."""

from __future__ import annotations

import itertools
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.signal import lfilter

from plant.bench import record
from plant.case import Case, in_reach, make_case
from plant.hidden import INSIDE, KINDS, OUTSIDE
from plant.scene import set_scene
from plant.sensing import add_noise
from plant.systems import SYSTEMS
from plant.writing import model_text, recording_text

SIZES = {"subtle": (1.5, 6.0), "plain": (15.0, 60.0)}  # times the noise in the worst sensor
TOGETHER = 15.0  # the same, of each of several effects
STATED = (1 / 3, 3.0)  # times the noise, that a model file states wrongly
SLOW = 200.0  # Hz
WRONG = ("angle_stiffness", "parameter_jump", "saturating_actuator", "disturbance", "crosstalk")  # in no vocabulary
RATES, TORQUES = (100, 200, 500, 1000), ("smooth", "stepped", "noisy")
FINE = 4000.0  # Hz at which a perfect model is driven
HIGHEST_SHARE = 1 / 16  # of the sampling rate: highest frequency of a smooth torque, 12.5 Hz of 200
OTHERS = ("perfect", "outside", "two", "perfect", "wrong_noise", "outside", "perfect", "three", "slow", "two")


@dataclass(frozen=True)
class Order:
    """What to make: effects with or without a background that no kind explains, or a perfect model."""

    category: str  # plain | subtle | wrong_plain | wrong_subtle | wrong_clean | one of OTHERS
    system: str
    effects: tuple[str, ...]
    size: float
    seed: int
    background: tuple[str, ...] = ()
    rate: float = 1000.0
    torque: str = ""
    stated_noise: float = 1.0

    def make(self, duration: float = 8.0, *, rivals: bool = True) -> Case:
        """The case; raises OutOfReach where no system can carry the effects in that size."""
        if self.category == "perfect":
            return _perfect(self.system, self.seed, duration, round(self.rate), self.torque)
        case = in_reach(
            self.system,
            lambda system: make_case(
                system, self.effects, self.size, "normal", self.seed, duration, self.rate,
                closed_loop=self.seed % 3 == 0, moving=self.seed % 2 == 0, rivals=rivals, background=self.background,
                stated_noise=self.stated_noise,
            ),
        )  # fmt: skip
        case.answer["category"] = self.category
        return case


def orders(n: int, seed: int) -> list[Order]:
    """n orders in random order: a third with one effect, a third on wrong models, a third of :data:`OTHERS` in turn."""
    rng = np.random.default_rng([14, seed])
    kinds, wrong = itertools.cycle(rng.permutation(INSIDE)), itertools.cycle(rng.permutation(WRONG))
    outside, perfect = itertools.cycle(rng.permutation(OUTSIDE)), itertools.cycle(itertools.product(RATES, TORQUES))
    out = []
    for k in range(n):
        system, own = str(rng.choice(list(SYSTEMS))), int(rng.integers(2**31))
        size = ("plain", "subtle")[k // 9 % 2]
        worth = float(rng.choice(SIZES[size]))
        if k % 3 == 0:
            out.append(Order(size, system, (str(next(kinds)),), worth, own))
        elif k % 3 == 1:
            background = (str(next(wrong)),)
            if k // 3 % 4 == 3:
                out.append(Order("wrong_clean", system, (), 0.0, own, background))
            else:
                out.append(Order(f"wrong_{size}", system, (str(next(kinds)),), worth, own, background))
        else:
            category = OTHERS[k // 3 % len(OTHERS)]
            if category == "perfect":
                rate, torque = next(perfect)
                out.append(Order(category, system, (), 0.0, own, (), rate, torque))
            elif category == "outside":
                out.append(Order(category, system, (str(next(outside)),), worth, own))
            elif category in ("two", "three"):
                effects = _of_different_groups(rng)[: 2 if category == "two" else 3]
                out.append(Order(category, system, effects, TOGETHER, own))
            elif category == "slow":
                out.append(Order(category, system, (str(next(kinds)),), SIZES["plain"][0], own, rate=SLOW))
            else:
                stated = float(rng.choice(STATED))
                out.append(Order(category, system, (str(next(kinds)),), SIZES["plain"][0], own, stated_noise=stated))
    return [out[i] for i in rng.permutation(n)]


def _of_different_groups(rng: np.random.Generator) -> tuple[str, ...]:
    groups: dict[str, str] = {}
    for kind in rng.permutation(INSIDE):
        groups.setdefault(KINDS[str(kind)].group, str(kind))
    return tuple(groups.values())


def _perfect(system: str, seed: int, duration: float, rate: int, torque: str) -> Case:
    """A recording of the very model. A smooth torque is smooth between the samples too; a stepped one is held by an
    inverter, and a noisy one follows a noisy set point: both are straight between samples."""
    scene = set_scene(system, "normal", seed, duration, 1000.0, False, False)
    rng, every = np.random.default_rng([15, seed]), round(FINE / rate)
    fine = np.arange(round(duration * FINE)) / FINE
    coarse = fine[::every]
    columns = []
    for amplitude in scene.drive.torque.values():
        steps = np.sign(np.sin(2 * np.pi * rng.uniform(0.2, 0.4) * coarse + rng.uniform(0, 6)))
        if torque == "smooth":
            tones = np.exp(rng.uniform(np.log(0.3), np.log(HIGHEST_SHARE * min(rate, 800)), 8))
            signal = sum(np.sin(2 * np.pi * f * fine + rng.uniform(0, 6)) for f in tones) / 2
            columns.append(amplitude * signal)
            continue
        if torque == "noisy":
            steps = lfilter([0.5], [1, -0.5], steps + rng.standard_normal(len(steps)))
        columns.append(amplitude * np.interp(fine, coarse, steps))
    inputs = np.stack(columns, axis=1)
    excitation = replace(
        scene.excitation, inputs=inputs, begin=0, controllers={}, reference=np.zeros_like(inputs),
        feedback_noise=np.zeros_like(inputs), start_speed=0.0,
    )  # fmt: skip
    take = record(scene.drive, [], excitation, 1 / FINE)
    readings = {name: value[::every] for name, value in take.readings.items()}
    noise = {name: 0.001 * float(np.ptp(value)) for name, value in readings.items()}
    kept = replace(take, time=take.time[::every], inputs=take.inputs[::every])
    text = recording_text(scene.drive, kept, add_noise(readings, noise, [], rng))
    answer: dict[str, Any] = {
        "kind": "none", "at": "", "parameters": {}, "causes": [], "differs": False, "outside": False,
        "verdict": "adequate", "base": scene.drive.values, "system": system, "seed": seed, "category": "perfect",
        "rate": rate, "torque": torque, "background": [], "closed_loop": False,
    }  # fmt: skip
    return Case(model_text(scene.drive, scene.written, noise, set()), text, "", answer)
