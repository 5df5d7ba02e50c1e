"""Whether a bed with free play in its cut shafts comes to rest as its vehicle does, in time."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from matching.match.beds import noise_of_sensors
from matching.match.case import Case
from matching.match.exported import exported_controller
from matching.match.imperfections import (
    HOLD_S,
    BedMotion,
    BedRun,
    Imperfection,
    bed_motions,
    vehicle_motions,
    with_cut_sensors,
)
from matching.match.judgements import Judgement
from matching.match.loop import linear_bed
from matching.match.targets import target_modes
from matching.match.verify import manoeuvre_torques
from modelling.controller.law import ExportedController
from modelling.errors import NoDesign
from modelling.fidelity.over_range import REST, at_rest
from modelling.modal.modes import damped_modes
from modelling.running.controllers import unsupervised
from modelling.simulation.stepping import SimulationError


@dataclass(frozen=True)
class FreePlay:
    """How beds with free play are judged in time.

    Attributes
    ----------
    gaps : (float, float)
        rad, whole lash of every shaft at the cut: of a drive from new (0.5°) to worn (5°).
    drawn : int
        Beds drawn from the case's box with drawn gaps: where none of thirty swings on, fewer than 10 % of all beds do
        (95 %).
    as_planned : int
        Runs of the bed as planned, from the least gap to the largest: a swing grows with its gap.
    pulse : (float, float)
        s, begin and end of the torque that closes the gap and then leaves it open, from the begin of emulation on.
    decayed : float
        A run lasts as long as the slowest target mode needs to decay to this share.
    shortest, longest : float
        s, of a run. One that is neither at rest at its end nor swings on evenly is run twice as long, up to the
        longest.
    periods, window : int, float
        The swing is taken over whole periods of the slowest target mode at the end of a run, at least so many, and at
        least so long (s): over less it depends on the phase.
    rest : float
        Of the range of the vehicle's signal, by which the bed's may swing more than the vehicle's: what swings by less
        is below what a response error of 0.1 allows. What the dynamometer's sensor cannot tell from rest
        (:class:`modelling.fidelity.over_range.RestSettings`) is no swing either.
    falling : float
        Swing at the end over that in the middle of the run, below which a bed is still coming to rest. Chosen by
        trial: a limit cycle keeps its swing within 5 %, and the slowest decay that was met leaves 0.6.
    """

    gaps: tuple[float, float] = (float(np.radians(0.5)), float(np.radians(5.0)))
    drawn: int = 27
    as_planned: int = 3
    pulse: tuple[float, float] = (0.2, 0.3)
    decayed: float = 0.02
    shortest: float = 5.0
    longest: float = 40.0
    periods: int = 3
    window: float = 0.5
    rest: float = 0.02
    falling: float = 0.8


FREE_PLAY = FreePlay()


@dataclass(frozen=True)
class Period:
    """The slowest target mode: s of a period, and s in which it decays to the share that ends a run."""

    seconds: float
    decay: float


def slowest_period(case: Case, settings: FreePlay = FREE_PLAY) -> Period:
    """Of a case's target modes; without targets of the emulated vehicle's modes within the band."""
    modes = [damped for _, damped in target_modes(case)] or [
        mode for mode in damped_modes(case.emulated_vehicle) if case.band[0] <= mode.frequency <= case.band[1]
    ]
    modes = [mode for mode in modes if mode.frequency > 0]
    if not modes:
        return Period(settings.window, settings.shortest)
    slowest = min(modes, key=lambda mode: mode.frequency)
    rate = 2 * np.pi * slowest.frequency * max(slowest.damping_ratio, 1e-6)
    return Period(1 / slowest.frequency, float(np.log(1 / settings.decayed) / rate))


@dataclass(frozen=True)
class OpenLash:
    """What lashes do on the bed as planned and on drawn ones.

    Attributes
    ----------
    drawn, limit_cycles : int
        ``limit_cycles`` swing on where the vehicle comes to rest, or are not stable.
    largest_swing, vehicle_swing : float
        N·m rms of the torque at a cut over the last periods, of the worst bed and of the vehicle next to it.
    largest_motion, vehicle_motion : float
        rad/s rms of the speed at a cut over the same, without its trend.
    seconds : float
        Of the longest run.
    allowed : float
        N·m rms that the worst bed may swing.
    """

    drawn: int
    limit_cycles: int
    largest_swing: float
    vehicle_swing: float
    largest_motion: float = 0.0
    vehicle_motion: float = 0.0
    seconds: float = 0.0
    allowed: float = 0.0
    settings: FreePlay = field(default=FREE_PLAY, repr=False)

    @property
    def limits(self) -> bool:
        """Whether free play keeps beds from coming to rest."""
        return self.limit_cycles > 0

    @property
    def judgement(self) -> Judgement | None:
        """What is not kept; None where all beds come to rest."""
        if not self.limits:
            return None
        return Judgement(
            "free_play", self.largest_swing, self.allowed, "N*m", "torque at a cut after a pulse", self.limit_cycles,
            self.drawn, "limits.opened_shafts",
        )  # fmt: skip

    def to_dict(self) -> dict[str, Any]:
        """As ``result.json`` holds it; None for a swing that grows out of bounds."""
        return {
            name: value if np.isfinite(value) else None for name, value in vars(self).items() if name != "settings"
        }  # fmt: skip

    def words(self) -> str:
        """What the beds do."""
        low, high = np.degrees(self.settings.gaps)
        said = (
            f"{self.limit_cycles or 'none'} of {self.drawn} beds with {low:.2g}° to {high:.2g}° of free play in the "
            "cut shafts, as planned and drawn, "
        )
        if not self.limit_cycles:
            return (
                f"{said}swings on after a pulse by more than {self.settings.rest:.0%} of the range of the vehicle's "
                f"torque; the largest swing left is {self.largest_swing:.2g} N·m rms"
            )
        if not np.isfinite(self.largest_swing):
            return f"{said}swing on after a pulse, and at least one of them grows out of bounds"
        return f"{said}swing on after a pulse, by up to {self.largest_swing:.3g} N·m rms"


def lash_runs(
    case: Case, torques: Mapping[str, np.ndarray], known: tuple[str, ...], seed: int, settings: FreePlay = FREE_PLAY
) -> list[BedRun]:
    """A pulse at the input of the rig that the manoeuvre drives hardest, on drawn beds with drawn gaps.

    ``torques`` are those of the manoeuvre, (t,) in N·m by input.
    """
    pulse = pulse_at_hardest(case, torques, len(next(iter(torques.values()))))
    if not pulse:
        return []
    gaps = np.random.default_rng(seed).uniform(*settings.gaps, settings.drawn)
    beds = case.uncertainty.draw(settings.drawn, seed + 1)
    return [
        BedRun(Imperfection("open lash", case.uncertainty.at(bed), float(gap)), pulse, known)
        for bed, gap in zip(beds, gaps, strict=True)
    ]  # fmt: skip


def pulse_at_hardest(case: Case, torques: Mapping[str, np.ndarray], count: int) -> dict[str, np.ndarray]:
    """A pulse (t,) at the input of the rig that a manoeuvre drives hardest; empty without such an input."""
    driven = {dynamometer.torque_input for dynamometer in case.loop.dynamometers}
    made = {name: float(np.abs(case.torque_made(name, torque)).max()) for name, torque in torques.items()}
    sizes = {part.name: made.get(part.name, 0.0) for part in case.rig.inputs if part.name not in driven}
    if not sizes:
        return {}
    name, time = max(sizes, key=lambda name: sizes[name]), np.arange(count) * case.loop["sample_time"]
    size = max(made.values()) if not sizes[name] else sizes[name]
    if name in case.rig.pedals:  # as pressed in the manoeuvre, else the whole way
        size = float(np.abs(torques[name]).max()) if sizes[name] else 1.0
    return {name: size * ((time >= FREE_PLAY.pulse[0]) & (time < FREE_PLAY.pulse[1]))}


@dataclass(frozen=True)
class _Swings:
    """Of one bed over the last periods: swings of torques and speeds (s,), what is allowed, and in mid-run."""

    bed: np.ndarray
    vehicle: np.ndarray
    allowed: np.ndarray
    middle: np.ndarray

    def state(self, settings: FreePlay) -> str:
        """``rests``, ``falls`` or ``swings``."""
        above = self.bed > self.allowed
        if not np.isfinite(self.bed).all():
            return "swings"
        if not above.any():
            return "rests"
        return "falls" if (self.bed[above] < settings.falling * self.middle[above]).all() else "swings"


def _swings(
    vehicle: np.ndarray, bed: np.ndarray | None, count: int, torques: int, settings: FreePlay,
    unseen: np.ndarray | float = 0.0,
) -> _Swings:  # fmt: skip
    """Of a vehicle (t, s) and a bed (t, s), of which the first are torques; ``count`` samples of whole periods.

    A signal that the pulse leaves at rest is held against the largest range of its kind; ``unseen`` (s,) is the rms of
    a swing that no sensor tells from rest.
    """
    own, span = swing(vehicle[-count:]), np.ptp(vehicle, axis=0)
    for kind in (slice(None, torques), slice(torques, None)):
        span[kind] = np.where(at_rest(vehicle[:, kind]), span[kind].max(initial=0.0), span[kind])
    allowed = own + np.maximum(settings.rest * span, unseen)
    if bed is None:
        nothing = np.full(len(own), np.inf)
        return _Swings(nothing, own, allowed, nothing)
    half = len(bed) // 2
    return _Swings(swing(bed[-count:]), own, allowed, swing(bed[half - count : half]))


def swing(signals: np.ndarray) -> np.ndarray:
    """Standard deviation (s,) of signals (t, s) about their straight trend: a vehicle that rolls out does not swing."""
    time = np.linspace(-1.0, 1.0, len(signals))
    trend = (time @ signals) / (time @ time)
    return np.std(signals - time[:, None] * trend, axis=0)


def open_lash(
    vehicles: Sequence[np.ndarray], beds: Sequence[BedMotion | None], at: Sequence[int], step: float,
    period: float = 0.0, settings: FreePlay = FREE_PLAY,
) -> OpenLash:  # fmt: skip
    """Judge vehicles (t, y) and beds of lashes by the readings ``at``, torques at the cuts; ``step``, ``period`` in s.

    What still falls at the end of its run counts as coming to rest.
    """
    count = min(window_samples(period, step, settings), len(vehicles[0]) // 4)
    each = [
        _swings(vehicle[:, at], None if bed is None else bed.readings[:, at], count, len(at), settings)
        for vehicle, bed in zip(vehicles, beds, strict=True)
    ]
    return _judged(each, [one.state(settings) == "swings" for one in each], len(at), len(vehicles[0]) * step, settings)


def window_samples(period: float, step: float, settings: FreePlay = FREE_PLAY) -> int:
    """Samples of whole periods (s) over which a swing is taken."""
    if period <= 0:
        return round(settings.window / step)
    whole = max(settings.periods, int(np.ceil(settings.window / period)))
    return round(whole * period / step)


def _judged(
    each: Sequence[_Swings], on: Sequence[bool], torques: int, seconds: float, settings: FreePlay
) -> OpenLash:  # fmt: skip
    """The worst of all beds: among those that swing on, if any; by torque first."""
    count = sum(on)
    chosen = [one for one, swings in zip(each, on, strict=True) if swings or not count]
    worst = max(chosen, key=lambda one: float((one.bed - one.vehicle)[:torques].max()))
    at = int((worst.bed - worst.vehicle)[:torques].argmax())
    motion = (0.0, 0.0)
    if len(worst.bed) > torques:
        further = torques + int((worst.bed - worst.vehicle)[torques:].argmax())
        motion = float(worst.bed[further]), float(worst.vehicle[further])
    return OpenLash(
        len(each), count, float(worst.bed[at]), float(worst.vehicle[at]), *motion, seconds, float(worst.allowed[at]),
        settings,
    )  # fmt: skip


def _unseen(case: Case) -> np.ndarray:
    """rms (s,) of swings of torques and speeds at the cuts that the dynamometers' sensors cannot tell from rest."""
    by_cut = {one.follows: one for one in case.loop.dynamometers}
    ones = [by_cut[cut.shaft] for cut in case.residual_vehicle.interfaces]
    torques = [0.0 if one.torque_sensor is None else noise_of_sensors(case, [one.torque_sensor])[0] for one in ones]
    speeds = [noise_of_sensors(case, [one.speed_sensor])[0] for one in ones]
    of_sine = 2 * np.sqrt(2)  # range over rms
    unseen: np.ndarray = REST.uncertainties / of_sine * np.array([*torques, *speeds])
    return unseen


def lashes(case: Case, seed: int = 0, settings: FreePlay = FREE_PLAY) -> OpenLash | None:
    """What free play in the cut shafts does on a tuned case's bed as planned and on drawn ones, in time.

    None where the controller gives no torque, where no input but the dynamometers' could move the bed, and where a
    bed or vehicle cannot be simulated.
    """
    if case.loop.torqueless:
        return None
    try:
        return played(case, unsupervised(exported_controller(case)), seed, settings)
    except (NoDesign, SimulationError):
        return None


def played(
    case: Case, controller: ExportedController, seed: int = 0, settings: FreePlay = FREE_PLAY
) -> OpenLash | None:  # fmt: skip
    """:func:`lashes` of a controller; None where no input but the dynamometers' could move the bed.

    Raises
    ------
    SimulationError
        If a vehicle cannot be simulated.
    """
    torques, _ = manoeuvre_torques(linear_bed(case))
    largest = {name: float(np.abs(torque).max()) for name, torque in torques.items()}
    period, step = slowest_period(case, settings), controller.law.sample_time
    seconds = float(np.clip(settings.pulse[1] + period.decay, settings.shortest, settings.longest))
    case, torque_names, speed_names = with_cut_sensors(case)
    sensors = [*torque_names, *speed_names]
    known = tuple(name for name in controller.law.known if name in {part.name for part in case.rig.inputs})
    gaps = [Imperfection("open lash", gap=float(gap)) for gap in np.geomspace(*settings.gaps, settings.as_planned)]
    count, unseen = window_samples(period.seconds, step, settings), _unseen(case)
    ended: dict[int, _Swings] = {}
    on: dict[int, bool] = {}
    left: list[int] | None = None
    while left is None or left:
        whole = {name: np.full(round(seconds / step), size) for name, size in largest.items()}
        runs = lash_runs(case, whole, known, seed, settings)
        if not runs:
            return None
        runs += [BedRun(each, runs[0].torques, known) for each in gaps]
        left = list(range(len(runs))) if left is None else left
        chosen = [runs[number] for number in left]
        vehicles = vehicle_motions(case, chosen, sensors)
        beds = bed_motions(case, controller, chosen, sensors, seed, HOLD_S)
        again = []
        for number, vehicle, bed in zip(left, vehicles, beds, strict=True):
            ended[number] = _swings(
                vehicle, None if bed is None else bed.readings, count, len(torque_names), settings, unseen
            )
            state = ended[number].state(settings)
            on[number] = state == "swings"
            if state == "falls" and seconds < settings.longest:
                again.append(number)
        left, last = again, seconds
        seconds = min(2 * seconds, settings.longest)
    order = sorted(ended)
    return _judged([ended[n] for n in order], [on[n] for n in order], len(torque_names), last, settings)
