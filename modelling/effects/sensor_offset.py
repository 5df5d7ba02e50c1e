"""A sensor that reads more than is."""

from modelling.effects.kind import Kind, Parameter


class SensorOffset(Kind):
    """Reads ``offset`` more."""

    kind = "sensor_offset"
    tables = ("sensors",)
    parameters = {"offset": Parameter("sensor")}

    def sensor(self, path, p, assembly):
        path.value += p["offset"]
