"""C sources of a controller: a header to call it by, its numbers, and the fixed code of ``sources/``."""

from __future__ import annotations

import math
from pathlib import Path

import casadi as ca
import numpy as np
from jinja2 import Environment, FileSystemLoader, StrictUndefined

from modelling.bed.scheduled import ScheduledLaw
from modelling.controller.law import (
    AVERAGED_SAMPLES,
    GONE,
    HELD_BELOW_LIMIT,
    IN_A_ROW,
    KEPT_SAMPLES,
    LARGEST_SHARE,
    REMEMBERED_SAMPLES,
    SAMPLES_IN_A_ROW,
    SLOWEST,
    TURNING,
    WATCHED_SAMPLES,
    ExportedController,
    mean_samples,
)
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
    v = controller.law.vehicle_states
    reals = (
        9 * k
        + 2 * len(controller.settings.curve_speeds)
        + y
        + x
        + 4 * y
        + 3 * (w + 1)
        + (v + 1)
        + 7 * k
        + KEPT_TORQUES * k
        + (s + 1)
        + 1
        + WATCHED_SAMPLES * y
    )
    return 8 * reals + 4 * (13 + k + 2 * (s + 1))


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
            speeds=len(law.laws),
            vehicle_states=law.vehicle_states,
            readings=[c_comment(reading) for reading in readings],
            known=[c_comment(name) for name in law.known],
            dynamometers=[c_comment(name) for name in law.dynamometers],
            kept=KEPT_TORQUES,
            watched=WATCHED_SAMPLES,
            shafts=[c_comment(name) for name in controller.watched.shafts],
            learned=len(controller.learned),
            curve=len(controller.settings.curve_speeds),
        )
        + "\n"
    )


def _data(controller: ExportedController) -> str:
    law, settings = controller.law, controller.settings
    lines = [
        "/* numbers of the controller: each matrix row by row, without its zeros */",
        "typedef struct {",
        "    const uint32_t *start;",
        "    const uint16_t *column;",
        "    const controller_real *value;",
        "} controller_matrix;",
        "",
        f"#define CONTROLLER_TURNING {_real(TURNING)} /* rad/s */",
        f"#define CONTROLLER_GONE {_real(GONE)}",
        f"#define CONTROLLER_REMEMBERED {REMEMBERED_SAMPLES}",
        f"#define CONTROLLER_JUDGED {KEPT_SAMPLES}",
        f"#define CONTROLLER_AVERAGED {AVERAGED_SAMPLES}",
        f"#define CONTROLLER_HELD_BELOW_LIMIT {_real(HELD_BELOW_LIMIT)}",
        f"#define CONTROLLER_SLOWEST {_real(SLOWEST)} /* rad/s */",
        f"#define CONTROLLER_IN_A_ROW {SAMPLES_IN_A_ROW}",
        f"#define CONTROLLER_MEAN_SAMPLES {mean_samples(law.sample_time)}",
        f"#define CONTROLLER_CARRIED_SAMPLES {controller.watched.carried_samples}",
        f"#define CONTROLLER_OPENED_IN_A_ROW {IN_A_ROW}",
        f"#define CONTROLLER_LARGEST_SHARE {_real(LARGEST_SHARE)}",
        "",
        f"static const int32_t TORQUE_READING[] = {{{', '.join(map(str, controller.torque_readings))}}};",
        f"static const int32_t SPEED_READING[] = {{{', '.join(map(str, controller.speed_readings))}}};",
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
    lines += [f"    {settings.frozen_samples}, {settings.life_samples}}};"]
    matrices = {"EXPECTED": law.E, "LOST": controller.watched.lost, "CARRIED": controller.watched.carried}
    for name, matrix in matrices.items():
        lines += ["", *_rows(name, matrix)]
    over_speed = {
        "CORRECTION": [one.L for one in law.laws],
        "COMMAND": [np.hstack([one.K, one.Dy, one.Dw]) for one in law.laws],
        "NEXT_STATE": [np.hstack([one.A, one.By, one.Bw, one.Bs]) for one in law.laws],
    }
    for name, stack in over_speed.items():
        lines += ["", *_at_speeds(name, stack)]
    played = controller.learned if len(controller.learned) else np.zeros((1, len(law.dynamometers)))
    lines += ["", "static const controller_real LEARNED[][CONTROLLER_DYNAMOMETERS] = {"]
    lines += [f"    {{{', '.join(map(_real, row))}}}," for row in played.tolist()] + ["};"]
    if isinstance(law, ScheduledLaw):
        lines += _vehicle(law)
    return "\n".join(lines) + "\n"


def _vehicle(law: ScheduledLaw) -> list[str]:
    """Numbers and rates of the residual vehicle that runs in the law."""
    vehicle, generator = (
        law.vehicle,
        ca.CodeGenerator("vehicle", {"with_header": False, "casadi_real": "controller_real"}),
    )
    generator.add(vehicle.rates)
    steady = (f"    {{{', '.join(map(_real, row))}}}," for row in vehicle.steady)

    def listed(name: str, values: np.ndarray, meaning: str) -> str:
        return f"static const controller_real {name}[] = {{{', '.join(map(_real, values))}}}; /* {meaning} */"

    lines = [
        "",
        f"#define CONTROLLER_VEHICLE_INPUTS {len(law.known_inputs)}",
        f"enum {{ OBSERVED = {law.observed.start}, AHEAD = {law.ahead.start} }};",
        f"static const int32_t KNOWN_INPUT[] = {{{', '.join(map(str, (*law.known_inputs, 0)))}}};",
        listed("NONLINEAR", np.r_[vehicle.nonlinear, 0], "1 of an input whose effect depends on the motion"),
        listed("SPEED", law.speeds, "rad/s of the vehicle"),
        listed("ROTOR_SPEED", law.rotor_speeds, "rad/s there"),
        listed("ROTOR_SHARE", law.rotor_shares, "of each rotor in it"),
        listed("VEHICLE_SPEED", vehicle.speed, "by state"),
        "static const controller_real STEADY[CONTROLLER_SPEEDS][CONTROLLER_VEHICLE_STATES] = {", *steady, "};",
        "", *_rows("CUT_BY_READING", law.cut_by_reading), "", *_rows("CUT_BY_COMMAND", law.cut_by_command),
        "", *_at_speeds("VEHICLE", list(vehicle.A)),
        "", "/* rates of the vehicle's states by states, torques at the cuts and torques of its own */",
        generator.dump(),
        "static void vehicle_rates(const controller_real *states, const controller_real *at_cuts,",
        "                          const controller_real *own, controller_real *rates)",
        "{",
        "    const controller_real *arguments[] = {states, at_cuts, own};",
        "    controller_real *results[] = {rates};",
        f"    controller_real work[{max(vehicle.rates.sz_w(), 1)}];",
        f"    casadi_int integers[{max(vehicle.rates.sz_iw(), 1)}];",
        f"    (void){vehicle.rates.name()}(arguments, results, integers, work, 0);",
        "}",
    ]  # fmt: skip
    return lines


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
