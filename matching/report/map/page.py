"""The page of a map: the best point, how far a match reaches, what limits it elsewhere; every point to download."""

from __future__ import annotations

from collections import Counter

from matching.frequency.studies.map import Map
from matching.frequency.studies.map_axis import Axis
from matching.frequency.studies.map_point import Point
from matching.report.common.csv_table import csv_table
from matching.report.common.provenance import Provenance
from matching.report.common.screen_point import ScreenPoint
from matching.report.common.wording import amount, number, practical
from matching.report.map.acting import acting_map, limiting_words
from matching.report.map.figure import case_lies_on
from matching.report.study.page import PageFigures, StudyPage, study_page

CAPTION = "Response error that a match reaches at every pair of values; hatched where a limit stands in the way."
CAPTION_OF_RING = "The ring is the case as it is."
NO_MATCH = "no point is matched: widen the limits, the bounds under [move] or the range of the map"


def page(result: Map, image: bytes, made: Provenance | None = None) -> str:
    """The page as HTML, from a map and its picture."""
    points = [point for row in result.points for point in row]
    matched = [point for point in points if point.status == "matched" and point.error is not None]
    content = StudyPage(
        title=f"Map: {result.title}" if result.title else "Map of the response error",
        status=f"{len(matched)} of {len(points)} matched",
        answer=_answer(result, points, matched),
        good=bool(matched),
        first_screen={
            "What to choose": _to_choose(result, matched),
            "How far a match reaches": [
                _reach(axis, name, matched) for name, axis in (("x", result.x), ("y", result.y))
            ],
            "What stands in the way": _in_the_way(points),
        },
        captions={"map": f"{CAPTION} {CAPTION_OF_RING}" if case_lies_on(result) else CAPTION},
    )
    return study_page(content, PageFigures({"map": image}, acting_map(result), {"map": point_data(result)}), made)


def point_data(result: Map) -> str:
    """Every point with its tuned values (CSV, SI)."""
    points = [point for row in result.points for point in row]
    names = list(dict.fromkeys(name for point in points for name in point.values))
    head = [f"{axis.name} [{axis.unit}]" for axis in (result.x, result.y)]
    head += [
        "status",
        "error",
        "error, unmeasured torques",
        "bound",
        "modulus margin",
        "share of stable beds",
        "limited by",
        *names,
    ]
    rows = [
        [point.x, point.y, point.status, point.error, point.unmeasured, point.bound, point.modulus_margin,
         point.stable_beds, " ".join(point.limited_by), *(point.values.get(name) for name in names)]
        for point in points
    ]  # fmt: skip
    return csv_table(head, rows)


def _answer(result: Map, points: list[Point], matched: list[Point]) -> str:
    known = matched or [point for point in points if point.error is not None]
    if not known:
        return "No point has a response error: no match could be tried."
    best = min(known, key=_error)
    limited = "" if matched else ", though limited,"
    return f"The least response error{limited} is {number(best.error, 3)}, at {_place(result, best)}."


def _to_choose(result: Map, matched: list[Point]) -> list[ScreenPoint]:
    if not matched:
        return [ScreenPoint("nothing on this map", NO_MATCH)]
    best = min(matched, key=_error)
    chosen = [
        ScreenPoint(_place(result, best), f"least error of all matched points, margin {number(best.modulus_margin, 3)}")
    ]
    safest = max(matched, key=lambda point: point.modulus_margin or 0.0)
    if safest is not best:
        reason = f"largest modulus margin, {number(safest.modulus_margin, 3)}; error {number(safest.error, 3)}"
        chosen.append(ScreenPoint(_place(result, safest), reason))
    return chosen


def _reach(axis: Axis, key: str, matched: list[Point]) -> ScreenPoint:
    values = sorted({getattr(point, key) for point in matched})
    if not values:
        return ScreenPoint(f"{axis.name}: nowhere")
    ends = " to ".join(dict.fromkeys(practical(value, axis.unit) for value in (values[0], values[-1])))
    whole = values[0] == axis.values[0] and values[-1] == axis.values[-1]
    return ScreenPoint(
        f"{axis.name}: {ends}", "the whole range of the map" if whole else "with some value of the other"
    )


def _in_the_way(points: list[Point]) -> list[ScreenPoint]:
    counted = Counter(limiting_words(point) for point in points if point.status != "matched")
    if not counted:
        return [ScreenPoint("nothing on this map", "every point is matched")]
    return [ScreenPoint(words, f"at {count} of {len(points)} points") for words, count in counted.most_common(4)]


def _place(result: Map, point: Point) -> str:
    return ", ".join(
        f"{axis.name} {practical(value, axis.unit) if axis.unit == 's' else amount(value, axis.unit)}"
        for axis, value in ((result.x, point.x), (result.y, point.y))
    )


def _error(point: Point) -> float:
    return float("inf") if point.error is None else point.error
