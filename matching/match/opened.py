"""Cut shafts that free play opens: what a bed may then appear to be, and which of these beds a search looks at."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from matching.match.case import Case

# --- Beds whose cut shafts have less stiffness and damping.

# Of stiffness and damping that is left, from a shaft that carries next to nothing to one that opens for moments. A
# lash that is crossed within a swing acts on the swing like a softer spring and damper, by the share of it that the
# flanks touch (describing function: Gelb and Vander Velde, Multiple-Input Describing Functions, 1968). So a share at
# which the bed is not stable is an amplitude at which it may swing on. From one share to the next a frequency moves by
# less than a fifth, which no unstable range hides between.
SHARES = (0.001, 0.03, 0.07, 0.1, 0.14, 0.2, 0.28, 0.38, 0.5, 0.65, 0.8)
STAYS_OPEN_S = 60.0  # no play stays open for so long: what grows slower than in this time is no matter of play


@dataclass(frozen=True)
class Opened:
    """Share of the cut shafts' stiffness and damping that remains; ``alone`` names the one reduced shaft, else all."""

    share: float = 1.0
    alone: str | None = None

    @property
    def damping_left(self) -> float:
        """Part of a shaft's damping ratio that is left with so much of its stiffness and damping: the root of it."""
        return float(np.sqrt(self.share))

    def values(self, case: Case, values: Mapping[str, float]) -> dict[str, float]:
        """Values (SI) by name of a bed, with the shafts that its dynamometers follow opened."""
        known, made = case.rig.parameters, dict(values)
        if self.share == 1.0:
            return made
        for dynamometer in case.loop.dynamometers:
            for quantity in ("stiffness", "damping") if self.alone in (None, dynamometer.follows) else ():
                name = f"shafts.{dynamometer.follows}.{quantity}"
                if name in known:
                    made[f"rig.{name}"] = self.share * values.get(f"rig.{name}", known[name].value)
        return made


CLOSED = Opened()


def openings(case: Case) -> tuple[Opened, ...]:
    """All shares, of all cut shafts together and, where there are several, of each alone."""
    shafts = [dynamometer.follows for dynamometer in case.loop.dynamometers]
    ways: list[str | None] = [None, *(shafts if len(shafts) > 1 else [])]
    return tuple(Opened(share, alone) for alone in ways for share in SHARES)


@dataclass(frozen=True)
class OpenedSettings:
    """Which opened beds a search looks at.

    Attributes
    ----------
    active : int
        Opened beds of the pool that are added to the active set at a time: the least stable ones.
    starts : int
        Starts that are followed; where each of them ends with an opened bed that is not stable, the search begins again
        without opened beds.
    """

    active: int = 6
    starts: int = 3


OPENED = OpenedSettings()
