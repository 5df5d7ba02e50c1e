"""The bed's limits on an excitation: how much of each is used."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from matching.excitation.motion import ExcitedMotion
from matching.excitation.recorded_bed import RecordedBed
from matching.frequency.beds.bed import disturbing
from matching.frequency.case.case import Case
from modelling.common.errors import InputError

SLOWEST = 0.2  # of the steady speed: no rotor comes nearer to standstill, where dry friction would hold it
BISECTIONS = 14
LARGEST_SCALE = 1e6


@dataclass(frozen=True)
class _Extremes:
    """Extremes over the samples: outputs (b, y + 2s), commands 2 × (b, k), demands (d,); all commands and speeds."""

    highest: np.ndarray
    lowest: np.ndarray
    command: tuple[np.ndarray, np.ndarray]
    demand: np.ndarray
    commands: np.ndarray
    speeds: np.ndarray

    @classmethod
    def of(cls, motion: ExcitedMotion, demands: np.ndarray, speed_rows: list[int]) -> _Extremes:
        k = motion.commands.shape[2]
        return cls(
            motion.outputs.max(axis=0), motion.outputs.min(axis=0),
            (motion.commands.max(axis=0), motion.commands.min(axis=0)), np.abs(demands[:, k:]).max(axis=0),
            motion.commands, motion.outputs[:, :, speed_rows],
        )  # fmt: skip


@dataclass(frozen=True)
class ExcitationLimits:
    """Largest absolute values; ``demanded`` are the largest torques (d,) of inputs that are no dynamometer's, N·m."""

    bed: RecordedBed
    speed: float
    demanded: np.ndarray

    def used(
        self, steady: tuple[np.ndarray, np.ndarray], motion: ExcitedMotion, demands: np.ndarray
    ) -> dict[str, float]:
        """Largest share of each limit, by its name in the case, over all beds and samples.

        Parameters
        ----------
        steady : (ndarray (b, k), ndarray (b, y + 2s))
            Commands and outputs of the steady motion.
        motion : ExcitedMotion
        demands : ndarray (t, u)
        """
        return self._shares(steady, _Extremes.of(motion, demands, self._speed_rows), 1.0)

    @property
    def _speed_rows(self) -> list[int]:
        return [self.bed.sensors.index(dynamometer.speed_sensor) for dynamometer in self.bed.case.loop.dynamometers]

    def _shares(self, steady: tuple[np.ndarray, np.ndarray], moved: _Extremes, scale: float) -> dict[str, float]:
        case, limits = self.bed.case, self.bed.case.limits
        highest, lowest = (steady[1] + scale * reading for reading in (moved.highest, moved.lowest))
        largest = np.maximum(np.abs(highest), np.abs(lowest)).max(axis=0)  # (y + 2s,)
        commands = np.maximum(
            np.abs(steady[0] + scale * moved.command[0]), np.abs(steady[0] + scale * moved.command[1])
        )
        shares = {"slowest rotor": float((1 - lowest[:, self._speed_rows].min() / self.speed) / (1 - SLOWEST))}
        peaks = {"dynamometer_torque": commands.max(), "dynamometer_speed": largest[self._speed_rows].max()}
        if "dynamometer_power" in limits or case.torque_curve is not None:
            torques, speeds = steady[0] + scale * moved.commands, self.speed + scale * moved.speeds
            peaks["dynamometer_power"] = np.abs(torques * speeds).max()
            if case.torque_curve is not None:
                shares["dynamometer_torque_over_speed"] = case.torque_curve.used(torques, speeds)
        shares |= {name: float(peak / limits[name]) for name, peak in peaks.items() if name in limits}
        names = [f"shafts.{shaft}.{what}" for what in ("torque", "twist") for shaft in self.bed.shafts]
        for name, peak in zip(names, largest[len(self.bed.sensors) :], strict=True):
            if name in limits:
                shares[name] = float(peak / limits[name])
        for name, peak, limit in zip(self.bed.inputs[commands.shape[1] :], moved.demand, self.demanded, strict=True):
            if limit > 0:
                shares[f"inputs.{name}"] = float(scale * peak / limit)
        return shares

    def check_steady(self, steady: tuple[np.ndarray, np.ndarray], allowed: float) -> None:
        """The steady speed alone must hold every limit up to a share ``allowed``.

        Raises
        ------
        InputError
            If it does not.
        """
        still = ExcitedMotion(np.zeros((1, *steady[0].shape)), np.zeros((1, *steady[1].shape)))
        used = self.used(steady, still, np.zeros((1, len(self.bed.inputs))))
        name = max(used, key=lambda key: used[key])
        if used[name] > allowed:
            raise InputError(
                "--speed",
                f"{self.speed:g} rad/s alone takes {used[name]:.0%} of {name}, {allowed:.0%} are allowed",
                "choose another speed",
            )

    def largest_scale(
        self, steady: tuple[np.ndarray, np.ndarray], motion: ExcitedMotion, demands: np.ndarray, allowed: float
    ) -> float:
        """Largest factor on an excitation with every limit used up to a share ``allowed``.

        Parameters are those of :meth:`used`; demands (t, u) in N·m.
        """

        moved = _Extremes.of(motion, demands, self._speed_rows)

        def holds(scale: float) -> bool:
            return max(self._shares(steady, moved, scale).values()) <= allowed

        low, high = 0.0, 1.0
        while holds(high) and high < LARGEST_SCALE:
            low, high = high, 2 * high
        for _ in range(BISECTIONS):
            middle = (low + high) / 2
            low, high = (middle, high) if holds(middle) else (low, middle)
        return low


def check_demanded(case: Case, stated: Mapping[str, float]) -> None:
    """Whether stated torques are those of inputs that are no dynamometer's.

    Raises
    ------
    InputError
        If ``stated`` names no such input.
    """
    names = disturbing(case)
    for name in stated:
        if name not in names:
            raise InputError(f"--limit {name}", "is no input beside the dynamometers'", f"choose of {', '.join(names)}")


def demanded_limits(bed: RecordedBed, stated: Mapping[str, float]) -> np.ndarray:
    """Largest torques (d,) of the inputs beside the dynamometers: as stated, else as large as the manoeuvre."""
    case, names = bed.case, bed.inputs[len(bed.case.loop.dynamometers) :]
    demands = []
    for name in names:
        manoeuvre = case.manoeuvre.get(name)
        peak = 0.0 if manoeuvre is None else float(np.abs(manoeuvre.torque(manoeuvre.time())).max())
        demands.append(stated.get(name, peak))
    return np.array(demands)
