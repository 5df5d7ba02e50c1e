"""An input that acts with a factor."""

from modelling.effects.kind import Kind, Parameter


class InputGain(Kind):
    """Acts with ``factor`` times the recorded value."""

    kind = "input_gain"
    tables = ("inputs",)
    parameters = {"factor": Parameter("1")}

    def input(self, path, p, assembly):
        path.value *= p["factor"]
