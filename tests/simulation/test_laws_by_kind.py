"""Every kind of effect against its documented law, executable and hard, in :mod:`tests.simulation.laws`."""

import numpy as np
import pytest

from modelling.effects import EFFECTS
from modelling.model_file import from_dict
from modelling.simulation.simulate import simulate
from tests.simulation import laws

NAMES = (*laws.KINDS, *laws.ELSEWHERE)
SEED = 6120
TRUE_ERROR = 0.01  # of the range of a reading
# Of the range, beside what is stated, as the documents say: a filter far above drivetrains drives an imposed inertia,
# and what dry friction holds creeps.
BESIDE = {"imposed_motion": 2e-3} | dict.fromkeys((*laws.FRICTION, "load_friction"), 3e-4)


def compared(name, count, seed=SEED, pieces=20):
    """True errors, what is stated, and the laws' own error by halving their steps, over the range; (b, sensors)."""
    of = laws.drawn(name, count, seed)
    coarse, fine = laws.readings(of, pieces // 2), laws.readings(of, pieces)
    true, stated, own = [], [], []
    for number in range(count):
        torques = {"u": of.u[:, number], "v": of.v[:, number]}
        done = simulate(from_dict(of.model(number)), of.time, torques, start="rest")
        ranges = {key: np.ptp(value[:, number]) for key, value in fine.items()}
        keys = [key for key in fine if ranges[key] > 1e-9]
        true.append([np.abs(done[key] - fine[key][:, number]).max() / ranges[key] for key in keys])
        own.append([np.abs(coarse[key][:, number] - fine[key][:, number]).max() / ranges[key] for key in keys])
        stated.append([done.integration_error[key] for key in keys])
    return np.array(true), np.array(stated), np.array(own)


def test_every_kind_has_its_law():
    assert set(laws.KINDS) == set(EFFECTS)


@pytest.mark.parametrize("name", ["sensor_delay", "tyre_slip", "stribeck_friction", "rate_limit", "backlash"])
def test_it_moves_as_its_law_says(name):
    true, stated, own = compared(name, 2, pieces=10)
    assert true.max() < TRUE_ERROR
    assert (true <= stated + 2 * own + BESIDE.get(name, 1e-5)).all()


@pytest.mark.long
@pytest.mark.parametrize("name", NAMES)
def test_drawn_chains_move_as_the_law_says(name):
    """Ten chains; the stated error, and that of the law's own steps, bound the true one in 95 of 100."""
    true, stated, own = compared(name, 10)
    ratio = np.median(true / np.maximum(stated, 1e-12))
    print(f"| {name} | {np.median(true):.1e} | {true.max():.1e} | {stated.max():.1e} | {ratio:.2g} | {own.max():.0e} |")
    assert true.max() < TRUE_ERROR
    assert np.mean((true <= stated + 2 * own + BESIDE.get(name, 1e-5)).all(axis=1)) >= 0.9
