"""What a diagnosis of one gear is worth in the others: rows that no fit has seen."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from modelling.equations.casadi_code import compiled
from modelling.errors import InputError
from modelling.recordings.gears import gear_words, stretches
from modelling.recordings.recording import Recording
from modelling.simulation.simulate import recorded_start, simulate, with_stick_speed
from modelling.simulation.stepping import SimulationError
from modelling.system import System


def errors_in_other_gears(
    model: System, fitted: System, extended: System, recordings: Sequence[Recording]
) -> list[str]:
    """Notes on every gear that was driven and not fitted: errors of the model as it was, and as it is extended.

    Each stretch in such a gear is simulated on its inputs from its own begin; the gear's ratio is that of the model.

    Parameters
    ----------
    model : System
        With its gearboxes.
    fitted, extended : System
        The model in the gear that was fitted, and what became of it.
    recordings : sequence of Recording
        Fitted ones and held-out ones, with all their rows.
    """
    ratios = {box.name: box.ratios for box in model.gearboxes}
    found: dict[str, list[tuple[Recording, list[dict[str, np.ndarray]]]]] = {}
    lost = dict[str, None]()
    for gears, rows in stretches(model, recordings):
        values = {f"gears.{name}.ratio": ratios[name][gear - 1].value for name, gear in gears.items()}
        if all(fitted.parameters[name].value == value for name, value in values.items()):
            continue
        words = gear_words(gears)
        try:
            both = [_simulated(one.with_values(values), rows) for one in (fitted, extended)]
        except (SimulationError, InputError):  # the diagnosis stands, whatever these rows hold
            lost[words] = None
            continue
        found.setdefault(words, []).append((rows, both))
    notes = [f"{words}, which was not fitted, cannot be simulated" for words in lost if words not in found]
    for words, parts in found.items():
        seconds = sum(float(np.ptp(rows.time)) for rows, _ in parts)
        errors = []
        for sensor in model.sensors:
            if all(sensor.name in rows.channels for rows, _ in parts):
                before, after = (
                    float(np.sqrt(np.nanmean(np.concatenate(
                        [(both[which][sensor.name] - rows[sensor.name]) ** 2 for rows, both in parts]
                    ))))
                    for which in (0, 1)
                )  # fmt: skip
                was = "" if f"{before:.3g}" == f"{after:.3g}" else f" ({before:.3g} before)"
                errors.append(f"{sensor.name} {after:.3g} {sensor.unit}{was}")
        if errors:
            notes.append(
                f"{words} was not fitted: over its {seconds:.3g} s the model is off by {', '.join(errors)} (rms)"
            )
    return notes


def _simulated(system: System, rows: Recording) -> dict[str, np.ndarray]:
    """Readings (t,) by sensor on the inputs of a recording, begun as recorded."""
    built = compiled(system)
    inputs = rows.inputs(system)
    start = recorded_start(built, rows, with_stick_speed(built, rows.time, inputs, built.p0))
    return dict(simulate(built, rows.time, inputs, start=start).readings)
