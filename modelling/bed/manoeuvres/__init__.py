"""Manoeuvres: torques over time, as drivability is tested."""

from modelling.bed.manoeuvres.read import from_table, read_manoeuvre
from modelling.bed.manoeuvres.sequence import RecordedTorque, Segments
from modelling.bed.manoeuvres.shapes import KINDS, BackOut, DriveAway, Kick, Manoeuvre, Step, Sweep, TipIn

__all__ = [
    "KINDS", "BackOut", "DriveAway", "Kick", "Manoeuvre", "RecordedTorque", "Segments", "Step", "Sweep", "TipIn",
    "from_table", "read_manoeuvre",
]  # fmt: skip
