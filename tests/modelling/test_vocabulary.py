"""What files may say: kinds of effects, control structures, units, with their names, units, bounds and defaults.

Others' files depend on all of it, so a change is read before it is kept.
"""

import pytest
from kept_values import same_statement

from modelling.bed.controllers import STRUCTURES
from modelling.effects import EFFECTS
from modelling.effects.effect import Kind
from modelling.units import INPUT_UNITS, QUANTITY_UNITS, SENSOR_UNITS

STATED = [name for name in Kind.__annotations__ if name != "kind"]


@pytest.mark.parametrize("kind", sorted(EFFECTS))
def test_kinds_of_effects_state_what_they_always_stated(kind):
    effect = EFFECTS[kind]
    assert effect.kind == kind
    plain = {name: getattr(Kind, name) for name in STATED}
    stated = {name: getattr(effect, name) for name in STATED}
    same_statement(f"effect {kind}", {name: value for name, value in stated.items() if value != plain[name]})


@pytest.mark.parametrize("name", sorted(STRUCTURES))
def test_control_structures_have_the_quantities_and_blocks_that_they_always_had(name):
    structure = STRUCTURES[name]
    same_statement(f"structure {name}", {"quantities": structure.quantities, "blocks": structure.blocks})


def test_quantities_have_the_units_that_they_always_had():
    same_statement("units", {"quantities": QUANTITY_UNITS, "inputs": INPUT_UNITS, "sensors": SENSOR_UNITS})
