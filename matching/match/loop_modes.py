"""Modes of the closed loop as it is sampled, and what rig and residual vehicle hold of them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Protocol

import numpy as np

from matching.match.loop import (
    Body,
    LinearBed,
    SampledController,
    body,
    closed_matrices,
    controller_on,
    side_by_side,
)
from modelling.bed.vehicle import cut
from modelling.linear.state_space import linear_motion
from modelling.modal.modes import labels
from modelling.modal.pairing import closeness, pairs, weighted_mac
from modelling.modal.result import Mode
from modelling.system import System

# --- What the residual vehicle of a bed reads while the bed runs: the vehicle's own sensors on the emulated side.
#
# The residual vehicle turns on the torque that the bed measures at each flange, lag included, and on the road torques
# of the manoeuvre. In the structure ``pi`` that is the model in the loop, as tuned. A model-based feed-forward keeps
# the vehicle's own values, so there, and on the rig without control whose residual vehicle has no effect, it is the one
# cut out of the vehicle. Its sensors are compared with the vehicle's for R_RVM (Eq. 21).

PLACE = "residual_vehicle."


def emulated(
    parts: LinearBed, traces: Mapping[str, np.ndarray], torques: Mapping[str, np.ndarray], *, tuned: bool
) -> dict[str, np.ndarray]:
    """Readings (t,) of the residual vehicle by ``residual_vehicle.SENSOR``, SI.

    Parameters
    ----------
    traces : mapping
        Of a rig from rest at the loop's sample time, by name; the torques of the flanges are used, without a
        flange that of the cut shaft.
    torques : mapping
        Of the manoeuvre by input (t,), linear between samples; those that act inside the residual vehicle are used.
    tuned : bool
        Whether it has its tuned values or those of the vehicle.
    """
    loop = parts.case.loop
    bodies = (
        parts.residual
        if tuned
        else tuple(body(part) for part in cut(parts.case.emulated_vehicle, parts.case.rig).parts)
    )
    count = len(next(iter(traces.values())))
    step, rates = loop["sample_time"], 1 / loop.lags("torque_sensor_lag")
    read = [traces[dyno.torque_sensor or f"shafts.{dyno.follows}.torque"] for dyno in parts.dynamometers]
    measured = {
        cut.torque: sign * linear_motion(np.array([[-rate]]), np.array([[rate]]), torque[:, None], step)[:, 0]
        for torque, cut, sign, rate in zip(read, parts.cuts, parts.torque_signs, rates, strict=True)
    }
    outputs: dict[str, np.ndarray] = {}
    for part in bodies:
        space, nothing = part.space, np.zeros(count)
        drive = np.stack([measured.get(name, torques.get(name, nothing)) for name in space.inputs], axis=1)
        y = linear_motion(space.A, space.B, drive, step) @ space.C.T + drive @ space.D.T
        outputs |= {PLACE + name: y[:, i] for i, name in enumerate(space.outputs)}
    return outputs


def on_emulated_side(vehicle: System, parts: LinearBed) -> tuple[str, ...]:
    """Sensors of the vehicle that the residual vehicle has too, less those right at the cuts, which the rotors show."""
    ends = {cut.vehicle_end for cut in parts.cuts}
    there = {sensor.name for part in parts.residual for sensor in part.system.sensors if sensor.of not in ends}
    return tuple(sensor.name for sensor in vehicle.sensors if sensor.name in there)


# --- Loop modes


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


HIGHEST_SHARE = 0.45  # of the sampling frequency, up to which modes are listed
SHORTEST_MEMORY = 1e-3  # of z: what decays faster from sample to sample is no mode
RESTING_BELOW = 1e-6  # rad/s, the same in continuous time


@dataclass(frozen=True)
class ClosedLoop:
    """The closed loop of the bed as planned with its controller, from sample to sample.

    Attributes
    ----------
    matrix : ndarray (x + o, x + o)
        States [bed with delayed commands, states of the controller that readings reach].
    driven : ndarray (x + o, m)
        What the states of the controller do that run on known torques alone.
    """

    bed: LinearBed
    controller: SampledController
    matrix: np.ndarray
    driven: np.ndarray

    @classmethod
    def of(cls, bed: LinearBed, controller: SampledController) -> ClosedLoop:
        """Close the loop round a bed."""
        sampled, o = side_by_side([bed.bed]), controller.reached
        driven = np.vstack([sampled.B[0] @ controller.C[:, o:], controller.A[:o, o:]])
        return cls(bed, controller, closed_matrices(sampled, controller)[0], driven)

    @property
    def poles(self) -> np.ndarray:
        """Poles z of the feedback loop."""
        return np.linalg.eigvals(self.matrix)

    @property
    def own_poles(self) -> np.ndarray:
        """Poles z of what runs on known torques alone: no bed moves them."""
        return np.linalg.eigvals(self.controller.own_matrix)

    def modes(self) -> tuple[LoopMode, ...]:
        """Modes: first those that known torques alone excite, then those of the feedback loop."""
        if self.bed.case.loop.torqueless:
            values, vectors = np.linalg.eig(self.bed.bed.A)
            return tuple(_listed(self.bed, values, vectors, np.zeros((0, len(values))), "feedback"))
        z, states = np.linalg.eig(self.matrix)
        own, outside = np.linalg.eig(self.controller.own_matrix)
        driven = (
            np.stack([_driven(self.matrix, value, self.driven @ v) for value, v in zip(own, outside.T)], axis=1)
            if len(own)
            else np.zeros((len(states), 0))
        )
        listed = []
        for values, inside, further, belongs_to in (
            (own, driven, outside, "feed_forward"),
            (z, states, np.zeros((len(own), len(z))), "feedback"),
        ):
            alive = np.abs(values) > SHORTEST_MEMORY
            kept, inside = values[alive].astype(complex), inside[:, alive]
            rig = inside[: len(self.bed.bed.A)]
            s = self._unfolded(np.log(kept) / self.controller.sample_time, rig)
            emulated = self._emulated(inside, further[:, alive])
            listed += _listed(self.bed, s, rig, emulated, belongs_to)
        return tuple(_numbered(listed))

    def _emulated(self, inside: np.ndarray, outside: np.ndarray) -> np.ndarray:
        """States (r, m) of the residual vehicle in eigenvectors of loop and of what runs on known torques alone."""
        if self.controller.emulated is None:
            return np.zeros((0, inside.shape[1]))
        of_states, of_readings = self.controller.emulated
        bed, x = self.bed.bed, len(self.matrix) - self.controller.reached
        readings = bed.readings[: len(self.controller.sensors)] @ inside[: len(bed.A)]
        states: np.ndarray = of_states @ np.vstack([inside[x:], outside]) + of_readings @ readings
        return states

    def _unfolded(self, s: np.ndarray, states: np.ndarray) -> np.ndarray:
        """Poles (m,), 1/s, of modes above half the sampling frequency as they are, not as the samples show them.

        The bed's own motion in a mode tells which it is: its rate of change over its size, weighted by energy.
        """
        rig, n = self.bed.rig, len(self.bed.rig.space.A)
        energy = np.vstack([np.sqrt(rig.J)[:, None] * rig.turns, np.sqrt(rig.stiffness)[:, None] * rig.twists])
        size, rate = energy @ states[:n], energy @ (self.bed.bed.A[:n] @ states)
        squares = (np.abs(size) ** 2).sum(axis=0)
        of_rig = (size.conj() * rate).sum(axis=0) / np.maximum(squares, 1e-300)
        around = 2 * np.pi / self.controller.sample_time
        turns = np.where(squares > 0, np.round((of_rig - s).imag / around), 0.0)
        return s + 1j * around * turns


def _driven(matrix: np.ndarray, value: complex, drive: np.ndarray) -> np.ndarray:
    """States of the loop that a mode of what runs on known torques alone drives; next to a pole of the loop, least."""
    shifted = value * np.eye(len(matrix)) - matrix
    try:
        states: np.ndarray = np.linalg.solve(shifted, drive)
    except np.linalg.LinAlgError:
        states = np.linalg.lstsq(shifted, drive, rcond=None)[0]
    return states


def modes_of(bed: LinearBed) -> tuple[LoopMode, ...]:
    """Modes of the closed loop of a case."""
    return ClosedLoop.of(bed, controller_on(bed)).modes()


def neutral_motions(bed: LinearBed) -> int:
    """Rigid motions of the residual vehicle that nothing slows: poles at 0 that the vehicle has as well."""
    return sum(int(np.sum(np.abs(np.linalg.eigvals(part.space.A)) < RESTING_BELOW)) for part in bed.residual)


def _listed(
    bed: LinearBed, eigenvalues: np.ndarray, states: np.ndarray, emulated: np.ndarray, belongs_to: str
) -> list[LoopMode]:  # fmt: skip
    """Modes with eigenvalues (m,), 1/s, states (x, m) of the bed and (r, m) of the residual vehicle."""
    rig, highest = bed.rig, 2 * np.pi * HIGHEST_SHARE / bed.case.loop["sample_time"]
    highest = np.inf if bed.case.loop.torqueless else highest
    vectors = np.vstack([states[: len(rig.space.A)], emulated])
    rows, start = [(rig, slice(0, len(rig.space.A)), "")], len(rig.space.A)
    for part in bed.residual if len(emulated) else ():
        rows.append((part, slice(start, start + len(part.space.A)), PLACE))
        start += len(part.space.A)
    swinging = (eigenvalues.imag > 1e-9) & (np.abs(eigenvalues) < highest)
    chosen = np.flatnonzero(swinging | _rigid(bed, eigenvalues, vectors, rows))
    chosen = chosen[np.lexsort((np.abs(eigenvalues[chosen]), eigenvalues[chosen].imag > 0))]
    names = _names_in_vehicle(bed)
    listed: list[LoopMode] = []
    for i in chosen:
        kinetic, potential = _energies(rows, vectors[:, i])
        turns = rig.turns @ vectors[rows[0][1], i]
        turns = turns / (max(turns, key=abs, default=1.0) or 1.0)
        value, rigid = complex(eigenvalues[i]), eigenvalues[i].imag <= 1e-9
        listed.append(
            LoopMode(
                len(listed) + 1, 0.0 if rigid else abs(value) / (2 * np.pi),
                0.0 if rigid else -value.real / abs(value), belongs_to,
                str(labels(turns[:, None], rig.J, rig.image)[0]), kinetic, {} if rigid else potential, value,
                dict(zip((names.get(name, name) for name in rig.masses), turns.tolist(), strict=True)),
            )
        )  # fmt: skip
    return listed


def _numbered(modes: Sequence[LoopMode]) -> list[LoopMode]:
    return [replace(mode, number=number) for number, mode in enumerate(modes, 1)]


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
    bed: LinearBed, eigenvalues: np.ndarray, vectors: np.ndarray, rows: list[tuple[Body, slice, str]]
) -> np.ndarray:
    """Which eigenvalues (m,) are rig and vehicle coasting as one: real, nothing twists, each rotor turns as its cut."""
    rigid = np.zeros(len(eigenvalues), bool)
    for i in np.flatnonzero(np.abs(eigenvalues.imag) <= 1e-9):
        vector = vectors[:, i]
        moving = sum(float(side.J @ np.abs(side.turns @ vector[place]) ** 2) for side, place, _ in rows)
        twisted = sum(float(side.stiffness @ np.abs(side.twists @ vector[place]) ** 2) for side, place, _ in rows)
        slip, speed = 0.0, 1.0 if len(rows) == 1 else 0.0
        for dyno, cut_shaft in zip(bed.dynamometers, bed.cuts, strict=True) if len(rows) > 1 else ():
            rotor = bed.rig.space.output(dyno.speed_sensor) @ vector[rows[0][1]]
            wanted = sum(
                side.space.output(cut_shaft.speed) @ vector[place]
                for side, place, _ in rows[1:]
                if cut_shaft.speed in side.space.outputs
            )
            slip, speed = slip + abs(rotor - wanted) ** 2, speed + abs(rotor) ** 2
        rigid[i] = twisted < 1e-2 * moving and slip < 1e-2 * speed
    return rigid


def _names_in_vehicle(bed: LinearBed) -> dict[str, str]:
    return {f"inertias.{cut.rig_end}": f"inertias.{cut.vehicle_end}" for cut in bed.cuts}


LEAST_MAC = 0.5  # of a mode of the loop that looks like one of the vehicle


def vehicle_modes_in_loop(
    vehicle: Sequence[Mode], modes: Sequence[LoopMode], inertia: Mapping[str, float]
) -> dict[int, tuple[LoopMode, float]]:
    """By number of a vehicle mode the mode of the closed loop that it became, with its MAC 0 … 1, one to one.

    The MAC is the modal assurance criterion over the drive side and the ends of the cuts, each coordinate weighted
    by its ``inertia`` (kg·m² by ``inertias.NAME``, 1 unless given). Modes that look alike (0.5 or more) are paired so
    that the sum of MAC·exp(−|ln s/s₀|) is largest: of two that move the drive side alike the eigenvalue decides, with
    its damping. What looks like no mode of the loop, rigid modes and overdamped motions are left out.
    """
    elastic, swinging = [mode for mode in vehicle if mode.frequency > 0], [mode for mode in modes if mode.frequency > 0]
    alike = weighted_mac(elastic, swinging, inertia)
    first, second = np.array([*map(eigenvalue_of, elastic)]), np.array([*map(eigenvalue_of, swinging)])
    score = np.where(alike >= LEAST_MAC, alike * closeness(first[:, None], second[None]), 0.0)
    return {elastic[i].number: (swinging[j], float(alike[i, j])) for i, j in pairs(score)}


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
