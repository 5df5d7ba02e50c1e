"""The car of ``multi_body.py`` as an FMU, for pythonfmu; it begins at a roll of 0.5 m/s."""

import numpy as np
from driving.multi_body import MultiBody
from pythonfmu import Fmi2Causality, Fmi2Slave, Real


class MultiBodySlave(Fmi2Slave):
    """Torques at the rear wheels in, their speeds out."""

    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self._car = MultiBody()
        speeds = self._car.begin(np.full((2, 1), 0.5 / 0.344), np.zeros((2, 1)))
        self.torque_left = self.torque_right = 0.0
        self.speed_left, self.speed_right = speeds[:, 0]
        for name in ("torque_left", "torque_right"):
            self.register_variable(Real(name, causality=Fmi2Causality.input))
        for name in ("speed_left", "speed_right"):
            self.register_variable(Real(name, causality=Fmi2Causality.output))

    def do_step(self, current_time, step_size):
        """Go on by one step."""
        torque = np.array([[self.torque_left], [self.torque_right]])
        self.speed_left, self.speed_right = self._car.step(torque, np.zeros((2, 1)), step_size)[:, 0].tolist()
        return True
