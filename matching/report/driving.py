"""A match over a range of speeds: its figures, and what its tables say."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from matching.match.case import ERROR_SCALES, Case
from matching.match.driving import DRIVING, Driving
from matching.report.common import (
    LIMIT,
    MATCHED,
    RIG,
    VEHICLE,
    decimated,
    figure,
    legend_above,
    number,
    percent,
    spaced,
    styled,
)
from matching.report.page import Block, Fold, Show, Table
from modelling.units import SENSOR_UNITS

KMH = 3.6
MOST_POINTS = 2000  # of a curve
CAPTIONS = {
    "over_speed": "Response error of the one controller about steady speeds: on the bed as planned, and what 95 % of "
    "the drawn beds keep. Points: where it is designed; in between it is interpolated.",
    "drives": "The drives on the nonlinear bed as planned, with noise and encoders, next to the nonlinear vehicle. "
    "Dotted: the controller of one speed. Values count from where the drive begins.",
}
HOW = (
    "Root mean square over the range of the vehicle's signal, of the worst compared sensor; the exported controller "
    "with noise, encoders and sensors' gains on nonlinear beds, each beside the vehicle with the same specimen. “One "
    "speed”: the controller that the same match gives about {speed} km/h alone."
)


def over_speed_figure(driving: Driving, case: Case) -> Figure:
    """Errors over the vehicle's speed, km/h."""
    rows = driving.speeds
    speed = KMH * np.array([row.vehicle_speed for row in rows])
    designed = np.isin(np.round(speed, 6), np.round(KMH * np.array(driving.designed_at), 6))
    with styled():
        fig = figure(8.0, 3.4)
        axes = fig.subplots()
        for name, key, colour in (
            ("measured torques", "measured", VEHICLE),
            ("unmeasured torques", "unmeasured", MATCHED),
        ):
            planned = np.array([getattr(row, key) for row in rows])
            high = np.array([np.nan if (value := getattr(row, f"{key}_95")) is None else value for row in rows])
            axes.plot(speed, planned, "-", color=colour, label=name)
            axes.plot(speed[designed], planned[designed], "o", color=colour, markersize=4)
            axes.plot(speed, high, "--", color=colour, label="95 % of drawn beds")
        axes.axhline(case.tolerance, color=LIMIT, linestyle=":", label="allowed, measured")
        if speed.min() < 0:  # both ways, about the slowest of the grid
            axes.set_xscale("symlog", linthresh=float(np.abs(speed).min()))
        else:
            axes.set_xscale("log")
        axes.set(yscale="log", xlabel="Vehicle speed in km/h", ylabel="Response error")
        legend_above(fig, axes)
    return fig


def drives_figure(driving: Driving, case: Case) -> Figure:
    """A row a drive: its worst sensor and the vehicle's first speed."""
    units = {sensor.name: SENSOR_UNITS[sensor.measures] for sensor in case.rig.sensors}
    with styled():
        fig = figure(12.4, 0.6 + 2.2 * len(driving.drives))
        rows = fig.subplots(len(driving.drives), 2, squeeze=False)
        for drive, panels in zip(driving.drives, rows, strict=True):
            time, signals = drive.traces
            others = [
                name for name in signals if name != drive.worst_sensor and units[name] != units[drive.worst_sensor]
            ]
            shown = [drive.worst_sensor, *(others or [name for name in signals if name != drive.worst_sensor])][:2]
            for axes, name in zip(panels, shown):
                vehicle, bed, one_speed = signals[name]
                for values, colour, style, width, label in (
                    (vehicle, VEHICLE, "-", 3.0, "vehicle"), (bed, MATCHED, "-", 1.2, "matched rig"),
                    (one_speed, RIG, ":", 1.2, "controller of one speed"),
                ):  # fmt: skip
                    axes.plot(*decimated(time, values, MOST_POINTS), style, color=colour, linewidth=width, label=label)
                low, high = float(vehicle.min()), float(vehicle.max())
                room = 0.4 * max(high - low, 1e-9)
                axes.set_ylim(low - room, high + room)
                axes.set_ylabel(f"{spaced(name)}\nin {units[name].replace('*', '·')}", fontsize=8)
            panels[0].set_title(drive.title, fontsize=9, loc="left")
        for axes in rows[-1]:
            axes.set_xlabel("Time in s")
        handles, labels = rows[0][0].get_legend_handles_labels()
        fig.legend(handles, labels, loc="outside upper center", ncols=3)
    return fig


def fold(content: Mapping[str, Any]) -> list[Fold]:
    """What the page shows of a range; nothing without one."""
    driving = content.get("driving")
    if not driving:
        return []
    blocks: list[Block] = [_why(driving), Show("over_speed"), Table([_speed(row) for row in driving["speeds"]])]
    if driving["drives"]:
        blocks = [
            Table([_drive(row) for row in driving["drives"]], HOW.format(speed=number(KMH * driving["one_speed"], 3))),
            Show("drives"), *blocks,
        ]  # fmt: skip
    low, high = (number(KMH * speed, 3) for speed in driving["vehicle_speed"])
    return [Fold(f"Driving: one controller from {low} to {high} km/h", blocks)]


def key_rows(content: Mapping[str, Any]) -> list[tuple[str, str, str, str, str]]:
    """Rows of the first screen's table: what, vehicle, rig, matched, asked."""
    driving = content.get("driving")
    if not driving:
        return []
    low, high = (number(KMH * speed, 3) for speed in driving["vehicle_speed"])
    worst = _worst(driving)
    at = number(KMH * worst["vehicle_speed"], 2)
    stable = sum(row["stable"] for row in driving["speeds"])
    drawn = sum(row["drawn"] for row in driving["speeds"])
    rows = [
        (
            f"{low} to {high} km/h: response error, at most",
            "",
            "",
            f"{number(max(worst['measured'], worst['unmeasured']), 2)} at {at} km/h",
            "",
        ),
        ("  drawn beds stable at every speed", "", "", str(stable), str(drawn)),
    ]
    asked = f"≤ {100 * DRIVING.planned:g} %, {100 * DRIVING.tolerance:g} %"
    for drive in driving["drives"]:
        errors = drive["errors"]
        found = f"{percent(errors['planned'])}, {_share(errors['high'])}"
        if errors["planned"] is None:
            found = "left emulation"
        rows.append((f"  {drive['title']}: as planned, 95 % of beds", "", "", found, asked))
    return [*rows, *_pulses(driving)]


def _pulses(driving: Mapping[str, Any]) -> list[tuple[str, str, str, str, str]]:
    """Up to where the pulses of an engine are followed."""
    rows = []
    for pulse in driving.get("pulses", []):
        within, beds = number(100 * pulse["tolerance"], 2), number(100 * pulse["share"], 2)
        what = f"  order {number(pulse['order'], 3)} of {spaced(pulse['place'])}: amplitude within {within} % up to"
        rows.append((what, "", "", _until(pulse, pulse["planned"]), f"of {number(pulse['highest'], 3)} Hz"))
        rows.append((f"    on {beds} % of drawn beds within", "", "", percent(pulse["drawn_off"]), ""))
        rows.append(
            (f"    for it dynamometer {pulse['dynamometer']} gives", "", "", f"{number(pulse['torque'], 2)} N·m", "")
        )
    return rows


def _until(pulse: Mapping[str, Any], frequency: float | None) -> str:
    if frequency is None:
        return "nowhere"
    speed = 60 * frequency / pulse["order"]
    return f"{number(frequency, 3)} Hz ({number(speed, 3)} 1/min)"


def _share(value: float | None) -> str:
    return "fewer stay" if value is None else percent(value)


def _worst(driving: Mapping[str, Any]) -> Mapping[str, Any]:
    """The speed at which the larger of both errors, each over its scale, is largest."""

    def size(row: Mapping[str, Any]) -> float:
        return max(row["measured"] / ERROR_SCALES.measured, row["unmeasured"] / ERROR_SCALES.unmeasured)

    worst: Mapping[str, Any] = max(driving["speeds"], key=size)
    return worst


def _why(driving: Mapping[str, Any]) -> str:
    """The worst speed, and why it is: between two designs, or what dead time and sampling leave there."""
    worst, known = _worst(driving), {round(speed, 9) for speed in driving["designed_at"]}
    same_way = [row for row in driving["speeds"] if row["vehicle_speed"] * worst["vehicle_speed"] > 0]
    designed = [row for row in same_way if round(row["vehicle_speed"], 9) in known]
    near = min(designed, key=lambda row: abs(np.log(row["vehicle_speed"] / worst["vehicle_speed"])))
    speed, error = number(KMH * worst["vehicle_speed"], 2), number(max(worst["measured"], worst["unmeasured"]), 2)
    said = f"The error is largest at {speed} km/h ({error})"
    if worst is near:
        return f"{said}, where the controller is designed: that is what dead time, sampling and the weights leave."
    other = number(max(near["measured"], near["unmeasured"]), 2)
    return f"{said}, between two of the designs, whose matrices are interpolated; at the next design it is {other}."


def _drive(row: Mapping[str, Any]) -> dict[str, str]:
    errors, other = row["errors"], row["one_speed"]

    def stayed(found: Mapping[str, Any]) -> str:
        return f"{found['stayed']} of {found['drawn']}" + (f" ({found['fault']})" if found["fault"] else "")

    return {
        "drive": row["title"], "worst sensor": spaced(row["worst_sensor"]), "as planned": _share(errors["planned"]),
        "largest deviation": "" if (apart := errors.get("largest_deviation")) is None else f"{number(apart, 2)} N·m",
        "drawn beds, median": _share(errors["median"]), "95 %": _share(errors["high"]),
        "stay in emulation": stayed(errors),
        "command at rest": "" if errors["quiet"] is None else f"{number(errors['quiet'], 2)} N·m rms",
        "one speed, as planned": _share(other["planned"]),
    }  # fmt: skip


def _speed(row: Mapping[str, Any]) -> dict[str, str]:
    return {
        "km/h": number(KMH * row["vehicle_speed"], 3), "measured": number(row["measured"], 2),
        "unmeasured": number(row["unmeasured"], 2), "measured, 95 % of beds": number(row["measured_95"], 2),
        "unmeasured, 95 %": number(row["unmeasured_95"], 2),
        "stable, damped": f"{row['stable']}, {row['damped']} of {row['drawn']}",
        "modulus margin": number(row["modulus_margin"], 2), "|T| rolled off": number(row["largest_rolled_off"], 2),
        "command noise": f"{number(row['command_noise'], 2)} N·m", "missed": "; ".join(row["missed"]),
    }  # fmt: skip
