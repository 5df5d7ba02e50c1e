"""The guard: what the program answers, against the rows of numbers.toml, through its public interface alone."""

import shutil
import tomllib
from pathlib import Path

import numpy as np
import pytest
from reference import beds, recordings

import rigmatch as rm

NUMBERS = tomllib.loads((Path(__file__).parent / "numbers.toml").read_text(encoding="utf-8"))
EXAMPLES = beds.EXAMPLES
ROAD = EXAMPLES / "road_to_rig"


def differs(row: dict, found) -> str:
    """One line that names the row, what was expected and what was found; empty where the row holds."""
    value, side = row["value"], row.get("side", "")
    if isinstance(value, str | bool):
        holds, expected = found == value, repr(value)
    else:
        margin = row["abs"] if "abs" in row else row["rel"] * abs(value)
        low = -np.inf if side == "at most" else value - margin
        high = np.inf if side == "at least" else value + margin
        holds, expected = bool(low <= found <= high), f"{side} {value:.9g} ± {margin:.3g}".strip()
    return "" if holds else f"{row['name']}: expected {expected}, found {found!r}; source: {row['source']}"


def at(result, path: str):
    """The value behind keys and indices, with / between them."""
    for key in path.split("/"):
        result = result[int(key) if isinstance(result, list | tuple) else key]
    return result


def matched(path: Path, **options) -> dict:
    """Result of a match; beside it how far the modes seen in the simulation are from those of the tuned loop."""
    result = rm.match(path, **options).to_dict()
    seen = [abs(one["seen_in_simulation"] / one["matched"] - 1) for one in result["targets"]]
    return result | {"simulation_differs": max(seen)}


def diagnosed(folder: Path, **hidden: float) -> dict:
    """What a diagnosis names first, with its first parameter, and how far that is from the truth."""
    result = rm.diagnose(*recordings.write(folder, **hidden)).to_dict()
    assert result["causes"], f"no cause is named, the verdict is {result['verdict']!r}"
    cause = result["causes"][0]
    first = next(iter(cause["parameters"].values()))
    deviation = abs(first["value"] - next(iter(hidden.values()))) / first["standard_uncertainty"]
    named = {"cause": f"{cause['kind']} at {cause['at']}", "first": first["value"], "standard_deviations": deviation}
    return named | {"count": len(result["causes"])}


def mapped(folder: Path) -> dict:
    """Points of a map by ``dead time, flange stiffness``."""
    axes = "loop.dead_time=0.5 ms,8 ms", "rig.shafts.flange.stiffness=4e4,1e5"
    points = rm.map(beds.small(folder, "model_based"), *axes, starts=1, workers=1).to_dict()["points"]
    return {f"{1e3 * own['x']:g} ms, {own['y']:g}": own for own in points}


def exported(folder: Path) -> dict:
    """Largest difference between the FMU through FMPy and the program's simulation, as a share of a reading's range."""
    fmpy = pytest.importorskip("fmpy")
    if not any(map(shutil.which, ("cc", "gcc", "clang"))):
        pytest.skip("no C compiler here, so the FMU has no binary")
    model, recording = recordings.write(folder)
    model.write_text(recordings.MODEL + beds.backlash("link"), encoding="utf-8")
    own = rm.simulate(model, recording, start="rest")
    columns = np.genfromtxt(recording, delimiter=",", skip_header=1)
    step = 2.5e-4  # s; an input is held over a step of FMI 2.0, so each step gets the torque at its middle
    signals = np.array([(t - step / 2, u) for t, u in columns[:, :2]], dtype=[("time", float), ("motor_torque", float)])
    run = fmpy.simulate_fmu(
        str(rm.export(model, folder / "drive.fmu")), stop_time=columns[-1, 0], output_interval=step, input=signals,
        output=list(recordings.NOISE),
    )  # fmt: skip
    differences = []
    for name in recordings.NOISE:
        expected = own.readings[name]
        differences.append(np.abs(np.interp(own.time, run["time"], run[name]) - expected).max() / np.ptp(expected))
    return {"differs": max(differences)}


def fidelity(arithmetic: str) -> dict:
    return rm.fidelity(EXAMPLES / "fidelity" / "tab2.toml", arithmetic=arithmetic, draws=1000).to_dict()


def gum(name: str) -> dict:
    return rm.uncertainty(EXAMPLES / "gum" / f"{name}.toml", draws=1000).to_dict()


LASHES = beds.backlash("side_left", "side_right")
RESULTS = {
    "vehicle": lambda folder: rm.modes(ROAD / "vehicle.toml").to_dict(),
    "vehicle_damped": lambda folder: rm.modes(ROAD / "vehicle.toml", damped=True).to_dict(),
    "rig": lambda folder: rm.modes(ROAD / "rig.toml").to_dict(),
    "pi": lambda folder: matched(beds.reference(folder, "case", structure="pi"), starts=1),
    "model_based": lambda folder: matched(beds.reference(folder, "case"), starts=1),
    "observer": lambda folder: matched(beds.reference(folder), beds=50),
    "observer_5_ms": lambda folder: matched(beds.reference(folder, dead_time=0.005), beds=50),
    "observer_8_ms": lambda folder: matched(beds.reference(folder, dead_time=0.008), beds=50),
    "two_lashes": lambda folder: matched(
        beds.small(folder, more={"vehicle": beds.backlash("side", "tyre"), "rig": beds.backlash("side")}), beds=20
    ),
    "two_lashes_at_rest": lambda folder: matched(beds.reference(folder, more=LASHES), beds=50),
    "twins": lambda folder: matched(beds.twins(folder), beds=50),
    "map": mapped,
    "tolerance": lambda folder: rm.tolerance(
        ROAD / "case.toml", 4000, added={"loop.dead_time": 0.1}, workers=1
    ).to_dict(),
    "end_gauge": lambda folder: gum("end_gauge"),
    "impedance": lambda folder: gum("impedance"),
    "fidelity_published": lambda folder: fidelity("published"),
    "fidelity_defined": lambda folder: fidelity("definition"),
    "backlash": lambda folder: diagnosed(folder, gap=0.024),
    "friction": lambda folder: diagnosed(folder, friction=1.5),
    "wrong_inertia": lambda folder: diagnosed(folder, load=1.25),
    "fmu": exported,
}
# Matches, studies and diagnoses: others of each run every time.
LONG = {
    "backlash", "friction", "map", "model_based", "observer", "observer_5_ms", "observer_8_ms", "pi", "tolerance",
    "twins", "two_lashes", "two_lashes_at_rest",
}  # fmt: skip


@pytest.mark.parametrize("of", [pytest.param(name, marks=pytest.mark.long if name in LONG else ()) for name in RESULTS])
def test_numbers(of, tmp_path):
    result = RESULTS[of](tmp_path)
    lines = [differs(row, at(result, row["field"])) for row in NUMBERS[of]]
    assert not any(lines), "\n".join(line for line in lines if line)


def test_every_row_belongs_to_a_result():
    assert set(NUMBERS) == set(RESULTS)
