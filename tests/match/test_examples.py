"""The examples run as scripts do, with their own asserted numbers."""

import pytest
from match.conftest import script


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
