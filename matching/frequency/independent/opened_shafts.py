"""The bed as planned with its cut shafts opened, as a lash lets it appear: stated once more, apart from the search."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from matching.frequency.case.case import Case

# Of stiffness and damping that is left; a shaft in which a lash is crossed acts on the swing like a softer one
# (describing function: Gelb and Vander Velde, Multiple-Input Describing Functions, 1968).
SHARES_LEFT = (0.001, 0.05, 0.1, 0.2, 0.35, 0.5, 0.7)


def with_opened_shafts(case: Case, share: float, alone: str | None = None) -> dict[str, float]:
    """Values (SI) of the bed, by name, whose followed shafts have ``share`` of their stiffness and damping.

    ``alone`` names the one shaft that does; without it all do.
    """
    quantities = {
        f"shafts.{dynamometer.follows}.{quantity}"
        for dynamometer in case.loop.dynamometers
        if alone in (None, dynamometer.follows)
        for quantity in ("stiffness", "damping")
    }
    return {
        f"rig.{name}": share * parameter.value for name, parameter in case.rig.parameters.items() if name in quantities
    }


def dampings_opened(
    case: Case, damping: Callable[[Mapping[str, float]], float]
) -> tuple[dict[float, float], dict[str, dict[float, float]]]:
    """Least damping ratios by share, of all followed shafts opened together and, by its name, of each one alone."""
    together = {share: damping(with_opened_shafts(case, share)) for share in SHARES_LEFT}
    names = [dynamometer.follows for dynamometer in case.loop.dynamometers]
    if len(names) == 1:
        return together, {names[0]: together}
    return together, {
        name: {share: damping(with_opened_shafts(case, share, name)) for share in SHARES_LEFT} for name in names
    }
