"""A compact electric car at 30 km/h: one rigid body behind two dynamometers.

python examples/compact_bev/run.py
"""

from pathlib import Path

from matching.match.case_file import load_case
from matching.match.match import match
from matching.match.result import MatchResult

HERE = Path(__file__).parent


def main() -> MatchResult:
    """Match, show the figures of README.md and check them."""
    case = load_case(HERE / "case.toml")
    (residual,) = case.residual_vehicle.parts
    print(f"one residual vehicle with {len(case.residual_vehicle.interfaces)} interfaces")
    assert len(case.residual_vehicle.interfaces) == 2
    assert [part.name for part in residual.inertias] == ["wheel_left", "wheel_right", "body"]

    result = match(case)
    (shuffle,) = result.targets
    checks, error = result.verification, result.response_error
    print(
        f"{result.status}: rig {shuffle.rig:.2f} Hz, vehicle {shuffle.vehicle:.3f} Hz, matched {shuffle.matched:.3f} Hz"
    )
    print(f"simulation shows {shuffle.identified:.3f} Hz, damping ratio {shuffle.identified_damping:.3f}")
    print(f"response error {error.before:.2f} before, {error.after:.4f} after, {error.unmeasured:.2f} unmeasured")
    print(f"modulus margin {checks.modulus_margin:.3f}")
    for sentence in result.limits:
        print("-", sentence)
    assert result.status == "matched"
    assert abs(shuffle.vehicle - 8.846) < 0.002
    assert abs(shuffle.matched / shuffle.vehicle - 1) < 0.01
    assert abs(shuffle.identified / shuffle.vehicle - 1) < 0.02
    assert checks.stable
    assert checks.modulus_margin >= 0.5
    assert error.after < 0.01
    assert error.unmeasured < 0.25
    return result


if __name__ == "__main__":
    main()
