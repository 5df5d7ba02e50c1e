"""The drivetrain of ``own_gearbox.py`` with dog clutches: teeth that are in hold rigidly, by impact where they come in.

Own equations: a dog that is asked for and whose slip is below a bound comes in; its slip is 0 from the next step on,
whatever torque that takes (an impulse at first, without loss of the momentum of all that turns). Without being asked
for it is out.
"""

import numpy as np
from simulation.own_gearbox import OwnGearbox, _friction

HOLDS = 1e12  # N·m


def simulate_dogs(own: OwnGearbox, time, torques, below, step=1e-5):
    """From rest under motor torque and two requests (t, 3); readings at the times, and what came in: time, gear, slip,
    impulse at the gearbox's input (N·m·s)."""
    J1, J2, J3, J4 = own.inertias
    (k1, c1), (k2, c2), (b1, b4), ratios = own.input_shaft, own.side_shaft, own.drags, own.ratios
    i1, i2 = ratios
    a11, a22, a12 = 1 / J2 + i1**2 / J3, 1 / J2 + i2**2 / J3, 1 / J2 + i1 * i2 / J3
    w1 = w2 = w3 = w4 = twist1 = twist2 = 0.0
    out, events, teeth = np.zeros((len(time), 4)), [], [False, False]
    for n, now in enumerate(time[:-1]):
        out[n] = w1, w4, k2 * twist2 + c2 * (w3 - w4), w2 - i1 * w3
        count = round((time[n + 1] - now) / step)
        slope = (torques[n + 1] - torques[n]) / count
        values = torques[n].copy()
        for piece in range(count):
            values = values + slope
            for gear in (0, 1):
                slip = w2 - ratios[gear] * w3
                asked = values[1 + gear] > 1e-9
                if asked and not teeth[gear] and abs(slip) < below:
                    events.append((now + piece * step, gear + 1, slip, slip / (a11, a22)[gear]))
                teeth[gear] = asked and (teeth[gear] or abs(slip) < below)
            t1, t2 = k1 * twist1 + c1 * (w1 - w2), k2 * twist2 + c2 * (w3 - w4)
            w1 += step / J1 * (values[0] - b1 * w1 - t1)
            w4 += step / J4 * (t2 - b4 * w4)
            free2, free3 = w2 + step / J2 * t1, w3 - step / J3 * t2
            s1, s2 = (free2 - i1 * free3) / step, (free2 - i2 * free3) / step
            f1, f2 = _friction(s1, s2, a11, a12, a22, *(HOLDS if each else 0.0 for each in teeth))
            w2, w3 = free2 - step / J2 * (f1 + f2), free3 + step / J3 * (i1 * f1 + i2 * f2)
            twist1 += step * (w1 - w2)
            twist2 += step * (w3 - w4)
    out[-1] = w1, w4, k2 * twist2 + c2 * (w3 - w4), w2 - i1 * w3
    return dict(zip(("motor_speed", "wheel_speed", "side_torque", "slip_1"), out.T, strict=True)), events


def drawn_shift(own: OwnGearbox, rng):
    """Times and torques (t, 3): away in gear 1, out of it, the motor braked until the teeth of gear 2 come in."""
    time = np.arange(0, 1.8, 1e-3)
    pull, out, hold = rng.uniform(60, 110), rng.uniform(0.55, 0.65), rng.uniform(1000, 3000)
    motor = pull * np.clip((time - 0.05) / 0.2, 0, 1) * np.clip((out - 0.02 - time) / 0.1, 0, 1)
    brake = -rng.uniform(15, 30) * (time > out + 0.03)
    # the driver's motor brakes until a while after both speeds have to meet; then it pulls again
    meet = out + 0.03 + 0.55
    motor = motor + np.where(time < meet, brake, 0.8 * pull * np.clip((time - meet) / 0.15, 0, 1))
    return time, np.stack([motor, hold * (time < out), hold * (time > out + 0.05)], axis=1)
