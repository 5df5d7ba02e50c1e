"""The verdict on free play over 20 s, on drawn beds of several kinds, against an integrator of its own.

Nothing is matched: weights where a search begins swing on in some beds and come to rest in others, and both are asked.
"""

import numpy as np
import pytest
from match_beds import free_play as independent
from match_beds.other_beds import (
    front_axle,
    geared_rotor,
    light_vehicle,
    one_flange,
    stiff_half_shafts,
    two_axles,
    write_models,
)
from plant.marks import needs_compiler

from matching.match.case_file import load_case
from matching.match.exported import exported_controller
from matching.match.free_play import FreePlay, played, slowest_period, swing
from modelling.running.controllers import unsupervised

KINDS = (front_axle, stiff_half_shafts, light_vehicle, geared_rotor, two_axles, one_flange)
SECONDS, SEED = 20.0, 8300
RANGE_SHARE, EVEN = 0.02, 0.8  # of the range of the vehicle's signal; a swing at the end over that of 6 s before
SETTINGS = FreePlay(drawn=5, as_planned=2)


def drawn_case(number, folder):
    """A bed with its shuffle between 1 and 10 Hz: softer half shafts and heavier bodies than the kind has."""
    random = np.random.default_rng(SEED + number)
    vehicle, rig, case = KINDS[number % len(KINDS)]()[:3]
    soft, heavy = 10 ** random.uniform(-1.7, 0.0), random.uniform(1.0, 2.0)
    for model in (vehicle, rig):
        for name, part in model["shafts"].items():
            if name.startswith("half"):
                part["stiffness"], part["damping"] = soft * part["stiffness"], np.sqrt(soft) * part["damping"]
    vehicle["inertias"]["body"]["J"] *= heavy
    case["loop"]["dead_time"] = float(random.uniform(0.002, 0.008))
    case["response"]["band"] = [0.2, 30]
    return load_case(write_models(vehicle, rig, case, folder, random))


def swings_on(case, law, rows, gaps, torques, period):
    """Which rows swing on after 20 s where their vehicles do not (b,), bool: whole periods, no trend."""
    vehicle, _ = independent.vehicles(case, rows, gaps, torques, speeds=True)
    bed, lost = independent.beds(case, law, rows, gaps, torques, speeds=True)
    step = law.sample_time
    window, back = round(max(3.0, 3 * period) / step), round(6.0 / step)
    last, before = slice(-window, None), slice(-window - back, -back)
    on, sensors = [], {sensor.name: sensor.uncertainty for sensor in case.rig.sensors}
    dynos = case.loop.dynamometers
    unseen = [sensors.get(one.torque_sensor, 0.0) for one in dynos] + [sensors[one.speed_sensor] for one in dynos]
    for b in range(len(rows)):
        more = np.maximum(RANGE_SHARE * np.ptp(vehicle[:, b], axis=0), np.sqrt(2) * np.array(unseen))
        allowed = swing(vehicle[last, b]) + more
        end, earlier = swing(bed[last, b]), swing(bed[before, b])
        above = end > allowed
        on.append(bool(lost[b]) or bool((above & (end > EVEN * earlier)).any()))
    return np.array(on)


def compared(number, folder):
    """Verdict of the program and rows of the independent bed, on the same drawn beds and gaps."""
    case = drawn_case(number, folder)
    controller = unsupervised(exported_controller(case))
    found = played(case, controller, number, SETTINGS)
    random_gaps = np.random.default_rng(number).uniform(*SETTINGS.gaps, SETTINGS.drawn)
    rows = [case.uncertainty.at(at) for at in case.uncertainty.draw(SETTINGS.drawn, number + 1)]
    rows += [{}] * SETTINGS.as_planned
    gaps = np.r_[random_gaps, np.geomspace(*SETTINGS.gaps, SETTINGS.as_planned)]
    drive = max(case.manoeuvre, key=lambda name: case.manoeuvre[name].largest)
    torques = independent.pulse(case, drive, case.manoeuvre[drive].largest, SECONDS)
    on = swings_on(case, controller.law, rows, gaps, torques, slowest_period(case).seconds)
    return case, found, on


@pytest.mark.long
@needs_compiler
@pytest.mark.parametrize("number", range(20))
def test_the_verdict_on_play_is_that_of_an_integrator_of_its_own(number, tmp_path):
    case, found, on = compared(number, tmp_path)
    assert found.limits == on.any(), f"{1 / slowest_period(case).seconds:.3g} Hz: {found}, {on}"
