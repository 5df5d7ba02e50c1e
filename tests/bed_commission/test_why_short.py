"""Why a bed falls short: what is diagnosed, what is said where it cannot be."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from small_bed import write

from matching.bed import commission as module
from matching.bed import identify
from matching.bed.simulated_bed import bed_system, names_in_system
from matching.diagnosis.statistics import Estimate
from matching.match.case_file import load_case
from matching.report.bed import why

ERROR = SimpleNamespace(name="measured", value=0.1312, uncertainty=0.004, predicted=0.02, allowed=0.1, status="short")
MODE = SimpleNamespace(
    number=2,
    vehicle=(1.6, 0.085),
    status="short",
    measured=SimpleNamespace(
        frequency=1.61, frequency_uncertainty=0.004, damping_ratio=0.095, damping_uncertainty=0.002
    ),
)
SHORT = SimpleNamespace(status="short", errors=(ERROR,), modes=(MODE,))
COMMANDED = "time [s],dyno,motor_torque,motor_speed,side_torque,flange_torque,rotor_speed"


@pytest.fixture(scope="module")
def case(tmp_path_factory):
    return load_case(write(tmp_path_factory.mktemp("case")))


def recording(folder, columns):
    rows = [",".join(f"{value:.4f}" for value in (0.001 * i, *np.sin(i * np.arange(1, columns.count(",") + 1))))
            for i in range(50)]  # fmt: skip
    path = folder / "recording.csv"
    path.write_text("\n".join([columns, *rows]), encoding="utf-8")
    return path


def test_only_what_falls_short_is_diagnosed(case, tmp_path):
    assert module.why_short(case, SimpleNamespace(status="as_predicted"), [tmp_path / "none.csv"]) is None


def test_a_recording_without_commands_says_what_is_missing(case, tmp_path):
    path = recording(tmp_path, COMMANDED.replace("dyno,", ""))
    found = module.why_short(case, SHORT, [path])
    assert found.verdict == ""
    assert found.sentences[0] == (
        "the response error to measured torques is 0.1312 ± 0.0080, where 0.02 was predicted and 0.1 is allowed"
    )
    assert found.sentences[1] == "vehicle mode 2: 1.6100 ± 0.0080 Hz for 1.6 Hz, damping 0.0950 ± 0.0040 for 0.085"
    assert "does not hold dyno" in found.sentences[2]


@pytest.mark.parametrize(("gain", "inertia", "said"), [
    (1.09, 0.5, "dyno gives 1.0900 ± 0.0022 times what it is asked for, not 1"),
    (1.0, 0.56, "rig.inertias.motor.J is 0.5600 ± 0.0011 instead of 0.5"),
    (1.001, 0.5004, "nothing that is off"),
])  # fmt: skip
@pytest.mark.parametrize("note", ["", "at the end of its range"])
def test_what_is_off_beyond_its_uncertainty_is_named(gain, inertia, said, note, case, tmp_path, monkeypatch):
    """A value at the end of its range is none that was found."""
    names, said = names_in_system(case), "nothing that is off" if note else said
    values = {"dynamometers.dyno.torque_gain": gain, "rig.inertias.motor.J": inertia}
    diagnosis = SimpleNamespace(
        parameters={names[name]: Estimate(value, 1e-4, note) for name, value in values.items()},
        extended=bed_system(case), verdict="adequate", to_dict=lambda: {"causes": []},
    )  # fmt: skip
    monkeypatch.setattr(identify, "diagnose", lambda *_: diagnosis)
    found = module.why_short(case, SHORT, [recording(tmp_path, COMMANDED)])
    assert len(found.sentences) == 3
    assert said in found.sentences[2]
    assert why({"diagnosis": found.to_dict()}) == list(found.sentences)


def test_a_cause_is_told_with_its_evidence(case, tmp_path, monkeypatch):
    said = "the torque stays at zero over 0.02 rad"
    cause = {"kind": "backlash", "at": "shafts.side", "evidence": said, "in_model": True}
    diagnosis = SimpleNamespace(
        parameters={}, extended=bed_system(case), verdict="explained", to_dict=lambda: {"causes": [cause]}
    )
    monkeypatch.setattr(identify, "diagnose", lambda *_: diagnosis)
    found = module.why_short(replace(case), SHORT, [recording(tmp_path, COMMANDED)])
    assert found.sentences[2:] == ("backlash at shafts.side: the torque stays at zero over 0.02 rad",)
    assert found.verdict == "explained"
