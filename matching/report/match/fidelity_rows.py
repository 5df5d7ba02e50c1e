"""The XiL fidelity of a match (Eqs. 14 to 23), for page and text."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from matching.report.common.wording import percent

COMPARED = {
    "R_SD": "torque and speed at every cut, rig against vehicle",
    "R_RVM": "sensors of the residual vehicle, driven by the rig's torques, against those of the vehicle",
    "R_MU": "uncertainty of the dynamometers' sensors over the range of the manoeuvre",
}


def fidelity_rows(fidelity: Mapping[str, Any]) -> dict[str, Any]:
    """Rows of the table: name, before, after, weight, what is compared."""
    before, after = fidelity["before"], fidelity["after"]
    rows = [
        {"name": f"R<sub>{name[2:]}</sub>", "before": percent(before[name]), "after": percent(after[name]),
         "weight": f"{fidelity['weights'][name]:.2g}", "what": what}
        for name, what in COMPARED.items()
    ]  # fmt: skip
    total = {"name": "<b>R<sub>XiL</sub></b>", "weight": "1", "what": "total (Eq. 16)"}
    total |= {key: f"{percent(values['R_XiL'])} ± {percent(2 * values['standard_uncertainty'])}"
              for key, values in (("before", before), ("after", after))}  # fmt: skip
    return {"rows": [*rows, total], "f_max": fidelity["f_max"], "notes": fidelity["notes"]}


def fidelity_line(fidelity: Mapping[str, Any]) -> str:
    """One line for a terminal."""
    before, after = fidelity["before"], fidelity["after"]
    parts = ", ".join(f"{name} {percent(after[name])}" for name in COMPARED if after[name] is not None)
    return f"fidelity R_XiL {percent(before['R_XiL'])} without control, {percent(after['R_XiL'])} matched ({parts})"
