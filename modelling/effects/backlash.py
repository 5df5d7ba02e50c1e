"""Free play of a shaft."""

from modelling.effects.kind import Kind, Parameter


class Backlash(Kind):
    """Dead zone of width ``gap`` (rad, total) in the twist; no pull across it."""

    kind = "backlash"
    tables = ("shafts",)
    parameters = {"gap": Parameter("rad", lower=0.0)}

    def shaft(self, law, p, assembly):
        law.gap = p["gap"]
