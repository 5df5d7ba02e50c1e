"""Four recordings of one drive, four verdicts.

python examples/diagnosis/run.py
"""

import importlib.util
import sys
from pathlib import Path

from matching.diagnosis.diagnose import diagnose
from matching.diagnosis.result import Diagnosis
from matching.report.diagnosis import content, summary
from modelling.model_file import load
from modelling.recordings.read import read_recording

HERE = Path(__file__).parent


def main(folder: Path = Path("out/diagnosis")) -> dict[str, Diagnosis]:
    """Record, diagnose, and check every answer against what was hidden."""
    spec = importlib.util.spec_from_file_location("record", HERE / "record.py")
    assert spec is not None
    assert spec.loader is not None
    record = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(record)
    record.main(folder)
    system = load(HERE / "model.toml")
    found = {}
    for name in ("play", "play_pulled_one_way", "sound", "shaken_from_outside"):
        found[name] = diagnose(system, [read_recording(folder / f"{name}.csv", system)])
        print(f"{name}: {found[name].verdict}\n{summary(content(found[name]))}\n")

    play = found["play"]
    assert play.verdict == "explained"
    assert [(cause.kind, cause.at) for cause in play.causes] == [("backlash", "shafts.link")]
    gap = play.causes[0].parameters["gap"]
    assert abs(gap.value - record.GAP) < 0.01 * record.GAP
    for errors in play.errors.values():  # back to the noise, on data no fit saw
        assert errors.after_holdout < 1.1 * errors.noise
    stiffness = play.parameters["shafts.link.stiffness"]  # and the model's own values come back to truth
    assert abs(stiffness.value - record.TRUTH["stiffness"]) < 4 * stiffness.standard_uncertainty

    # the same play, but the flanks never part: nothing in the recording tells of it, and nothing is made up
    assert found["play_pulled_one_way"].verdict == "adequate"
    assert found["sound"].verdict == "adequate"
    assert not found["sound"].causes

    shaken = found["shaken_from_outside"]  # a torque that no input tells is no law of the vocabulary
    assert shaken.verdict == "unexplained"
    assert all(cause.confidence < 0.5 for cause in shaken.causes)
    assert shaken.rest
    return found


if __name__ == "__main__":
    main(*map(Path, sys.argv[1:2]))
