"""A tuned feedback law on drawn beds, judged as an observer is."""

from __future__ import annotations

import numpy as np

from matching.frequency.beds.figures import LoopFigures
from matching.frequency.beds.requirements import requirements
from matching.frequency.case.case import Case
from matching.frequency.independent.beds_check import check_beds
from matching.frequency.independent.loop_check import check_loop
from matching.frequency.loop.control_law import control_law
from matching.frequency.loop.parts import parts_of
from matching.frequency.verification.observed import FRESH, RobustVerification
from matching.frequency.verification.verify import Verification
from modelling.bed.observer.model import NOISE


def on_drawn_beds(case: Case, checked: Verification, count: int, seed: int = 0) -> RobustVerification:
    """Judge a tuned case of any structure: margin above the emulated band, roll-off, noise and drawn beds.

    Parameters
    ----------
    checked : Verification
        Of the bed as planned.
    count, seed : int
        Of the fresh beds.

    Raises
    ------
    InputError
        If a model cannot be made linear or a design has no solution.
    """
    required, law = requirements(case), control_law(parts_of(case))
    by_name = {sensor.name: sensor for sensor in case.rig.sensors}
    noise = np.array([by_name[name].uncertainty or NOISE[by_name[name].measures] for name in law.sensors])
    loop = check_loop(case, law, noise, required.margin_from, required.rolled_off_from)
    figures = LoopFigures(loop.modulus_margin, loop.margin_at, loop.largest_rolled_off, loop.command_noise)
    beds = check_beds(case, law, required.damping_ratio, count, seed + FRESH, required.rolled_off_from)
    return RobustVerification(checked, required, figures, beds, law.dynamometers)
