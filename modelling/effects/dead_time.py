"""An input that acts later than it was recorded."""

from modelling.effects.kind import Kind, Parameter


class DeadTime(Kind):
    """Acts ``delay`` (s) later than recorded."""

    kind = "dead_time"
    tables = ("inputs",)
    parameters = {"delay": Parameter("s", lower=0.0)}

    def input(self, path, p, assembly):
        path.delay += p["delay"]
