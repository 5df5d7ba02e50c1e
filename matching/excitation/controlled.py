"""What torques do to beds under their controller, by frequency."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from matching.excitation.recorded_bed import RecordedBed, transfer
from matching.frequency.loop.law_action import law_action
from modelling.controller.law import ControlLaw


@dataclass(frozen=True)
class ControlledBeds:
    """Responses of beds under emulation; b beds, f frequencies, e torques, k dynamometers.

    Attributes
    ----------
    commands : ndarray (b, f, k, e)
    outputs : ndarray (b, f, y + 2s, e)
        Sensors of the rig, then torques and twists of its shafts.
    """

    commands: np.ndarray
    outputs: np.ndarray


def controlled_beds(
    bed: RecordedBed,
    values: Sequence[Mapping[str, float]],
    law: ControlLaw,
    torques: Sequence[str],
    frequencies: np.ndarray,
) -> ControlledBeds:
    """Responses to torques (e), inputs of the rig or known to the law, at frequencies (f,), Hz, well below half the
    sampling frequency: what a sampled reading folds back from above is left out.

    Parameters
    ----------
    values : sequence of mappings (b)
        Values of what is uncertain, SI.
    """
    acting = law_action(law, frequencies, bed.case.loop.controller_sensors)
    s, step = 2j * np.pi * frequencies, law.sample_time
    hold = (1 - np.exp(-s * step)) / (s * step)
    commands, outputs = [], []
    for bed_values in values:
        shifted = bed.at(bed_values)
        C, D = bed.rows(shifted, bed_values)
        k, count = shifted.commands.shape[1], len(C)
        H = transfer(shifted.A, np.hstack([shifted.commands, shifted.torques]), np.vstack([C, shifted.readings]), s)
        H[:, :, :k] *= (hold * np.exp(-s * shifted.delay))[:, None, None]
        H[:, :count] += D
        direct = np.zeros((*H.shape[:2], len(torques)), complex)
        asked = np.zeros((len(s), k, len(torques)), complex)
        for i, name in enumerate(torques):
            if name in bed.inputs:
                direct[:, :, i] = H[:, :, bed.inputs.index(name)]
            if name in law.known:
                asked[:, :, i] = acting.of_known[:, :, law.known.index(name)]
        asked += acting.of_readings @ direct[:, count:]
        sent = np.linalg.solve(np.eye(k) - acting.of_readings @ H[:, count:, :k], asked)
        commands.append(sent)
        outputs.append(direct[:, :count] + H[:, :count, :k] @ sent)
    return ControlledBeds(np.stack(commands), np.stack(outputs))
