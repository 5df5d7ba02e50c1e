"""When a shaft counts as opened: readings leave what is expected as they do where its torque is gone.

What an opened shaft, or a clutch in it, does to the readings over the first samples is as large as the torque that it
carried. Weights on what the readings of the last samples are off from what the controller's model expects estimate the
torque that was lost; the flange torques before these samples state what the shaft carried. An opened shaft has lost all
of it; noise and driving torques that are not as measured seem to take a small share of it, or none. A lash that is
crossed is an opened shaft for that time, but of a shaft whose torque has just changed its sign: so only shafts that
have carried a torque for a while are judged.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

WATCHED_SAMPLES = 5  # within which an opened shaft is to be noticed
IN_A_ROW = 2  # of these samples, so that a single wrong reading does not count
LARGEST_SHARE = 2.0  # of the carried torque that an opened shaft can seem to lose: more is something else


@dataclass(frozen=True)
class WatchedShafts:
    """How opened shafts are noticed; s shafts, y readings, k dynamometers.

    Attributes
    ----------
    shafts : tuple of str (s)
    lost : ndarray (s, WATCHED_SAMPLES · y)
        Torque that was lost, N·m, by what the readings are off from what is expected: those of the newest sample first.
    carried : ndarray (s, k)
        Torque of the shaft, N·m, by flange torques in steady motion.
    carried_samples : int
        For which a shaft has to have carried its torque before it is judged.
    """

    shafts: tuple[str, ...]
    lost: np.ndarray
    carried: np.ndarray
    carried_samples: int


@dataclass(frozen=True)
class OpenedShaft:
    """How the opening of a shaft is noticed.

    Attributes
    ----------
    shaft : str
    noticed_by : str
        ``lost_torque``, ``opened_torque`` (settings of the controller), or nothing: not within five samples.
    from_torque : float or None
        N·m in the shaft that have to be carried.
    why_not : str
        In words, where it is not noticed.
    """

    shaft: str
    noticed_by: str
    from_torque: float | None
    why_not: str = ""

    @property
    def words(self) -> str:
        """For people."""
        if self.noticed_by:
            return f"{self.shaft}: noticed by {self.noticed_by} from {self.from_torque:.3g} N·m in it on"
        return f"{self.shaft}: not noticed within five samples; {self.why_not}"


def nothing_watched(readings: int, dynamometers: int) -> WatchedShafts:
    """Of a controller that cannot tell an opened shaft from anything else."""
    return WatchedShafts((), np.zeros((0, WATCHED_SAMPLES * readings)), np.zeros((0, dynamometers)), 1)


class ShaftWatch:
    """Judges the watched shafts, sample by sample."""

    def __init__(self, watched: WatchedShafts):
        self.watched = watched
        self.reset()

    def reset(self) -> None:
        """Forget what the shafts carried."""
        count = len(self.watched.shafts)
        self._carried_for = np.zeros(count, int)  # samples, negative where the torque is
        self._seems_open = np.zeros(count, int)  # samples in a row

    def opened(self, deviations: np.ndarray, before: np.ndarray, least: np.ndarray, share: float) -> np.ndarray:
        """Which shafts (s,) have opened, as bool.

        Parameters
        ----------
        deviations : ndarray (WATCHED_SAMPLES · y,)
            Readings less what is expected, the newest sample first.
        before : ndarray (k,)
            Flange torques a sample before the oldest of these, N·m.
        least : ndarray (s,)
            N·m: shafts that carried no more are not judged.
        share : float
            Of the carried torque that an opened shaft seems to lose at least.
        """
        carried, enough = self.watched.carried @ before, self.watched.carried_samples
        longer = np.where(carried > 0, np.maximum(self._carried_for, 0) + 1, np.minimum(self._carried_for, 0) - 1)
        self._carried_for = np.where(np.abs(carried) > least, np.clip(longer, -enough, enough), 0)
        size, lost = np.abs(carried), self.watched.lost @ deviations * np.sign(carried)
        seems = (np.abs(self._carried_for) >= enough) & (lost > share * size) & (lost < LARGEST_SHARE * size)
        self._seems_open = np.where(seems, self._seems_open + 1, 0)
        opened: np.ndarray = self._seems_open >= IN_A_ROW
        return opened
