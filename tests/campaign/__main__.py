"""The campaign that judges a diagnosis on what it was not tuned on.

``python -m tests.campaign make DIR --cases 300 --seed 8201`` makes recordings; ``… run DIR --seconds 2700`` diagnoses
them and goes on where it was stopped; ``… table DIR`` prints what the answers are worth, ``… picture DIR`` draws it.
``--only perfect`` takes one category alone.
"""

import argparse
import json
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

from tests.campaign.recordings import make, rows, run


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("work", choices=["make", "run", "table", "picture"])
    parser.add_argument("folder", type=Path)
    parser.add_argument("--record", type=Path, help="rows, one a line; beside the folder if not given")
    parser.add_argument("--cases", type=int, default=300)
    parser.add_argument("--seed", type=int, default=8201)
    parser.add_argument("--only", default="", help="a category")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--seconds", type=float, default=2700.0, help="after which no further recording is begun")
    given = parser.parse_args()
    record = given.record or given.folder.with_suffix(".jsonl")
    if given.work == "make":
        from plant.orders import orders

        wanted = [(k, one) for k, one in enumerate(orders(given.cases, given.seed)) if given.only in ("", one.category)]
        with ProcessPoolExecutor(given.workers) as pool:
            places = [given.folder / f"{k:03d}" for k, _ in wanted]
            print("".join(f"{line}\n" for line in pool.map(make, places, [one for _, one in wanted]) if line), end="")
    elif given.work == "run":
        run(given.folder, record, given.workers, given.seconds)
    elif given.work == "picture":
        from tests.campaign.picture import picture

        picture(rows(record), given.folder.with_suffix(".png"))
    else:
        from tests.campaign.score import table

        print(json.dumps(table(rows(record)), indent=1))


if __name__ == "__main__":
    main()
