"""`rigmatch new`: what it writes, and where not. That its case is matched: tests/report/test_match_command.py."""

import json

import pytest

from matching.cli import main


@pytest.fixture(scope="module")
def case(tmp_path_factory):
    directory = tmp_path_factory.mktemp("new") / "mine"
    assert main(["new", str(directory)]) == 0
    return directory


def test_models_have_modes(case, capsys):
    for name, shuffle in (("vehicle", 7.97), ("rig", 19.89)):
        assert main(["modes", str(case / f"{name}.toml"), "--out", str(case / name), "--json"]) == 0
        assert json.loads(capsys.readouterr().out)["modes"][1]["frequency"] == pytest.approx(shuffle, rel=1e-2)


def test_nothing_is_overwritten(case, tmp_path, capsys):
    before = {path: path.read_bytes() for path in case.iterdir() if path.is_file()}
    assert main(["new", str(case)]) == 2
    assert "is not empty" in capsys.readouterr().err
    assert {path: path.read_bytes() for path in before} == before
    (tmp_path / "file").write_text("mine")
    assert main(["new", str(tmp_path / "file")]) == 2
