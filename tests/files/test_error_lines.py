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
SIMULATED = ["simulate", "rig.toml", "bed.csv", "--channels", "channels.toml"]
KEY = re.compile(r'^("?)([\w.]+)("?) = (.*)$')
PLACES = 5  # a file and kind of fault
TEXTS = ("title", "description", "cause", "distribution")  # any text is right there, or another line is what is wrong


@pytest.fixture(scope="module")
def examples(tmp_path_factory):
    place = tmp_path_factory.mktemp("examples")
    for folder in {name.split("/")[0] for name in COMMANDS} | {"from_recordings"}:
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


MISTAKES = (
    ("road_to_rig/case.toml", "mode = 3 ", "mode = 33 ", ["match"]),
    ("road_to_rig/case.toml", "mode = 3 ", "mode = 2 ", ["match"]),
    ("road_to_rig/case.toml", '"road_left", sensor = "side_left', '"road_left", sensr = "side_left', ["match"]),
    ("road_to_rig/case.toml", '"road_left", sensor = "side_left', '"road_lft", sensor = "side_left', ["match"]),
    ("road_to_rig/case.toml", "damping_ratio = 0.01 ", "damping_ratio = 1.5 ", ["match"]),
    ("road_to_rig/case.toml", "{ lower = 0.03, upper = 0.1 }", "{ lower = 0.3, upper = 0.1 }", ["match"]),
    ("road_to_rig/case.toml", "{ lower = 0.03, upper = 0.1 }", "{ lower = 0.03, uper = 0.1 }", ["match"]),
    ("road_to_rig/case.toml", "band = [0.5, 30]", "band = [30, 0.5]", ["match"]),
    ("gum/mass.toml", "- m_nominal", "- m_nominl", ["uncertainty"]),
    ("fidelity/tab2.toml", "[system_dynamics.speed]", "[system_dynamic.speed]", ["fidelity"]),
    ("from_recordings/vehicle.toml", 'of = "side"', 'of = "motor"', ["modes"]),
    ("from_recordings/channels.toml", '"dyno"', '"dyn"', SIMULATED),
    ("from_recordings/channels.toml", "sign = 1", "sign = 2", SIMULATED),
    ("from_recordings/channels.toml", "sign = 1", "sgn = 1", SIMULATED),
)
CHANNELS = """[channels]
dyno = "dyno"
motor_speed = { channel = "motor_speed", sign = 1 }
"""


@pytest.mark.parametrize(("name", "right", "wrong", "words"), MISTAKES)
def test_the_line_of_a_mistake_is_named(name, right, wrong, words, examples, capsys, monkeypatch):
    """Values that are right as TOML and wrong beside others; keys within tables in one line."""
    path = examples / name
    content = CHANNELS if path.name == "channels.toml" else path.read_text()
    assert right in content
    line = content[: content.index(right)].count("\n") + 1
    monkeypatch.chdir(path.parent)
    try:
        path.write_text(content.replace(right, wrong, 1))
        code = main([*words, *([] if path.name == "channels.toml" else [path.name]), "--check"])
    finally:
        path.write_text(content)
    said = capsys.readouterr().err
    assert code == 2
    assert said.startswith(f"rigmatch: {path.name}: ")
    assert said.endswith(f"(line {line})\n")


def test_a_model_that_is_not_there_is_the_fault_of_the_case(examples, capsys):
    path = examples / "road_to_rig" / "elsewhere.toml"
    path.write_text((examples / "road_to_rig" / "case.toml").read_text().replace('"rig.toml"', '"gone.toml"'))
    assert main(["match", str(path), "--check"]) == 2
    said = capsys.readouterr().err
    assert "elsewhere.toml: rig: " in said
    assert "gone.toml does not exist" in said
    assert "(line 5)" in said
