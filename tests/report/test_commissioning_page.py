"""The page of a commissioning shows the check of the channels, then the match and the modes of each round."""

import pytest

from matching.report.bed import commissioning_report
from matching.report.page import in_terminal

CHANNEL = {"name": "motor_speed", "quantity": "speed", "unit": "rad/s", "gain": 1.01, "gain_uncertainty": 0.005,
           "delay": None, "delay_uncertainty": None, "zero": 0.0, "zero_uncertainty": 0.01, "noise": 0.1,
           "words": None}  # fmt: skip
CHECK = {"sentence": "every channel is right", "channels": [CHANNEL], "unjudged": []}
MATCH = {
    "status": "matched", "limits": [], "structure": "observer", "beds": None,
    "targets": [{"vehicle_mode": 2, "symmetry": "", "vehicle": 3.17, "rig": 9.0, "matched": 3.18, "met": True,
                 "vehicle_damping": 0.04, "matched_damping": 0.04}],
    "response_error": {"before": 2.0, "after": 0.037, "unmeasured_after": 0.05},
}  # fmt: skip
PROOF = {
    "status": "as_predicted", "open": [], "notes": [], "fidelity": [], "duration": 12.0, "planned": None,
    "errors": [{"name": "measured", "error": 0.061, "standard_uncertainty": 0.01, "interval": [0.04, 0.08],
                "predicted": 0.037, "expected": 0.09, "allowed": 0.1, "status": "as_predicted"}],
    "modes": [{"vehicle_mode": 2, "vehicle": {"frequency": 3.17, "damping_ratio": 0.04}, "predicted": None,
               "measured": {"frequency": 3.21, "frequency_uncertainty": 0.01, "damping_ratio": 0.041,
                            "damping_uncertainty": 0.001}, "status": "as_predicted"}],
}  # fmt: skip


def told(status, rounds, channels=CHECK, waiting=None):
    content = {"status": status, "waiting_for": waiting, "end": None, "best_round": None, "vehicle": None,
               "channels": channels, "rounds": rounds, "command": "rigmatch commission", "out": "out"}  # fmt: skip
    return in_terminal(commissioning_report(content))


@pytest.mark.parametrize(
    ("entry", "shown"),
    [
        (None, ["1.010 ± 0.010"]),
        ({"round": 1, "match": MATCH}, ["1.010 ± 0.010", "3.180 Hz", "0.037"]),
        (
            {"round": 1, "match": MATCH, "verification": PROOF},
            ["0.061", "1.010 ± 0.010", "3.180 Hz", "3.21 ± 0.02 Hz"],
        ),
    ],
)
def test_the_page_grows_and_keeps_what_it_had(entry, shown):
    text = told("as_predicted" if entry and "verification" in entry else "waiting", [entry] if entry else [],
                waiting=None if entry and "verification" in entry else "the check")  # fmt: skip
    places = [text.find(part) for part in shown]
    assert -1 not in places
    assert places == sorted(places)


def test_a_round_of_an_older_version_has_no_table_of_its_match():
    text = told("waiting", [{"round": 1, "match": {"status": "as given"}}], waiting="a recording")
    assert "match as given" in text
