"""The long diagnosis campaign: many recordings of the truth plant with something hidden in them, diagnosed and scored.

``python -m tests.campaign [--cases 400] [--seed 1] [--out out/campaign] [--workers 2]``; started again, it goes
on where it was stopped.
"""

import argparse
import json
import sys
import tempfile
import time
from concurrent.futures import ProcessPoolExecutor, as_completed
from pathlib import Path
from typing import Any

TESTS = Path(__file__).parents[1]
sys.path.insert(0, str(TESTS))  # the truth plant is imported as `plant`


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--cases", type=int, default=400)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--out", type=Path, default=Path("out/campaign"))
    given = parser.parse_args()
    given.out.mkdir(parents=True, exist_ok=True)
    kept = given.out / f"cases_{given.cases}_{given.seed}.jsonl"
    rows = [json.loads(line) for line in kept.read_text().splitlines()] if kept.exists() else []
    run(given.cases, given.seed, given.workers, rows, kept)
    from tests.campaign.score import report

    report(rows, given.out, given.seed)


def run(cases: int, seed: int, workers: int, rows: list[dict[str, Any]], kept: Path) -> None:
    """Diagnose what is not in ``rows`` yet; every answer is appended to the file ``kept`` at once."""
    from plant.campaign import campaign_cases
    from tqdm import tqdm

    done = {row["number"] for row in rows}
    orders = [(i, order) for i, order in enumerate(campaign_cases(cases, seed)) if i not in done]
    with ProcessPoolExecutor(workers) as pool, kept.open("a") as file:
        jobs = [pool.submit(one, number, order) for number, order in orders]
        for job in tqdm(as_completed(jobs), total=len(jobs), disable=not sys.stderr.isatty()):
            row = job.result()
            rows.append(row)
            file.write(json.dumps(row) + "\n")
            file.flush()


def one(number: int, order: Any) -> dict[str, Any]:
    """Make a case, diagnose it, keep what is scored."""
    from plant.calibrate import OutOfReach

    from matching.diagnosis.diagnosis import diagnose
    from modelling.files import load
    from modelling.recording import read_recording

    row: dict[str, Any] = {"number": number, "order": order.__dict__ | {"effects": list(order.effects)}}
    try:
        case = order.make()
    except OutOfReach as reason:
        return row | {"failed": f"not made: {reason}"}
    with tempfile.TemporaryDirectory() as folder:
        case.write(folder)
        system = load(f"{folder}/model.toml")
        recording = read_recording(f"{folder}/recording.csv", system)
        begin = time.perf_counter()
        try:
            found = diagnose(system, [recording]).to_dict()
        except Exception as fault:
            import traceback

            return row | {"failed": f"{type(fault).__name__}: {fault}", "trace": traceback.format_exc()[-1500:]}
    return row | {"seconds": time.perf_counter() - begin, "answer": case.answer, "found": found}


if __name__ == "__main__":
    main()
