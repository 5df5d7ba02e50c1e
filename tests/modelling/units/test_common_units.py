"""The units that Pint is not asked for are Pint's."""

import pytest

from modelling.units import BY_TEXT, registry


@pytest.mark.parametrize("text", BY_TEXT)
def test_name_and_value_are_pints(text):
    units, known = registry(), BY_TEXT[text]
    prefix, base, _ = units.parse_unit_name(text)[0]
    assert (known.name, known.base) == (prefix + base, base)
    assert known.value == pytest.approx(units.Quantity(1.0, known.name).to_base_units().magnitude, rel=4e-16)
