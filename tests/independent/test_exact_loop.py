"""The exact loop of the product against dynamic stiffness: poles, responses, margin, roll-off, noise, on any bed."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from independent.dynamic_stiffness import Judge as Independent
from independent.dynamic_stiffness import check_loop, in_balance
from match_beds.drawn_cases import draw

from matching.match.beds import Judge, loop_figures, noise_of_sensors, planned
from matching.match.case_file import load_case
from matching.match.damping import damping_ratios
from matching.match.loop import LinearBed, control_law, controller_on, linear_bed
from matching.match.loop_modes import neutral_motions
from matching.match.requirements import requirements
from modelling.bed.controllers import STRUCTURES

EXAMPLES = Path(__file__).parents[2] / "examples"
BEDS = 3  # variants of each bed, beside the bed as planned


def assert_alike(case, bed: LinearBed, seed: int) -> None:
    """Least damping, stability and response errors of some beds; margin, roll-off and noise of the bed as planned."""
    controller, law, required = controller_on(bed), control_law(bed), requirements(case)
    own = Judge(case, controller, neutral_motions(bed), required)
    other = Independent(case, law, required=(required.damping_ratio, required.rolled_off_from))
    positions = case.uncertainty.draw(BEDS, seed)
    values = [{}, *(case.uncertainty.at(position) for position in positions)]
    found, own_poles = own.verdicts(values), np.linalg.eigvals(controller.own_matrix)
    alone = damping_ratios(own_poles[None], law.sample_time).min(initial=1.0)  # judged once, not on every bed
    for i, of_bed in enumerate(values):
        wanted = other.verdict(of_bed)
        assert found.stable[i] == (wanted.stable and bool((np.abs(own_poles) < 1).all()))
        if found.stable[i]:
            least = min(wanted.damping_ratio, alone)
            assert min(found.damping_ratio[i], alone) == pytest.approx(least, rel=1e-6, abs=1e-9)
        else:
            assert found.damping_ratio[i] < 0
        if found.stable[i]:  # an error is a difference of responses of size 1, which both have to some 1e-10
            assert found.measured[i] == pytest.approx(wanted.measured, rel=1e-6, abs=1e-9)
            assert found.unmeasured[i] == pytest.approx(wanted.unmeasured, rel=1e-6, abs=1e-9)
    noise = noise_of_sensors(case, controller.sensors)
    figures = loop_figures(planned(case, noise), controller, required)
    judged = check_loop(case, law, noise[: len(law.sensors)], required.margin_from, required.rolled_off_from)
    difference = Independent(case, law, np.array([figures.margin_at])).planned()[0][0]
    difference = in_balance(difference, case, law, noise[: len(law.sensors)])
    assert figures.modulus_margin == pytest.approx(np.linalg.svd(difference, compute_uv=False)[-1], rel=1e-6)
    assert figures.modulus_margin <= judged.modulus_margin * (1 + 1e-6)  # of a grid
    assert figures.largest_rolled_off == pytest.approx(judged.largest_rolled_off, rel=1e-6, abs=1e-9)
    for name, value in zip(law.dynamometers, judged.command_noise, strict=True):
        assert figures.command_noise[name] == pytest.approx(value, rel=5e-3, abs=1e-9)


def in_structure(case, name: str):
    """The case with another control structure at its start values."""
    structure = STRUCTURES[name]
    values = {**case.loop.values, **{key: quantity.start for key, quantity in structure.quantities.items()}}
    return read_alike(replace(case, loop=replace(case.loop, structure=structure, values=values)))


def read_alike(case):
    """Without the sensors that a feedback law makes nothing of: the independent law has no rows for them."""
    return case if case.loop.structure.is_observer else replace(case, loop=replace(case.loop, further_sensors=()))


@pytest.mark.parametrize("structure", ["pi", "model_based", "observer"])
@pytest.mark.parametrize("example", ["road_to_rig/case.toml", "road_to_rig/observer.toml", "compact_bev/case.toml"])
def test_reference_and_examples(example, structure):
    case = in_structure(load_case(EXAMPLES / example), structure)
    assert_alike(case, linear_bed(case), seed=1)


def test_without_control():
    case = load_case(EXAMPLES / "adapter_only" / "case.toml")
    assert_alike(case, linear_bed(case), seed=2)


@pytest.mark.parametrize("seed", range(30))
def test_drives_drawn_at_random(seed, tmp_path):
    """One to four dynamometers, chains, axles and independent motors, 0.5 to 20 ms, every structure."""
    case = read_alike(load_case(draw(seed, tmp_path)))
    assert_alike(case, linear_bed(case), seed)
