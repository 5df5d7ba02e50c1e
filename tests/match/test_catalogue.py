"""Adapters that are bought from a catalogue: reading it, and that an order is one of its parts."""

import shutil
from pathlib import Path

import pytest

from matching.match.case_file import load_case
from matching.match.match import match
from modelling.errors import InputError

EXAMPLE = Path("examples/road_to_rig")
FLANGE = "rig.shafts.flange_left.stiffness"


def with_flange(folder, **keys):
    """The reference case with an adapter that may move."""
    for name in ("vehicle.toml", "rig.toml"):
        shutil.copy(EXAMPLE / name, folder)
    entry = ", ".join(f"{key} = {value}" for key, value in {"lower": 1e5, "upper": 4e5, **keys}.items())
    text = (EXAMPLE / "observer.toml").read_text(encoding="utf-8")
    (folder / "case.toml").write_text(f'{text}\n[move]\n"{FLANGE}" = {{ {entry} }}\n', encoding="utf-8")
    return folder / "case.toml"


def test_parts_within_the_bounds_in_rising_order(tmp_path):
    case = load_case(with_flange(tmp_path, catalogue='["250 kN*m/rad", 1.2e5, 9e5, 1.2e5]'))
    assert case.moves[0].catalogue == (1.2e5, 2.5e5)


def test_a_step_counts_from_the_plan(tmp_path):
    parts = load_case(with_flange(tmp_path, step=0.25)).moves[0].catalogue
    assert parts == pytest.approx([1.024e5, 1.28e5, 1.6e5, 2e5, 2.5e5, 3.125e5, 3.90625e5])


@pytest.mark.parametrize(
    ("keys", "wrong"),
    [
        ({"catalogue": "[]"}, "no list of values"),
        ({"catalogue": "[1e3]"}, "no part lies within"),
        ({"catalogue": '["soft"]'}, "no quantity"),
        ({"step": 0}, "no step"),
        ({"step": 0.1, "catalogue": "[2e5]"}, "a catalogue and a step"),
    ],
)
def test_what_is_no_catalogue_is_refused_in_one_line(tmp_path, keys, wrong):
    with pytest.raises(InputError) as fault:
        load_case(with_flange(tmp_path, **keys))
    assert wrong in str(fault.value)
    assert FLANGE in str(fault.value)


@pytest.mark.long
def test_an_order_is_a_part_of_the_catalogue(tmp_path):
    """Planned far too stiff: what is ordered is listed, gains what an order needs, and no other part gains more."""
    listed = (1.1e5, 1.7e5, 2.4e5)
    result = match(load_case(with_flange(tmp_path, planned=4e5, catalogue=list(listed))), beds=100)
    (trade,) = result.adapters
    assert any(trade.ordered == pytest.approx(part) for part in listed)
    assert result.tuned.rig.parameters["shafts.flange_left.stiffness"].value == pytest.approx(trade.ordered)
    assert trade.error_as_ordered < 0.98 * trade.error_as_planned
    assert trade.twist == pytest.approx(2000 / trade.ordered)  # limits."shafts.flange_left.torque"
    for part in listed:
        near = min(trade.curve, key=lambda point: abs(point[0] - part))
        assert trade.error_as_ordered <= 1.02 * near[1]
