"""Drawings of a model, and of a case with the vehicle above its rig and the cut marked in both."""

from __future__ import annotations

import textwrap
from dataclasses import replace

from matplotlib.figure import Figure

from matching.frequency.case.case import Case
from matching.report.common.style import RIG, VEHICLE, figure, styled
from matching.report.drawing.drivetrain import Drawing, Emphasis, draw, drawing
from modelling.model.system import System

INCHES = 0.62  # of a unit of the drawing
NARROWEST_INCHES = 4.5  # with room for the legend
TITLE_POINTS = 9.0
POINTS_AN_INCH = 72.0
LETTER_WIDTH = 0.62  # of the height of a title's letters, on average
LEGEND = "height of a disc ~ J^(1/4), as of discs of one thickness; ↻ torque input; φ ω α M sensor; + effect"

CASE_LEGEND = (
    "dashed: the cut; hatched: residual vehicle, emulated by the dynamometers; grey: hardware that both have; "
)


def model_figure(system: System) -> Figure:
    """The drivetrain of a model.

    Raises
    ------
    InputError
        If it has too many inertias.
    """
    return _figure([(system.title, "#222222", drawing(system))])


def case_figure(case: Case) -> Figure:
    """Vehicle above rig: shared hardware in grey, what only one has in its colour, what is emulated hatched.

    Raises
    ------
    InputError
        If one of them has too many inertias.
    """
    vehicle, rig = case_drawings(case)
    return _figure(
        [
            (f"Vehicle: {case.vehicle.title}", VEHICLE, vehicle),
            (f"Rig: {case.rig.title}", RIG, rig),
        ],
        CASE_LEGEND,
    )


def case_drawings(case: Case) -> tuple[Drawing, Drawing]:
    """Vehicle and rig laid out, with what the case says of them.

    Raises
    ------
    InputError
        If one of them has too many inertias.
    """
    vehicle, rig = ({part.name for part in system.inertias} for system in (case.vehicle, case.rig))
    interfaces = case.residual_vehicle.interfaces
    rotors = {source.name: source.on for source in case.rig.inputs}
    machines = {rotors[machine.torque_input]: machine.name for machine in case.loop.dynamometers}
    of_vehicle = Emphasis(
        dict.fromkeys(vehicle - rig, VEHICLE),
        frozenset(vehicle - rig),
        cuts={interface.shaft: interface.vehicle_end for interface in interfaces},
    )
    of_rig = Emphasis(
        dict.fromkeys(rig - vehicle, RIG),
        machines=machines,
        cuts={interface.shaft: interface.rig_end for interface in interfaces},
    )
    largest = max(part.J.value for system in (case.vehicle, case.rig) for part in system.inertias)
    both = drawing(case.vehicle, of_vehicle, largest), drawing(case.rig, of_rig, largest)
    column = max(drawn.column for drawn in both)  # parts of both stand below each other
    return replace(both[0], column=column), replace(both[1], column=column)


def _figure(drawings: list[tuple[str, str, Drawing]], legend: str = "") -> Figure:
    width = max(drawn.width for _, _, drawn in drawings)
    heights = [drawn.height for _, _, drawn in drawings]
    with styled():
        inches = max(INCHES * width, NARROWEST_INCHES)
        letters = int(inches * POINTS_AN_INCH / (TITLE_POINTS * LETTER_WIDTH))
        titles = [textwrap.fill(title, letters, break_on_hyphens=False) for title, _, _ in drawings]
        lines = sum(1 + title.count("\n") for title in titles)
        fig = figure(inches, INCHES * (sum(heights) + 0.6) + 0.25 * lines)
        beside = (inches / INCHES - width) / 2  # of a drawing narrower than the figure
        rows = fig.subplots(len(drawings), 1, squeeze=False, height_ratios=heights)[:, 0]
        for axes, title, (_, colour, drawn) in zip(rows, titles, drawings, strict=True):
            draw(axes, drawn)
            axes.set_xlim(-1.0 - beside, width - 1.0 + beside)
            axes.set_title(title, loc="left", color=colour, fontsize=TITLE_POINTS, parse_math=False)
        fig.supxlabel(legend + LEGEND, fontsize=6, color="#555555", parse_math=False, wrap=True)
    return fig
