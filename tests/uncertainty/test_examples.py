"""The examples run as scripts do, with their own asserted numbers; the beam against closed forms and another method."""

import importlib.util
from pathlib import Path

import pytest
import sympy
from sympy.physics.continuum_mechanics.beam import Beam

EXAMPLES = Path(__file__).parents[2] / "examples"


def load(name):
    path = EXAMPLES / name
    spec = importlib.util.spec_from_file_location(path.parent.name + "_" + path.stem, path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_sensors(tmp_path, capsys):
    found = load("sensors/run.py").main(tmp_path)
    assert found["torque_M2"] == pytest.approx(0.6916, abs=1e-4)
    assert found["torque_M3"] == pytest.approx(0.6796, abs=1e-4)
    assert "not the authors' budget" in capsys.readouterr().out
    assert len(list(tmp_path.glob("*.svg"))) == 6


def test_fidelity(tmp_path, capsys):
    found = load("fidelity/run.py").main(tmp_path)
    assert f"{100 * found['published']:.2f} {100 * found['definition']:.2f}" == "76.75 88.54"
    assert "divided by 6" in capsys.readouterr().out
    assert (tmp_path / "fig6.svg").exists()


def test_two_span_beam_in_closed_form():
    statics = load("sensors/statics.py")
    load_, span = sympy.symbols("P l", positive=True)
    middle_of_first = [(0, statics.SUPPORT), (span / 2, load_), (span, statics.SUPPORT), (2 * span, statics.SUPPORT)]
    expected = (13 * load_ / 32, 11 * load_ / 16, -3 * load_ / 32)
    assert all(sympy.simplify(a - b) == 0 for a, b in zip(statics.reactions(middle_of_first), expected, strict=True))
    both = [(0, None), (span / 2, load_), (span, None), (3 * span / 2, load_), (2 * span, None)]
    expected = (5 * load_ / 16, 11 * load_ / 8, 5 * load_ / 16)
    assert all(sympy.simplify(a - b) == 0 for a, b in zip(statics.reactions(both), expected, strict=True))


def test_load_side_against_the_deflection_method():
    """SymPy's beam solver integrates the deflection curve and knows nothing of strain energy."""
    statics = load("sensors/statics.py")
    places = {symbol: sympy.Rational(str(value)) for symbol, value in statics.GEOMETRY.items()}
    weights = {statics.G_adapter: 250, statics.G_rotor: 700}
    ours = [value.subs(places | weights) for value in statics.reactions(statics.LOAD_SIDE)]
    stiffness, inertia, c, b, a = sympy.symbols("E I C B A")
    end = places[statics.end]
    beam = Beam(end, stiffness, inertia)
    beam.apply_load(c, 0, -1)
    beam.apply_load(b, places[statics.bearing], -1)
    beam.apply_load(a, end, -1)
    beam.apply_load(-250, places[statics.adapter], -1)
    beam.apply_load(-700, places[statics.rotor], -1)
    beam.bc_deflection = [(0, 0), (places[statics.bearing], 0), (end, 0)]
    beam.solve_for_reaction_loads(c, b, a)
    theirs = [beam.reaction_loads[symbol] for symbol in (c, b, a)]
    assert [float(one) for one in ours] == pytest.approx([float(one) for one in theirs], rel=1e-9)


def test_section_loads_balance():
    """Shear and moment at the flange from the left equal those from the right."""
    statics = load("sensors/statics.py")
    values = statics.GEOMETRY | {statics.G_adapter: 250.0, statics.G_rotor: 700.0}
    shear, moment = (float(load_.subs(values)) for load_ in statics.section_loads(statics.LOAD_SIDE, 1, statics.flange))
    _, at_b, at_a = (float(one.subs(values)) for one in statics.reactions(statics.LOAD_SIDE))
    assert shear == pytest.approx(700 - at_b - at_a)
    flange, bearing, rotor, end = (
        statics.GEOMETRY[one] for one in (statics.flange, statics.bearing, statics.rotor, statics.end)
    )
    assert moment == pytest.approx(at_b * (bearing - flange) + at_a * (end - flange) - 700 * (rotor - flange))
