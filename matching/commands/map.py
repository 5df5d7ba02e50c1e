"""`rigmatch map`: the response error that a match reaches, over two quantities."""

import argparse
from typing import Any

HELP = """Match the case at every pair of values of two quantities and draw the response error that is reached. A
quantity is named as in [move] of the case, or is one of the loop, e.g. loop.dead_time; it may carry its range and the
number of values, or all of them: loop.dead_time=0.001:0.008:6 or "loop.dead_time=1 ms,2 ms,5 ms". Mirror images get
the same value. Every point is then solved again from its neighbours' solutions until none improves. Writes map.json,
report.html, map.svg and map.png. Points are kept in map.partial.jsonl as they come; a map that was stopped continues
from them."""
PAGE = "report.html"  # in the folder of --out
EXAMPLES = (
    "rigmatch map examples/road_to_rig/case.toml --x loop.dead_time=1ms:8ms:4 "
    "--y rig.shafts.flange_left.stiffness=1e5:4e5:3 --out out/map",
    'rigmatch map examples/road_to_rig/case.toml --x "loop.dead_time=1 ms,2 ms,5 ms" --y loop.inverter_lag --starts 1 '
    "--out out/map_of_lags",
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Case file, both quantities, output directory, and effort."""
    from matching.arguments import completed, count, scale_out

    parser.add_argument("case", metavar="CASE", help="case file (TOML)")
    for name in ("x", "y"):
        axis = parser.add_argument(
            f"--{name}", metavar="QUANTITY", required=True, help="QUANTITY[=LOW:HIGH[:N]] or QUANTITY=VALUE,VALUE,…"
        )
        completed(axis, _quantities)
    parser.add_argument("--out", metavar="DIR", required=True, help="directory to write to")
    parser.add_argument(
        "--seed", metavar="N", type=count(0), default=0, help="seed of the starting points (default: 0)"
    )
    parser.add_argument("--starts", metavar="N", type=count(1), default=2, help="starting points a match (default: 2)")
    scale_out(parser)


def _quantities(arguments: argparse.Namespace) -> list[str]:
    from matching.completion import quantities_of_case

    return quantities_of_case(arguments.case)


def run(arguments: argparse.Namespace) -> dict[str, Any]:
    """Draw the map; the result object is the content of ``map.json``."""
    from pathlib import Path

    from matching.arguments import progress
    from matching.executors import executor_of
    from matching.frequency.case.load import load_case
    from matching.frequency.studies.map import map_case
    from matching.frequency.studies.map_axis import axis
    from matching.report.common.provenance import provenance
    from matching.report.common.style import image
    from matching.report.map.figure import map_figure
    from matching.report.map.page import page
    from modelling.common.cores import cores
    from modelling.writing.output import write_results

    case = load_case(arguments.case)
    x, y = (axis(case, getattr(arguments, name), f"--{name}") for name in ("x", "y"))
    record = Path(arguments.out) / "map.partial.jsonl"
    with (
        executor_of(arguments.workers or cores(), arguments.scheduler) as executor,
        progress("map") as advance,
    ):
        study = map_case(
            case, x, y, executor, seed=arguments.seed, starts=arguments.starts, record=record, progress=advance
        )
    result = study.to_dict()
    drawn = map_figure(study)
    files: dict[str, str | bytes] = {f"map.{kind}": image(drawn, kind) for kind in ("svg", "png")}
    files["report.html"] = page(study, image(drawn), provenance(case, arguments.seed))
    written = write_results(arguments.out, "map.json", result, files)
    record.unlink(missing_ok=True)
    return written


def summary(result: dict[str, Any]) -> str:
    """The best point, how many match, and how many were improved from their neighbours' solutions."""
    from matching.report.common.wording import amount, counted, number

    points = [point for point in result["points"] if point["error"] is not None]
    matched = [point for point in points if point["status"] == "matched"]
    lines = [f"{len(matched)} of {len(result['points'])} points matched"]
    if points:
        best = min(matched or points, key=lambda point: point["error"])
        place = ", ".join(f"{result[key]['name']} {amount(best[key], result[key]['unit'])}" for key in ("x", "y"))
        lines.append(f"least error {number(best['error'], 3)} at {place} ({best['status']})")
    better = [point for point in points if point["objective"] != point["objective_from_own_starts"]]
    if better:
        lines.append(f"{counted(len(better), 'point')} improved from their neighbours' solutions")
    return "\n".join(lines)
