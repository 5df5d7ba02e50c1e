"""A batch shared out among threads is the same batch."""

import numpy as np

from modelling.equations.casadi_code import Model, compiled
from modelling.model_file import from_dict
from modelling.simulation import compiled as native
from modelling.simulation.task import Trajectories, make_task


def drive(*effects: dict) -> Model:
    """Two masses with effects."""
    return compiled(
        from_dict(
            {
                "inertias": {"motor": {"J": 0.1, "drag": 0.02}, "load": {"J": 1.0, "drag": 0.1}},
                "shafts": {"link": {"between": ["motor", "load"], "stiffness": 300, "damping": 0.6}},
                "inputs": {"motor_torque": {"on": "motor"}},
                "sensors": {"link_torque": {"measures": "torque", "of": "link"}},
                "effects": list(effects),
            }
        )
    )


def assert_same(expected: Trajectories | None, got: Trajectories | None) -> None:
    assert expected is not None
    assert got is not None
    for name in ("states", "readings", "failed", "derivatives"):
        np.testing.assert_array_equal(getattr(got, name), getattr(expected, name))


def test_rows_do_not_depend_on_how_many_threads_share_them() -> None:
    model = drive(
        {"kind": "sensor_delay", "at": "sensors.link_torque", "delay": 0.0123},
        {"kind": "dead_time", "at": "inputs.motor_torque", "delay": 0.0045},
    )
    time, batch = np.arange(800) * 1e-3, 5
    p = np.repeat(model.p0[None], batch, axis=0)
    p[:, model.parameters.index("shafts.link.stiffness")] *= np.linspace(0.5, 2.0, batch)
    p[:, model.parameters.index("sensors.link_torque.sensor_delay.delay")] *= np.linspace(0.1, 3.0, batch)
    p[3, model.parameters.index("inertias.motor.J")] = 1e-9  # diverges, which must stay its own affair
    start = np.random.default_rng(0).normal(size=(batch, len(model.states)))
    task = make_task(model, time, 10 * np.sin(20 * time)[:, None], p, start, 2000.0)
    alone = native.run_compiled(task)
    if alone is None:
        return  # no compiler: nothing is shared out
    for threads in (2, 3, 8):
        assert_same(alone, native.run_compiled(task, threads=threads))
    assert (alone.failed[:, 0] >= 0).tolist() == [False, False, False, True, False]
    assert np.ptp(alone.readings[[0, 1, 2, 4], -1, 0]) > 0.1


def test_several_tasks_at_once_are_what_each_is_alone() -> None:
    model = drive({"kind": "backlash", "at": "shafts.link", "gap": 0.02})
    time, random = np.arange(900) * 1e-3, np.random.default_rng(1)
    torque = 30 * np.sin(25 * time)[:, None]
    tasks = []
    for first, last, batch in ((0, 300, 3), (299, 700, 1), (699, 900, 8)):
        p = np.repeat(model.p0[None], batch, axis=0) * random.uniform(0.9, 1.1, (batch, len(model.p0)))
        start = random.normal(size=(batch, len(model.states)))
        tasks.append(make_task(model, time[first:last], torque[first:last], p, start, 4000.0))
    alone = [native.run_compiled(task) for task in tasks]
    for threads in (1, 2, 5):
        together = native.run_all_compiled(tasks, threads=threads)
        if together is None:
            return  # no compiler
        for expected, got in zip(alone, together, strict=True):
            assert_same(expected, got)
