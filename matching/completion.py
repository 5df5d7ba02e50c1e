"""Names that a shell offers on Tab, read from the files alone: nothing that computes is imported."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from modelling.common.tables import read_toml

# Quantities that every component of a table has, and those it has where its file gives them
ALWAYS = {"inertias": ("J", "drag"), "shafts": ("stiffness", "damping"), "gears": ("ratio",)}
WHERE_GIVEN = {"shafts": ("ratio",)}
LOOP = ("dead_time", "inverter_lag", "torque_sensor_lag", "sample_time")  # of every control structure
SPEED_CONTROLLER = (
    "proportional_gain", "integral_gain", "torque_feed_forward", "acceleration_feed_forward", "lead_time",
)  # fmt: skip
OBSERVER = (
    "torque_drift", "dynamometer_drift", "dynamometer_swing", "dynamometer_noise", "shaft_noise", "command_weight",
    "command_change_weight", "torque_sensor_noise", "rotor_speed_noise", "further_sensor_noise",
)  # fmt: skip
# As the structures themselves have them, which a test compares: to import them takes a second, and Tab should not wait
STRUCTURES = {"pi": SPEED_CONTROLLER, "model_based": SPEED_CONTROLLER, "observer": OBSERVER}


def parameters_of_model(path: str | Path) -> list[str]:
    """Names of a model's quantities; those of effects as far as its file gives them.

    Raises
    ------
    InputError
        If the file cannot be read.
    """
    return _parameters(read_toml(path))


def quantities_of_case(path: str | Path) -> list[str]:
    """Names of a case's quantities that can be set, as :func:`matching.frequency.studies.map_axis.quantities` has them.

    Raises
    ------
    InputError
        If a file cannot be read.
    KeyError
        If it is no case file.
    """
    data = read_toml(path)
    vehicle, rig = (_parameters(read_toml(Path(path).parent / data[key])) for key in ("vehicle", "rig"))
    loop = data["loop"]
    of_loop = dict.fromkeys((*LOOP, *STRUCTURES.get(loop["structure"], ())))
    return [
        *(f"residual_vehicle.{name}" for name in vehicle if name not in rig),
        *(f"rig.{name}" for name in rig if name not in vehicle),
        *(f"loop.{name}" for name in of_loop),
    ]


def _parameters(model: dict[str, Any]) -> list[str]:
    names = [
        f"{table}.{name}.{key}"
        for table, keys in ALWAYS.items()
        for name, content in model.get(table, {}).items()
        for key in (*keys, *(key for key in WHERE_GIVEN.get(table, ()) if key in content))
    ]
    for effect in model.get("effects", []):
        names += [f"{effect['at']}.{effect['kind']}.{key}" for key in effect if key not in ("at", "kind")]
    return names
