"""`rigmatch map`: the achievable error over two quantities."""

import argparse
from typing import Any

HELP = """Match the case at every pair of values of two quantities and draw the response error that is reached. A
quantity is named as in [move] of the case, or is one of the loop, e.g. loop.dead_time; it may carry its range and the
number of values: loop.dead_time=0.001:0.008:6 or "loop.dead_time=1 ms:8 ms". Mirror images go along. Writes map.json
and map.svg."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Case file, both quantities, place to write to, and how hard to work."""
    from matching.arguments import count

    parser.add_argument("case", metavar="CASE", help="case file (TOML)")
    for name in ("x", "y"):
        parser.add_argument(f"--{name}", metavar="QUANTITY", required=True, help="QUANTITY[=LOW:HIGH[:N]]")
    parser.add_argument("--out", metavar="DIR", required=True, help="directory to write to")
    parser.add_argument(
        "--seed", metavar="N", type=count(0), default=0, help="seed of the starting points (default: 0)"
    )
    parser.add_argument("--starts", metavar="N", type=count(1), default=2, help="starting points a match (default: 2)")
    parser.add_argument("--workers", metavar="N", type=count(1), help="processes (default: one a core)")


def run(arguments: argparse.Namespace) -> dict[str, Any]:
    """Draw the map; the result object is the content of ``map.json``."""
    from matching.arguments import cores, progress
    from matching.frequency.case import load_case
    from matching.frequency.map import axis, map_case
    from matching.report.map_figure import map_figure
    from matching.report.style import image
    from modelling.output import strict_json, write_all

    case = load_case(arguments.case)
    x, y = (axis(case, getattr(arguments, name), f"--{name}") for name in ("x", "y"))
    with progress("map") as advance:
        found = map_case(
            case,
            x,
            y,
            seed=arguments.seed,
            starts=arguments.starts,
            workers=arguments.workers or cores(),
            progress=advance,
        )
    result = found.to_dict()
    write_all(arguments.out, {"map.json": strict_json(result), "map.svg": image(map_figure(found))})
    return result


def summary(result: dict[str, Any]) -> str:
    """The best point, and how many match."""
    from matching.report.words import amount, number

    points = [own for own in result["points"] if own["error"] is not None]
    matched = [own for own in points if own["status"] == "matched"]
    lines = [f"{len(matched)} of {len(result['points'])} points matched"]
    if points:
        best = min(matched or points, key=lambda own: own["error"])
        place = ", ".join(f"{result[key]['name']} {amount(best[key], result[key]['unit'])}" for key in ("x", "y"))
        lines.append(f"least error {number(best['error'], 3)} at {place} ({best['status']})")
    return "\n".join(lines)
