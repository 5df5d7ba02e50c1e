"""The reference of the effects, from their registry."""

import inspect
import math

from modelling.effects import EFFECTS
from modelling.effects.effect import Kind, Parameter

TOP = """# Effects

Everything beyond a linear chain of inertias and shafts, written from the registry when the site is built. An effect
stands in a model file as an entry of `[[effects]]` with its kind, its place and its parameters:

```toml
[[effects]]
kind = "backlash"
at = "shafts.link"
gap = "1.2 deg"
```

A parameter with a range (`{ value = 0.02, lower = 0, upper = 0.1 }`) is uncertain and may be identified.
`rigmatch diagnose` tries every effect at every place where it can stand.
"""
PLACES = {"shafts": "shaft", "inertias": "inertia", "inputs": "input", "sensors": "sensor", "gears": "gear"}


def effects_page() -> str:
    """One section an effect: law, parameters, what it looks like in a recording, picture."""
    return "\n".join([TOP, *(_section(kind) for kind in EFFECTS.values())])


def _section(kind: Kind) -> str:
    at = " or ".join(PLACES.get(table, table) for table in kind.tables)
    shared = " Several inputs or sensors may share it." if kind.shareable else ""
    rows = [f"| `{key}` | {_unit(kind.parameter(key))} | {_of(kind, key)} |" for key in kind.file_keys]
    lines = [
        f"## {kind.kind}", "", inspect.cleandoc(type(kind).__doc__ or ""), "", f"Stands at: {at}.{shared}", "",
        "| parameter | unit | range |", "|---|---|---|", *rows, "",
    ]  # fmt: skip
    if kind.in_recording:
        lines += [f"In a recording: {kind.in_recording}", ""]
    return "\n".join(lines)


def _of(kind: Kind, key: str) -> str:
    """The range of a parameter; of a list that of its elements, and how many there may be."""
    part = kind.parameter(key)
    if key in kind.arrays:
        return f"list of up to {sum(name.rpartition('_')[0] == key for name in kind.parameters)}: {_ends(part)}"
    return f"list of rows: {_ends(part)}" if key in kind.matrices else _range(part)


def _unit(part: Parameter) -> str:
    words = {
        "sensor": "that of the sensor",
        "sensor/s": "that of the sensor, per second",
        "quantity": "that of the quantity",
    }
    return words.get(
        part.unit, "–" if part.unit == "1" else part.unit.replace("*", "·").replace("^2", "²").replace("^3", "³")
    )


def _range(part: Parameter) -> str:
    return f"{_ends(part)}, optional" if part.optional else _ends(part)


def _ends(part: Parameter) -> str:
    return (
        "any"
        if math.isinf(part.lower) and math.isinf(part.upper)
        else f"from {part.lower:g}"
        if math.isinf(part.upper)
        else f"{part.lower:g} to {part.upper:g}"
    )
