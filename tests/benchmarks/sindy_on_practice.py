"""Diagnosis against PySINDy on the ten shared practice recordings: errors on held-out data, the cause named, time.

Both are judged on the speeds alone, which are all that SINDy's states can tell: root mean square error in free
simulation of the last 30 %, in times the noise, of the worst sensor. ``right`` is kind and place.
"""

import json
import time
from pathlib import Path

from matching.diagnosis.diagnose import diagnose
from modelling.model_file import load
from modelling.recordings.read import read_recording
from tests.benchmarks.row import peer_runs

PRACTICE = Path(__file__).parents[3] / "shared" / "practice"
HEAD = (
    f"{'hidden':34} {'ours':>8} {'SINDy':>8} {'1 step':>7} {'ours':>6} {'SINDy':>6} {'ours':>6} {'SINDy':>6}"
    "  SINDy names\n"
    f"{'':34} {'times the noise':>25} {'right':>13} {'s':>13}"
)


def main() -> None:
    if not PRACTICE.exists():
        print("diagnosis against PySINDy: skipped, ../shared/practice is not here")
        return
    try:
        import pysindy  # noqa: F401

        from tests.benchmarks._sindy import run
    except ImportError:
        print("diagnosis against PySINDy: skipped, pysindy is not installed")
        return
    answers = json.loads((PRACTICE / "answers.json").read_text())
    print(HEAD)
    right = [0, 0]
    for case, answer in answers.items():
        system = load(PRACTICE / case / "model.toml")
        recording = read_recording(PRACTICE / case / "recording.csv", system)
        began = time.perf_counter()
        found = diagnose(system, [recording])
        between = time.perf_counter()
        peer = None
        with peer_runs(f"{answer['kind']} {answer['at']}"):
            peer = run(system, recording)
        if peer is None:
            continue
        after = time.perf_counter()
        speeds = [sensor.name for sensor in system.sensors if sensor.measures == "speed"]
        error = max((found.errors[name]["after_holdout"] or 0) / (found.errors[name]["noise"] or 1) for name in speeds)
        named = (found.causes[0].kind, found.causes[0].at) if found.causes else ("none", "")
        places = [answer["at"], *answer.get("equivalent", [])]
        good = [kind == answer["kind"] and at in places for kind, at in (named, (peer.kind, peer.at))]
        right = [total + one for total, one in zip(right, good, strict=True)]
        marks = ["yes" if one else "no" for one in good]
        print(
            f"{answer['kind'] + ' ' + answer['at']:34} {error:8.3g} {peer.free:8.3g} {peer.one_step:7.3g} "
            f"{marks[0]:>6} {marks[1]:>6} {between - began:6.1f} {after - between:6.1f}  "
            f"{peer.kind} {peer.at}, {peer.terms} terms",
            flush=True,
        )
    print(f"{'named right of ' + str(len(answers)):34} {'':25} {right[0]:6d} {right[1]:6d}")


if __name__ == "__main__":
    main()
