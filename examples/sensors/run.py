"""Uncertainty of torque and speed at the load sides under the conditions of Tab. 1: a reconstruction.

python examples/sensors/run.py [folder for the figures]
"""

import sys
from pathlib import Path

from matching.report import common as style
from matching.report import evidence as uncertainty_figures
from matching.uncertainty.budget import read_budget
from matching.uncertainty.evaluate import evaluate
from matching.uncertainty.propagate import required

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE))
from statics import flange_loads  # noqa: E402

PUBLISHED = {"torque_M2": 0.689, "torque_M3": 0.677, "speed": 1.597}  # U, k = 2
PUBLISHED_LOADS = {"M2": (204.38, 34.48), "M3": (218.02, 29.11)}  # Tab. 1: F_y in N, M_b in N·m


def main(folder: Path | None = None) -> dict[str, float]:
    """Expanded uncertainties (k = 2) by budget, in the units of the paper; figures go into the folder."""
    for side, (force, moment) in PUBLISHED_LOADS.items():
        ours = flange_loads(side)
        print(f"{side}: F_y = {ours[0]:.1f} N, M_b = {ours[1]:.2f} N·m; Tab. 1: {force} N, {moment} N·m")
        assert abs(ours[0] / force - 1) < 0.02
        assert abs(ours[1] / moment - 1) < 0.02
    found = {}
    for name, published in PUBLISHED.items():
        budget = read_budget(HERE / f"{name}.toml")
        evaluated = evaluate(budget)
        (answer,) = evaluated.to_dict()["measurands"]
        found[name] = answer["expanded_uncertainty"]
        low, high = answer["monte_carlo"]["shortest_interval"]
        print(
            f"{answer['statement']}; published U = {published} (not the authors' budget); "
            f"Monte Carlo 95 %: ±{(high - low) / 2:.3f}"
        )
        if folder:
            folder.mkdir(parents=True, exist_ok=True)
            for kind in ("ishikawa", "contributions"):
                figure = getattr(uncertainty_figures, kind)(evaluated.measurands[0])
                (folder / f"{name}_{kind}.svg").write_bytes(style.image(figure))
    for name in ("torque_M2", "torque_M3"):
        assert abs(found[name] / PUBLISHED[name] - 1) < 0.005
    assert f"{found['torque_M2']:.3f} {found['torque_M3']:.3f} {found['speed']:.3f}" == "0.692 0.680 1.601"
    budget = read_budget(HERE / "torque_M2.toml")
    need = required(budget, budget.measurands[0], 0.5)
    (best,) = need.alone
    print("For U = 0.5 N·m one input must improve:", {name: f"{u:.3f} N·m" for name, u in best.needed.items()})
    assert list(best.needed) == ["linearity"]
    return found


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else None)
