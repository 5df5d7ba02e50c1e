"""A sensor that reads more than is."""

from __future__ import annotations

from typing import TYPE_CHECKING

from modelling.effects.kind import Kind, Parameter

if TYPE_CHECKING:
    from modelling.assembly import Assembly, SensorPath, Symbols


class SensorOffset(Kind):
    """Reads ``offset`` more."""

    kind = "sensor_offset"
    tables = ("sensors",)
    parameters = {"offset": Parameter("sensor")}

    def sensor(self, path: SensorPath, p: Symbols, assembly: Assembly) -> None:
        path.value += p["offset"]
