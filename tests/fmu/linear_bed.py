"""The linear bed of a case, by half samples, with a queue for the dead time: for controllers stepped one by one."""

import numpy as np

from modelling.linear.state_space import discretise


class LinearBed:
    """A bed at rest: deviations from a steady state; k dynamometers, d other inputs of the rig."""

    def __init__(self, parts, loop):
        self.k, self.bed, step = len(parts.dynamometers), parts.bed, loop["sample_time"]
        self.read = self.bed.readings
        self.half = discretise(self.bed.A, np.hstack([self.bed.commands, self.bed.torques]), step / 2)
        self.queue = [np.zeros(self.k)] * round(loop["dead_time"] / (step / 2) - 1)  # less the half sample of hold
        self.x = np.zeros(len(self.bed.A))

    def readings(self):
        """Flange torques, speeds and the loop's further sensors (y,)."""
        return self.read @ self.x

    def step(self, command, drive, after):
        """One sample with commands (k,) held; other inputs (d,) go straight from ``drive`` to ``after``."""
        for begin in (drive, (drive + after) / 2):
            self.queue.append(np.array(command))
            held = self.half.held @ np.concatenate([self.queue.pop(0), begin])
            self.x = self.half.transition @ self.x + held + self.half.ramp[:, self.k :] @ (after - drive) / 2
