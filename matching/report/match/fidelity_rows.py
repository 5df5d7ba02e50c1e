"""The XiL fidelity of a match, for page and text."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

WHAT = {
    "R_SD": "torque and speed at every cut, rig against vehicle",
    "R_RVM": "what the residual vehicle on the rig's torques reads, against the vehicle's sensors",
    "R_MU": "uncertainty of the dynamometers' sensors over the range of the manoeuvre",
}


def fidelity_rows(fidelity: Mapping[str, Any]) -> dict[str, Any]:
    """Rows of the table: name, before, after, weight, what is compared."""
    before, after = fidelity["before"], fidelity["after"]
    rows = [
        {"name": f"R<sub>{name[2:]}</sub>", "before": percent(before[name]), "after": percent(after[name]),
         "weight": f"{fidelity['weights'][name]:.2g}", "what": what}
        for name, what in WHAT.items()
    ]  # fmt: skip
    total = {"name": "<b>R<sub>XiL</sub></b>", "weight": "1", "what": "all of it (Eq. 16)"}
    total |= {key: f"{percent(own['R_XiL'])} ± {percent(2 * own['standard_uncertainty'])}"
              for key, own in (("before", before), ("after", after))}  # fmt: skip
    return {"rows": [*rows, total], "f_max": fidelity["f_max"], "notes": fidelity["notes"]}


def fidelity_line(fidelity: Mapping[str, Any]) -> str:
    """One line for a terminal."""
    before, after = fidelity["before"], fidelity["after"]
    parts = ", ".join(f"{name} {percent(after[name])}" for name in WHAT if after[name] is not None)
    return f"fidelity R_XiL {percent(before['R_XiL'])} free, {percent(after['R_XiL'])} matched ({parts})"


def percent(value: float | None) -> str:
    """A share as a percentage, or a dash."""
    return "–" if value is None else f"{100 * value:.2f} %"
