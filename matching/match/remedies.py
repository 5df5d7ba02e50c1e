"""What would make a limited match a match: single changes of the case, each solved and judged, the smallest first.

Nothing is recommended that was not run. Which changes are tried follows from what limits the match.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from matching.match.box import Box, Uncertain
from matching.match.case import Case, apply
from matching.match.findings import counts_of
from matching.match.requirements import OPENED_SHAFTS, TORQUE_OVER_SPEED
from matching.match.result import MatchResult, Remedy
from modelling.bed.bed import predicted_part
from modelling.bed.observer import sensor_noise
from modelling.errors import InputError, NoDesign
from modelling.simulation.stepping import SimulationError
from modelling.system import Sensor


@dataclass(frozen=True)
class RemedySettings:
    """How far changes go, and how many are tried.

    Attributes
    ----------
    factors : tuple of float
        By which a quantity is made better, the smallest first: each is what the next class of part has. The largest is
        tried first: where that does not do, none does.
    above : tuple of float
        Relative, above the error that was found, of the tolerances that are tried: each is a whole match. The search
        keeps the first one by its reserve; where it ends elsewhere, three per cent more are no other bed to an
        engineer.
    as_coarse : float
        Times less noise than the coarsest encoder up to which another one is coarse as well.
    most : int
        Matches that are tried at most. Each takes some seconds; a limited case answers within a minute.
    seconds : float
        s of processor time after which no other one is begun. Three machines that are not alike take 10 s for one.
    """

    factors: tuple[float, ...] = (2.0, 4.0, 8.0)
    above: tuple[float, ...] = (0.01, 0.03)
    as_coarse: float = 4.0
    most: int = 12
    seconds: float = 30.0


REMEDIES = RemedySettings()

Change = Callable[[Case, float], tuple[Case, dict[str, Any], str] | None]  # the case, its keys, the words

# --- Single changes, each by a factor


def _finer_encoders(case: Case, factor: float) -> tuple[Case, dict[str, Any], str] | None:
    """More counts of the coarsest encoders that reach the controller; one that states a noise alone gets its counts."""
    step, names = case.loop["sample_time"], set(case.loop.controller_sensors)
    noise = {
        one.name: sensor_noise(one, step)
        for one in case.rig.sensors if one.name in names and one.measures == "speed"
    }  # fmt: skip
    if not noise:
        return None
    coarse = [name for name, size in noise.items() if size > max(noise.values()) / REMEDIES.as_coarse]
    counts = {name: counts_of(noise[name] / factor, step) for name in coarse}
    made = [
        replace(one, counts=float(counts[one.name]), uncertainty=None) if one.name in counts else one
        for one in case.rig.sensors
    ]
    keys: dict[str, Any] = {}
    for one in case.rig.sensors:
        if one.name in counts:
            keys[f"rig: sensors.{one.name}.counts"] = counts[one.name]
            if one.uncertainty is not None:
                keys[f"rig: sensors.{one.name}.uncertainty"] = "left out: the counts are its noise"
    return _with_rig_sensors(case, made), keys, f"encoders of {' and '.join(coarse)} with {min(counts.values())} counts"


def _with_rig_sensors(case: Case, sensors: Sequence[Sensor]) -> Case:
    return replace(case, rig=replace(case.rig, sensors=tuple(sensors)))


def _less(name: str, words: str) -> Change:
    """A quantity of the loop, smaller by the factor; each dynamometer's own too."""

    def change(case: Case, factor: float) -> tuple[Case, dict[str, Any], str] | None:
        value = float(f"{case.loop[name] / factor:.3g}")
        made = apply(case, {f"loop.{name}": value})
        keys: dict[str, Any] = {f"loop.{name}": value}
        dynamometers = []
        for one in made.loop.dynamometers:
            own = getattr(one, name, None)
            if own is not None:
                own = float(f"{own / factor:.3g}")
                keys[f"dynamometers.{one.name}.{name}"] = own
            dynamometers.append(one if own is None else replace(one, **{name: own}))  # type: ignore[arg-type]
        made = replace(made, loop=replace(made.loop, dynamometers=tuple(dynamometers)))
        return made, keys, f"{words} {1e3 * value:.3g} ms"

    return change


def _known_better(case: Case, factor: float) -> tuple[Case, dict[str, Any], str]:
    """Every tolerance of the bed smaller by the factor."""
    box = Box(tuple(Uncertain(one.name, one.value, one.half_width / factor) for one in case.uncertainty.uncertain))
    share = f"1/{factor:g}"
    return replace(case, uncertainty=box), {"uncertainty": share}, f"every tolerance of [uncertainty] times {share}"


def _torque_flange(case: Case) -> Iterator[tuple[Case, dict[str, Any], str]]:
    """A torque that is measured in addition, by a sensor that the rig has or by one in a shaft on the specimen."""
    own = set(case.loop.controller_sensors)
    known = predicted_part(case.rig, case.residual_vehicle, case.loop).system.sensors
    there = [one for one in known if one.name not in own and one.measures in ("speed", "torque")]
    measured = {one.of for one in case.rig.sensors if one.measures == "torque"}
    cut = [one.follows for one in case.loop.dynamometers]
    taken = {one.name for one in case.rig.sensors}
    new = [
        Sensor(_free(f"{name}_torque", taken), "torque", name) for name in dict.fromkeys(cut) if name not in measured
    ]
    for sensor in sorted(there, key=lambda one: one.measures != "speed"):
        names = [*case.loop.further_sensors, sensor.name]
        yield _measuring(case, names), {"loop.measures": names}, f"{sensor.name} read by the controller"
    for sensor in new:
        names = [*case.loop.further_sensors, sensor.name]
        made = _with_rig_sensors(case, (*case.rig.sensors, sensor))
        keys = {f"rig: sensors.{sensor.name}": {"measures": "torque", "of": sensor.of}}
        yield _measuring(made, names), {**keys, "loop.measures": names}, f"a torque flange in shaft {sensor.of}"


def _free(name: str, taken: set[str]) -> str:
    """A name that no sensor has."""
    return name if name not in taken else _free(f"{name}_2", taken)


def _measuring(case: Case, names: Sequence[str]) -> Case:
    return replace(case, loop=replace(case.loop, further_sensors=tuple(names)))


DEAD_TIME, LAG = _less("dead_time", "a dead time of"), _less("inverter_lag", "an inverter lag of")
SAMPLE = _less("sample_time", "a sample time of")

# what may help against each cause, in the order in which it is tried
HELPS: dict[str, tuple[Change, ...]] = {
    "response_error": (_finer_encoders, DEAD_TIME, LAG, SAMPLE),
    "dead_time_alone": (DEAD_TIME, LAG, SAMPLE),
    "free_play": (_finer_encoders, DEAD_TIME),
    "standstill": (_finer_encoders,),
    "command_noise": (_finer_encoders,),
    "roll_off": (_finer_encoders, DEAD_TIME),
    "sensor_offset": (_finer_encoders,),
    "beds_not_stable": (_known_better, DEAD_TIME),
    "beds_damping": (_known_better, DEAD_TIME),
    "worst_bed": (_known_better,),
}

# --- Changes tried


def remedies_of(
    result: MatchResult, again: Callable[[Case], MatchResult], limits: Mapping[str, float],
    settings: RemedySettings = REMEDIES,
) -> tuple[Remedy, ...]:  # fmt: skip
    """Single changes with which a limited case was matched, the smallest first.

    Parameters
    ----------
    result : MatchResult
        Limited.
    again : callable
        Matches a changed case, without remedies of its own.
    limits : mapping
        Larger limits of the case, SI, with which every target was met.
    """
    case, causes = result.case, [one.cause for one in result.findings if one.limits]
    trials, found = _Trials(again, settings), []
    if limits and TORQUE_OVER_SPEED not in limits:  # a curve is no number that could be larger
        ratio = max(value / case.limits[key] for key, value in limits.items())
        words = " and ".join(f"limits.{key} = {value:.4g}" for key, value in limits.items())
        keys = {f"limits.{key}": value for key, value in limits.items()}
        found += trials.tried(replace(case, limits={**case.limits, **limits}), keys, words, ratio)
    for changed, keys, words in _requirements_waived(result, settings):
        found += (waived := trials.tried(changed, keys, words, 1.0))
        if waived:  # the smaller tolerance of two does
            break
    for change in dict.fromkeys(change for cause in causes for change in HELPS.get(cause, ())):
        found += _smallest(case, change, trials, settings)
    if "response_error" in causes and result.response_error.unmeasured > case.unmeasured_tolerance:
        for changed, keys, words in _torque_flange(case):
            found += (flange := trials.tried(changed, keys, words, 1.0))
            if flange:
                break
    return tuple(sorted(found, key=lambda one: one.factor))


class _Trials:
    """Matches of changed cases, so many at most and for so long."""

    def __init__(self, again: Callable[[Case], MatchResult], settings: RemedySettings):
        self._again, self._left = again, settings.most
        self._ends = time.process_time() + settings.seconds

    def tried(self, case: Case, keys: dict[str, Any], words: str, factor: float) -> list[Remedy]:
        """The remedy, where the case is matched and trials are left."""
        if not self._left or time.process_time() > self._ends:
            return []
        self._left -= 1
        try:
            result = self._again(case)
        except (NoDesign, SimulationError):
            return []
        error = result.response_error
        matched = result.status == "matched"
        return [Remedy(keys, words, factor, error.after, error.unmeasured)] if matched else []


def _smallest(case: Case, change: Change, trials: _Trials, settings: RemedySettings) -> list[Remedy]:
    """The smallest factor of a change with which the case is matched; the largest is tried first."""
    *smaller, largest = settings.factors
    best: list[Remedy] = []
    for factor in (largest, *smaller):
        made = _made(case, change, factor)
        tried = [] if made is None else trials.tried(*made, factor)
        if factor == largest and not tried:
            return []
        if tried:
            best = tried
            if factor != largest:
                break
    return best


def _made(case: Case, change: Change, factor: float) -> tuple[Case, dict[str, Any], str] | None:
    """A changed case; None where the change is none of this case, as a dead time below its bound."""
    try:
        return change(case, factor)
    except InputError:
        return None


def _requirements_waived(
    result: MatchResult, settings: RemedySettings
) -> Iterator[tuple[Case, dict[str, Any], str]]:  # fmt: skip
    """Requirements eased by as little as would do: free play waived, larger tolerances, or both where both limit."""
    case, error = result.case, result.response_error
    play, large = result.limited_by("free_play"), {
        f"response.{key}": (key, value)
        for key, value in (("tolerance", error.after), ("unmeasured_tolerance", error.unmeasured))
        if getattr(case, key) < value < np.inf
    }  # fmt: skip
    waived: dict[str, Any] = {f"limits.{OPENED_SHAFTS}": False} if play else {}
    free = replace(case, limits={**case.limits, OPENED_SHAFTS: False}) if play else case
    if play:
        yield free, waived, f"limits.{OPENED_SHAFTS} = false, if the cut shafts have no play"
    for above in settings.above if large else ():
        keys = {name: rounded_up(value * (1 + above)) for name, (_, value) in large.items()}
        larger: dict[str, Any] = {key: keys[name] for name, (key, _) in large.items()}
        words = " and ".join(f"{name} = {value:g}" for name, value in keys.items())
        yield replace(case, **larger), keys, words
        if play:
            yield replace(free, **larger), {**keys, **waived}, f"{words} and limits.{OPENED_SHAFTS} = false"


def rounded_up(value: float) -> float:
    """A value as it is printed, with three digits."""
    step = 10.0 ** (np.floor(np.log10(value)) - 2)
    return float(f"{np.ceil(value / step) * step:.3g}")
