"""A short form of the fuzzer, the inputs it found, and that it finds what is planted."""

import base64
import itertools
import tomllib

import pytest

from modelling.errors import InputError
from modelling.model_file import from_dict
from tests.fuzz import targets
from tests.fuzz.corpus import seeds
from tests.fuzz.inputs import fuzz_input
from tests.fuzz.minimise import minimised
from tests.fuzz.mutate import mutated
from tests.fuzz.runs import RUNS, check_html
from tests.fuzz.seed import FOUND, MODEL, Seed
from tests.fuzz.targets import TARGETS, failure

SHORT_RUN, SHORT_COUNT, PARTS = 0, 2500, 5
COSTLY = ("words", "binary", *RUNS)  # they take processes, or calculate
QUICK = (*(kind for kind in TARGETS if kind not in COSTLY), "drive", "trace", "loggers", "by_hand", "record")


@pytest.mark.parametrize("seed", seeds(), ids=lambda seed: f"{seed.target}-{seed.name}")
def test_seeds_are_answered(seed, tmp_path):
    path = tmp_path / f"input{TARGETS[seed.target].suffix}"
    path.write_bytes(seed.content)
    for name, content in seed.beside.items():
        (tmp_path / name).write_bytes(content)
    TARGETS[seed.target].run(path, False)


@pytest.mark.parametrize("part", range(PARTS))
def test_changed_inputs_are_answered_or_refused_in_one_line(part, tmp_path):
    """2500 inputs, read and checked but not calculated; ``make fuzz`` does both with 100 000."""
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


def test_the_same_number_gives_the_same_input_and_another_one_another():
    again = [fuzz_input(3, number).content for number in range(30)]
    assert again == [fuzz_input(3, number).content for number in range(30)]
    assert len(set(again)) > 25
    assert again != [fuzz_input(4, number).content for number in range(30)]


def test_every_kind_of_file_and_every_way_to_change_it_is_drawn():
    drawn = {fuzz_input(1, number).seed.target for number in range(5000)}
    assert drawn == set(TARGETS)
    assert len({mutated(f"{n}", b'[a]\nx = 1.5\ny = "2 m"\n', [b"b\nc"]) for n in range(200)}) > 150


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


def test_a_picture_is_allowed_once_and_only_as_the_program_draws_it():
    model = from_dict(tomllib.loads(MODEL))
    page = model._repr_html_()
    check_html(page, ["two discs"])
    drawing = page[page.index("<img") : page.index("</p>")]
    script = base64.b64encode(b"<svg xmlns='http://www.w3.org/2000/svg'><script/></svg>").decode()
    for planted in (
        "<img src=x>",
        "<img alt='a' src='x.svg' style='max-width:100%'>",
        drawing,
        drawing.replace("<img ", "<img onload='a()' "),
        f"<img alt='a' src='data:image/svg+xml;base64,{script}' style='max-width:100%'>",
    ):
        with pytest.raises(AssertionError, match="<img>"):
            check_html(page + planted, ["two discs"])
    with pytest.raises(AssertionError, match="0 <img>"):
        check_html(page.replace(drawing, ""), ["two discs"])


def test_a_failing_input_is_made_small():
    content = b"\n".join(b"line %d" % n for n in range(60))
    tries = itertools.count()

    def fails(part):
        next(tries)
        return b"17" in part and b"4" in part

    small = minimised(content, fails)
    assert fails(small)
    assert len(small) <= 4
    assert next(tries) < 420
