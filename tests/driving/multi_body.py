"""A car that nobody here wrote: the multi-body model of CommonRoad (Althoff et al.) as a vehicle at the cut, 29 states.

Its rear wheels are driven by the torques at the cuts; all four are braked. It creeps kinematically below 0.1 m/s, so
drives begin at a roll. It needs ``commonroad-vehicle-models``, of which a dependency has no wheel: install it by hand.
"""

import numpy as np
from vehiclemodels.init_mb import init_mb
from vehiclemodels.parameters_vehicle2 import parameters_vehicle2
from vehiclemodels.vehicle_dynamics_mb import vehicle_dynamics_mb

REAR, FRONT = (25, 26), (23, 24)
STIFFEST = 8.4e3  # m/s²: over the speed it is the fastest rate of a wheel, 1/s, by its slip


class MultiBody:
    """One car as a ``Vehicle``: torques at the rear wheels in, their speeds out; ``steering``: rad/s over s."""

    cuts, own, count = ("left", "right"), ("brake_left", "brake_right"), 1

    def __init__(self, steering=lambda _: 0.0):
        self.p, self.steering = parameters_vehicle2(), steering
        self.begin(np.zeros((2, 1)), np.zeros((2, 1)))

    def begin(self, speed, torque):
        """Straight on; its states can be set."""
        self.x, self.time = np.array(init_mb([0, 0, 0, float(speed.mean()) * self.p.R_w, 0, 0, 0], self.p)), 0.0
        return self.speeds

    @property
    def speeds(self):
        return self.x[list(REAR)][:, None].copy()

    def rates(self, x, torque, brake):
        made = np.array(vehicle_dynamics_mb(x, [self.steering(self.time), 0.0], self.p))
        made[list(REAR)] += (torque - brake * np.tanh(x[list(REAR)] / 0.1)) / self.p.I_y_w
        made[list(FRONT)] -= brake * np.tanh(x[list(FRONT)] / 0.1) / self.p.I_y_w
        return made

    def step(self, torque, own, span):
        """Runge and Kutta's classical method, as fine as slow wheels need it."""
        fine = max(int(np.ceil(span * STIFFEST / max(abs(self.x[3]), 0.3) / 1.5)), 1)
        h, given = span / fine, (torque[:, 0], own[:, 0])
        for _ in range(fine):
            a = self.rates(self.x, *given)
            b = self.rates(self.x + h / 2 * a, *given)
            c = self.rates(self.x + h / 2 * b, *given)
            d = self.rates(self.x + h * c, *given)
            self.x = self.x + h / 6 * (a + 2 * b + 2 * c + d)
            self.time += h
        return self.speeds
