"""A sensor that reads the past."""

from __future__ import annotations

from typing import TYPE_CHECKING

from modelling.effects.kind import Kind, Parameter

if TYPE_CHECKING:
    from modelling.assembly import Assembly, SensorPath, Symbols


class SensorDelay(Kind):
    """Reads what was ``delay`` (s) ago."""

    kind = "sensor_delay"
    tables = ("sensors",)
    parameters = {"delay": Parameter("s", lower=0.0)}

    def sensor(self, path: SensorPath, p: Symbols, assembly: Assembly) -> None:
        path.delay += p["delay"]
