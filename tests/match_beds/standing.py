"""Standing beds under the exported controller, stepped by a bed of its own: exact matrices, encoders that count."""

import numpy as np
from match_beds.free_play import Train, machines_of, own_values
from scipy.linalg import expm

from modelling.controller.batch import ControllerBatch

FINE = 4  # pieces of a sample, in which a command may arrive
HOLD_S = 3.0


class StandingBeds:
    """Rigs of a case with values (dict) each, in fine exact steps; states [train, air gap, flanges]."""

    def __init__(self, case, rows):
        self.case, self.step = case, case.loop["sample_time"]
        trains = [Train(case.rig, own_values(row, case.rig, "rig.")) for row in rows]
        machines = machines_of(case, rows)
        self.k, x = len(machines), len(trains[0].A)
        self.flanges = [j for j, one in enumerate(machines) if one.flange is not None]
        size, h = x + self.k + len(self.flanges), self.step / FINE
        self.A, self.B = [], []
        for i, train in enumerate(trains):
            A, B = np.zeros((size, size)), np.zeros((size, self.k))
            A[:x, :x] = train.A
            for j, one in enumerate(machines):
                A[:x, x + j] = one.gains[i] * train.driven(one.input)
                A[x + j, x + j], B[x + j, j] = -1 / one.lags[i], 1 / one.lags[i]
            for at, j in enumerate(self.flanges, x + self.k):
                sensed, _ = train.sensed(machines[j].flange)
                A[at, :x], A[at, at] = sensed / machines[j].flange_lags[i], -1 / machines[j].flange_lags[i]
            block = np.zeros((size + self.k,) * 2)
            block[:size, :size], block[:size, size:] = A, B
            grown = expm(block * h)
            self.A.append(grown[:size, :size])
            self.B.append(grown[:size, size:])
        self.A, self.B = np.stack(self.A), np.stack(self.B)
        # the dead time counts half a sample of hold
        late = np.maximum(np.array([one.delays for one in machines]).T - self.step / 2, 0.0)  # (b, k)
        middles = (np.arange(FINE) + 0.5) * h
        self.ago = -np.floor((middles[:, None, None] - late) / self.step + 1e-9).astype(int)  # (FINE, b, k)
        self.train, self.x, self.names = trains[0], x, [machines[j].flange for j in self.flanges]
        self.trains = trains
        self.states = np.zeros((len(rows), size))
        self.sent = np.zeros((self.ago.max() + 1, len(rows), self.k))

    def rows_of(self, names):
        """Rows (b, y, x) of sensors by name, flanges behind their lag."""
        made = np.zeros((len(self.trains), len(names), self.states.shape[1]))
        for i, train in enumerate(self.trains):
            for number, name in enumerate(names):
                if name in self.names:
                    made[i, number, self.x + self.k + self.names.index(name)] = 1.0
                else:
                    made[i, number, : self.x] = train.sensed(name)[0]
        return made

    def advance(self, commands):
        """A sample under commands (b, k) issued now."""
        self.sent = np.concatenate([commands[None], self.sent[:-1]])
        bed, machine = np.arange(len(self.states))[:, None], np.arange(self.k)
        for piece in range(FINE):
            acting = self.sent[self.ago[piece], bed, machine]
            self.states = (self.A @ self.states[..., None] + self.B @ acting[..., None])[..., 0]


def largest_motion(case, controller, rows, zeros, seconds, counts, seed):
    """rad/s (b,) by which a rotor of each standing bed turns at most, after a speed hold, in so many seconds.

    Parameters
    ----------
    zeros : ndarray (b, k)
        N·m, by which the flanges' zeros step as emulation begins.
    counts : ndarray (y,)
        rad of a count of each of the controller's sensors that is an encoder, else 0; others have white noise of their
        stated uncertainty.
    """
    law, random = controller.law, np.random.default_rng(seed)
    beds, batch = StandingBeds(case, rows), ControllerBatch(controller, len(rows))
    known = {sensor.name: sensor for sensor in case.rig.sensors}
    noise = np.where(counts > 0, 0.0, [known[name].uncertainty for name in law.sensors])
    C, rotors = beds.rows_of(law.sensors), beds.rows_of([one.speed_sensor for one in case.loop.dynamometers])
    offset = np.zeros((len(rows), len(law.sensors)))
    for j, one in enumerate(case.loop.dynamometers):
        if one.torque_sensor is not None:
            offset[:, law.sensors.index(one.torque_sensor)] = zeros[:, j]
    begun, ended = round(HOLD_S / beds.step), round((HOLD_S + seconds) / beds.step)
    angle, before = random.uniform(0, 1, C.shape[:2]) * counts, np.zeros(C.shape[:2])
    told, hold, most, first = np.zeros((len(law.known), len(rows))), np.zeros((beds.k, len(rows))), 0.0, None
    for n in range(ended):
        true = (C @ beds.states[..., None])[..., 0]
        turned = angle + true * beds.step  # of an encoder that counts: the angle is known to a count at each sample
        safe = np.where(counts > 0, counts, 1.0)
        counted = np.floor(turned / safe) * safe
        read = np.where(counts > 0, (counted - before) / beds.step if n else 0.0, true)
        angle, before = turned, counted
        read = (
            read + noise * random.standard_normal(read.shape) + (n > begun) * offset
        )  # after the sample from which it begins
        commands, _, faults = batch.step(read.T, told, 1 if n < begun else 2, hold, n)
        assert not faults.any()
        turning = (rotors @ beds.states[..., None])[..., 0]
        if n == begun:
            first = turning
        if n >= begun:
            most = np.maximum(most, np.abs(turning - first).max(axis=1))
        beds.advance(commands.T)
    return most
