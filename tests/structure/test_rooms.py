"""The program's rooms: imports run downwards, without circles, at the top of a file."""

from collections import Counter
from graphlib import TopologicalSorter

import pytest
from structure.imports import ROOT, Arrow, arrows, dotted, modules

# From the ground up; a room may import those before it and nothing after it. Rooms side by side do not know each other.
FLOORS = [
    ["modelling.common"],
    ["modelling.writing"],
    ["modelling.units"],
    ["modelling.effects"],
    ["modelling.model"],
    ["modelling.equations"],
    ["modelling.linear"],
    ["modelling.measurement.readers"],
    ["modelling.modal", "modelling.measurement", "modelling.fidelity"],
    ["modelling.simulation.integrator"],
    ["modelling.simulation"],
    ["modelling.bed.manoeuvres"],
    ["modelling.bed"],
    ["modelling.bed.observer"],
    ["modelling.bed.structures"],
    ["modelling.controller"],
    ["modelling.fmu"],
    ["matching.executors", "matching.records"],
    ["matching.aside"],
    ["matching.studies"],
    ["matching.validity.budget"],
    ["matching.validity.uncertainty"],
    ["matching.validity.fidelity"],
    ["matching.validity"],
    ["matching.frequency.case"],
    ["matching.frequency.independent"],
    ["matching.frequency.beds"],
    ["matching.frequency.tuning"],
    ["matching.frequency.loop"],
    ["matching.frequency.response"],
    ["matching.frequency.programme"],
    ["matching.frequency.programme.objectives"],
    ["matching.frequency.solver"],
    ["matching.frequency.verification"],
    ["matching.frequency.in_time"],
    ["matching.frequency.search"],
    ["matching.frequency.studies"],
    ["matching.diagnosis.data"],
    ["matching.diagnosis.fitting"],
    ["matching.diagnosis.candidates"],
    ["matching.diagnosis.search"],
    ["matching.diagnosis.verdict"],
    ["matching.diagnosis"],
    ["matching.fmu"],
    ["matching.bed_test"],
    ["matching.excitation"],
    ["matching.commissioning"],
    ["matching.report", "matching.report.common"],
    ["matching.report.drawing"],
    ["matching.report.modes", "matching.report.simulation"],
    ["matching.report.in_time", "matching.report.beds"],
    ["matching.report.controller", "matching.report.responses"],
    ["matching.report.match", "matching.report.study"],
    ["matching.report.curves"],
    ["matching.report.fidelity", "matching.report.uncertainty", "matching.report.tolerance"],
    ["matching.report.map", "matching.report.diagnosis", "matching.report.bed_test", "matching.report.excitation"],
    ["matching.report.commissioning"],
    ["matching.expected_end"],
    ["matching.arguments", "matching.completion"],
    ["matching.dry_run"],
    ["matching.explore.files", "matching.explore.signals"],
    ["matching.explore"],
    ["matching.explore.page.widgets"],
    ["matching.explore.page"],
    ["matching.api"],
    ["matching.commands"],
    ["matching.cli", "matching.supervision", "matching.streams"],
    ["rigmatch"],
    ["matching.__main__"],
]
PACKAGES = {"modelling", "matching", "matching.frequency"}  # their ``__init__`` imports nothing of a room
INSIDE_ALLOWED = (
    "matching.commands",
    "matching.dry_run",
    "matching.api",
    "matching.cli",
    "matching.__main__",
    "rigmatch",
)
LARGEST_ROOM = 14  # files of a folder
ONE_THING_A_FILE = {"modelling/effects", "matching/commands"}  # a law, a command: these may be more


def room(module: str) -> str:
    """The folder of a module; files that stand alone above the rooms are rooms of their own."""
    path = modules()[module]
    folder = module if path.name == "__init__.py" else dotted(path.parent / "__init__.py")
    return module if folder in ("matching", "") else folder


@pytest.fixture(scope="module")
def found() -> list[Arrow]:
    return arrows()


def test_no_file_imports_itself_round_a_corner(found):
    graph: dict[str, set[str]] = {}
    for arrow in found:
        graph.setdefault(arrow.source, set()).add(arrow.target)
    TopologicalSorter(graph).prepare()  # CycleError names the files


def test_every_room_has_a_floor():
    known = {name for floor in FLOORS for name in floor} | PACKAGES
    assert {room(module) for module in modules()} <= known


def test_imports_run_downwards(found):
    height = {name: level for level, floor in enumerate(FLOORS) for name in floor}
    upward = [
        str(arrow)
        for arrow in found
        if room(arrow.source) != room(arrow.target)
        and not {room(arrow.source), room(arrow.target)} & PACKAGES
        and height.get(room(arrow.source), -1) <= height[room(arrow.target)]
    ]
    assert upward == []


def test_imports_stand_at_the_top_of_a_file(found):
    """But in commands and the public face, which keep the start fast."""
    assert [str(arrow) for arrow in found if arrow.inside and not arrow.source.startswith(INSIDE_ALLOWED)] == []


def test_modelling_knows_nothing_of_matching(found):
    up = [str(arrow) for arrow in found if arrow.source.startswith("modelling") and arrow.target.startswith("matching")]
    assert up == []


def test_rooms_are_small():
    files = Counter(str(path.parent.relative_to(ROOT)) for path in modules().values())
    assert {name for name, count in files.items() if count > LARGEST_ROOM} - ONE_THING_A_FILE == set()
