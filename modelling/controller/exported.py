"""A controller with all that its export needs: law, settings, and what the signals are."""

from __future__ import annotations

from dataclasses import dataclass

from modelling.controller.law import ControlLaw
from modelling.controller.opened_shaft import OpenedShaft, WatchedShafts
from modelling.controller.settings import Settings
from modelling.controller.supervised import SupervisedController


@dataclass(frozen=True)
class ExportedController:
    """What becomes C.

    Attributes
    ----------
    title : str
    law : ControlLaw
    settings : Settings
    units : tuple of str (y)
        SI units of the readings.
    torque_readings, speed_readings : tuple of int (k)
        Which readings are the dynamometers' flange torques and speeds.
    watched : WatchedShafts
        Shafts whose opening is noticed by what it does to the readings.
    shafts : tuple of OpenedShaft
        How the opening of every shaft of the rig is noticed.
    """

    title: str
    law: ControlLaw
    settings: Settings
    units: tuple[str, ...]
    torque_readings: tuple[int, ...]
    speed_readings: tuple[int, ...]
    watched: WatchedShafts
    shafts: tuple[OpenedShaft, ...]

    def running(self) -> SupervisedController:
        """The same controller in Python, at zero torque."""
        return SupervisedController(
            self.law, self.settings, list(self.torque_readings), list(self.speed_readings), self.watched
        )
