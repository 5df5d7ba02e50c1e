"""A sensor whose zero drifts."""

from modelling.effects.kind import Kind, Parameter


class SensorDrift(Kind):
    """Offset that grows with ``rate`` per second from the start of the recording."""

    kind = "sensor_drift"
    tables = ("sensors",)
    parameters = {"rate": Parameter("sensor/s")}

    def sensor(self, path, p, assembly):
        path.value += p["rate"] * assembly.time
