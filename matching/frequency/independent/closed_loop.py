"""The closed loop as one matrix W(s): rig, residual vehicle and control law at every s, dead time exact.

Unknowns are the coordinates of the rig, those of the residual vehicle and the air-gap torques. W has no poles in the
right half plane, so det W turns once round 0 for every closed-loop pole that a contour there encloses.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np

from matching.frequency.case.case import Case
from matching.frequency.independent.chain import Chain, NotCovered
from modelling.model.components import Shaft
from modelling.model.system import System


@dataclass(frozen=True)
class Law:
    """Air-gap torque command of one dynamometer: gains (f,) on reference angle, rotor angle and flange torque."""

    reference: np.ndarray
    rotor: np.ndarray
    torque: np.ndarray


def speed_controller(case: Case, s: np.ndarray) -> Law:
    """lead·[(kp + ki/s)·(reference − speed) + ka·s·reference − kt·torque] at s (f,), speeds as s times angles."""
    loop = case.loop
    lead = (1 + s * loop["lead_time"]) / (1 + s * loop["lead_time"] / 5)
    error = s * loop["proportional_gain"] + loop["integral_gain"]
    ahead = s**2 * loop["acceleration_feed_forward"]
    return Law(lead * (error + ahead), -lead * error, -lead * loop["torque_feed_forward"])


# Feedback of the control structures, written here once more; measured torques do not go round it.
LAWS: dict[str, Callable[[Case, np.ndarray], Law]] = {"pi": speed_controller, "model_based": speed_controller}


@dataclass(frozen=True)
class IndependentLoop:
    """A tuned case in the frequency domain; f complex frequencies, k dynamometers.

    Raises
    ------
    NotCovered
        If rig, residual vehicle or control structure holds what is not known here.
    """

    case: Case
    rig: Chain = field(init=False)
    vehicle: tuple[Chain, ...] = field(init=False)

    def __post_init__(self) -> None:
        if self.case.loop.structure.name not in LAWS:
            raise NotCovered(f"the control structure {self.case.loop.structure.name!r}")
        object.__setattr__(self, "rig", Chain(self.case.rig))
        object.__setattr__(self, "vehicle", tuple(Chain(part) for part in self.case.residual_vehicle.parts))

    def matrix(self, s: np.ndarray) -> np.ndarray:
        """W (f, w, w): rows are the torque balances of rig and residual vehicle, then the control laws."""
        n, k, dynamometers = self.rig.basis.shape[1], len(self.case.loop.dynamometers), self.case.loop.dynamometers
        sizes = [n, *(part.basis.shape[1] for part in self.vehicle), k]
        starts = np.cumsum([0, *sizes])
        W = np.zeros((len(s), starts[-1], starts[-1]), complex)
        torques = starts[-2]
        W[:, :n, :n] = self.rig.stiffness(s)
        W[:, :n, torques:] = -self.rig.drive([dynamometer.torque_input for dynamometer in dynamometers])
        for part, first, last in zip(self.vehicle, starts[1:-2], starts[2:-1], strict=True):
            W[:, first:last, first:last] = part.stiffness(s)
        law = LAWS[self.case.loop.structure.name](self.case, s)
        act = self.actuator(s)
        for j in range(k):
            torque, rotor = self.measured(j, s)
            at, end = self.interface(j)
            rows = slice(starts[1 + at], starts[2 + at])
            W[:, rows, :n] -= (self.vehicle[at].basis.T @ self.vehicle[at].unit(end))[None, :, None] * torque[:, None]
            reference = self.vehicle[at].unit(end) @ self.vehicle[at].basis
            W[:, torques + j, torques + j] = 1
            W[:, torques + j, rows] -= (act * law.reference)[:, None] * reference
            W[:, torques + j, :n] -= act[:, None] * (law.rotor[:, None] * rotor + law.torque[:, None] * torque)
        return W

    def actuator(self, s: np.ndarray) -> np.ndarray:
        """Air-gap torque (f,) for a command: dead time and inverter lag."""
        return np.exp(-s * self.case.loop["dead_time"]) / (1 + s * self.case.loop["inverter_lag"])

    def measured(self, j: int, s: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Lagged flange torque into the rotor and rotor angle (f, n), (n,) of a dynamometer, for unit coordinates."""
        dynamometer = self.case.loop.dynamometers[j]
        rotor = next(part.on for part in self.case.rig.inputs if part.name == dynamometer.torque_input)
        flange = next(part.of for part in self.case.rig.sensors if part.name == dynamometer.torque_sensor)
        shaft = next(part for part in self.case.rig.shafts if part.name == flange)
        speed_of = next(part.of for part in self.case.rig.sensors if part.name == dynamometer.speed_sensor)
        torque = self.rig.reading(dynamometer.torque_sensor, s) * torque_into(self.case.rig, shaft, rotor)
        lag = 1 / (1 + s * self.case.loop["torque_sensor_lag"])
        return lag[:, None] * torque, self.rig.unit(speed_of) @ self.rig.basis

    def interface(self, j: int) -> tuple[int, str]:
        """Which part of the residual vehicle a dynamometer stands for, and the inertia that it follows."""
        followed = self.case.loop.dynamometers[j].follows
        shaft = next(part for part in self.case.vehicle.shafts if part.name == followed)
        for at, part in enumerate(self.vehicle):
            for end in shaft.between:
                if end in part.nodes:
                    return at, end
        raise NotCovered(f"the cut at shafts.{followed}")

    def unstable_poles(self, offset: float = 1e-3, steps: int = 4000) -> int:
        """Closed-loop poles with a real part above ``offset``, 1/s, by the argument principle.

        The contour runs up the line Re s = offset and back on a half circle so wide that no pole lies beyond it. It is
        refined until det W turns by less than half a radian from point to point; slower drifts than exp(offset·t) are
        rigid motions.

        Raises
        ------
        NotCovered
            If a pole lies so near the contour that the count is no whole number.
        """
        radius = 2 * np.pi * 2e4
        up = np.concatenate([[0.0], np.geomspace(1e-4, radius, steps)])
        line = offset + 1j * up
        angle = np.pi / 2 - np.linspace(0, np.pi / 2, 400)[1:]
        path = np.concatenate([line, offset + radius * np.exp(1j * angle)])
        phase = np.linalg.slogdet(self.matrix(path))[0]
        for _ in range(30):
            turn = np.angle(phase[1:] / phase[:-1])
            wide = np.flatnonzero(np.abs(turn) > 0.5)
            if not len(wide):
                break
            middle = (path[wide] + path[wide + 1]) / 2
            phase = np.insert(phase, wide + 1, np.linalg.slogdet(self.matrix(middle))[0])
            path = np.insert(path, wide + 1, middle)
        turn = np.angle(phase[1:] / phase[:-1])
        # clockwise up the line and back: the upper half alone turns by −π for every pole of the whole
        count = -turn.sum() / np.pi
        if np.abs(turn).max() > 0.5 or abs(count - round(count)) > 0.05:
            raise NotCovered("a pole so near the imaginary axis that it cannot be counted")
        return round(count)

    def return_difference(self, s: np.ndarray) -> np.ndarray:
        """I + L at the commands (f, k, k)."""
        k = len(self.case.loop.dynamometers)
        plant = np.linalg.solve(
            self.rig.stiffness(s),
            np.broadcast_to(
                self.rig.drive([each.torque_input for each in self.case.loop.dynamometers]).astype(complex),
                (len(s), self.rig.basis.shape[1], k),
            ),
        )
        law, act = LAWS[self.case.loop.structure.name](self.case, s), self.actuator(s)
        torques = np.stack([(self.measured(j, s)[0][:, None] @ plant)[:, 0] for j in range(k)], axis=1)
        angles = np.stack([self.measured(j, s)[1] @ plant for j in range(k)], axis=1)
        followed = self._followed(s) @ torques
        command = (
            law.reference[:, None, None] * followed
            + law.rotor[:, None, None] * angles
            + law.torque[:, None, None] * torques
        )
        return np.eye(k) - act[:, None, None] * command

    def _followed(self, s: np.ndarray) -> np.ndarray:
        """Reference angles (f, k, k) of the residual vehicle for flange torques."""
        k = len(self.case.loop.dynamometers)
        followed = np.zeros((len(s), k, k), complex)
        for at, part in enumerate(self.vehicle):
            mine = [j for j in range(k) if self.interface(j)[0] == at]
            ends = np.array([part.unit(self.interface(j)[1]) @ part.basis for j in mine])
            torques = np.broadcast_to(ends.T.astype(complex), (len(s), *ends.T.shape))
            followed[np.ix_(range(len(s)), mine, mine)] = ends @ np.linalg.solve(part.stiffness(s), torques)
        return followed

    def response(self, s: np.ndarray, source: str, sensor: str) -> np.ndarray:
        """What a sensor of the rig reads (f,) for a torque that the controller does not measure."""
        W = self.matrix(s)
        load = np.zeros((len(s), W.shape[1], 1), complex)
        n = self.rig.basis.shape[1]
        if source in {part.name for part in self.case.rig.inputs}:
            load[:, :n] = self.rig.drive([source])
        else:
            starts = np.cumsum([n, *(part.basis.shape[1] for part in self.vehicle)])
            for part, first, last in zip(self.vehicle, starts[:-1], starts[1:], strict=True):
                if source in {driven.name for driven in part.system.inputs}:
                    load[:, first:last] = part.drive([source])
        motion = np.linalg.solve(W, load)[:, :n]
        return (self.rig.reading(sensor, s)[:, None] @ motion)[:, 0, 0]


def torque_into(system: System, shaft: Shaft, rotor: str) -> float:
    """Torque into the side of a shaft where ``rotor`` hangs, for 1 N·m that the shaft transmits."""
    joined = [set(other.between) for other in system.shafts if other.name != shaft.name]
    joined += [set(gear.between) for gear in system.gears]
    joined += [{differential.cage, differential.left, differential.right} for differential in system.differentials]
    side = {rotor}
    for _ in system.inertias:
        side |= {end for ends in joined if ends & side for end in ends}
    if shaft.between[1] in side:
        return 1.0
    return -1 / (1.0 if shaft.ratio is None else shaft.ratio.value)


def plain_response(chain: Chain, s: np.ndarray, source: str, sensor: str) -> np.ndarray:
    """What a sensor of a system reads (f,) for a torque at one of its inputs, nothing closed round it."""
    return plain_responses(chain, s, [source], [sensor])[:, 0, 0]


def plain_responses(chain: Chain, s: np.ndarray, sources: Sequence[str], sensors: Sequence[str]) -> np.ndarray:
    """What sensors of a system read (f, sensors, sources) for torques at some of its inputs."""
    drive = chain.drive(list(sources)).astype(complex)
    motion = np.linalg.solve(chain.stiffness(s), np.broadcast_to(drive, (len(s), *drive.shape)))
    return np.stack([chain.reading(sensor, s) for sensor in sensors], axis=1) @ motion
