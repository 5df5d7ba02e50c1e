"""A new control structure is one class: read, judged, simulated and verified without a change elsewhere."""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
import pytest
from match import drawn
from matching.match.continuous_loop import encirclements

from matching.match.case_file import load_case
from matching.match.loop import linear_bed
from matching.match.match import match
from matching.match.verify import verify
from modelling.bed.bed import ControlStructure, LoopQuantity
from modelling.bed.controllers import STRUCTURES
from modelling.linear.state_space import StateSpace

GAIN = 25.0  # N·m·s/rad


@dataclass(frozen=True)
class Proportional(ControlStructure):
    """command = kp·(reference − speed)."""

    name = "proportional"
    quantities = {"proportional_gain": LoopQuantity("N*m*s/rad", 100.0, 0.0, 1e5, "torque for a speed error")}

    def gives_torque(self, values: Mapping[str, float]) -> bool:
        return values["proportional_gain"] != 0

    def measured_inputs(self, measured, simulated):
        return ()

    def commands(self, values, s, reference, speeds, torques):
        return [values["proportional_gain"] * (wanted - speed) for wanted, speed in zip(reference, speeds, strict=True)]

    def controller(self, loop, residual, rig):
        k, size, gain = len(loop.dynamometers), len(residual.A), loop["proportional_gain"]
        B = np.hstack([residual.B[:, :k], np.zeros((size, k)), residual.B[:, k:]])
        D = -gain * np.eye(k, B.shape[1], k)
        names = tuple(dynamometer.name for dynamometer in loop.dynamometers)
        inputs = (*(f"{name} torque" for name in names), *(f"{name} speed" for name in names), *residual.inputs[k:])
        return StateSpace(residual.A, B, gain * residual.C, D, inputs, names)


@pytest.fixture(scope="module")
def beds(tmp_path_factory):
    """A case with the structure above, and the same with pi whose other gains are 0."""
    path = drawn.draw(1, tmp_path_factory.mktemp("drawn"))
    like = load_case(path)
    assert like.loop.structure.name == "pi"
    zero = {"integral_gain": 0.0, "torque_feed_forward": 0.0, "acceleration_feed_forward": 0.0, "lead_time": 0.0}
    like = replace(like, loop=like.loop.with_values({**zero, "proportional_gain": GAIN}), moves=())
    head, _, moves = path.read_text().partition("[move]")
    moves = "".join(line for line in moves.splitlines(True) if not any(name in line for name in zero))
    path.write_text(head.replace('"pi"', '"proportional"') + "[move]" + moves)
    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(STRUCTURES, "proportional", Proportional())
        case = load_case(path)
    return replace(case, loop=case.loop.with_values({"proportional_gain": GAIN}), moves=()), like


def test_its_loop_is_that_of_a_pi_without_the_other_gains(beds):
    found, like = (encirclements(linear_bed(case)) for case in beds)
    assert (found.unstable, found.resting, found.clear) == (like.unstable, like.resting, True)
    assert found.modulus_margin == pytest.approx(like.modulus_margin, rel=1e-9)


@pytest.mark.parametrize("gain", [0.0, 50.0])
@pytest.mark.parametrize(
    "structure", [one for one in STRUCTURES.values() if not one.is_observer], ids=lambda one: one.name
)
def test_integrators_are_the_poles_of_the_law_at_zero(structure, gain):
    """Where s is halved near 0, a law with r poles there grows 2^r times."""
    values = {name: quantity.start for name, quantity in structure.quantities.items()} | {"integral_gain": gain}
    far, near = (structure.commands(values, s, [1.0], [0.0], [0.0])[0] for s in (2e-9j, 1e-9j))
    assert abs(near / far) == pytest.approx(2.0 ** structure.integrators(values), rel=1e-3)


@pytest.mark.long
def test_its_verification_is_that_of_a_pi_without_the_other_gains(beds):
    found, like = (verify(case) for case in beds)
    assert found.stable == like.stable
    assert found.errors.after == pytest.approx(like.errors.after, rel=1e-9)
    assert [mode.eigenvalue for mode in found.modes] == pytest.approx([mode.eigenvalue for mode in like.modes])
    assert any(
        "proportional" in note for note in found.notes
    )  # its law is not written in matching/frequency/independent


def test_it_is_matched_to_the_end_where_targets_are_missed(beds):
    """A feed-forward beside the same feedback is tried then, which takes the quantities of ``pi``."""
    strict = tuple(replace(target, frequency_tolerance=1e-6, damping_tolerance=1e-6) for target in beds[0].targets)
    result = match(replace(beds[0], targets=strict), starts=1)
    assert result.status == "limited"
    assert all("model_based" not in sentence for sentence in result.limits)
    assert any("does not cover the control structure 'proportional'" in note for note in result.notes)
