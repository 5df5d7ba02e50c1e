"""A sampled controller on beds: poles, damping, responses, all beds of a set at once; b beds, f frequencies."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from matching.frequency.beds.bed import Bed, bed_of, compared_sensors, disturbing, vehicle_response
from matching.frequency.beds.eigenvalues import eigenvalues
from matching.frequency.beds.requirements import OF_ITS_OWN
from matching.frequency.beds.resolvent import resolvent
from matching.frequency.case.case import Case
from modelling.bed.observer_controller import ObserverController

FORGOTTEN = 1e-3  # of z: poles that decay faster have no frequency worth a number
LEAST_OF_ITS_OWN = 1e-6  # damping ratio, of a mode of the bed's own
SLOWEST_SWING_RAD_S = 1.0  # below, a pair of poles is a drift, not a mode


@dataclass(frozen=True)
class SampledBeds:
    """Beds from sample to sample, their matrices side by side; the states end with the commands on their way.

    Attributes
    ----------
    A, B, C : ndarray (b, x, x), (b, x, k), (b, y, x)
        Commands on their way stand newest first.
    states : int
        Of a bed itself, which the commands on their way follow.
    own_damping : ndarray (b,)
        Least damping ratio of each bed's own modes, without control, where the loop has to have rolled off.
    """

    A: np.ndarray
    B: np.ndarray
    C: np.ndarray
    states: int
    own_damping: np.ndarray

    def some(self, which: np.ndarray) -> SampledBeds:
        """The beds of these numbers (n,)."""
        return SampledBeds(self.A[which], self.B[which], self.C[which], self.states, self.own_damping[which])


@dataclass(frozen=True)
class BedSet:
    """Beds of one case and what they do at frequencies.

    Attributes
    ----------
    sampled : SampledBeds
    frequencies : ndarray (f,)
        Hz.
    held : ndarray (b, f, y, k)
        Readings for commands, sampled.
    read, answered, commanded : ndarray (b, f, y, d), (b, f, c, d), (b, f, c, k)
        Readings and compared sensors for continuous torques, and compared sensors for held commands.
    vehicle : ndarray (b, f, h)
    """

    case: Case
    sampled: SampledBeds
    frequencies: np.ndarray
    held: np.ndarray
    read: np.ndarray
    answered: np.ndarray
    commanded: np.ndarray
    vehicle: np.ndarray


def sampled_beds(case: Case, values: Sequence[dict[str, float]]) -> SampledBeds:
    """Beds with these values (SI, by name; :func:`bed_of`)."""
    return side_by_side([bed_of(case, of_bed) for of_bed in values])


def side_by_side(beds: Sequence[Bed]) -> SampledBeds:
    """Sampled beds as one batch, each with as many delayed commands as the bed with the longest dead time has."""
    longest = max(bed.sampled.delay for bed in beds) + 1
    matrices = [_shifting(bed, longest) for bed in beds]
    A, B, C = (np.stack(parts) for parts in zip(*matrices, strict=True))
    return SampledBeds(A, B, C, len(beds[0].A), np.array([bed.own_damping for bed in beds]))


def bed_set(case: Case, values: Sequence[dict[str, float]], frequencies: np.ndarray) -> BedSet:
    """Beds with these values (SI, by name; :func:`bed_of`) and their responses at frequencies (f,) in Hz."""
    beds = [bed_of(case, of_bed) for of_bed in values]
    sampled, step = side_by_side(beds), case.loop["sample_time"]
    s = 2j * np.pi * frequencies
    hold = (1 - np.exp(-s * step)) / (s * step)
    z = np.exp(s * step)
    held = np.stack(
        [c @ resolvent(a).columns(z, b) for a, b, c in zip(sampled.A, sampled.B, sampled.C, strict=True)]
    )  # fmt: skip
    read, answered, commanded = [], [], []
    for bed in beds:
        d = bed.torques.shape[1]
        states = resolvent(bed.A).columns(s, np.hstack([bed.torques, bed.commands]))
        read.append(bed.readings @ states[:, :, :d])
        answered.append(bed.compared @ states[:, :, :d] + bed.compared_torques)
        late = hold * np.exp(-s * bed.delay)
        commanded.append(bed.compared @ states[:, :, d:] * late[:, None, None])
    vehicle = np.stack([vehicle_response(case, of_bed, frequencies) for of_bed in values])
    return BedSet(case, sampled, frequencies, held, np.stack(read), np.stack(answered), np.stack(commanded), vehicle)


def _shifting(bed: Bed, longest: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A, B, C with ``longest`` commands on their way as further states."""
    x, k, delay = len(bed.A), bed.commands.shape[1], bed.sampled.delay
    A, B = np.zeros((x + k * longest,) * 2), np.zeros((x + k * longest, k))
    A[:x, :x] = bed.sampled.whole
    if delay:
        A[:x, x + k * (delay - 1) : x + k * delay] = bed.sampled.new
    else:
        B[:x] = bed.sampled.new
    A[:x, x + k * delay : x + k * (delay + 1)] = bed.sampled.old
    A[x + k :, x:-k] = np.eye(k * (longest - 1))
    B[x : x + k] = np.eye(k)
    return A, B, np.hstack([bed.readings, np.zeros((len(bed.readings), k * longest))])


@dataclass(frozen=True)
class Action:
    """A controller at frequencies: commands for readings (f, k, y) and for known torques (f, k, w)."""

    of_readings: np.ndarray
    of_known: np.ndarray
    known: tuple[str, ...]

    def at(self, part: slice) -> Action:
        """The same at some of the frequencies."""
        return Action(self.of_readings[part], self.of_known[part], self.known)


def action(controller: ObserverController, frequencies: np.ndarray, ahead: np.ndarray | None = None) -> Action:
    """What a controller does at frequencies (f,), Hz.

    ``ahead`` is what :func:`ahead_states` gives, if it is there already: it does not depend on the weights.
    """
    space, o, y = controller.space, controller.observed, len(controller.sensors)
    feedback = controller.feedback
    # C·(zI − A)⁻¹ of the observer, from the left: as many right-hand sides as dynamometers
    z = np.exp(2j * np.pi * frequencies * controller.sample_time)
    left = resolvent(feedback.A).rows(z, feedback.C)
    ahead = ahead_states(controller, frequencies) if ahead is None else ahead
    reaches = space.A[:o, o:] @ ahead + space.B[:o, y:]
    of_known = left @ reaches + space.C[:, o:] @ ahead + space.D[:, y:]
    return Action(left @ feedback.B + feedback.D, of_known, controller.known)


def ahead_states(controller: ObserverController, frequencies: np.ndarray) -> np.ndarray:
    """States (f, m, w) of the model that runs ahead, for known torques, at frequencies (f,) in Hz."""
    space, o, y = controller.space, controller.observed, len(controller.sensors)
    z = np.exp(2j * np.pi * frequencies * controller.sample_time)
    return resolvent(space.A[o:, o:]).columns(z, space.B[o:, y:])


def closed_matrices(beds: SampledBeds, controller: ObserverController) -> np.ndarray:
    """State matrices (b, x + c, x + c) of the closed loops."""
    space = controller.feedback
    By, Dy = space.B, space.D
    count, x, c = len(beds.A), beds.A.shape[1], len(space.A)
    closed = np.empty((count, x + c, x + c))
    closed[:, :x, :x] = beds.A + beds.B @ Dy @ beds.C
    closed[:, :x, x:] = beds.B @ space.C
    closed[:, x:, :x] = By @ beds.C
    closed[:, x:, x:] = space.A
    return closed


def shared_poles(beds: SampledBeds, controller: ObserverController, on_their_way: slice) -> np.ndarray:
    """Poles (b, p) of the closed loops without those at 0 that stand for commands known twice.

    A bed and the controller, among whose states ``on_their_way`` are these commands, hold the same ones, and what tells
    theirs apart is gone once they have passed. So the closed loop is worked out with the bed's alone, which takes a
    fraction of the time where the dead time is many samples.
    """
    closed, x = closed_matrices(beds, controller), beds.A.shape[1]
    both = np.arange(min(x - beds.states, on_their_way.stop - on_their_way.start))
    twice = x + on_their_way.start + both
    closed[:, :, beds.states + both] += closed[:, :, twice]
    once = np.delete(np.arange(closed.shape[1]), twice)
    return eigenvalues(closed[:, once[:, None], once])


def damping(z: np.ndarray, step: float) -> tuple[np.ndarray, np.ndarray]:
    """Largest magnitude (b,) of poles (b, x) of a loop with this sampling interval (s), and least damping ratio (b,).

    Poles that do not swing have no damping ratio.
    """
    return np.abs(z).max(axis=1), damping_ratios(z, step).min(axis=1)


def damping_ratios(z: np.ndarray, step: float) -> np.ndarray:
    """Damping ratios (b, x) of poles (b, x) of a loop with this sampling interval (s); 1 of what does not swing."""
    size, s = np.abs(z), rates(z, step)
    swinging = (size > FORGOTTEN) & (np.abs(s.imag) > SLOWEST_SWING_RAD_S)
    return np.where(swinging, -s.real / np.maximum(np.abs(s), 1e-300), 1.0)


def rates(z: np.ndarray, step: float) -> np.ndarray:
    """Poles (b, x) of a loop with this sampling interval (s) in continuous time, 1/s."""
    s: np.ndarray = np.log(np.where(np.abs(z) > FORGOTTEN, z, 0.5).astype(complex)) / step
    return s


def eased(beds: SampledBeds, z: np.ndarray, step: float, least: float, rolled_off_from: float) -> np.ndarray:
    """Factors (b, x) on the damping ratios of poles (b, x), sampling interval ``step`` (s), that ``least`` judges.

    From ``rolled_off_from`` (Hz) on no control helps a bed's own modes: there they count as if they had all of it.
    """
    of_own = least / (OF_ITS_OWN * np.maximum(beds.own_damping, LEAST_OF_ITS_OWN))
    fast = np.abs(rates(z, step)) >= 2 * np.pi * rolled_off_from
    factors: np.ndarray = np.where(fast, np.maximum(of_own, 1.0)[:, None], 1.0)
    return factors


def return_difference(beds: BedSet, acting: Action) -> np.ndarray:
    """I + L at the commands (b, f, k, k)."""
    return np.eye(acting.of_readings.shape[1]) - acting.of_readings @ beds.held


@dataclass(frozen=True)
class Driven:
    """What the i inputs of the compared functions do before any command reaches the bed.

    Attributes
    ----------
    commands : ndarray (b, f, k, i)
        What the controller makes of them.
    read, answered : ndarray (b, f, y, i), (b, f, c, i)
        Readings and compared sensors.
    known : dict
        Of the inputs, by number, those whose torque the controller knows: number among its known torques.
    """

    commands: np.ndarray
    read: np.ndarray
    answered: np.ndarray
    known: dict[int, int]


def compared_columns(case: Case) -> tuple[list[int], list[int]]:
    """Of every compared function: number of its sensor, number of its input."""
    sensors, inputs = compared_sensors(case), compared_inputs(case)
    return [sensors.index(pair.sensor) for pair in case.compared], [inputs.index(pair.input) for pair in case.compared]


def compared_inputs(case: Case) -> list[str]:
    """Inputs of the compared functions, each once."""
    return list(dict.fromkeys(pair.input for pair in case.compared))


def drive(beds: BedSet, acting: Action, measured: Sequence[str]) -> Driven:
    """What the compared functions' inputs do; ``measured`` and what acts inside the residual vehicle are known."""
    rig_inputs, inputs = disturbing(beds.case), compared_inputs(beds.case)
    shape = beds.read.shape[:2]
    read = np.zeros((*shape, beds.read.shape[2], len(inputs)), complex)
    answered = np.zeros((*shape, beds.answered.shape[2], len(inputs)), complex)
    known = {}
    for i, name in enumerate(inputs):
        if name in rig_inputs:
            read[..., i] = beds.read[..., rig_inputs.index(name)]
            answered[..., i] = beds.answered[..., rig_inputs.index(name)]
        if name in measured or name not in rig_inputs:
            known[i] = acting.known.index(name)
    commands = acting.of_readings @ read
    for i, column in known.items():
        commands[..., i] += acting.of_known[:, :, column]
    return Driven(commands, read, answered, known)


def responses(beds: BedSet, acting: Action, measured: Sequence[str]) -> np.ndarray:
    """Compared functions (b, f, h) of the beds under control for continuous torques, of which ``measured`` are known.

    What acts inside the residual vehicle is always known.
    """
    driven = drive(beds, acting, measured)
    answer = beds.commanded @ np.linalg.solve(return_difference(beds, acting), driven.commands) + driven.answered
    sensors, inputs = compared_columns(beds.case)
    return answer[:, :, sensors, inputs]


def errors(beds: BedSet, acting: Action, measured: Sequence[str]) -> np.ndarray:
    """Mean squares (b, h) over the frequencies of |log(H_rig/H_vehicle)|, complex logarithm."""
    with np.errstate(divide="ignore", invalid="ignore"):
        squares = np.abs(np.log(responses(beds, acting, measured) / beds.vehicle)) ** 2
    return np.nan_to_num(squares, nan=1e6, posinf=1e6).mean(axis=1)
