"""Input torques: sweeps on top of steps for recordings; tones, tip-ins and back-outs for hold-outs."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.signal import chirp, lfilter

from plant.systems import Drive

BEFORE = 1.5  # s of motion before a recording that starts in motion


@dataclass
class Excitation:
    """Torques (t, u) or feed-forwards, the controllers' settings by input, and the recording's first sample."""

    inputs: np.ndarray
    begin: int
    controllers: dict[str, tuple[float, float]]  # input -> proportional N·m·s/rad, integral N·m/rad
    reference: np.ndarray
    feedback_noise: np.ndarray
    start_speed: float


def _limited(signal: np.ndarray, slope: float, dt: float) -> np.ndarray:
    """A torque command through the inverter: no jump, a first-order rise."""
    a = np.exp(-dt / slope)
    return lfilter([1 - a], [1, -a], signal - signal[0]) + signal[0]


def _steps(rng: np.random.Generator, time: np.ndarray, shortest: float, longest: float) -> np.ndarray:
    """Levels in −1…1 that change sign; mostly their mean is taken off, so that the speed comes back through zero."""
    level, side, now = np.zeros_like(time), rng.choice([-1.0, 1.0]), time[0]
    turning, balanced = rng.uniform(0.3, 0.8), rng.uniform(0.7, 1.0) if rng.random() < 0.75 else 0.0
    while now < time[-1]:
        after = now + rng.uniform(shortest, longest)
        level[(time >= now) & (time < after)] = side * rng.uniform(0.25, 1.0)
        now, side = after, side * (-1.0 if rng.random() < turning else 1.0)
    return level - balanced * level.mean()


def _sweeps(rng: np.random.Generator, time: np.ndarray, highest: float) -> np.ndarray:
    length = rng.uniform(0.4, 0.55) * (time[-1] - time[0])
    phase = np.mod(time - time[0], length)
    low = rng.uniform(0.4, 1.2)
    return chirp(phase, low, length, rng.uniform(0.8, 1.0) * highest, method="linear", phi=rng.uniform(0, 360))


def _tones(rng: np.random.Generator, time: np.ndarray, highest: float) -> np.ndarray:
    tones = np.exp(rng.uniform(np.log(0.6), np.log(highest), 12))
    return sum(np.sin(2 * np.pi * f * time + rng.uniform(0, 2 * np.pi)) for f in tones) / np.sqrt(12)


def excite(
    drive: Drive,
    rng: np.random.Generator,
    duration: float,
    dt: float,
    *,
    holdout: bool,
    closed_loop: bool,
    moving: bool,
    speed_noise: float,
) -> Excitation:
    """Draw a manoeuvre. `speed_noise` in rad/s is what a speed controller's own encoder adds."""
    begin = round(BEFORE / dt) if moving else 0
    time = np.arange(begin + round(duration / dt)) * dt
    columns = []
    for amplitude in drive.torque.values():
        steps = _steps(rng, time, *((0.6, 2.5) if holdout else (1.0, 4.5)))
        fast = _tones(rng, time, 40.0) if holdout else _sweeps(rng, time, 60.0)
        columns.append(amplitude * _limited(steps + rng.uniform(0.25, 0.45) * fast, rng.uniform(0.004, 0.015), dt))
    inputs = np.stack(columns, axis=1)
    turns = {name: drive.speed_ratio(name) for name in drive.inertias}
    total = sum(drive.values[f"inertias.{name}.J"] * turns[name] ** 2 for name in drive.inertias)
    pull = inputs @ np.array([turns[on] for on in drive.inputs.values()])
    free = np.cumsum(pull) * dt / total  # speed of the whole as one inertia
    start_speed = -float(free.mean()) if moving else 0.0
    controllers, reference = {}, np.zeros_like(inputs)
    if closed_loop:
        driven = list(drive.inputs)[1:] or list(drive.inputs)
        gain = total * 2 * np.pi * rng.uniform(0.3, 1.0) / len(driven)
        integral = rng.uniform(0.5, 2.0)
        profile = np.cumsum(_steps(rng, time, 1.0, 3.0)) * dt
        profile *= max(free.std(), 1e-3) / max(profile.std(), 1e-9)
        profile += start_speed - profile[0]
        for name in driven:
            turn, j = turns[drive.inputs[name]], list(drive.inputs).index(name)
            controllers[name] = (gain / turn**2, gain * integral / turn**2)
            reference[:, j] = profile * turn
            inputs[:, j] *= 0.5 if len(drive.inputs) > 1 else 0.8
    noise = speed_noise * rng.standard_normal(inputs.shape) if closed_loop else np.zeros_like(inputs)
    return Excitation(inputs, begin, controllers, reference, noise, start_speed)
