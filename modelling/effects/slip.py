"""Tyre slip or another damper in series with a shaft."""

from __future__ import annotations

from typing import TYPE_CHECKING

from modelling.effects.kind import Kind, Parameter

if TYPE_CHECKING:
    from modelling.assembly import Assembly, ShaftLaw, Symbols


class Slip(Kind):
    """A damper of ``coefficient`` (N·m·s/rad) in series: the spring relaxes (tyre slip, relaxation length)."""

    kind = "slip"
    tables = ("shafts",)
    parameters = {"coefficient": Parameter("N*m*s/rad", lower=1e-9)}

    def shaft(self, law: ShaftLaw, p: Symbols, assembly: Assembly) -> None:
        law.series = p["coefficient"]
