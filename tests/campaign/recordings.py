"""The work on the recordings of a campaign: made, diagnosed, and on record."""

import json
import sys
import time
from concurrent.futures import ProcessPoolExecutor, as_completed
from itertools import islice
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parents[1]))  # the truth plant is imported as `plant`

RENEWED = 10  # recordings a process; a new one gives memory back


def make(place: Path, order: Any) -> str:
    """Make a recording that is not there yet; why not, where it cannot be made."""
    from plant.calibrate import OutOfReach

    if (place / "answer.json").exists():
        return ""
    try:
        case = order.make()
    except (OutOfReach, FloatingPointError) as reason:  # the latter: its own control loop runs away
        return f"{place.name} {order.category} not made: {reason}"
    case.write(place)
    if not case.answer["differs"]:  # the end of the recording is held out
        (place / "holdout.csv").unlink()
    (place / "answer.json").write_text(json.dumps(case.answer))
    return ""


def diagnosed(place: Path) -> dict[str, Any]:
    """Diagnose a recording."""
    from matching.diagnosis.diagnose import diagnose
    from modelling.model_file import load
    from modelling.recordings.read import read_recording

    row: dict[str, Any] = {"number": place.name, "answer": json.loads((place / "answer.json").read_text())}
    system = load(place / "model.toml")
    files = [place / name for name in ("recording.csv", "holdout.csv") if (place / name).exists()]
    clock = time.process_time()
    try:
        row["found"] = diagnose(system, [read_recording(file, system) for file in files]).to_dict()
    except Exception as fault:  # a campaign goes on
        row["failed"] = f"{type(fault).__name__}: {fault}"
    return row | {"seconds": time.process_time() - clock}


def run(folder: Path, record: Path, workers: int, seconds: float) -> None:
    """Diagnose the recordings that are not on record yet, for so long; rows are written as they come."""
    end, done = time.monotonic() + seconds, {row["number"] for row in rows(record)}
    left = iter([path.parent for path in sorted(folder.glob("*/answer.json")) if path.parent.name not in done])
    while time.monotonic() < end and (batch := list(islice(left, RENEWED * workers))):
        with ProcessPoolExecutor(workers) as pool, record.open("a", encoding="utf-8") as file:
            for each in as_completed([pool.submit(diagnosed, place) for place in batch]):
                file.write(json.dumps(each.result()) + "\n")
                file.flush()
                if time.monotonic() > end:
                    pool.shutdown(wait=False, cancel_futures=True)
                    break


def rows(record: Path) -> list[dict[str, Any]]:
    """What is on record."""
    return [json.loads(line) for line in record.read_text().splitlines()] if record.exists() else []
