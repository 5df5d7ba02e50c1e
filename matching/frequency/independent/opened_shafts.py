"""The bed as planned with its cut shafts opened, as a lash lets it appear: stated once more, apart from the search."""

from __future__ import annotations

from matching.frequency.case.case import Case

# Of stiffness and damping that is left; a shaft in which a lash is crossed acts on the swing like a softer one
# (describing function: Gelb and Vander Velde, Multiple-Input Describing Functions, 1968).
SHARES_LEFT = (0.001, 0.05, 0.1, 0.2, 0.35, 0.5, 0.7)


def with_opened_shafts(case: Case, share: float) -> dict[str, float]:
    """Values (SI) of the bed, by name, whose followed shafts have ``share`` of their stiffness and damping."""
    quantities = {
        f"shafts.{dynamometer.follows}.{quantity}"
        for dynamometer in case.loop.dynamometers
        for quantity in ("stiffness", "damping")
    }
    return {
        f"rig.{name}": share * parameter.value for name, parameter in case.rig.parameters.items() if name in quantities
    }
