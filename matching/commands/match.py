"""`rigmatch match`: tune loop, residual vehicle and adapters until the rig reproduces the vehicle's response."""

import argparse
from typing import Any

HELP = """Tune the quantities under [move] of the case until the rig reproduces the vehicle's response, check the
result by methods other than those of the tuning, and write result.json, report.html, figures, and the tuned model
files (case.toml, vehicle.toml, rig.toml, residual_vehicle*.toml), which rigmatch reads again. Where the targets
cannot be met the status is "limited" and the limits name the reasons."""
BEDS_OF_FEEDBACK = 40  # drawn beds that judge a feedback law unless asked otherwise; they take about two seconds
PAGE = "report.html"  # in the folder of --out
EXAMPLES = (
    "rigmatch match examples/road_to_rig/case.toml --out out/match",
    "rigmatch match examples/compact_bev/case.toml --seed 3 --starts 20 --workers 2 --out out/compact",
    "rigmatch match examples/road_to_rig/observer.toml --beds 2000 --out out/observer",
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Case file, output directory, and effort of the search."""
    from matching.arguments import count

    parser.add_argument("case", metavar="CASE", help="case file (TOML)")
    parser.add_argument("--out", metavar="DIR", required=True, help="directory to write to")
    parser.add_argument(
        "--seed", metavar="N", type=count(0), default=0, help="seed of the starting points (default: 0)"
    )
    parser.add_argument("--starts", metavar="N", type=count(1), help="largest number of starting points (default: 14)")
    parser.add_argument("--workers", metavar="N", type=count(1), help="processes (default: one a core)")
    parser.add_argument(
        "--beds",
        metavar="N",
        type=count(1),
        help="fresh beds drawn from [uncertainty] that judge the result (default: 200 of an observer, else 40)",
    )


def run(arguments: argparse.Namespace) -> dict[str, Any]:
    """Match and write files; the result object is the content of ``result.json``."""
    from matching.arguments import steps
    from matching.aside import beside
    from matching.expected_end import OF_A_MATCH
    from matching.frequency.case.case_file import case_files
    from matching.frequency.case.load import load_case
    from matching.frequency.search.match import match
    from modelling.common import protection
    from modelling.common.cores import cores
    from modelling.writing.output import write_results

    case, workers = load_case(arguments.case), arguments.workers or cores()
    protection.check(arguments.out, case_files(case))  # before the work
    beds = arguments.beds
    if beds is None and not case.loop.structure.is_observer:
        beds = BEDS_OF_FEEDBACK
    effort = {} if arguments.starts is None else {"starts": arguments.starts}
    with beside(workers) as aside:
        aside.prepare("matching.report.match.figures", "matching.report.curves.moving_figures", "bokeh.plotting")
        with steps("match", OF_A_MATCH) as tell:
            matched = match(case, arguments.seed, progress=tell, workers=workers, beds=beds, aside=aside, **effort)
        result, files = _written(matched, arguments.seed, aside)
    return write_results(arguments.out, "result.json", result, files)


def _written(matched: Any, seed: int, aside: Any) -> tuple[dict[str, Any], dict[str, str | bytes]]:
    """Result and files by name; the figures are drawn aside, from the first on, and here, from the last on."""
    from matching.frequency.case.case_file import case_files
    from matching.report.common.provenance import provenance
    from matching.report.curves.curve_data import curve_data
    from matching.report.curves.moving_figures import moving_figures
    from matching.report.match.figures import drawers, svg
    from matching.report.match.page import page
    from matching.report.match.text import content

    aside.share(matched)
    acting = aside.begin(moving_figures, matched)
    tasks = {name: aside.begin(svg, matched, name) for name in drawers(matched)}
    made = provenance(matched.case, seed)
    result, curves = content(matched) | {"made_by": made.to_dict()}, curve_data(matched)
    drawn = {name: tasks[name].result() for name in reversed(tasks)}
    drawn = {name: drawn[name] for name in tasks}
    files: dict[str, str | bytes] = {"report.html": page(matched, drawn, made, acting.result(), curves)}
    return result, files | {f"figures/{name}.svg": image for name, image in drawn.items()} | case_files(matched.tuned)


def summary(result: dict[str, Any]) -> str:
    """The result in at most twenty lines."""
    from matching.report.match.text import summary as words

    return words(result)
