"""Lines of keys in error messages."""

import pytest

from matching.cli import main
from modelling.toml import line_of

CONTENT = """# a model
title = "two discs"

[inertias.motor]   # first
J = 0.05
drag = -1

[inertias.load]
J = 0.2
[shafts.link]
between = ["motor", "load"]
stiffness = {value = 1.0, lower = 2.0, upper = 3.0}
[[effects]]
kind = "backlash"
at = "shafts.link"
gap = 0.1
[[effects]]
kind = "slip"
at = "shafts.link"
coefficient = 3
"""


@pytest.mark.parametrize(
    ("place", "line"),
    [
        ("title", 2),
        ("inertias.motor.drag", 6),
        ("inertias.load.J", 9),
        ("inertias.load.speed", 8),
        ("shafts.link.stiffness.value", 12),
        ("effects[1].gap", 16),
        ("effects[2].coefficient", 20),
        ("effects[2] (slip)", 17),
        ("sensors.none", None),
        ("", None),
    ],
)
def test_the_line_of_a_place(place, line, tmp_path):
    path = tmp_path / "model.toml"
    path.write_text(CONTENT)
    assert line_of(f"{path}: {place}") == line


@pytest.mark.parametrize("where", ["", "missing.toml: inertias.a.J", "--change", "model: inertias", "/dev/zero: a"])
def test_places_outside_of_files_have_no_line(where):
    assert line_of(where) is None


def test_the_command_line_says_the_line(tmp_path, capsys):
    path = tmp_path / "model.toml"
    path.write_text(CONTENT)
    assert main(["modes", str(path), "--check"]) == 2
    said = capsys.readouterr().err
    assert said.endswith("(line 12)\n")
    assert said.count("\n") == 1


def test_an_unknown_list_of_tables_is_found_at_its_first(tmp_path):
    path = tmp_path / "file.toml"
    path.write_text("a = 1\n\n[[lists]]\nb = 2\n\n[[lists]]\nb = 3\n")
    assert line_of(str(path), "'lists' does not exist") == 3
