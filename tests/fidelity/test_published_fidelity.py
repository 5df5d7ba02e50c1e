"""Tab. 2 in, Tab. 3 out: by the published arithmetic to its last digit, and by the definition."""

from pathlib import Path

import numpy as np
import pytest

from matching.fidelity import attribute, read_case
from modelling.errors import InputError
from modelling.fidelity.measures import (
    FidelityMethod,
    chi,
    delay_fidelity,
    dynamics_fidelity,
    measurement_fidelity,
    nrmse_fidelity_of,
    representativeness,
    total_fidelity,
)

TAB2 = Path(__file__).parents[2] / "examples" / "fidelity" / "tab2.toml"


@pytest.mark.parametrize(
    ("arithmetic", "expected"),
    [("published", ("61.01", "77.65", "99.76", "76.75")), ("definition", ("74.72", "95.10", "99.70", "88.54"))],
)
def test_tab3(arithmetic, expected):
    _, fidelity = read_case(TAB2, arithmetic)
    assert tuple(f"{100 * part:.2f}" for part in (*fidelity.domains.values(), fidelity.total)) == expected


def test_the_definition_is_the_default():
    assert f"{100 * read_case(TAB2)[1].total:.2f}" == "88.54"


def test_ideal_rig_scores_one_by_the_definition_and_not_by_the_published_arithmetic():
    ideal = dynamics_fidelity([1, 1], [1, 1])
    assert ideal == 1
    assert total_fidelity({"a": ideal, "b": 1.0}, {"a": 0.4, "b": 0.6}) == 1
    assert dynamics_fidelity([1, 1], [1, 1], "published") == pytest.approx(0.8165, abs=5e-5)


def test_published_arithmetic_is_refused_for_other_shapes():
    with pytest.raises(InputError, match="divides by 6"):
        dynamics_fidelity([1, 1, 1], [1, 1, 1], "published")
    with pytest.raises(InputError, match="divides by 6"):
        measurement_fidelity([0.1, 0.1], "published")


@pytest.mark.parametrize(("key", "given"), [("arithmetic", {"arithmetic": "new"}), ("nrmse", {"nrmse_form": "new"})])
def test_a_form_that_does_not_exist_is_refused_by_the_key_of_the_file(key, given):
    with pytest.raises(InputError, match=f"^{key}: 'new' is not known"):
        FidelityMethod(30.0, **given)


def test_fig6_anchor_points():
    assert chi(30.0) == pytest.approx(180.0**3)
    assert delay_fidelity(1 / 180, 30.0) == pytest.approx(0.5)
    assert delay_fidelity(0.0, 30.0) == 1
    assert delay_fidelity(-0.005, 30.0) == delay_fidelity(0.005, 30.0) == pytest.approx(0.5990, abs=5e-5)


def test_literal_eq18_depends_on_the_unit_and_the_definition_does_not():
    reference, test = np.array([0.0, 1.0, 2.0, 3.0]), np.array([0.1, 1.2, 1.9, 3.0])
    mean_square = float(np.mean((reference - test) ** 2))  # 0.015 over a range of 3
    assert nrmse_fidelity_of(mean_square, 3.0) == pytest.approx(1 - np.sqrt(0.015) / 3)
    assert nrmse_fidelity_of(1e6 * mean_square, 3000.0) == pytest.approx(1 - np.sqrt(0.015) / 3)
    assert nrmse_fidelity_of(mean_square, 3.0, "literal") == pytest.approx(1 - np.sqrt(0.015 / 3))
    assert nrmse_fidelity_of(1e2 * mean_square, 30.0, "literal") == pytest.approx(1 - np.sqrt(0.15 / 3))


def test_dos_santos():
    assert representativeness([10, 30], [1.0, 0.5], [0.9, 0.8]) == pytest.approx(0.25 * 0.9 + 0.75 * 0.4)
    assert representativeness([10, 30], [1, 1], [1, 1], total_time=80) == pytest.approx(0.5)
    with pytest.raises(InputError, match="as many"):
        representativeness([10], [1, 1], [1])


def test_attribution_sums_to_the_loss_and_each_gain_is_what_repair_gives():
    _, fidelity = read_case(TAB2)
    attribution = attribute(fidelity)
    losses = attribution.losses
    assert sum(loss.loss for loss in losses) == pytest.approx(1 - fidelity.total**2, rel=1e-12)
    assert sum(attribution.by_origin.values()) == pytest.approx(1)
    assert (losses[0].signal, losses[0].cause) == ("speed", "delay")
    torque, speed = fidelity.signals["system_dynamics"]
    dynamics = dynamics_fidelity([torque.nrmse, speed.nrmse], [torque.delay_fidelity, 1.0])
    repaired = total_fidelity(fidelity.domains | {"system_dynamics": dynamics}, fidelity.weights)
    assert repaired - fidelity.total == pytest.approx(losses[0].gain, rel=1e-12)
