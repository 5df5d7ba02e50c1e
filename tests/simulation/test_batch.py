"""Batches, uneven time, caching."""

import numpy as np
import pytest
from needs import compiles
from processes import started

from modelling.equations.casadi_code import compiled
from modelling.simulation.simulate import sensitivities, simulate, simulate_batch
from tests.simulation.drives import excitation, system_with


def test_a_batch_is_its_rows(path):
    model = compiled(system_with("dead_time", "sensor_delay"))
    time, inputs = excitation(0.3)
    p = model.p0 * np.random.default_rng(3).uniform(0.8, 1.2, (5, len(model.p0)))
    got = simulate_batch(model, time, inputs, p, steps_per_second=4000.0, compile=path)
    assert got.shape == (5, len(time), 4)
    for row, values in zip(got, p):
        one = simulate(model, time, inputs, dict(zip(model.parameters, values)), steps_per_second=4000.0)
        np.testing.assert_allclose(row, np.stack(list(one.readings.values()), axis=1), atol=1e-9)


def test_uneven_time_gives_the_same_motion(path):
    time = np.sort(np.append(np.arange(0, 1.0001, 0.004), np.random.default_rng(0).uniform(0, 1, 300)))
    even = np.arange(0, 1.0001, 0.004)

    def inputs(at):  # linear between the even samples, so the same signal on both grids
        return {
            "motor_torque": np.interp(at, even, np.sin(20 * even)),
            "brake_torque": np.interp(at, even, np.cos(9 * even)),
        }

    system = system_with("dead_time", "sensor_delay")
    got = simulate(system, time, inputs(time), compile=path, steps_per_second=2000.0)
    expected = simulate(system, even, inputs(even), steps_per_second=2000.0)
    for name, reading in expected.readings.items():
        np.testing.assert_allclose(got[name][np.searchsorted(time, even)], reading, atol=2e-5 * np.ptp(reading))


def test_no_sensitivity_is_asked_for():
    model = compiled(system_with())
    got = sensitivities(model, *excitation(0.1), model.p0, [])
    assert got.jacobian.shape == (101, 4, 0)


def test_without_a_compiler_the_virtual_machine_steps_in(monkeypatch):
    from modelling.simulation import compiled as build

    time, inputs = excitation(0.1)
    expected = simulate(system_with(), time, inputs)
    monkeypatch.setattr(build, "compiler", lambda: None)
    monkeypatch.setattr(build, "_LIBRARIES", {})
    np.testing.assert_allclose(simulate(system_with(), time, inputs).states, expected.states, atol=1e-10)


def test_a_compiler_that_fails_is_no_fault(monkeypatch, tmp_path):
    from modelling.simulation import compiled as build

    time, inputs = excitation(0.1)
    expected = simulate(system_with(), time, inputs)
    monkeypatch.setattr(build, "compiler", lambda: "/bin/false")
    monkeypatch.setattr(build, "folder", lambda: tmp_path)
    monkeypatch.setattr(build, "_LIBRARIES", {})
    build.works.cache_clear()
    with pytest.warns(build.CompilerWarning, match="/bin/false does not work"):
        np.testing.assert_allclose(simulate(system_with(), time, inputs).states, expected.states, atol=1e-10)
    assert not list(tmp_path.iterdir())


RACE = """
import numpy as np
from modelling.simulation.simulate import simulate
from tests.simulation.drives import excitation, system_with
print(repr(simulate(system_with("hardening", "lag"), *excitation(0.05))["link_torque"][-1]))
"""


@compiles
def test_processes_may_race_for_the_cache(tmp_path):
    import os
    import subprocess
    import sys

    environment = os.environ | {"RIGMATCH_CACHE": str(tmp_path), "PYTHONPATH": os.pathsep.join(sys.path)}
    words, options = [sys.executable, "-c", RACE], {"env": environment, "stdout": subprocess.PIPE}
    with started(words, **options) as one, started(words, **options) as other:
        said = [command.communicate(timeout=200)[0] for command in (one, other)]
    assert [one.returncode, other.returncode] == [0, 0]
    assert said[0] == said[1] != b""
    assert sorted(path.suffix for path in tmp_path.iterdir()) == [".so", ".so"]  # driver and model, nothing half made
