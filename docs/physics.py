"""Six moving pictures of the physics, each made from the product's own results of the starter case: SVG with SMIL."""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

import rigmatch as rm

WIDTH, HEIGHT = 720, 250  # px
SECONDS = 6.0  # of a round of a picture
VEHICLE, RIG, MATCHED, INK, PALE = "#0072B2", "#D55E00", "#009E73", "#333333", "#bbbbbb"
DEAD_TIMES = (1.0, 2.0, 3.0, 4.0, 6.0, 8.0, 10.0, 12.0)  # ms
BEDS = 24  # that are drawn
GAPS = 9  # sizes of free play that are tried
KICK, SAMPLE = 60.0, 1e-3  # N·m at the motor, s
AT, LASTS = 0.25, 1.2  # s: when it begins, and until when it is watched


def pictures() -> dict[str, Callable[[], bytes]]:
    """What makes each picture, by its name."""
    return {
        "bed": what_a_bed_changes, "cut": what_a_cut_is, "dead_time": why_dead_time_costs,
        "observer": what_the_observer_does, "drawn_beds": what_a_drawn_bed_is, "diagnosis": what_a_diagnosis_compares,
    }  # fmt: skip


# --- The starter case, tuned once.


@functools.cache
def _tuned(structure: str) -> Any:
    """The starter matched with a control structure of its own choice."""
    with TemporaryDirectory() as folder:
        rm.new(Path(folder) / "first")
        file = Path(folder) / "first" / "case.toml"
        text = file.read_text(encoding="utf-8").replace('structure = "model_based"', f'structure = "{structure}"')
        kept = [
            line for line in text.splitlines() if structure != "observer" or not line.startswith(('"loop.', '"res'))
        ]
        file.write_text("\n".join(kept), encoding="utf-8")
        return rm.match(file)


# --- Pieces of a picture.


def _picture(words: str, pieces: Iterable[str], height: int = HEIGHT) -> bytes:
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {height}" width="{WIDTH}" height="{height}" '
        f'role="img" aria-label="{words}" font-family="sans-serif">'
        '<rect width="100%" height="100%" rx="8" fill="#fff"/>'
        f"{''.join(pieces)}</svg>\n"
    ).encode()


def _text(x: float, y: float, words: str, colour: str = INK, size: int = 13, anchor: str = "start") -> str:
    return f'<text x="{x:.0f}" y="{y:.0f}" font-size="{size}" fill="{colour}" text-anchor="{anchor}">{words}</text>'


class _Axes:
    """Where values of two quantities lie in a picture."""

    def __init__(self, box: tuple[float, float, float, float], x: tuple[float, float], y: tuple[float, float]):
        self.box, self.x, self.y = box, x, y

    def at(self, x: Any, y: Any) -> tuple[np.ndarray, np.ndarray]:
        left, top, right, bottom = self.box
        across = left + (np.asarray(x, float) - self.x[0]) / (self.x[1] - self.x[0]) * (right - left)
        down = bottom - (np.asarray(y, float) - self.y[0]) / (self.y[1] - self.y[0]) * (bottom - top)
        return across, down

    def frame(self, x: str, y: str) -> str:
        left, top, right, bottom = self.box
        lines = f'<path d="M{left},{top}V{bottom}H{right}" fill="none" stroke="{PALE}"/>'
        return lines + _text((left + right) / 2, bottom + 32, x, anchor="middle") + _text(left, top - 10, y)

    def ticks(self, values: Sequence[float], unit: str = "") -> str:
        """Numbers below the axis of x."""
        y = self.box[3] + 14
        return "".join(_text(float(self.at(v, 0)[0]), y, f"{v:g}{unit}", size=11, anchor="middle") for v in values)

    def curve(self, x: Any, y: Any, colour: str, *, width: float = 2.0, dash: str = "", more: str = "") -> str:
        points = " ".join(f"{a:.1f},{b:.1f}" for a, b in zip(*self.at(x, y), strict=True))
        dashed = f' stroke-dasharray="{dash}"' if dash else ""
        look = f'fill="none" stroke="{colour}" stroke-width="{width}"{dashed}'
        return f'<polyline points="{points}" {look}>{more}</polyline>'

    def dot(self, x: Sequence[float], y: Sequence[float], colour: str) -> str:
        """A dot that runs along."""
        xs, ys = self.at(x, y)
        begin = f'cx="{xs[0]:.1f}" cy="{ys[0]:.1f}"'
        return f'<circle r="6" fill="{colour}" {begin}>{_over("cx", xs)}{_over("cy", ys)}</circle>'


def _over(attribute: str, values: Any, discrete: bool = False) -> str:
    """A change of an attribute over a round."""
    listed = ";".join(value if isinstance(value, str) else f"{value:.1f}" for value in values)
    mode = ' calcMode="discrete"' if discrete else ""
    return f'<animate attributeName="{attribute}" dur="{SECONDS}s" repeatCount="indefinite" values="{listed}"{mode}/>'


def _shown_at(number: int, turn: Sequence[int]) -> str:
    """Visible only when it is its turn."""
    return _over("opacity", ["1" if now == number else "0" for now in turn], discrete=True)


def _disc(x: float, y: float, name: str, colour: str, amplitude: float, seconds: float) -> str:
    """A disc with a hand that swings."""
    angle = round(amplitude, 1)
    hand = (
        f'<line y2="-26" stroke="#000" stroke-width="3"><animateTransform attributeName="transform" type="rotate" '
        f'dur="{seconds:.2f}s" repeatCount="indefinite" calcMode="spline" values="{angle};{-angle};{angle}" '
        'keyTimes="0;0.5;1" keySplines="0.364 0 0.636 1;0.364 0 0.636 1"/></line>'
    )
    return (
        f'<g transform="translate({x:.0f},{y:.0f})"><circle r="26" fill="{colour}" fill-opacity="0.15" '
        f'stroke="{colour}" stroke-width="1.5"/>{hand}{_text(0, 44, name, size=12, anchor="middle")}</g>'
    )


# --- The six pictures.

SLOWED = 2.4  # s of a period of the vehicle's mode
SWING = 60.0  # degrees of the largest amplitude


def what_a_bed_changes() -> bytes:
    """The shuffle of the vehicle beside the lowest elastic mode of the rig alone."""
    result, pieces = _tuned("model_based"), []
    vehicle = next(mode for mode in rm.modes(result.case.vehicle) if mode.frequency > 0)
    rig = next(mode for mode in rm.modes(result.case.rig) if mode.frequency > 0)
    for row, (title, mode, colour) in enumerate((("in the car", vehicle, VEHICLE), ("on the bed", rig, RIG))):
        system = (result.case.vehicle, result.case.rig)[row]
        ratio = system.parameters["gears.reduction.ratio"].value
        before = {"motor", "pinion"}  # of the gear: reduced to the wheels
        shape = {name[9:]: amplitude / (ratio if name[9:] in before else 1) for name, amplitude in mode.shape.items()}
        largest, y = max(map(abs, shape.values())), 60 + 118 * row
        pieces += [_text(14, y, title, colour, 16), _text(14, y + 22, f"{mode.frequency:.1f} Hz")]
        for column, (name, amplitude) in enumerate(shape.items()):
            seconds = SLOWED * vehicle.frequency / mode.frequency
            pieces.append(_disc(190 + 105 * column, y, name, colour, SWING * amplitude / largest, seconds))
    return _picture("The slowest vibration in the car and on the bed", pieces)


def what_a_cut_is() -> bytes:
    """The parts beyond the cut leave the drivetrain and become a model; rotor and adapter take their place."""
    case = _tuned("model_based").case
    rig_only = [part.name for part in case.rig.inertias if part.name not in {one.name for one in case.vehicle.inertias}]
    beyond = [part.name for part in case.residual_vehicle.parts[0].inertias]
    kept = [part.name for part in case.vehicle.inertias if part.name not in beyond]
    pieces = [_text(14, 30, "hardware on the bed", INK, 14), _text(430, 30, "model in the controller", VEHICLE, 14)]
    pieces += [_disc(60 + 105 * i, 110, name, INK, 0.0, SECONDS) for i, name in enumerate(kept)]
    edge = 60 + 105 * len(kept) - 48
    pieces.append(f'<path d="M{edge},70V160" stroke="{RIG}" stroke-width="2" stroke-dasharray="6 4"/>')
    pieces.append(_text(edge, 62, "the cut", RIG, anchor="middle"))
    away = "0,0;0,0;110,-15;110,-15;110,-15;0,0"
    move = (
        f'<animateTransform attributeName="transform" type="translate" dur="{SECONDS}s" repeatCount="indefinite" '
        f'values="{away}"/>'
    )
    pieces.append(
        "<g>" + move + "".join(_disc(60 + 105 * (len(kept) + i), 110, name, VEHICLE, 25.0, 1.4)
                               for i, name in enumerate(beyond)) + "</g>"
    )  # fmt: skip
    comes = _over("opacity", ["0", "0", "1", "1", "1", "0"])
    pieces.append(
        '<g opacity="1">' + comes + "".join(_disc(60 + 105 * (len(kept) + i), 205, name, RIG, 25.0, 1.4)
                                            for i, name in enumerate(rig_only)) + "</g>"
    )  # fmt: skip
    return _picture("Wheels and body leave the drivetrain at the cut and become a model", pieces, 270)


def why_dead_time_costs() -> bytes:
    """The least response error over the dead time, and a torque that is answered so late."""
    from matching.match.bounds import lower_bound

    case = _tuned("model_based").case
    least = [lower_bound(case.with_values({"loop.dead_time": f"{ms} ms"}), 1) for ms in DEAD_TIMES]
    turn = [*range(len(DEAD_TIMES)), *range(len(DEAD_TIMES) - 1, -1, -1)]
    left = _Axes((50, 40, 320, 200), (-5, 30), (-0.1, 1.2))
    right = _Axes((420, 40, 690, 200), (0, DEAD_TIMES[-1] + 1), (0, 1.15 * max(least)))
    time = np.linspace(-5, 30, 200)
    pieces = [left.frame("time in ms", "torque"), left.curve(time, (time > 0) * 1.0, VEHICLE, width=3)]
    pieces.append(_text(230, 58, "asked", VEHICLE))
    lag = 1e3 * case.loop["inverter_lag"]
    for number, late in enumerate(DEAD_TIMES):
        answer = 1 - np.exp(-np.maximum(time - late, 0) / lag)
        pieces.append(left.curve(time, answer, RIG, width=3, more=_shown_at(number, turn)))
    pieces.append(_text(230, 190, "delivered", RIG))
    pieces += [right.frame("dead time in ms", "least response error"), right.curve(DEAD_TIMES, least, MATCHED)]
    pieces.append(right.dot([DEAD_TIMES[k] for k in turn], [least[k] for k in turn], RIG))
    pieces += [left.ticks((0, 10, 20)), right.ticks((0, 5, 10))]
    pieces += [_text(412, float(right.at(0, v)[1]) + 4, f"{v:.2g}", size=11, anchor="end") for v in (0, max(least))]
    return _picture("The longer the dead time, the larger the least response error", pieces)


def _kicked(result: Any) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Time, and the side shaft torque of vehicle and bed under a kick that no sensor tells the controller."""
    from modelling.simulation.simulate import simulate

    time = np.arange(0, LASTS, SAMPLE)
    kick = {"motor_torque": np.where((time >= AT) & (time < AT + 0.06), KICK, 0.0)}
    case = result.tuned
    vehicle = simulate(case.vehicle, time, {**kick, "road_torque": np.zeros(len(time))})
    controller = rm.controller(result, hold=0.1)
    ahead = np.zeros(2000)  # the controller takes over before
    torque = {"motor_torque": np.r_[ahead, kick["motor_torque"]]}
    bed = rm.run(rm.bed(case), controller, torque, {})
    return time, vehicle.readings["side_shaft_torque"], bed["side_shaft_torque"][len(ahead) :, 0]


def what_the_observer_does() -> bytes:
    """A torque that nobody measures: car, bed with a feed-forward alone, bed with an observer."""
    rows = {"without an observer": _kicked(_tuned("model_based")), "with an observer": _kicked(_tuned("observer"))}
    largest = 1.15 * max(np.abs(each).max() for _, *both in rows.values() for each in both)
    pieces = []
    for place, (words, (time, vehicle, bed)) in enumerate(rows.items()):
        axes = _Axes((50 + 350 * place, 50, 350 + 350 * place, 200), (0, LASTS), (-largest, largest))
        colour = (RIG, MATCHED)[place]
        pieces += [axes.frame("time in s", "side shaft torque"), axes.curve(time[::3], vehicle[::3], VEHICLE, width=4)]
        pieces += [
            axes.curve(time[::3], bed[::3], colour, dash="7 4"),
            _text(350 + 350 * place, 66, words, colour, anchor="end"),
        ]
        pieces += [_text(350 + 350 * place, 84, "the car", VEHICLE, anchor="end")]
        pieces.append(axes.ticks((0, 0.5, 1)))
        few = slice(None, None, len(time) // 60)
        pieces += [axes.dot(time[few], vehicle[few], VEHICLE), axes.dot(time[few], bed[few], colour)]
    return _picture("The observer answers a torque that no sensor measures", pieces)


def what_a_drawn_bed_is() -> bytes:
    """Responses of beds whose values lie anywhere within the tolerances, one after another."""
    case = _tuned("observer").case
    box = case.uncertainty
    frequencies = np.geomspace(10, 35, 90)

    def curve(rig: Any) -> np.ndarray:
        return np.log10(np.abs(rm.response(rig, frequencies)["motor_speed", "dyno"]))

    drawn = []
    for position in box.draw(BEDS, 1):
        values = {name[4:]: value for name, value in box.at(position).items() if name.startswith("rig.")}
        drawn.append(curve(case.rig.with_values({n: v for n, v in values.items() if n in case.rig.parameters})))
    axes = _Axes((60, 40, 690, 200), (1, np.log10(35)), (np.min(drawn) - 0.05, np.max(drawn) + 0.05))
    pieces = [axes.frame("frequency", "motor speed for the dynamometer's torque (logarithmic)")]
    across = np.log10(frequencies)
    pieces += [axes.curve(across, one, PALE, width=1) for one in drawn]
    pieces += [
        axes.curve(across, one, MATCHED, width=3, more=_shown_at(number, range(BEDS)))
        for number, one in enumerate(drawn)
    ]
    pieces.append(axes.curve(across, curve(case.rig), INK, width=2, dash="6 4"))
    for hertz in (10, 15, 20, 30):
        pieces.append(_text(float(axes.at(np.log10(hertz), 0)[0]), 212, f"{hertz} Hz", size=11, anchor="middle"))
    pieces += [_text(690, 60, "dashed: the bed as planned", anchor="end"), _text(690, 78, "green: one drawn bed",
                                                                                 MATCHED, anchor="end")]  # fmt: skip
    return _picture("Beds drawn within the tolerances, one after another", pieces)


def what_a_diagnosis_compares() -> bytes:
    """A recording of a drivetrain with free play, and models whose free play grows until the error is least."""
    from modelling.simulation.simulate import simulate
    from modelling.system import Effect, Quantity

    vehicle = _tuned("model_based").case.vehicle
    time = np.arange(0, 1.6, 4e-3)
    torque = 60 * np.interp(time, [0, 0.2, 0.25, 0.8, 0.85, 1.6], [0, 0, 1, 1, -1, -1])
    inputs = {"motor_torque": torque, "road_torque": np.zeros(len(time))}

    def shaft(gap: float) -> np.ndarray:
        play = Effect("backlash", "shafts.side_shafts", (("gap", Quantity(gap)),))
        system = vehicle.with_effects(play) if gap else vehicle
        return simulate(system, time, inputs).readings["side_shaft_torque"]

    true = 0.04
    recorded = shaft(true) + np.random.default_rng(1).normal(0, 8.0, len(time))
    gaps = np.linspace(0, 2 * true, GAPS)
    tried = [shaft(gap) for gap in gaps]
    errors = [float(np.sqrt(np.mean((one - recorded) ** 2))) for one in tried]
    turn = [*range(GAPS), *range(GAPS - 2, 0, -1)]
    largest = 1.1 * np.abs(recorded).max()
    left = _Axes((50, 40, 400, 200), (0, time[-1]), (-largest, largest))
    right = _Axes((480, 40, 690, 200), (0, np.degrees(gaps[-1])), (0, 1.1 * max(errors)))
    pieces = [left.frame("time in s", "side shaft torque"), left.curve(time, recorded, PALE, width=3)]
    pieces += [left.curve(time, one, RIG, more=_shown_at(number, turn)) for number, one in enumerate(tried)]
    pieces += [
        _text(400, 56, "grey: the recording", "#777777", anchor="end"),
        _text(400, 74, "the model", RIG, anchor="end"),
    ]
    pieces += [
        right.frame("free play of the model in °", "error in N·m"),
        right.curve(np.degrees(gaps), errors, MATCHED),
    ]
    pieces.append(right.dot([np.degrees(gaps[k]) for k in turn], [errors[k] for k in turn], RIG))
    pieces += [left.ticks((0, 0.5, 1, 1.5)), right.ticks((0, 1, 2, 3, 4))]
    return _picture("The model with the right free play differs least from the recording", pieces)
