"""The campaign that judges a diagnosis on what it was not tuned on.

``python -m tests.campaign.fresh make DIR --cases 60 --seed 8201`` makes recordings; ``… run DIR --seconds 900``
diagnoses them one after another and goes on where it was stopped; ``… table DIR`` prints what the answers are worth,
``… picture DIR`` draws it.
"""

import argparse
import json
import sys
import time
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parents[1]))  # the truth plant is imported as `plant`

QUICK_FIRST = ("perfect", "plain", "subtle", "outside", "wrong_clean", "wrong_plain", "wrong_subtle")
ALARM = 0.5  # confidence from which a cause outside the vocabulary is an alarm
BEYOND_CHANCE = 1.02  # ratio of pooled unseen errors


def make(folder: Path, cases: int, seed: int) -> None:
    """Make the recordings that are not there yet."""
    from plant.calibrate import OutOfReach
    from plant.fresh import fresh_cases

    for number, order in enumerate(fresh_cases(cases, seed)):
        place = folder / f"{number:03d}"
        if (place / "answer.json").exists():
            continue
        try:
            case = order.make()
        except (OutOfReach, FloatingPointError) as reason:
            print(number, order.category, "not made:", reason)
            continue
        case.write(place)
        if not case.answer["differs"]:
            (place / "holdout.csv").unlink()
        (place / "answer.json").write_text(json.dumps(case.answer))


def run(folder: Path, record: Path, seconds: float) -> None:
    """Diagnose the recordings that are not on record yet, for so long."""
    from matching.diagnosis.diagnose import diagnose
    from modelling.model_file import load
    from modelling.recordings.read import read_recording

    begin = time.monotonic()
    done = {row["number"] for row in rows(record)}
    answers = {place: json.loads((place / "answer.json").read_text()) for place in sorted(folder.iterdir())
               if (place / "answer.json").exists() and place.name not in done}  # fmt: skip
    for place, answer in sorted(answers.items(), key=lambda one: QUICK_FIRST.index(one[1]["category"])):
        if time.monotonic() - begin > seconds:
            break
        row: dict[str, Any] = {"number": place.name, "answer": answer}
        system = load(place / "model.toml")
        files = [place / name for name in ("recording.csv", "holdout.csv") if (place / name).exists()]
        clock = time.process_time()
        try:
            row["found"] = diagnose(system, [read_recording(file, system) for file in files]).to_dict()
        except Exception as fault:  # a campaign goes on
            row["failed"] = f"{type(fault).__name__}: {fault}"
        row["seconds"] = time.process_time() - clock
        with record.open("a", encoding="utf-8") as file:
            file.write(json.dumps(row) + "\n")


def rows(record: Path) -> list[dict[str, Any]]:
    """What is on record."""
    return [json.loads(line) for line in record.read_text().splitlines()] if record.exists() else []


def table(every: list[dict[str, Any]]) -> dict[str, Any]:
    """Counts by category: [good, of]."""
    from tests.campaign.score import covered, matches, right

    made = [row for row in every if "found" in row]
    out: dict[str, Any] = {"failed": [row["failed"] for row in every if "failed" in row]}
    for category in ("plain", "subtle", "wrong_plain", "wrong_subtle"):
        own = [row for row in made if row["answer"]["category"] == category]
        out[f"{category}: right first"] = [sum(right(row) for row in own), len(own)]
    for category in ("perfect", "wrong_clean"):
        own = [row for row in made if row["answer"]["category"] == category]
        out[f"{category}: any cause"] = [sum(bool(row["found"]["causes"]) for row in own), len(own)]
    own = [row for row in made if row["answer"]["category"] == "outside"]
    named = [max((c["confidence"] for c in row["found"]["causes"]), default=0.0) > ALARM for row in own]
    out[f"outside: confidence over {ALARM}"] = [sum(named), len(own)]
    caused = [row for row in made if row["found"]["causes"]]
    gains = [row["found"]["gain"] for row in caused]
    worse = [gain["nrmse_after"] > BEYOND_CHANCE * gain["nrmse_before"] for gain in gains]
    out["causes named, unseen error higher"] = [sum(worse), len(caused)]
    intervals = covered([row for row in made if not row["answer"]["background"]], causes=True)
    out["95 % intervals cover"] = [sum(intervals), len(intervals)]
    wrong = [c["confidence"] for row in caused for c in row["found"]["causes"] if not _hidden(c, row, matches)]
    out["wrong causes of confidence over 0.9"] = [sum(c > 0.9 for c in wrong), len(wrong)]
    times = sorted(row["seconds"] for row in made)
    out["processor seconds: median, most, all"] = [times[len(times) // 2], times[-1], sum(times)] if times else None
    return out


def picture(every: list[dict[str, Any]], path: Path) -> None:
    """Draw what was named first against what was hidden, and the reliability of the confidences."""
    from matplotlib.figure import Figure

    from tests.campaign.picture import confusion_axes, reliability_axes
    from tests.campaign.score import confidences

    rows = [row | {"order": _order(row["answer"])} for row in every if "found" in row]
    figure = Figure(figsize=(13, 7), layout="constrained")
    left, right = figure.subplots(1, 2, width_ratios=(1.4, 1))
    confusion_axes(left, rows)
    reliability_axes(right, confidences(rows))
    figure.savefig(path, dpi=100)


def _order(answer: dict[str, Any]) -> dict[str, Any]:
    """What was hidden, as the scores of the other campaigns take it."""
    if not answer["causes"]:
        return {"category": "clean", "effects": []}
    cause, outside = answer["causes"][0], answer["category"] == "outside"
    kind = cause["kind"]
    if kind == "lag":
        kind = ("input" if cause["at"].startswith("inputs") else "sensor") + "_lag"
    return {"category": "outside" if outside else "single", "effects": [kind]}


def _hidden(cause: dict[str, Any], row: dict[str, Any], matches: Any) -> bool:
    return any(matches(cause, one) for one in row["answer"]["causes"])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("work", choices=["make", "run", "table", "picture"])
    parser.add_argument("folder", type=Path)
    parser.add_argument("--record", type=Path, help="rows, one a line; beside the folder if not given")
    parser.add_argument("--cases", type=int, default=60)
    parser.add_argument("--seed", type=int, default=8201)
    parser.add_argument("--seconds", type=float, default=2700.0)
    given = parser.parse_args()
    record = given.record or given.folder.with_suffix(".jsonl")
    if given.work == "make":
        make(given.folder, given.cases, given.seed)
    elif given.work == "run":
        run(given.folder, record, given.seconds)
    elif given.work == "picture":
        picture(rows(record), given.folder.with_suffix(".png"))
    else:
        print(json.dumps(table(rows(record)), indent=1))


if __name__ == "__main__":
    main()
