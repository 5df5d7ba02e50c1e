"""A value given as known that is not so."""

from modelling.effects.kind import Kind, Parameter


class WrongParameter(Kind):
    """The quantity at the place (e.g. ``inertias.body.J``) is ``value`` instead; the assembly reads it from here."""

    kind = "wrong_parameter"
    tables = ("inertias", "shafts", "gears")
    parameters = {"value": Parameter("quantity")}

    def places(self, system):
        return [name for name in system.parameters if name.count(".") == 2]
