"""An error in an input file names its line: wrong keys and wrong values at places spread over every kind of file."""

import re
import shutil
from pathlib import Path

import pytest

from matching.cli import main

EXAMPLES = Path(__file__).parents[2] / "examples"
COMMANDS = {
    "diagnosis/model.toml": "modes",
    "road_to_rig/rig.toml": "modes",
    "road_to_rig/case.toml": "match",
    "road_to_rig/observer.toml": "match",
    "gum/end_gauge.toml": "uncertainty",
    "gum/thermometer.toml": "uncertainty",
    "fidelity/tab2.toml": "fidelity",
}
KEY = re.compile(r'^("?)([\w.]+)("?) = (.*)$')
PLACES = 5  # a file and kind of fault
TEXTS = ("title", "description", "cause", "distribution")  # any text is right there, or another line is what is wrong


@pytest.fixture(scope="module")
def examples(tmp_path_factory):
    place = tmp_path_factory.mktemp("examples")
    for folder in {name.split("/")[0] for name in COMMANDS}:
        shutil.copytree(EXAMPLES / folder, place / folder, ignore=shutil.ignore_patterns("*.png", "*.py"))
    return place


def spread(lines: list[str]) -> list[int]:
    """Places of keys with a value in one line, spread over a file."""
    keys = [i for i, line in enumerate(lines) if (key := KEY.match(line)) and key[2] not in TEXTS]
    keys = [i for i in keys if not KEY.match(lines[i])[4].startswith(("[", "{"))]
    return keys[:: max(len(keys) // PLACES, 1)]


@pytest.mark.parametrize("name", COMMANDS)
@pytest.mark.parametrize("fault", ["key", "value"])
def test_the_line_is_named(name, fault, examples, capsys):
    path = examples / name
    content = path.read_text()
    lines = content.split("\n")
    for place in spread(lines):
        quote, key, _, value = KEY.match(lines[place]).groups()
        wrong = f"{quote}{key}x{quote} = {value}" if fault == "key" else f'{quote}{key}{quote} = "wrong"'
        path.write_text("\n".join([*lines[:place], wrong, *lines[place + 1 :]]))
        try:
            code = main([COMMANDS[name], str(path), "--check"])
        finally:
            path.write_text(content)
        said = capsys.readouterr().err
        assert code == 2, wrong
        assert f"(line {place + 1})" in said, wrong


def test_a_model_that_is_not_there_is_the_fault_of_the_case(examples, capsys):
    path = examples / "road_to_rig" / "elsewhere.toml"
    path.write_text((examples / "road_to_rig" / "case.toml").read_text().replace('"rig.toml"', '"gone.toml"'))
    assert main(["match", str(path), "--check"]) == 2
    said = capsys.readouterr().err
    assert "elsewhere.toml: rig: " in said
    assert "gone.toml does not exist" in said
    assert "(line 5)" in said
