"""The work on one recording of a campaign, in a process of its own."""

import contextlib
import json
import sys
import time
import traceback
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parents[1]))  # the truth plant is imported as `plant`


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
        (folder / "holdout.csv").unlink()  # the end of the recording is held out here
        (folder / "answer.json").write_text(json.dumps(case.answer))
    return folder


def prepared(number: int, order: Any, made: Path, seconds: float) -> None:
    """Make a case, if it can be made."""
    from plant.calibrate import OutOfReach

    with contextlib.suppress(OutOfReach):
        made_in(number, order, made, seconds)


def diagnosed(number: int, order: Any, made: Path, seconds: float) -> dict[str, Any]:
    """Make a case, diagnose it, keep what is scored."""
    from plant.calibrate import OutOfReach

    from matching.diagnosis.diagnosis import diagnose
    from modelling.files import load
    from modelling.recording import read_recording

    row: dict[str, Any] = {"number": number, "order": order.__dict__ | {"effects": list(order.effects)}}
    try:
        folder = made_in(number, order, made, seconds)
    except OutOfReach as reason:
        return row | {"failed": f"not made: {reason}"}
    answer = json.loads((folder / "answer.json").read_text())
    system = load(folder / "model.toml")
    recording = read_recording(folder / "recording.csv", system)
    begin = time.perf_counter()
    try:
        found = diagnose(system, [recording]).to_dict()
    except Exception as fault:
        return row | {
            "failed": f"{type(fault).__name__}: {fault}",
            "trace": traceback.format_exc()[-1500:],
            "answer": answer,
        }
    row |= {"seconds": time.perf_counter() - begin, "found": found}
    first = found["causes"][0] if found["causes"] else None
    if order.category == "single" and first and (first["kind"], first["at"]) != (answer["kind"], answer["at"]):
        answer = order.make(seconds).answer  # the same again, with the causes that no recording like it tells apart
    return row | {"answer": answer}
