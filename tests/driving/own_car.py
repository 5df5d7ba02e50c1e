"""A car and its test bed as equations of this file alone, many side by side, by Runge and Kutta's classical method.

Nothing of rigmatch is used: values come from the TOML files, laws from the literature (contact patch with a relaxation
length and the Magic Formula: Pacejka, Tire and Vehicle Dynamics, 3rd ed. 2012, sections 4.3 and 7.2).
"""

import tomllib

import numpy as np

FINE = 2e-4  # s
SHAPE = 1.65
SETTLES = 0.02  # rad/s up to which dry friction rises
PAD_SETTLES = 0.002  # s
COUNTS = 8192  # of an encoder's turn
SIDES = ("left", "right")


def values_of(path):
    """Inertias (J, drag), shafts (stiffness, damping, ratio) and effects of a model file."""
    data = tomllib.loads(path.read_text())
    inertias = {name: (part["J"], part.get("drag", 0.0)) for name, part in data["inertias"].items()}
    shafts = {name: (part["stiffness"], part["damping"]) for name, part in data["shafts"].items()}
    return inertias, shafts, data["shafts"]["gear_output"]["ratio"], data.get("effects", [])


class Drive:
    """Motor to differential and side shafts; what hangs on the side shafts is a car's wheels or a bed's rotors.

    ``factors`` (dict of name to (b,)) multiply values: ``inertias.motor.J``, ``shafts.side_left.stiffness``, …
    ``play`` (b,) is the whole free play of each side shaft, rad, ``friction`` (b,) dry friction of the differential.
    """

    def __init__(self, path, factors, count, play=None, friction=None):
        inertias, shafts, self.ratio, effects = values_of(path)
        one = np.ones(count)
        self.J = {name: J * factors.get(f"inertias.{name}.J", one) for name, (J, _) in inertias.items()}
        self.drag = {name: drag * factors.get(f"inertias.{name}.drag", one) for name, (_, drag) in inertias.items()}
        self.k = {name: k * factors.get(f"shafts.{name}.stiffness", one) for name, (k, _) in shafts.items()}
        self.c = {name: c * factors.get(f"shafts.{name}.damping", one) for name, (_, c) in shafts.items()}
        self.effects = {(one["kind"], one["at"]): one for one in effects}
        self.play = np.zeros(count) if play is None else play
        self.friction = np.zeros(count) if friction is None else friction
        self.count = count

    def shaft(self, name, twist, rate, play=0.0):
        """Torque of a shaft; none within its free play, and never one that pulls where it pushes."""
        over = np.sign(twist) * np.maximum(np.abs(twist) - play / 2, 0.0)
        torque = self.k[name] * over + self.c[name] * rate * ((np.abs(over) > 0) | (play == 0))
        pushes = (np.abs(over) > 0) & (np.sign(torque) == np.sign(over))
        return np.where(pushes | (play == 0), torque, 0.0)

    def front(self, s, motor_torque, slopes):
        """Rates of motor, gearbox and differential but for the side shafts; torque into the differential."""
        mesh = self.shaft("gear_mesh", s["mesh"], s["motor"] - s["gearbox"])
        out_rate = s["gearbox"] / self.ratio - s["diff"]
        output = self.shaft("gear_output", s["output"], out_rate)
        slopes["motor"] = (motor_torque - mesh - self.drag["motor"] * s["motor"]) / self.J["motor"]
        slopes["gearbox"] = (mesh - output / self.ratio - self.drag["gearbox"] * s["gearbox"]) / self.J["gearbox"]
        slopes["mesh"], slopes["output"] = s["motor"] - s["gearbox"], out_rate
        return output


class Car(Drive):
    """The vehicle; states by name, each (b,). Its drive is the motor's torque (b,), or that and the brakes' (2, b)."""

    names = (
        "motor", "gearbox", "diff", "mesh", "output",
        *(f"{part}_{side}" for side in SIDES for part in ("wheel", "tyre", "body", "side", "belt", "slip", "pad")),
    )  # fmt: skip

    def brake(self, side, wheel, pad, pulled):
        """Torque against a wheel, and the rate of the pad's deflection: it sticks as a spring, slides as friction."""
        most = self.effects.get(("brake", f"inputs.brake_{side}"), {"deflection": 1.0})["deflection"]
        pad_rate = wheel - np.abs(wheel) * pad / most
        return pulled * (pad + PAD_SETTLES * pad_rate) / most, pad_rate

    def tyre(self, side, tyre, body, z):
        """Torque of a tyre whose carcass is deflected by z, and the rate of z: a slip that saturates, or a damper."""
        k, c = self.k[f"tyre_body_{side}"], self.c[f"tyre_body_{side}"]
        place = f"shafts.tyre_body_{side}"
        if ("slip", place) in self.effects:
            damper = self.effects["slip", place]["coefficient"]
            z_rate = (damper * (tyre - body) - k * z) / (damper + c)
            return k * z + c * z_rate, z_rate
        law, v = self.effects["tyre_slip", place], np.abs(body)
        z_rate = (law["slip_stiffness"] * (tyre - body) - v * k * z) / (law["slip_stiffness"] + v * c)
        linear = k * z + c * z_rate
        return law["peak"] * np.sin(SHAPE * np.arctan(linear / (SHAPE * law["peak"]))), z_rate

    def rates(self, s, drive):
        slopes, (motor_torque, brakes) = {}, (drive, np.zeros((2, 1))) if np.ndim(drive) < 2 else (drive[0], drive[1:])
        into = self.front(s, motor_torque, slopes)
        for side in SIDES:
            wheel, tyre, body = (s[f"{part}_{side}"] for part in ("wheel", "tyre", "body"))
            twist_rate = s["diff"] - wheel
            torque = self.shaft(f"side_{side}", s[f"side_{side}"], twist_rate, self.play)
            belt = self.shaft(f"wheel_tyre_{side}", s[f"belt_{side}"], wheel - tyre)
            road, z_rate = self.tyre(side, tyre, body, s[f"slip_{side}"])
            air = self.effects.get(("quadratic_drag", f"inertias.body_{side}"), {"coefficient": 0.0})["coefficient"]
            rolling = self.effects.get(("coulomb_friction", f"inertias.body_{side}"), {"torque": 0.0})["torque"]
            against = air * body * np.abs(body) + rolling * np.tanh(body / SETTLES) + self.drag[f"body_{side}"] * body
            braked, slopes[f"pad_{side}"] = self.brake(side, wheel, s[f"pad_{side}"], brakes[SIDES.index(side)])
            slopes[f"wheel_{side}"] = (torque - belt - braked) / self.J[f"wheel_{side}"]
            slopes[f"tyre_{side}"] = (belt - road) / self.J[f"tyre_{side}"]
            slopes[f"body_{side}"] = (road - against) / self.J[f"body_{side}"]
            slopes[f"side_{side}"], slopes[f"belt_{side}"], slopes[f"slip_{side}"] = twist_rate, wheel - tyre, z_rate
            into = into - torque
            s[f"side_{side}_torque"] = torque
        slopes["diff"] = (into - self.friction * np.tanh(s["diff"] / SETTLES)) / self.J["differential"]
        return slopes


class Bed(Drive):
    """The bed with inverter and flange lags; ``air_*`` are air-gap torques, ``read_*`` lagged flange torques."""

    names = (
        "motor", "gearbox", "diff", "mesh", "output",
        *(f"{part}_{side}" for side in SIDES for part in ("adapter", "rotor", "side", "flange", "air", "read")),
        *(f"angle_{side}" for side in SIDES), "motor_angle",
    )  # fmt: skip

    def __init__(self, path, factors, count, inverter, sensor, gains, play=None, friction=None):
        super().__init__(path, factors, count, play, friction)
        self.inverter, self.sensor, self.gains = inverter, sensor, gains

    def rates(self, s, drive, acting):
        slopes, motor_torque = {}, drive if np.ndim(drive) < 2 else drive[0]
        into = self.front(s, motor_torque, slopes)
        for number, side in enumerate(SIDES):
            adapter, rotor = s[f"adapter_{side}"], s[f"rotor_{side}"]
            twist_rate = s["diff"] - adapter
            torque = self.shaft(f"side_{side}", s[f"side_{side}"], twist_rate, self.play)
            flange = self.shaft(f"flange_{side}", s[f"flange_{side}"], adapter - rotor)
            air = s[f"air_{side}"]
            slopes[f"adapter_{side}"] = (torque - flange) / self.J[f"adapter_{side}"]
            drag = self.drag[f"rotor_{side}"] * rotor
            slopes[f"rotor_{side}"] = (flange + self.gains[number] * air - drag) / self.J[f"rotor_{side}"]
            slopes[f"side_{side}"], slopes[f"flange_{side}"] = twist_rate, adapter - rotor
            slopes[f"air_{side}"] = (acting[number] - air) / self.inverter
            slopes[f"read_{side}"] = (flange - s[f"read_{side}"]) / self.sensor
            slopes[f"angle_{side}"] = rotor
            into = into - torque
            s[f"side_{side}_torque"] = torque
        slopes["motor_angle"] = s["motor"]
        slopes["diff"] = (into - self.friction * np.tanh(s["diff"] / SETTLES)) / self.J["differential"]
        return slopes


def step(system, state, *inputs):
    """A fine step; inputs are held."""
    h = FINE

    def moved(slopes, share):
        return {name: state[name] + share * h * slopes[name] for name in system.names}

    k1 = system.rates(dict(state), *inputs)
    k2 = system.rates(moved(k1, 0.5), *inputs)
    k3 = system.rates(moved(k2, 0.5), *inputs)
    k4 = system.rates(moved(k3, 1.0), *inputs)
    return {name: state[name] + h / 6 * (k1[name] + 2 * k2[name] + 2 * k3[name] + k4[name]) for name in system.names}


def still(system, speed):
    """States of a system that turns as one, bodies or rotors at speeds (b,) in rad/s; nothing twisted."""
    turning = {"motor": system.ratio, "gearbox": system.ratio}
    angles = ("mesh", "output", "side", "belt", "slip", "flange", "air", "read", "angle", "motor_angle", "pad")
    return {name: 0.0 * speed if name.startswith(angles) else speed * turning.get(name, 1.0) for name in system.names}


def steady(car, bed, speed):
    """Car and bed in steady motion at the bodies' speeds (b,), and the motor torque (b,) that holds it; rest at 0."""
    law = car.effects["tyre_slip", "shafts.tyre_body_left"]
    air = car.effects["quadratic_drag", "inertias.body_left"]["coefficient"]
    rolling = car.effects["coulomb_friction", "inertias.body_left"]["torque"]
    load = air * speed**2 + rolling * np.tanh(speed / SETTLES) + car.drag["body_left"] * speed
    linear = SHAPE * law["peak"] * np.tan(np.arcsin(load / law["peak"]) / SHAPE)
    wheel = speed * (1 + linear / law["slip_stiffness"])
    states = still(car, wheel), still(bed, wheel)
    of_gearbox = 2 * load / car.ratio + car.drag["gearbox"] * wheel * car.ratio
    for system, state in zip((car, bed), states, strict=True):
        state["output"] = 2 * load / system.k["gear_output"]
        state["mesh"] = of_gearbox / system.k["gear_mesh"]
        for side in SIDES:
            state[f"side_{side}"] = load / system.k[f"side_{side}"] + np.sign(load) * system.play / 2
    for side in SIDES:
        states[0][f"body_{side}"] = speed
        states[0][f"belt_{side}"] = load / car.k[f"wheel_tyre_{side}"]
        states[0][f"pad_{side}"] = np.sign(speed) * car.effects["brake", f"inputs.brake_{side}"]["deflection"]
        states[0][f"slip_{side}"] = linear / car.k[f"tyre_body_{side}"]
        states[1][f"flange_{side}"] = load / bed.k[f"flange_{side}"]
        states[1][f"read_{side}"] = load
        states[1][f"air_{side}"] = (bed.drag[f"rotor_{side}"] * wheel - load) / bed.gains[SIDES.index(side)]
    return (*states, of_gearbox + car.drag["motor"] * wheel * car.ratio, wheel)


def torques_of(system, s, *inputs):
    """Torques of the side shafts (2, b) at a state."""
    s = dict(s)
    system.rates(s, *inputs)
    return np.stack([s[f"side_{side}_torque"] for side in SIDES])


def drive_car(car, begin, torque, step_time):
    """Motor speed and side-shaft torques (t, 3, b) under motor torques (t, b), or these and the brakes' (t, 3, b),
    straight between samples."""
    state, pieces, out = begin, round(step_time / FINE), []
    for n, now in enumerate(torque):
        out.append(np.vstack([state["motor"][None], torques_of(car, state, now)]))
        after = torque[min(n + 1, len(torque) - 1)]
        for piece in range(pieces):
            state = step(car, state, now + (after - now) * (piece + 0.5) / pieces)
    return np.array(out), state


class Sensors:
    """Flange torques with noise and gain, speeds as differences of counts with noise."""

    def __init__(self, names, noise, gains, step_time, seed):
        self.names, self.noise, self.gains, self.step = names, noise, gains, step_time
        self.random, self.counts = np.random.default_rng(seed), {}

    def read(self, state, ratio):
        rows = []
        for name, noise in zip(self.names, self.noise, strict=True):
            side = "left" if "left" in name else "right"
            if name.endswith("torque"):
                value = state[f"read_{side}"] * self.gains[name]
            else:
                angle = state["motor_angle"] if name == "motor_speed" else state[f"angle_{side}"]
                counts = np.floor(angle / (2 * np.pi) * COUNTS)
                value = (counts - self.counts.get(name, counts)) * 2 * np.pi / COUNTS / self.step
                if name not in self.counts:
                    value = state["motor"] if name == "motor_speed" else state[f"rotor_{side}"]
                self.counts[name] = counts
            rows.append(value + noise * self.random.standard_normal(len(value)))
        return np.stack(rows)


def run_bed(bed, begin, torque, controller, sensors, delay, step_time, hold, before=0.0):
    """The bed under a controller: motor speed and side torques (t, 3, b), commands (t, 2, b), whether emulation lasted.

    ``controller`` (readings, motor torque, mode, hold speeds, sample) → commands, faults; ``delay`` (b,) from a sample
    to the moment its command begins to act; ``before`` s of speed hold come first.
    """
    state, pieces, out, sent = begin, round(step_time / FINE), [], []
    first = round(before / step_time)
    longest = int(np.ceil(delay.max() / FINE)) + pieces + 2
    issued = np.zeros((longest + 1, 2, bed.count))  # commands at each fine step, the newest first
    whole, part = np.floor(delay / FINE).astype(int), (delay / FINE) % 1.0
    rows, lasted = np.arange(bed.count), np.ones(bed.count, bool)
    for n in range(-first, len(torque)):
        now, after = (torque[min(max(i, 0), len(torque) - 1)] for i in (n, n + 1))
        commands, faults = controller(sensors.read(state, bed.ratio), now, 1 if n < 0 else 2, hold, n + first)
        if n >= 0:
            lasted &= faults == 0
            out.append(np.vstack([state["motor"][None], torques_of(bed, state, now, commands)]))
            sent.append(commands)
        for piece in range(pieces):
            issued = np.roll(issued, 1, axis=0)
            issued[0] = commands
            acting = (1 - part) * issued[whole, :, rows].T + part * issued[whole + 1, :, rows].T
            state = step(bed, state, now + (after - now) * (piece + 0.5) / pieces, acting)
    return np.array(out), np.array(sent), lasted
