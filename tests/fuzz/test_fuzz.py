"""A short form of the fuzzer, the inputs it found, and that it finds what is planted."""

import pytest

from modelling.errors import InputError
from tests.fuzz import targets
from tests.fuzz.corpus import seeds
from tests.fuzz.inputs import fuzz_input
from tests.fuzz.seed import FOUND, Seed
from tests.fuzz.targets import TARGETS, failure

SHORT_RUN, SHORT_COUNT, PARTS = 0, 1000, 2
QUICK = tuple(kind for kind in TARGETS if kind not in ("words", "binary"))  # these take processes


@pytest.mark.parametrize("seed", seeds(), ids=lambda seed: f"{seed.target}-{seed.name}")
def test_seeds_are_answered(seed, tmp_path):
    path = tmp_path / f"input{TARGETS[seed.target].suffix}"
    path.write_bytes(seed.content)
    for name, content in seed.beside.items():
        (tmp_path / name).write_bytes(content)
    TARGETS[seed.target].run(path, False)


@pytest.mark.parametrize("part", range(PARTS))
def test_changed_inputs_are_answered_or_refused_in_one_line(part, tmp_path):
    """1000 inputs, read and checked but not calculated; ``make fuzz`` does both with 100 000."""
    failed = {}
    for number in range(part, SHORT_COUNT, PARTS):
        changed = fuzz_input(SHORT_RUN, number, QUICK)
        folder = tmp_path / changed.seed.target / changed.seed.name
        folder.mkdir(parents=True, exist_ok=True)
        if what := failure(changed.seed, changed.content, folder, deep=False):
            failed[number] = what
    assert not failed


@pytest.mark.parametrize("path", sorted(FOUND.glob("*-*")), ids=lambda path: path.stem)
def test_inputs_that_once_failed(path, tmp_path):
    kind, name = path.stem.rsplit("-", 1)[0].split("-", 1)
    beside = next(seed.beside for seed in seeds() if (seed.target, seed.name) == (kind, name))
    assert failure(Seed(kind, name, b"", beside), path.read_bytes(), tmp_path, deep=True) == ""


@pytest.mark.parametrize("fault", [KeyError("planted"), targets.TooLong(), InputError("x", "y" * 500, "z" * 2000)])
def test_planted_faults_are_found(fault, tmp_path, monkeypatch):
    def planted(path):
        raise fault

    monkeypatch.setattr(targets, "load_case", planted)
    seed = next(seed for seed in seeds() if seed.target == "case")
    what = failure(seed, seed.content, tmp_path, deep=False)
    assert what.startswith(
        "KeyError at " if isinstance(fault, KeyError) else ("TooLong", "")[isinstance(fault, InputError)]
    )
    assert bool(what) is not isinstance(fault, InputError)  # its parts are cut, so the line stays short
