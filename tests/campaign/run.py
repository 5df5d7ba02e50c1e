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

from matching import studies
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
    given = {**asdict(campaign), "made": str(out / f"made_{campaign.name}")}
    numbers = list(range(min(campaign.cases, first or campaign.cases)))
    record = None if make_only else out / f"cases_{campaign.name}.jsonl"
    return studies.run(
        prepared if make_only else diagnosed, Prepared, given, numbers, executor,
        content=json.dumps(given), record=record, progress=progress,
    )  # fmt: skip
