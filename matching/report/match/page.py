"""The report of a match: one HTML page that opens anywhere, without network."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from matching.fmu.controller import exported_controller
from matching.frequency.search.result import MatchResult
from matching.report.beds.requirement_rows import error_rows, requirement_rows
from matching.report.common.environment import embedded, environment, in_address
from matching.report.common.mathml import LEGEND, equations
from matching.report.common.provenance import Provenance
from matching.report.common.style import RIG, VEHICLE
from matching.report.common.wording import amount, change, component, number, sentence
from matching.report.controller.diagram import EnteredNumber, block_diagram
from matching.report.in_time.in_words import in_time_table
from matching.report.match.checks import checks, needs
from matching.report.match.fidelity_rows import fidelity_rows
from matching.report.match.figures import CAPTIONS
from matching.report.match.first_screen import (
    SAME_RELATIVE,
    adapters_of,
    measured_inputs,
    to_enter,
    to_order,
    to_watch,
    traded_before_beds,
    why_these_values,
)
from matching.report.match.modes_figure import nearest
from matching.report.match.text import answer, content, operating_point
from matching.report.modes.animation import ModeAnimation
from modelling.bed.loop import HARDWARE
from modelling.common.errors import InputError
from modelling.controller.opened_shaft import OpenedShaft
from modelling.model.system import System

DEAD_TIME = (
    "A command acts one dead time after it is given, so a controller can only act on what it predicts for that time; a "
    "torque that steps at an unforeseeable moment is always answered late. The lower bound is the error of the best "
    "command that knows every state and every measured torque but nothing of the future. It is the best over all "
    "frequencies, for torques that step; within a band alone a controller can be below it."
)
NEAR_BEST = 0.01  # relative: starts that end this near to the best objective count as agreeing


def page(
    result: MatchResult,
    images: Mapping[str, bytes],
    made: Provenance | None = None,
    moving: Mapping[str, str] | None = None,
    data: Mapping[str, str] | None = None,
) -> str:
    """The page as HTML.

    Parameters
    ----------
    result : MatchResult
    images : mapping of str to bytes
        Figures by the names of :func:`matching.report.match.figures.figures`, as SVG or PNG.
    made : Provenance, optional
        What the result was made from; without it the page does not say.
    moving : mapping of str to str, optional
        Figures that act, as :func:`matching.report.curves.moving_figures.moving_figures` has them.
    data : mapping of str to str, optional
        CSV of the curves by the name of their figure.
    """
    values = context(result, images) | {"made": made, "moving": moving or {}, "data": _addresses(data or {})}
    return environment().get_template("match.html").render(values)


def _addresses(data: Mapping[str, str]) -> dict[str, str]:
    """Tables as addresses from which a browser saves them."""
    return {name: in_address(text, "text/csv") for name, text in data.items()}


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


def context(result: MatchResult, images: Mapping[str, bytes]) -> dict[str, Any]:
    """Values of the template."""
    tuned, error, residual = result.tuned, result.response_error, _residual(result)
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
        "in_time": in_time_table(result.in_time) if result.in_time.rows else None,
        "explanations": [*_explanations(result), DEAD_TIME],
        "adapters": [row.to_dict() | {"change": change(row.start, row.tuned)} for row in adapters_of(result)],
        "trades": {trade.name: trade for trade in result.adapters},
        "trades_before_beds": traded_before_beds(result),
        "to_order": to_order(result),
        "to_enter": to_enter(result),
        "why_these_values": why_these_values(result),
        "to_watch": to_watch(result),
        "needs": needs(result),
        "operating_point": operating_point(content(result)),
        "manoeuvre": sentence([_manoeuvre(name, torque) for name, torque in tuned.manoeuvre.items()]),
        "structure": tuned.loop.structure.name,
        "requirements": requirement_rows(result.robust) if result.robust else [],
        "bed_errors": error_rows(result.robust) if result.robust else [],
        "unmeasured_note": "estimated by the observer" if tuned.loop.structure.is_observer else "feedback alone",
        "has_feed_forward": tuned.loop.structure.has_feed_forward,
        **_loop(result),
        "residual": residual,
        "own_residual": result.simple_vehicle is not None,
        "opened_shafts": _opened_shafts(result),
        "diagram": block_diagram(tuned.loop, _entries(residual)),
        "fixed": [row for row in result.parameters if row.fixed],
        "checks": checks(result),
        "search": _search(result),
        "animations": _animations(result),
        "figures": {name: embedded(image) for name, image in images.items()},
        "captions": CAPTIONS,
        **_equations(result),
    }


def _animations(result: MatchResult) -> list[str]:
    """Target modes of the vehicle, and the nearest modes of the rig without control, as moving drawings."""
    drawings = []
    for target in result.targets:
        of_vehicle = next(mode for mode in result.vehicle_modes if mode.number == target.vehicle_mode)
        of_rig = None if target.rig is None else nearest(result.rig_modes, target.rig, of_vehicle.symmetry)
        pairs = [("Vehicle", of_vehicle, VEHICLE), ("Rig", of_rig, RIG)]
        drawings += [ModeAnimation(mode, colour, title).svg for title, mode, colour in pairs if mode and mode.shape]
    return drawings


def _measured_note(result: MatchResult) -> str:
    names = measured_inputs(result)
    return f"{sentence([name.replace('_', ' ') for name in names])} measured" if names else "feedback alone"


def _explanations(result: MatchResult) -> list[str]:
    names = measured_inputs(result)
    error = result.response_error
    if not names:
        return ["No torque is measured for a feed-forward: these errors are those of feedback alone."]
    reaction = "by what its observer estimates" if result.tuned.loop.structure.is_observer else "by feedback alone"
    return [
        f"Measured torques ({sentence([name.replace('_', ' ') for name in names])}) reach the feed-forward, "
        f"a model of rig and vehicle that predicts across the dead time: error {number(error.after, 3)}. "
        "To an unmeasured torque, such as a brake on the shaft or a torque the model lacks, the rig reacts "
        f"{reaction}: error {number(error.unmeasured, 3)}. Both errors are true of this rig; which one counts "
        "depends on where the torque comes from."
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
    """Rows of the residual vehicle; one of the case's own beside what its file says, else beside the vehicle."""
    simple = result.simple_vehicle
    rows = []
    for part in result.tuned.residual_vehicle.parts:
        for name, quantity in part.parameters.items():
            if simple is None:
                before = result.case.vehicle.parameters[name].value
            else:
                before, _ = simple.values.get(name, (quantity.value, quantity.value))
            if quantity.value == 0 and before == 0:
                continue
            moved = abs(quantity.value - before) > SAME_RELATIVE * abs(before)
            row = {"name": name, "value": quantity.value, "unit": part.units[name], "before": before}
            rows.append(row | {"moved": moved})
    return rows


def _entries(residual: list[dict[str, Any]]) -> list[EnteredNumber]:
    """Values of the residual vehicle for the diagram."""
    return [EnteredNumber(component(row["name"]), amount(row["value"], row["unit"], 5)) for row in residual]


def _opened_shafts(result: MatchResult) -> list[OpenedShaft]:
    """How the exported controller notices the opening of every shaft; nothing where it cannot be exported."""
    try:
        return list(exported_controller(result.tuned).shafts)
    except InputError:
        return []


def _manoeuvre(name: str, torque: Any) -> str:
    return f"{torque.words} of {number(torque.amplitude)} N·m on {name.replace('_', ' ')}"


def _search(result: MatchResult) -> str:
    if result.robust and result.tuned.loop.structure.is_observer:
        return (
            "The weights of the observer were tuned over beds that fill the box of what is not known exactly; "
            f"{result.robust.beds.drawn} fresh beds judged the result by equations of their own."
        )
    stable = [value for value in result.starts if value is not None]
    if not stable:
        return f"None of {len(result.starts)} starts ended in a stable loop."
    best = min(stable)
    agreeing = sum(value <= best * (1 + NEAR_BEST) + 1e-12 for value in stable)
    return f"Of {len(result.starts)} starts {len(stable)} ended in a stable loop and {agreeing} within 1 % of the best."


def _equations(result: MatchResult) -> dict[str, Any]:
    systems: list[tuple[str, System]] = [("Vehicle", result.case.vehicle), ("Rig", result.case.rig)]
    repeated = () if result.simple_vehicle is not None else result.case.residual_vehicle.parts
    parts = result.case.residual_vehicle.parts
    for place, part in enumerate(parts, 1):
        systems.append(("Residual vehicle" + (f", part {place}" if len(parts) > 1 else ""), part))
    blocks = []
    for title, system in systems:
        written = equations(system)
        lines = [line for key in ("T", "V", "D", "motion") for line in written[key]]
        name = f"{title}: {system.title}" if system.title else title
        blocks.append({"title": name, "lines": lines, "repeated": any(system is part for part in repeated)})
    return {"equations": blocks, "legend": LEGEND}
