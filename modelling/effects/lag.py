"""First-order lag of an input or a sensor."""

from modelling.effects.kind import Kind, Parameter


class Lag(Kind):
    """First-order lag with ``time_constant`` (s)."""

    kind = "lag"
    tables = ("inputs", "sensors")
    parameters = {"time_constant": Parameter("s", lower=1e-7)}

    def input(self, path, p, assembly):
        value = path.value
        path.value = assembly.state(f"{path.place}.lag", lambda lagged: (value - lagged) / p["time_constant"])

    def sensor(self, path, p, assembly):
        self.input(path, p, assembly)
