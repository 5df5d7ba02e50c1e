"""The channels of a bed, before anything is fed back: small torques one after another, and what every channel reads.

A sign, a unit, a pair of exchanged channels, one that is stuck or reads something at rest: each of them makes a speed
hold or an emulation dangerous. So no reading is fed back here. Each torque acts alone, in pulses that bring the rotors
back to rest; commands stay below a tenth of the torque limit, and no rotor passes a tenth of its speed limit. The
recording is compared with the model's answer to the recorded commands. A bed that is off by tenths, rubs or has free
play still answers like its model to a factor of two; a wrong channel does not.
"""

from __future__ import annotations

import contextlib
import itertools
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from scipy.ndimage import uniform_filter1d

from matching.bed.deviations import DEVIATIONS, Deviations, begun_fit, delays_at_edges, deviations
from matching.bed.excite import bed_inputs, torques_csv
from matching.bed.identify import measured_case
from matching.bed.lost_motion import LostMotion, lost_motion, with_free_play
from matching.bed.simulated_bed import FmuBed, FmuController, FmuPlant, bed_system, held_as_linear, run_csv
from matching.bed.stated import Deviation, case_line, off_words
from matching.match.case import Case
from modelling.bed.stepped import Law
from modelling.controller.law import (
    CHANNEL_CHECK,
    CHECK_SPEED_SHARE,
    CHECK_TORQUE_SHARE,
    FAULTS,
    NO_LIMIT,
    ZERO_TORQUE,
    SupervisedController,
)
from modelling.display import Displayed
from modelling.effects.effect import place_in_words
from modelling.effects.friction_and_compliance import CoulombFriction
from modelling.equations.casadi_code import compiled
from modelling.errors import InputError, listed
from modelling.modal.modes import damped_modes
from modelling.recordings.channel_faults import ChannelFault, conversion, factor_fault, fault
from modelling.recordings.corrections import SETTINGS as CORRECTIONS
from modelling.recordings.corrections import kept_values, resolution
from modelling.recordings.recording import Recording
from modelling.running.run import run
from modelling.simulation.simulate import simulate
from modelling.simulation.stepping import SimulationError
from modelling.system import Effect, Quantity, System
from modelling.topology import joints, speed_ratios


@dataclass(frozen=True)
class ChannelSettings:
    """How channels are checked; the reason of a number stands beside it."""

    lead: float = 0.5  # s at rest: noise and zero of every channel to a fifteenth of the noise of one sample
    pulse: float = 0.15  # s of the first of four pulses +, −, −, +: two periods of a mode of 15 Hz
    rests: tuple[float, float] = (0.45, 2.0)  # s after them, at least and at most, so that the bed has come to rest
    decayed: float = 0.05  # of an answer, that may ring on into the next
    before: int = 10  # samples before an answer, whose mean it begins from
    compared: float = 0.3  # s of an answer that are compared: five periods of 15 Hz, known to 5 %, are in step so long
    averaged: float = 0.06  # s of a running mean over all pulses: a period of 15 Hz, and what crosses free play
    early: float = 0.04  # s after the last command of a check that tripped, in which its answer is seen
    still: float = 0.35  # of the answer that is expected: what rings on from the pulses before is no answer
    held: float = 0.2  # of the answer without friction: where friction leaves less of it, it says nothing
    use_of_speed: float = 0.4  # of the speed limit of the check, on the bed as modelled: it may be off by a factor 2
    motor_share: float = 0.8  # of the manoeuvre's largest torque, for other inputs; use_of_speed bounds it as well
    least_weight: float = 0.1  # of a channel's largest answer: a torque that moves it less says nothing of it
    over_noise: float = 8.0  # times the noise of a sample, that an answer (root of the sum of squares) is larger
    free_ratio: float = 2.0  # by which the size of an answer may be off without a wrong channel
    largest: float = 3.0  # misfit of a channel that answers like something else altogether; 0 is as modelled
    wrong: float = 0.5  # misfit from which on an answer is not the model's: friction and play stay below 0.3
    strange: float = (
        1.5  # misfit of an answer that nothing is said by: no likeness, and another size, or the other sign
    )
    better: float = 0.5  # of the misfit before: what a wrong channel leaves when it is taken into account, and
    mended: float = 0.2  # the same, where it is still not like the model: a bed that sticks answers like nothing
    rival: float = 1.05  # of χ² of the first fit: an exchange that leaves more is none, whatever else is wrong
    most: int = 4  # wrong channels that are looked for
    plays: int = 2  # shafts with free play that are looked for, one after another
    friction: tuple[float, ...] = (0.03, 0.06, 0.1, 0.15, 0.22, 0.32, 0.5, 1.1)  # of the largest torque: what may hold
    inexact: float = 0.01  # of a reading's range: error of a simulation with friction, small beside any misfit
    stops: float = (
        1.2  # factor of a channel from which on no emulation begins; a smaller one goes on as a measured value
    )
    noisy: float = 1.0  # steps of its resolution: eight equal values of a channel with more noise are no chance (1e-4)
    nothing: float = 0.02  # of a torque's command: what acts with less gives no torque
    offset_ratio: float = 5.0  # of a sensor's stated uncertainty, from which on its zero is wrong
    offset_share: float = 0.005  # of the torque limit or a channel's own range: the same where none is stated


CHANNELS = ChannelSettings()
NAMED = 0.35  # of a factor's natural logarithm: friction makes an answer smaller by up to a third


# --- The plan: pulses of every torque alone, then of all at once.


@dataclass(frozen=True)
class ChannelPlan(Displayed):
    """What moves a bed while its channels are checked.

    Attributes
    ----------
    inputs : tuple of str (u)
        Inputs of the rig: the dynamometers', then the others.
    torques : ndarray (t, u)
        N·m, at steps of ``step`` (s): commands of the dynamometers, and demands of the others.
    step : float
        s.
    largest_speed : float
        rad/s, of any dynamometer's rotor, as modelled.
    """

    inputs: tuple[str, ...]
    torques: np.ndarray = field(repr=False)
    step: float
    largest_speed: float

    @property
    def duration(self) -> float:
        """Of the recording, s."""
        return len(self.torques) * self.step

    def csv(self) -> str:
        """Time and torques as a CSV file."""
        return torques_csv(np.arange(len(self.torques)) * self.step, self.inputs, self.torques)

    def to_dict(self) -> dict[str, Any]:
        """As ``channels_plan.json`` holds it."""
        largest = np.abs(self.torques).max(axis=0)
        return {
            "inputs": list(self.inputs), "duration": self.duration, "largest_speed": self.largest_speed,
            "largest_torques": dict(zip(self.inputs, largest.tolist(), strict=True)),
        }  # fmt: skip


def plan_channels(case: Case, share: float = 1.0, settings: ChannelSettings = CHANNELS) -> ChannelPlan:
    """Plan the pulses that check the channels of a case's bed; with a share of their torques where they tripped.

    Raises
    ------
    InputError
        If an input's torque is not known from limits or manoeuvre.
    """
    step, system = case.loop["sample_time"], bed_system(case)
    inputs, driven = bed_inputs(case), len(case.loop.dynamometers)
    alone = _pulses(case, settings, step)
    lead, count = round(settings.lead / step), len(alone)
    sizes = share * np.array([_largest(case, name, j < driven, settings) for j, name in enumerate(inputs)])
    parts = [np.zeros((lead, len(inputs)))]
    for j in range(len(inputs)):
        part = np.zeros((count, len(inputs)))
        part[:, j] = alone
        parts.append(part)
    torques = np.vstack(parts) * sizes
    speeds = np.abs(_answers(system, torques, inputs, step, case)).max(axis=1).reshape(-1)
    allowed = share * settings.use_of_speed * CHECK_SPEED_SHARE * case.limits.get("dynamometer_speed", NO_LIMIT)
    fastest = np.array([speeds[lead + j * count : lead + (j + 1) * count].max() for j in range(len(inputs))])
    scale = np.minimum(1.0, allowed / np.maximum(fastest, 1e-12))
    together = np.outer(alone, scale * sizes) / len(inputs)
    return ChannelPlan(inputs, np.vstack([torques * scale, together]), step, float((fastest * scale).max()))


def _pulses(case: Case, settings: ChannelSettings, step: float) -> np.ndarray:
    """Signs (t,) of +, −, −, + and rest: speed and angle come back to where they began, and modes die out."""
    rates = [2 * np.pi * mode.frequency * mode.damping_ratio for mode in damped_modes(case.rig) if mode.frequency > 0]
    slowest = -np.log(settings.decayed) / max(min(rates, default=np.inf), 1e-9)
    one, rest = round(settings.pulse / step), round(float(np.clip(slowest, *settings.rests)) / step)
    return np.concatenate([np.ones(one), -np.ones(2 * one), np.ones(one), np.zeros(rest)])


def _largest(case: Case, name: str, driven: bool, settings: ChannelSettings) -> float:
    inputs, torques = [dynamometer.torque_input for dynamometer in case.loop.dynamometers], case.manoeuvre
    limits = case.limits_of("torque")
    limit = float(limits[inputs.index(name)] if driven else limits.min())
    if driven and limit < np.inf:
        return CHECK_TORQUE_SHARE * limit
    sizes = {source: drive.largest for source, drive in torques.items()}
    if not sizes and limit == np.inf:
        raise InputError(
            f"{case.path or 'case'}: limits.dynamometer_torque", "is missing",
            "state it: the check of the channels stays below a tenth of it",
        )  # fmt: skip
    return settings.motor_share * (sizes.get(name) or max(sizes.values(), default=limit))


def _answers(system: System, torques: np.ndarray, inputs: Sequence[str], step: float, case: Case) -> np.ndarray:
    """Speeds (t, k) of the dynamometers' rotors under torques (t, u), as modelled."""
    time = np.arange(len(torques)) * step
    read = [dynamometer.speed_sensor for dynamometer in case.loop.dynamometers]
    done = simulate(compiled(system), time, dict(zip(inputs, torques.T, strict=True)), sensors=read)
    return np.stack([done[name] for name in read], axis=1)


# --- The run.

COAST_SECONDS = 0.3  # that are recorded after the controller has given up: what it left shows which channel it was


def channel_recording(
    bed: FmuBed, case: Case, law: Law, controller: FmuController | SupervisedController, plan: ChannelPlan,
    known: Mapping[str, tuple[str, float]] | None = None,
) -> tuple[str, str]:  # fmt: skip
    """Text of the CSV recording of the check of the channels, from rest; what ended it early, empty where nothing did.

    No reading is fed back: the controller's mode for it commands the planned torques, within its limits. ``known`` is
    :attr:`ChannelCheck.carried` of an earlier check that a wrong channel ended: the controller, which watches the
    speeds, reads them mended; the recording holds them as the bed gives them.
    """
    carried = known or {}
    sensors = tuple(carried.get(name, (name, 1.0))[0] for name in law.sensors)
    factors = np.array([carried.get(name, (name, 1.0))[1] for name in law.sensors])
    asks = _Check(controller, sensors, tuple(law.known), plan, len(law.dynamometers), factors)
    plant = FmuPlant(bed, bed.inputs, 0.0)
    found = run(plant, asks, samples=len(plan.torques), sample_time=plan.step)
    sent, readings = found.commands[:, :, 0], found.readings[:, :, 0]
    text = run_csv(case, bed, plan.step, held_as_linear(sent), readings, plan.inputs)
    if not asks.fault:
        return text, ""
    fastest = _fastest(bed, case, readings[asks.fault_at])
    return text, f"{FAULTS[asks.fault]}, {asks.fault_at * plan.step:.3f} s after the start{fastest}"


@dataclass
class _Check:
    """The check of the channels as a controller of all inputs; it ends the run a moment after a fault."""

    controller: FmuController | SupervisedController
    sensors: tuple[str, ...]
    known: tuple[str, ...]
    plan: ChannelPlan
    dynamometers: int
    factors: np.ndarray  # of the readings, over the truth
    fault: int = 0
    fault_at: int = -1

    def step(self, sample: int, readings: np.ndarray, known: np.ndarray) -> np.ndarray | None:
        """See :class:`modelling.running.plant.Controller`."""
        k, torque = self.dynamometers, self.plan.torques[sample]
        if self.fault and sample > self.fault_at + round(COAST_SECONDS / self.plan.step):
            return None
        mode = ZERO_TORQUE if self.fault else CHANNEL_CHECK
        answer = self.controller.step(readings[:, 0] / self.factors, known[:, 0], mode, np.zeros(k), sample, torque[:k])
        if answer.fault and not self.fault:
            self.fault, self.fault_at = answer.fault, sample
        others = np.zeros(len(torque) - k) if self.fault else torque[k:]
        return np.concatenate([answer.commands, others])[:, None]


def _fastest(bed: FmuBed, case: Case, readings: np.ndarray) -> str:
    """The fastest of the dynamometers' speeds as read, in words."""
    names = [dynamometer.speed_sensor for dynamometer in case.loop.dynamometers]
    values = [abs(readings[bed.sensors.index(name)]) for name in names]
    return f" ({names[int(np.argmax(values))]} reads {max(values):.3g} rad/s)"


# --- What channels may be: exchanged, multiplied by a factor, stuck. One hypothesis changes one channel, or a pair.


@dataclass(frozen=True)
class _Wiring:
    """Which truth every output (y) and input (u) is connected to, and by what factor."""

    outputs: tuple[int, ...]
    factors: tuple[float, ...]
    inputs: tuple[int, ...]
    gains: tuple[float, ...]

    def exchanged(self, kind: str, i: int, k: int) -> _Wiring:
        """Two outputs, or two inputs, exchanged."""
        order = list(getattr(self, kind))
        order[i], order[k] = order[k], order[i]
        return replace(self, **{kind: tuple(order)})

    def scaled(self, kind: str, i: int, factor: float) -> _Wiring:
        """An output, or an input, with a factor."""
        values = list(getattr(self, kind))
        values[i] *= factor
        return replace(self, **{kind: tuple(values)})


class _Blocks:
    """Answers of every output (y) while each input (u) alone, and then all, move the bed; n samples a window.

    Rows of the comparison are the outputs, then the differences of every two outputs of one quantity: where two
    channels answer nearly alike, their difference says which is which.
    """

    def __init__(
        self, measured: np.ndarray, modelled: np.ndarray, together: np.ndarray, expected: np.ndarray,
        shares: np.ndarray, noise: np.ndarray, start: np.ndarray, pairs: Sequence[tuple[int, int]],
        settings: ChannelSettings, averaged: _Blocks | None = None, free: _Blocks | None = None,
    ):  # fmt: skip
        # noise (y,) of a sample, and start (y,): that of the value which an answer begins from
        self._averaged = averaged  # the same answers as running means: what free play leaves of them
        self.measured, self.modelled, self.together = measured, modelled, together  # (u, y, n), (u, y, n), (y, n)
        self.shares, self.pairs, self.settings = shares, list(pairs), settings  # amplitudes (u,) alone and together
        # what is no sum of the torques alone, (y, n): friction holds less of all than of each
        self._beyond = expected - (modelled * (shares[:, 1] / shares[:, 0])[:, None, None]).sum(axis=0)
        first, second = (np.array([pair[side] for pair in self.pairs], int) for side in (0, 1))
        self._first, self._second = first, second
        self.noise, start = (np.concatenate([own, np.hypot(own[first], own[second])]) for own in (noise, start))
        count = measured.shape[2]
        self._silent = settings.over_noise * self.noise + 3 * np.sqrt(count) * start  # k = 3
        seen = self._rows(measured, together)
        sizes = np.linalg.norm(self._rows(*self._parts(self.right())), axis=2)
        self._seen = seen
        self._energy = np.maximum((seen**2).sum(axis=2) - count * (self.noise**2 + start**2), 0.0)
        self._usual = settings.still * sizes
        alone = sizes[:, : measured.shape[1]]
        common = np.concatenate([alone, np.maximum(alone[:, first], alone[:, second])], axis=1)
        largest = common.max(axis=0)
        self.strong = (
            (sizes > settings.over_noise * self.noise) & (sizes > settings.least_weight * largest) & (sizes > 0)
        )
        self.sizes = sizes
        if free is not None:  # of the bed without friction: where friction holds it, only earlier motion rings on
            self.strong &= sizes > settings.held * free.sizes

    def right(self) -> _Wiring:
        """Every channel is what it is called."""
        u, y = self.modelled.shape[:2]
        return _Wiring(tuple(range(y)), (1.0,) * y, tuple(range(u)), (1.0,) * u)

    def _rows(self, alone: np.ndarray, together: np.ndarray) -> np.ndarray:
        """Outputs and differences (u + 1, y + pairs, n)."""
        every = np.concatenate([alone, together[None]])
        return np.concatenate([every, every[:, self._first] - every[:, self._second]], axis=1)

    def _parts(self, wiring: _Wiring) -> tuple[np.ndarray, np.ndarray]:
        own, other = self.shares, self.shares[list(wiring.inputs)]
        parts = self.modelled[list(wiring.inputs)] * (np.array(wiring.gains) * own[:, 0] / other[:, 0])[:, None, None]
        factors = np.array(wiring.factors)[:, None]
        parts = parts[:, list(wiring.outputs)] * factors
        beyond = self._beyond[list(wiring.outputs)] * factors
        return parts, (parts * (own[:, 1] / own[:, 0])[:, None, None]).sum(axis=0) + beyond

    def alike(self) -> list[tuple[int, int]]:
        """Pairs of outputs whose difference says nothing of any input."""
        told = self.strong[:, self.measured.shape[1] :].any(axis=0)
        return [pair for pair, known in zip(self.pairs, told, strict=True) if not known]

    def misfits(self, wiring: _Wiring) -> np.ndarray:
        """Misfit (u + 1, rows) of every answer, 0 where the row says nothing of the input.

        Of an answer and its running mean, the one that is more like the model counts: free play tears the first apart,
        and what rings on bends the second; a wrong channel is wrong in both.
        """
        expected = self._rows(*self._parts(wiring))
        settings, size = self.settings, np.linalg.norm(expected, axis=2)
        root = np.sqrt(self._energy)
        stuck = np.zeros(len(self.noise), bool)
        stuck[: len(wiring.factors)] = np.array(wiring.factors) == 0  # it shows its noise, and nothing else
        silent = root < np.where(stuck, self._silent, self._usual)
        still = np.where(silent | (root == 0), 0.0, settings.largest)
        with np.errstate(divide="ignore", invalid="ignore"):
            alike = np.clip((self._seen * expected).sum(axis=2) / (root * size), -1.0, 1.0)
            off = np.maximum(np.abs(np.log(root / size)) - np.log(settings.free_ratio), 0.0)
            found = np.minimum(1 - alike + off**2, settings.largest)
        found = np.where(size == 0, still, np.where(root == 0, settings.largest, found))
        if self._averaged is not None:
            mean = self._averaged.misfits(wiring)
            found = np.where(self._averaged.strong, np.minimum(found, mean), found)
        return np.where(self.strong, found, 0.0)

    def changed(self, before: _Wiring, after: _Wiring) -> np.ndarray:
        """Answers (u + 1, rows), as bool, of the channels in which two wirings differ."""
        outputs = [i for i, pair in enumerate(zip(before.outputs, after.outputs, strict=True)) if pair[0] != pair[1]]
        outputs += [i for i, pair in enumerate(zip(before.factors, after.factors, strict=True)) if pair[0] != pair[1]]
        inputs = [j for j, pair in enumerate(zip(before.inputs, after.inputs, strict=True)) if pair[0] != pair[1]]
        inputs += [j for j, pair in enumerate(zip(before.gains, after.gains, strict=True)) if pair[0] != pair[1]]
        own = np.zeros(self.strong.shape, bool)
        own[:, outputs] = True
        own[inputs] = True
        for row, (i, k) in enumerate(self.pairs, start=self.measured.shape[1]):
            own[:, row] |= {i, k} == set(outputs)
        return own

    def factors(self, wiring: _Wiring) -> tuple[np.ndarray, np.ndarray]:
        """Factor on every output (y,) and every input (u,) by the sizes and signs of its answers; NaN: none is told."""
        expected = self._rows(*self._parts(wiring))
        u, y = self.modelled.shape[:2]
        with np.errstate(divide="ignore", invalid="ignore"):
            ratio = np.sqrt(self._energy) / np.linalg.norm(expected, axis=2)
            ratio = ratio * np.sign((self._seen * expected).sum(axis=2))
        ratio = np.where(self.strong & (ratio != 0) & np.isfinite(ratio), ratio, np.nan)[:u, :y]
        return tuple(_typical(rows) for rows in (ratio.T, ratio))  # type: ignore[return-value]


def _typical(ratios: np.ndarray) -> np.ndarray:
    """Geometric mean (r,) of the sizes of ratios (r, n), with the sign that most of them have; NaN of none."""
    found = np.full(len(ratios), np.nan)
    for r, row in enumerate(ratios):
        told = row[np.isfinite(row)]
        if len(told):
            found[r] = np.exp(np.mean(np.log(np.abs(told)))) * (1.0 if np.sum(np.sign(told)) >= 0 else -1.0)
    return found


def _hypotheses(
    blocks: _Blocks, wiring: _Wiring, quantities: Sequence[str], outputs: Sequence[str], inputs: Sequence[str],
    driven: int,
) -> Iterator[tuple[_Wiring, tuple[ChannelFault, ...]]]:  # fmt: skip
    """Each wiring that differs by one channel, or by one exchanged pair, and what it would mean."""
    of_outputs, of_inputs = blocks.factors(wiring)
    for i, (name, quantity) in enumerate(zip(outputs, quantities, strict=True)):
        yield wiring.scaled("factors", i, -1.0), (fault("sign", name),)
        yield wiring.scaled("factors", i, 0.0), (fault("stuck", name),)
        if np.isfinite(of_outputs[i]) and abs(np.log(abs(of_outputs[i]))) > np.log(blocks.settings.free_ratio):
            yield wiring.scaled("factors", i, of_outputs[i]), (factor_fault(name, quantity, of_outputs[i], NAMED),)
    for i, k in itertools.combinations(range(len(outputs)), 2):
        one, other = outputs[i], outputs[k]
        yield wiring.exchanged("outputs", i, k), (fault("exchanged", one, other), fault("exchanged", other, one))
    for j, name in enumerate(inputs):
        giver = "its dynamometer" if j < driven else "what gives it"
        yield wiring.scaled("gains", j, -1.0), (fault("sign", name, giver=giver),)
        silent = fault("stuck", name, giver=giver)
        if j >= driven:
            words = f"moves nothing: friction holds the bed, or {giver} gives no torque"
            silent = replace(silent, words=words, certain=False)
        yield wiring.scaled("gains", j, 0.0), (silent,)
        factor = of_inputs[j]
        if np.isfinite(factor) and abs(np.log(abs(factor))) > np.log(blocks.settings.free_ratio):
            yield wiring.scaled("gains", j, factor), (factor_fault(name, "torque", factor, NAMED, giver=giver),)
    for j, k in itertools.combinations(range(driven), 2):
        one, other, giver = inputs[j], inputs[k], "its dynamometer"
        pair = (fault("exchanged", one, other, giver), fault("exchanged", other, one, giver))
        yield wiring.exchanged("inputs", j, k), pair


# --- The judgement of a recording.


@dataclass(frozen=True)
class CheckedChannel:
    """What the check says of a channel.

    Attributes
    ----------
    name, quantity, unit : str
        Unit in SI.
    gain, gain_uncertainty : float or None
        Of a sensor: reading over what the model expects; of an input: torque over command; k = 1. None: not told.
    delay, delay_uncertainty : float or None
        s, beyond what the case states.
    zero, zero_uncertainty, noise : float or None
        Reading at rest, its uncertainty, and the standard deviation of a sample; None of inputs.
    words : str
        What is wrong, empty where nothing is.
    """

    name: str
    quantity: str
    unit: str
    gain: float | None
    gain_uncertainty: float | None
    delay: float | None
    delay_uncertainty: float | None
    zero: float | None = None
    zero_uncertainty: float | None = None
    noise: float | None = None
    words: str = ""

    def to_dict(self) -> dict[str, Any]:
        """As ``channels.json`` holds it."""
        return {key: getattr(self, key) for key in self.__dataclass_fields__} | {"words": self.words or None}


@dataclass(frozen=True)
class ChannelCheck(Displayed):
    """What the check of the channels found.

    Attributes
    ----------
    channels : tuple of CheckedChannel
        Sensors of the rig that were recorded, then its inputs.
    wrong : tuple of ChannelFault
        In the order in which they were found.
    unlike : tuple of str
        Channels that answer otherwise than the model, whatever one channel's fault is assumed.
    alike : tuple of tuple of str
        Pairs of channels that answer so much alike that nothing tells whether they are exchanged.
    open : tuple of ChannelFault
        What may be wrong, or otherwise explained.
    fastest : float
        rad/s: largest reading of a dynamometer's speed, as the model's units have it.
    tripped : str
        What ended the check early; empty where nothing did.
    unjudged : tuple of str
        Channels of which the recording says nothing: nothing moved them, or the check ended before.
    needed : tuple of str
        Those of them that the controller reads or commands.
    off : tuple of Deviation
        What of bed and channels lies beyond its tolerance and goes on as a measured value: no wrong channel.
    measured : tuple of Deviation
        All that the check measures of the bed: the first match begins from it.
    explained : bool
        Whether the bed with these values, and with the free play that was found, answers as it was recorded.
    free_plays : tuple of LostMotion
        Free play that the recording shows, with its wrong channels mended.
    shown : mapping of str to ndarray (t,)
        ``time`` (s), and of every wrong sensor the reading and, as ``NAME model``, what it should have read.
    carried : mapping of str to (str, float)
        By sensor whose reading is not its own: the channel that carries it, and its factor; of wrong channels that
        nothing else explains.
    mended : Recording or None
        The recording with its wrong channels mended, by which a further defect is looked for; None of one that a trip
        ended, or with a channel that stands still.
    """

    channels: tuple[CheckedChannel, ...]
    wrong: tuple[ChannelFault, ...]
    unlike: tuple[str, ...] = ()
    alike: tuple[tuple[str, str], ...] = ()
    open: tuple[ChannelFault, ...] = ()
    fastest: float = 0.0
    tripped: str = ""
    unjudged: tuple[str, ...] = ()
    needed: tuple[str, ...] = ()
    off: tuple[Deviation, ...] = ()
    measured: tuple[Deviation, ...] = ()
    explained: bool = False
    free_plays: tuple[LostMotion, ...] = ()
    shown: Mapping[str, np.ndarray] = field(default_factory=dict, repr=False)
    carried: Mapping[str, tuple[str, float]] = field(default_factory=dict, repr=False)
    mended: Recording | None = field(default=None, repr=False)

    @property
    def right(self) -> bool:
        """Whether an emulation may follow."""
        return not self.wrong and not self.tripped and not self.needed

    def sentence(self) -> str:
        """Which channels are wrong or open, and which are not judged, in a sentence."""
        rest = f"not judged: {listed(list(self.unjudged))}" if self.unjudged else ""
        played = [f"{'with what is wrong mended, ' * (not self.right)}the recording shows free play of "
                  f"{one.gap:.2g} rad of {place_in_words(one.at)}" for one in self.free_plays]  # fmt: skip
        return "; ".join(part for part in (self._judged(), *map(off_words, self.off), *played, rest) if part)

    def _judged(self) -> str:
        if self.wrong:
            return "; ".join(one.sentence for one in self.wrong)
        if self.tripped:
            return f"the check of the channels ended early: {self.tripped}, and no single channel explains it"
        rest = [f"perhaps {one.sentence}" for one in self.open]
        if self.unlike:
            rest.append(f"{listed(list(self.unlike))} answer{'s' * (len(self.unlike) == 1)} otherwise than the model")
        if rest or self.unjudged:
            return "; ".join(["no channel that is judged is wrong" if self.unjudged else "no channel is wrong", *rest])
        return "every channel has the sign, unit and place that the model expects"

    def to_dict(self) -> dict[str, Any]:
        """As ``channels.json`` holds it."""
        return {
            "right": self.right, "sentence": self.sentence(),
            "wrong": [{"channel": one.channel, "words": one.words, "line": one.line or None} for one in self.wrong],
            "unlike": list(self.unlike), "open": [one.sentence for one in self.open],
            "alike": [list(pair) for pair in self.alike], "tripped": self.tripped or None, "fastest": self.fastest,
            "unjudged": list(self.unjudged), "needed": list(self.needed),
            "channels": [one.to_dict() for one in self.channels],
            "off": [one.to_dict() | {"words": off_words(one), "line": case_line(one)} for one in self.off],
            "measured": [one.to_dict() for one in self.measured], "explained": self.explained,
            "free_plays": [one.to_dict() for one in self.free_plays],
            "shown": {name: [float(f"{value:.5g}") for value in values[:: max(len(values) // SHOWN, 1)]]
                      for name, values in self.shown.items()},
        }  # fmt: skip


SHOWN = 1500  # samples of a wrong channel that are shown: 6 ms apart


@dataclass(frozen=True)
class _Run:
    """A recording on the grid of samples: commands (t, u), readings (t, y), and the windows in which they are compared.

    ``acted`` are the inputs that move the bed alone, in ``windows``; ``noise`` (y,) is that of a sample.
    """

    sent: np.ndarray
    read: np.ndarray
    windows: tuple[slice, ...]
    together: slice | None
    acted: tuple[int, ...]
    noise: np.ndarray
    quantities: list[str]
    step: float

    def blocks(
        self, model: np.ndarray, settings: ChannelSettings, most: int | None = None, free: np.ndarray | None = None
    ) -> _Blocks:
        """Its answers, ``most`` samples at most, next to those of a model (t, y), as they are and as running means;
        ``free`` (t, y) are those of the model without friction."""
        without = None if free is None else self.blocks(free, settings, most)
        lengths = [window.stop - window.start for window in (*self.windows, self.together) if window is not None]
        whole = min(lengths if most is None else [*lengths, most])

        def part(values: np.ndarray, window: slice | None, count: int) -> np.ndarray:
            if window is None:
                return np.zeros((values.shape[1], count))
            before = values[max(window.start + 1 - settings.before, 0) : window.start + 1]
            return np.nan_to_num(values[window.start : window.start + count] - before.mean(axis=0)).T

        largest = np.array([
            [np.abs(self.sent[window, j]).max(), np.abs(self.sent[self.together, j]).max() if self.together else 0.0]
            for j, window in zip(self.acted, self.windows, strict=True)
        ])  # fmt: skip
        pairs = [
            (i, k)
            for i, k in itertools.combinations(range(self.read.shape[1]), 2)
            if self.quantities[i] == self.quantities[k]
        ]
        found: _Blocks | None = None
        for seconds, over in ((4 * settings.pulse, settings.averaged), (settings.compared, 0.0)):
            count, width = min(round(seconds / self.step), whole), max(round(over / self.step), 1)
            measured, modelled = (
                uniform_filter1d(np.stack([part(values, window, count) for window in self.windows]), width)
                for values in (self.read, model)
            )
            together, expected = (
                uniform_filter1d(part(values, self.together, count), width) for values in (self.read, model)
            )
            found = _Blocks(
                measured, modelled, together, expected, largest, self.noise / np.sqrt(width),
                self.noise / np.sqrt(settings.before), pairs, settings, found,
                None if without is None else (without._averaged if over else without),
            )  # fmt: skip
        assert found is not None
        return found


def _as_it_may_be(system: System, case: Case, largest: Mapping[str, float], settings: ChannelSettings) -> list[System]:
    """The bed as modelled, then with dry friction where the torques act that no dynamometer gives.

    Small torques do not overcome friction that nothing is wrong with, and then channels seem to stand still or to be
    exchanged. So no channel is named for what friction explains. ``largest`` are the torques, N·m, by input.
    """
    driven, on = {one.torque_input for one in case.loop.dynamometers}, {part.name: part.on for part in system.inputs}
    places = list(dict.fromkeys(on[name] for name in largest if name not in driven))
    known = {effect.at for effect in system.effects if effect.kind == CoulombFriction.kind}
    turns = {place: speed_ratios(place, joints(system)) for place in places}
    beds = [system]
    for share in settings.friction:
        effects = []
        for place in places:  # torques that act on it, as it feels them
            felt = [largest[name] * abs(turns[place].get(on[name], 0.0)) for name in largest]
            size = Quantity(share * max(felt, default=0.0))
            if f"inertias.{place}" not in known and size.value > 0:
                effects.append(Effect(CoulombFriction.kind, f"inertias.{place}", (("torque", size),)))
        beds += [system.with_effects(*effects)] if effects else []
    return beds


def check_channels(
    case: Case, record: Callable[[Mapping[str, tuple[str, float]]], tuple[Recording, str]],
    settings: ChannelSettings = CHANNELS,
) -> ChannelCheck:  # fmt: skip
    """Record and judge the channels; after a trip that a wrong channel explains, again with its reading mended.

    A trip ends a recording that would tell what else is wrong.

    Parameters
    ----------
    record : callable
        Is given ``known`` of :func:`channel_recording`; returns the recording, and what ended it early.
    """
    known: dict[str, tuple[str, float]] = {}
    for _ in range(settings.most):
        recording, tripped = record(known)
        found = judge_channels(case, recording, tripped, settings)
        if not tripped or not found.wrong or not found.carried.items() - known.items():
            break
        known |= found.carried
    return found


def judge_channels(
    case: Case, recording: Recording, tripped: str = "", settings: ChannelSettings = CHANNELS,
) -> ChannelCheck:  # fmt: skip
    """Judge the channels by a recording of planned pulses, from rest.

    Parameters
    ----------
    recording : Recording
        Torque commands of all inputs and any sensors of the rig; it begins at rest before the first pulse.
    tripped : str
        What ended the recording early.

    Raises
    ------
    InputError
        If an input is missing, or no pulse is in the recording.
    """
    system, step = bed_system(case), case.loop["sample_time"]
    inputs, driven = bed_inputs(case), len(case.loop.dynamometers)
    missing = [name for name in inputs if name not in recording.channels]
    if missing:
        raise InputError(f"{recording.source}", f"does not hold {listed(missing)}", "record every torque command")
    sensors = [sensor for sensor in case.rig.sensors if sensor.name in recording.channels]
    time = np.arange(recording.time[0], recording.time[-1] + step / 2, step)
    sent = np.stack([np.interp(time, recording.time, recording[name]) for name in inputs], axis=1)
    read = np.stack([_at(time, recording, sensor.name) for sensor in sensors], axis=1)
    windows, together, lead = _windows(sent, settings, step, recording.source)
    rest = read[:lead]
    steps = np.array([resolution(recording[one.name][np.isfinite(recording[one.name])]) for one in sensors])
    zero, noise = np.nanmean(rest, axis=0), np.maximum(np.nanstd(rest, axis=0), steps / np.sqrt(12))
    acted = [j for j, window in enumerate(windows) if window is not None]
    run = _Run(
        sent, read, tuple(window for window in windows if window is not None), together, tuple(acted), noise,
        [sensor.measures for sensor in sensors], step,
    )  # fmt: skip
    names = [sensor.name for sensor in sensors]
    moved = [inputs[j] for j in acted]
    reached = _too_fast(case, names, read) if tripped or together is None else {}
    if reached and not tripped:
        tripped = f"overspeed ({listed([f'{name} reads {value:.3g} rad/s' for name, value in reached.items()])})"
    alone = sum(j < driven for j in acted)
    only = {*reached, moved[-1]} if tripped else None  # little is seen until a trip: what led to it, and nothing else
    # until a torque has run through the shafts, play and friction beyond them do not matter
    acting = np.flatnonzero(sent[windows[acted[-1]], acted[-1]])  # type: ignore[index]
    lengths = [int(np.ptp(acting)) + round(settings.early / step), None] if tripped else [None]
    findings: list[_Finding] = []
    largest = {name: float(np.abs(sent[:, j]).max()) for j, name in enumerate(inputs)}
    for of_bed in _as_it_may_be(system, case, largest, settings):
        with contextlib.suppress(SimulationError):
            done = simulate(
                compiled(of_bed), time - time[0], dict(zip(inputs, sent.T, strict=True)), sensors=names,
                tolerance=settings.inexact,
            )  # fmt: skip
            model = np.stack([done[name] for name in names], axis=1)
            for most in lengths:
                blocks = run.blocks(model, settings, most, findings[0].model if findings else None)
                findings.append(_found(blocks, model, run.quantities, names, moved, alone, only, settings))
                if findings[-1].clear:
                    break
        if findings and findings[-1].clear:
            break
    if not findings:
        raise InputError(recording.source, "holds torques that the model cannot follow", "check inertias and shafts")
    best = min(findings, key=lambda one: one.score(settings.largest))
    units = {sensor.name: sensor.unit for sensor in case.rig.sensors}
    blocks, wiring, wrong, unlike, model = best.blocks, best.wiring, best.wrong, best.unlike, best.model
    if best.model is not findings[0].model:  # friction holds the bed: what little a motor moves says no sign of it
        wrong = [replace(one, certain=one.certain and one.channel not in inputs[driven:]) for one in wrong]
    found, off, plays = None, list[Deviation](), list[LostMotion]()
    clipped = _clipped(time, read, zero, noise, steps, names, units, settings)
    if not tripped and not clipped:
        found, wiring, wrong = _measured(
            case, system, time, sent, read, lead, names, moved, inputs, best, wrong, settings
        )
    explained = found is not None and found.misfit <= DEVIATIONS.explained
    commands, readings = _mended(sent, read, names, moved, inputs, wiring)
    edges: tuple[Deviation, ...] = ()
    if not tripped and not clipped and not explained:
        edges = delays_at_edges(case, system, time - time[0], commands, readings)
        if not any(one.kind == "stuck" for one in wrong):
            mended = replace(recording, time=time, channels=commands | readings)
            plays, played = _plays(case, edges, mended, commands, readings, lead, settings)
            explained = played is not None and played.misfit <= DEVIATIONS.explained
            found = played if explained else found
    if found is not None and explained:
        unlike = []
        wrong, off = _with_factors(case, found, wiring, names, run.quantities, wrong, settings)
    # free play that is not found exactly: its dynamometers may be late all the same
    measured = found.quantities if found is not None and explained else edges
    off = off if explained else [one for one in edges if one.beyond]
    if clipped:  # its answer is too small for whatever the bed is: nothing else is said by it
        wrong, unlike = [one for one in wrong if one.plain and one.channel not in clipped], []
    open_ = [one for one in wrong if not one.certain]
    wrong = [*clipped.values(), *(one for one in wrong if one.certain)]
    uncertain = noise / np.sqrt(max(lead, 1))
    channels = []
    for i, sensor in enumerate(sensors):
        limit = _zero_limit(case, sensor.uncertainty, sensor.measures, model[:, i], settings)
        value = zero[i] / (wiring.factors[i] or 1.0)
        if sensor.measures != "angle" and abs(value) - 3 * uncertain[i] > limit and np.isfinite(limit):
            size = f"{value:.3g} {units[sensor.name]}"
            wrong.append(replace(fault("zero", sensor.name, size=size), size=float(value)))
        told = "; ".join(one.words for one in wrong if one.channel == sensor.name)
        gain = None if found is None else found.get(f"sensors.{names[wiring.outputs[i]]}.gain")
        channels.append(
            CheckedChannel(
                sensor.name, sensor.measures, units[sensor.name], *_told(gain, wiring.factors[i]), None, None,
                float(zero[i]), float(uncertain[i]), float(noise[i]), told,
            )
        )  # fmt: skip
    own = {one.torque_input: f"dynamometers.{one.name}" for one in case.loop.dynamometers}
    for name in inputs:
        told = "; ".join(one.words for one in (*wrong, *open_) if one.channel == name)
        of = ("torque_gain", "dead_time") if name in own else ("gain", "delay")
        gain, late = (None if found is None else found.get(f"{own.get(name, f'inputs.{name}')}.{key}") for key in of)
        later: tuple[float | None, float | None] = (None, None)
        if late is not None and late.told and (gain is None or abs(gain.value) > settings.nothing):
            later = (late.value - late.stated, late.uncertainty)
        channels.append(CheckedChannel(name, "torque", "N*m", *_told(gain, 1.0), *later, words=told))
    speeds = [names.index(one.speed_sensor) for one in case.loop.dynamometers if one.speed_sensor in names]
    fastest = float(np.nanmax(np.abs(read[:, speeds]), initial=0.0))
    alike = tuple((names[i], names[k]) for i, k in blocks.alike())
    whole = blocks.strong[: len(moved) - bool(tripped), : len(names)]  # of torques that were not cut off
    judged = {names[i] for i in np.flatnonzero(whole.any(axis=0))}
    judged |= {moved[j] for j in np.flatnonzero(whole.any(axis=1))}
    judged |= {one.channel for one in (*wrong, *open_)}
    judged -= best.strange - {one.channel for one in wrong}
    unjudged = [name for name in (*names, *inputs) if name not in judged]
    needed = [name for name in unjudged if name in {*case.loop.controller_sensors, *inputs[:driven]}]
    return ChannelCheck(
        tuple(channels), tuple(wrong), tuple(name for name in unlike if name in judged), alike, tuple(open_), fastest,
        tripped, tuple(unjudged), tuple(needed), tuple(off), measured, explained,
        tuple(plays), _shown(time, names, read - zero, wrong, found, wiring, model),
        {} if open_ else _carried(names, wiring),
        None if tripped or any(one.kind in ("stuck", "clipped") for one in wrong) else replace(
            recording, time=time, channels=commands | readings
        ),
    )  # fmt: skip


def _clipped(
    time: np.ndarray, read: np.ndarray, zero: np.ndarray, noise: np.ndarray, steps: np.ndarray, names: Sequence[str],
    units: Mapping[str, str], settings: ChannelSettings,
) -> dict[str, ChannelFault]:  # fmt: skip
    """Sensors that stay at the end of their range, away from their value at rest, while a torque moves the bed."""
    found = {}
    for i, name in enumerate(names):
        # equal values are no chance where noise is wider than a step, however short they last
        shortest = 0.0 if noise[i] > settings.noisy * steps[i] else CORRECTIONS.longest_constant
        ends = {
            float(read[first, i]) for first, _, kind in kept_values(read[:, i], time, shortest) if kind == "clipped"
        }
        beyond = [end for end in ends if abs(end - zero[i]) > settings.over_noise * noise[i]]
        if beyond:
            said = " and ".join(f"{end:.4g} {units[name]}" for end in sorted(beyond))
            found[name] = fault("clipped", name, size=f", {said}", value=max(map(abs, beyond)))
    return found


def _told(one: Deviation | None, factor: float) -> tuple[float | None, float | None]:
    """Gain of a channel and its uncertainty, with the factor that it was read with."""
    return (None, None) if one is None else (one.value * factor, abs(one.uncertainty * factor))


def _mended(
    sent: np.ndarray, read: np.ndarray, names: list[str], moved: list[str], inputs: Sequence[str], wiring: _Wiring
) -> tuple[dict[str, np.ndarray], dict[str, np.ndarray]]:
    """Commands and readings by name as they are at the places where they belong; the sign of a command alone."""
    truth, commands = dict[str, np.ndarray](), dict(zip(inputs, sent.T, strict=True))
    for i, (place, factor) in enumerate(zip(wiring.outputs, wiring.factors, strict=True)):
        if factor:
            truth[names[place]] = read[:, i] / factor
    for j, (place, gain) in enumerate(zip(wiring.inputs, wiring.gains, strict=True)):
        commands[moved[place]] = sent[:, inputs.index(moved[j])] * (np.sign(gain) or 1.0)
    return commands, truth


def _carried(names: Sequence[str], wiring: _Wiring) -> dict[str, tuple[str, float]]:
    """See :attr:`ChannelCheck.carried`; a channel that stands still carries nothing."""
    pairs = zip(names, wiring.outputs, wiring.factors, strict=True)
    found = {names[place]: (name, factor) for name, place, factor in pairs if factor}
    return {name: told for name, told in found.items() if told != (name, 1.0)}


def _measured(
    case: Case, system: System, time: np.ndarray, sent: np.ndarray, read: np.ndarray, lead: int, names: list[str],
    moved: list[str], inputs: Sequence[str], best: _Finding, wrong: list[ChannelFault], settings: ChannelSettings,
) -> tuple[Deviations | None, _Wiring, list[ChannelFault]]:  # fmt: skip
    """What the recording measures of the bed, with the wrong channels mended; as recorded where that explains it.

    Neighbours on a shaft answer so much alike that their answers alone, beside another defect, do not tell whether they
    are exchanged. The fit does.
    """
    right, wiring = best.blocks.right(), best.wiring

    def parts(own: _Wiring) -> tuple[Any, ...]:
        return case, system, time - time[0], *_mended(sent, read, names, moved, inputs, own), lead

    begun = begun_fit(*parts(wiring))
    if begun is not None:
        before, begun = begun.cost, begun.released() if begun.misfit > DEVIATIONS.right else begun
        for i, k in best.neighbours(settings) if begun.misfit > DEVIATIONS.right else ():
            if begun.run.over:
                break
            other = wiring.exchanged("outputs", i, k)
            rival = begun_fit(*parts(other))
            if rival is None or rival.cost > settings.rival * before:
                continue
            # where nothing is released, as with free play, an exchange shows at once or not at all
            rival = rival.released() if begun.rivals else rival
            told = rival.measured() if rival.cost * DEVIATIONS.nearly < begun.cost else None
            if told is not None and told.misfit <= DEVIATIONS.right:
                pair = (fault("exchanged", names[i], names[k]), fault("exchanged", names[k], names[i]))
                return told, other, [*wrong, *pair]
    found = None if begun is None else begun.measured()
    if wrong and wiring != right and (found is None or found.misfit > DEVIATIONS.explained):
        as_recorded = deviations(*parts(right))
        if as_recorded is not None and as_recorded.misfit <= DEVIATIONS.explained:
            return as_recorded, right, []
    return found, wiring, wrong


def _plays(
    case: Case, edges: Sequence[Deviation], mended: Recording, commands: Mapping[str, np.ndarray],
    readings: Mapping[str, np.ndarray], lead: int, settings: ChannelSettings,
) -> tuple[list[LostMotion], Deviations | None]:  # fmt: skip
    """Free play that a recording shows, one shaft after another, and what it measures with it in the model."""
    plays, found, time = list[LostMotion](), None, mended.time - mended.time[0]
    searched, playing = measured_case(case, edges)[0], case
    begin: Mapping[str, float] = {}
    share = DEVIATIONS.part
    for _ in range(settings.plays):
        seen = lost_motion(searched, mended, share=share, begin=begin)
        if seen is None:
            break
        plays.append(seen)
        searched, playing = with_free_play(searched, seen), with_free_play(playing, seen)
        again = deviations(playing, bed_system(playing), time, commands, readings, lead, begin=seen.values)
        if again is None:
            break
        found, begin = again, again.coordinates
        plays = [replace(one, gap=begin[f"{one.at}.gap"]) for one in plays]
        if found.share == 1:
            break
        share = min(found.share + DEVIATIONS.stride, 1.0)
    told = found is not None and found.share >= DEVIATIONS.least_part
    return plays, found if told else None


def _with_factors(
    case: Case, found: Deviations, wiring: _Wiring, names: list[str], quantities: Sequence[str],
    wrong: list[ChannelFault], settings: ChannelSettings,
) -> tuple[list[ChannelFault], list[Deviation]]:  # fmt: skip
    """Faults with the factors of a bed that is explained, and what else of it lies beyond its tolerance.

    A factor beyond :attr:`ChannelSettings.stops`, or a usual conversion within the uncertainty, is a wrong channel.
    """
    driven = {f"dynamometers.{one.name}.torque_gain": one.torque_input for one in case.loop.dynamometers}
    kept, off = list(wrong), list[Deviation]()
    for one in found.quantities:
        table, *middle, key = one.name.split(".")
        if key not in ("gain", "torque_gain"):
            off += [one] if one.beyond else []
            continue
        channel, quantity, before, giver = driven.get(one.name, ".".join(middle)), "torque", 1.0, ""
        if table == "sensors":
            i = wiring.outputs.index(names.index(channel))
            channel, quantity, before = names[i], quantities[i], wiring.factors[i]
        else:
            giver = "its dynamometer" if one.name in driven else "what gives it"
        named = [own for own in kept if own.channel == channel and own.kind in ("factor", "stuck")]
        if not (one.beyond or named):
            continue
        kept = [own for own in kept if own not in named]
        factor = one.value * before
        within = DEVIATIONS.coverage * one.uncertainty / max(abs(one.value), 1e-12) + one.tolerance
        if giver and abs(factor) < settings.nothing:
            kept.append(fault("stuck", channel, giver=giver))
        elif (not giver and conversion(factor, quantity, within)) or not 1 < settings.stops * abs(
            factor
        ) < settings.stops**2:
            kept.append(factor_fault(channel, quantity, factor, within, abs(one.uncertainty * before), giver))
        elif one.beyond:
            off.append(one)
    return kept, off


def _shown(
    time: np.ndarray, names: list[str], read: np.ndarray, wrong: Sequence[ChannelFault], found: Deviations | None,
    wiring: _Wiring, model: np.ndarray,
) -> dict[str, np.ndarray]:  # fmt: skip
    """The recording of wrong sensors next to what they should read."""
    shown = {"time": time - time[0]}
    for name in dict.fromkeys(one.channel for one in wrong if one.channel in names):
        i = names.index(name)
        fitted = None if found is None or not found.readings else found.readings.get(name)
        shown |= {name: read[:, i], f"{name} model": model[:, i] if fitted is None else fitted}
    return shown


def _too_fast(case: Case, names: Sequence[str], read: np.ndarray) -> dict[str, float]:
    """Speeds of dynamometers that read more than the check allows, and the most that they read, rad/s."""
    limit = CHECK_SPEED_SHARE * case.limits.get("dynamometer_speed", NO_LIMIT)
    own = [one.speed_sensor for one in case.loop.dynamometers if one.speed_sensor in names]
    largest = {name: float(np.nanmax(np.abs(read[:, names.index(name)]))) for name in own}
    return {name: value for name, value in largest.items() if value > limit}


def _at(time: np.ndarray, recording: Recording, name: str) -> np.ndarray:
    """A channel (t,) at other times."""
    values = recording[name]
    there = np.isfinite(values)
    if not there.any():
        raise InputError(f"{recording.source}: {name}", "has no value", "connect the sensor, or leave the channel out")
    return np.interp(time, recording.time[there], values[there])


def _windows(
    sent: np.ndarray, settings: ChannelSettings, step: float, source: str
) -> tuple[list[slice | None], slice | None, int]:
    """Samples in which every input (u) acts alone, those in which all act, and how many are at rest before."""
    moving = np.abs(sent) > 0.05 * np.maximum(np.abs(sent).max(axis=0), 1e-12)
    if not moving.any():
        raise InputError(source, "holds no torque", "add the torques of the plan, and record the commands")
    lead, tail = int(np.argmax(moving.any(axis=1))), round(settings.rests[0] / step)
    alone = moving & (moving.sum(axis=1) == 1)[:, None]
    several = np.flatnonzero(moving.sum(axis=1) > 1)
    windows: list[slice | None] = []
    for j in range(sent.shape[1]):
        at = np.flatnonzero(alone[:, j])
        first = int(at[0]) if len(at) else 0
        windows.append(slice(max(first - 1, 0), min(int(at[-1]) + tail, len(sent))) if len(at) > 3 else None)
    together = slice(max(int(several[0]) - 1, 0), min(int(several[-1]) + tail, len(sent))) if len(several) > 3 else None
    if lead < 10 or not any(windows):
        raise InputError(
            source,
            "does not begin at rest, or no torque acts alone",
            "record the torques of the plan from before they begin",
        )
    return windows, together, lead


@dataclass(frozen=True)
class _Finding:
    """What one model of the bed makes of a recording."""

    blocks: _Blocks
    wiring: _Wiring
    wrong: list[ChannelFault]
    unlike: list[str]
    strange: set[str]  # of those unlike, the ones that answer altogether otherwise
    steps: int
    left: float  # sum of the misfits
    model: np.ndarray  # readings (t, y)

    def score(self, largest: float) -> tuple[float, ...]:
        """Of findings that leave no channel unlike, the one that names fewest, and those plainly; else each channel
        named counts as an answer that is altogether wrong."""
        if self.unlike:
            return 1.0, self.left + largest * self.steps
        return 0.0, self.steps, sum(not one.plain for one in self.wrong), self.left

    def neighbours(self, settings: ChannelSettings) -> Iterator[tuple[int, int]]:
        """Pairs of outputs whose exchange, on top of what is wrong, leaves answers as like the model as they are."""
        for i, k in self.blocks.pairs:
            other = self.wiring.exchanged("outputs", i, k)
            answers = np.where(self.blocks.changed(self.wiring, other), self.blocks.misfits(other), 0.0)
            if answers.max(initial=0.0) <= settings.wrong:
                yield i, k

    @property
    def clear(self) -> bool:
        """Whether nothing is left open that friction may explain: all is like the model, or but for one channel."""
        return not self.unlike and self.steps <= 1 and all(one.plain for one in self.wrong)


def _found(
    blocks: _Blocks, model: np.ndarray, quantities: Sequence[str], outputs: Sequence[str], inputs: Sequence[str],
    driven: int, only: Collection[str] | None, settings: ChannelSettings,
) -> _Finding:  # fmt: skip
    """One wrong channel after another, the one that explains most first, until the answers are those of the model.

    With ``only``, one of these channels, alone or exchanged with another.
    """
    wiring, wrong, steps = blocks.right(), list[ChannelFault](), 0
    for _ in range(settings.most if only is None else 1):
        left = blocks.misfits(wiring)
        if left.max(initial=0.0) <= settings.wrong:
            break
        tried = []
        for n, (other, words) in enumerate(_hypotheses(blocks, wiring, quantities, outputs, inputs, driven)):
            if only is not None and not any(one.channel in only for one in words):
                continue
            own = blocks.changed(wiring, other)
            worst = float(np.where(own, left, 0.0).max(initial=0.0))
            if worst <= settings.wrong:
                continue
            after = blocks.misfits(other)
            mended = float(np.where(own, after, 0.0).max(initial=0.0)) <= settings.wrong
            share = settings.better if mended else settings.mended
            if (after * own).sum() <= share * (left * own).sum():
                tried.append((float(after.sum()), n, other, words))
        if not tried or min(tried)[0] >= left.sum():
            break
        _, _, wiring, words = min(tried)
        wrong += words
        steps += 1
    left = blocks.misfits(wiring)
    far = dict(zip(outputs, left[:, : len(outputs)].max(axis=0, initial=0.0), strict=True))
    unlike, strange = ([name for name in far if far[name] > limit] for limit in (settings.wrong, settings.strange))
    if unlike:  # a torque that seems to act otherwise is certain only if that explains everything
        wrong = [replace(one, certain=one.certain and one.channel not in inputs) for one in wrong]
    return _Finding(
        blocks, wiring, wrong, unlike, set(strange),
        steps, float(left.sum()), model,
    )  # fmt: skip


def _zero_limit(
    case: Case, uncertainty: float | None, quantity: str, model: np.ndarray, settings: ChannelSettings
) -> float:
    """Largest reading at rest, SI, that counts as none."""
    if uncertainty:
        return settings.offset_ratio * uncertainty
    limit = case.limits_of("torque").min() if quantity == "torque" else case.limits.get("dynamometer_speed", np.inf)
    return settings.offset_share * float(limit if limit < np.inf else np.ptp(model))
