"""JSON schemas of input files: every example is valid by them, and what the readers refuse they refuse."""

import json
import tomllib
from pathlib import Path

import pytest
from jsonschema import Draft202012Validator

import rigmatch as rm
from matching.schemas import schemas
from modelling.errors import InputError
from modelling.model_file import from_dict

EXAMPLES = Path(__file__).parents[2] / "examples"
MARKS = {"case": "dynamometers", "model": "inertias", "budget": "inputs", "fidelity": "system_dynamics",
         "channels": "channels"}  # fmt: skip
VALIDATORS = {kind: Draft202012Validator(schema) for kind, schema in schemas().items()}


def kind_of(data):
    return next((kind for kind, mark in MARKS.items() if mark in data), "")


FILES = {path: tomllib.loads(path.read_text(encoding="utf-8")) for path in sorted(EXAMPLES.rglob("*.toml"))}
KNOWN = {path: (kind_of(data), data) for path, data in FILES.items() if kind_of(data)}


def test_schemas_are_schemas():
    for validator in VALIDATORS.values():
        Draft202012Validator.check_schema(validator.schema)
    assert {kind for kind, _ in KNOWN.values()} >= {"case", "model", "budget", "fidelity"}


@pytest.mark.parametrize("path", KNOWN, ids=lambda path: f"{path.parent.name}-{path.stem}")
def test_every_example_is_valid(path):
    kind, data = KNOWN[path]
    assert [error.message for error in VALIDATORS[kind].iter_errors(data)] == []


MODEL = EXAMPLES / "diagnosis" / "model.toml"


@pytest.mark.parametrize(
    "spoil",
    [
        lambda data: data.update(inertia={}),
        lambda data: next(iter(data["inertias"].values())).update(j=1),
        lambda data: next(iter(data["inertias"].values())).pop("J"),
        lambda data: next(iter(data["shafts"].values())).update(between=["a"]),
        lambda data: next(iter(data["shafts"].values())).update(stiffness={"value": 1, "lower": 0}),
        lambda data: next(iter(data["sensors"].values())).update(measures="twist"),
        lambda data: data.update(effects=[{"kind": "lash", "at": "shafts.link"}]),
        lambda data: data.update(effects=[{"kind": "backlash", "at": "shafts.link", "gape": 1}]),
    ],
)
def test_reader_and_schema_refuse_the_same(spoil):
    data = tomllib.loads(MODEL.read_text(encoding="utf-8"))
    assert not list(VALIDATORS["model"].iter_errors(data))
    spoil(data)
    assert list(VALIDATORS["model"].iter_errors(data))
    with pytest.raises(InputError):
        from_dict(data)


def test_a_channel_file():
    rows = {"motor_speed": "n_mot", "link_torque": {"channel": "T1", "unit": "kN*m", "sign": -1}}
    assert not list(VALIDATORS["channels"].iter_errors({"header": 3, "channels": rows}))
    for wrong in ({"channels": {"a": {"unit": "s"}}}, {"channels": {"a": {"channel": "b", "sign": 2}}}, {"header": 0}):
        assert list(VALIDATORS["channels"].iter_errors(wrong))


def test_the_starter_names_its_schemas(tmp_path):
    rm.new(tmp_path)
    for path in tmp_path.glob("*.toml"):
        text = path.read_text(encoding="utf-8")
        named = tmp_path / text.splitlines()[0].removeprefix("#:schema ")
        Draft202012Validator(json.loads(named.read_text(encoding="utf-8"))).validate(tomllib.loads(text))
