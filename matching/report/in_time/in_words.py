"""The tuned controller in time, on beds that are not the model: lines for a terminal, rows of a table."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from matching.frequency.in_time.imperfection import EVERYTHING_STATED
from matching.frequency.in_time.table import TruthInTime
from matching.report.common.wording import number, percent


def in_time_lines(result: Mapping[str, Any]) -> list[str]:
    """Error of the bed as modelled and of those with everything wrong, and what an open lash does."""
    in_time = result.get("in_time")
    if not in_time or not in_time["rows"]:
        return []
    first, *others, last = in_time["rows"]
    wrong = [row for row in others if row["what_is_wrong"] == EVERYTHING_STATED]
    errors = "; ".join(f"{row['what_is_wrong']}: {_pair(row)}" for row in (*wrong, last))
    lash = in_time["open_lash"]
    swinging = f"; open lash: {_lash(lash)}" if lash else ""
    return [
        f"in time, {number(in_time['duration'], 2)} s on beds that are not the model, largest error over range: as "
        f"modelled {_pair(first)}; {errors}{swinging}"
    ]


def _pair(row: Mapping[str, Any]) -> str:
    measured, unmeasured = _largest(row["measured"]), _largest(row["unmeasured"])
    return measured if measured == unmeasured else f"{measured} (measured torques), {unmeasured} (unmeasured)"


def _largest(errors: Mapping[str, float] | None) -> str:
    return "not stable" if errors is None else percent(max(errors.values()))


def _lash(lash: Mapping[str, Any]) -> str:
    if not lash["limit_cycles"]:
        return f"{lash['drawn']} of {lash['drawn']} drawn ones come to rest"
    return f"{lash['limit_cycles']} of {lash['drawn']} drawn ones swing on where the vehicle comes to rest"


def lash_sentence(truth: TruthInTime) -> str:
    """What drawn lashes do, as a sentence; empty where none was tried."""
    lash = truth.lash
    if lash is None:
        return ""
    return (
        f"After a short torque pulse with an open lash, {_lash(lash.to_dict())}; at the end the worst bed swings by "
        f"{number(lash.largest_swing, 2)} N·m rms, the vehicle by {number(lash.vehicle_swing, 2)} N·m."
    )


def in_time_table(truth: TruthInTime) -> dict[str, Any]:
    """Heads and rows for the page: of every sensor the error with measured and with unmeasured torques."""
    rows = []
    for row in truth.rows:
        cells = []
        for name in truth.sensors:
            for errors in (row.measured, row.unmeasured):
                cells.append("not stable" if errors is None else percent(errors[name]))
        rows.append({"words": row.words, "cells": cells})
    heads = [name.replace("_", " ") for name in truth.sensors]
    return {"heads": heads, "rows": rows, "seconds": truth.seconds, "lash": lash_sentence(truth)}
