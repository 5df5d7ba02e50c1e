"""The report of a match: one HTML page that opens anywhere, without network."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from matching.frequency.search.result import MatchResult
from matching.report.common.environment import embedded, environment
from matching.report.common.mathml import LEGEND, equations
from matching.report.common.style import RIG, VEHICLE
from matching.report.common.wording import change, number, sentence
from matching.report.match.checks import checks, needs
from matching.report.match.fidelity_rows import fidelity_rows
from matching.report.match.figures import CAPTIONS
from matching.report.match.modes_figure import nearest
from matching.report.match.text import answer, content
from matching.report.modes.animation import ModeAnimation
from modelling.bed.loop import HARDWARE
from modelling.model.system import System

DEAD_TIME = (
    "Whatever a controller commands acts one dead time later, so it can only answer what it foresees for that long; a "
    "torque that steps at an unforeseeable moment is answered late by anyone. The bound is the error of the best "
    "command that knows every state and every measured torque but nothing of the future."
)


def page(result: MatchResult, drawn: Mapping[str, bytes]) -> str:
    """The page.

    Parameters
    ----------
    drawn : mapping of str to bytes
        Figures by the names of :func:`matching.report.match.figures.figures`, as SVG or PNG.
    """
    return environment().get_template("match.html").render(context(result, drawn))


def summary_html(result: MatchResult) -> str:
    """Answer and targets for a notebook."""
    template = (
        "<p><b>{{ status }}</b>: {{ answer }}</p>"
        "<table><tr><th>mode</th><th>vehicle</th><th>rig</th><th>matched</th></tr>"
        "{% for row in targets %}<tr><td>{{ row.vehicle_mode }}</td><td>{{ row.vehicle|hertz }} Hz</td>"
        "<td>{{ row.rig|hertz }} Hz</td><td>{{ row.matched|hertz }} Hz</td></tr>{% endfor %}</table>"
    )
    values = {"status": result.status, "answer": answer(content(result)), "targets": result.targets}
    return environment().from_string(template).render(values)


def context(result: MatchResult, drawn: Mapping[str, bytes]) -> dict[str, Any]:
    """What the template shows."""
    tuned, error = result.tuned, result.response_error
    return {
        "title": result.case.title or "Match of a test bed to a vehicle",
        "status": result.status,
        "answer": answer(content(result)),
        "limits": result.limits,
        "notes": result.notes,
        "targets": result.targets,
        "error": error,
        "band": f"{number(error.band[0])}–{number(error.band[1])} Hz",
        "measured_note": _measured_note(result),
        "fidelity": fidelity_rows(result.fidelity.to_dict()) if result.fidelity else None,
        "honest": [*_honest(result), DEAD_TIME],
        "adapters": [
            own.to_dict() | {"change": change(own.start, own.tuned)}
            for own in result.parameters
            if own.name.startswith("rig.")
        ],
        "needs": needs(result),
        "manoeuvre": sentence([_manoeuvre(name, own) for name, own in tuned.manoeuvre.items()]),
        "structure": tuned.loop.structure.name,
        "twin": tuned.loop.structure.has_feed_forward,
        **_loop(result),
        "residual": _residual(result),
        "frozen": [own for own in result.parameters if own.frozen],
        "checks": checks(result),
        "found": _found(result),
        "swinging": _swinging(result),
        "figures": {name: embedded(content) for name, content in drawn.items()},
        "captions": CAPTIONS,
        **_equations(result),
    }


def _swinging(result: MatchResult) -> list[str]:
    """Target modes of the vehicle, and the modes of the free rig that come nearest, as moving drawings."""
    drawn = []
    for target in result.targets:
        own = next(mode for mode in result.vehicle_modes if mode.number == target.vehicle_mode)
        there = None if target.rig is None else nearest(result.rig_modes, target.rig, own.symmetry)
        pairs = [("Vehicle", own, VEHICLE), ("Rig", there, RIG)]
        drawn += [ModeAnimation(mode, colour, title).svg for title, mode, colour in pairs if mode and mode.shape]
    return drawn


def _measured(result: MatchResult) -> list[str]:
    """Compared inputs whose torque the feed-forward takes as measured."""
    loop = result.tuned.loop
    simulated = [own.name for part in result.tuned.residual_vehicle.parts for own in part.inputs]
    measured = loop.structure.measured_inputs(loop.measured, simulated)
    compared = dict.fromkeys(pair.input for pair in result.case.compared)
    return [name for name in compared if name in measured]


def _measured_note(result: MatchResult) -> str:
    names = _measured(result)
    return f"{sentence([name.replace('_', ' ') for name in names])} measured" if names else "feedback alone"


def _honest(result: MatchResult) -> list[str]:
    names = _measured(result)
    error = result.response_error
    if not names:
        return ["No torque is measured for feed-forward: all of this is done by feedback alone."]
    return [
        f"Measured torques ({sentence([name.replace('_', ' ') for name in names])}) reach the feed-forward, "
        f"a model of rig and vehicle that predicts across the dead time: error {number(error.after, 3)}. "
        "To an unmeasured torque, such as a brake on the shaft or a torque the model lacks, the rig reacts by "
        f"feedback alone: error {number(error.unmeasured, 3)}. Both are true of this rig; which one counts depends on "
        "where the torque comes from."
    ]


def _loop(result: MatchResult) -> dict[str, Any]:
    loop = result.tuned.loop

    def rows(table: Mapping[str, Any]) -> list[dict[str, Any]]:
        return [
            {"name": f"loop.{name}", "value": loop[name], "unit": knob.unit, "meaning": knob.meaning}
            for name, knob in table.items()
        ]

    return {"knobs": rows(loop.structure.quantities), "hardware": rows(HARDWARE)}


def _residual(result: MatchResult) -> list[dict[str, Any]]:
    rows = []
    for part in result.tuned.residual_vehicle.parts:
        for name, quantity in part.parameters.items():
            own = result.case.vehicle.parameters[name].value
            if quantity.value == 0 and own == 0:
                continue
            moved = abs(quantity.value - own) > 1e-9 * abs(own)
            rows.append(
                {"name": name, "value": quantity.value, "unit": part.units[name], "vehicle": own, "moved": moved}
            )
    return rows


def _manoeuvre(name: str, own: Any) -> str:
    return f"{own.kind.replace('_', '-')} of {number(own.amplitude)} N·m on {name.replace('_', ' ')}"


def _found(result: MatchResult) -> str:
    good = [value for value in result.starts if value is not None]
    if not good:
        return f"Found in {number(result.seconds, 2)} s."
    best = min(good)
    near = sum(value <= best * 1.01 + 1e-12 for value in good)
    return (
        f"Found in {number(result.seconds, 2)} s from {len(result.starts)} starts, of which {len(good)} ended in a "
        f"stable loop and {near} within 1 % of the best."
    )


def _equations(result: MatchResult) -> dict[str, Any]:
    systems: list[tuple[str, System]] = [("Vehicle", result.case.vehicle), ("Rig", result.case.rig)]
    parts = result.case.residual_vehicle.parts
    systems += [("Residual vehicle" + (f", part {k}" if len(parts) > 1 else ""), own) for k, own in enumerate(parts, 1)]
    shown = []
    for title, system in systems:
        found = equations(system)
        lines = [line for key in ("T", "V", "D", "motion") for line in found[key]]
        shown.append({"title": f"{title}: {system.title}" if system.title else title, "lines": lines})
    return {"equations": shown, "legend": LEGEND}
