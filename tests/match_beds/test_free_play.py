"""What a match and a map say of free play, judged by beds that share nothing with the program's: see ``free_play``."""

from dataclasses import replace

import numpy as np
import pytest
from match_beds import free_play
from match_beds.other_beds import (
    KINDS,
    geared_rotor,
    light_vehicle,
    one_flange,
    stiff_half_shafts,
    two_axles,
    without_flanges,
    write,
)

from matching.match.case import apply
from matching.match.case_file import load_case
from matching.match.free_play import lash_runs
from matching.match.loop import control_law, linear_bed
from matching.match.map import match_at
from matching.match.match import match
from matching.match.requirements import OPENED_SHAFTS
from modelling.system import Inertia, Quantity, Shaft, System

SEED = 90  # of beds that the rule was not made on
DRAWN, PLANNED, SECONDS = 12, 4, 7.0
LEAST, LARGEST = np.radians(0.5), np.radians(5.0)
RANGE_SHARE = 0.02  # of the range of the vehicle's torque: what swings by less has come to rest
# 0 of the program's 30 beds leaves 1 − 0.05^(1/30) of all beds at 95 %
UNSEEN_SHARE = 1 - 0.05 ** (1 / 30)


def oscillator(k, J, gap):
    """Two free inertias on a shaft with play, without any damping."""
    system = System(
        inertias=tuple(Inertia(name, J=Quantity(J), drag=Quantity(0.0)) for name in ("a", "b")),
        shafts=(Shaft("s", ("a", "b"), stiffness=Quantity(k), damping=Quantity(0.0)),),
    )  # fmt: skip
    return free_play.Rows([free_play.Train(system, {})], [gap], ["s"], [])


def test_the_period_of_an_oscillator_with_play_is_that_of_the_closed_form():
    """2π/ω on the flanks and twice the gap at the largest speed between them; the energy stays."""
    k, J, gap, twist = 1000.0, 0.2, 0.02, 0.05  # twist beyond the flank
    rows, omega = oscillator(k, J, gap), np.sqrt(2 * k / J)
    rows.states[0, :2] = (gap / 2 + twist) / 2 * np.array([1, -1])
    period = 2 * np.pi / omega + 2 * gap / (twist * omega)
    torque = []
    for _ in range(round(20 * period / rows.h)):
        torque.append(rows.carried(rows.states)[0, 0])
        rows.advance(np.zeros((1, 0)))
    torque = np.array(torque)
    middle = k * twist / 2
    rising = np.flatnonzero((torque[:-1] < middle) & (torque[1:] >= middle))
    at = rising + (middle - torque[rising]) / (torque[rising + 1] - torque[rising])
    assert np.diff(at) * rows.h == pytest.approx(period, rel=1e-3)
    assert max(torque[-round(1.2 * period / rows.h) :]) == pytest.approx(k * twist, rel=2e-3)


def swing_on(case, seed):
    """Which of beds drawn from the box, and of the bed as planned, swing on after a pulse (b,), bool."""
    random = np.random.default_rng(seed)
    size = len(case.uncertainty.uncertain)
    rows = [case.uncertainty.at(place) for place in random.uniform(-1, 1, (DRAWN, size))] + [{}] * PLANNED
    gaps = np.concatenate([random.uniform(LEAST, LARGEST, DRAWN), np.geomspace(LEAST, LARGEST, PLANNED)])
    name = max(case.manoeuvre, key=lambda one: case.manoeuvre[one].largest)
    return swinging(case, rows, gaps, free_play.pulse(case, name, case.manoeuvre[name].largest, SECONDS))


def swinging(case, rows, gaps, torques):
    """Which beds with values (dict) and gaps (rad) swing on after torques (b,), bool."""
    law = control_law(linear_bed(case))
    vehicle, _ = free_play.vehicles(case, rows, gaps, torques)
    bed, lost = free_play.beds(case, law, rows, gaps, torques)
    half = round(0.5 / law.sample_time)
    last, before = slice(-half, None), slice(-5 * half, -4 * half)
    rests = np.std(vehicle[last], axis=0).max(axis=1) + RANGE_SHARE * np.ptp(vehicle, axis=0).max(axis=1)
    ends, began = (np.std(bed[part], axis=0).max(axis=1) for part in (last, before))
    return lost | ((ends > rests) & (ends > 0.9 * began))


def says_play(result):
    """Whether free play is among the sentences that limit a match."""
    return any("of free play in the cut shafts" in sentence for sentence in result.limits)


BEDS = {
    "stiff half shafts, 8 ms": (stiff_half_shafts, 0.008), "light vehicle": (light_vehicle, 0.003),
    "geared rotor, 6 ms": (geared_rotor, 0.006), "two axles": (two_axles, 0.003),
    "without flanges": (without_flanges, 0.003), "one flange, 5 ms": (one_flange, 0.005),
}  # fmt: skip


def drawn_case(words, folder, seed=SEED):
    kind, dead_time = BEDS[words]
    return load_case(write(KINDS.index(kind), folder, seed, dead_time=dead_time))


@pytest.mark.long
@pytest.mark.parametrize("words", BEDS)
def test_what_is_said_of_free_play_is_what_independent_beds_do(words, tmp_path):
    """As the case asks, and with the requirement waived, where a search that does not know of it may swing on."""
    case = drawn_case(words, tmp_path)
    asked = match(case, ordering=False)
    swings = swing_on(asked.tuned, SEED)
    if says_play(asked):
        assert swings.any()
    else:
        assert not swings.any(), f"{swings.sum()} of {len(swings)} beds swing on"
    waived = match(replace(case, limits={**case.limits, OPENED_SHAFTS: False}), ordering=False)
    assert not says_play(waived)
    assert waived.lash is not None
    swings, share = swing_on(waived.tuned, SEED), waived.lash.limit_cycles / waived.lash.drawn
    if share == 0:
        assert swings.mean() <= UNSEEN_SHARE
    else:
        assert swings.any()
        assert abs(swings.mean() - share) < 0.4  # two draws of 13 and 16: three standard deviations at a half are 0.55


@pytest.mark.long
def test_the_point_of_a_map_names_free_play_where_an_independent_bed_swings_on(tmp_path):
    """On the drawn beds and gaps that the map judges: of its points with 3 ms one in ten swings on, none of another."""
    named = []
    for words in ("stiff half shafts, 8 ms", "geared rotor, 6 ms"):
        case = drawn_case(words, tmp_path)
        x, y = ("loop.dead_time", 0.003), ("loop.inverter_lag", 0.002)
        point = match_at(case, x, y, 0, 1)
        tuned = apply(case, dict([x, y]) | dict(point.values))
        (drive,) = tuned.manoeuvre
        torques = free_play.pulse(tuned, drive, tuned.manoeuvre[drive].largest, SECONDS)
        runs = lash_runs(tuned, {drive: np.full(1, tuned.manoeuvre[drive].largest)}, (drive,), 0)
        rows, gaps = ([getattr(run.imperfection, key) for run in runs] for key in ("values", "gap"))
        swings = swinging(tuned, rows, gaps, torques)
        assert swings.any() == (OPENED_SHAFTS in point.limited_by)
        named.append(bool(swings.any()))
    assert named == [True, False]
