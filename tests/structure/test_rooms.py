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
    ["modelling.model_file"],
    ["modelling.equations.casadi_code"],
    ["modelling.linear.linearise"],
    ["modelling.recordings.readers"],
    ["modelling.modal.sensitivity", "modelling.recordings.recording", "modelling.fidelity.measures"],
    ["modelling.simulation.compiled"],
    ["modelling.simulation.simulate"],
    ["modelling.bed.manoeuvres"],
    ["modelling.bed.bed"],
    ["modelling.bed.observer"],
    ["modelling.bed.controllers"],
    ["modelling.controller.law"],
    ["modelling.fmu.export"],
    ["matching.worker_pool", "matching.studies"],
    ["matching.worker_pool"],
    ["matching.studies"],
    ["matching.uncertainty.budget"],
    ["matching.uncertainty.propagate"],
    ["matching.fidelity"],
    ["matching.validity"],
    ["matching.match.case_file"],
    ["matching.frequency.independent"],
    ["matching.match.tune_observer"],
    ["matching.match.tune_observer"],
    ["matching.frequency.loop"],
    ["matching.match.responses"],
    ["matching.match.programme"],
    ["matching.match.objectives"],
    ["matching.match.solve"],
    ["matching.match.verify"],
    ["matching.match.in_time"],
    ["matching.match.match"],
    ["matching.match.tolerance"],
    ["matching.diagnosis.data"],
    ["matching.diagnosis.fit"],
    ["matching.diagnosis.screening"],
    ["matching.diagnosis.search"],
    ["matching.diagnosis.verdict"],
    ["matching.diagnosis"],
    ["matching.export"],
    ["matching.bed.verify"],
    ["matching.bed.excite"],
    ["matching.bed.commission"],
    ["matching.report", "matching.report.common"],
    ["matching.report.drivetrain"],
    ["matching.report.modes", "matching.report.common"],
    ["matching.report.match", "matching.report.match"],
    ["matching.report.match", "matching.report.match"],
    ["matching.report.match", "matching.report.common"],
    ["matching.report.curves"],
    ["matching.report.evidence", "matching.report.evidence", "matching.report.studies"],
    ["matching.report.studies", "matching.report.diagnosis", "matching.report.bed", "matching.report.bed"],
    ["matching.report.bed"],
    ["matching.progress"],
    ["matching.progress", "matching.cli"],
    ["matching.cli"],
    ["matching.explore.files", "matching.explore.common"],
    ["matching.explore.live"],
    ["matching.explore.common"],
    ["matching.explore.live"],
    ["matching.api"],
    ["matching.commands"],
    ["matching.cli", "matching.cli", "matching.cli"],
    ["rigmatch"],
    ["matching.__main__"],
]
PACKAGES = {"modelling", "matching", "matching.frequency"}  # their ``__init__`` imports nothing of a room
INSIDE_ALLOWED = (
    "matching.commands",
    "matching.cli",
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
