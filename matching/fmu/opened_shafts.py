"""Which shafts' opening the exported controller notices within five samples, by what, and from which torque on.

The weights that estimate a lost torque are those of the least variance (a linearly constrained filter, Frost, 1972)
over what else moves the readings: noise and encoders, torques at the rig's inputs that step unmeasured or late, torques
of the road, on beds drawn from the box of the case. What these reach at most sets the torque from which on a shaft is
judged.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from matching.fmu.deviations import LinearBed, linear_bed
from matching.fmu.disturbances import Disturbances, disturbances, windows
from matching.frequency.case.case import Case
from modelling.controller.law import ControlLaw
from modelling.controller.opened_shaft import WATCHED_SAMPLES, OpenedShaft, WatchedShafts, nothing_watched
from modelling.controller.settings import NO_LIMIT, OPENED_SHARE
from modelling.controller.torque_gone import KEPT_SAMPLES, has_gone

DRAWN_BEDS = 8
NOISE_DEVIATIONS = 6.0  # standard deviations of the estimate that noise may reach
SHARES = 0.75, 1.33  # of the carried torque that an opened shaft has to seem to lose, on every drawn bed
SHARE_BEFORE = 0.62  # at least, a sample earlier: both samples have to pass the share that counts as opened
SHARE_WANTED = 0.75  # of it, where the filter of the least variance does not reach it
SMALLEST_JUDGED = 1.0  # of the torque that `lost_torque` at every flange is in a shaft: lash of 5° reached 0.7
CARRIED_S = 0.03  # for which a shaft has to have carried its torque: a lash is crossed and has struck within it
ROUNDING = 1e-9  # of a variance, added to it
LARGEST_LEAST = 0.5  # of the torque that a shaft carries at most: a rule that begins beyond it is of no use


@dataclass(frozen=True)
class OpenedShaftRule:
    """Watched shafts, the least torque (s,) in N·m from which on each is judged, and a row for every shaft."""

    watched: WatchedShafts
    least: np.ndarray
    rows: tuple[OpenedShaft, ...]


def opened_shaft_rule(case: Case, law: ControlLaw, lost_torque: float) -> OpenedShaftRule:
    """Design the rule of a controller.

    Parameters
    ----------
    case : Case
    law : ControlLaw
    lost_torque : float
        N·m: from this flange torque on the controller judges whether it is gone at once.

    Raises
    ------
    InputError
        If the rig cannot be made linear.
    """
    beds = [linear_bed(case, law, case.uncertainty.at(at)) for at in case.uncertainty.spread(DRAWN_BEDS)]
    shafts = tuple(part.name for part in case.rig.shafts)
    carried = linear_bed(case, law, {}).carried(shafts)
    limit = case.limits.get("dynamometer_torque", NO_LIMIT)
    scale = lost_torque if limit < NO_LIMIT else 0.0
    what, unwatched = None, _why_nothing_is_watched(case, law)
    rows, weights, least = [], [], []
    for shaft, of_flanges in zip(shafts, carried, strict=True):
        if limit < NO_LIMIT and gone_at_once(beds, shaft, of_flanges):
            rows.append(OpenedShaft(shaft, "lost_torque", float(np.abs(of_flanges).sum() * lost_torque)))
            continue
        if unwatched:
            rows.append(OpenedShaft(shaft, "", None, unwatched))
            continue
        if what is None:
            what = disturbances(case, beds, scale)
        row, weights_of_shaft = _judged(beds, shaft, of_flanges, what, scale, limit)
        rows.append(row)
        if weights_of_shaft is not None:
            weights.append((shaft, weights_of_shaft, of_flanges))
            least.append(row.from_torque)
    if not weights:
        return OpenedShaftRule(nothing_watched(len(law.sensors), len(law.dynamometers)), np.zeros(0), tuple(rows))
    names, lost, ratios = zip(*weights, strict=True)
    carried_samples = max(round(CARRIED_S / law.sample_time), 1)
    watched = WatchedShafts(names, np.array(lost), np.array(ratios), carried_samples)
    return OpenedShaftRule(watched, np.array(least), tuple(rows))


def _why_nothing_is_watched(case: Case, law: ControlLaw) -> str:
    """In words; empty where the controller can watch shafts."""
    if not law.L.any():
        return "the controller has no observer"
    kinds = {sensor.name: sensor.measures for sensor in case.rig.sensors}
    if not any(kinds[name] == "speed" for name in case.loop.further_sensors):
        return "the observer reads no speed but the dynamometers'"  # an unmeasured torque looks the same to it
    return ""


def _judged(
    beds: Sequence[LinearBed], shaft: str, of_flanges: np.ndarray, what: Disturbances, scale: float, limit: float
) -> tuple[OpenedShaft, np.ndarray | None]:
    """A shaft's row, and its weights where an opening can be told from everything else."""
    if not of_flanges.any():
        return OpenedShaft(shaft, "", None, "it carries no torque of the flanges in steady motion"), None
    signatures = np.stack([_openings(bed, shaft) for bed in beds])
    smallest = SMALLEST_JUDGED * float(np.abs(of_flanges).sum()) * scale
    weights = estimating(signatures, what, smallest)
    before, at_last = (signatures @ weights).T
    if before.min() < SHARE_BEFORE or at_last.min() < SHARES[0] or max(before.max(), at_last.max()) > SHARES[1]:
        words = "what its opening does to the readings differs too much over drawn beds"
        return OpenedShaft(shaft, "", None, words), None
    noise = float(np.sqrt(np.sum((what.noise @ weights) ** 2)))
    reached = float(np.abs(what.steps @ weights).max(initial=0.0)) + NOISE_DEVIATIONS * noise
    least, largest = max(reached / OPENED_SHARE, smallest), float(np.abs(of_flanges).sum()) * limit
    if least > LARGEST_LEAST * largest:
        words = (
            f"noise and torques that are not as measured look like {reached:.3g} N·m lost, and it carries "
            f"{largest:.3g} N·m at most"
        )
        return OpenedShaft(shaft, "", None, words), None
    return OpenedShaft(shaft, "opened_torque", float(f"{least:.3g}")), weights


def estimating(signatures: np.ndarray, what: Disturbances, carried: float) -> np.ndarray:
    """Weights (WATCHED_SAMPLES · y,) on deviations that estimate the torque that was lost, N·m.

    Parameters
    ----------
    signatures : ndarray (b, 2, WATCHED_SAMPLES · y)
        Deviations after 1 N·m was lost, one sample before the last watched one and at it, on every bed.
    what : Disturbances
    carried : float
        N·m for which the signatures' differences from bed to bed count.
    """
    mean = signatures.mean(axis=0)
    apart = carried * (signatures - mean).reshape(-1, mean.shape[1]) / np.sqrt(len(signatures))
    parts = np.vstack([what.noise, what.steps / np.sqrt(what.count), apart])
    covariance = parts.T @ parts
    covariance += ROUNDING * np.diag(np.diag(covariance))
    toward = np.linalg.solve(covariance, mean.T)
    gained = mean @ toward  # what each filter makes of each signature
    weights: np.ndarray = toward[:, 1] / gained[1, 1]
    if (signatures[:, 0] @ weights).min() < SHARE_BEFORE:
        weights = toward @ np.linalg.solve(gained, [SHARE_WANTED, 1.0])
    return weights


def _openings(bed: LinearBed, shaft: str) -> np.ndarray:
    """Windows (2, WATCHED_SAMPLES · y) one sample before the last watched one, and at it."""
    off, _ = bed.opening(shaft, WATCHED_SAMPLES + 1)
    return windows(off[:, :, None])[-2:, 0]


def gone_at_once(beds: Sequence[LinearBed], shaft: str, of_flanges: np.ndarray) -> bool:
    """Whether a flange torque is gone within WATCHED_SAMPLES after a shaft opened, on every bed.

    ``of_flanges`` (k,): torque in the shaft by flange torques.
    """
    return all(_gone_at_once(bed, shaft, of_flanges) for bed in beds)


def _gone_at_once(bed: LinearBed, shaft: str, of_flanges: np.ndarray) -> bool:
    if not of_flanges.any():
        return False
    if shaft in bed.measured_shafts:
        return True
    before = of_flanges / (of_flanges @ of_flanges)  # of 1 N·m in the shaft
    _, read = bed.opening(shaft, WATCHED_SAMPLES + 1)
    torques = np.vstack([np.tile(before, (KEPT_SAMPLES, 1)), before + read[:, : len(of_flanges)]])
    least = 0.5 * np.abs(before)
    gone = False
    for n in range(KEPT_SAMPLES, len(torques)):
        gone |= bool(has_gone(torques[n - KEPT_SAMPLES : n + 1][::-1], least).any())
    return gone
