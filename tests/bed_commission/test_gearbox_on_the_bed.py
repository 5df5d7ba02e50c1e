"""A bed whose specimen is a gearbox with clutches, from its case to a verified bed, in the gear of the case."""

import json
from pathlib import Path

import pytest
from needs import compiles

from matching.cli import main
from modelling.fmu.export import block, fmu
from modelling.model_file import load

EXAMPLE = Path(__file__).parents[2] / "examples" / "gear_change"
LATE = """
[[effects]]
kind = "{kind}"
at = "{place}"
{key} = "{value} ms"
"""


@compiles
@pytest.mark.long
def test_a_gearbox_stays_in_gear_through_the_circle(tmp_path):
    """The bed gives way in its clutch, of which neither the case nor the fit knows anything."""
    pytest.importorskip("fmpy")
    late = [("dead_time", "delay", 2.5), ("lag", "time_constant", 2.0)]
    places = [(f"inputs.dyno_{side}", *one) for side in ("left", "right") for one in late]
    places += [(f"sensors.flange_{side}_torque", "lag", "time_constant", 0.5) for side in ("left", "right")]
    text = (EXAMPLE / "gearbox.toml").read_text(encoding="utf-8")
    text += "".join(LATE.format(place=place, kind=kind, key=key, value=value) for place, kind, key, value in places)
    file, bed = tmp_path / "bed.toml", tmp_path / "bed.fmu"
    file.write_text(text, encoding="utf-8")
    bed.write_bytes(fmu(block([load(file)], "bed", "bed"), "2.0").content)
    out = tmp_path / "out"
    order = ["commission", str(EXAMPLE / "case.toml"), "--bed", str(bed), "--rounds", "1", "--out", str(out)]
    assert main(order) == 0
    content = json.loads((out / "commission.json").read_text(encoding="utf-8"))
    assert content["status"] == "as_predicted"
    assert not content["channels"]["wrong"]
