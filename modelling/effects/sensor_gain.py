"""A sensor whose scale is off."""

from modelling.effects.kind import Kind, Parameter


class SensorGain(Kind):
    """Reads ``factor`` times the truth."""

    kind = "sensor_gain"
    tables = ("sensors",)
    parameters = {"factor": Parameter("1")}

    def sensor(self, path, p, assembly):
        path.value *= p["factor"]
