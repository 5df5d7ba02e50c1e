"""What a recording holds, in words."""

from __future__ import annotations

from modelling.measurement.recording import Recording
from modelling.model.system import System


def contents_of(recording: Recording, system: System) -> str:
    """Samples, length, inputs and sensors of a system's recording, and what is to note of it, in one line."""
    inputs, sensors = [part.name for part in system.inputs], recording.sensors(system)
    notes = "".join(f"; note: {note}" for note in recording.notes)
    return (
        f"a recording: {len(recording.time)} samples over {recording.time[-1] - recording.time[0]:g} s, "
        f"inputs {', '.join(inputs) or 'none'}, sensors {', '.join(sensors) or 'none'}{notes}"
    )
