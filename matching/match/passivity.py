"""The controlled bed as a specimen meets it at the cut: is it passive, and from which frequency on not.

What stands beyond the cut shafts, adapters, flanges, rotors and the dynamometers under control, answers the torques of
the cut shafts with speeds of their outer ends. Where the bed alone is stable and the real part of that admittance is
nowhere negative, the bed gives no energy: with any passive specimen it is stable (Colgate and Hogan 1988). Below the
first frequency at which that fails, no resonance of a specimen can be driven by the bed. The readings of sensors on the
specimen count as held: what another specimen would show there is not known.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.linalg import block_diag

from matching.match.case import Case
from matching.match.damping import stable_loops
from matching.match.loop import Bed, SampledController, closed_poles, frequency_response, side_by_side, with_hardware
from modelling.bed.bed import delayed_bed
from modelling.bed.vehicle import cut
from modelling.errors import InputError
from modelling.linear.resolvent import resolvent
from modelling.linear.state_space import state_space


@dataclass(frozen=True)
class PassivitySettings:
    """Numbers of the look at passivity.

    Attributes
    ----------
    points : int
        Frequencies, evenly on a logarithmic scale: fifty a decade and more, since a mode of the vehicle that is damped
        by 1 % is 2 % wide.
    decades : float
        Below the lower edge of the band, from where they are looked at.
    rounding : float
        Relative to the size of the admittance, below which a negative real part is rounding.
    """

    points: int = 600
    decades: float = 1.0
    rounding: float = 1e-6


PASSIVITY = PassivitySettings()


@dataclass(frozen=True)
class Passivity:
    """Of the bed as planned under control, at the cut.

    Attributes
    ----------
    stable_alone : bool
        With the cut shafts free.
    passive_to : float or None
        Hz, up to which the bed gives no energy; None where it is passive up to half the sampling frequency.
    worst : float
        Least real part over the size of the admittance, −1 to 1, and where.
    worst_at : float
        Hz.
    looked_at : (float, float)
        Hz, between which it was looked at.
    """

    stable_alone: bool
    passive_to: float | None
    worst: float
    worst_at: float
    looked_at: tuple[float, float]

    @property
    def any_specimen(self) -> bool:
        """Whether the bed is stable with any passive specimen."""
        return self.stable_alone and self.passive_to is None

    def words(self) -> str:
        """The figure in one sentence."""
        if not self.stable_alone:
            return "not stable with the cut shafts free"
        if self.passive_to is None:
            return "stable with any passive specimen"
        return f"passive up to {self.passive_to:.3g} Hz; with a specimen that has modes above, judge it as a case"

    def to_dict(self) -> dict[str, Any]:
        """As ``result.json`` holds it."""
        return {**vars(self), "looked_at": list(self.looked_at), "any_specimen": self.any_specimen}


def passivity_of(case: Case, controller: SampledController) -> Passivity | None:
    """Whether the controlled bed as planned is passive; None where the bed cannot be cut from its specimen."""
    if case.loop.torqueless:
        return None
    try:
        bed, speeds, torques = _beyond(case)
    except InputError:  # rig and vehicle share what lies beyond the cut, or a specimen's shaft bridges it
        return None
    top = 0.499 / case.loop["sample_time"]
    frequencies = np.geomspace(min(case.band[0], top) / 10**PASSIVITY.decades, top, PASSIVITY.points)
    admittance = _admittance(bed, speeds, torques, controller, frequencies, case.loop["sample_time"])
    real = (admittance + np.swapaxes(admittance.conj(), 1, 2)) / 2
    size = np.linalg.norm(admittance, 2, axis=(1, 2))
    least = np.linalg.eigvalsh(real)[:, 0] / np.maximum(size, 1e-300)
    active = np.flatnonzero(least < -PASSIVITY.rounding)
    alone = closed_poles(side_by_side([bed]), controller)
    # rotors that coast as one with the vehicle are no instability: they are what a free vehicle does
    resting = int((np.abs(alone - 1) < 1e-6).sum())
    first = None if not len(active) else float(frequencies[active[0]])
    worst = int(least.argmin())
    return Passivity(
        bool(stable_loops(alone, resting).all()), first, float(least[worst]), float(frequencies[worst]),
        (float(frequencies[0]), float(frequencies[-1])),
    )  # fmt: skip


def _beyond(case: Case) -> tuple[Bed, np.ndarray, np.ndarray]:
    """The bed without its specimen, rows that read the speeds at the cut (k, x), and its torques there (x, k)."""
    parts, loop = cut(case.rig, case.vehicle), case.loop
    spaces = [state_space(part) for part in parts.parts]
    ends = {interface.shaft: interface for interface in parts.interfaces}
    cuts = [ends[dynamometer.follows] for dynamometer in loop.dynamometers]
    k, n = len(cuts), sum(len(space.A) for space in spaces)
    begins = np.cumsum([0, *(len(space.A) for space in spaces)])

    def placed(name: str, names: str, vector: str) -> np.ndarray:
        """A vector of a part (x,) at the part's place among all states (n,); zeros where no part has that name."""
        made = np.zeros(n)
        for begin, space in zip(begins, spaces, strict=False):
            if name in getattr(space, names):
                made[begin : begin + len(space.A)] = getattr(space, vector)(name)
        return made

    def row(name: str) -> np.ndarray:
        """What a sensor reads (n,); nothing where it stands on the specimen."""
        return placed(name, "outputs", "output")

    def column(name: str) -> np.ndarray:
        """What an input does (n,)."""
        return placed(name, "inputs", "input")

    A, commands, readings = (
        part[0] for part in with_hardware(loop, block_diag(*(space.A for space in spaces))[None], column, row, [{}])
    )
    at_cut, speeds = np.zeros((len(A), k)), np.zeros((k, len(A)))
    for j, interface in enumerate(cuts):
        at_cut[:n, j], speeds[j, :n] = column(interface.torque), row(interface.speed)
    delay, nothing = loop.command_delays(None), np.zeros(0, complex)
    sampled = delayed_bed(A, commands, at_cut, delay, loop["sample_time"])
    bed = Bed(A, commands, at_cut, readings, speeds, np.zeros((k, k)), delay, sampled, nothing, 1.0)
    return bed, speeds, at_cut


def _admittance(
    bed: Bed, speeds: np.ndarray, torques: np.ndarray, controller: SampledController, frequencies: np.ndarray,
    step: float,
) -> np.ndarray:  # fmt: skip
    """Speeds for torques (f, k, k): of a torque at a frequency, the part of the speed at that frequency."""
    k, s = speeds.shape[0], 2j * np.pi * frequencies
    z, sampled = np.exp(s * step), side_by_side([bed])
    held = sampled.C[0] @ resolvent(sampled.A[0]).columns(z, sampled.B[0])
    states = resolvent(bed.A).columns(s, np.hstack([torques, bed.commands]))
    late = ((1 - np.exp(-s * step)) / (s * step))[:, None] * np.exp(-s[:, None] * bed.delay)
    acting = frequency_response(controller, frequencies).of_readings
    given = np.linalg.solve(np.eye(k) - acting @ held, acting @ (bed.readings @ states[:, :, :k]))
    answered: np.ndarray = speeds @ states[:, :, :k] + (speeds @ states[:, :, k:]) * late[:, None, :] @ given
    return answered
