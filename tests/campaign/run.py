"""A campaign on any executor: workers make and diagnose recordings, rows are written as they come; it can be resumed.

    from concurrent.futures import ProcessPoolExecutor
    from tests.campaign.run import Campaign, run

    with ProcessPoolExecutor(2) as executor:
        rows = run(Campaign(cases=400, seed=1, seconds=8.0), "out/campaign", executor)

A cluster's workers need this repository on their path and the folder of ``out`` under the same name.
"""

import json
from collections.abc import Callable
from concurrent.futures import Executor
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from matching.studies import finished
from tests.campaign.work import Prepared, diagnosed, prepared


@dataclass(frozen=True)
class Campaign:
    """What a campaign is made of; ``seconds`` is the length of a recording, at 1 kHz; ``hard`` and
    ``vocabulary``: the second and the third one."""

    cases: int = 400
    seed: int = 1
    seconds: float = 8.0
    hard: bool = False
    vocabulary: bool = False

    @property
    def name(self) -> str:
        kind = "hard_" if self.hard else "vocabulary_" if self.vocabulary else ""
        return f"{kind}{self.cases}_{self.seed}_{self.seconds:g}s"


def record_of(campaign: Campaign, out: Path) -> Path:
    """The file of a campaign's rows, one a line."""
    return out / f"cases_{campaign.name}.jsonl"


def whole_lines(record: Path) -> list[str]:
    """Lines of a record, without one that a kill left half written."""
    text = record.read_text(encoding="utf-8") if record.exists() else ""
    return text[: text.rfind("\n") + 1].splitlines()


def run(
    campaign: Campaign, out: str | Path, executor: Executor, *, first: int | None = None,
    make_only: bool = False, progress: Callable[[int, int], None] | None = None,
) -> list[dict[str, Any]]:  # fmt: skip
    """Rows of a campaign: those on record, and those of the recordings that were still to be diagnosed.

    Parameters
    ----------
    out : path
        Directory of the record and of the recordings.
    executor : concurrent.futures.Executor
        Processes rather than threads: diagnoses are Python at work.
    first : int, optional
        Only so many recordings of the campaign; they come in random order.
    make_only : bool
        Make the recordings, diagnose nothing.
    progress : callable, optional
        Called with (recordings done, all recordings).
    """
    out = Path(out).resolve()
    out.mkdir(parents=True, exist_ok=True)
    record = record_of(campaign, out)
    rows = [json.loads(line) for line in whole_lines(record)]
    wanted = range(min(campaign.cases, first or campaign.cases))
    done = set() if make_only else {row["number"] for row in rows}
    numbers = [number for number in wanted if number not in done]
    before = len(wanted) - len(numbers)
    given = {**asdict(campaign), "made": str(out / f"made_{campaign.name}")}
    task = prepared if make_only else diagnosed
    for count, (_, row) in enumerate(finished(task, Prepared, given, numbers, executor, content=json.dumps(given)), 1):
        if not make_only:
            rows.append(row)
            with record.open("a", encoding="utf-8") as file:
                file.write(json.dumps(row) + "\n")
        if progress:
            progress(before + count, len(wanted))
    return rows
