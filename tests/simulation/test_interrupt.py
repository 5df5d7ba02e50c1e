"""Ctrl-C ends a long simulation within a second."""

import os
import signal
import subprocess
import sys
import time

from needs import compiles

LONG = """
import signal
signal.signal(signal.SIGINT, signal.default_int_handler)  # whoever started the tests may ignore it
import numpy as np
from modelling.simulation.simulate import simulate
from tests.simulation.drives import excitation, system_with
simulate(system_with(), *excitation(0.05), steps_per_second=1e4)
print("begun", flush=True)
simulate(system_with(), *excitation(200.0), steps_per_second=1e7)
"""


@compiles
def test_an_interrupt_ends_a_native_run():
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)}
    with subprocess.Popen(
        [sys.executable, "-c", LONG], env=environment, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as running:
        assert running.stdout is not None
        assert running.stdout.readline() == "begun\n"
        time.sleep(1.0)
        assert running.poll() is None  # well inside the run, which takes minutes
        running.send_signal(signal.SIGINT)
        _, said = running.communicate(timeout=20)
    assert "KeyboardInterrupt" in said
