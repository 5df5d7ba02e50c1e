"""The examples run as scripts do, with their own asserted numbers."""

from pathlib import Path

import pytest
from match.conftest import script

from matching.match.case_file import load_case
from matching.match.match import match

EXAMPLES = Path(__file__).parents[2] / "examples"
TESTS = Path(__file__).parents[1]


def test_adapters_alone_end_limited(adapters):
    assert adapters.status == "limited"
    assert not any(target.met for target in adapters.targets)
    torques = [value for name, value in adapters.verification.peaks.items() if name.endswith("left.torque")]
    assert adapters.verification.peaks["dynamometers.left.torque"] == 0
    assert max(torques) > 0
    told = " ".join(adapters.limits)
    assert "(2.6 turns) at 1500 N·m" in told
    assert "109 times the inertia" in told


def test_modes_of_a_torqueless_bed_are_the_rigs_own(adapters):
    """Nothing of the residual vehicle, which nobody feels, stands among them."""
    from modelling.modal.modes import damped_modes

    ours = [mode.frequency for mode in adapters.matched_modes if mode.frequency > 0]
    wanted = [own.frequency for own in damped_modes(adapters.tuned.rig) if own.frequency > 0]
    assert ours == pytest.approx(wanted, rel=1e-6)


def test_compact_car(compact):
    assert compact.status == "matched"
    assert len(compact.case.residual_vehicle.parts) == 1
    assert compact.targets[0].symmetry == "none"
    tuned = {own.name: own.tuned for own in compact.parameters}
    assert tuned["residual_vehicle.inertias.wheel_left.J"] != tuned["residual_vehicle.inertias.wheel_right.J"]


@pytest.mark.long
@pytest.mark.parametrize("name", ["adapter_only", "compact_bev"])
def test_an_example_as_it_is(name):
    """With all starts and what may move free: it asserts its own figures."""
    script(name).main()


@pytest.mark.long
def test_a_controller_that_is_given_ends_limited():
    """The figures of its README, on the bad side alone."""
    result = match(load_case(EXAMPLES / "fixed_controller" / "case.toml"))
    assert result.status == "limited"
    assert result.verification.stable
    assert result.response_error.after < 0.5 < result.response_error.before
    assert not any(quantity.name.startswith("loop.") for quantity in result.parameters)


def test_every_example_is_run_by_a_test():
    """Each folder of examples is named by a test, and each script is run by one."""
    tests = {path: path.read_text(encoding="utf-8") for path in TESTS.rglob("test_*.py")}
    tests |= {path: path.read_text(encoding="utf-8") for path in TESTS.rglob("conftest.py")}
    for folder in sorted(path for path in EXAMPLES.iterdir() if path.is_dir()):
        named = [text for text in tests.values() if folder.name in text and "example" in text.lower()]
        assert named, f"no test names examples/{folder.name}"
        if (folder / "run.py").exists():
            assert any("run.py" in text or "script(" in text for text in named), f"no test runs {folder.name}/run.py"
