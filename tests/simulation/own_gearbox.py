"""A drivetrain with two clutches by equations of its own: rigid dry friction that sticks or slips, no product code.

Four inertias: motor, input of the gearbox, output of the gearbox, wheel. A step solves for the friction of both
clutches at the end of the step: either the clutch sticks and its slip is 0, or its friction is at its capacity. That is
a linear complementarity problem, solved by going through the cases. Nothing gives way, there is no state of a clutch.
"""

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class OwnGearbox:
    """Inertias (kg·m²) of motor, input, output and wheel, shafts (N·m/rad, N·m·s/rad), drags, two ratios."""

    inertias: tuple[float, float, float, float]
    input_shaft: tuple[float, float]
    side_shaft: tuple[float, float]
    drags: tuple[float, float]
    ratios: tuple[float, float]

    def simulate(self, time: np.ndarray, torques: np.ndarray, step: float = 1e-5) -> dict[str, np.ndarray]:
        """From rest under motor torque and two capacities (t, 3), linear in between; readings at the times."""
        J1, J2, J3, J4 = self.inertias
        (k1, c1), (k2, c2), (b1, b4), (i1, i2) = self.input_shaft, self.side_shaft, self.drags, self.ratios
        w1 = w2 = w3 = w4 = twist1 = twist2 = 0.0
        a11, a22, a12 = 1 / J2 + i1**2 / J3, 1 / J2 + i2**2 / J3, 1 / J2 + i1 * i2 / J3
        out = np.zeros((len(time), 4))
        for n, now in enumerate(time[:-1]):
            out[n] = w1, w4, k2 * twist2 + c2 * (w3 - w4), w2 - i1 * w3
            count = round((time[n + 1] - now) / step)
            slope = (torques[n + 1] - torques[n]) / count
            m, one, two = (float(each) for each in torques[n])
            dm, d_one, d_two = (float(each) for each in slope)
            for _ in range(count):
                m, one, two = m + dm, one + d_one, two + d_two
                t1, t2 = k1 * twist1 + c1 * (w1 - w2), k2 * twist2 + c2 * (w3 - w4)
                w1 += step / J1 * (m - b1 * w1 - t1)
                w4 += step / J4 * (t2 - b4 * w4)
                free2, free3 = w2 + step / J2 * t1, w3 - step / J3 * t2
                s1, s2 = (
                    (free2 - i1 * free3) / step,
                    (free2 - i2 * free3) / step,
                )  # slip without friction, over the step
                f1, f2 = _friction(s1, s2, a11, a12, a22, one, two)
                w2, w3 = free2 - step / J2 * (f1 + f2), free3 + step / J3 * (i1 * f1 + i2 * f2)
                twist1 += step * (w1 - w2)
                twist2 += step * (w3 - w4)
        out[-1] = w1, w4, k2 * twist2 + c2 * (w3 - w4), w2 - i1 * w3
        return dict(zip(("motor_speed", "wheel_speed", "side_torque", "slip_1"), out.T, strict=True))


def _friction(s1, s2, a11, a12, a22, one, two):
    """Frictions within their capacities: inside, the slip s − A·f is 0; at the limit the friction opposes the slip."""
    f2 = min(max(s2 / a22, -two), two)
    for _ in range(200):
        f1 = min(max((s1 - a12 * f2) / a11, -one), one)
        new = min(max((s2 - a12 * f1) / a22, -two), two)
        if abs(new - f2) < 1e-9 * (1 + two):
            return f1, new
        f2 = new
    return f1, f2


@dataclass(frozen=True)
class Drawn:
    """One drawn drivetrain, its model file and a shift in the torques (t, 3)."""

    own: OwnGearbox
    toml: str
    time: np.ndarray
    torques: np.ndarray


def drawn(rng: np.random.Generator, deflection: float) -> Drawn:
    """Inertias, shafts and ratios drawn widely, and a shift up under torque: both clutches stick, slip and stick."""

    def around(value: float, factor: float = 1.5) -> float:
        return float(value * factor ** rng.uniform(-1, 1))

    own = OwnGearbox(
        (around(0.06), around(0.02), around(0.05), around(30)), (around(3000), around(1.5)), (around(8000), around(20)),
        (around(0.002), around(0.5)), (float(rng.uniform(10, 14)), float(rng.uniform(6, 8.5))),
    )  # fmt: skip
    time = np.arange(0, 1.6, 1e-3)
    pull = around(100)

    def ramp(begin: float, rise: float) -> np.ndarray:
        return np.clip((time - begin) / rise, 0, 1)

    begin, handing = float(rng.uniform(0.6, 0.75)), float(rng.uniform(0.08, 0.2))
    slide = float(rng.uniform(1.15, 1.5)) * pull  # while it slides, the clutch of the new gear brakes the motor
    closed = 4 * pull
    low = closed * (1 - ramp(begin, handing))
    high = slide * ramp(begin, handing) + (closed - slide) * ramp(float(rng.uniform(1.3, 1.45)), 0.05)
    torques = np.column_stack([pull * ramp(0.1, 0.2), low, high])
    return Drawn(own, _written(own, deflection), time, torques)


def _written(own: OwnGearbox, deflection: float) -> str:
    tables = [
        f"[inertias.{name}]\nJ = {J!r}\ndrag = {drag!r}"
        for name, J, drag in zip(
            ("motor", "input", "output", "wheel"), own.inertias, (own.drags[0], 0.0, 0.0, own.drags[1]), strict=True
        )
    ]
    for name, ends, (k, c) in (
        ("drive", '["motor", "input"]', own.input_shaft), ("side", '["output", "wheel"]', own.side_shaft),
    ):  # fmt: skip
        tables.append(f"[shafts.{name}]\nbetween = {ends}\nstiffness = {k!r}\ndamping = {c!r}")
    tables.append(
        f'[gearboxes.box]\nbetween = ["input", "output"]\nratios = {list(own.ratios)!r}\n'
        f'capacities = ["clutch_1", "clutch_2"]\ndeflection = {deflection!r}\nsettling = 1e-5'
    )
    tables += [f'[inputs.{name}]\non = "{on}"' for name, on in
               (("motor_torque", "motor"), ("clutch_1", "input"), ("clutch_2", "input"))]  # fmt: skip
    tables += [f'[sensors.{name}]\nmeasures = "{measures}"\nof = "{of}"' for name, measures, of in
               (("motor_speed", "speed", "motor"), ("wheel_speed", "speed", "wheel"),
                ("side_torque", "torque", "side"))]  # fmt: skip
    return "\n".join(tables)
