"""A sensor that reads the past."""

from modelling.effects.kind import Kind, Parameter


class SensorDelay(Kind):
    """Reads what was ``delay`` (s) ago."""

    kind = "sensor_delay"
    tables = ("sensors",)
    parameters = {"delay": Parameter("s", lower=0.0)}

    def sensor(self, path, p, assembly):
        path.delay += p["delay"]
