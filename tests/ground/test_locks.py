"""The locks pin everything by hash, agree with one another and name no place to download from."""

import re
from pathlib import Path

import pytest

LOCKS = Path(__file__).parents[2] / "locks"


def pins(name):
    text = (LOCKS / f"{name}.txt").read_text().replace("\\\n", " ")
    lines = [line.split(" --hash=sha256:") for line in text.splitlines() if line and not line.startswith("#")]
    return {requirement.strip(): hashes for requirement, *hashes in lines}


@pytest.mark.parametrize("name", ["run", "test", "mutants", "bench"])
def test_every_requirement_is_pinned_by_hash(name):
    assert len(pins(name)) > 20
    for requirement, hashes in pins(name).items():
        assert re.match(r"^[a-z0-9-]+==[0-9][0-9a-z.]*( ; .+)?$", requirement)
        assert hashes
        assert all(re.fullmatch(r"[0-9a-f]{64}", each.strip()) for each in hashes)


@pytest.mark.parametrize("name", ["run", "test", "mutants", "bench"])
def test_no_place_to_download_from(name):
    assert not re.search(r"://|index-url|find-links", (LOCKS / f"{name}.txt").read_text())


@pytest.mark.parametrize("name", ["test", "mutants", "bench"])
def test_locks_agree(name):
    assert pins("run").keys() <= pins(name).keys()
