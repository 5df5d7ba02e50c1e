"""Free play of a shaft."""

from __future__ import annotations

from typing import TYPE_CHECKING

from modelling.effects.kind import Kind, Parameter

if TYPE_CHECKING:
    from modelling.assembly import Assembly, ShaftLaw, Symbols


class Backlash(Kind):
    """Dead zone of width ``gap`` (rad, total) in the twist; no pull across it."""

    kind = "backlash"
    tables = ("shafts",)
    parameters = {"gap": Parameter("rad", lower=0.0)}

    def shaft(self, law: ShaftLaw, p: Symbols, assembly: Assembly) -> None:
        law.gap = p["gap"]
