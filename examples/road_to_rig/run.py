"""The reference match: from 16.7 Hz to 1.6 Hz and from 17.9 Hz to 8.44 Hz.

python examples/road_to_rig/run.py
"""

from dataclasses import replace
from pathlib import Path

from matching.match.case_file import load_case
from matching.match.loop import linear_bed
from matching.match.match import match
from matching.match.responses import error_figures
from matching.match.result import MatchResult

HERE = Path(__file__).parent


def main(seed: int = 0) -> MatchResult:
    """Match, show the figures of README.md and check them."""
    result = match(load_case(HERE / "case.toml"), seed)
    checks, error = result.verification, result.response_error
    low = replace(result.tuned, band=(0.5, 15.0))
    narrow = error_figures(low, linear_bed(low, untuned=result.case.rig))

    print(f"{result.status}, objective {result.objective:.4f}")
    for target in result.targets:
        print(f"{target.symmetry}: vehicle {target.vehicle:.3f} Hz, rig without control {target.rig:.2f} Hz, ", end="")
        print(f"matched {target.matched:.3f} Hz, from simulation {target.identified:.3f} Hz; ", end="")
        print(f"damping ratio {target.vehicle_damping:.4f} and {target.matched_damping:.4f}")
    print(f"0.5–30 Hz: before {error.before:.2f}, after {error.after:.4f}, unmeasured {error.unmeasured:.2f}")
    print(f"lower bound {error.bound:.4f} as sampled, {error.bound_unsampled:.4f} without sampling")
    print(f"0.5–15 Hz: before {narrow.before:.2f}, after {narrow.after:.4f}")
    print(f"modulus margin {checks.modulus_margin:.3f}, checks: {', '.join(checks.checks)}")

    assert result.status == "matched"
    assert checks.stable
    assert checks.modulus_margin >= 0.5
    for target, frequency in zip(result.targets, (1.600, 8.442), strict=True):
        assert abs(target.vehicle - frequency) < 0.001
        assert abs(target.matched / target.vehicle - 1) < 0.01
        assert abs(target.matched_damping - target.vehicle_damping) < 0.02
        assert abs(target.identified / target.vehicle - 1) < 0.02
    assert narrow.after <= narrow.before / 5
    assert error.after <= error.before / 10
    assert error.after <= 1.3 * error.bound
    assert error.bound_unsampled < error.bound < 0.01
    # This holds for measured torques only: the feedback alone stays farther from the vehicle.
    assert error.unmeasured < error.before / 2
    assert result.verification.beds.stable == result.verification.beds.drawn
    return result


if __name__ == "__main__":
    main()
