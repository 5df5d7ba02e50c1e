"""The functions behind the commands, in Python: each takes a path or what another has read, each result shows itself.

    python examples/python_api/run.py [DIR]      figures go to DIR (default: python_api_out)

`matching.match` and `matching.diagnose` are used the same way; see ../road_to_rig and ../diagnosis.
"""

import sys
from pathlib import Path

import numpy as np

import rigmatch as rm

HERE = Path(__file__).parent.parent
REFERENCE = HERE / "road_to_rig"


def main(out: Path) -> dict[str, float]:
    """Draw four results and return the numbers that matter."""
    out.mkdir(parents=True, exist_ok=True)
    vehicle, rig = rm.load(REFERENCE / "vehicle.toml"), rm.load(REFERENCE / "rig.toml")

    found = rm.modes(vehicle)
    shuffle = next(mode for mode in found if mode.symmetry == "symmetric" and mode.frequency > 0)
    found.plot().savefig(out / "modes.png")
    shuffle.animate().save(out / "shuffle.svg")  # moves in any browser

    on_the_rig = next(mode for mode in rm.modes(rig) if mode.symmetry == "symmetric" and mode.frequency > 0)
    stiffer = rm.modes(rig, {name: 2 * rig.parameters[name].value for name in rig.parameters if is_side_shaft(name)})
    stiffer_shuffle = next(mode for mode in stiffer if mode.symmetry == "symmetric" and mode.frequency > 0)

    answers = rm.response(vehicle, np.geomspace(0.5, 30, 300))  # (f, y, u), complex
    answers.plot().savefig(out / "response.png")

    trust = rm.fidelity(HERE / "fidelity" / "tab2.toml")
    trust.plot().savefig(out / "fidelity.png")
    return {
        "shuffle of the vehicle [Hz]": shuffle.frequency,
        "shuffle of the rig [Hz]": on_the_rig.frequency,
        "the same, side shafts twice as stiff [Hz]": stiffer_shuffle.frequency,
        "R_XiL": trust.to_dict()["R_XiL"],
    }


def is_side_shaft(name: str) -> bool:
    """Whether a parameter is the stiffness of a side shaft."""
    return name.startswith("shafts.side") and name.endswith(".stiffness")


if __name__ == "__main__":
    numbers = main(Path(sys.argv[1] if len(sys.argv) > 1 else "python_api_out"))
    for what, value in numbers.items():
        print(f"{what:40} {value:.4g}")
    vehicle, rig, stiffer, trust = numbers.values()
    assert abs(vehicle - 8.439) < 0.001
    assert abs(rig - 17.946) < 0.001
    assert 1.3 * rig < stiffer < 2**0.5 * rig  # nearly all of the twist is in the side shafts
    assert abs(trust - 0.8854) < 0.0001
