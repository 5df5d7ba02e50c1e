"""Model file and recording as text, in the specification's formats."""

from __future__ import annotations

import io

import numpy as np

from plant.bench import Take
from plant.systems import Drive

UNITS = {
    "speed": ("1/min", 30 / np.pi),
    "torque": ("N*m", 1.0),
    "acceleration": ("rad/s^2", 1.0),
    "angle": ("rad", 1.0),
}


def _quantity(name: str, written: dict[str, float], drive: Drive, known: set[str]) -> str:
    value = f"{written[name]:.6g}"
    if name in drive.tolerance and name not in known:
        return f"{{ value = {value}, tolerance = {drive.tolerance[name]:g} }}"
    return value


def model_text(drive: Drive, written: dict[str, float], noise: dict[str, float], known: set[str]) -> str:
    """The linear model file; quantities in `known` are written without a range."""
    lines = [f'title = "{drive.title}"', ""]
    for name in drive.inertias:
        lines += [f"[inertias.{name}]"]
        lines += [f"{q} = {_quantity(f'inertias.{name}.{q}', written, drive, known)}" for q in ("J", "drag")] + [""]
    for name, (first, second) in drive.shafts.items():
        lines += [f"[shafts.{name}]", f'between = ["{first}", "{second}"]']
        if f"shafts.{name}.ratio" in drive.values:
            lines += [f"ratio = {drive.values[f'shafts.{name}.ratio']:.6g}"]
        lines += [
            f"{q} = {_quantity(f'shafts.{name}.{q}', written, drive, known)}" for q in ("stiffness", "damping")
        ] + [""]
    for name, on in drive.inputs.items():
        lines += [f"[inputs.{name}]", f'on = "{on}"', ""]
    for name, (what, of) in drive.sensors.items():
        lines += [f"[sensors.{name}]", f'measures = "{what}"', f'of = "{of}"', f"uncertainty = {noise[name]:.4g}", ""]
    return "\n".join(lines)


def recording_text(drive: Drive, take: Take, readings: dict[str, np.ndarray]) -> str:
    """CSV with units; speeds in 1/min."""
    names, columns = ["time [s]"], [take.time]
    for j, name in enumerate(drive.inputs):
        names.append(f"{name} [N*m]")
        columns.append(take.inputs[:, j])
    for name, value in readings.items():
        unit, factor = UNITS[drive.sensors[name][0]]
        names.append(f"{name} [{unit}]")
        columns.append(value * factor)
    out = io.StringIO()
    np.savetxt(out, np.stack(columns, axis=1), delimiter=",", fmt="%.7g", header=",".join(names), comments="")
    return out.getvalue()
