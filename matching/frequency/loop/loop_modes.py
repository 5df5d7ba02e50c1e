"""Damped modes of the closed loop, with what rig and emulated vehicle hold of them."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np

from matching.frequency.loop.linear_body import Body, body
from matching.frequency.loop.pade import good_up_to
from matching.frequency.loop.parts import Parts
from matching.frequency.loop.poles import ORDERS, TRUSTED, closed_matrix
from modelling.bed.feed_forward import FeedForward
from modelling.bed.residual_vehicle import ResidualVehicle
from modelling.modal.result import Mode
from modelling.modal.symmetry import labels

EMULATED = "residual_vehicle."


@dataclass(frozen=True)
class LoopMode:
    """A damped mode of the closed loop.

    Attributes
    ----------
    frequency, damping_ratio : float
        |λ|/2π in Hz and −Re λ/|λ|; a rigid motion stands at 0.0 with damping ratio 0.
    belongs_to : str
        ``feed_forward``: a mode of the model-based feed-forward, which measured torques excite; ``feedback``: of the
        feedback loop, which all other torques excite.
    symmetry : str
    kinetic, potential : dict
        Energy shares of the rig (``inertias.NAME``) and the emulated vehicle (``residual_vehicle.inertias.NAME``); each
        adds up to 1.
    shape : dict
        Complex amplitudes of the rig's inertias, under the vehicle's names where they stand for its own: shared ones,
        and the rig's end of a cut for the inertia behind the cut.
    eigenvalue : complex
        rad/s.
    """

    number: int
    frequency: float
    damping_ratio: float
    belongs_to: str
    symmetry: str
    kinetic: dict[str, float]
    potential: dict[str, float]
    eigenvalue: complex
    shape: dict[str, complex] = field(repr=False, default_factory=dict)

    def to_dict(self) -> dict[str, Any]:
        """As ``result.json`` holds it."""
        keys = ("number", "frequency", "damping_ratio", "symmetry", "belongs_to", "kinetic", "potential")
        return {key: getattr(self, key) for key in keys}


def feedback_modes(parts: Parts, order: int = ORDERS[-1]) -> tuple[LoopMode, ...]:
    """Modes of the feedback loop, up to where the Padé approximation of that order can be believed.

    Without torque from the dynamometers they are the rig's own: the residual vehicle turns along, but nothing feels it.
    """
    if parts.case.loop.torqueless:
        return tuple(_listed(parts, (), *np.linalg.eig(parts.bed.A), 0, np.inf, "feedback"))
    eigenvalues, vectors = np.linalg.eig(closed_matrix(parts, order))
    limit = good_up_to(parts.case.loop["dead_time"], order, TRUSTED)
    start = len(parts.bed.A)
    return tuple(_listed(parts, parts.residual, eigenvalues, vectors, start, limit, "feedback"))


def feed_forward_modes(
    parts: Parts, feed_forward: FeedForward, reference: ResidualVehicle, belongs_to: str = "feed_forward"
) -> tuple[LoopMode, ...]:
    """Modes of the feed-forward's model, which follows ``reference``, up to 0.45 of its sampling frequency."""
    z, vectors = np.linalg.eig(feed_forward.A - feed_forward.B @ feed_forward.F)
    alive = np.abs(z) > 1e-6
    eigenvalues = np.log(z[alive].astype(complex)) / feed_forward.sample_time
    residual = tuple(body(part) for part in reference.parts)
    start = len(parts.bed.A)
    limit = 0.45 / feed_forward.sample_time
    return tuple(_listed(parts, residual, eigenvalues, vectors[:, alive], start, limit, belongs_to))


# more than six parameters: eigenpairs, and what they are read with
def _listed(
    parts: Parts,
    residual: Sequence[Body],
    eigenvalues: np.ndarray,
    vectors: np.ndarray,
    start: int,
    limit: float,
    belongs_to: str,
) -> Iterable[LoopMode]:
    rig = parts.rig
    rows = [(rig, slice(0, len(rig.space.A)), "")]
    for part in residual:
        rows.append((part, slice(start, start + len(part.space.A)), EMULATED))
        start += len(part.space.A)
    oscillating = (eigenvalues.imag > 1e-9) & (np.abs(eigenvalues) < 2 * np.pi * limit)
    chosen = np.flatnonzero(oscillating | _rigid(parts, residual, eigenvalues, vectors, rows))
    chosen = chosen[np.lexsort((np.abs(eigenvalues[chosen]), eigenvalues[chosen].imag > 0))]
    names = _names_in_vehicle(parts)
    for number, i in enumerate(chosen, 1):
        kinetic, potential = _energies(rows, vectors[:, i])
        turns = rig.turns @ vectors[rows[0][1], i]
        turns = turns / max(turns, key=abs, default=1.0)
        value, rigid = complex(eigenvalues[i]), eigenvalues[i].imag <= 1e-9
        yield LoopMode(
            number,
            0.0 if rigid else abs(value) / (2 * np.pi),
            0.0 if rigid else -value.real / abs(value),
            belongs_to,
            str(labels(turns[:, None], rig.J, rig.image)[0]),
            kinetic,
            {} if rigid else potential,
            value,
            dict(zip((names.get(name, name) for name in rig.masses), turns.tolist(), strict=True)),
        )


def _energies(rows: list[tuple[Body, slice, str]], vector: np.ndarray) -> tuple[dict[str, float], dict[str, float]]:
    kinetic: dict[str, float] = {}
    potential: dict[str, float] = {}
    for side, place, prefix in rows:
        speeds, twists = side.turns @ vector[place], side.twists @ vector[place]
        kinetic |= {prefix + name: float(e) for name, e in zip(side.masses, side.J * np.abs(speeds) ** 2, strict=True)}
        potential |= {
            prefix + name: float(e) for name, e in zip(side.springs, side.stiffness * np.abs(twists) ** 2, strict=True)
        }
    return _shares(kinetic), _shares(potential)


def _shares(energy: dict[str, float]) -> dict[str, float]:
    total = sum(energy.values()) or 1.0
    return {name: value / total for name, value in energy.items()}


def _rigid(
    parts: Parts,
    residual: Sequence[Body],
    eigenvalues: np.ndarray,
    vectors: np.ndarray,
    rows: list[tuple[Body, slice, str]],
) -> np.ndarray:
    """Which eigenvalues (m,) are rig and vehicle coasting as one: real, nothing twists, each rotor turns as its cut."""
    rigid = np.zeros(len(eigenvalues), bool)
    for i in np.flatnonzero(np.abs(eigenvalues.imag) <= 1e-9):
        vector = vectors[:, i]
        moving = sum(float(side.J @ np.abs(side.turns @ vector[place]) ** 2) for side, place, _ in rows)
        twisted = sum(float(side.stiffness @ np.abs(side.twists @ vector[place]) ** 2) for side, place, _ in rows)
        slip, speed = 0.0, 1.0 if not residual else 0.0
        for dyno, cut in zip(parts.dynamometers, parts.cuts, strict=True) if residual else ():
            rotor = parts.rig.space.output(dyno.speed_sensor) @ vector[rows[0][1]]
            wanted = sum(
                side.space.output(cut.speed) @ vector[place]
                for side, place, _ in rows[1:]
                if cut.speed in side.space.outputs
            )
            slip, speed = slip + abs(rotor - wanted) ** 2, speed + abs(rotor) ** 2
        rigid[i] = twisted < 1e-2 * moving and slip < 1e-2 * speed
    return rigid


def _names_in_vehicle(parts: Parts) -> dict[str, str]:
    return {f"inertias.{cut.rig_end}": f"inertias.{cut.vehicle_end}" for cut in parts.cuts}


def match_mode(
    vehicle_mode: Mode, modes: Sequence[LoopMode], inertia: Mapping[str, float] | None = None
) -> tuple[LoopMode, float] | None:
    """The mode of the closed loop that a vehicle mode became, with its MAC 0 … 1.

    The MAC is the modal assurance criterion over the drive side and the ends of the cuts, each coordinate weighted
    by its ``inertia`` (kg·m² by ``inertias.NAME``, 1 unless given). Among the modes that look alike (0.5 or more), the
    one with the nearest eigenvalue on a logarithmic scale and most alike is taken: MAC·exp(−|ln s/s₀|), so that
    of two that move the drive side alike the damping decides, too. None if no mode looks alike, a rigid one, or an
    overdamped motion.
    """
    best: tuple[float, LoopMode, float] | None = None
    for mode in modes:
        if mode.frequency <= 0 or vehicle_mode.frequency <= 0:
            continue
        mac = _mac(vehicle_mode, mode, inertia or {})
        score = mac * float(np.exp(-abs(np.log(eigenvalue_of(mode) / eigenvalue_of(vehicle_mode)))))
        if mac >= 0.5 and (best is None or score > best[0]):
            best = score, mode, mac
    return None if best is None else (best[1], best[2])


class SwingingMotion(Protocol):
    """What has a frequency in Hz and a damping ratio."""

    @property
    def frequency(self) -> float:
        """Hz."""

    @property
    def damping_ratio(self) -> float:
        """−Re s/|s|."""


def eigenvalue_of(mode: SwingingMotion) -> complex:
    """2π·f·(−ζ + j·√(1 − ζ²)), 1/s."""
    damping = float(np.clip(mode.damping_ratio, -1, 1))
    return 2 * np.pi * mode.frequency * complex(-damping, np.sqrt(1 - damping**2))


def _mac(vehicle_mode: Mode, mode: LoopMode, inertia: Mapping[str, float]) -> float:
    names = [name for name in vehicle_mode.shape if name in mode.shape]
    weight = np.sqrt([inertia.get(name, 1.0) for name in names])
    first = weight * np.array([vehicle_mode.shape[name] for name in names])
    second = weight * np.array([mode.shape[name] for name in names])
    return float(
        abs(np.vdot(first, second)) ** 2 / max(np.vdot(first, first).real * np.vdot(second, second).real, 1e-300)
    )
