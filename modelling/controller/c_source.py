"""C sources of a controller: a header to call it by, its numbers, and the fixed code of ``sources/``."""

from __future__ import annotations

import math
import re
from pathlib import Path

import casadi as ca
import numpy as np
from jinja2 import Environment, FileSystemLoader, StrictUndefined

from modelling.bed.bed import ControlLaw
from modelling.bed.clutches import SLIPS, SWEEPS
from modelling.bed.foreign_vehicle import ForeignVehicleLaw
from modelling.bed.stepped import GAMMA, SMALLEST_SLOPE, SlippingDesign, SteppedLaw, own_vehicle
from modelling.controller.law import (
    AVERAGED_SAMPLES,
    DELIVERY_S,
    EVEN_LIFE,
    FADE_S,
    GONE,
    HELD_BELOW_LIMIT,
    IN_A_ROW,
    KEPT_SAMPLES,
    LARGEST_SHARE,
    MEAN_OF_OFF,
    MEAN_SHARE,
    REMEMBERED_SAMPLES,
    SAMPLES_IN_A_ROW,
    SLOWEST,
    TURNING,
    WATCHED_SAMPLES,
    ExportedController,
    mean_samples,
    undelivered_samples,
)
from modelling.controller.tracking import samples, share
from modelling.escape import c_comment

HERE = Path(__file__).with_name("sources")
KEPT_TORQUES = max(KEPT_SAMPLES, WATCHED_SAMPLES)


def c_sources(controller: ExportedController) -> dict[str, str]:
    """C files by name: ``controller.h``, ``controller.c`` and ``controller_data.h``."""
    return {
        "controller.h": _header(controller),
        "controller.c": (HERE / "controller.c").read_text(encoding="utf-8"),
        "controller_data.h": _data(controller),
    }


def memory_bytes(controller: ExportedController) -> int:
    """Size of the controller's structure in double precision, padding aside."""
    k, y = len(controller.law.dynamometers), len(controller.law.sensors)
    x, w, s = controller.law.states, len(controller.law.known), len(controller.watched.shafts)
    v, t, c = _vehicle_states(controller), len(tyres_of(controller)), clutch_count(controller)
    settings = 9 * k + 2 * len(controller.settings.curve_speeds) + y + (s + 1) + 2 + (t + 3 if v else 0)
    state = x + 5 * y + 3 * (w + 1) + 9 * k + 2 * (v + 1) + c + 1 + KEPT_TORQUES * k + WATCHED_SAMPLES * y
    state += (controller.rotors.kept + 4) * k + 4 * _pulse_count(controller)
    if isinstance(controller.law, ForeignVehicleLaw):
        timing = controller.law.timing
        state += controller.law.by_load.shape[1] + (timing.late + timing.steps + 5) * k
    tracker = 6 + 4 * samples(controller.drifts.older, controller.law.sample_time) + 2 * 24 + 16 + 4 * 4 + 3 * 3
    return 8 * (settings + state + tracker * k) + 4 * (21 + 12 * k + 3 * y + 2 * (s + 1))


def tyres_of(controller: ExportedController) -> tuple[str, ...]:
    """Shafts whose tyres slip in the vehicle that is stepped beside the law."""
    own = own_vehicle(controller.law)
    return () if own is None else own.tyres


def _vehicle_states(controller: ExportedController) -> int:
    """States of the vehicle that is stepped beside the law."""
    own = own_vehicle(controller.law)
    return 0 if own is None else len(own.body)


def clutch_count(controller: ExportedController) -> int:
    """Clutches of the vehicle that is stepped beside the law."""
    own = own_vehicle(controller.law)
    return 0 if own is None else len(own.slip)


def _pulse_count(controller: ExportedController) -> int:
    """Pulses of the vehicle that is stepped beside the law."""
    own = own_vehicle(controller.law)
    return 0 if own is None else own.pulses.count


def _header(controller: ExportedController) -> str:
    law = controller.law
    readings = [f"{name}, {unit}" for name, unit in zip(law.sensors, controller.units, strict=True)]
    # loads from the folder itself: the text is C, not HTML, so names go through c_comment and nothing else
    made = Environment(
        loader=FileSystemLoader(HERE), autoescape=False, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    return (
        made.get_template("controller.h.in").render(
            title=c_comment(controller.title) or "Controller",
            sample_time=_real(law.sample_time),
            seconds=law.sample_time,
            bytes=memory_bytes(controller),
            states=law.states,
            speeds=len(law.speeds) if isinstance(law, SteppedLaw) else 0,
            vehicle_states=_vehicle_states(controller),
            locked_states=law.vehicle_states if _vehicle_states(controller) else 0,
            clutches=clutch_count(controller),
            pulses=_pulse_count(controller),
            foreign=law.timing if isinstance(law, ForeignVehicleLaw) else None,
            loads=law.by_load.shape[1] if isinstance(law, SteppedLaw) else 0,
            tyres=[c_comment(name) for name in tyres_of(controller)],
            readings=[c_comment(reading) for reading in readings],
            known=[c_comment(f"{name}, pedal 0 to 1" if name in controller.pedals else name) for name in law.known],
            dynamometers=[c_comment(name) for name in law.dynamometers],
            kept=KEPT_TORQUES,
            sent_kept=controller.rotors.kept,
            watched=WATCHED_SAMPLES,
            shafts=[c_comment(name) for name in controller.watched.shafts],
            learned=len(controller.learned),
            curve=len(controller.settings.curve_speeds),
            older=samples(controller.drifts.older, law.sample_time),
        )
        + "\n"
    )


def _data(controller: ExportedController) -> str:
    law, settings, rotors = controller.law, controller.settings, controller.rotors
    laws = (law,) if isinstance(law, ControlLaw) else law.laws
    if isinstance(law, SteppedLaw) and law.slipping is not None:
        laws = (*laws, *law.slipping.laws)
    lines = [
        "/* numbers of the controller: each matrix row by row, without its zeros */",
        "typedef struct {",
        "    const uint32_t *start;",
        "    const uint16_t *column;",
        "    const controller_real *value;",
        "} controller_matrix;",
        "",
        f"#define CONTROLLER_ACTING {laws[0].Bw.shape[1]} /* known torques, then rates of the vehicle's states */",
        f"#define CONTROLLER_TURNING {_real(TURNING)} /* rad/s */",
        f"#define CONTROLLER_GONE {_real(GONE)}",
        f"#define CONTROLLER_REMEMBERED {REMEMBERED_SAMPLES}",
        f"#define CONTROLLER_JUDGED {KEPT_SAMPLES}",
        f"#define CONTROLLER_AVERAGED {AVERAGED_SAMPLES}",
        f"#define CONTROLLER_HELD_BELOW_LIMIT {_real(HELD_BELOW_LIMIT)}",
        f"#define CONTROLLER_SLOWEST {_real(SLOWEST)} /* rad/s */",
        f"#define CONTROLLER_IN_A_ROW {SAMPLES_IN_A_ROW}",
        f"#define CONTROLLER_MEAN_SAMPLES {mean_samples(law.sample_time)}",
        f"#define CONTROLLER_FADE {_real(FADE_S)} /* s */",
        f"#define CONTROLLER_MEAN_OF_OFF {MEAN_OF_OFF}",
        f"#define CONTROLLER_EVEN_LIFE {EVEN_LIFE}",
        f"#define CONTROLLER_DELIVERY {_real(DELIVERY_S)} /* s */",
        f"#define CONTROLLER_UNDELIVERED_SAMPLES {undelivered_samples(law.sample_time)}",
        f"#define CONTROLLER_MEAN_SHARE {_real(MEAN_SHARE)}",
        f"#define CONTROLLER_CARRIED_SAMPLES {controller.watched.carried_samples}",
        f"#define CONTROLLER_OPENED_IN_A_ROW {IN_A_ROW}",
        f"#define CONTROLLER_LARGEST_SHARE {_real(LARGEST_SHARE)}",
        "",
        f"static const int32_t TORQUE_READING[] = {{{', '.join(map(str, controller.torque_readings))}}};",
        f"static const int32_t SPEED_READING[] = {{{', '.join(map(str, controller.speed_readings))}}};",
        f"static const controller_real ROTOR_INERTIA[] = {{{', '.join(map(_real, rotors.inertia))}}};",
        f"static const controller_real ROTOR_DRAG[] = {{{', '.join(map(_real, rotors.drag))}}};",
        f"static const controller_real ROTOR_SIGN[] = {{{', '.join(map(_real, rotors.sign))}}};",
        f"static const int32_t SENT_DELAY[] = {{{', '.join(str(int(one)) for one in rotors.delay)}}}; /* samples */",
        f"static const controller_real SENT_PART[] = {{{', '.join(_real(one % 1) for one in rotors.delay)}}};",
        *_tracking(controller),
        "static const controller_settings CONTROLLER_DEFAULTS = {",
    ]
    per_dynamometer = (
        "torque_limit",
        "speed_limit",
        "hold_proportional",
        "hold_integral",
        "lost_torque",
        "torque_gain",
        "power_limit",
        "check_torque",
        "check_speed",
    )
    for part in (*per_dynamometer, "curve_speeds", "curve_torques", "unexpected"):
        lines.append(f"    {{{', '.join(_real(value) for value in getattr(settings, part))}}}, /* {part} */")
    opened = ", ".join(_real(value) for value in (*settings.opened_torque, 0.0))
    lines += [f"    {{{opened}}}, /* opened_torque */", f"    {_real(settings.opened_share)}, /* opened_share */"]
    lines += [f"    {_real(settings.undelivered_share)}, /* undelivered_share */"]
    if isinstance(law, SteppedLaw) and law.steps_vehicle:
        lines += [f"    {{{', '.join(['1.0'] * (len(law.vehicle.tyres) + 1))}}}, 1.0, 0.0, /* friction, mass, grade */"]
    lines += [f"    {settings.frozen_samples}, {settings.life_samples}, {settings.ride_samples}}};"]
    matrices = {
        "BY_OTHERS": controller.by_others,
        "EXPECTED": law.E,
        "LOST": controller.watched.lost,
        "CARRIED": controller.watched.carried,
    }
    for name, matrix in matrices.items():
        lines += ["", *_rows(name, matrix)]
    over_speed = {
        "CORRECTION": [one.L for one in laws],
        "COMMAND": [np.hstack([one.K, one.Dy, one.Dw]) for one in laws],
        "NEXT_STATE": [np.hstack([one.A, one.By, one.Bw, one.Bs]) for one in laws],
    }
    for name, stack in over_speed.items():
        lines += ["", *_at_speeds(name, stack)]
    played = controller.learned if len(controller.learned) else np.zeros((1, len(law.dynamometers)))
    lines += ["", "static const controller_real LEARNED[][CONTROLLER_DYNAMOMETERS] = {"]
    lines += [f"    {{{', '.join(map(_real, row))}}}," for row in played.tolist()] + ["};"]
    if isinstance(law, ForeignVehicleLaw):
        lines += _foreign(law)
    elif isinstance(law, SteppedLaw):
        lines += _vehicle(law)
    return "\n".join(lines) + "\n"


def _tracking(controller: ExportedController) -> list[str]:
    """Numbers by which drifts are tracked and judged."""
    tracking, step = controller.drifts, controller.law.sample_time
    late = ", ".join(_real(one * step) for one in controller.rotors.late)

    def rows(name: str, values: np.ndarray, meaning: str) -> list[str]:
        inside = ", ".join(f"{{{', '.join(map(_real, row))}}}" for row in values)
        return [f"static const double {name}[][{values.shape[1]}] = {{{inside}}}; /* {meaning} */"]

    return [
        f"static const double ROTOR_LATE[] = {{{late}}}; /* s */",
        f"#define TRACK_SMOOTHING {_real(share(tracking.smoothing, step))} /* of a change in a sample */",
        f"#define TRACK_SECOND_SMOOTHING {_real(share(tracking.second_smoothing, step))}",
        f"#define TRACK_SETTLING {samples(tracking.settling, step)} /* samples */",
        f"#define TRACK_BLOCK {samples(tracking.block, step)} /* samples */",
        f"#define TRACK_LEAST_BLOCKS {tracking.least_blocks}",
        f"#define TRACK_KEPT {_real(math.exp(-tracking.block / tracking.forgetting))} /* of weights, a block later */",
        f"#define TRACK_INERTIA {_real(tracking.inertia / math.sqrt(3))} /* relative standard uncertainty */",
        f"#define TRACK_SURE {_real(tracking.sure)}",
        f"#define TRACK_CERTAINTY {_real(tracking.certainty)}",
        *rows("TRACK_PRIOR", 1 / tracking.prior**2, "inverse variances: gain, delay, zero, drag"),
        *rows("TRACK_MOST", tracking.most, "gain and delay, off what the match was made for"),
        *rows("TRACK_DRIFT", tracking.drift, "gain, delay and zero, off the first sure value"),
    ]


def _listed(name: str, values: np.ndarray, meaning: str) -> str:
    return f"static const controller_real {name}[] = {{{', '.join(map(_real, values))}}}; /* {meaning} */"


def _beside(law: SteppedLaw) -> list[str]:
    """Numbers that both kinds of vehicle need, in the controller or outside."""
    vehicle, settings = law.vehicle, law.settings
    return [
        "",
        f"#define CONTROLLER_VEHICLE_INPUTS {len(vehicle.inputs)}",
        f"#define CONTROLLER_ANGLE_TIME {_real(settings.angle_time)} /* s */",
        f"#define CONTROLLER_ANGLE_ROLL {_real(settings.angle_roll)} /* rad */",
        f"enum {{ OBSERVED = {law.observed.start} }};",
        _listed("OVER", law.over, "speed of a rotor over its wheel's"),
        _listed("SPEED", law.designed, "rad/s of the vehicle"),
        f"#define CONTROLLER_DESIGNS {len(law.designed)}",
        _listed("ROTOR_SPEED", law.rotor_speeds, "rad/s there"),
        _listed("ROTOR_SHARE", law.rotor_shares, "of each rotor in it"),
        "", *_rows("MOMENTUM", law.momentum), "", *_rows("WHEEL", law.stepped.wheel),
        "", *_rows("CUT_TORQUE", law.cut_torque), "", *_rows("CUT_BY_READING", law.cut_by_reading),
        "", *_rows("CUT_BY_COMMAND", law.cut_by_command),
    ]  # fmt: skip


def _foreign(law: ForeignVehicleLaw) -> list[str]:
    """Numbers for a vehicle that is stepped outside."""
    vehicle, run_in = law.vehicle, law.run_in
    return [
        *_beside(law),
        f"#define CONTROLLER_LOAD_STAYS {_real(law.load_stays)} /* from sample to sample */",
        f"#define CONTROLLER_DESIGN_STATES {law.vehicle_states}",
        _listed("STEADY_BODY", vehicle.steady @ vehicle.body, "rad/s"),
        _listed("RUN_IN_PROPORTIONAL", run_in.proportional, "N*m*s/rad"),
        _listed("RUN_IN_INTEGRAL", run_in.integral, "N*m/rad"),
        _listed("RUN_IN_LARGEST", run_in.largest, "N*m"),
        "", *_rows("BODY_SPEED", vehicle.body[None]), "", *_rows("BY_LOAD", law.by_load),
        "", *_at_speeds("BY_WHEEL", list(law.by_late_wheel)), "", *_at_speeds("CATCHES", list(law.catches)),
        "", *_at_speeds("BY_OWN", list(law.by_own)),
    ]  # fmt: skip


def _vehicle(law: SteppedLaw) -> list[str]:
    """Numbers and functions of the residual vehicle that is stepped beside the law."""
    vehicle, locked, slipping = law.stepped, law.vehicle, law.slipping
    functions = {"rates": vehicle.rates, "slopes": vehicle.slopes, "outputs": vehicle.outputs}
    by_wheel, likeness = (
        [*of_locked, *([] if slipping is None else getattr(slipping, name))]
        for name, of_locked in (("by_wheel", law.by_wheel), ("likeness", law.likeness))
    )
    steady = (f"    {{{', '.join(map(_real, row))}}}," for row in vehicle.steady)
    lines = [
        *_beside(law),
        f"#define CONTROLLER_PIECES {vehicle.pieces} /* steps of its integration in a sample */",
        f"#define CONTROLLER_RADIUS {_real(vehicle.radius)} /* m */",
        f"#define GAMMA (controller_real){_real(GAMMA)}",
        _listed("NONLINEAR", np.r_[locked.nonlinear, 0], "1 of an own input whose effect depends on the motion"),
        f"#define SMALLEST_SLOPE (controller_real){_real(SMALLEST_SLOPE)}",
        _listed("BODY", vehicle.body, "speed by state"),
        "static const controller_real STEADY[CONTROLLER_SPEEDS][CONTROLLER_VEHICLE_STATES] = {", *steady, "};",
        "", *_at_speeds("BY_WHEEL", by_wheel), "", *_at_speeds("LIKENESS", likeness),
        "", *_rows("BY_CUT", locked.by_cut), "", *_rows("LOCKED_WHEEL", locked.wheel),
    ]  # fmt: skip
    if slipping is None:
        lines += ["#define MOMENTUM_SLIPPING MOMENTUM"]
    else:
        lines += _clutches(slipping)
        functions["locked"] = _named("vehicle_locked", locked.rates)
    words = "the vehicle: rates of its states, their derivatives by the states, slips and torques of its tyres"
    return [*lines, *_firing(law), "", f"/* {words} */", *_functions(functions)]


def _clutches(slipping: SlippingDesign) -> list[str]:
    """Numbers of the vehicle's clutches."""
    clutches = slipping.clutches
    vehicle = clutches.vehicle
    by_clutch = (f"    {{{', '.join(map(_real, row))}}}," for row in vehicle.by_clutch.T)
    return [
        "", "/* clutches: states of the vehicle that has them locked by those of the one that is stepped; slips */",
        f"#define CONTROLLER_SLIPS {_real(SLIPS)} /* rad/s */",
        f"#define CONTROLLER_SWEEPS {1 if len(vehicle.slip) == 1 else SWEEPS}",
        *_rows("SEEN", clutches.seen), "", *_rows("SLIP", vehicle.slip),
        "", *_rows("BY_CUT_SLIPPING", clutches.by_cut), "", *_rows("MOMENTUM_SLIPPING", slipping.momentum),
        "static const controller_real BY_CLUTCH[CONTROLLER_CLUTCHES][CONTROLLER_VEHICLE_STATES] = {", *by_clutch, "};",
    ]  # fmt: skip


def _named(name: str, function: ca.Function) -> ca.Function:
    """A function under another name: C takes each name once."""
    given = [ca.SX.sym(f"in{number}", function.size_in(number)) for number in range(function.n_in())]
    return ca.Function(name, given, [function(*given)])


def _firing(law: SteppedLaw) -> list[str]:
    """Numbers of the vehicle's pulses; nothing without any."""
    pulses, following = law.stepped.pulses, law.following
    if not pulses.count:
        return []
    k, points = len(law.dynamometers), following.speeds.shape[1]
    share = law.sample_time / (law.sample_time + following.speed_time)
    speeds = (f"    {{{', '.join(map(_real, row))}}}," for row in following.speeds)
    gains = [
        f"    {{{', '.join(f'{{{_real(one.real)}, {_real(one.imag)}}}' for one in row)}}},"
        for table in following.gains for row in table
    ]  # fmt: skip
    answers = (
        f"    {{{', '.join(f'{{{_real(one.real)}, {_real(one.imag)}}}' for one in row)}}}," for row in following.answers
    )  # fmt: skip
    tables = [["  {", *gains[at : at + points], "  },"] for at in range(0, len(gains), points)]
    return [
        "", "/* pulses of the vehicle's engine over its angle, and what each asks of the commands: real, imaginary */",
        f"#define CONTROLLER_PULSE_SPEEDS {points}",
        f"#define CONTROLLER_PULSE_SMOOTHING {_real(share)} /* of a change in a sample */",
        f"#define TURN {_real(2 * math.pi)}",
        _listed("PULSE_ORDER", pulses.order, "over a turn"), _listed("PULSE_AMPLITUDE", pulses.amplitude, "N*m"),
        _listed("PULSE_START", pulses.phase, "rad"),
        "", *_rows("BY_PULSE", pulses.by), "", *_rows("LOCKED_BY_PULSE", law.vehicle.pulses.by),
        "", *_rows("PULSE_TURNS", pulses.turns),
        "static const controller_real PULSE_SPEED[CONTROLLER_PULSES][CONTROLLER_PULSE_SPEEDS] = {", *speeds, "};",
        f"static const controller_real PULSE_GAIN[CONTROLLER_PULSES][CONTROLLER_PULSE_SPEEDS][{k}][2] = {{",
        *(line for table in tables for line in table), "};",
        "static const controller_real PULSE_ANSWER[CONTROLLER_PULSES][CONTROLLER_PULSE_SPEEDS][2] = {", *answers, "};",
        f"static const int32_t PULSE_MACHINE[] = {{{', '.join(map(str, following.machines))}}};",
        f"#define CONTROLLER_PULSE_CORRECTING {_real(law.sample_time / following.correcting)}",
    ]  # fmt: skip


# What CasADi calls by names of its own in the C of a function of scalars.
HELPERS = {
    "sq": "x * x", "sign": "(x < 0) ? -1 : ((x > 0) ? 1 : 0)", "fabs": "(controller_real)fabs((double)x)",
    "fmax": "(x > y) ? x : y", "fmin": "(x < y) ? x : y", "log1p": "(controller_real)log1p((double)x)",
    "expm1": "(controller_real)expm1((double)x)", "hypot": "(controller_real)hypot((double)x, (double)y)",
}  # fmt: skip
ARGUMENTS = ("states", "at_cuts", "own", "road")


def _functions(functions: dict[str, ca.Function]) -> list[str]:
    """C of functions of the vehicle without what CasADi writes around them."""
    generator = ca.CodeGenerator("vehicle", {"with_header": False})
    for function in functions.values():
        generator.add(function)
    text = generator.dump()
    bodies = re.findall(r"^static int casadi_f\d+\(.*?\{\n(.*?)^\s*return 0;\n\}", text, re.MULTILINE | re.DOTALL)
    assert len(bodies) == len(functions)
    lines, used = [], set()
    for name, body in zip(functions, bodies, strict=True):
        body = re.sub(r"arg\[(\d)\]\? arg\[\d\]\[(\d+)\] : 0", lambda m: f"{ARGUMENTS[int(m[1])]}[{m[2]}]", body)
        body = re.sub(r"if \(res\[0\]!=0\) res\[0\]\[(\d+)\]=", r"found[\1]=", body)
        used |= set(re.findall(r"casadi_(\w+)\(", body))
        body = re.sub(r"casadi_(\w+)\(", r"vehicle_\1(", body).replace("casadi_real", "controller_real")
        parameters = ", ".join(f"const controller_real *{argument}" for argument in ARGUMENTS)
        unused = "".join(f"  (void){argument};\n" for argument in (*ARGUMENTS, "found"))
        lines += [f"static void {name}_of({parameters}, controller_real *found)", "{", body + unused + "}"]
    helpers = []
    for name in sorted(used):
        parameters = (
            "controller_real x, controller_real y"
            if "y" in re.findall(r"\b\w\b", HELPERS[name])
            else "controller_real x"
        )
        helpers.append(f"static controller_real vehicle_{name}({parameters}) {{ return {HELPERS[name]}; }}")
    return [*helpers, *lines]


def _at_speeds(name: str, matrices: list[np.ndarray]) -> list[str]:
    """Matrices of every speed, and the array of them."""
    lines = []
    for number, matrix in enumerate(matrices):
        lines += _values(f"{name}_{number}", matrix)
    rows = (f"    {{{name}_{n}_START, {name}_{n}_COLUMN, {name}_{n}_VALUE}}," for n in range(len(matrices)))
    return [*lines, f"static const controller_matrix {name}[] = {{", *rows, "};"]


def _rows(name: str, matrix: np.ndarray) -> list[str]:
    """A matrix in compressed rows."""
    made = f"static const controller_matrix {name} = {{{name}_START, {name}_COLUMN, {name}_VALUE}};"
    return [*_values(name, matrix), made]


def _values(name: str, matrix: np.ndarray) -> list[str]:
    """Numbers of a matrix in compressed rows; one unused entry at the end, for C knows no empty array."""
    rows, columns = np.nonzero(matrix)
    starts = np.searchsorted(rows, np.arange(len(matrix) + 1))
    values = matrix[rows, columns]
    lines = [f"static const uint32_t {name}_START[] = {{"]
    lines += _wrapped([str(start) for start in starts])
    lines += ["};", f"static const uint16_t {name}_COLUMN[] = {{", *_wrapped([*map(str, columns), "0"]), "};"]
    lines += [f"static const controller_real {name}_VALUE[] = {{", *_wrapped([*map(_real, values), "0.0"]), "};"]
    return lines


def _wrapped(entries: list[str], a_line: int = 6) -> list[str]:
    return [f"    {', '.join(entries[i : i + a_line])}," for i in range(0, len(entries), a_line)]


def _real(value: float) -> str:
    if math.isinf(value):
        return "HUGE_VAL" if value > 0 else "-HUGE_VAL"
    return repr(float(value))
