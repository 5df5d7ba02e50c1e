"""The work on one recording of a campaign, in a worker."""

import contextlib
import json
import sys
import time
import traceback
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parents[1]))  # the truth plant is imported as `plant`

ONE_HIDDEN = ("single", "model_error", "wrong_noise", "newer", "closed_loop")


def made_in(number: int, order: Any, made: Path, seconds: float) -> Path:
    """Files of a case, made if they are not there yet.

    Raises
    ------
    plant.calibrate.OutOfReach
        If no system can carry the effect in that size.
    """
    folder = made / str(number)
    if not (folder / "answer.json").exists():
        case = order.make(seconds, rivals=False)
        case.write(folder)
        if not case.answer["differs"]:  # the end of the recordings is held out here
            (folder / "holdout.csv").unlink()
        (folder / "answer.json").write_text(json.dumps(case.answer))
    return folder


class Prepared:
    """What a worker needs for every recording: what was ordered, and where to make it."""

    def __init__(self, given: dict[str, Any]):
        from plant.campaign import campaign_cases
        from plant.hard import hard_cases
        from plant.vocabulary import vocabulary_cases

        make = hard_cases if given.get("hard") else vocabulary_cases if given.get("vocabulary") else campaign_cases
        self.orders = make(given["cases"], given["seed"])
        self.made, self.seconds = Path(given["made"]), given["seconds"]


def prepared(given: Prepared, number: int) -> None:
    """Make a case, if it can be made."""
    from plant.calibrate import OutOfReach

    with contextlib.suppress(OutOfReach, FloatingPointError):
        made_in(number, given.orders[number], given.made, given.seconds)


def diagnosed(given: Prepared, number: int) -> dict[str, Any]:
    """Make a case, diagnose it, keep what is scored."""
    from plant.calibrate import OutOfReach

    from matching.diagnosis.diagnose import diagnose
    from modelling.model_file import load
    from modelling.recordings.read import read_recording
    from tests.campaign.score import where

    order = given.orders[number]
    row: dict[str, Any] = {"number": number, "order": order.__dict__ | {"effects": list(order.effects)}}
    try:
        folder = made_in(number, order, given.made, given.seconds)
    except (OutOfReach, FloatingPointError) as reason:  # the latter: its own control loop runs away
        return row | {"failed": f"not made: {reason}"}
    answer = json.loads((folder / "answer.json").read_text())
    system = load(folder / "model.toml")
    recordings = [
        read_recording(file, system) for file in (folder / "recording.csv", folder / "holdout.csv") if file.exists()
    ]
    begin = time.perf_counter()
    try:
        found = diagnose(system, recordings).to_dict()
    except Exception as fault:
        return row | {
            "failed": f"{type(fault).__name__}: {fault}",
            "trace": traceback.format_exc()[-1500:],
            "answer": answer,
        }
    row |= {"seconds": time.perf_counter() - begin, "found": found}
    named = [(cause["kind"], where(cause)) for cause in found["causes"]]
    hidden = [(cause["kind"], cause["at"]) for cause in answer["causes"]]
    missed = dict.fromkeys(ONE_HIDDEN, named[:1] != hidden[:1]) | {"double": not set(hidden) <= set(named)}
    if named and missed.get(order.category, False):
        # again, with the causes that no recording like it tells apart; where the motion without the effect runs away
        # under the recorded torques, the answer stays missed
        with contextlib.suppress(FloatingPointError):
            answer = order.make(given.seconds).answer
    return row | {"answer": answer}
