"""What a study is recorded under: all that its results depend on, and nothing else."""

from dataclasses import replace

import pytest
from small_bed import CASE, FEEDBACK_GAINS, write

from matching.match import map as maps
from matching.match import tolerance as tolerances
from matching.match.case_file import load_case

FEEDBACK = CASE.replace('structure = "observer"', 'structure = "pi"') + FEEDBACK_GAINS
DEAD_TIME, LAG = "loop.dead_time=1 ms:3 ms:2", "loop.inverter_lag=1 ms:2 ms:2"


class Asked(Exception):
    """Raised in the place of a study."""


@pytest.fixture
def content(monkeypatch):
    """Of a study: what its record is kept under."""

    def asked(*_, content, **__):
        raise Asked(content)

    for module in (maps, tolerances):
        monkeypatch.setattr(module, "run", asked)

    def of(study, *given, **named):
        with pytest.raises(Asked) as seen:
            study(*given, **named)
        return str(seen.value)

    return of


def changed(folder, file, before, after):
    """The case, with one of its files changed."""
    path = write(folder, FEEDBACK)
    text = (folder / file).read_text(encoding="utf-8")
    assert before in text
    (folder / file).write_text(text.replace(before, after, 1), encoding="utf-8")
    return load_case(path)


FILES = [
    ("case.toml", "dead_time = 0.0023", "dead_time = 0.0023000001"),
    ("case.toml", "amplitude = 50", "amplitude = 50.00001"),
    ("case.toml", "dynamometer_torque = 1500", "dynamometer_torque = 1500.0001"),
    ("case.toml", "lower = 1, upper = 300 }", "lower = 1, upper = 300.00001 }"),
    ("vehicle.toml", "stiffness = 8000", "stiffness = 8000.00001"),
    ("rig.toml", "J = 0.9", "J = { value = 0.9, lower = 0.8, upper = 1 }"),
]


@pytest.mark.parametrize(("file", "before", "after"), FILES, ids=[after for _, _, after in FILES])
def test_a_change_of_any_file_of_a_case_is_another_study(file, before, after, content, tmp_path):
    first, second = load_case(write(tmp_path, FEEDBACK)), changed(tmp_path, file, before, after)
    added = {"rig.inertias.motor.J": 0.1}
    for study, given, named in (
        (maps.map_case, (DEAD_TIME, LAG, object()), {}), (tolerances.tolerance, (200, None), {"added": added}),
    ):  # fmt: skip
        assert content(study, first, *given, **named) == content(study, replace(first), *given, **named)
        assert content(study, first, *given, **named) != content(study, second, *given, **named)


def test_a_change_of_any_option_is_another_study(content, tmp_path, monkeypatch):
    case = load_case(write(tmp_path, FEEDBACK))
    common = "rig.inertias.motor.J", "rig.inertias.rotor.J"

    def contents():
        return [
            *(content(maps.map_case, case, *axes, object(), **options)
              for axes in ((DEAD_TIME, LAG), (LAG, DEAD_TIME))
              for options in ({}, {"seed": 1}, {"starts": 3})),
            *(content(tolerances.tolerance, case, 200, None, **options)
              for options in ({"added": {common[0]: 0.1}}, {"added": {common[0]: 0.1}, "seed": 1},
                              {"added": {common[0]: 0.11}}, {"added": {common[1]: 0.1}})),
        ]  # fmt: skip

    all_contents = contents()
    for module in (maps, tolerances):
        monkeypatch.setattr(module, "VERSION", "99")
    all_contents += contents()
    assert len(set(all_contents)) == len(all_contents)
