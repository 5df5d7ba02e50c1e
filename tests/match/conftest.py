"""Matches of the examples, each made once a session, whatever the number of test workers."""

import importlib.util
import pickle
import time
from dataclasses import replace
from pathlib import Path

import pytest

from matching.match.case_file import load_case
from matching.match.in_time import InTime
from matching.match.match import match
from matching.match.variables import SearchSettings

NOT_ASKED = InTime(not_simulated="left out here, tested in tests/match_beds/test_in_time.py")
LITTLE = SearchSettings(
    drawn=4,
    pool=8,
    rounds=1,
    steps=6,
    joint_rounds=1,
    restarts=0,
    emulated=0.0,
    scenarios=0,
    blind=0,
    starts=1,
    fresh=20,
)
EXAMPLES = Path(__file__).parents[2] / "examples"


def script(name):
    """``run.py`` of an example as a module."""
    path = EXAMPLES / name / "run.py"
    spec = importlib.util.spec_from_file_location(f"example_{name}", path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="session")
def once(tmp_path_factory):
    """Make a result once: the first worker that asks makes it, the others wait for its file."""
    own = tmp_path_factory.getbasetemp()
    folder = own.parent if own.name.startswith("popen-") else own

    def make(name, function):
        path, claimed = folder / f"{name}.pickle", folder / f"{name}.claimed"
        try:
            claimed.mkdir()
        except FileExistsError:
            failed = folder / f"{name}.failed"
            while not path.exists():
                assert not failed.exists(), f"{name} failed in another worker"
                time.sleep(0.2)
            return pickle.loads(path.read_bytes())
        try:
            result = function()
        except BaseException:
            (folder / f"{name}.failed").touch()
            raise
        partly = path.with_suffix(".part")
        partly.write_bytes(pickle.dumps(result))
        partly.rename(path)
        return result

    return make


@pytest.fixture(scope="session")
def reference(once):
    """The reference, matched with little effort: `make test-long` runs the example as it is."""

    def quick():
        return match(load_case(EXAMPLES / "road_to_rig" / "case.toml"), settings=LITTLE)

    return replace(once("reference", quick), simulated_in_time=NOT_ASKED)


@pytest.fixture(scope="session")
def adapters(once):
    """Adapters alone, with little effort."""
    return once("adapters", lambda: match(load_case(EXAMPLES / "adapter_only" / "case.toml"), settings=LITTLE))


@pytest.fixture(scope="session")
def compact(once):
    """compact_bev from one start with its flanges as planned: `make test-long` runs the example as it is."""

    def quick():
        case = load_case(EXAMPLES / "compact_bev" / "case.toml")
        planned = tuple(move for move in case.moves if not move.name.startswith("rig."))
        return match(replace(case, moves=planned), settings=LITTLE)

    return replace(once("compact", quick), simulated_in_time=NOT_ASKED)
