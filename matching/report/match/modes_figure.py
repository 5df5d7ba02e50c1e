"""Frequencies and energy shares of vehicle, rig without control and matched rig, as the paper's Fig. 3 shows them."""

from __future__ import annotations

from collections.abc import Sequence

from matplotlib.figure import Figure

from matching.frequency.loop.loop_modes import LoopMode
from matching.frequency.search.result import MatchResult
from matching.report.common.style import MATCHED, RIG, VEHICLE
from matching.report.modes.figures import Column, energy_figure
from modelling.modal.result import Mode

HIGHEST_HZ = 1000.0  # above are poles of lags and of the dead time, which are no modes of the drivetrain


def match_modes_figure(result: MatchResult) -> Figure:
    """Three columns, three rows: frequencies, kinetic and potential shares of the target modes."""
    return energy_figure(columns(result))


def columns(result: MatchResult) -> list[Column]:
    """Vehicle, rig without control and matched rig with the target modes; a system without modes is left out."""
    # modes of the feed-forward: what the matched rig shows for measured torques
    measured = [mode for mode in result.matched_modes if mode.belongs_to == "feed_forward"]
    matched = [mode_of(mode) for mode in measured or result.matched_modes]
    drawn = []
    for title, colour, modes, aims in (
        ("Vehicle", VEHICLE, result.vehicle_modes, [target.vehicle for target in result.targets]),
        ("Rig without control", RIG, result.rig_modes, [target.rig for target in result.targets]),
        ("Matched rig", MATCHED, matched, [target.matched for target in result.targets]),
    ):
        shown = [
            nearest(modes, aim, target.symmetry)
            for aim, target in zip(aims, result.targets, strict=True)
            if aim is not None
        ]
        numbers = tuple(dict.fromkeys(mode.number for mode in shown if mode is not None))
        low = [mode for mode in modes if mode.frequency <= HIGHEST_HZ]
        if not numbers:
            title += ", no target mode found: its first modes"
        if low:
            drawn.append(Column(title, colour, low, numbers))
    return drawn


def mode_of(mode: LoopMode) -> Mode:
    """A mode of the closed loop as one of a drivetrain, to be drawn beside those of vehicle and rig."""
    keys = ("number", "frequency", "damping_ratio", "symmetry", "kinetic", "potential")
    return Mode(**{key: getattr(mode, key) for key in keys})


def nearest(modes: Sequence[Mode], frequency: float, symmetry: str) -> Mode | None:
    """The mode of a symmetry whose frequency lies nearest to a frequency in Hz."""
    alike = [mode for mode in modes if mode.symmetry == symmetry and mode.kinetic and 0 < mode.frequency <= HIGHEST_HZ]
    return min(alike, key=lambda mode: abs(mode.frequency - frequency), default=None)
