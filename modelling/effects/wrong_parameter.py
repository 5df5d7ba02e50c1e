"""A value given as known that is not so."""

from __future__ import annotations

from typing import TYPE_CHECKING

from modelling.effects.kind import Kind, Parameter

if TYPE_CHECKING:
    from modelling.system import System


class WrongParameter(Kind):
    """The quantity at the place (e.g. ``inertias.body.J``) is ``value`` instead; the assembly reads it from here."""

    kind = "wrong_parameter"
    tables = ("inertias", "shafts", "gears")
    parameters = {"value": Parameter("quantity")}

    def places(self, system: System) -> list[str]:
        return [name for name in system.parameters if name.count(".") == 2]
